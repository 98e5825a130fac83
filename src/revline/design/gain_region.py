"""Which (kp, ki) stabilise a loop at a given kd, its delay exact: the boundary on which a root lies on the imaginary axis.

With q = 1/P along s = jw, a root lies at jw where kp = -Re q and ki = w Im q + kd w^2: one curve, exact point by point. How many roots
lie right of the axis changes by two across it, to a side that the curve's own direction tells, so that the count is known everywhere from
one count: that of the plant alone.

Source: Neimark's D-decomposition; Gryazina and Polyak (2006), Automatica 42(1), 13-26, for the count; with delay Silva, Datta and
Bhattacharyya (2005), PID Controllers for Time-Delay Systems, chapter 7.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.values import make_read_only

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]
Inverse = Callable[[Floats], NDArray[np.complex128]]

PHASE_STEP = 0.05
"""Largest change of the phase of q between neighbours on the curve, in rad."""

SIZE_STEP = 0.05
"""Largest change of the logarithm of its magnitude."""

MOST_POINTS = 20_000
"""Most points of the curve."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopFamily:
    """A plant under all PI controllers with one derivative gain.

    Attributes:
        name: of the plant.
        inverse: q = 1/P at frequencies in rad/s.
        at_rest: q(0), real; 0 for a plant that integrates.
        kd: derivative gain.
        base: a kp at which the roots were counted, ki being 0.
        unstable: how many lie right of the imaginary axis there.
        gain_unit: of kp.
    """

    name: str
    inverse: Inverse
    at_rest: float
    kd: float
    base: float
    unstable: int
    gain_unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Gains that are looked at: kp from `kp_low` to `kp_high`, ki from 0 to `ki_high`."""

    kp_low: float
    kp_high: float
    ki_high: float

    def __post_init__(self) -> None:
        if not -math.inf < self.kp_low < self.kp_high < math.inf:
            raise out_of_range("largest kp", self.kp_high, "", f"values above {self.kp_low:g}", "give a window of gains")
        if not 0.0 < self.ki_high < math.inf:
            raise out_of_range("largest ki", self.ki_high, "", "values above 0", "give a window of gains")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainRegion:
    """The stabilising (kp, ki), ki not negative, of one plant and one kd, within a window.

    Attributes:
        family: plant and kd.
        window: what was looked at.
        omega, kp, ki: the curve of gains at which a root lies at +-j omega, by rising frequency, shape (n,).
        rim: for each point of the curve, whether it bounds the stabilising gains, shape (n,).
    """

    family: LoopFamily
    window: Window
    omega: Floats
    kp: Floats
    ki: Floats
    rim: NDArray[np.bool_]

    def __post_init__(self) -> None:
        make_read_only(self)

    def unstable_roots(self, kp: ArrayLike, ki: ArrayLike) -> Counts:
        """Count the roots right of the imaginary axis for gains of any common shape, ki not negative.

        Exact but for gains nearer to the curve than its points are to the chords between them.
        """
        p, i = np.broadcast_arrays(np.asarray(kp, dtype=float), np.asarray(ki, dtype=float))
        if np.any(i < 0.0):
            raise out_of_range("ki", float(np.min(i)), "", "0 and above", "turn the sign of the plant's gain, or of the controller's")
        flat = _count(self.family, (self.omega, self.kp, self.ki), p.ravel(), i.ravel())
        return flat.reshape(p.shape)

    def stabilises(self, kp: ArrayLike, ki: ArrayLike) -> NDArray[np.bool_]:
        """Whether gains stabilise the loop; with ki = 0 the controller is taken to have no integrator."""
        return self.unstable_roots(kp, ki) == 0

    @property
    def bounded(self) -> bool:
        """Whether all stabilising gains lie inside the window."""
        low, high, top = self.window.kp_low, self.window.kp_high, self.window.ki_high
        at = np.linspace(0.0, top, 257)[1:]
        across = np.linspace(low, high, 257)
        edges = (self.stabilises(np.full(at.size, high), at), self.stabilises(np.full(at.size, low), at), self.stabilises(across, top))
        return not any(bool(np.any(edge)) for edge in edges)

    def kp_ends(self) -> tuple[tuple[float, float], ...]:
        """Intervals of kp that stabilise without integral action, within the window."""
        crossings = np.sort(np.append(_axis_crossings(self.omega, self.kp, self.ki)[0], -self.family.at_rest))
        inside = crossings[(crossings > self.window.kp_low) & (crossings < self.window.kp_high)]
        ends = np.concatenate(([self.window.kp_low], inside, [self.window.kp_high]))
        stable = self.stabilises(0.5 * (ends[:-1] + ends[1:]), 0.0)
        return tuple((float(a), float(b)) for a, b, good in zip(ends[:-1], ends[1:], stable, strict=True) if good)


def find_gain_region(family: LoopFamily, window: Window, *, low: float = 1e-3) -> GainRegion:
    """Find the stabilising gains of a plant within a window.

    Args:
        family: plant and kd.
        window: gains that are looked at.
        low: lowest frequency of the curve, in rad/s; below it the curve is taken to run straight to (-q(0), 0).

    Raises:
        InvalidInputError: the plant does not fall at high frequency faster than the derivative rises.
        NotConvergedError: the curve turns too fast to be followed.
    """
    reach = max(abs(window.kp_low), abs(window.kp_high))
    high = _top(family, reach, window.ki_high, low)
    omega = _with_axis_points(family, _grid(family, low, high))
    q = family.inverse(omega)
    kp, ki = -q.real, omega * q.imag + family.kd * omega**2
    rim = _rim(family, (omega, kp, ki), window)
    return GainRegion(family=family, window=window, omega=omega, kp=kp, ki=ki, rim=rim)


def find_window(family: LoopFamily) -> Window:
    """Choose a window that holds all stabilising gains, or where they have no end those up to a loop gain of about a hundred."""
    sizes = np.abs([family.at_rest, *family.inverse(np.array([1.0]))])
    reach = 100.0 * max(float(sizes[0]), 0.1 * float(sizes[1]))
    widest = Window(kp_low=-0.5 * reach, kp_high=reach, ki_high=100.0 * reach)
    found = find_gain_region(family, widest)
    ends = found.kp_ends()
    if not ends or not found.bounded:
        low = min((low for low, _ in ends), default=0.0)
        return Window(kp_low=max(widest.kp_low, low - 0.02 * reach), kp_high=reach, ki_high=widest.ki_high)
    gains = np.concatenate((found.kp[found.rim], *ends))
    room = 0.1 * float(np.ptp(gains))
    tallest = float(np.max(found.ki[found.rim], initial=0.0)) or widest.ki_high
    return Window(kp_low=float(np.min(gains)) - room, kp_high=float(np.max(gains)) + room, ki_high=1.1 * tallest)


def _top(family: LoopFamily, reach: float, ki: float, low: float) -> float:
    """A frequency beyond which no root can lie on the axis for any gains in the window: |q + j w kd| > |kp| + ki/w there."""
    grid = np.geomspace(low, 1e9, 3000)
    free = np.abs(family.inverse(grid) + 1j * grid * family.kd) > 1.05 * (reach + ki / grid)
    held = np.flatnonzero(~free)
    if held.size and held[-1] == grid.size - 1:
        message = (
            f"{family.name} with kd = {family.kd:g} answers at any frequency: the loop is improper, or its derivative as strong as the "
            "plant is fast; lower kd, or filter it"
        )
        raise InvalidInputError(message, kd=family.kd)
    return float(grid[held[-1] + 1]) if held.size else float(grid[1])


def _grid(family: LoopFamily, low: float, high: float) -> Floats:
    grid = np.geomspace(low, high, 200)
    values = family.inverse(grid)
    while True:
        ratio = values[1:] / values[:-1]
        coarse = ~((np.abs(np.angle(ratio)) < PHASE_STEP) & (np.abs(np.log(np.abs(ratio))) < SIZE_STEP))
        if not np.any(coarse):
            return grid
        if grid.size > MOST_POINTS:
            where = float(grid[1:][coarse][0])
            message = f"1/P of {family.name} turns too fast near {where:g} rad/s to be followed with {MOST_POINTS} points"
            raise NotConvergedError(message, frequency=where)
        middle, places = np.sqrt(grid[:-1][coarse] * grid[1:][coarse]), np.flatnonzero(coarse) + 1
        grid, values = np.insert(grid, places, middle), np.insert(values, places, family.inverse(middle))


def _with_axis_points(family: LoopFamily, omega: Floats) -> Floats:
    """Add the frequencies at which the curve crosses ki = 0, found exactly."""

    def height(w: float) -> float:
        return float(family.inverse(np.array([w])).imag[0]) + family.kd * w

    slope = family.inverse(omega).imag + family.kd * omega
    at = np.flatnonzero((slope[1:] > 0.0) != (slope[:-1] > 0.0))
    roots = [float(brentq(height, omega[k], omega[k + 1], xtol=1e-300, rtol=1e-14)) for k in at]
    return np.unique(np.concatenate((omega, roots)))


Curve = tuple[Floats, Floats, Floats]


def _axis_crossings(omega: Floats, kp: Floats, ki: Floats) -> tuple[Floats, Counts]:
    """Where the curve crosses ki = 0 at omega > 0: kp there, and by how many the unstable roots change as kp rises through it."""
    slope = ki / omega  # Im q + kd w, which changes its sign where ki does
    at = np.flatnonzero((slope[1:] > 0.0) != (slope[:-1] > 0.0))
    share = slope[at] / (slope[at] - slope[at + 1])
    rising = slope[at + 1] > slope[at]
    return kp[at] + share * (kp[at + 1] - kp[at]), np.where(rising, -2, 2)


def _count(family: LoopFamily, curve: Curve, p: Floats, i: Floats) -> Counts:
    """Unstable roots: from the base along ki = 0 to kp, then up to ki."""
    omega, kp, ki = curve
    count = np.full(p.size, family.unstable)
    for place, change in zip(*_axis_crossings(omega, kp, ki), strict=True):
        count += change * _passed(family.base, p, float(place))
    count += _turn_at_rest(family) * _passed(family.base, p, -family.at_rest)
    count += ((i > 0.0) & (family.at_rest + p < 0.0)).astype(int)  # the integrator's own root, s = -ki/(q(0) + kp) at first
    points, pieces = np.nonzero((kp[:-1] - p[:, None] > 0.0) != (kp[1:] - p[:, None] > 0.0))
    share = (p[points] - kp[pieces]) / (kp[pieces + 1] - kp[pieces])
    height = ki[pieces] + share * (ki[pieces + 1] - ki[pieces])
    below = (height > 0.0) & (height < i[points])
    np.add.at(count, points[below], np.where(kp[pieces + 1] > kp[pieces], 2, -2)[below])
    return count


def _passed(base: float, p: Floats, place: float) -> Counts:
    """Whether kp passes a place on its way from the base: 1 upwards, -1 downwards, 0 if not at all."""
    return ((base <= place) & (p > place)).astype(int) - ((base > place) & (p <= place)).astype(int)


def _turn_at_rest(family: LoopFamily) -> int:
    """Change of the count where kp rises through -q(0) and a real root passes the origin: s = -(kp + q(0))/q'(0)."""
    tiny = 1e-6
    slope = float((family.inverse(np.array([tiny])).imag / tiny)[0]) + family.kd
    return 1 if slope < 0.0 else -1


def _rim(family: LoopFamily, curve: Curve, window: Window) -> NDArray[np.bool_]:
    """Whether points of the curve bound stabilising gains: on one side of them no root is unstable."""
    omega, kp, ki = curve
    inside = (kp >= window.kp_low) & (kp <= window.kp_high) & (ki > 0.0) & (ki <= window.ki_high)
    rim = np.zeros(omega.size, dtype=bool)
    at = np.flatnonzero(inside)
    for side in (-1.0, 1.0):
        moved = np.maximum(ki[at] + side * 1e-3 * (np.abs(ki[at]) + 1e-3 * window.ki_high), 0.0)
        rim[at] |= _count(family, curve, kp[at], moved) == 0
    return rim
