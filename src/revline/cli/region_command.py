"""The command region: which (kp, ki) stabilise a loop at a given kd, its delay exact."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption
from revline.cli.shell import Facts, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from revline.design.gain_curve import LoopFamily
    from revline.design.gain_region import GainRegion, Window


def region(
    *,
    model: Annotated[
        Path | None, typer.Argument(metavar="[MODEL.json]", help="Model file; without one, the engine's exact linear model at --throttle.")
    ] = None,
    throttle: Annotated[
        float | None, typer.Option("--throttle", metavar="DEG", help="Throttle angle of the engine's trim [deg]; a model needs none.")
    ] = None,
    load: LoadOption = 0.0,
    kd: Annotated[float, typer.Option("--kd", metavar="KD", help="Derivative gain [deg s/rad per rad/s for an engine].")] = 0.0,
    kp_max: Annotated[float | None, typer.Option("--kp-max", metavar="KP", help="Largest kp looked at; else chosen.")] = None,
    ki_max: Annotated[float | None, typer.Option("--ki-max", metavar="KI", help="Largest ki looked at; else chosen.")] = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the (kp, ki) that stabilise the speed loop at a derivative gain, ki not negative, every delay exact.

    The boundary is the curve of gains at which a root lies on the imaginary axis; each of its points is exact.
    """
    from revline.design.gain_region import find_gain_region, find_window
    from revline.io.json_files import format_json
    from revline.io.region_records import region_record

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "region")
    family = _family(model, engine, (throttle, load), kd)
    found = find_gain_region(family, _window(find_window(family), kp_max, ki_max))
    record = region_record(found)
    shell.write(out, format_json(record), "region")
    shell.show(record, Facts(f"Stabilising gains of {family.name}, kd = {kd:g}", _facts(found, record)), text_on=out)


def _window(chosen: "Window", kp_max: float | None, ki_max: float | None) -> "Window":
    from revline.design.gain_region import Window

    return Window(
        kp_low=chosen.kp_low if kp_max is None else min(chosen.kp_low, -0.1 * abs(kp_max)),
        kp_high=chosen.kp_high if kp_max is None else kp_max,
        ki_high=chosen.ki_high if ki_max is None else ki_max,
    )


def _family(model: Path | None, engine: str, place: tuple[float | None, float], kd: float) -> "LoopFamily":
    from revline.design.loop_family import family_of_model, family_of_system

    throttle, load = place
    if model is not None:
        if throttle is not None or load != 0.0:
            message = "--throttle and --load place an engine's trim; a model file has its own operating point, leave them out"
            raise InvalidInputError(message)
        from revline.io.model_files import read_model

        file = read_model(model)
        return family_of_model(file.model, kd=kd, name=file.name)
    if throttle is None:
        message = "give a model file, or --throttle, the angle [deg] of the trim that the engine is linearised at"
        raise InvalidInputError(message)
    from revline.analysis.linearize import linearize
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine

    system = load_engine(engine)
    trim = find_trim(system, inputs={"throttle": throttle, "load_torque": load})
    return family_of_system(linearize(system, trim).model, kd=kd, name=f"{system.name} at {throttle:g} deg, {load:g} N m")


def _facts(found: "GainRegion", record: "Mapping[str, object]") -> list[tuple[str, float | str, str]]:
    unit = found.family.gain_unit
    rows: list[tuple[str, float | str, str]] = [
        ("kp without integral", f"{low:.5g} to {high:.5g}", unit) for low, high in found.kp_ends()
    ] or [("kp without integral", "none stabilises", "")]
    if found.rim.any():
        top = int(found.ki[found.rim].argmax())
        kp, ki, omega = (float(array[found.rim][top]) for array in (found.kp, found.ki, found.omega))
        rows.append(("largest ki", ki, f"{unit}/s, at kp = {kp:.4g}, oscillating at {omega:.4g} rad/s"))
    rows.append(("within the window", "all of them" if record["bounded"] else "not all: they go on beyond it", ""))
    rows.append(("points of the boundary", f"{int(found.rim.sum())}", ""))
    return rows
