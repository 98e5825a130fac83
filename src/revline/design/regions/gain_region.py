"""Which (kp, ki) stabilise a loop at a given kd, or damp it as well as is asked, its delay exact.

How many roots lie right of a line of the complex plane changes by two across the curve of gains that put a root on the line, to a side
that the curve's own direction tells: if a root moves by ds along the line as the gains move along the curve, other changes of them move it
by ds (dkp + dki/s)/(dkp' + dki'/s), and Im 1/s is negative above the real axis. So the count is known everywhere from one count.

Source: Neimark's D-decomposition; Gryazina and Polyak (2006), Automatica 42(1), 13-26, for the count; with delay Silva, Datta and
Bhattacharyya (2005), PID Controllers for Time-Delay Systems, chapter 7.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.regions.gain_curve import GainCurve, LoopFamily, refine_curve, trace_curve
from revline.errors import NotConvergedError, out_of_range
from revline.values import make_read_only

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

LOW = 1e-3
"""Lowest frequency of a curve, in rad/s, where none is given."""

WIDER = (10.0, 100.0)
"""Where the gains sought go on beyond a loop gain of about a hundred, an end of them is looked for up to so many times that."""

COLUMNS = 2049
"""Values of kp at which the height of a region is taken for its area."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Area:
    """Size of a region within its window.

    Attributes:
        value: in the unit of kp times that of ki.
        error: by how much half as many columns change it.
    """

    value: float
    error: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainRegion:
    """The (kp, ki), ki not negative, that leave no root right of a family's contour, within a window.

    Attributes:
        family: plant, kd and contour; on the imaginary axis these gains are the stabilising ones.
        window: what was looked at.
        omega, kp, ki: the curve of gains at which a root of imaginary part omega lies on the contour, by rising omega, shape (n,).
        rim: for each point of the curve, whether it bounds the region, shape (n,).
        reach: largest magnitude of kp and largest ki for which the curve is complete, at least those of the window.
    """

    family: LoopFamily
    window: Window
    omega: Floats
    kp: Floats
    ki: Floats
    rim: NDArray[np.bool_]
    reach: tuple[float, float]

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def curve(self) -> GainCurve:
        """The whole curve."""
        return GainCurve(self.omega, self.kp, self.ki)

    def unstable_roots(self, kp: ArrayLike, ki: ArrayLike) -> Counts:
        """Count the roots right of the contour for gains of any common shape, ki not negative.

        Exact but for gains nearer to the curve than its points are to the chords between them.
        """
        p, i = np.broadcast_arrays(np.asarray(kp, dtype=float), np.asarray(ki, dtype=float))
        if np.any(i < 0.0):
            raise out_of_range("ki", float(np.min(i)), "", "0 and above", "turn the sign of the plant's gain, or of the controller's")
        for name, value, limit in (("magnitude of kp", np.abs(p), self.reach[0]), ("ki", i, self.reach[1])):
            if not np.all(value <= limit):
                raise out_of_range(name, float(np.max(value)), "", f"0 to {limit:g}", "find the region in a window that holds these gains")
        return count_roots(self.family, self.curve, p.ravel(), i.ravel()).reshape(p.shape)

    def stabilises(self, kp: ArrayLike, ki: ArrayLike) -> NDArray[np.bool_]:
        """Whether gains leave no root right of the contour; with ki = 0 the controller is taken to have no integrator."""
        return self.unstable_roots(kp, ki) == 0

    @property
    def empty(self) -> bool:
        """Whether no gains of the window do it."""
        return not self.rim.any() and not self.kp_ends()

    @property
    def bounded(self) -> bool:
        """Whether all such gains lie inside the window."""
        low, high, top = self.window.kp_low, self.window.kp_high, self.window.ki_high
        across = _middles(self.kp, self.ki - top, low, high)
        left, right = (_middles(self.ki, self.kp - edge, 0.0, top) for edge in (low, high))
        p = np.concatenate((np.full(left.size, low), np.full(right.size, high), across))
        i = np.concatenate((left, right, np.full(across.size, top)))
        return not bool(np.any(self.stabilises(p, i)))

    @property
    def area(self) -> Area:
        """Size within the window, by columns of kp; where the region goes on beyond the window, that part is not in it."""
        at, width = np.linspace(self.window.kp_low, self.window.kp_high, COLUMNS, retstep=True)
        heights = _heights(self, at)
        value = float(np.trapezoid(heights, dx=width))
        return Area(value=value, error=abs(value - float(np.trapezoid(heights[::2], dx=2.0 * width))))

    def kp_ends(self) -> tuple[tuple[float, float], ...]:
        """Intervals of kp that do it without integral action, within the window."""
        crossings = np.sort(np.append(_axis_crossings(self.curve)[0], -self.family.at_rest))
        inside = crossings[(crossings > self.window.kp_low) & (crossings < self.window.kp_high)]
        ends = np.concatenate(([self.window.kp_low], inside, [self.window.kp_high]))
        stable = self.stabilises(0.5 * (ends[:-1] + ends[1:]), 0.0)
        return tuple((float(a), float(b)) for a, b, good in zip(ends[:-1], ends[1:], stable, strict=True) if good)


