"""The command linear-range: up to which amplitude an engine's linear model holds, frequency by frequency."""

from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption
from revline.cli.shell import Grid, Shell, is_stdout
from revline.errors import InvalidInputError, out_of_range

if TYPE_CHECKING:
    from revline.analysis.linear_range import LinearRanges, RangeLimits

LEAST_PERCENT, MOST_PERCENT = 1e-3, 100.0
"""Smallest limit that can be asked for, and the end below which an error's must lie."""

WORDS = MappingProxyType(
    {
        "error": "the error reaches its limit",
        "distortion": "the distortion reaches its limit",
        "input-limits": "holds as far as the throttle goes",
        "amplitudes-asked-for": "holds at all amplitudes asked for",
        "no-orbit": "no periodic answer above",
    }
)


def linear_range(
    *,
    throttle: ThrottleOption,
    load: LoadOption = 0.0,
    frequencies: Annotated[
        str, typer.Option("--frequencies", metavar="W1,W2,..", help="Frequencies [rad/s], rising, separated by commas.")
    ] = "0.1,0.2,0.5,1,2,5,10,20,50,100",
    within: Annotated[float, typer.Option("--within", metavar="PERCENT", help="Largest error of the linear model's response [%].")] = 5.0,
    distortion_within: Annotated[
        float | None, typer.Option("--distortion-within", metavar="PERCENT", help="Largest distortion [%]; without it any.")
    ] = None,
    amplitudes: Annotated[
        str | None,
        typer.Option("--amplitudes", metavar="A1,A2,..", help="Amplitudes of the grid [deg], rising; else 14 up to the throttle's limits."),
    ] = None,
    cells: Annotated[
        Path | None,
        typer.Option("--cells", metavar="FILE.csv", help="File for the describing functions, cell by cell.", show_default=False),
    ] = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find up to which throttle amplitude the exact linear model answers as the engine does, frequency by frequency.

    Compared are complex responses of the speed at the fundamental: the small-signal one with its delays exact, and that of the nonlinear
    engine by harmonic balance. The amplitude at which the error reaches its limit is found as a root. How straight the steady map is, is
    another question: `revline map --linear-within`. --out writes the ranges, as JSON where its name ends so, else as CSV.
    """
    from revline.analysis.linear_range import find_linear_ranges
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine
    from revline.io.json_files import format_json
    from revline.io.linear_range_records import format_cells, format_ranges, linear_range_record
    from revline.io.number_lists import parse_numbers

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "ranges")
    _check_cells(cells, out)
    shell.prepare(cells, "describing functions")
    limits = _limits(within, distortion_within)
    omega, ladder = parse_numbers(frequencies, "--frequencies"), amplitudes and parse_numbers(amplitudes, "--amplitudes")
    system = load_engine(engine)
    trim = find_trim(system, inputs={"throttle": throttle, "load_torque": load})
    with shell.progress("amplitudes") as progress:
        found = find_linear_ranges(system, trim, ("throttle", "engine_speed"), omega, ladder, limits=limits, progress=progress)
    place: dict[str, str | float] = {"engine": engine, "throttle_deg": throttle, "load_n_m": load}
    warnings = _warnings(found)
    record = {**place, **linear_range_record(found), "warnings": warnings}
    as_json = out is not None and out.suffix == ".json"
    shell.write(out, format_json(record) if as_json else format_ranges(found, {**place, "within": limits.error}), "ranges")
    shell.write(cells, format_cells(found.grid, place), "describing functions")
    shell.warn(*warnings)
    shell.show(record, *_for_people(f"{engine} at {throttle:g} deg, {load:g} N m", found), text_on=out)


def _check_cells(cells: Path | None, out: Path | None) -> None:
    if is_stdout(cells) or (cells is not None and out is not None and cells.absolute() == out.absolute()):
        message = f"--cells {cells} must be a file of its own; name another than that of --out"
        raise InvalidInputError(message)


def _limits(within: float, distortion_within: float | None) -> "RangeLimits":
    from revline.analysis.linear_range import RangeLimits

    if not LEAST_PERCENT <= within < MOST_PERCENT:
        raise out_of_range("--within", within, "%", f"{LEAST_PERCENT:g} to {MOST_PERCENT:g}", "give a percentage such as 5")
    if distortion_within is None:
        return RangeLimits(error=within / 100.0)
    if not distortion_within >= LEAST_PERCENT:
        remedy = "give a percentage such as 5, or leave it out"
        raise out_of_range("--distortion-within", distortion_within, "%", f"{LEAST_PERCENT:g} and above", remedy)
    return RangeLimits(error=within / 100.0, distortion=distortion_within / 100.0)


def _warnings(found: "LinearRanges") -> list[str]:
    import numpy as np

    from revline.analysis.describing import FINE_ENOUGH

    grid, warnings = found.grid, []
    if grid.missing:
        first = grid.missing[0]
        warnings.append(
            f"{len(grid.missing)} of {grid.found.size} cells have no periodic answer; the first, {first.amplitude:g} deg at "
            f"{first.omega:g} rad/s: {first.reason}"
        )
    rough = int(np.count_nonzero(grid.error > FINE_ENOUGH.tolerance))
    if rough:
        warnings.append(f"in {rough} cells the answer itself is known to {grid.error.max():.1g} only, as where an orbit touches a limit")
    return warnings


def _for_people(place: str, found: "LinearRanges") -> tuple[Grid, str]:
    from revline.io.linear_range_records import ended_by

    rows = [
        (entry.omega, entry.amplitude, f"{100.0 * entry.error:.3g}", f"{100.0 * entry.distortion:.3g}", WORDS[ended_by(entry)])
        for entry in found.ranges
    ]
    title = f"{place}: the linear model holds within {100.0 * found.limits.error:g} % up to"
    narrowest = f"narrowest: {found.narrowest.amplitude:.4g} deg at {found.narrowest.omega:.4g} rad/s"
    return Grid(title, ("frequency [rad/s]", "amplitude [deg]", "error there [%]", "distortion there [%]", "why"), rows), narrowest
