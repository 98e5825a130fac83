"""The command margins: how much a loop's gain, phase and delay may change, on a linear model or on an engine's exact one."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption
from revline.cli.plants import EngineChoice, find_engine_trim, linearise_engine, refuse_engine
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.controllers.controller import PidGains
    from revline.design.controllers.pid_controller import PidController
    from revline.design.stability.open_loop import OpenLoop

UnstablePolesOption = Annotated[
    int | None, typer.Option("--unstable-poles", metavar="N", help="Of a sampled plant: its poles right of the axis; else 0.")
]
DelayOption = Annotated[
    float | None, typer.Option("--delay", metavar="S", help="Of a sampled plant: delay [s] known to be in it; else the file's.")
]
ColumnsOption = Annotated[
    str | None, typer.Option("--columns", metavar="QUANTITY=COLUMN,..", help="Of a response: which column is what, as for fit.")
]
AmplitudeOption = Annotated[
    float | None, typer.Option("--amplitude", metavar="DEG", help="Of a response: amplitude of the input [deg], as for fit.")
]

WANTING = "a loop around an engine needs --throttle, the angle [deg] of the trim that it is linearised at"

OF_CRANK = "sampling by the crank's angle needs the speed: give --throttle, the angle [deg] of the trim that the model belongs to"


def margins(
    *,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="[MODEL.json|RESPONSE.csv] CONTROLLER.json",
            help="Controller file; before it a model or a frequency response (.csv), for the loop with that instead of an engine.",
        ),
    ],
    throttle: Annotated[
        float | None,
        typer.Option(
            "--throttle",
            metavar="DEG",
            help="Throttle angle of the engine's trim [deg]; a model needs none but for the speed of crank-synchronous sampling.",
        ),
    ] = None,
    load: LoadOption = 0.0,
    engine: EngineOption = DEFAULT_ENGINE,
    unstable_poles: UnstablePolesOption = None,
    delay: DelayOption = None,
    columns: ColumnsOption = None,
    amplitude: AmplitudeOption = None,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the margins of a speed loop, every delay exact: all crossovers, gain, phase, delay and disk margins, Ms and Mt.

    The loop is broken at the throttle. Margins of an unstable loop are no safety: the first line says which it is.
    Of a sampled response they hold within its band, with the interpolation's error: revline margins response.csv controller.json
    Of a controller that samples they are those that its samples see, sampling and hold exact; of one with a filter its filter is in
    the loop. Set-point weights, limits, anti-windup, dead zone and resolution have no part in small signals.
    """
    from revline.io.controller_files import read_controller

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "margins")
    options, choice = (unstable_poles, delay, columns, amplitude), EngineChoice(engine, throttle, load)
    of_response = _is_of_response(files, options)
    file = read_controller(files[-1])
    if hasattr(file.controller.sampling, "computation_delay"):
        _show_discrete(shell, files, file.controller, choice, out)
    elif of_response:
        refuse_engine(choice)
        _show_sampled(shell, files[0], file.feedback_gains, options, out)
    else:
        _show_continuous(shell, files, file.controller, choice, out)


def _show_continuous(shell: Shell, files: list[Path], controller: "PidController", choice: EngineChoice, out: Path | None) -> None:
    """Margins under a continuous controller."""
    from revline.design.stability.margins import find_margins
    from revline.io.json_files import format_json
    from revline.io.margin_records import describe_margins, margin_record

    found = find_margins(_open_loop(files, controller, choice))
    record = margin_record(found, controller)
    shell.write(out, format_json(record), "margins")
    shell.show(
        record,
        Facts(f"{found.loop}: {'stable' if found.stable else 'UNSTABLE'}", describe_margins(found)),
        Grid("Crossovers", ("frequency [rad/s]", "what", "margin"), _crossovers(record)),
        text_on=out,
    )


def _is_of_response(files: list[Path], options: tuple[object, ...]) -> bool:
    """Whether the plant is a frequency response; options that only that takes are refused without it, and more than two files."""
    if len(files) > 2:
        message = f"{len(files)} files were given; give a controller file, or a model file and a controller file"
        raise InvalidInputError(message)
    found = len(files) == 2 and files[0].suffix.lower() == ".csv"
    if not found and any(option is not None for option in options):
        message = "--unstable-poles, --delay, --columns and --amplitude are for a frequency response; give RESPONSE.csv, or leave them out"
        raise InvalidInputError(message)
    return found


