"""The largest box of operating points in which one set of gains holds, found on a map and refined, with the performance it must keep.

A bound of the sensitivity alone is met by no control at all wherever the system is stable by itself. So a floor is part of the question:
ki, whose inverse is the integrated error after a step of load, must not fall below a share of the best ki that the bound allows at each
point, or below a value. Source of the measure: Astrom and Hagglund (2006), Advanced PID Control, chapter 4.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.maps.gain_columns import SLACK, peak_columns
from revline.design.maps.gain_map import Design, GainGrid, GainMap, GainPoint, MapPoint, find_gain_map, solve_point
from revline.design.regions.sensitivity_contour import find_peaks
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.system import DelaySystem

Floats = NDArray[np.float64]

KP_COLUMNS, KI_LEVELS = 161, 161
"""Gains that are tried: kp evenly in its inverse hyperbolic sine, ki evenly in its logarithm."""

KP_SCALE = 0.05
"""Part of the largest kp below which columns are evenly spaced."""

CANDIDATES = 200
"""Gains of the largest box on the grid whose peaks are compared."""

LINES, REFINEMENTS = 4, 2
"""Into how many parts the grid is divided about the edges of its largest box, before the box is sought again, and how often."""

ABOUT, SMALL_KP = 0.4, 0.01
"""How far from the best ones found before, as a part of them, gains are then tried; kp counts as at least this part of the largest."""

HALVINGS = 4
"""How often an edge's place between two lines of the grid is halved."""

ALONG = 5
"""Points of an edge at which gains are tried while it is moved."""

INSIDE = 6
"""Points in each direction at which the gains of a box are tried between the grid's lines."""

WORST_HALVINGS = 3
"""How often the step about the worst point is halved, to find where it lies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """Performance below which gains do not count.

    Attributes:
        share: of the best ki at each point, 0 to 1; the integrated error after a step of load is then at most 1/share times the best.
        ki: smallest ki at any point; 1/ki is the integrated error per unit of drive that the load asks for.

    Raises:
        InvalidInputError: neither is given, or one is outside its range.
    """

    share: float = 0.25
    ki: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0:
            raise out_of_range("share of the best ki", self.share, "", "0 to 1", "give one such as 0.25")
        if not 0.0 <= self.ki < math.inf:
            raise out_of_range("smallest ki", self.ki, "", "0 and above", "give one, or 0 for none")
        if self.share == self.ki == 0.0:
            message = (
                "no performance is asked for: at points that are stable by themselves no control at all would do; give a share or a ki"
            )
            raise InvalidInputError(message)

    def at(self, best: float) -> float:
        """Smallest ki at a point whose best is given."""
        return max(self.ki, self.share * best)


class Box(NamedTuple):
    """Operating points between ends of both axes."""

    first_low: float
    first_high: float
    second_low: float
    second_high: float

    @property
    def area(self) -> float:
        """In the product of the axes' units."""
        return (self.first_high - self.first_low) * (self.second_high - self.second_low)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The four, that with the lowest first and highest second value first."""
        return (
            (self.first_low, self.second_high),
            (self.first_high, self.second_low),
            (self.first_low, self.second_low),
            (self.first_high, self.second_high),
        )

    def grid(self, count: int) -> list[tuple[float, float]]:
        """Points evenly spread over the box, edges included."""
        firsts = np.linspace(self.first_low, self.first_high, count)
        return [(float(a), float(b)) for a in firsts for b in np.linspace(self.second_low, self.second_high, count)]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxGains:
    """One set of gains, and the box of operating points that they hold.

    Attributes:
        box: of operating points.
        share: of the map's area.
        kp, ki, kd: gains.
        peak: bound of the sensitivity.
        floor: of performance.
        worst: highest peak found in the box, at `worst_at`.
        worst_at: values of the two axes.
        tightest: smallest ratio of ki to what the floor asks for, over the points tried; 1 and above.
        tried: operating points at which the gains were tried, between the grid's lines too.
    """

    box: Box
    share: float
    kp: float
    ki: float
    kd: float
    peak: float
    floor: Floor
    worst: float
    worst_at: tuple[float, float]
    tightest: float
    tried: int


class Solver:
    """Operating points of one system, each solved once; `best` is that of the map with the floor's kd."""

    def __init__(self, system: DelaySystem, found: GainMap, design: Design) -> None:
        self._system, self._grid, self._design, self._found = system, found.grid, design, found
        self._known: dict[tuple[float, float], MapPoint] = {}
        if found.kd == design.kd and found.peak == design.peak:
            self._known = {point.place: point for point in found.points}

    def __call__(self, place: tuple[float, float]) -> MapPoint:
        """Solve a point, on the branch of the nearest one of the map."""
        if place not in self._known:
            near = min(self._found.found, key=lambda point: math.dist(point.place, place))
            self._known[place] = solve_point(self._system, self._grid, self._design, place, near.trim)
        return self._known[place]