def find_gain_region(family: LoopFamily, window: Window | None = None, *, low: float = LOW) -> GainRegion:
    """Find the gains of a window that leave no root right of a family's contour.

    Args:
        family: plant, kd and contour.
        window: gains that are looked at; where none is given, one that holds all of them, or those up to a loop gain of about a hundred
            where they do not end within a hundred times that.
        low: lowest frequency of the curve, in rad/s; below it the curve is taken to run straight to (-q(0), 0).

    Raises:
        InvalidInputError: the plant does not fall at high frequency faster than the derivative rises.
        NotConvergedError: the curve turns too fast to be followed.
    """
    if window is None:
        return _in_chosen_window(family, low)
    reach = max(abs(window.kp_low), abs(window.kp_high))
    curve = trace_curve(family, kp_reach=reach, ki_reach=window.ki_high, low=low)
    return _in_window(family, window, curve, (reach, window.ki_high))


def find_window(family: LoopFamily) -> Window:
    """Choose a window that holds all gains sought, or where they have no end those up to a loop gain of about a hundred."""
    return find_gain_region(family).window


def _in_chosen_window(family: LoopFamily, low: float) -> GainRegion:
    sizes = np.abs([family.at_rest, *family.inverse(np.array([1j]))])
    reach = 100.0 * max(float(sizes[0]), 0.1 * float(sizes[1]))
    found = first = _in_widest_window(family, reach, low)
    for wider in WIDER:  # a slow plant's gains end far beyond those of its rest
        if found.bounded:
            break
        try:
            found = _in_widest_window(family, wider * reach, low)
        except NotConvergedError:
            break
    found = found if found.bounded else first
    return _in_window(family, _narrowed(found, found.reach[0]), found.curve, found.reach)


def _in_widest_window(family: LoopFamily, reach: float, low: float) -> GainRegion:
    widest = Window(kp_low=-0.5 * reach, kp_high=reach, ki_high=100.0 * reach)
    curve = trace_curve(family, kp_reach=reach, ki_reach=widest.ki_high, low=low)
    rim = _rim(family, curve, widest)
    return GainRegion(family=family, window=widest, omega=curve.omega, kp=curve.kp, ki=curve.ki, rim=rim, reach=(reach, widest.ki_high))


def _narrowed(found: GainRegion, reach: float) -> Window:
    """A window that holds a region with room about it, if it is bounded, within that for which the curve is complete."""
    widest, ends = found.window, found.kp_ends()
    if not ends or not found.bounded:
        low = min((low for low, _ in ends), default=0.0)
        return Window(kp_low=max(widest.kp_low, low - 0.02 * reach), kp_high=reach, ki_high=widest.ki_high)
    gains = np.concatenate((found.kp[found.rim], *ends))
    room = 0.1 * float(np.ptp(gains))
    tallest = float(np.max(found.ki[found.rim], initial=0.0)) or widest.ki_high
    return Window(
        kp_low=max(widest.kp_low, float(np.min(gains)) - room),
        kp_high=min(widest.kp_high, float(np.max(gains)) + room),
        ki_high=min(widest.ki_high, 1.1 * tallest),
    )


def _in_window(family: LoopFamily, window: Window, curve: GainCurve, reach: tuple[float, float]) -> GainRegion:
    curve = refine_curve(family, curve, kp=(window.kp_low, window.kp_high), ki=window.ki_high)
    rim = _rim(family, curve, window)
    return GainRegion(family=family, window=window, omega=curve.omega, kp=curve.kp, ki=curve.ki, rim=rim, reach=reach)


def _axis_crossings(curve: GainCurve) -> tuple[Floats, Counts]:
    """Where the curve crosses ki = 0 at omega > 0: kp there, and by how many the roots to the right change as kp rises through it."""
    omega, kp, ki = curve
    slope = ki / omega  # Im q + kd w, which changes its sign where ki does
    at = np.flatnonzero((slope[1:] > 0.0) != (slope[:-1] > 0.0))
    share = slope[at] / (slope[at] - slope[at + 1])
    rising = slope[at + 1] > slope[at]
    return kp[at] + share * (kp[at + 1] - kp[at]), np.where(rising, -2, 2)


