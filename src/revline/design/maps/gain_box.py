"""The largest box of operating points in which one set of gains holds: begun on the lines of a map, grown between them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.maps.box_gains import CommonGains, Floor, Solver, try_gains
from revline.design.maps.gain_columns import SLACK, peak_columns
from revline.design.maps.gain_map import Design, GainMap, GainPoint
from revline.design.maps.operating_box import CORNERS, Box, Share, grow_box
from revline.errors import InvalidInputError, NotConvergedError
from revline.system import DelaySystem

KP_COLUMNS, KI_LEVELS = 161, 161
"""Gains that are tried on the grid: kp evenly in its inverse hyperbolic sine, ki evenly in its logarithm."""

KP_SCALE = 0.05
"""Part of the largest kp below which columns are evenly spaced."""

INSIDE = 6
"""Points in each direction at which the gains of a box are tried between the grid's lines."""

WORST_HALVINGS = 3
"""How often the step about the worst point is halved, to find where it lies."""

DRAWN_IN, DRAWINGS = 0.7, 7
"""To which part a box that the grid gives is drawn in where its corners have no gains in common, and how often."""

TINY = 1e-12
"""Smallest share of the asked ki that is told apart from none."""

Attempt = Callable[[tuple[float, float]], tuple[float, float]]

ROUNDS = 4
"""How often a box grows anew at most, each time with one more point that it must serve."""


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


def find_largest_box(system: DelaySystem, found: GainMap, floor: Floor, *, reference: GainMap | None = None) -> BoxGains:
    """Find the largest box of a map in which one set of gains keeps the bound and the floor.

    The largest box between the grid's lines that any of many gains hold grows between the lines, one edge traded for another, as long as
    its corners have gains in common. Of these the ones with the lowest highest peak are tried in its inside; where they fail, the worst
    point there is one more that a box must serve, and it grows anew.

    Args:
        system: whose map it is.
        found: at the kd of the gains.
        floor: of performance.
        reference: map whose best ki the floor refers to, of the same grid; the map itself by default.

    Raises:
        InvalidInputError: the map has fewer than two values on an axis, or the reference has another grid.
        NotConvergedError: no gains hold even a part of a cell of the grid, or those that hold a box's corners fail between them.
    """
    reference = reference or found
    if min(found.grid.shape) < 2 or found.grid.shape != reference.grid.shape:
        message = f"a box is sought in a map of {found.grid.shape} points; give at least two values on each axis, alike in both maps"
        raise InvalidInputError(message)
    starts = _starts(found, _masks(found, reference, floor, _candidates(reference, floor)))
    own = Solver(system, found, Design(kd=found.kd, peak=found.peak))
    ask = own if reference is found else Solver(system, reference, Design(kd=reference.kd, peak=reference.peak))
    common = CommonGains(own, ask, floor, found.peak)

    def grow(served: tuple[Share, ...]) -> _Trial:
        box = _grown(starts, _whole(found), common, served)
        gains = common.gentlest(box, served)
        return _try_inside(box, gains, lambda place: try_gains(own, ask, floor, place, gains))

    trial, served = grow(CORNERS), CORNERS
    for _ in range(ROUNDS):
        if trial.holds(found.peak):
            break
        served = (*served, trial.box.share(trial.failing(found.peak)))
        trial = grow(served)
    return _result(found, floor, trial)


def _result(found: GainMap, floor: Floor, trial: "_Trial") -> BoxGains:
    kp, ki = trial.gains
    if not trial.holds(found.peak):
        words = f"at {found.words(trial.worst_at)} and {trial.tightest:.3g} times the ki that the floor asks for at least"
        message = (
            f"gains that hold the corners of a box do not hold its inside: kp = {kp:.4g}, ki = {ki:.4g} have a peak of "
            f"{trial.worst:.4g} {words}; take a finer map"
        )
        raise NotConvergedError(message, worst=trial.worst, tightest=trial.tightest)
    return BoxGains(
        box=trial.box,
        share=trial.box.area / _whole(found).area,
        kp=kp,
        ki=ki,
        kd=found.kd,
        peak=found.peak,
        floor=floor,
        worst=trial.worst,
        worst_at=trial.worst_at,
        tightest=trial.tightest,
        tried=len(trial.tried),
    )


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


