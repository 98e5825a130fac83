"""Equations: plain Python functions of scalars, written once and used three ways.

The same function is compiled into simulation kernels, evaluated with complex arguments for exact derivatives, and
traced here for what depends on what. The trace also refuses what would break the other two uses.
"""

import dis
import functools
import hashlib
from collections.abc import Callable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar

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


LIBRARIES = frozenset({"numpy", "numba"})
"""Packages whose functions are not looked into: their version is the compiler's."""


def equation(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a function as an equation: scalars in, a scalar or a tuple of scalars out, no `if` on values."""
    function.__dict__["is_equation"] = True
    return function


class Traced:
    """A scalar that remembers which arguments it was computed from."""

    __slots__ = ("sources",)
    __hash__ = None  # type: ignore[assignment]  # a traced value has no value to hash or compare

    def __init__(self, sources: frozenset[str]) -> None:
        self.sources = sources

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **_: object) -> "Traced":
        if ufunc.__name__ not in ALLOWED_FUNCTIONS or method != "__call__":
            allowed = ", ".join(sorted(ALLOWED_FUNCTIONS))
            message = f"an equation calls numpy.{ufunc.__name__}, which does not keep derivatives; use one of {allowed}"
            raise InvalidInputError(message, function=ufunc.__name__)
        return Traced(frozenset[str]().union(*(item.sources for item in inputs if isinstance(item, Traced))))

    def _combine(self, other: object) -> "Traced":
        return Traced(self.sources | other.sources) if isinstance(other, Traced) else self

    def _unary(self) -> "Traced":
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _combine
    __truediv__ = __rtruediv__ = __pow__ = __rpow__ = _combine
    __neg__ = __pos__ = _unary

    def _refuse(self, *_: object) -> bool:
        message = "an equation decides on a value (if, <, >, == or abs); write the limit with numpy.minimum or numpy.maximum"
        raise InvalidInputError(message)

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = __abs__ = __float__ = __complex__ = __int__ = _refuse


def trace(function: Equation, parameters: object, *arguments: tuple[str, int]) -> tuple[frozenset[str], ...]:
    """Find which arguments each result of an equation depends on, by its structure and not by sampled values.

    Args:
        function: equation called as function(parameters, a, b, ...) that returns a tuple.
        parameters: its first argument.
        arguments: for each further argument its letter and its length.

    Returns:
        For each result the names it depends on, for example frozenset({"x0", "u2"}).

    Raises:
        InvalidInputError: the equation branches on a value, calls a function without derivative, or returns anything
            but a tuple of floating-point scalars.
    """
    vectors = [tuple(Traced(frozenset({f"{letter}{k}"})) for k in range(length)) for letter, length in arguments]
    results = function(parameters, *vectors)
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
    order: dict[int, FunctionType] = {}

    def visit(value: object) -> None:
        if isinstance(value, FunctionType) and not _is_library(value) and id(value) not in order:
            for _, entry in _names(value):
                visit(entry)
            order[id(value)] = value

    for function in functions:
        visit(function)
    return tuple(order.values())


def _is_library(function: FunctionType) -> bool:
    """Whether a function belongs to a library that compiles by its own means."""
    return str(function.__module__).partition(".")[0] in LIBRARIES


def _reached(value: object, seen: set[int]) -> Iterator[str]:
    if isinstance(value, FunctionType) and not _is_library(value):
        if id(value) in seen:
            return
        seen.add(id(value))
        yield from _code_parts(value.__code__)
        for default in value.__defaults__ or ():
            yield from _reached(default, seen)
        for name, entry in _names(value):
            yield name
            yield from _reached(entry, seen)
    elif isinstance(value, ModuleType):
        yield f"module {value.__name__}"
    elif isinstance(value, type):
        yield f"class {value.__qualname__} {getattr(value, '_fields', '')}"
    elif isinstance(value, np.ufunc):
        yield f"ufunc {value.__name__}"
    elif isinstance(value, tuple):
        for entry in value:
            yield from _reached(entry, seen)
    elif value is None or isinstance(value, bool | int | float | complex | str | bytes):
        yield repr(value)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.tolist()!r}"
    else:
        yield f"{type(value).__qualname__} {getattr(value, '__name__', '')}"


def _code_parts(code: CodeType) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_parts(constant)
        else:
            yield repr(constant)


@functools.cache
def _global_paths(code: CodeType) -> tuple[tuple[str, ...], ...]:
    paths: list[tuple[str, ...]] = []
    chain: tuple[str, ...] = ()
    for instruction in dis.get_instructions(code):
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
            entry = getattr(entry, step, None) if isinstance(entry, ModuleType) else None
        if entry is not None:
            yield ".".join(path), entry
