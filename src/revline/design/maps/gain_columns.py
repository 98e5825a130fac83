"""Sets of gains (kp, ki) as intervals of ki on columns of constant kp, so that those of many plants can be intersected exactly.

On a column the ellipses of each frequency, |q + j w kd + kp - j ki/w| < |q|/Ms, forbid one interval of ki each; what is left between
them and is stable keeps the peak of the sensitivity. Source: Astrom, Panagopoulos and Hagglund (1998), Automatica 34(5), 585-601.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.regions.gain_curve import AXIS
from revline.design.regions.gain_region import GainRegion, column_crossings, count_roots
from revline.design.regions.sensitivity_contour import find_peaks
from revline.errors import InvalidInputError, out_of_range
from revline.values import make_read_only

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

BEYOND = 100.0
"""How far beyond the region's own frequencies the ellipses are looked at, as a factor."""

BEYOND_POINTS = 60
"""At how many frequencies there."""

LARGEST_PEAK = 20.0
"""Largest bound of the sensitivity's peak."""

FINE_TO = 2.0
"""Up to this peak the region's own frequencies do; twice the peak takes twice as many."""

SLACK = 1e-3
"""How far the middle of an upper interval may exceed the peak: more, and it is a crack between the ellipses of neighbouring frequencies."""


SEAM = 1e-5
"""How near to -q(0), as a part of it, a column has no gains but ki near 0: the curve of the boundary begins there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainColumns:
    """A set of gains, ki not negative, on columns of constant kp.

    Attributes:
        kp: of the columns, rising, shape (n,).
        column: the column of each interval, rising, shape (m,).
        low, high: its ends in ki, shape (m,); those of one column are disjoint and rise.

    Raises:
        InvalidInputError: columns do not rise, or an interval is upside down.
    """

    kp: Floats
    column: Places
    low: Floats
    high: Floats

    def __post_init__(self) -> None:
        if np.any(np.diff(self.kp) <= 0.0) or np.any(self.high < self.low):
            message = f"{self.kp.size} columns of gains do not rise, or an interval of them is upside down; sort them"
            raise InvalidInputError(message)
        make_read_only(self)

    @property
    def empty(self) -> bool:
        """Whether no column has any."""
        return not self.column.size

    @property
    def highest(self) -> tuple[float, float]:
        """The largest ki and its kp, as (kp, ki).

        Raises:
            InvalidInputError: the set is empty.
        """
        if self.empty:
            message = "a set of gains without any has no largest ki; ask for a higher peak of the sensitivity, or for fewer points"
            raise InvalidInputError(message)
        at = int(np.argmax(self.high))
        return float(self.kp[self.column[at]]), float(self.high[at])

    @property
    def area(self) -> float:
        """Size by the columns' heights, in the unit of kp times that of ki."""
        heights = np.bincount(self.column, weights=self.high - self.low, minlength=self.kp.size)
        return float(np.trapezoid(heights, self.kp))

    def above(self, ki: float) -> "GainColumns":
        """Those of at least one ki."""
        kept = self.high >= ki
        return GainColumns(kp=self.kp, column=self.column[kept], low=np.maximum(self.low[kept], ki), high=self.high[kept])

    def holds(self, ki: Floats) -> NDArray[np.bool_]:
        """Whether each column holds values of ki, as rows of columns."""
        inside = np.zeros((self.kp.size, ki.size), dtype=bool)
        for k, low, high in zip(self.column, self.low, self.high, strict=True):
            inside[k] |= (ki >= low) & (ki <= high)
        return inside


def stable_columns(region: GainRegion, kp: Floats) -> GainColumns:
    """Find the stabilising gains on columns, within the region's window.

    Args:
        region: of one plant and kd.
        kp: of the columns, rising, within the region's reach.
    """
    top = region.window.ki_high
    count = count_roots(region.family, region.curve, kp, np.full(kp.size, np.finfo(float).tiny))
    points, height, change = column_crossings(region.curve, kp)
    kept = (height > 0.0) & (height < top)
    points, height, change = points[kept], height[kept], change[kept]
    order = np.lexsort((height, points))
    rows: list[tuple[int, float, float]] = []
    level = np.zeros(kp.size)
    for k, h, d in zip(points[order], height[order], change[order], strict=True):
        if count[k] == 0:
            rows.append((int(k), float(level[k]), float(h)))
        count[k] += d
        level[k] = h
    rows += [(int(k), float(level[k]), top) for k in np.flatnonzero(count == 0)]
    table = np.array(rows, dtype=float).reshape(-1, 3)
    found = table[:, 0].astype(np.int64)
    return _sorted(kp, found, table[:, 1], table[:, 2], _off_the_seam(region, kp[found]))


class Ellipses(NamedTuple):
    """Frequencies (n,) in rad/s, and q = 1/P there, from which the ellipses of any peak follow."""

    omega: Floats
    q: NDArray[np.complex128]


def check_peak(peak: float) -> None:
    """Refuse a bound of the sensitivity's peak that says nothing, or for which the ellipses would be too small to meet.

    Raises:
        InvalidInputError: it is not above 1, or above 20.
    """
    if not 1.0 < peak <= LARGEST_PEAK:
        limit = f"values above 1, up to {LARGEST_PEAK:g}"
        raise out_of_range("peak of the sensitivity", peak, "", limit, "give one such as 1.4, 1.7 or 2; see the stabilising gains for more")


