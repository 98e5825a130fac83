"""Gains over the study's map of throttle and load: what one set of gains holds, and a schedule over speed and load that holds all of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from revline.analysis.threads import Progress
from revline.design.maps.box_gains import Floor
from revline.design.maps.gain_box import BoxGains, find_largest_box
from revline.design.maps.gain_box_limit import BoxLimit, limit_boxes
from revline.design.maps.gain_map import Design, GainGrid, GainMap, find_gain_map
from revline.design.maps.schedule_design import ScheduleResult, design_schedule
from revline.io.common_gain_records import box_record, schedule_record
from revline.io.gain_map_records import gain_map_record
from revline.report.gain_maps import plot_gain_map, plot_schedule
from revline.studies.config import StudyConfig
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.results import NotFound, attempt
from revline.system import DelaySystem

MAP_FIGURE, SCHEDULE_FIGURE = "7.9", "7.10"

PEAK = 2.0
"""Largest maximum sensitivity over the whole map. Source of the value: Astrom and Hagglund (2006), section 4.6."""

SPEEDS, LOADS = 6, 4
"""Nodes of the schedule."""

LITTLE = 0.25
"""Gains that hold everywhere do little where their ki is below this part of what the best point allows."""

WITHIN = 0.25
"""By this part of its area the largest box may fall short of what is proved of all; nearer proofs are those of the command `gain-map`."""

MAP_SHARE, BOX_SHARE, PROOF_SHARE = 0.1, 0.2, 0.4
"""Parts of the step's time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapResult:
    """Gains over the operating points.

    Attributes:
        gains: those that stabilise and those that keep the sensitivity at each point.
        box: the largest box of points that one set of gains holds, of those tried; nothing where there is none.
        limit: proofs that no box is much larger; nothing where there is no box, or where it is the whole map.
        nodes: the map of the schedule's nodes, where there is a schedule.
        schedule: over speed and load.
        missing: what was not found.
    """

    gains: GainMap
    box: tuple[BoxGains, ...]
    limit: tuple[BoxLimit, ...]
    nodes: tuple[GainMap, ...]
    schedule: tuple[ScheduleResult, ...]
    missing: tuple[NotFound, ...]

    @property
    def is_drawn(self) -> bool:
        """Whether any point has gains."""
        return any(point.best for point in self.gains.found)


def find_map(engine: DelaySystem, config: StudyConfig, progress: Progress) -> MapResult:
    """Find the gains of every operating point of the map with PI control, what one set of them holds, and a schedule.

    Raises:
        AnalysisError: no operating point of the map has a steady state.
    """
    grid = GainGrid(
        first="throttle",
        first_values=np.array(config.map_throttle_deg),
        second="load_torque",
        second_values=np.array(config.map_load_n_m),
    )
    gains = find_gain_map(engine, grid, Design(peak=PEAK), progress=lambda part: progress(MAP_SHARE * part))
    box, no_box = attempt("gains that hold a box of the map", lambda: find_largest_box(engine, gains, Floor()))
    progress(MAP_SHARE + BOX_SHARE)
    limit, no_limit = tuple[BoxLimit, ...](), tuple[NotFound, ...]()
    for one in box:
        if one.share < 1.0:
            limit, no_limit = attempt("limit of such boxes", partial(_limit, engine, one, gains, progress))
    begin = MAP_SHARE + BOX_SHARE + PROOF_SHARE
    progress(begin)
    schedule, no_schedule = attempt("schedule", lambda: _find_schedule(engine, gains, lambda part: progress(begin + (1.0 - begin) * part)))
    return MapResult(
        gains=gains,
        box=box,
        limit=limit,
        nodes=tuple(nodes for nodes, _ in schedule),
        schedule=tuple(result for _, result in schedule),
        missing=no_box + no_limit + no_schedule,
    )


def _limit(engine: DelaySystem, box: BoxGains, gains: GainMap, progress: Progress) -> BoxLimit:
    begin = MAP_SHARE + BOX_SHARE
    return limit_boxes(engine, box, gains, within=WITHIN, progress=lambda part: progress(begin + PROOF_SHARE * part))


