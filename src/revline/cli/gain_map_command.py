"""The command gain-map: stabilising gains over a map of operating points, and what holds at all of them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, OutOption, QuietOption
from revline.cli.plots import PlotOption, check_plot, write_plot
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import PartialResultError

if TYPE_CHECKING:
    from revline.design.gain_map import GainGrid, GainMap

THROTTLE, LOAD = "throttle", "load_torque"

HEADER = ("throttle [deg]", "load [N m]", "speed [rad/s]", "unstable roots", "largest kp", "best kp", "best ki", "")

ThrottlesOption = Annotated[str, typer.Option("--throttle", metavar="A1,A2,..", help="Throttle angles of the map [deg], rising.")]
LoadsOption = Annotated[str, typer.Option("--load", metavar="T1,T2,..", help="Load torques of the map [N m], rising.")]
KdOption = Annotated[float, typer.Option("--kd", metavar="KD", help="Derivative gain at all points [deg s/(rad/s)].")]
MsOption = Annotated[float, typer.Option("--ms", metavar="MS", help="Bound of the peak sensitivity.")]
WorkersOption = Annotated[int, typer.Option("--workers", min=1, max=64, help="Threads; results do not depend on them.")]


def gain_map(
    *,
    throttle: ThrottlesOption,
    load: LoadsOption = "0",
    kd: KdOption = 0.0,
    ms: MsOption = 2.0,
    plot: PlotOption = None,
    workers: WorkersOption = 2,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the (kp, ki) that stabilise the speed loop at each operating point of a map, and those that do at all, every delay exact.

    Points without a steady state or without gains stay in the map with the reason. `best` is the largest ki that keeps the peak
    sensitivity: 1/ki is the integrated error after a step of load.
    """
    from revline.design.gain_map import Design, find_gain_map
    from revline.io.engine_files import load_engine
    from revline.io.gain_map_records import gain_map_record
    from revline.io.json_files import format_json

    shell = Shell(json=json, quiet=quiet)
    check_plot(plot)
    shell.prepare_each((out, "map of gains"), (plot, "figure"))
    grid = _grid(throttle, load)
    system = load_engine(engine)
    with shell.progress(f"gains of {system.name}") as progress:
        found = find_gain_map(system, grid, Design(kd=kd, peak=ms), workers=workers, progress=progress)
    record = gain_map_record(found)
    shell.write(out, format_json(record), "map of gains")
    if found.interrupted:
        done, whole = len(found.found), len(found.points)
        kept = f"{out} holds the finished ones and says that it is partial" if out else "nothing was written, for want of --out"
        message = f"interrupted after {done} of {whole} operating points; {kept}"
        raise PartialResultError(message, done=done, points=whole)
    if plot is not None:
        from revline.report.gain_maps import plot_gain_map

        write_plot(plot, plot_gain_map(found), "gain-map")
    shell.warn(*_warnings(found))
    shell.show(record, *_parts(found), text_on=out)


def _grid(throttle: str, load: str) -> "GainGrid":
    import numpy as np

    from revline.design.gain_map import GainGrid
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
