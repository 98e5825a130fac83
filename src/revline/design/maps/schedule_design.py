"""A gain schedule over speed and load that keeps the peak of the sensitivity, between the nodes of its table too.

At each node the gains with the largest ki at one peak are taken. Between the nodes the gains are interpolated and tried at the operating
points there, in finer steps about the worst; where it exceeds the bound, the peak at the nodes is lowered until it does not.

While the operating point moves: the integral sums ki e, so that at rest, where e and dy/dt are none, the derivatives of the gains multiply
nothing: the scheduled loop's linear model is that of the loop with frozen gains, at every point (Rugh and Shamma 2000, Automatica 36(10),
1401-1425). How fast the point may move is told by the rate `slowest`, a measure and no proof; a moving run is for
simulation, with `revline.design.controllers.scheduled_pid`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from revline.analysis.threads import Failure, Progress, run_each
from revline.design.controllers.gain_schedule import GainSchedule, Scaling
from revline.design.maps.best_gains import best_gains
from revline.design.maps.gain_columns import peak_columns
from revline.design.maps.gain_map import Design, GainMap, GainPoint, LostPoint, MapPoint, solve_point
from revline.design.regions.sensitivity_contour import find_peaks
from revline.errors import InvalidInputError, NotConvergedError
from revline.system import DelaySystem

Floats = NDArray[np.float64]
Place = tuple[float, float]

PARTS = 3
"""Into how many parts the sides of each cell of the table are divided where gains are tried first."""

HALVINGS = 3
"""How often the step about the worst point is halved."""

ATTEMPTS = 6
"""How often the peak at the nodes is lowered."""

LOWERED = 1.1
"""By this factor of the excess."""

SMALL_CHANGE = 0.1
"""Part by which the gains may change within one radian of the frequency at which the sensitivity peaks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedPlace:
    """Interpolated gains at one operating point.

    Attributes:
        place: values of the two axes.
        peak: of the sensitivity; infinite where the loop is unstable.
        fastest: rate of the first axis, in its unit per s, at which ki changes by a tenth within one radian of the peak's frequency.
    """

    place: Place
    peak: float
    fastest: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScheduleResult:
    """A schedule and its evidence.

    Attributes:
        schedule: the gains.
        peak: bound of the sensitivity.
        node_peak: the peak at the nodes, the bound or below it so that between them the bound is kept.
        tried: all operating points at which interpolated gains were tried.
        lost: operating points without a trim or gains, between the nodes.
        worst: the highest peak found, at `worst_at`.
        worst_at: values of the two axes.
        search_error: by how much the last halving about the worst point raised it.
        slowest: smallest of the rates `fastest`, at `slowest_at`.
        slowest_at: values of the two axes.
    """

    schedule: GainSchedule
    peak: float
    node_peak: float
    tried: tuple[TriedPlace, ...]
    lost: tuple[LostPoint, ...]
    worst: float
    worst_at: Place
    search_error: float
    slowest: float
    slowest_at: Place

    @property
    def holds(self) -> bool:
        """Whether the bound is kept wherever gains were tried."""
        return self.worst <= self.peak


def design_schedule(
    system: DelaySystem, found: GainMap, *, scaling: Scaling | None = None, workers: int = 1, progress: Progress | None = None
) -> ScheduleResult:
    """Design a schedule on a map, so that the map's bound is kept between its nodes too.

    Args:
        system: whose map it is.
        found: over the two signals that the gains are scheduled by, at least two values each; every node must have gains.
        scaling: powers of the first signal by which the gains are divided in the table; 1 for kp and 2 for ki by default.
        workers: threads.
        progress: told which part is done.

    Raises:
        InvalidInputError: the map has one value on an axis only.
        NotConvergedError: a node has no gains, or lowering their peak does not keep the bound between them.
    """
    if min(found.grid.shape) < 2:
        message = f"a schedule on a map of {found.grid.shape} points has nothing to interpolate; give at least two values on each axis"
        raise InvalidInputError(message)
    nodes = _nodes(found)
    places = _between(found)
    tell = progress or _ignore
    solve = partial(_solve, system, found)
    outcomes = run_each(solve, places, lambda _: 1.0, workers=workers, progress=lambda part: tell(0.9 * part))
    points: list[MapPoint] = []
    for place, outcome in zip(places, outcomes, strict=True):
        if isinstance(outcome, Failure):
            if isinstance(outcome.error, KeyboardInterrupt):
                raise outcome.error
            points.append(LostPoint(place=place, reason=str(outcome.error)))
        else:
            points.append(outcome)
    usable = [point for point in points if isinstance(point, GainPoint)] + [point for row in nodes for point in row]
    lost = tuple(point for point in points if isinstance(point, LostPoint))
    node_peak, scale = found.peak, Scaling() if scaling is None else scaling
    worst = TriedPlace(place=usable[0].place, peak=math.inf, fastest=0.0)
    for attempt in range(ATTEMPTS):
        schedule = _table(found, nodes, node_peak, scale)
        tried, error = _search(system, found, schedule, usable)
        worst = max(tried, key=lambda entry: entry.peak)
        if worst.peak <= found.peak:
            tell(1.0)
            return _result(found, schedule, node_peak, tried, lost, error)
        tell(0.9 + 0.1 * (attempt + 1) / ATTEMPTS)
        node_peak = max(1.0 + 0.5 * (node_peak - 1.0), node_peak - LOWERED * (worst.peak - found.peak))
    raise _not_kept(found, worst, node_peak)


