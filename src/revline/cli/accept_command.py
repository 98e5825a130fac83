"""The command accept: a controller on the nonlinear, sampled, saturated, noisy engine, with a verdict."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline import __version__
from revline.cli.loop_command import throttle_limits
from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, OutOption, QuietOption
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.acceptance import Acceptance
    from revline.design.pid_controller import PidController
    from revline.system import DelaySystem

PERIOD = 0.005
"""Seconds between samples where neither the file nor an option says when the controller runs."""


def accept(
    *,
    controller: Annotated[Path, typer.Argument(metavar="CONTROLLER.json", help="Controller file.")],
    throttle: Annotated[str, typer.Option("--throttle", metavar="A1,A2,..", help="Throttle angles of the trims [deg].")],
    load: Annotated[str, typer.Option("--load", metavar="T1,T2,..", help="Load torques of the trims [N m]; each with each angle.")] = "0",
    period: Annotated[
        float | None, typer.Option("--period", metavar="S", help="Sampling period [s], where the file names none; 0.005 by default.")
    ] = None,
    crank_angle: Annotated[
        float | None, typer.Option("--crank-angle", metavar="RAD", help="Sample each so many radians of the crank instead [rad].")
    ] = None,
    computation_delay: Annotated[
        float, typer.Option("--computation-delay", metavar="S", help="Time from a sample to its output [s], with the two above.")
    ] = 0.0,
    low: Annotated[
        float | None, typer.Option("--low", metavar="DEG", help="Lower limit of the throttle [deg]; else the file's, else 0.")
    ] = None,
    high: Annotated[
        float | None,
        typer.Option("--high", metavar="DEG", help="Upper limit of the throttle [deg]; else the file's, else where it saturates."),
    ] = None,
    command: Annotated[float, typer.Option("--command", metavar="RAD_S", help="Step of the speed command, up and down [rad/s].")] = 10.0,
    load_step: Annotated[float, typer.Option("--load-step", metavar="N_M", help="Step of the load, up and down [N m].")] = 5.0,
    until: Annotated[float, typer.Option("--until", metavar="S", help="Length of each run [s]; the load steps at half of it.")] = 10.0,
    noise: Annotated[float, typer.Option("--noise", metavar="RAD_S", help="Standard deviation of the speed's noise [rad/s].")] = 0.3,
    jitter: Annotated[
        float, typer.Option("--jitter", metavar="S", help="Standard deviation of each sample's shift [s; rad with --crank-angle].")
    ] = 1e-4,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of noise and jitter.")] = 0,
    spread: Annotated[
        float, typer.Option("--spread", metavar="SHARE", help="Share by which inertia, delays, volume and torque are changed, one by one.")
    ] = 0.1,
    max_overshoot: Annotated[float, typer.Option("--max-overshoot", metavar="SHARE", help="Largest overshoot, of the command.")] = 0.3,
    max_settling: Annotated[float, typer.Option("--max-settling", metavar="S", help="Longest settling time after either step [s].")] = 3.0,
    max_droop: Annotated[
        float | None, typer.Option("--max-droop", metavar="RAD_S", help="Largest deviation after the load's step [rad/s]; else any.")
    ] = None,
    min_reserve: Annotated[float, typer.Option("--min-reserve", metavar="DB", help="Least distance of the gains from hunting [dB].")] = 3.0,
    run_unstable: Annotated[
        bool, typer.Option("--run-unstable", help="Also run where the linear loop is unstable; else it fails there without a run.")
    ] = False,
    workers: Annotated[int, typer.Option("--workers", min=1, max=64, help="Threads; results do not depend on them.")] = 2,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Put a controller through a battery of runs on the nonlinear engine, sampled and limited as an engine computer runs it.

    At each trim: steps of command and load as they are, with noise and jitter, and on engines whose parameters differ; then all gains are
    raised until the loop hunts. The verdict names what was not kept. A verdict of failure is a result: the exit status is 0.
    """
    from revline.design.acceptance import Battery, OfUnstable, Requirements, accept
    from revline.design.sampled_loop import Disturbance
    from revline.engine.spread import spread_engine
    from revline.io.acceptance_records import acceptance_record
    from revline.io.engine_files import load_engine
    from revline.io.json_files import format_json
    from revline.io.number_lists import parse_numbers

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "acceptance")
    wish = Requirements(overshoot=max_overshoot, settling_time=max_settling, gain_reserve_db=min_reserve)
    battery = Battery(
        command=command,
        load=load_step,
        until=until,
        disturbance=Disturbance(noise=noise, jitter=jitter, seed=seed),
        requirements=wish if max_droop is None else replace(wish, droop=max_droop),
        of_unstable=OfUnstable.RUN if run_unstable else OfUnstable.SKIP,
    )
    plant = load_engine(engine)
    judged = _controller(controller, plant, (period, crank_angle, computation_delay), (low, high))
    places = [
        {"throttle": angle, "load_torque": torque}
        for torque, angle in product(parse_numbers(load, "--load [N m]"), parse_numbers(throttle, "--throttle [deg]"))
    ]
    plants = {plant.name: plant, **spread_engine(plant, spread)}
    with shell.progress("acceptance") as progress:
        found = accept(plants, judged, places, battery, workers=workers, progress=progress)
    record = acceptance_record(found, engine=plant.name, provenance={"program": f"revline {__version__}", "controller": controller.name})
    shell.write(out, format_json(record), "acceptance")
    shell.warn(*(loop.verdict for loop in found.linear if loop.verdict))
    shell.show(record, *_parts(found), text_on=out)