def find_largest_box(system: DelaySystem, found: GainMap, floor: Floor, *, reference: GainMap | None = None) -> BoxGains:
    """Find the largest box of a map in which one set of gains keeps the bound and the floor.

    Of the boxes between the grid's lines the largest one that any of many gains hold is taken, of these gains the ones with the lowest
    highest peak; then its edges are moved outwards by halving, and the gains are tried between the lines.

    Args:
        system: whose map it is.
        found: at the kd of the gains.
        floor: of performance.
        reference: map whose best ki the floor refers to, of the same grid; the map itself by default.

    Raises:
        InvalidInputError: the map has fewer than two values on an axis, or the reference has another grid.
        NotConvergedError: no gains hold even one cell of the grid, or those that hold its lines fail between them.
    """
    reference = reference or found
    if min(found.grid.shape) < 2 or found.grid.shape != reference.grid.shape:
        message = f"a box is sought in a map of {found.grid.shape} points; give at least two values on each axis, alike in both maps"
        raise InvalidInputError(message)
    gains, whole = _candidates(reference, floor), _whole(found)
    ends, good = _largest(found, _masks(found, reference, floor, gains))
    kp, ki = _gentlest(found, ends, [gains[k] for k in good])
    for _ in range(REFINEMENTS):
        found, reference = _finer(system, found, ends, same=reference is found, reference=reference)
        gains = _near(kp, ki, SMALL_KP * max(abs(p) for p, _ in gains))
        ends, good = _largest(found, _masks(found, reference, floor, gains))
        kp, ki = _gentlest(found, ends, [gains[k] for k in good])
    box = _box(found, ends)
    own = Solver(system, found, Design(kd=found.kd, peak=found.peak))
    ask = own if reference is found else Solver(system, reference, Design(kd=reference.kd, peak=reference.peak))

    def holds(places: Sequence[tuple[float, float]]) -> bool:
        return all(peak <= found.peak and slack >= 1.0 for peak, slack in (try_gains(own, ask, floor, place, (kp, ki)) for place in places))

    box = _moved(box, ends, found, holds)
    tried = {place: try_gains(own, ask, floor, place, (kp, ki)) for place in (*box.corners, *box.grid(INSIDE))}
    step = (box.first_high - box.first_low) / (INSIDE - 1), (box.second_high - box.second_low) / (INSIDE - 1)
    worst_at = _climb(box, step, tried, lambda place: try_gains(own, ask, floor, place, (kp, ki)))
    worst, tightest = tried[worst_at][0], min(slack for _, slack in tried.values())
    if worst > found.peak * (1.0 + SLACK) or tightest < 1.0:
        words = f"have a peak of {worst:.4g} at {found.words(worst_at)} and {tightest:.3g} times the ki that the floor asks for at least"
        message = f"gains that hold the lines of the map do not between them: kp = {kp:.4g}, ki = {ki:.4g} {words}; take a finer map"
        raise NotConvergedError(message, worst=worst, tightest=tightest)
    return BoxGains(
        box=box,
        share=box.area / whole.area,
        kp=kp,
        ki=ki,
        kd=found.kd,
        peak=found.peak,
        floor=floor,
        worst=worst,
        worst_at=worst_at,
        tightest=tightest,
        tried=len(tried),
    )


