"""Gains scheduled over two signals as an engine computer has them: tables, interpolated between, held at their ends.

Only + - * / and limits are used, so that simulation and exported code compute the same to the last bit. The delay of an engine is an angle
over its speed, K/w: time shrinks as 1/w, so that kp changes about as w and ki as its square. What is interpolated may be the gains divided
by such a power of the speed, which changes less from node to node.

Source: of gain schedules Astrom and Wittenmark (1995), Adaptive Control, chapter 9.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.equations import equation
from revline.errors import InvalidInputError
from revline.values import make_read_only

Floats = NDArray[np.float64]
Row = tuple[float, ...]

MOST_POWER = 2


class Scaling(NamedTuple):
    """By which whole power of the first signal each gain is divided before it is tabulated: 0, 1 or 2."""

    kp: int = 1
    ki: int = 2
    kd: int = 0


PLAIN = Scaling(0, 0, 0)

EDGE = 1e-6
"""A value beyond the table by no more than this part of its axis is at its edge: a trim is known no better."""


class ScheduleTables(NamedTuple):
    """Parameters of the equations: axes, tables row by row of the first axis, and the powers of the first signal, 1 or 0 each.

    `reference` is the first signal at which its powers are 1.
    """

    first: Row
    second: Row
    kp: tuple[Row, ...]
    ki: tuple[Row, ...]
    kd: tuple[Row, ...]
    reference: float
    linear: tuple[float, float, float]
    square: tuple[float, float, float]


@equation
def passed(low: float, high: float, value: float) -> float:
    """Which part of an interval a value has passed, 0 to 1."""
    return np.minimum(np.maximum((value - low) / (high - low), 0.0), 1.0)


@equation
def along(axis: Row, row: Row, value: float) -> float:
    """Interpolate a row of a table, held at its ends."""
    total = row[0]
    for k in range(len(axis) - 1):
        total = total + (row[k + 1] - row[k]) * passed(axis[k], axis[k + 1], value)
    return total


@equation
def across(first: Row, second: Row, table: tuple[Row, ...], a: float, b: float) -> float:
    """Interpolate a table in both directions."""
    before = along(second, table[0], b)
    total = before
    for k in range(len(first) - 1):
        after = along(second, table[k + 1], b)
        total = total + (after - before) * passed(first[k], first[k + 1], a)
        before = after
    return total


@equation
def gains_at(p: ScheduleTables, a: float, b: float) -> tuple[float, float, float]:
    """Gains kp, ki and kd at values of both signals; the first signal's powers are held at the table's ends too."""
    held = np.minimum(np.maximum(a, p.first[0]), p.first[len(p.first) - 1])
    ratio = held / p.reference
    squared = ratio * ratio
    return (
        across(p.first, p.second, p.kp, a, b) * (1.0 + p.linear[0] * (ratio - 1.0) + p.square[0] * (squared - 1.0)),
        across(p.first, p.second, p.ki, a, b) * (1.0 + p.linear[1] * (ratio - 1.0) + p.square[1] * (squared - 1.0)),
        across(p.first, p.second, p.kd, a, b) * (1.0 + p.linear[2] * (ratio - 1.0) + p.square[2] * (squared - 1.0)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainSchedule:
    """Gains at the nodes of a grid, and how they are interpolated.

    Attributes:
        names: of the two signals.
        units: of the two signals.
        gain_unit: of kp.
        first: values of the first signal, rising, shape (n,), at least two.
        second: of the second, rising, shape (m,), at least two.
        kp, ki, kd: gains at the nodes, shape (n, m).
        scaling: powers of the first signal by which they are divided in between.

    Raises:
        InvalidInputError: axes do not rise, have one value only, shapes do not fit, a value is not finite, or a power is none of 0, 1, 2.
    """

    names: tuple[str, str]
    units: tuple[str, str]
    gain_unit: str
    first: Floats
    second: Floats
    kp: Floats
    ki: Floats
    kd: Floats
    scaling: Scaling = PLAIN

    def __post_init__(self) -> None:
        for name, axis in zip(self.names, (self.first, self.second), strict=True):
            if axis.ndim != 1 or axis.size < 2 or not np.all(np.isfinite(axis)) or np.any(np.diff(axis) <= 0.0):
                message = f"axis {name} of the schedule: {axis.tolist()}; give at least two finite values that rise strictly"
                raise InvalidInputError(message, axis=name)
        shape = (self.first.size, self.second.size)
        for name, table in (("kp", self.kp), ("ki", self.ki), ("kd", self.kd)):
            if table.shape != shape or not np.all(np.isfinite(table)):
                message = (
                    f"table {name} of the schedule has shape {table.shape} or holds what is not finite; {shape} finite gains are wanted"
                )
                raise InvalidInputError(message, table=name)
        scaled = any(self.scaling)
        if any(power not in range(MOST_POWER + 1) for power in self.scaling) or (scaled and self.first[0] <= 0.0):
            message = (
                f"scaling by powers {tuple(self.scaling)} of {self.names[0]}, from {self.first[0]:g} {self.units[0]} on; powers are 0, "
                "1 or 2, and the signal must be positive where one is not 0"
            )
            raise InvalidInputError(message)
        make_read_only(self)

    @property
    def tables(self) -> ScheduleTables:
        """Parameters of the equations."""
        ratio = (self.first / self.first[-1])[:, None]
        shown = [table / ratio**power for table, power in zip((self.kp, self.ki, self.kd), self.scaling, strict=True)]
        kp, ki, kd = (tuple(tuple(float(v) for v in row) for row in table) for table in shown)
        one, two = (tuple(float(power == wanted) for power in self.scaling) for wanted in (1, 2))
        return ScheduleTables(
            first=tuple(self.first.tolist()),
            second=tuple(self.second.tolist()),
            kp=kp,
            ki=ki,
            kd=kd,
            reference=float(self.first[-1]),
            linear=(one[0], one[1], one[2]),
            square=(two[0], two[1], two[2]),
        )

    def gains_at(self, first: float, second: float) -> tuple[float, float, float]:
        """Gains kp, ki and kd at values of the two signals; outside the table those at its edge."""
        kp, ki, kd = gains_at(self.tables, first, second)
        return float(kp), float(ki), float(kd)

    def outside(self, first: Floats, second: Floats) -> str:
        """Say where values of the two signals lie outside the table, whose edge's gains hold there; empty where none does.

        Args:
            first: values of the first signal, shape (k,).
            second: of the second, shape (l,).
        """
        found = []
        for name, unit, axis, seen in zip(self.names, self.units, (self.first, self.second), (first, second), strict=True):
            low, high = float(np.min(seen)), float(np.max(seen))
            spare = EDGE * float(axis[-1] - axis[0])
            if low < axis[0] - spare or high > axis[-1] + spare:
                reached = f"{low:.6g} to {high:.6g}" if high > low else f"{low:.6g}"
                found.append(f"{name} = {reached} {unit} is not all within {axis[0]:.6g} to {axis[-1]:.6g} {unit}")
        return f"outside the gain schedule, whose edge's gains hold there: {'; '.join(found)}" if found else ""
