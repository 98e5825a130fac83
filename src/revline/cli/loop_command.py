"""The command loop: a closed speed loop in time, on an engine or on a linear model."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption
from revline.cli.shell import Facts, Shell
from revline.errors import InvalidInputError, out_of_range

if TYPE_CHECKING:
    from collections.abc import Mapping

    from revline.design.closed_loop import LoopRun, LoopTask
    from revline.design.controller import PidGains

WIDE_OPEN = 90.0
"""Largest throttle angle [deg]."""


def loop(
    *,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="[MODEL.json] CONTROLLER.json", help="Controller file; before it a model file, to run that instead of an engine."
        ),
    ],
    throttle: Annotated[
        float | None,
        typer.Option("--throttle", metavar="DEG", help="Throttle angle of the trim that the loop starts from [deg]; a model needs none."),
    ] = None,
    load: LoadOption = 0.0,
    step: Annotated[float, typer.Option("--step", metavar="RAD_S", help="Step of the speed command at time 0 [rad/s].")] = 60.0,
    until: Annotated[float, typer.Option("--until", metavar="S", help="Stop time [s].")] = 20.0,
    time_step: Annotated[
        float, typer.Option("--time-step", metavar="S", help="Step of the simulation [s], shorter than every lag.")
    ] = 1e-3,
    low: Annotated[float | None, typer.Option("--low", metavar="DEG", help="Lower limit of the throttle [deg]; 0 for an engine.")] = None,
    high: Annotated[
        float | None,
        typer.Option("--high", metavar="DEG", help="Upper limit of the throttle [deg]; for an engine where the throttle saturates."),
    ] = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Close the speed loop with a controller, step its command, and tell how it ends: settled, hunting, diverged or stalled.

    The throttle is trim + kp e + ki integral of e - kd dw/dt, within its limits; without anti-windup. A model runs without limits,
    its delay exact; with --throttle it is placed at the engine's trim, else all values are deviations from it.
    """
    from revline.design.closed_loop import LoopTask, describe_outcome
    from revline.io.controller_files import read_controller
    from revline.io.loop_records import format_loop, loop_warnings

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "closed-loop record")
    _check_plant(files, throttle, limited=low is not None or high is not None, placed=load != 0.0 or engine != DEFAULT_ENGINE)
    gains = read_controller(files[-1]).gains
    task = LoopTask(command=step, until=until, step=time_step)
    with shell.busy("running the loop; the first run of all compiles it, which takes some seconds"):
        if throttle is None or len(files) == 2:
            run, record = _run_model(files[0], gains, task, base=_place(engine, throttle, load))
        else:
            run, record = _run_engine(engine, gains, task, place=(throttle, load), limits=(low, high))
    shell.warn(*loop_warnings(run))
    shell.write(out, format_loop(run), "closed-loop record")
    shell.show(record, Facts(f"{gains.rule} controller on {run.plant}", _facts(record)), describe_outcome(run), text_on=out)


def _check_plant(files: list[Path], throttle: float | None, *, limited: bool, placed: bool) -> None:
    """Refuse files and options that make no loop."""
    if len(files) > 2:
        message = f"{len(files)} files were given; give a controller file, or a model file and a controller file"
        raise InvalidInputError(message)
    if len(files) == 2 and limited:
        message = "--low and --high limit an engine's throttle; a linear model runs without limits, leave them out"
        raise InvalidInputError(message)
    if len(files) == 2 and placed and throttle is None:
        message = "--engine and --load place a linear model at an engine's trim; give --throttle too, or leave them out"
        raise InvalidInputError(message)
    if len(files) == 1 and throttle is None:
        message = "a loop around an engine needs --throttle, the angle [deg] of the trim that it starts from"
        raise InvalidInputError(message)


def _run_engine(
    engine: str, gains: "PidGains", task: "LoopTask", *, place: tuple[float, float], limits: tuple[float | None, float | None]
) -> "tuple[LoopRun, Mapping[str, object]]":
    from revline.analysis.trim import find_trim
    from revline.design.closed_loop import Limits, operating_point, run_loop
    from revline.engine.lee1995 import lee1995_parameters
    from revline.io.engine_files import load_engine
    from revline.io.loop_records import loop_record

    plant = load_engine(engine)
    trim = find_trim(plant, inputs={"throttle": place[0], "load_torque": place[1]})
    bounds = Limits(*throttle_limits(limits, lee1995_parameters(plant).throttle.saturation_angle))
    run = run_loop(plant, operating_point(trim), gains, task, limits=bounds)
    return run, loop_record(run)


def throttle_limits(wanted: tuple[float | None, float | None], saturation: float) -> tuple[float, float]:
    """Limits asked for, else 0 and where the throttle saturates; refused where no throttle can reach them."""
    low, high = (default if value is None else value for value, default in zip(wanted, (0.0, saturation), strict=True))
    for name, value in (("--low", low), ("--high", high)):
        if not 0.0 <= value <= WIDE_OPEN:
            raise out_of_range(name, value, "deg", f"0 to {WIDE_OPEN:g} deg", "give an angle that the throttle can reach")
    if not low < high:
        message = f"--low = {low:g} deg is not below --high = {high:g} deg; give limits with room between them"
        raise InvalidInputError(message, low=low, high=high)
    return low, high


def _run_model(path: Path, gains: "PidGains", task: "LoopTask", *, base: tuple[float, float]) -> "tuple[LoopRun, Mapping[str, object]]":
    from revline.design.closed_loop import run_linear_loop
    from revline.io.loop_records import linear_loop_record
    from revline.io.model_files import read_model

    file = read_model(path)
    run = run_linear_loop(file.model, gains, task, name=file.name, base=base)
    return run, linear_loop_record(run, file.model)


def _place(engine: str, throttle: float | None, load: float) -> tuple[float, float]:
    """Throttle and speed at the trim that a model is placed at; 0 without one."""
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine

    if throttle is None:
        return 0.0, 0.0
    trim = find_trim(load_engine(engine), inputs={"throttle": throttle, "load_torque": load})
    return throttle, trim.output("engine_speed")


def _facts(record: "Mapping[str, object]") -> list[tuple[str, float | str, str]]:
    """What a record says of a closed loop, for people."""
    names = (
        ("start_rad_s", "speed before the step", "rad/s"),
        ("target_rad_s", "speed commanded", "rad/s"),
        ("overshoot", "overshoot", "of the command"),
        ("settling_time_s", "settling time", "s"),
        ("bandwidth_rad_s", "bandwidth", "rad/s"),
        ("throttle_low_deg", "lowest throttle", "deg"),
        ("throttle_high_deg", "highest throttle", "deg"),
    )
    rows: list[tuple[str, float | str, str]] = [("stable", "yes" if record["stable"] else "no", "")]
    for key, text, unit in names:
        value = record.get(key)
        if isinstance(value, float):
            rows.append((text, value, unit))
    return rows
