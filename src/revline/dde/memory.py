"""What compiled code reads and writes by address: the tables of a run, its parameters, and tuples kept in its state.

A run's state `s` holds the address and the shape of each table. Passing arrays or parameters to functions instead costs three
times the run time of a simulation: compiled code counts references to arrays, and copies parameters on each call.
Who calls a kernel keeps the arrays alive. These are numba's intrinsics: they turn into a few machine instructions where they are called.
"""

import functools
import itertools
import math
from collections.abc import Iterator
from typing import Any

from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.errors import RequireLiteralValue
from numba.core.typing.templates import Signature
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from revline.dde.run import Floats, Record
from revline.errors import InvalidInputError

VIEW = types.Array(types.float64, 2, "C")
POINTER = ir.DoubleType().as_pointer()

Compiled = Any
"""A function that compiled code alone can call; numba publishes no type for it."""


def view_of(name: str) -> Compiled:
    """Make the function of a run's state that gives one of its tables as an array, without counting references."""

    def define(_: Any, s: Any) -> Any:
        def generate(context: Any, builder: Any, __: Any, arguments: Any) -> Any:
            address, rows, columns = (_field(context, builder, s, arguments[0], f"{name}_{what}") for what in ("at", "rows", "columns"))
            size = context.get_constant(types.intp, 8)
            view = make_array(VIEW)(context, builder)
            populate_array(
                view,
                data=builder.inttoptr(address, POINTER),
                shape=cgutils.pack_array(builder, [rows, columns]),
                strides=cgutils.pack_array(builder, [builder.mul(columns, size), size]),
                itemsize=size,
                meminfo=None,
                parent=None,
            )
            return view._getvalue()  # noqa: SLF001 - numba's own way to make an array

        return VIEW(s), generate

    return intrinsic(define)


nodes_of: Compiled = view_of("nodes")
"""History, one row per node: time, count of nodes before it that are one step apart, value per channel."""

segments_of = view_of("segments")
"""Smooth pieces of history, one row each: index of its first node, its time, order of the break per channel."""

terms_of = view_of("terms")
"""Input signals, one row per term: index of the input, then the row of `revline.signals`."""

record_of = view_of("record")
"""Samples of all recordings: time, value."""

breaks_of = view_of("breaks")
"""Where an input is not smooth: time, order per input."""

samples_of = view_of("samples")
"""What is stored: time, states, inputs, outputs."""

disturbances_of = view_of("disturbances")
"""What disturbs a sampled controller, one row per sample: shift of the sample, then what is added to each measurement."""

updates_of = view_of("updates")
"""What a sampled controller did, one row per sample: time, seconds since the one before, measurements, commands, states, outputs."""


def _define_load(_: Any, array: Any, size: Any) -> Any:
    if not isinstance(size, types.IntegerLiteral):
        message = "the size of a tuple must be known to the compiler"
        raise RequireLiteralValue(message)
    count = int(size.literal_value)
    result = types.UniTuple(types.float64, count)

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        data = make_array(array)(context, builder, arguments[0]).data
        return context.make_tuple(builder, result, [builder.load(_place(builder, data, k)) for k in range(count)])

    return result(array, size), generate


def _define_store(_: Any, values: Any, array: Any) -> Any:
    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        data = make_array(array)(context, builder, arguments[1]).data
        for k, kind in enumerate(values.types):
            entry = context.cast(builder, builder.extract_value(arguments[0], k), kind, types.float64)
            builder.store(entry, _place(builder, data, k))
        return context.get_dummy_value()

    return types.void(values, array), generate


load_tuple: Compiled = intrinsic(_define_load)
"""Read the first numbers of an array as a tuple of a size that the compiler knows: load_tuple(array, size)."""

store_tuple: Compiled = intrinsic(_define_store)
"""Write a tuple of numbers into the first places of an array: store_tuple(values, array)."""


def loader_of(kind: Any, table: str = "parameters") -> Compiled:
    """Make the function of a run's state that gives the parameters, a tuple of floats or of such, as a value of their own type."""

    def define(_: Any, s: Any) -> Any:
        def generate(context: Any, builder: Any, __: Any, arguments: Any) -> Any:
            data = builder.inttoptr(_field(context, builder, s, arguments[0], f"{table}_at"), POINTER)
            return _load(context, builder, kind, data, itertools.count())

        return Signature(kind, (s,), None), generate

    return intrinsic(define)


def _load(context: Any, builder: Any, kind: Any, data: Any, places: Iterator[int]) -> Any:
    parts = getattr(kind, "types", None)  # those of a tuple
    if parts is None:
        return builder.load(_place(builder, data, next(places)))
    return context.make_tuple(builder, kind, [_load(context, builder, part, data, places) for part in parts])


def _place(builder: Any, data: Any, position: int) -> Any:
    return builder.gep(data, [ir.IntType(64)(position)])


def _field(context: Any, builder: Any, kind: Any, record: Any, name: str) -> Any:
    """Read a whole number in a record."""
    return builder.load(cgutils.get_record_member(builder, record, kind.offset(name), context.get_value_type(types.int64)))


def as_floats(parameters: Any, path: str) -> Any:
    """Give parameters with every number as a float, in tuples of their own types.

    Raises:
        InvalidInputError: one is no number; the message names it.
    """
    if isinstance(parameters, tuple):
        names = getattr(parameters, "_fields", range(len(parameters)))
        parts = [part if _is_good(part) else as_floats(part, f"{path}.{name}") for name, part in zip(names, parameters, strict=True)]
        return type(parameters)(*parts) if hasattr(parameters, "_fields") else tuple(parts)
    try:
        value = float(parameters)
    except (TypeError, ValueError) as error:
        message = f"parameter {path} = {parameters!r} is no number; parameters are floats, or named tuples of floats"
        raise InvalidInputError(message, quantity=path) from error
    if math.isnan(value):
        message = f"parameter {path} = {value} is no number; give one"
        raise InvalidInputError(message, quantity=path)
    return value


def _is_good(part: Any) -> bool:
    return type(part) is float and not math.isnan(part)


def parameter_type(parameters: Any) -> Any:
    """Type that compiled code gives to parameters."""
    return _type_of(_shape_of(parameters))


def _shape_of(parameters: Any) -> Any:
    """Classes of a tuple and of all tuples in it; of a number None."""
    return (type(parameters), *map(_shape_of, parameters)) if isinstance(parameters, tuple) else None


@functools.cache
def _type_of(shape: Any) -> Any:
    """Type of parameters of a shape; numba takes long to find it, and a run that goes on in blocks asks at each."""
    return typeof(_zeros(shape))


def _zeros(shape: Any) -> Any:
    if shape is None:
        return 0.0
    kind, *parts = shape
    values = map(_zeros, parts)
    return kind(*values) if hasattr(kind, "_fields") else tuple(values)


def flatten(parameters: Any) -> Iterator[float]:
    """List all numbers of parameters, in their order."""
    if isinstance(parameters, tuple):
        for part in parameters:
            yield from flatten(part)
    else:
        yield parameters


def attach_tables(state: Record, tables: dict[str, Floats]) -> None:
    """Write addresses and shapes of all tables into a state; the caller keeps the arrays alive while a kernel runs."""
    for name, table in tables.items():
        state[f"{name}_at"], state[f"{name}_rows"], state[f"{name}_columns"] = table.ctypes.data, *table.shape
