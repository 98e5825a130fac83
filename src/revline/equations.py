"""Equations: plain Python functions of scalars, written once and used three ways.

The same function is compiled into simulation kernels, evaluated with complex arguments for exact derivatives, and
traced here for what depends on what. The trace also refuses what would break the other two uses.
"""

import dis
import functools
import hashlib
import re
from collections.abc import Callable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any, ClassVar, ParamSpec, TypeVar

import numpy as np

from revline.errors import InvalidInputError

P = ParamSpec("P")
R = TypeVar("R")
Equation = Callable[..., Any]

ALLOWED_FUNCTIONS = frozenset(
    {"add", "subtract", "multiply", "divide", "negative", "positive", "power", "square", "sqrt", "exp", "log"}
    | {"sin", "cos", "tan", "sinh", "cosh", "tanh", "minimum", "maximum"}
)
"""Functions of numpy that an equation may call: each compiles and keeps its derivative on complex numbers."""

UPDATE_FUNCTIONS = frozenset({"add", "subtract", "multiply", "divide", "negative", "minimum", "maximum", "fmin", "fmax"})
"""Functions of numpy that a sampled controller may call: every computer gives the same result to the last bit.

`fmin` and `fmax` pass over what is no number, which lets a controller go on without a sensor.
"""


LIBRARIES = frozenset({"numpy", "numba"})
"""Packages whose functions are not looked into: their version is the compiler's."""


