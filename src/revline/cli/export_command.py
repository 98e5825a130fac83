"""The command export: a controller as C99, MATLAB, python-control or JSON."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from revline import __version__
from revline.cli.controllers import HighOption, LowOption, SetpointWeightOption, read_any_controller, surrounded
from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, QuietOption
from revline.cli.plants import EngineChoice, find_engine_trim, refuse_engine
from revline.cli.shell import Facts, Shell
from revline.errors import InvalidInputError
from revline.studies.loop_runs import TimingChoice, own_limits

if TYPE_CHECKING:
    from collections.abc import Mapping

    from revline.design.controllers.scheduled_pid import AnyController
    from revline.io.controller_exports import Export

ControllerArgument = Annotated[Path, typer.Argument(metavar="CONTROLLER.json", help="Controller file, or a gain map with a schedule.")]
FormatOption = Annotated[
    str, typer.Option("--format", metavar="F1,F2,..", help="Of c, matlab, control and json, separated by commas; or all.")
]
FolderOption = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write into; made where it is missing.")]
PrecisionOption = Annotated[Literal["double", "float"], typer.Option("--precision", help="Type of the numbers in C.")]
NameOption = Annotated[
    str, typer.Option("--name", metavar="NAME", help="Begins the names of files and functions: lower-case letters, digits and underscores.")
]
PeriodOption = Annotated[
    float | None, typer.Option("--period", metavar="S", help="Sampling period [s], where the file names none; 0.005 by default.")
]
CrankOption = Annotated[float | None, typer.Option("--crank-angle", metavar="RAD", help="Sample each so many radians instead [rad].")]
TrimOption = Annotated[
    float | None, typer.Option("--throttle", metavar="DEG", help="Take output and measurement at rest from the engine's trim here [deg].")
]
RestOutputOption = Annotated[
    float | None, typer.Option("--rest-output", metavar="DEG", help="Output at rest, in its unit, where no engine is given; 0 by default.")
]
RestMeasurementOption = Annotated[
    float | None, typer.Option("--rest-measurement", metavar="RAD_S", help="Measurement at rest, in its unit; 0 by default.")
]


def export(
    *,
    controller: ControllerArgument,
    formats: FormatOption,
    out: FolderOption,
    precision: PrecisionOption = "double",
    name: NameOption = "speed_controller",
    period: PeriodOption = None,
    crank_angle: CrankOption = None,
    setpoint_weight: SetpointWeightOption = None,
    low: LowOption = None,
    high: HighOption = None,
    throttle: TrimOption = None,
    load: LoadOption = 0.0,
    rest_output: RestOutputOption = None,
    rest_measurement: RestMeasurementOption = None,
    engine: EngineOption = DEFAULT_ENGINE,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a controller as code: C99 in one file without dependency, a MATLAB function, python-control objects, or JSON with everything.

    The C code computes, in double precision, the same bits as the simulation. With --throttle the controller rests at the engine's trim
    and is limited as its throttle is; else it rests at the values given, and takes over whatever output there is when it starts.
    """
    from revline.design.controllers.scheduled_pid import law_of
    from revline.io.c_controller import COMPILE, Precision
    from revline.io.controller_exports import Export

    shell = Shell(json=json, quiet=quiet)
    wanted = _formats(formats)
    found = read_any_controller(controller, TimingChoice(period, crank_angle, 0.0))
    place = EngineChoice(engine, throttle, load)
    found, rest, full = _at_rest(found, place, (setpoint_weight, low, high), (rest_output, rest_measurement))
    made = Export(
        controller=found,
        name=name,
        rest=rest,
        precision=Precision(precision),
        full_range=full,
        provenance={"program": f"revline {__version__}", "controller": controller.name},
    )
    shell.warn(*_warnings(found))
    files = _write(made, wanted, out)
    gains = law_of(found).gains
    record: Mapping[str, object] = {
        "files": files,
        "formats": list(wanted),
        "precision": precision,
        "rest": {"output": rest[0], "measurement": rest[1]},
        "units": gains.gain_units,
    }
    rows: list[tuple[str, float | str, str]] = [("written", file, "") for file in files]
    rows += [("output at rest", rest[0], gains.output_unit), ("measurement at rest", rest[1], gains.input_unit)]
    rows += [("compile", f"{COMPILE} {name}.c", "")] if "c" in wanted else []
    shell.show(record, Facts(f"Export of {controller.name}", rows))


