"""Stabilising gains of a nonlinear system over a grid of operating points: region and gains of each, and what all have in common.

Each point is trimmed and linearised with its delays exact. A point without a trim, or without gains, stays in the map with the reason.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.analysis.linearize import linearize
from revline.analysis.threads import Failure, Progress, run_each
from revline.analysis.trim import Trim, find_trim
from revline.design.maps.best_gains import BestGains, best_gains
from revline.design.maps.gain_columns import (
    Ellipses,
    GainColumns,
    check_peak,
    find_ellipses,
    intersect_columns,
    peak_columns,
    stable_columns,
)
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.regions.gain_region import GainRegion, find_gain_region
from revline.design.regions.loop_family import family_of_system
from revline.errors import AnalysisError, InvalidInputError, NoTrimError, RevlineError
from revline.system import DelaySystem, Variable, index_of
from revline.values import make_read_only

Floats = NDArray[np.float64]

COLUMNS = 81
"""Columns of kp at which the gains of one point are looked at."""

COMMON_COLUMNS = 129
"""Columns at which the gains of all points are intersected."""

FEW_STARTS = 1
"""Starts of a trim beside a neighbour's, whose branch is followed; where these find none, as many are tried as elsewhere."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainGrid:
    """Operating points: all pairs of two signals' values.

    Attributes:
        first: name of the first signal: an input, or an output that the loop's drive holds, such as the speed.
        first_values: rising, shape (n,).
        second: name of the second signal, an input such as the load.
        second_values: rising, shape (m,).

    Raises:
        InvalidInputError: values do not rise, are none or not finite, or both axes are one signal.
    """

    first: str
    first_values: Floats
    second: str
    second_values: Floats

    def __post_init__(self) -> None:
        if self.first == self.second:
            message = f"both axes of the map are {self.first}; name two signals"
            raise InvalidInputError(message)
        for name, values in ((self.first, self.first_values), (self.second, self.second_values)):
            if values.ndim != 1 or not values.size or not np.all(np.isfinite(values)):
                message = f"axis {name} of the map: {values.tolist()}; give a list of finite numbers, at least one"
                raise InvalidInputError(message, axis=name)
            if np.any(np.diff(values) <= 0.0):
                message = f"axis {name} of the map does not rise strictly: {values.tolist()}; sort its values and give each once"
                raise InvalidInputError(message, axis=name)
        make_read_only(self)

    @property
    def shape(self) -> tuple[int, int]:
        """How many values each axis has."""
        return self.first_values.size, self.second_values.size


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainPoint:
    """One operating point with its gains.

    Attributes:
        place: values of the two axes.
        trim: the steady state.
        region: all stabilising gains at the map's kd.
        stable: the same on columns.
        ellipses: from which the gains that keep any peak of the sensitivity follow.
        allowed: those that keep the peak of the sensitivity.
        best: of these the ones with the largest ki; nothing where there are none.
        reason: why there are none, in words; empty where there are.
    """

    place: tuple[float, float]
    trim: Trim
    region: GainRegion
    stable: GainColumns
    ellipses: Ellipses
    allowed: GainColumns
    best: BestGains | None
    reason: str

    @property
    def proportional_limit(self) -> float | None:
        """Largest kp that stabilises without integral action; nothing where none does."""
        ends = self.region.kp_ends()
        return ends[-1][1] if ends else None


@dataclass(frozen=True, slots=True, kw_only=True)
class LostPoint:
    """An operating point without a result.

    Attributes:
        place: values of the two axes.
        reason: why, in words.
        interrupted: whether it was not tried because the whole was interrupted.
    """

    place: tuple[float, float]
    reason: str
    interrupted: bool = False