def _controller(
    path: Path,
    plant: "DelaySystem",
    timing: tuple[float | None, float | None, float],
    limits: tuple[float | None, float | None],
) -> "PidController":
    """The file's controller, sampled and within the throttle's limits."""
    from revline.design.pid_controller import AntiWindup, Continuous
    from revline.engine.lee1995 import lee1995_parameters
    from revline.io.controller_files import read_controller
    from revline.sampled import CrankSynchronous, FixedRate

    found = read_controller(path).controller
    period, angle, computation = timing
    if period is not None and angle is not None:
        message = "--period and --crank-angle each say when the controller samples; give one"
        raise InvalidInputError(message)
    if isinstance(found.sampling, Continuous):
        sampling = (
            CrankSynchronous(angle=angle, computation_delay=computation)
            if angle is not None
            else FixedRate(period=PERIOD if period is None else period, computation_delay=computation)
        )
        windup = AntiWindup.CLAMPING if found.anti_windup is AntiWindup.NONE else found.anti_windup
        found = replace(found, sampling=sampling, anti_windup=windup)
    elif period is not None or angle is not None or computation != 0.0:
        message = f"{path.name} says itself when its controller samples; leave --period, --crank-angle and --computation-delay out"
        raise InvalidInputError(message)
    own = tuple(bound if abs(bound) != float("inf") else None for bound in (found.low, found.high))
    wanted = tuple(option if option is not None else bound for option, bound in zip(limits, own, strict=True))
    bounds = throttle_limits((wanted[0], wanted[1]), lee1995_parameters(plant).throttle.saturation_angle)
    return replace(found, low=bounds[0], high=bounds[1])


def _parts(found: "Acceptance") -> list[Facts | Grid | str]:
    rows = [
        ("verdict", "passed" if found.passed else "failed", ""),
        ("runs", float(len(found.runs)), ""),
        ("runs that kept everything", float(sum(run.passed for run in found.runs)), ""),
    ]
    if found.reserves:
        rows.append(("least gain reserve", found.gain_reserve_db, "dB"))
    reserves = {tuple(r.place.items()): r for r in found.reserves}
    table = [
        (
            *(f"{value:g}" for value in loop.place.values()),
            f"{loop.margins.margins.sensitivity.value:.3f}" if loop.margins.margins.stable else "unstable",
            f"{reserves[key].decibels:.2f}" if (key := tuple(loop.place.items())) in reserves else "not run",
            *_worst(found, loop.place),
        )
        for loop in found.linear
    ]
    heads = ("throttle [deg]", "load [N m]", "Ms", "reserve [dB]", "overshoot", "settling [s]", "droop [rad/s]", "travel [deg]")
    reasons = [f"- {reason}" for reason in found.reasons[:SHOWN]]
    if len(found.reasons) > SHOWN:
        reasons.append(f"- and {len(found.reasons) - SHOWN} more; --json lists all")
    return [Facts(f"Acceptance of {found.controller.gains.rule}", rows), Grid("Worst of all runs", heads, table), *reasons]


SHOWN = 12
"""So many reasons are shown."""


def _worst(found: "Acceptance", place: object) -> tuple[str, str, str, str]:
    """Largest measures of the runs at a place."""
    runs = [run.measures for run in found.runs if run.case.place == place and run.measures is not None]
    if not runs:
        return ("", "", "", "")
    settling = max(max(m.command_settling_time, m.load_settling_time) for m in runs)
    return (
        f"{max(m.overshoot for m in runs):.3f}",
        f"{settling:.2f}" if settling < float("inf") else "never",
        f"{max(m.droop for m in runs):.2f}",
        f"{max(m.travel for m in runs):.1f}",
    )