def _find_schedule(engine: DelaySystem, gains: GainMap, progress: Progress) -> tuple[GainMap, ScheduleResult]:
    speeds = [point.trim.output("engine_speed") for point in gains.found]
    loads = gains.grid.second_values
    grid = GainGrid(
        first="engine_speed",
        first_values=np.geomspace(min(speeds), max(speeds), SPEEDS),
        second="load_torque",
        second_values=np.linspace(loads[0], loads[-1], LOADS),
    )
    nodes = find_gain_map(engine, grid, Design(peak=PEAK), progress=lambda part: progress(0.1 * part))
    return nodes, design_schedule(engine, nodes, progress=lambda part: progress(0.1 + 0.9 * part))


def map_fields(found: MapResult) -> dict[str, Any]:
    """The field `operating_map` of results.json."""
    record: dict[str, Any] = {
        key: value for key, value in gain_map_record(found.gains).items() if key not in {"schema", "engine", "partial"}
    }
    for box in found.box:
        record["fixed"] = box_record(found.gains, box, next(iter(found.limit), None))
    for nodes, schedule in zip(found.nodes, found.schedule, strict=True):
        record["schedule"] = schedule_record(nodes, schedule)
    if found.missing:
        record["not_found"] = [one._asdict() for one in found.missing]
    return {"operating_map": record}


def map_figures(found: MapResult) -> dict[str, FigureCall]:
    """The figures of the map and of the schedule; those that exist."""
    calls = {MAP_FIGURE: to_draw(plot_gain_map, found.gains)} if found.is_drawn else {}
    for schedule in found.schedule:
        calls[SCHEDULE_FIGURE] = to_draw(plot_schedule, schedule)
    return calls


def map_words(found: MapResult) -> str:
    """What holds at all operating points, in sentences."""
    return " ".join(_sentences(found))


def _sentences(found: MapResult) -> Iterator[str]:
    gains = found.gains
    limits = [point.proportional_limit for point in gains.found if point.proportional_limit is not None]
    if limits and min(limits) > 0.0:
        yield f"Over the map the largest proportional gain varies by a factor of {max(limits) / min(limits):.0f}."
    if gains.allowed is None or gains.allowed.empty:
        yield f"No kp and ki keep the maximum sensitivity at or below {gains.peak:g} at every point of it."
    else:
        kp, ki = gains.allowed.highest
        most = max((point.best.ki for point in gains.found if point.best), default=0.0)
        if ki < LITTLE * most:
            yield (
                f"One set of gains keeps the maximum sensitivity at or below {gains.peak:g} at every point only if it does little: ki is "
                f"at most {ki:.3g} (with kp = {kp:.2g}), where single points allow up to {most:.3g}."
            )
        else:
            yield f"One set of gains keeps Ms at or below {gains.peak:g} at every point: kp = {kp:.3g}, ki up to {ki:.3g}."
    yield from map(box_words, found.box)
    yield from map(limit_words, found.limit)
    for schedule in found.schedule:
        first, second = schedule.worst_at
        yield (
            f"A schedule over speed and load keeps it everywhere: {schedule.worst:.3f} at the worst of {len(schedule.tried)} points tried "
            f"between its {schedule.schedule.first.size} x {schedule.schedule.second.size} nodes too, at {first:.0f} rad/s and "
            f"{second:.3g} N m.{lost_words(schedule)}"
        )


def lost_words(schedule: ScheduleResult) -> str:
    """What to say of points between the nodes that could not be tried; nothing where there are none."""
    if not schedule.lost:
        return ""
    return f" {len(schedule.lost)} more could not be tried (the first: {schedule.lost[0].reason})."


def limit_words(limit: BoxLimit) -> str:
    """What no gains can do."""
    proofs = f"{len(limit.ruled)} proofs, each by a cover of all gains"
    nearer = "" if limit.complete else "; nearer to the box that was found they could not be brought"
    return f"No gains hold so much in any box of more than {100.0 * limit.share:.0f} % of the map: {proofs}{nearer}."


def box_words(box: BoxGains) -> str:
    """What one set of gains holds."""
    ends = box.box
    return (
        f"The largest box of it that one set of gains was found to hold, with at least {100.0 * box.floor.share:g} % of the best integral "
        f"gain of each point, is {100.0 * box.share:.0f} % of the map: {ends.first_low:.3g} to {ends.first_high:.3g} deg, "
        f"{ends.second_low:.3g} to {ends.second_high:.3g} N m, with kp = {box.kp:.3g} and ki = {box.ki:.3g}."
    )