MapPoint = GainPoint | LostPoint
Value = Callable[[GainPoint], float | None]
ColumnsOf = Callable[[GainPoint, Floats], GainColumns]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainMap:
    """Gains over a grid of operating points.

    Attributes:
        system: name.
        grid: of the points.
        units: of the two axes.
        gain_unit: of kp.
        kd: derivative gain of all points.
        peak: bound of the sensitivity, Ms.
        points: one for each pair, those of one second value after another: point (i, j) stands at i + j n.
        stable: the gains that stabilise every point with a trim, on common columns; nothing where there are no such points.
        allowed: those that keep the peak at every such point.
    """

    system: str
    grid: GainGrid
    units: tuple[str, str]
    gain_unit: str
    kd: float
    peak: float
    points: tuple[MapPoint, ...]
    stable: GainColumns | None
    allowed: GainColumns | None

    @property
    def found(self) -> tuple[GainPoint, ...]:
        """Points with a trim."""
        return tuple(point for point in self.points if isinstance(point, GainPoint))

    @property
    def lost(self) -> tuple[LostPoint, ...]:
        """Points without a result."""
        return tuple(point for point in self.points if isinstance(point, LostPoint))

    @property
    def interrupted(self) -> bool:
        """Whether points are missing because the whole was interrupted."""
        return any(point.interrupted for point in self.lost)

    @property
    def limits(self) -> Floats:
        """Proportional limit of each point, shape as the grid; what does not exist is masked by infinity below."""
        return self._table(lambda point: point.proportional_limit)

    @property
    def weakest(self) -> GainPoint | None:
        """The point that allows least: one without gains, else the one with the smallest best ki."""
        return min(self.found, key=lambda point: point.best.ki if point.best else -math.inf, default=None)

    def words(self, place: tuple[float, float]) -> str:
        """Name a point for people."""
        names = (self.grid.first, self.grid.second)
        return ", ".join(f"{name} = {value:g} {unit}" for name, value, unit in zip(names, place, self.units, strict=True))

    def _table(self, value: Value) -> Floats:
        cells = [value(point) if isinstance(point, GainPoint) else None for point in self.points]
        numbers = np.array([-math.inf if cell is None else cell for cell in cells])
        return numbers.reshape(self.grid.shape[::-1]).T


class Design(NamedTuple):
    """What is asked of every point.

    Attributes:
        kd: derivative gain.
        peak: bound of the sensitivity, Ms, above 1, up to 20.
        wires: which signals close the loop.
    """

    kd: float = 0.0
    peak: float = 2.0
    wires: LoopSignals = SPEED_BY_THROTTLE


