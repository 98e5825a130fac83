"""The command margins: how much a loop's gain, phase and delay may change, on a linear model or on an engine's exact one."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.controller import PidGains
    from revline.design.open_loop import OpenLoop


def margins(
    *,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="[MODEL.json] CONTROLLER.json",
            help="Controller file; before it a model file, to judge the loop with that instead of an engine's exact linear model.",
        ),
    ],
    throttle: Annotated[
        float | None, typer.Option("--throttle", metavar="DEG", help="Throttle angle of the engine's trim [deg]; a model needs none.")
    ] = None,
    load: LoadOption = 0.0,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the margins of a speed loop, every delay exact: all crossovers, gain, phase, delay and disk margins, Ms and Mt.

    The loop is broken at the throttle. Margins of an unstable loop are no safety: the first line says which it is.
    """
    from revline.design.margins import find_margins
    from revline.io.controller_files import read_controller
    from revline.io.json_files import format_json
    from revline.io.margin_records import describe_margins, margin_record

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "margins")
    gains = read_controller(files[-1]).gains
    found = find_margins(_open_loop(files, gains, engine, place=(throttle, load)))
    record = margin_record(found, gains)
    shell.write(out, format_json(record), "margins")
    shell.show(
        record,
        Facts(f"{found.loop}: {'stable' if found.stable else 'UNSTABLE'}", describe_margins(found)),
        Grid("Crossovers", ("frequency [rad/s]", "what", "margin"), _crossovers(record)),
        text_on=out,
    )


def _open_loop(files: list[Path], gains: "PidGains", engine: str, *, place: tuple[float | None, float]) -> "OpenLoop":
    throttle, load = place
    if len(files) > 2:
        message = f"{len(files)} files were given; give a controller file, or a model file and a controller file"
        raise InvalidInputError(message)
    if len(files) == 2:
        if throttle is not None or load != 0.0:
            message = "--throttle and --load place an engine's trim; a model file has its own operating point, leave them out"
            raise InvalidInputError(message)
        return _of_model(files[0], gains)
    if throttle is None:
        message = "a loop around an engine needs --throttle, the angle [deg] of the trim that it is linearised at"
        raise InvalidInputError(message)
    return _of_engine(engine, gains, throttle, load)


def _of_model(path: Path, gains: "PidGains") -> "OpenLoop":
    from revline.design.open_loop import open_loop_of_model
    from revline.io.model_files import read_model

    file = read_model(path)
    return open_loop_of_model(file.model, gains, name=file.name)


def _of_engine(engine: str, gains: "PidGains", throttle: float, load: float) -> "OpenLoop":
    from revline.analysis.linearize import linearize
    from revline.analysis.trim import find_trim
    from revline.design.open_loop import open_loop_of_system
    from revline.io.engine_files import load_engine

    system = load_engine(engine)
    trim = find_trim(system, inputs={"throttle": throttle, "load_torque": load})
    return open_loop_of_system(linearize(system, trim).model, gains, name=f"{system.name} at {throttle:g} deg, {load:g} N m")


def _crossovers(record: Mapping[str, object]) -> list[tuple[float, str, str]]:
    """Crossovers as rows for people, by rising frequency; of the phase's only the first few."""
    rows: list[tuple[float, str, str]] = []
    gain, phase = record["gain_crossovers"], record["phase_crossovers"]
    if isinstance(gain, list) and isinstance(phase, list):
        rows += [(c["frequency_rad_s"], "gain", f"{c['phase_margin_deg']:.2f} deg, {1e3 * c['delay_margin_s']:.2f} ms") for c in gain]
        rows += [(c["frequency_rad_s"], "phase", f"factor {c['gain_margin']:.4g} ({c['gain_margin_db']:.2f} dB)") for c in phase[:6]]
    return sorted(rows)
