"""Proof that no gains (kp, ki, kd) of a box serve some operating points at once: a finite cover of the box.

Each cell of the cover has its own reason at one of the points, which holds for every gain of the cell:

- at one frequency the distance |q + j w kd + kp - j ki/w| stays below |q|/Ms everywhere in the cell. It is a norm of an affine function,
  thus convex: its largest value is that of a vertex;
- or the loop is unstable in the middle of the cell, and no gains of the cell put a root on the axis, so that it is unstable everywhere.

Cells with neither are divided in the direction in which they are widest. The first reason is exact at its frequency; the second is read
off a curve whose neighbours change q by 2 %, each piece widened by 1 % of |q|, more than an arc of that angle rises above its chord.

Source: the ellipses of Astrom, Panagopoulos and Hagglund (1998), Automatica 34(5), 585-601; the count along Neimark's D-decomposition,
Gryazina and Polyak (2006), Automatica 42(1), 13-26; the subdivision is that of set inversion, Jaulin and Walter (1993), Automatica 29(4).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.regions.gain_curve import AXIS, GainCurve, LoopFamily, trace_curve
from revline.design.regions.gain_region import LOW, count_roots
from revline.errors import InvalidInputError, out_of_range

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Cells = NDArray[np.float64]
Family = Callable[[float], LoopFamily]
"""Gives an operating point's family at a kd."""

MARGIN = 1e-3
"""By this part the distance must fall short of |q|/Ms in every vertex, far more than rounding."""

WIDENED = 0.01
"""By this part of |q| pieces of the boundary's curve are widened."""

EVERY = 4
"""Each how-manieth frequency of a curve is tried for the first reason: any serves."""

DEPTH = 40
"""How often cells are halved at most."""

MOST_CELLS = 60_000
"""Most cells looked at in all, where nothing else is asked for."""

FAR = 1e6
"""A frequency in rad/s, and a factor of one, at which a plant is as it is at any higher one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GainBox:
    """Gains: all kp, ki and kd between ends; an end in kd may be the other, for one kd.

    Raises:
        InvalidInputError: an end is not below the other, ki does not begin above 0, or kd below it.
    """

    kp_low: float
    kp_high: float
    ki_low: float
    ki_high: float
    kd_low: float = 0.0
    kd_high: float = 0.0

    def __post_init__(self) -> None:
        ends = (self.kp_low, self.kp_high, self.ki_low, self.ki_high, self.kd_low, self.kd_high)
        if not np.all(np.isfinite(ends)) or not (self.kp_low < self.kp_high and self.ki_low < self.ki_high and self.kd_low <= self.kd_high):
            message = f"a box of gains from {ends[::2]} to {ends[1::2]} (kp, ki, kd) is upside down or endless; give the lower ends first"
            raise InvalidInputError(message)
        for name, value, inclusive in (("lowest ki", self.ki_low, False), ("lowest kd", self.kd_low, True)):
            if value < 0.0 or (value == 0.0 and not inclusive):
                raise out_of_range(name, value, "", "values above 0" if not inclusive else "0 and above", "turn the signs, or raise it")


class Point(NamedTuple):
    """An operating point as the proof sees it.

    Attributes:
        name: for people.
        family: at a kd.
    """

    name: str
    family: Family


@dataclass(frozen=True, slots=True, kw_only=True)
class NoCommonGains:
    """A proof that no gains of a box keep the peak of the sensitivity at all points.

    Attributes:
        points: names of the operating points.
        box: of gains.
        peak: Ms.
        cells: of the cover, in all.
        by_peak: how many of them exceed the peak.
        unstable: how many are unstable.
        smallest: share of the box's side, in each direction, of the smallest cell.
    """

    points: tuple[str, ...]
    box: GainBox
    peak: float
    cells: int
    by_peak: int
    unstable: int
    smallest: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NoProof:
    """Cells are left over: there may be gains.

    Attributes:
        kp, ki, kd: middle of such a cell.
        cells: looked at.
        reason: in words.
    """

    kp: float
    ki: float
    kd: float
    cells: int
    reason: str


class _Axis(NamedTuple):
    """A point's curve: frequencies (n,), q there, and the family at no kd."""

    omega: Floats
    q: Complexes
    family: LoopFamily


def prove_no_gains(points: Sequence[Point], box: GainBox, peak: float, *, most: int = MOST_CELLS) -> NoCommonGains | NoProof:
    """Try to cover a box of gains by cells that fail at one of some operating points each.

    Args:
        points: at least one.
        box: of gains.
        peak: Ms, above 1.
        most: cells looked at in all, at most.

    Returns:
        The proof, or a cell that neither reason covers: where the sets touch nearly, more cells than are allowed would be needed.

    Raises:
        InvalidInputError: there are no points, the peak is not above 1, or a plant answers as fast as the largest kd rises.
        NotConvergedError: a curve turns too fast to be followed.
    """
    if not points:
        message = "no operating points are given, at which any gains would do; give at least one"
        raise InvalidInputError(message)
    if not 1.0 < peak < np.inf:
        raise out_of_range("peak of the sensitivity", peak, "", "values above 1", "give one such as 1.4, 1.7 or 2")
    axes = [_axis(point.family(0.0), box) for point in points]
    cells = np.array([[box.kp_low, box.kp_high, box.ki_low, box.ki_high, box.kd_low, box.kd_high]])
    seen, by_peak, unstable = 0, 0, 0
    for depth in range(DEPTH):
        seen += len(cells)
        near = _exceeds(axes, cells, peak)
        by_peak += int(near.sum())
        cells = cells[~near]
        lost = _unstable(points, axes, cells)
        unstable += int(lost.sum())
        cells = cells[~lost]
        if not len(cells):
            names = tuple(point.name for point in points)
            smallest = 0.5 ** (depth / (3.0 if box.kd_high > box.kd_low else 2.0))
            return NoCommonGains(points=names, box=box, peak=peak, cells=seen, by_peak=by_peak, unstable=unstable, smallest=smallest)
        if seen + 2 * len(cells) > most:
            break
        cells = _halved(cells, box)
    kp, ki, kd = (0.5 * (cells[0, k] + cells[0, k + 1]) for k in (0, 2, 4))
    reason = f"{len(cells)} cells are left after {seen}; the sets of gains meet or nearly touch there"
    return NoProof(kp=float(kp), ki=float(ki), kd=float(kd), cells=seen, reason=reason)