def _starts(found: GainMap, masks: NDArray[np.bool_]) -> tuple[Box, ...]:
    """Where the search may begin: the largest box between the grid's lines, else its cells; and parts of these about their middle."""
    n, m = found.grid.shape
    largest = _largest(found, masks)
    boxes = [largest] if largest else [_box(found, (a, a + 1, c, c + 1)) for a in range(n - 1) for c in range(m - 1)]
    return (*boxes, *(box.about_middle(DRAWN_IN**k) for k in range(1, DRAWINGS) for box in boxes))


def _largest(found: GainMap, masks: NDArray[np.bool_]) -> Box | None:
    """The largest box between the grid's lines that any of the gains hold; nothing where they hold none."""
    bad = np.zeros((masks.shape[0] + 1, masks.shape[1] + 1, masks.shape[2]), dtype=np.int32)
    bad[1:, 1:] = np.cumsum(np.cumsum(~masks, axis=0), axis=1)
    n, m = found.grid.shape
    boxes = [(a, b, c, d) for a in range(n) for b in range(a + 1, n) for c in range(m) for d in range(c + 1, m)]
    for a, b, c, d in sorted(boxes, key=lambda ends: -_box(found, ends).area):
        count = bad[b + 1, d + 1] - bad[a, d + 1] - bad[b + 1, c] + bad[a, c]
        if np.any(count == 0):
            return _box(found, (a, b, c, d))
    return None


def _box(found: GainMap, ends: tuple[int, int, int, int]) -> Box:
    first, second = found.grid.first_values, found.grid.second_values
    return Box(float(first[ends[0]]), float(first[ends[1]]), float(second[ends[2]]), float(second[ends[3]]))


def _whole(found: GainMap) -> Box:
    return _box(found, (0, found.grid.shape[0] - 1, 0, found.grid.shape[1] - 1))


class _Trial(NamedTuple):
    """Gains tried in the inside of a box: peak of the sensitivity and slack of ki at each point."""

    box: Box
    gains: tuple[float, float]
    tried: dict[tuple[float, float], tuple[float, float]]

    @property
    def worst_at(self) -> tuple[float, float]:
        return max(self.tried, key=lambda place: self.tried[place][0])

    @property
    def worst(self) -> float:
        return self.tried[self.worst_at][0]

    @property
    def tightest(self) -> float:
        return min(slack for _, slack in self.tried.values())

    def holds(self, peak: float) -> bool:
        """Whether the gains keep the bound and the floor at all points."""
        return self.worst <= peak * (1.0 + SLACK) and self.tightest >= 1.0

    def failing(self, peak: float) -> tuple[float, float]:
        """The point that fails most."""
        return max(self.tried, key=lambda place: max(self.tried[place][0] / peak, 1.0 / max(self.tried[place][1], TINY)))


def _grown(starts: tuple[Box, ...], whole: Box, common: CommonGains, served: tuple[Share, ...]) -> Box:
    """Grow the first of some boxes whose served points have gains in common."""
    box = next((box for box in starts if common.exist(box, served)), None)
    if box is None:
        message = (
            "no gains hold even a cell of the map with this floor, nor a part of one about its middle; "
            "ask for less performance, allow a higher peak, or take a finer map"
        )
        raise NotConvergedError(message)
    return grow_box(box, whole, lambda tried: common.exist(tried, served))


def _try_inside(box: Box, gains: tuple[float, float], attempt: Attempt) -> _Trial:
    """Try gains on a grid of a box, and go from the worst point to worse neighbours with ever smaller steps."""
    tried = {place: attempt(place) for place in (*box.corners, *box.grid(INSIDE))}
    step = box.side(0) / (INSIDE - 1), box.side(2) / (INSIDE - 1)
    for _ in range(WORST_HALVINGS):
        here, step = _Trial(box, gains, tried).worst_at, (0.5 * step[0], 0.5 * step[1])
        for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            place = (
                min(max(here[0] + a * step[0], box.first_low), box.first_high),
                min(max(here[1] + b * step[1], box.second_low), box.second_high),
            )
            if place not in tried:
                tried[place] = attempt(place)
    return _Trial(box, gains, tried)
