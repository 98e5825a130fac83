"""The command gain-map: stabilising gains over a map of operating points, and what holds at all of them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, OutOption, QuietOption
from revline.cli.plots import PlotOption, check_plot, write_plot
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError, NotConvergedError, PartialResultError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from revline.design.maps.box_gains import Floor
    from revline.design.maps.gain_box_limit import BoxLimit
    from revline.design.maps.gain_map import Design, GainGrid, GainMap
    from revline.design.maps.schedule_design import ScheduleResult
    from revline.io.common_gain_records import Rows
    from revline.system import DelaySystem

THROTTLE, LOAD, SPEED = "throttle", "load_torque", "engine_speed"

FLOOR = (0.25, 0.0)
"""Share of the best ki, and smallest ki, where nothing else is asked for."""

HEADER = ("throttle [deg]", "load [N m]", "speed [rad/s]", "unstable roots", "largest kp", "best kp", "best ki", "")

ThrottlesOption = Annotated[str, typer.Option("--throttle", metavar="A1,A2,..", help="Throttle angles of the map [deg], rising.")]
LoadsOption = Annotated[str, typer.Option("--load", metavar="T1,T2,..", help="Load torques of the map [N m], rising.")]
KdOption = Annotated[float, typer.Option("--kd", metavar="KD", help="Derivative gain at all points [deg s/(rad/s)].")]
MsOption = Annotated[float, typer.Option("--ms", metavar="MS", help="Bound of the peak sensitivity, above 1 and up to 20.")]
FixedOption = Annotated[bool, typer.Option("--fixed", help="Find the largest box of the map in which one set of gains holds.")]
ShareOption = Annotated[
    float, typer.Option("--floor-share", metavar="S", help="With --fixed: smallest ki at each point as a part of the best there, 0 to 1.")
]
FloorOption = Annotated[float, typer.Option("--floor-ki", metavar="KI", help="With --fixed: smallest ki at all points [deg/(rad/s)/s].")]
BoxKdOption = Annotated[
    str,
    typer.Option(
        "--box-kd", metavar="KD,..", help="With --fixed: further kd [deg s/(rad/s)] to seek the box at; the floor stays that of --kd."
    ),
]
ProveOption = Annotated[
    float | None,
    typer.Option("--prove", metavar="PART", help="With --fixed: prove that no box is larger than the found one by more than this part."),
]
ScheduleOption = Annotated[bool, typer.Option("--schedule", help="Design a schedule over speed and load, tried between its nodes.")]
WorkersOption = Annotated[int, typer.Option("--workers", min=1, max=64, help="Threads; results do not depend on them.")]


def gain_map(
    *,
    throttle: ThrottlesOption,
    load: LoadsOption = "0",
    kd: KdOption = 0.0,
    ms: MsOption = 2.0,
    fixed: FixedOption = False,
    floor_share: ShareOption = FLOOR[0],
    floor_ki: FloorOption = FLOOR[1],
    box_kd: BoxKdOption = "",
    prove: ProveOption = None,
    schedule: ScheduleOption = False,
    plot: PlotOption = None,
    workers: WorkersOption = 1,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the (kp, ki) that stabilise the speed loop at each operating point of a map, and those that do at all, every delay exact.

    Points without a steady state or without gains stay in the map with the reason. `best` is the largest ki that keeps the peak
    sensitivity: 1/ki is the integrated error after a step of load.
    """
    from revline.design.maps.gain_map import Design, find_gain_map
    from revline.io.engine_files import load_engine
    from revline.io.gain_map_records import gain_map_record
    from revline.io.json_files import format_json

    shell = Shell(json=json, quiet=quiet)
    check_plot(plot)
    shell.prepare_each((out, "map of gains"), (plot, "figure"))
    asked = _asked(fixed=fixed, floor=(floor_share, floor_ki), box_kd=box_kd, prove=prove)
    grid, design = _grid(throttle, load), Design(kd=kd, peak=ms)
    system = load_engine(engine)
    with shell.progress(f"gains of {system.name}") as progress:
        found = find_gain_map(system, grid, design, workers=workers, progress=progress)
    record, parts = dict(gain_map_record(found)), _parts(found)
    shell.write(out, format_json(record), "map of gains")
    if found.interrupted:
        done, whole = len(found.found), len(found.points)
        kept = f"{out} holds the finished ones and says that it is partial" if out else "nothing was written, for want of --out"
        message = f"interrupted after {done} of {whole} operating points; {kept}"
        raise PartialResultError(message, done=done, points=whole)
    shell.warn(*_warnings(found))
    if asked is not None:
        record["fixed"], rows = _find_fixed(shell, system, found, asked, workers)
        parts.append(Facts("Largest box that one set of gains holds, of those tried", rows))
    result = None
    if schedule:
        record["schedule"], rows, result = _design(shell, system, found, design, workers)
        parts.append(Facts("Schedule over speed and load", rows))
    shell.write(out, format_json(record), "map of gains")
    _draw(plot, found, result)
    shell.show(record, *parts, text_on=out)