def _write(made: "Export", formats: tuple[str, ...], out: Path) -> list[str]:
    """Write all formats, once all of them could be made; the files' names."""
    from revline.io.atomic import write_atomically
    from revline.io.controller_exports import FORMATS

    texts = {out / FORMATS[key][1].format(name=made.name): FORMATS[key][0](made) for key in formats}
    _make_folder(out)
    for file, text in texts.items():
        write_atomically(file, text, "exported controller")
    return [str(file) for file in texts]


def _warnings(controller: "AnyController") -> list[str]:
    from revline.design.controllers.scheduled_pid import law_of

    if all(map(math.isfinite, (law_of(controller).low, law_of(controller).high))):
        return []
    return ["the code has an output without limits, and anti-windup nothing to act on; give --throttle, or --low and --high"]


def _formats(text: str) -> tuple[str, ...]:
    from revline.io.controller_exports import FORMATS

    wanted = tuple(FORMATS) if text == "all" else tuple(entry.strip() for entry in text.split(","))
    unknown = [entry for entry in wanted if entry not in FORMATS]
    if unknown:
        message = f"there is no format {unknown[0]!r}; there are {', '.join(FORMATS)}, and all"
        raise InvalidInputError(message, format=unknown[0])
    return wanted


def _at_rest(
    controller: "AnyController",
    place: EngineChoice,
    options: tuple[float | None, float | None, float | None],
    given: tuple[float | None, float | None],
) -> "tuple[AnyController, tuple[float, float], tuple[float, float]]":
    """The controller with weight and limits, output and measurement at rest, and the output's full range."""
    from revline.design.controllers.scheduled_pid import ScheduledController, law_of

    weight, *limits = options
    law = law_of(controller)
    if not isinstance(controller, ScheduledController) and law.gains.kp == law.gains.ki == law.gains.kd == 0.0:
        message = "all gains of the controller are 0, so that its code would do nothing; give a gain"
        raise InvalidInputError(message)
    if place.throttle is None:
        refuse_engine(place, "without --throttle the controller rests where --rest-output and --rest-measurement say")
        made = surrounded(controller, weight=weight, limits=(limits[0], limits[1]))
        law = law_of(made)
        low, high = own_limits(law)
        full = (0.0 if low is None else low, 90.0 if high is None else high)
        rest = (given[0] if given[0] is not None else min(max(0.0, law.low), law.high), given[1] or 0.0)
        return made, rest, full
    if given != (None, None):
        message = "--throttle and --rest-output or --rest-measurement each say where the controller rests; give one"
        raise InvalidInputError(message)
    from revline.engine.lee1995 import lee1995_parameters

    for unit, wanted, what in ((law.gains.input_unit, "rad/s", "measures"), (law.gains.output_unit, "deg", "drives")):
        if unit != wanted:
            message = (
                f"the controller {what} in {unit} and the engine's trim is in {wanted}; convert the gains, "
                "or give --rest-output and --rest-measurement in the controller's units in place of --throttle"
            )
            raise InvalidInputError(message)
    system, trim = find_engine_trim(place, "")
    saturation = lee1995_parameters(system).throttle.saturation_angle
    made = surrounded(controller, weight=weight, limits=(limits[0], limits[1]), saturation=saturation)
    return made, (place.throttle, trim.output("engine_speed")), (law_of(made).low, law_of(made).high)


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"the folder {out} cannot be made: {error.strerror}; name another with --out"
        raise InvalidInputError(message) from error