def try_gains(
    own: Callable[[tuple[float, float]], MapPoint],
    ask: Callable[[tuple[float, float]], MapPoint],
    floor: Floor,
    place: tuple[float, float],
    gains: tuple[float, float],
) -> tuple[float, float]:
    """Try gains at a point: the peak of the sensitivity, infinite where they do not stabilise, and ki over what the floor asks for.

    Args:
        own: gives the point at the gains' kd.
        ask: gives the point whose best ki the floor refers to.
        floor: of performance.
        place: of the point.
        gains: kp and ki.
    """
    point, other = own(place), ask(place)
    if not isinstance(point, GainPoint) or not isinstance(other, GainPoint) or other.best is None:
        return math.inf, 0.0
    kp, ki = gains
    region = point.region
    inside = abs(kp) <= region.reach[0] and ki <= region.reach[1] and bool(region.stabilises(kp, ki))
    return (float(find_peaks(region, kp, ki)) if inside else math.inf), ki / floor.at(other.best.ki)


def _candidates(reference: GainMap, floor: Floor) -> list[tuple[float, float]]:
    """Gains that are tried."""
    best = [point.best for point in reference.found if point.best]
    if not best:
        message = "no point of the map has gains that keep the bound, so that no box has; allow a higher peak, or another kd"
        raise NotConvergedError(message)
    high = 2.0 * max(abs(gains.kp) for gains in best) or 1.0
    scale = KP_SCALE * high
    kp = scale * np.sinh(np.linspace(-math.asinh(0.5 * high / scale), math.asinh(high / scale), KP_COLUMNS))
    low = min(floor.at(gains.ki) for gains in best)
    ki = np.geomspace(low, max(low * 1.001, *(gains.ki for gains in best)), KI_LEVELS)
    return [(float(p), float(i)) for p in kp for i in ki]


def _near(kp: float, ki: float, least: float) -> list[tuple[float, float]]:
    """Gains about others, closer to each other."""
    kps = kp + max(abs(kp), least) * np.linspace(-ABOUT, ABOUT, KP_COLUMNS)
    kis = ki * np.geomspace(1.0 - ABOUT, 1.0 / (1.0 - ABOUT), KI_LEVELS)
    return [(float(p), float(i)) for p in kps for i in kis]