class _Asked(NamedTuple):
    """What is asked of fixed gains."""

    floor: "Floor"
    kds: tuple[float, ...]
    within: float | None


def _asked(*, fixed: bool, floor: tuple[float, float], box_kd: str, prove: float | None) -> _Asked | None:
    from revline.design.maps.box_gains import Floor
    from revline.errors import out_of_range
    from revline.io.number_lists import parse_numbers

    if not fixed:
        if box_kd or prove is not None or floor != FLOOR:
            message = "--floor-share, --floor-ki, --box-kd and --prove are about fixed gains; give --fixed too, or leave them out"
            raise InvalidInputError(message)
        return None
    if prove is not None and not prove > 0.0:
        raise out_of_range("--prove", prove, "", "values above 0", "give a part such as 0.2")
    return _Asked(Floor(share=floor[0], ki=floor[1]), parse_numbers(box_kd, "--box-kd") if box_kd else (), prove)


def _find_fixed(
    shell: Shell, system: "DelaySystem", found: "GainMap", asked: _Asked, workers: int
) -> tuple["Mapping[str, object]", "Rows"]:
    from revline.design.maps.gain_box import BoxGains, find_largest_box
    from revline.design.maps.gain_box_limit import limit_boxes
    from revline.design.maps.gain_map import Design, find_gain_map
    from revline.io.common_gain_records import box_record, box_rows

    maps = [found]
    for kd in asked.kds:
        with shell.progress(f"gains at kd = {kd:g}") as progress:
            maps.append(find_gain_map(system, found.grid, Design(kd=kd, peak=found.peak), workers=workers, progress=progress))
    boxes, refusals = list[BoxGains](), list[NotConvergedError]()
    with shell.busy("largest box"):
        for one in maps:
            try:
                boxes.append(find_largest_box(system, one, asked.floor, reference=found))
            except NotConvergedError as error:
                refusals.append(error)
                shell.warn(f"kd = {one.kd:g}: {error}")
    if not boxes:
        raise refusals[0]
    gains = max(boxes, key=lambda entry: entry.box.area)
    limit: BoxLimit | None = None
    if asked.within is not None and gains.share < 1.0:
        kds = (found.kd, *asked.kds)
        with shell.progress("proofs") as progress:
            limit = limit_boxes(system, gains, found, kd=(min(kds), max(kds)), within=asked.within, progress=progress)
    return box_record(found, gains, limit), box_rows(found, gains, limit)


def _design(
    shell: Shell, system: "DelaySystem", found: "GainMap", design: "Design", workers: int
) -> tuple["Mapping[str, object]", "Rows", "ScheduleResult"]:
    import numpy as np

    from revline.design.maps.gain_map import GainGrid, find_gain_map
    from revline.design.maps.schedule_design import design_schedule
    from revline.io.common_gain_records import schedule_record, schedule_rows

    speeds = [point.trim.output(SPEED) for point in found.found]
    axis = np.geomspace(min(speeds), max(speeds), found.grid.shape[0])
    grid = GainGrid(first=SPEED, first_values=axis, second=LOAD, second_values=found.grid.second_values)
    with shell.progress("gains over speed and load") as progress:
        nodes = find_gain_map(system, grid, design, workers=workers, progress=progress)
    with shell.progress("between the nodes") as progress:
        result = design_schedule(system, nodes, workers=workers, progress=progress)
    return schedule_record(nodes, result), schedule_rows(nodes, result), result


def _draw(plot: Path | None, found: "GainMap", result: "ScheduleResult | None") -> None:
    if plot is None:
        return
    from revline.report.gain_maps import plot_gain_map, plot_schedule

    write_plot(plot, plot_gain_map(found) if result is None else plot_schedule(result), "gain-map")


def _grid(throttle: str, load: str) -> "GainGrid":
    import numpy as np

    from revline.design.maps.gain_map import GainGrid
    from revline.io.number_lists import parse_numbers

    angles, loads = parse_numbers(throttle, "--throttle"), parse_numbers(load, "--load")
    return GainGrid(first=THROTTLE, first_values=np.array(angles), second=LOAD, second_values=np.array(loads))


def _warnings(found: "GainMap") -> list[str]:
    words = [f"no steady state at {found.words(point.place)}: {point.reason}" for point in found.lost]
    words += [f"at {found.words(point.place)}: {point.reason}" for point in found.found if point.reason]
    return words


def _parts(found: "GainMap") -> list[Facts | Grid]:
    from revline.io.gain_map_records import common_rows, map_rows

    title = f"Gains of {found.system}, kd = {found.kd:g}, Ms at most {found.peak:g}; gains in {found.gain_unit}"
    return [Grid(title, HEADER, map_rows(found)), Facts(f"All {len(found.found)} points with a steady state", common_rows(found))]