def _axis(family: LoopFamily, box: GainBox) -> _Axis:
    """Follow q until no gains of the box can put a root on the axis any more."""
    largest = max(abs(box.kp_low), abs(box.kp_high))
    if abs(complex(family.inverse(AXIS.points(np.array([FAR])))[0])) <= box.kd_high * FAR:
        message = (
            f"{family.name} answers as fast as kd = {box.kd_high:g} rises, so that no frequency bounds the gains; lower the largest kd"
        )
        raise InvalidInputError(message, kd=box.kd_high)
    reach = largest
    while True:
        curve = trace_curve(family, kp_reach=reach, ki_reach=box.ki_high, low=LOW)
        beyond = np.geomspace(curve.omega[-1], FAR * curve.omega[-1], 400)
        with np.errstate(over="ignore"):
            room = np.abs(family.inverse(AXIS.points(beyond))) - beyond * box.kd_high - largest - box.ki_high / beyond
        if np.all(room > 0.0):
            return _Axis(curve.omega, family.inverse(AXIS.points(curve.omega)), family)
        reach *= 2.0


def _exceeds(axes: Sequence[_Axis], cells: Cells, peak: float) -> NDArray[np.bool_]:
    """Whether one frequency of one point exceeds the peak in the whole of each cell."""
    found = np.zeros(len(cells), dtype=bool)
    for axis in axes:
        omega, q = axis.omega[::EVERY], axis.q[::EVERY]
        left = np.flatnonzero(~found)
        kp0, kp1, ki0, ki1, kd0, kd1 = (column[:, None] for column in cells[left].T)
        across = np.maximum(np.abs(q.real + kp0), np.abs(q.real + kp1))
        up = np.maximum(np.abs(q.imag + omega * kd0 - ki1 / omega), np.abs(q.imag + omega * kd1 - ki0 / omega))
        limit = np.abs(q) / peak * (1.0 - MARGIN)
        found[left] = np.any(across**2 + up**2 < limit**2, axis=1)
    return found


def _unstable(points: Sequence[Point], axes: Sequence[_Axis], cells: Cells) -> NDArray[np.bool_]:
    """Whether one point is unstable in the whole of each cell."""
    found = np.zeros(len(cells), dtype=bool)
    for point, axis in zip(points, axes, strict=True):
        left = np.flatnonzero(~found)
        apart = left[~_crossed(axis, cells[left])]
        middle = 0.5 * (cells[apart][:, ::2] + cells[apart][:, 1::2])
        for kd in np.unique(middle[:, 2]):
            at = middle[:, 2] == kd
            found[apart[at]] = _count(point, axis, float(kd), middle[at, 0], middle[at, 1]) > 0
    return found


def _crossed(axis: _Axis, cells: Cells) -> NDArray[np.bool_]:
    """Whether gains of a cell may put a root on the axis: the curve's pieces, widened, against the cell."""
    omega, q = axis.omega, axis.q
    kp0, kp1, ki0, ki1, kd0, kd1 = (column[:, None] for column in cells.T)
    room = WIDENED * np.maximum(np.abs(q[1:]), np.abs(q[:-1]))
    low, high = omega[:-1], omega[1:]
    left, right = np.minimum(q.real[:-1], q.real[1:]) - room, np.maximum(q.real[:-1], q.real[1:]) + room
    under, over = np.minimum(q.imag[:-1], q.imag[1:]) - room, np.maximum(q.imag[:-1], q.imag[1:]) + room
    across = (left + kp0 <= 0.0) & (right + kp1 >= 0.0)
    up = (under + low * kd0 - ki1 / low <= 0.0) & (over + high * kd1 - ki0 / high >= 0.0)
    return np.asarray(np.any(across & up, axis=1))


def _count(point: Point, axis: _Axis, kd: float, kp: Floats, ki: Floats) -> NDArray[np.int64]:
    """Unstable roots at gains of one kd."""
    family = point.family(kd)
    curve = GainCurve(axis.omega, -axis.q.real, axis.omega * (axis.q.imag + kd * axis.omega))
    return count_roots(replace(family, kd=kd), curve, kp, ki)


def _halved(cells: Cells, box: GainBox) -> Cells:
    """Halve each cell in the direction in which it takes the largest share of the box."""
    sides = np.array([box.kp_high - box.kp_low, box.ki_high - box.ki_low, box.kd_high - box.kd_low])
    share = (cells[:, 1::2] - cells[:, ::2]) / np.where(sides > 0.0, sides, np.inf)
    way = np.argmax(share, axis=1)
    rows = np.arange(len(cells))
    middle = 0.5 * (cells[rows, 2 * way] + cells[rows, 2 * way + 1])
    lower, upper = cells.copy(), cells.copy()
    lower[rows, 2 * way + 1] = middle
    upper[rows, 2 * way] = middle
    return np.concatenate((lower, upper))