def _masks(found: GainMap, reference: GainMap, floor: Floor, gains: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Which gains do at each point, shape of the grid by gains."""
    kp = np.array([p for p, _ in gains[::KI_LEVELS]])
    ki = np.array([i for _, i in gains[:KI_LEVELS]])
    rows = np.zeros((len(found.points), len(gains)), dtype=bool)
    for k, (point, other) in enumerate(zip(found.points, reference.points, strict=True)):
        if not isinstance(point, GainPoint) or not isinstance(other, GainPoint) or other.best is None:
            continue
        kept = np.abs(kp) <= point.region.reach[0]
        held = np.zeros((kp.size, ki.size), dtype=bool)
        held[kept] = peak_columns(point.region, kp[kept], found.peak, point.ellipses).holds(ki)
        rows[k] = (held & (ki >= floor.at(other.best.ki))).ravel()
    return rows.reshape(*found.grid.shape[::-1], len(gains)).swapaxes(0, 1)


def _largest(found: GainMap, masks: NDArray[np.bool_]) -> tuple[tuple[int, int, int, int], NDArray[np.intp]]:
    """Indices of the largest box's lines, and which gains hold it."""
    bad = np.zeros((masks.shape[0] + 1, masks.shape[1] + 1, masks.shape[2]), dtype=np.int32)
    bad[1:, 1:] = np.cumsum(np.cumsum(~masks, axis=0), axis=1)
    n, m = found.grid.shape
    boxes = [(a, b, c, d) for a in range(n) for b in range(a + 1, n) for c in range(m) for d in range(c + 1, m)]
    for a, b, c, d in sorted(boxes, key=lambda ends: -_box(found, ends).area):
        count = bad[b + 1, d + 1] - bad[a, d + 1] - bad[b + 1, c] + bad[a, c]
        good = np.flatnonzero(count == 0)
        if good.size:
            return (a, b, c, d), good
    message = "no gains hold even one cell of the map with this floor; ask for less performance, allow a higher peak, or take a finer map"
    raise NotConvergedError(message)


def _finer(
    system: DelaySystem, found: GainMap, ends: tuple[int, int, int, int], *, same: bool, reference: GainMap
) -> tuple[GainMap, GainMap]:
    """The maps with more lines about a box's edges."""
    axes = [_more_lines(axis, pair) for axis, pair in ((found.grid.first_values, ends[:2]), (found.grid.second_values, ends[2:]))]
    grid = GainGrid(first=found.grid.first, first_values=axes[0], second=found.grid.second, second_values=axes[1])
    own = find_gain_map(system, grid, Design(kd=found.kd, peak=found.peak), known=found)
    return own, own if same else find_gain_map(system, grid, Design(kd=reference.kd, peak=reference.peak), known=reference)


def _more_lines(axis: Floats, pair: tuple[int, int]) -> Floats:
    """Lines of a grid between the neighbours of two of them, with others about these two, where they are not its ends."""
    lines = [axis[max(0, pair[0] - 1) : pair[1] + 2]]
    for k in pair:
        if k in (0, axis.size - 1):
            continue
        lines += [np.linspace(axis[j], axis[j + 1], LINES + 1) for j in (k - 1, k)]
    return np.unique(np.concatenate(lines))


def _box(found: GainMap, ends: tuple[int, int, int, int]) -> Box:
    first, second = found.grid.first_values, found.grid.second_values
    return Box(float(first[ends[0]]), float(first[ends[1]]), float(second[ends[2]]), float(second[ends[3]]))


def _whole(found: GainMap) -> Box:
    return _box(found, (0, found.grid.shape[0] - 1, 0, found.grid.shape[1] - 1))


def _gentlest(found: GainMap, ends: tuple[int, int, int, int], gains: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Of some gains the ones with the lowest highest peak at the corners."""
    chosen = gains[:: max(1, len(gains) // CANDIDATES)]
    kp, ki = np.array(chosen).T
    n = found.grid.shape[0]
    corners = [found.points[i + j * n] for i in ends[:2] for j in ends[2:]]
    peaks = [find_peaks(point.region, kp, ki) for point in corners if isinstance(point, GainPoint)]
    return chosen[int(np.argmin(np.max(peaks, axis=0)))]


def _moved(box: Box, ends: tuple[int, int, int, int], found: GainMap, holds: Callable[[Sequence[tuple[float, float]]], bool]) -> Box:
    """Move each edge outwards, between its line of the grid and the next."""
    for name, k, way in (("first_low", 0, -1), ("first_high", 1, 1), ("second_low", 2, -1), ("second_high", 3, 1)):
        values = found.grid.first_values if k < 2 else found.grid.second_values
        line = ends[k] + way
        if not 0 <= line < values.size:
            continue
        inner, outer = float(values[ends[k]]), float(values[line])
        for _ in range(HALVINGS):
            middle = 0.5 * (inner + outer)
            inner, outer = (middle, outer) if holds(_edge(box, name, middle)) else (inner, middle)
        box = box._replace(**{name: inner})
    return box


def _edge(box: Box, name: str, value: float) -> list[tuple[float, float]]:
    shares = np.linspace(0.0, 1.0, ALONG)
    if name.startswith("first"):
        return [(value, float(box.second_low + s * (box.second_high - box.second_low))) for s in shares]
    return [(float(box.first_low + s * (box.first_high - box.first_low)), value) for s in shares]


def _climb(
    box: Box,
    step: tuple[float, float],
    tried: dict[tuple[float, float], tuple[float, float]],
    attempt: Callable[[tuple[float, float]], tuple[float, float]],
) -> tuple[float, float]:
    """Go from the worst point to worse neighbours with ever smaller steps."""
    here = max(tried, key=lambda place: tried[place][0])
    for _ in range(WORST_HALVINGS):
        step = 0.5 * step[0], 0.5 * step[1]
        for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            place = (
                min(max(here[0] + a * step[0], box.first_low), box.first_high),
                min(max(here[1] + b * step[1], box.second_low), box.second_high),
            )
            if place not in tried:
                tried[place] = attempt(place)
        here = max(tried, key=lambda place: tried[place][0])
    return here