def count_roots(family: LoopFamily, curve: GainCurve, p: Floats, i: Floats) -> Counts:
    """Count the roots right of a family's contour: from the base along ki = 0 to kp, then up to ki.

    Args:
        family: plant, kd and contour.
        curve: of the family.
        p: values of kp, shape (n,).
        i: values of ki, shape (n,), 0 and above.
    """
    count = np.full(p.size, family.unstable)
    for place, change in zip(*_axis_crossings(curve), strict=True):
        count += change * _passed(family.base, p, float(place))
    count += turn_at_rest(family) * _passed(family.base, p, -family.at_rest)
    count += ((i > 0.0) & (family.at_rest + p < 0.0)).astype(int)  # the integrator's own root, s = -ki/(q(0) + kp) at first
    points, height, change = column_crossings(curve, p)
    below = (height > 0.0) & (height < i[points])
    np.add.at(count, points[below], change[below])
    return count


def column_crossings(curve: GainCurve, p: Floats) -> tuple[NDArray[np.intp], Floats, Counts]:
    """Find where a curve crosses lines of constant kp: which of them, the ki there, and the change of the count as ki rises through it.

    Args:
        curve: of a family.
        p: values of kp, shape (n,).
    """
    _, kp, ki = curve
    order = np.argsort(p, kind="stable")
    low, high = np.minimum(kp[:-1], kp[1:]), np.maximum(kp[:-1], kp[1:])
    first, last = np.searchsorted(p[order], low, side="left"), np.searchsorted(p[order], high, side="left")
    lengths = last - first
    pieces = np.repeat(np.arange(kp.size - 1), lengths)
    offsets = np.arange(pieces.size) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    points = order[first[pieces] + offsets]
    share = (p[points] - kp[pieces]) / (kp[pieces + 1] - kp[pieces])
    height = ki[pieces] + share * (ki[pieces + 1] - ki[pieces])
    return points, height, np.where(kp[pieces + 1] > kp[pieces], 2, -2)


def _middles(along: Floats, beyond: Floats, low: float, high: float) -> Floats:
    """Middles between the places where a curve crosses an edge, which runs from low to high: the count changes nowhere else on it."""
    at = np.flatnonzero((beyond[1:] > 0.0) != (beyond[:-1] > 0.0))
    share = beyond[at] / (beyond[at] - beyond[at + 1])
    places = along[at] + share * (along[at + 1] - along[at])
    ends = np.concatenate(([low], np.sort(places[(places > low) & (places < high)]), [high]))
    return np.asarray(0.5 * (ends[:-1] + ends[1:]))


def _heights(region: GainRegion, at: Floats) -> Floats:
    """Length of the lines of constant kp within a region and its window."""
    top = region.window.ki_high
    count = count_roots(region.family, region.curve, at, np.full(at.size, np.finfo(float).tiny))
    points, height, change = column_crossings(region.curve, at)
    kept = (height > 0.0) & (height < top)
    points, height, change = points[kept], height[kept], change[kept]
    order = np.lexsort((height, points))
    points, height, change = points[order], height[order], change[order]
    total, level, running = [0.0] * at.size, [0.0] * at.size, count.tolist()
    for k, h, d in zip(points.tolist(), height.tolist(), change.tolist(), strict=True):  # numbers of Python's own: ten times as fast
        if running[k] == 0:
            total[k] += h - level[k]
        running[k] += d
        level[k] = h
    return np.where(np.array(running) == 0, np.array(total) + top - np.array(level), np.array(total))


def _passed(base: float, p: Floats, place: float) -> Counts:
    """Whether kp passes a place on its way from the base: 1 upwards, -1 downwards, 0 if not at all."""
    return ((base <= place) & (p > place)).astype(int) - ((base > place) & (p <= place)).astype(int)


def turn_at_rest(family: LoopFamily) -> int:
    """Tell by how much the count changes where kp rises through -q(0) and a real root passes the origin: s = -(kp + q(0))/q'(0)."""
    tiny = 1e-6
    slope = float((family.inverse(np.array([1j * tiny])).imag / tiny)[0]) + family.kd
    return 1 if slope < 0.0 else -1


def _rim(family: LoopFamily, curve: GainCurve, window: Window) -> NDArray[np.bool_]:
    """Whether points of the curve bound the region: on one side of them, up, down or aside, no root lies to the right."""
    omega, kp, ki = curve
    inside = (kp >= window.kp_low) & (kp <= window.kp_high) & (ki >= 0.0) & (ki <= window.ki_high)
    rim = np.zeros(omega.size, dtype=bool)
    at = np.flatnonzero(inside)
    up = 1e-3 * (np.abs(ki[at]) + 1e-3 * window.ki_high)
    aside = 1e-3 * (np.abs(kp[at]) + 1e-3 * (window.kp_high - window.kp_low))
    p = np.concatenate((kp[at], kp[at], kp[at] - aside, kp[at] + aside))
    i = np.concatenate((np.maximum(ki[at] - up, 0.0), ki[at] + up, ki[at], ki[at]))
    counts = count_roots(family, curve, p, i).reshape(4, -1)
    rim[at] = np.any(counts == 0, axis=0)
    return rim