def find_ellipses(region: GainRegion, peak: float = 2.0) -> Ellipses:
    """Evaluate a plant at the frequencies of its region, at some beyond, and in between where the ellipses of a peak are small.

    Args:
        region: of the plant.
        peak: the largest Ms that the ellipses are for.
    """
    last = region.omega[-1]
    omega = np.concatenate((region.omega, np.geomspace(last, BEYOND * last, BEYOND_POINTS)[1:]))
    parts = math.ceil(peak / FINE_TO)
    count = parts * (omega.size - 1) + 1
    omega = np.exp(np.interp(np.arange(count) / parts, np.arange(omega.size), np.log(omega))) if parts > 1 else omega
    with np.errstate(over="ignore"):
        return Ellipses(omega, region.family.inverse(AXIS.points(omega)))


def peak_columns(region: GainRegion, kp: Floats, peak: float, ellipses: Ellipses | None = None) -> GainColumns:
    """Find the gains on columns that keep the peak of the sensitivity at or below a value.

    Args:
        region: of one plant and kd; its frequencies are those of the ellipses, between which neighbours change q by 2 % (less for a
            larger peak, whose ellipses are smaller), so that the peak at an end is exceeded by some 1e-4 at most.
        kp: of the columns, rising.
        peak: Ms, above 1, up to 20.
        ellipses: of the region for this peak or a larger one, where they are at hand.

    Raises:
        InvalidInputError: the peak is not above 1, or above 20.
    """
    check_peak(peak)
    top = region.window.ki_high
    bottom, ceiling = _forbidden(region.family.kd, ellipses or find_ellipses(region, peak), kp, peak)
    order = np.argsort(bottom, axis=1)
    bottom, ceiling = np.take_along_axis(bottom, order, axis=1), np.take_along_axis(ceiling, order, axis=1)
    level = np.maximum.accumulate(np.maximum(ceiling, 0.0), axis=1)
    level = np.concatenate((np.zeros((kp.size, 1)), level), axis=1)
    upper = np.minimum(np.concatenate((bottom, np.full((kp.size, 1), np.inf)), axis=1), top)
    column, at = np.nonzero(upper > level)
    low, high = level[column, at], upper[column, at]
    middle = 0.5 * (low + high)
    kept = region.stabilises(kp[column], middle) & _off_the_seam(region, kp[column])
    column, low, high, middle = column[kept], low[kept], high[kept], middle[kept]
    doubtful = np.flatnonzero(low > 0.0)
    cracks = doubtful[find_peaks(region, kp[column[doubtful]], middle[doubtful]) > peak * (1.0 + SLACK)]
    column, low, high = np.delete(column, cracks), np.delete(low, cracks), np.delete(high, cracks)
    return GainColumns(kp=kp, column=column, low=low, high=high)


def _forbidden(kd: float, ellipses: Ellipses, kp: Floats, peak: float) -> tuple[Floats, Floats]:
    """Ends of the interval of ki that each frequency's ellipse forbids, columns by frequencies; infinite where it forbids none."""
    omega, q = ellipses
    room = (np.abs(q) / peak) ** 2 - (kp[:, None] + q.real) ** 2
    inside = room > 0.0
    half = np.sqrt(np.where(inside, room, 0.0))
    middle = q.imag + kd * omega
    return np.where(inside, omega * (middle - half), np.inf), np.where(inside, omega * (middle + half), -np.inf)


def intersect_columns(sets: Sequence[GainColumns]) -> GainColumns:
    """Find the gains that all sets hold.

    Args:
        sets: on the same columns.

    Raises:
        InvalidInputError: there are none, or their columns differ.
    """
    if not sets or any(not np.array_equal(entry.kp, sets[0].kp) for entry in sets):
        message = f"{len(sets)} sets of gains to intersect: give at least one, all on the same columns"
        raise InvalidInputError(message)
    column = np.concatenate([np.concatenate((entry.column, entry.column)) for entry in sets])
    value = np.concatenate([np.concatenate((entry.low, entry.high)) for entry in sets])
    step = np.concatenate([np.repeat([1, -1], entry.column.size) for entry in sets])
    order = np.lexsort((-step, value, column))
    column, value, step = column[order], value[order], step[order]
    full = np.flatnonzero(np.cumsum(step) == len(sets))  # the next event closes what is open in all
    return GainColumns(kp=sets[0].kp, column=column[full], low=value[full], high=value[full + 1])


def _sorted(kp: Floats, column: Places, low: Floats, high: Floats, kept: NDArray[np.bool_]) -> GainColumns:
    column, low, high = column[kept], low[kept], high[kept]
    order = np.lexsort((low, column))
    return GainColumns(kp=kp, column=column[order], low=low[order], high=high[order])


def _off_the_seam(region: GainRegion, kp: Floats) -> NDArray[np.bool_]:
    rest = region.family.at_rest
    return np.asarray(np.abs(kp + rest) > SEAM * abs(rest))
