"""The command map: an engine's steady states over the throttle, and how far a straight line through them holds."""

from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError
from revline.studies.throttle_map import Angles, Wording, find_throttle_map, find_widest

if TYPE_CHECKING:
    from revline.analysis.operating_range import LineFit, OperatingRange
    from revline.analysis.steady_map import SteadyMap

MOST_POINTS = 100_001

WORDING = Wording("--from", "--to", "--linear-within")

LineOption = Annotated[
    str | None, typer.Option("--line", metavar="LOW,HIGH", help="Lay a straight line through the speeds of this range [deg].")
]
WithinOption = Annotated[
    str | None,
    typer.Option(
        "--linear-within",
        metavar="TOL",
        help="Choose the widest range in which a straight line holds: within a part of the speed's change (1%) or within rad/s (3).",
    ),
]
AroundOption = Annotated[float, typer.Option("--around", metavar="DEG", help="Centre of the range that --linear-within chooses [deg].")]


def steady_map(
    *,
    low: Annotated[float, typer.Option("--from", metavar="DEG", help="Lowest throttle angle [deg].")] = 0.0,
    high: Annotated[float, typer.Option("--to", metavar="DEG", help="Highest throttle angle [deg].")] = 90.0,
    points: Annotated[int, typer.Option("--points", min=2, max=MOST_POINTS, help="How many angles, evenly spaced.")] = 91,
    line: LineOption = None,
    linear_within: WithinOption = None,
    around: AroundOption = 25.0,
    load: LoadOption = 0.0,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Map the steady states over the throttle: speed, pressure, torques and stability, and where steady states end.

    Angles without a steady state are left out and named in the warnings. The column `stable` of the file is 1 or 0. With --line or
    --linear-within also a straight line through the speeds, by least squares, with its largest error.
    """
    from revline.io.engine_files import load_engine
    from revline.io.point_records import format_map, line_record, map_record, operating_range_record

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "map")
    with shell.busy("steady states"):
        found = find_throttle_map(load_engine(engine), Angles(low, high, points), load, WORDING)
    record, parts = dict(map_record(found, load=load)), _show_map(found)
    if line is not None:
        fitted = _fit(found, line)
        record["line"] = line_record(fitted)
        parts.append(Facts(f"Straight line over {fitted.low:g} to {fitted.high:g} deg", _line_facts(fitted)))
    if linear_within is not None:
        chosen = find_widest(found, linear_within, around, WORDING)
        record["operating_range"] = operating_range_record(chosen)
        parts.append(_range_facts(chosen, linear_within))
    shell.write(out, format_map(found, load=load), "map")
    shell.warn(*found.warnings)
    shell.show(record, *parts, text_on=out)


def _show_map(found: "SteadyMap") -> list[Facts | Grid]:
    rows = [
        (trim.input("throttle"), trim.output("engine_speed"), trim.output("manifold_pressure"), "yes" if trim.stable else "no")
        for trim in found.trims
    ]
    header = ("throttle [deg]", "speed [rad/s]", "pressure [kPa]", "stable")
    return [Grid(f"Steady states of {found.system}", header, rows)]


def _fit(found: "SteadyMap", text: str) -> "LineFit":
    from revline.analysis.operating_range import fit_line
    from revline.io.number_lists import parse_numbers

    ends = parse_numbers(text, "--line")
    if len(ends) != 2:
        message = f"--line {text!r} names {len(ends)} angles; give the two ends of a range, for example 10,40"
        raise InvalidInputError(message, ends=len(ends))
    return fit_line(found, low=ends[0], high=ends[1])


def _line_facts(line: "LineFit") -> list[tuple[str, float | str, str]]:
    part = f"rad/s at {line.max_error_at:.4g} deg" + (
        f", {100.0 * line.max_error_fraction:.3g} % of the speed's change" if line.span else ""
    )
    return [
        ("slope", line.slope, "rad/s per deg"),
        ("intercept", line.intercept, "rad/s"),
        ("largest error", line.max_error, part),
    ]


def _range_facts(found: "OperatingRange", asked: str) -> Facts:
    from revline.analysis.operating_range import LimitedBy

    limits = {LimitedBy.TOLERANCE: "the tolerance", LimitedBy.MAP: "the end of the map"}
    unit = "of the speed's change" if asked.strip().endswith("%") else "rad/s"
    rows: list[tuple[str, float | str, str]] = [
        ("from", found.line.low, "deg"),
        ("to", found.line.high, "deg"),
        *_line_facts(found.line),
        ("limited by", limits[found.limited_by], ""),
    ]
    return Facts(f"Widest range around {found.centre:g} deg that is linear within {asked} {unit}", rows)
