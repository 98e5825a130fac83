"""What a sampled controller's equations compute, recorded operation by operation, and written down in another language.

The equations are called with scalars that remember how they were made. Nothing is simplified and no order is changed, so that a computer
that rounds as IEEE 754 says gives the same bits.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from revline.equations import UPDATE_FUNCTIONS
from revline.errors import InvalidInputError
from revline.sampled import SampledController

OPERATORS: Final[Mapping[str, str]] = MappingProxyType({"add": "+", "subtract": "-", "multiply": "*", "divide": "/"})


NAME: Final = re.compile(r"(?!(v|w)[0-9]+$)[a-z][a-z0-9_]{0,60}")
TAKEN: Final = (
    " auto break case char const continue default do double else enum extern float for goto if inline int long real register restrict "
    "return short signed sizeof static struct switch typedef union unsigned void volatile while end function "
    "p state output next seconds minimum maximum fmin fmax fmin_ fmax_ "
)
"""Words of C and MATLAB, and names that the written files use themselves."""


def check_names(controller: SampledController) -> None:
    """Refuse signals whose names cannot stand in code.

    Raises:
        InvalidInputError: a name of a measurement or a command is none, is taken, or stands twice.
    """
    names = [v.name for v in (*controller.measurements, *controller.commands)]
    for k, name in enumerate(names):
        if not NAME.fullmatch(name) or f" {name} " in TAKEN or name in names[:k]:
            message = (
                f"the signal {name!r} cannot be named so in code; give it a name of lower-case letters, digits and underscores that is no "
                "word of C and not measurement, command, state, output or seconds"
            )
            raise InvalidInputError(message, name=name)


class Operation:
    """A scalar and how it was made: by an operation on others, or given from outside by name."""

    __slots__ = ("arguments", "kind", "name")
    __hash__ = None  # type: ignore[assignment]  # two scalars of one name are not one

    def __init__(self, kind: str, arguments: tuple["Operation | float", ...] = (), name: str = "") -> None:
        self.kind, self.arguments, self.name = kind, arguments, name

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **_: object) -> "Operation":
        if ufunc.__name__ not in UPDATE_FUNCTIONS or method != "__call__":
            message = (
                f"an update calls numpy.{ufunc.__name__}, which cannot be written as code; use one of {', '.join(sorted(UPDATE_FUNCTIONS))}"
            )
            raise InvalidInputError(message, function=ufunc.__name__)
        return Operation(ufunc.__name__, inputs)

    def __add__(self, other: Any) -> "Operation":
        return Operation("add", (self, other))

    def __radd__(self, other: Any) -> "Operation":
        return Operation("add", (other, self))

    def __sub__(self, other: Any) -> "Operation":
        return Operation("subtract", (self, other))

    def __rsub__(self, other: Any) -> "Operation":
        return Operation("subtract", (other, self))

    def __mul__(self, other: Any) -> "Operation":
        return Operation("multiply", (self, other))

    def __rmul__(self, other: Any) -> "Operation":
        return Operation("multiply", (other, self))

    def __truediv__(self, other: Any) -> "Operation":
        return Operation("divide", (self, other))

    def __rtruediv__(self, other: Any) -> "Operation":
        return Operation("divide", (other, self))

    def __neg__(self) -> "Operation":
        return Operation("negative", (self,))


def given(name: str) -> Operation:
    """A scalar that comes from outside, under the name that the other language has for it."""
    return Operation("given", (), name)


@dataclass(frozen=True, slots=True)
class Statement:
    """A name and the expression that it stands for."""

    name: str
    expression: str


def write_statements(
    results: Sequence[Operation | float], names: Sequence[str], literal: Callable[[float], str], *, prefix: str = "v"
) -> tuple[Statement, ...]:
    """Write results as statements, each scalar that is used more than once under a name of its own.

    Args:
        results: what the equation returned.
        names: of the results, in the other language; each gets a statement.
        literal: writes a number in the other language.
        prefix: of the names of what lies between.

    Returns:
        Statements in an order in which each uses earlier ones only. Expressions use + - * / ( ) and the functions minimum, maximum, fmin
        and fmax of two arguments.
    """
    uses: dict[int, int] = {}
    for result in results:
        _count(result, uses)
    known: dict[int, str] = {}
    statements: list[Statement] = []

    def write(node: Operation | float) -> str:
        if not isinstance(node, Operation):
            return literal(float(node))
        if node.kind == "given":
            return node.name
        if id(node) in known:
            return known[id(node)]
        text = _expression(node, [write(argument) for argument in node.arguments])
        if uses[id(node)] > 1:
            name = f"{prefix}{len(known) + 1}"
            statements.append(Statement(name, _bare(text)))
            known[id(node)] = text = name
        return text

    for result, name in zip(results, names, strict=True):
        statements.append(Statement(name, _bare(write(result))))
    return tuple(statements)


def _count(node: Operation | float, uses: dict[int, int]) -> None:
    if isinstance(node, Operation):
        uses[id(node)] = uses.get(id(node), 0) + 1
        if uses[id(node)] == 1:
            for argument in node.arguments:
                _count(argument, uses)


def _expression(node: Operation, arguments: list[str]) -> str:
    if node.kind == "negative":
        return f"(-{arguments[0]})"
    if node.kind in OPERATORS:
        return f"({arguments[0]} {OPERATORS[node.kind]} {arguments[1]})"
    return f"{node.kind}({arguments[0]}, {arguments[1]})"


def _bare(text: str) -> str:
    """Leave out a pair of parentheses around the whole."""
    if not text.startswith("("):
        return text
    depth = 0
    for position, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if position == len(text) - 1 else text
    return text


def flat_parameters(parameters: Any, path: tuple[str, ...] = ()) -> list[tuple[str, float]]:
    """List the numbers of parameters, in tuples of any depth, each under a name of its own: "law_kp", "tables_ki_0_3".

    Args:
        parameters: NamedTuple of numbers, or of such.
        path: names that lead there.
    """
    if not isinstance(parameters, tuple):
        return [("_".join(path), float(parameters))]
    names = getattr(parameters, "_fields", [str(k) for k in range(len(parameters))])
    return [entry for name, part in zip(names, parameters, strict=True) for entry in flat_parameters(part, (*path, name))]


def named_parameters(parameters: Any, path: tuple[str, ...] = ()) -> Any:
    """Give parameters of the same form whose numbers are scalars from outside, under the names of `flat_parameters` in a struct p."""
    if not isinstance(parameters, tuple):
        return given(f"p.{'_'.join(path)}")
    names = getattr(parameters, "_fields", [str(k) for k in range(len(parameters))])
    parts = [named_parameters(part, (*path, name)) for name, part in zip(names, parameters, strict=True)]
    return type(parameters)(*parts) if hasattr(parameters, "_fields") else tuple(parts)