def _show_discrete(shell: Shell, files: list[Path], controller: "PidController", choice: EngineChoice, out: Path | None) -> None:
    """Margins as the samples of a controller see them."""
    from revline.analysis.linearize import linearize
    from revline.design.stability.discrete_loop import find_discrete_margins, sampled_plant_of_model, sampled_plant_of_system
    from revline.io.json_files import format_json
    from revline.io.margin_records import describe_margins, margin_record
    from revline.io.model_files import read_model

    if len(files) == 2:
        if files[0].suffix.lower() == ".csv":
            message = "a controller that samples needs its plant above half its sampling frequency, which no response shows; give a model"
            raise InvalidInputError(message)
        speed = _speed_of_samples(controller, choice)
        model = read_model(files[0])
        plant = sampled_plant_of_model(model.model, name=model.name)
    else:
        system, trim = find_engine_trim(choice, WANTING)
        plant = sampled_plant_of_system(linearize(system, trim).model, name=f"{system.name} at {choice.place}")
        speed = trim.output("engine_speed")
    found = find_discrete_margins(plant, controller, speed=speed)
    extra = {"sampling_period_s": found.period, "equivalent_delay_s": found.equivalent_delay, "left_out": found.left_out}
    record = {**margin_record(found.margins, controller), **extra}
    shell.write(out, format_json(record), "margins")
    facts = [
        *describe_margins(found.margins),
        ("sampling period", found.period, "s"),
        ("equivalent delay", found.equivalent_delay, "s, for a continuous loop"),
    ]
    shell.show(
        record,
        Facts(f"{found.margins.loop}: {'stable' if found.margins.stable else 'UNSTABLE'}", facts),
        Grid("Crossovers up to half the sampling frequency", ("frequency [rad/s]", "what", "margin"), _crossovers(record)),
        text_on=out,
    )


def _speed_of_samples(controller: "PidController", choice: EngineChoice) -> float | None:
    """Speed that a model's samples are taken at, where that is what they need: that of the engine's trim which the model belongs to."""
    if not hasattr(controller.sampling, "angle"):
        refuse_engine(choice)
        return None
    _, trim = find_engine_trim(choice, OF_CRANK)
    return trim.output("engine_speed")


def _show_sampled(
    shell: Shell, path: Path, gains: "PidGains", options: tuple[int | None, float | None, str | None, float | None], out: Path | None
) -> None:
    from revline.design.stability.sampled_margins import find_sampled_margins
    from revline.io.json_files import format_json
    from revline.io.number_lists import parse_pairs
    from revline.io.response_files import read_response
    from revline.io.sampled_margin_records import describe_sampled_margins, sampled_margin_record

    unstable_poles, delay, columns, amplitude = options
    file = read_response(path, columns=parse_pairs(columns, "--columns") if columns is not None else None, amplitude=amplitude)
    found = find_sampled_margins(file.response, gains, delay=delay, unstable_poles=unstable_poles or 0, name=path.stem)
    record = sampled_margin_record(found, gains)
    shell.warn(*file.notes)
    shell.write(out, format_json(record), "margins")
    shell.show(
        record,
        Facts(f"{found.loop}: sampled", describe_sampled_margins(found)),
        Grid("Crossovers in the band", ("frequency [rad/s]", "what", "margin"), _crossovers(record)),
        *(f"note: {note}" for note in found.notes),
        text_on=out,
    )


def _open_loop(files: list[Path], controller: "PidController", choice: EngineChoice) -> "OpenLoop":
    from revline.design.stability.open_loop import open_loop_of_model, open_loop_of_system
    from revline.io.model_files import read_model

    if len(files) == 2:
        refuse_engine(choice)
        file = read_model(files[0])
        return open_loop_of_model(file.model, controller, name=file.name)
    name, linear = linearise_engine(choice, WANTING)
    return open_loop_of_system(linear, controller, name=name)


def _crossovers(record: Mapping[str, object]) -> list[tuple[float, str, str]]:
    """Crossovers as rows for people, by rising frequency; of the phase's only the first few."""
    rows: list[tuple[float, str, str]] = []
    gain, phase = record["gain_crossovers"], record["phase_crossovers"]
    if isinstance(gain, list) and isinstance(phase, list):
        rows += [(c["frequency_rad_s"], "gain", f"{c['phase_margin_deg']:.2f} deg, {1e3 * c['delay_margin_s']:.2f} ms") for c in gain]
        rows += [(c["frequency_rad_s"], "phase", f"factor {c['gain_margin']:.4g} ({c['gain_margin_db']:.2f} dB)") for c in phase[:6]]
    return sorted(rows)