def _result(
    found: GainMap, schedule: GainSchedule, node_peak: float, tried: Sequence[TriedPlace], lost: tuple[LostPoint, ...], error: float
) -> ScheduleResult:
    worst, slow = max(tried, key=lambda entry: entry.peak), min(tried, key=lambda entry: entry.fastest)
    return ScheduleResult(
        schedule=schedule,
        peak=found.peak,
        node_peak=node_peak,
        tried=tuple(tried),
        lost=lost,
        worst=worst.peak,
        worst_at=worst.place,
        search_error=error,
        slowest=slow.fastest,
        slowest_at=slow.place,
    )


def _not_kept(found: GainMap, worst: TriedPlace, node_peak: float) -> NotConvergedError:
    message = (
        f"between the nodes of the schedule the sensitivity peaks at {worst.peak:.4g}, at {found.words(worst.place)}, above the bound of "
        f"{found.peak:g}, and lowering the peak at the nodes to {node_peak:.4g} does not mend it; take more nodes, or a higher bound"
    )
    return NotConvergedError(message, worst=worst.peak)


def _nodes(found: GainMap) -> list[list[GainPoint]]:
    n, m = found.grid.shape
    rows: list[list[GainPoint]] = []
    for i in range(n):
        row = []
        for j in range(m):
            point = found.points[i + j * n]
            if isinstance(point, LostPoint) or point.best is None:
                message = f"no gains at the node {found.words(point.place)}: {point.reason}. A schedule needs gains at each; move the axes"
                raise NotConvergedError(message)
            row.append(point)
        rows.append(row)
    return rows


def _between(found: GainMap) -> list[Place]:
    firsts, seconds = (_divided(axis) for axis in (found.grid.first_values, found.grid.second_values))
    known = {point.place for point in found.points}
    return [(a, b) for b in seconds for a in firsts if (a, b) not in known]


def _divided(axis: Floats) -> list[float]:
    parts = [low + (high - low) * k / PARTS for low, high in pairwise(axis.tolist()) for k in range(PARTS)]
    return [float(value) for value in (*parts, axis[-1])]


def _solve(system: DelaySystem, found: GainMap, place: Place, go_on: Progress) -> MapPoint:
    go_on(0.0)
    near = min(found.found, key=lambda point: math.dist(point.place, place))
    return solve_point(system, found.grid, Design(kd=found.kd, peak=found.peak), place, near.trim)


def _table(found: GainMap, nodes: Sequence[Sequence[GainPoint]], peak: float, scaling: Scaling) -> GainSchedule:
    """Gains with the largest ki at one peak, at each node."""
    best = [[_at_peak(point, found.peak, peak) for point in row] for row in nodes]
    kp, ki = (np.array([[gains[k] for gains in row] for row in best]) for k in (0, 1))
    return GainSchedule(
        names=(found.grid.first, found.grid.second),
        units=found.units,
        gain_unit=found.gain_unit,
        first=found.grid.first_values,
        second=found.grid.second_values,
        kp=kp,
        ki=ki,
        kd=np.full(kp.shape, found.kd),
        scaling=scaling,
    )


def _at_peak(point: GainPoint, bound: float, peak: float) -> tuple[float, float]:
    if point.best is not None and peak == bound:
        return point.best.kp, point.best.ki
    allowed = peak_columns(point.region, point.allowed.kp, peak, point.ellipses)
    best = best_gains(point.region, point.ellipses, allowed, peak)
    return best.kp, best.ki


def try_place(point: GainPoint, gains: Callable[[float, float], tuple[float, float, float]]) -> TriedPlace:
    """Try a schedule's gains at an operating point; the derivative gain must be the map's.

    Args:
        point: solved.
        gains: kp, ki and kd at values of the two axes.
    """
    a, b = point.place
    kp, ki, _ = gains(a, b)
    region = point.region
    if abs(kp) > region.reach[0] or not 0.0 <= ki <= region.reach[1] or not region.stabilises(kp, ki):
        return TriedPlace(place=point.place, peak=math.inf, fastest=0.0)
    step = 1e-3 * max(abs(a), 1.0)
    up, down = gains(a + step, b)[1], gains(a - step, b)[1]
    slope = max(abs(up - ki), abs(ki - down)) / step / ki
    q = point.ellipses.q
    omega = point.ellipses.omega
    size = np.abs(q) / np.hypot(q.real + kp, q.imag + region.family.kd * omega - ki / omega)
    frequency = float(omega[int(np.argmax(size))])
    fastest = SMALL_CHANGE * frequency / slope if slope > 0.0 else math.inf
    return TriedPlace(place=point.place, peak=float(find_peaks(region, kp, ki)), fastest=fastest)


def _search(system: DelaySystem, found: GainMap, schedule: GainSchedule, points: Sequence[GainPoint]) -> tuple[list[TriedPlace], float]:
    """Try all points, then neighbours of the worst with ever smaller steps; the last rise tells how well it is located."""
    tried = {point.place: try_place(point, schedule.gains_at) for point in points}
    worst = max(tried.values(), key=lambda entry: entry.peak)
    steps = [float(np.max(np.diff(axis))) / PARTS for axis in (schedule.first, schedule.second)]
    error = 0.0
    for _ in range(HALVINGS):
        steps = [0.5 * step for step in steps]
        for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            place = (
                float(np.clip(worst.place[0] + a * steps[0], schedule.first[0], schedule.first[-1])),
                float(np.clip(worst.place[1] + b * steps[1], schedule.second[0], schedule.second[-1])),
            )
            if place not in tried:
                point = _solve(system, found, place, _ignore)
                if isinstance(point, GainPoint):
                    tried[place] = try_place(point, schedule.gains_at)
        before, worst = worst, max(tried.values(), key=lambda entry: entry.peak)
        error = worst.peak - before.peak if math.isfinite(before.peak) else math.inf
    return list(tried.values()), error


def _ignore(_: float) -> None:
    """Where nobody looks at progress."""