def find_gain_map(
    system: DelaySystem,
    grid: GainGrid,
    design: Design | None = None,
    *,
    known: GainMap | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> GainMap:
    """Find the gains at each point of a grid, and what all points have in common.

    Rows of the grid are followed from one trim to the next, so that of several steady states those of one branch are taken.

    Args:
        system: nonlinear, with its delays.
        grid: of operating points.
        design: derivative gain, bound of the sensitivity and signals.
        known: map of the same signals and design, whose points are not solved again.
        workers: threads; more than one gain nothing where the system's equations are short, as the interpreter then is what takes the time.
        progress: told which part is done.

    Returns:
        The map; where it was interrupted, with the points that were finished.

    Raises:
        InvalidInputError: an axis is no signal of the system, its values are out of range, or the peak is not above 1, or above 20.
        AnalysisError: no point has a trim.
    """
    design = design or Design()
    check_peak(design.peak)
    units = _check_axes(system, grid, design.wires)
    rows = [tuple((float(a), float(b)) for a in grid.first_values) for b in grid.second_values]
    solved = {point.place: point for point in known.points} if known is not None else {}
    task = partial(_follow_row, system, grid, design, solved)
    outcomes = run_each(task, rows, lambda row: float(len(row)), workers=workers, progress=progress)
    points: list[MapPoint] = []
    for row, outcome in zip(rows, outcomes, strict=True):
        points += [_unfinished(place, outcome) for place in row] if isinstance(outcome, Failure) else outcome
    found = [point for point in points if isinstance(point, GainPoint)]
    if not found and not any(isinstance(point, LostPoint) and point.interrupted for point in points):
        first = next(point for point in points if isinstance(point, LostPoint))
        message = f"none of the {len(points)} operating points has a result; the first: {first.reason}"
        raise NoTrimError(message)
    return GainMap(
        system=system.name,
        grid=grid,
        units=units,
        gain_unit=found[0].region.family.gain_unit if found else "",
        kd=design.kd,
        peak=design.peak,
        points=tuple(points),
        stable=_common(found, lambda point, kp: stable_columns(point.region, kp)),
        allowed=_common(found, lambda point, kp: peak_columns(point.region, kp, design.peak, point.ellipses)),
    )


def _unfinished(place: tuple[float, float], failure: Failure) -> LostPoint:
    stopped = isinstance(failure.error, KeyboardInterrupt)
    return LostPoint(place=place, reason="not reached before the interruption" if stopped else str(failure.error), interrupted=stopped)


def _check_axes(system: DelaySystem, grid: GainGrid, wires: LoopSignals) -> tuple[str, str]:
    names = [variable.name for variable in system.inputs]
    if grid.second not in names:
        index_of(system.inputs, grid.second)
    if grid.first in names:
        return _unit(system.inputs, grid.first), _unit(system.inputs, grid.second)
    if grid.second == wires.drive:
        message = f"{wires.drive} is to hold {grid.first}, so that it cannot be an axis too; give another input as the second axis"
        raise InvalidInputError(message)
    return _unit(system.outputs, grid.first), _unit(system.inputs, grid.second)


def _unit(variables: Sequence[Variable], name: str) -> str:
    return variables[index_of(variables, name)].unit


def _follow_row(
    system: DelaySystem,
    grid: GainGrid,
    design: Design,
    solved: Mapping[tuple[float, float], MapPoint],
    row: tuple[tuple[float, float], ...],
    go_on: Progress,
) -> list[MapPoint]:
    points: list[MapPoint] = []
    near: Trim | None = None
    for k, place in enumerate(row):
        go_on(k / len(row))
        point = solved[place] if place in solved else solve_point(system, grid, design, place, near)
        near = point.trim if isinstance(point, GainPoint) else near
        points.append(point)
    return points


def solve_point(system: DelaySystem, grid: GainGrid, design: Design, place: tuple[float, float], near: Trim | None = None) -> MapPoint:
    """Find the gains of one operating point.

    Args:
        system: nonlinear, with its delays.
        grid: names the axes; the place need not be one of its points.
        design: what is asked.
        place: values of the two axes.
        near: trim of a neighbour, whose branch is followed.

    Raises:
        InvalidInputError: a value is out of range.
    """
    try:
        trim = _trim(system, grid, design.wires, place, near)
        return _with_gains(system, design, place, trim)
    except InvalidInputError:
        raise
    except RevlineError as error:
        return LostPoint(place=place, reason=str(error))


def _trim(system: DelaySystem, grid: GainGrid, wires: LoopSignals, place: tuple[float, float], near: Trim | None) -> Trim:
    first, second = place
    given = any(variable.name == grid.first for variable in system.inputs)
    inputs = {grid.first: first, grid.second: second} if given else {grid.second: second}
    outputs = {} if given else {grid.first: first}
    free = () if given else (wires.drive,)
    if near is not None:
        states = {variable.name: float(value) for variable, value in zip(near.state_variables, near.states, strict=True)}
        try:
            return find_trim(system, inputs=inputs, outputs=outputs, free=free, near=states, starts=FEW_STARTS)
        except NoTrimError:
            pass
    return find_trim(system, inputs=inputs, outputs=outputs, free=free)


def _with_gains(system: DelaySystem, design: Design, place: tuple[float, float], trim: Trim) -> GainPoint:
    model = linearize(system, trim).model
    if model.static_gain(design.wires.drive, design.wires.measurement) == 0.0:
        message = f"{design.wires.drive} does not move {design.wires.measurement} for good here (gain 0 at rest), so that no gains hold it"
        raise AnalysisError(message)
    region = find_gain_region(family_of_system(model, kd=design.kd, wires=design.wires, name=system.name, roots=trim.roots))
    window = region.window
    kp = np.linspace(window.kp_low, window.kp_high, COLUMNS)
    ellipses = find_ellipses(region, design.peak)
    stable, allowed = stable_columns(region, kp), peak_columns(region, kp, design.peak, ellipses)
    best = None if allowed.empty else best_gains(region, ellipses, allowed, design.peak)
    reason = ""
    if region.empty:
        reason = f"no kp and ki stabilise this point with kd = {design.kd:g}; change kd, or leave the point out"
    elif best is None:
        words = f"no kp and ki keep the peak of the sensitivity at or below {design.peak:g} here"
        reason = f"{words} with kd = {design.kd:g}; allow more, or change kd"
    return GainPoint(place=place, trim=trim, region=region, stable=stable, ellipses=ellipses, allowed=allowed, best=best, reason=reason)


def _common(points: Sequence[GainPoint], columns: ColumnsOf) -> GainColumns | None:
    """Intersect the gains of all points, on columns over the kp that all windows hold."""
    if not points:
        return None
    low = max(point.region.window.kp_low for point in points)
    high = min(point.region.window.kp_high for point in points)
    if not low < high:
        nothing = np.empty(0)
        return GainColumns(kp=np.array([low]), column=np.empty(0, dtype=np.int64), low=nothing, high=nothing)
    kp = np.linspace(low, high, COMMON_COLUMNS)
    weakest_first = sorted(points, key=lambda point: point.stable.area)
    common = columns(weakest_first[0], kp)
    for point in weakest_first[1:]:
        alive = np.unique(common.column)
        if not alive.size:
            break
        beside = columns(point, kp[alive])  # columns without any need not be looked at again
        common = intersect_columns([common, replace(beside, kp=kp, column=alive[beside.column])])
    return common
