"""The tables that a run reads and writes beside its state, as views that compiled code makes from their addresses.

A run's state `s` holds the address and the shape of each table. Passing arrays instead costs three times the run time
of a simulation, because compiled code counts references to each array on each call. Who calls a kernel keeps the arrays alive.
"""

from typing import Any

import numpy as np
from numba import carray, types
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from revline.dde.run import TABLES, Floats, Record


@intrinsic  # type: ignore[untyped-decorator]  # numba publishes no types
def as_pointer(typing_context: Any, address: Any) -> tuple[Signature, Any]:  # noqa: ARG001 - the form of an intrinsic
    """Turn an address into a pointer to floats, inside compiled code."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.int64), generate


def nodes_of(s: Record) -> Floats:
    """History, one row per node: time, count of nodes before it that are one step apart, value per channel."""
    return carray(as_pointer(s.nodes_at), (s.nodes_rows, s.nodes_columns))


def segments_of(s: Record) -> Floats:
    """Smooth pieces of history, one row each: index of its first node, its time, order of the break per channel."""
    return carray(as_pointer(s.segments_at), (s.segments_rows, s.segments_columns))


def terms_of(s: Record) -> Floats:
    """Input signals, one row per term: index of the input, then the row of `revline.signals`."""
    return carray(as_pointer(s.terms_at), (s.terms_rows, s.terms_columns))


def record_of(s: Record) -> Floats:
    """Samples of all recordings: time, value."""
    return carray(as_pointer(s.record_at), (s.record_rows, s.record_columns))


def breaks_of(s: Record) -> Floats:
    """Where an input is not smooth: time, order per input."""
    return carray(as_pointer(s.breaks_at), (s.breaks_rows, s.breaks_columns))


def samples_of(s: Record) -> Floats:
    """What is stored: time, states, inputs, outputs."""
    return carray(as_pointer(s.samples_at), (s.samples_rows, s.samples_columns))


def attach_tables(state: np.ndarray, tables: dict[str, Floats]) -> None:
    """Write addresses and shapes of all tables into a state; the caller keeps the arrays alive while a kernel runs."""
    for name in TABLES:
        table = tables[name]
        state[f"{name}_at"], state[f"{name}_rows"], state[f"{name}_columns"] = table.ctypes.data, *table.shape
