"""One set of gains for the points of a box: the floor of performance, gains tried at a point, and gains that points have in common.

A bound of the sensitivity alone is met by no control at all wherever the system is stable by itself. So a floor is part of the question:
ki, whose inverse is the integrated error after a step of load, must not fall below a share of the best ki that the bound allows at each
point, or below a value. Source of the measure: Astrom and Hagglund (2006), Advanced PID Control, chapter 4.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from revline.design.maps.gain_columns import GainColumns, intersect_columns, peak_columns
from revline.design.maps.gain_map import Design, GainMap, GainPoint, MapPoint, solve_point
from revline.design.maps.operating_box import Box, Share
from revline.design.regions.sensitivity_contour import find_peaks
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.system import DelaySystem

Floats = NDArray[np.float64]

COLUMNS, NEAR_COLUMNS = 121, 17
"""Columns of kp at which points' gains are intersected: over all windows, and then between the neighbours of the best one."""

PEAK_ROOM = 2e-4
"""By this part gains in common stay below the bound: between a region's frequencies it is exceeded by half as much."""

LEVELS = 9
"""Values of ki of each column at which the peaks of gains in common are compared."""


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


class CommonGains:
    """Gains that some points of a box have in common."""

    def __init__(
        self,
        own: Callable[[tuple[float, float]], MapPoint],
        ask: Callable[[tuple[float, float]], MapPoint],
        floor: Floor,
        peak: float,
    ) -> None:
        """Remember what is asked.

        Args:
            own: gives the point at the gains' kd.
            ask: gives the point whose best ki the floor refers to.
            floor: of performance.
            peak: bound of the sensitivity.
        """
        self._own, self._ask, self._floor, self._peak = own, ask, floor, peak * (1.0 - PEAK_ROOM)

    def exist(self, box: Box, shares: tuple[Share, ...]) -> bool:
        """Whether there are any, at points given by their shares of the box's sides."""
        return self._find(box, shares) is not None

    def gentlest(self, box: Box, shares: tuple[Share, ...]) -> tuple[float, float]:
        """The kp and ki with the lowest highest peak at the points.

        Raises:
            NotConvergedError: the points have no gains in common.
        """
        found = self._find(box, shares)
        if found is None:
            message = f"the {len(shares)} points of a box have no gains in common on {COLUMNS} columns; take a finer map, or ask for less"
            raise NotConvergedError(message)
        points, common = found
        parts = np.linspace(0.0, 1.0, LEVELS)[:, None]
        kp = np.broadcast_to(common.kp[common.column], (LEVELS, common.column.size)).ravel()
        ki = (common.low + parts * (common.high - common.low)).ravel()
        peaks = np.max([find_peaks(point.region, kp, ki) for point in points], axis=0)
        at = int(np.argmin(peaks))
        return float(kp[at]), float(ki[at])

    def _find(self, box: Box, shares: tuple[Share, ...]) -> tuple[list[GainPoint], GainColumns] | None:
        points, floors = list[GainPoint](), list[float]()
        for place in (box.at(share) for share in shares):
            point, other = self._own(place), self._ask(place)
            if not isinstance(point, GainPoint) or not isinstance(other, GainPoint) or other.best is None:
                return None
            points.append(point)
            floors.append(self._floor.at(other.best.ki))
        low = max(max(point.region.window.kp_low, -point.region.reach[0]) for point in points)
        high = min(min(point.region.window.kp_high, point.region.reach[0]) for point in points)
        if not low < high:
            return None
        kp, least = np.linspace(low, high, COLUMNS), max(floors)
        common = self._columns(points, kp, 0.0)
        if common.empty:
            return None
        if common.highest[1] < least or common.above(least).column.size < LEVELS:
            best = int(common.column[np.argmax(common.high)])
            common = self._columns(points, np.linspace(kp[max(best - 1, 0)], kp[min(best + 1, COLUMNS - 1)], NEAR_COLUMNS), least)
        enough = common.above(least)
        return None if enough.empty else (points, enough)

    def _columns(self, points: list[GainPoint], kp: Floats, least: float) -> GainColumns:
        """Intersect one point after another, on the columns that still have gains of a ki above the least."""
        common = peak_columns(points[0].region, kp, self._peak, points[0].ellipses).above(least)
        for point in points[1:]:
            alive = np.unique(common.column)
            if alive.size:
                beside = peak_columns(point.region, kp[alive], self._peak, point.ellipses)
                common = intersect_columns([common, replace(beside, kp=kp, column=alive[beside.column])])
        return common
