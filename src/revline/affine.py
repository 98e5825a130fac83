"""Scalars that remember how they depend on one unknown: not at all, along a straight line, or otherwise.

Evaluating an equation on them tells, by its structure and not by samples, whether an algebraic loop through it can be solved exactly.
"""

from collections.abc import Callable, Mapping
from enum import IntEnum
from types import MappingProxyType

import numpy as np


class Dependence(IntEnum):
    """How a value depends on the unknown."""

    NONE = 0
    STRAIGHT = 1
    OTHER = 2


class Affine:
    """A scalar that is value + slope * unknown, or depends on the unknown in another way.

    Attributes:
        dependence: on the unknown.
        value: where the unknown is 0; `None` where it varies with other signals.
        slope: per unit of the unknown; `None` where it varies with other signals.
    """

    __slots__ = ("dependence", "slope", "value")

    def __init__(self, dependence: Dependence, value: float | None, slope: float | None) -> None:
        self.dependence = dependence
        self.value = value
        self.slope = slope

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: "float | Affine", **_: object) -> "Affine":
        parts = [as_affine(item) for item in inputs]
        exact = LINEAR_FUNCTIONS.get(ufunc.__name__) if method == "__call__" else None
        return exact(*parts) if exact else _through(*parts)

    def __add__(self, other: "float | Affine") -> "Affine":
        return _add(self, as_affine(other))

    def __sub__(self, other: "float | Affine") -> "Affine":
        return _subtract(self, as_affine(other))

    def __rsub__(self, other: float) -> "Affine":
        return _subtract(as_affine(other), self)

    def __mul__(self, other: "float | Affine") -> "Affine":
        return _multiply(self, as_affine(other))

    def __truediv__(self, other: "float | Affine") -> "Affine":
        return _divide(self, as_affine(other))

    def __rtruediv__(self, other: float) -> "Affine":
        return _divide(as_affine(other), self)

    def __pow__(self, other: "float | Affine") -> "Affine":
        return _through(self, as_affine(other))

    def __rpow__(self, other: float) -> "Affine":
        return _through(as_affine(other), self)

    def __neg__(self) -> "Affine":
        return _negate(self)

    def __pos__(self) -> "Affine":
        return self

    __radd__ = __add__
    __rmul__ = __mul__


def unknown() -> Affine:
    """Make the unknown itself."""
    return Affine(Dependence.STRAIGHT, 0.0, 1.0)


def varying() -> Affine:
    """Make a signal that does not depend on the unknown, and of which nothing else is known."""
    return Affine(Dependence.NONE, None, 0.0)


def as_affine(value: "float | Affine") -> Affine:
    """Take a plain number as one that does not depend on the unknown."""
    return value if isinstance(value, Affine) else Affine(Dependence.NONE, value, 0.0)


def _through(*parts: Affine) -> Affine:
    """Pass through a function that is not linear."""
    return varying() if all(part.dependence is Dependence.NONE for part in parts) else Affine(Dependence.OTHER, None, None)


def _known_sum(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a + b


def _known_product(a: float | None, b: float | None) -> float | None:
    return 0.0 if 0.0 in (a, b) else None if a is None or b is None else a * b


def _add(a: Affine, b: Affine) -> Affine:
    return Affine(max(a.dependence, b.dependence), _known_sum(a.value, b.value), _known_sum(a.slope, b.slope))


def _negate(a: Affine) -> Affine:
    return Affine(a.dependence, None if a.value is None else -a.value, None if a.slope is None else -a.slope)


def _subtract(a: Affine, b: Affine) -> Affine:
    return _add(a, _negate(b))


def _multiply(a: Affine, b: Affine) -> Affine:
    if a.dependence + b.dependence > Dependence.STRAIGHT:
        return _through(a, b)
    straight, factor = (a, b) if a.dependence is Dependence.STRAIGHT else (b, a)
    return Affine(straight.dependence, _known_product(straight.value, factor.value), _known_product(straight.slope, factor.value))


def _divide(a: Affine, b: Affine) -> Affine:
    if b.dependence is not Dependence.NONE:
        return _through(a, b)
    return _multiply(a, Affine(Dependence.NONE, 1.0 / b.value if b.value else None, 0.0))


LINEAR_FUNCTIONS: Mapping[str, Callable[..., Affine]] = MappingProxyType(
    {"add": _add, "subtract": _subtract, "negative": _negate, "multiply": _multiply, "divide": _divide, "positive": lambda a: a}
)
"""Functions of numpy through which a straight line stays one."""