def equation(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a function as an equation: scalars in, a scalar or a tuple of scalars out, no `if` on values."""
    function.__dict__["is_equation"] = True
    return function


class Traced:
    """A scalar that remembers which arguments it was computed from."""

    allowed: ClassVar[frozenset[str]] = ALLOWED_FUNCTIONS
    why_not: ClassVar[str] = "which does not keep derivatives"

    __slots__ = ("sources",)
    __hash__ = None  # type: ignore[assignment]  # a traced value has no value to hash or compare

    def __init__(self, sources: frozenset[str]) -> None:
        self.sources = sources

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **_: object) -> "Traced":
        if ufunc.__name__ not in self.allowed or method != "__call__":
            message = f"an equation calls numpy.{ufunc.__name__}, {self.why_not}; use one of {', '.join(sorted(self.allowed))}"
            raise InvalidInputError(message, function=ufunc.__name__)
        return type(self)(frozenset[str]().union(*(item.sources for item in inputs if isinstance(item, Traced))))

    def _combine(self, other: object) -> "Traced":
        return type(self)(self.sources | other.sources) if isinstance(other, Traced) else self

    def _power(self, other: object) -> "Traced":
        return self._combine(other)

    def _unary(self) -> "Traced":
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _combine
    __truediv__ = __rtruediv__ = _combine
    __neg__ = __pos__ = _unary

    def __pow__(self, other: object) -> "Traced":
        return self._power(other)

    __rpow__ = __pow__

    def _refuse_decision(self, *_: object) -> bool:
        message = "an equation decides on a value (if, <, >, == or abs); write the limit with numpy.minimum or numpy.maximum"
        raise InvalidInputError(message)

    def _refuse_rounding(self, *_: object) -> Any:
        message = "an equation rounds a value (//, %, round or int), which has no derivative; write it without"
        raise InvalidInputError(message)

    def _refuse_conversion(self) -> Any:
        message = (
            "an equation turns a value into a plain float (float or a function of math), which loses its derivative; use numpy's functions"
        )
        raise InvalidInputError(message)

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = __abs__ = _refuse_decision
    __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = __divmod__ = __rdivmod__ = _refuse_rounding
    __round__ = __trunc__ = __floor__ = __ceil__ = __int__ = __index__ = _refuse_rounding
    __float__ = __complex__ = _refuse_conversion


class TracedUpdate(Traced):
    """A scalar of a sampled controller: only what every computer does alike may be done to it."""

    allowed = UPDATE_FUNCTIONS
    why_not = "which not every computer rounds alike"

    __slots__ = ()

    def _power(self, _: object) -> "Traced":
        message = "an equation raises to a power, which not every computer rounds alike; write the product"
        raise InvalidInputError(message)


def trace(function: Equation, parameters: object, *arguments: tuple[str, int], kind: type[Traced] = Traced) -> tuple[frozenset[str], ...]:
    """Find which arguments each result of an equation depends on, by its structure and not by sampled values.

    Args:
        function: equation called as function(parameters, a, b, ...) that returns a tuple.
        parameters: its first argument.
        arguments: for each further argument its letter and its length.
        kind: of scalar that the equation is called with; it decides what may be done to it.

    Returns:
        For each result the names it depends on, for example frozenset({"x0", "u2"}).

    Raises:
        InvalidInputError: the equation fails, branches on a value, calls a function without derivative, or returns
            anything but a tuple of floating-point scalars.
    """
    vectors = [tuple(kind(frozenset({f"{letter}{k}"})) for k in range(length)) for letter, length in arguments]
    try:
        results = function(parameters, *vectors)
    except InvalidInputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError) as error:
        given = ", ".join(f"{length} {letter}" for letter, length in arguments)
        message = f"equation {function.__name__} fails with its parameters and {given}: {type(error).__name__}: {error}"
        raise InvalidInputError(message) from error
    if not isinstance(results, tuple):
        message = f"equation {function.__name__} returns {type(results).__name__}; return a tuple of scalars, also for one result: (value,)"
        raise InvalidInputError(message)
    found = []
    for position, result in enumerate(results):
        if isinstance(result, Traced):
            found.append(result.sources)
        elif isinstance(result, float | complex) and not isinstance(result, bool):
            found.append(frozenset[str]())
        else:
            message = f"equation {function.__name__}, result {position}: {result!r} is no floating-point scalar; write 0.0, not 0"
            raise InvalidInputError(message)
    return tuple(found)


def equation_digest(*functions: Equation) -> str:
    """Digest everything that equations compute with: their code, and all functions and constants that they reach.

    A compiled kernel that closes over this text is never taken from the cache after an equation in any file changed.
    """
    digest = hashlib.sha256()
    seen: set[int] = set()
    for function in functions:
        for part in _reached(function, seen):
            digest.update(part.encode())
            digest.update(b"\0")
    return digest.hexdigest()[:16]


def reached_functions(*functions: Equation) -> tuple[FunctionType, ...]:
    """List the plain functions that equations call, themselves included, callees first."""
    order: list[FunctionType] = []
    seen: set[int] = set()

    def visit(value: object) -> None:
        if isinstance(value, FunctionType) and not _is_library(value) and id(value) not in seen:
            seen.add(id(value))
            for _, entry in _names(value):
                visit(entry)
            order.append(value)

    for function in functions:
        visit(function)
    return tuple(order)


def _is_library(function: FunctionType) -> bool:
    """Whether a function belongs to a library that compiles by its own means."""
    return str(function.__module__).partition(".")[0] in LIBRARIES


def _reached(value: object, seen: set[int]) -> Iterator[str]:
    plain = getattr(value, "py_func", value)  # numba keeps the Python function that it compiled under this name
    if isinstance(plain, FunctionType) and not _is_library(plain):
        yield from _reached_by_function(plain, seen)
    elif isinstance(value, tuple | list):
        yield f"{type(value).__name__} {len(value)}"
        for entry in value:
            yield from _reached(entry, seen)
    else:
        yield _content(value)


def _reached_by_function(function: FunctionType, seen: set[int]) -> Iterator[str]:
    if id(function) in seen:
        return
    seen.add(id(function))
    yield from _code_parts(function.__code__)
    for default in (*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).items()):
        yield from _reached(default, seen)
    for name, entry in _names(function):
        yield name
        yield from _reached(entry, seen)


def _content(value: object) -> str:
    """Text for anything but functions and sequences, without the addresses that differ from process to process."""
    if isinstance(value, ModuleType):
        return f"module {value.__name__}"
    if isinstance(value, type):
        return f"class {value.__qualname__} {getattr(value, '_fields', '')}"
    if isinstance(value, np.ufunc):
        return f"ufunc {value.__name__}"
    if isinstance(value, np.ndarray):
        return f"array {value.dtype.str} {value.shape} {value.tobytes().hex()}"
    if isinstance(value, set | frozenset):
        return f"set {sorted(map(_content, value))}"
    return re.sub(r" at 0x[0-9A-Fa-f]+", "", repr(value))


def _code_parts(code: CodeType) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_parts(constant)
        else:
            yield _content(constant)


@functools.cache
def _global_paths(code: CodeType) -> tuple[tuple[str, ...], ...]:
    """The dotted names that start at a global, those of inner functions and comprehensions included."""
    paths = [path for constant in code.co_consts if isinstance(constant, CodeType) for path in _global_paths(constant)]
    chain: tuple[str, ...] = ()
    for instruction in dis.get_instructions(code):
        if instruction.opname == "EXTENDED_ARG":
            continue
        if instruction.opname in {"LOAD_GLOBAL", "LOAD_NAME"}:
            chain = (str(instruction.argval),)
        elif instruction.opname in {"LOAD_ATTR", "LOAD_METHOD"} and chain:
            chain = (*chain, str(instruction.argval))
        else:
            chain = ()
        if chain:
            paths.append(chain)
    return tuple(paths)


def _names(function: FunctionType) -> Iterator[tuple[str, object]]:
    """The globals (through modules too) and closure cells that a function mentions, by name."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents
    for path in _global_paths(function.__code__):
        if path[0] not in function.__globals__:
            continue
        entry = function.__globals__[path[0]]
        for step in path[1:]:
            entry = getattr(entry, step, None) if isinstance(entry, ModuleType | type) else None
        if entry is not None:
            yield ".".join(path), entry
