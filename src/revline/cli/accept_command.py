"""The command accept: a controller on the nonlinear, sampled, saturated, noisy engine, with a verdict."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline import __version__
from revline.cli.controllers import HighOption, LowOption, SetpointWeightOption, read_any_controller, surrounded
from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, OutOption, QuietOption
from revline.cli.plots import PlotOption, check_plot, write_plot
from revline.cli.shell import Facts, Grid, Shell
from revline.studies.loop_runs import TimingChoice

if TYPE_CHECKING:
    from revline.design.controllers.scheduled_pid import AnyController
    from revline.design.trials.acceptance import Acceptance, Battery
    from revline.design.trials.acceptance_summary import PlaceSummary
    from revline.system import DelaySystem


TIMER_JITTER, CRANK_JITTER = 1e-4, 0.005
"""Standard deviation of a sample's shift: of a timer in s; of the crank as a part of the angle between samples."""

ControllerArgument = Annotated[Path, typer.Argument(metavar="CONTROLLER.json", help="Controller file, or a gain map with a schedule.")]
ThrottleListOption = Annotated[str, typer.Option("--throttle", metavar="A1,A2,..", help="Throttle angles of the trims [deg].")]
LoadListOption = Annotated[str, typer.Option("--load", metavar="T1,T2,..", help="Load torques of the trims [N m]; each with each angle.")]
PeriodOption = Annotated[
    float | None, typer.Option("--period", metavar="S", help="Sampling period [s], where the file names none; 0.005 by default.")
]
CrankAngleOption = Annotated[
    float | None, typer.Option("--crank-angle", metavar="RAD", help="Sample each so many radians of the crank instead [rad].")
]
ComputationDelayOption = Annotated[
    float, typer.Option("--computation-delay", metavar="S", help="Time from a sample to its output [s], with the two above.")
]
CommandOption = Annotated[float, typer.Option("--command", metavar="RAD_S", help="Step of the speed command, up and down [rad/s].")]
LoadStepOption = Annotated[float, typer.Option("--load-step", metavar="N_M", help="Step of the load, up and down [N m].")]
UntilOption = Annotated[float, typer.Option("--until", metavar="S", help="Length of each run [s]; the load steps at half of it.")]
NoiseOption = Annotated[float, typer.Option("--noise", metavar="RAD_S", help="Standard deviation of the speed's noise [rad/s].")]
JitterOption = Annotated[
    float | None,
    typer.Option(
        "--jitter",
        metavar="S",
        help="Standard deviation of each sample's shift [s; rad by the crank's angle]; else 1e-4 s or 0.5 % of the angle.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of noise and jitter.")]
SpreadOption = Annotated[
    float, typer.Option("--spread", metavar="SHARE", help="Share by which inertia, delays, volume and torque are changed, one by one.")
]
MaxOvershootOption = Annotated[float, typer.Option("--max-overshoot", metavar="SHARE", help="Largest overshoot, of the command.")]
MaxSettlingOption = Annotated[float, typer.Option("--max-settling", metavar="S", help="Longest settling time after either step [s].")]
MaxDroopOption = Annotated[
    float | None, typer.Option("--max-droop", metavar="RAD_S", help="Largest deviation after the load's step [rad/s]; else any.")
]
MinReserveOption = Annotated[float, typer.Option("--min-reserve", metavar="DB", help="Least distance of the gains from hunting [dB].")]
RunUnstableOption = Annotated[
    bool, typer.Option("--run-unstable", help="Also run where the linear loop is unstable; else it fails there without a run.")
]
WorkersOption = Annotated[int, typer.Option("--workers", min=1, max=64, help="Threads; results do not depend on them.")]


def accept(
    *,
    controller: ControllerArgument,
    throttle: ThrottleListOption,
    load: LoadListOption = "0",
    period: PeriodOption = None,
    crank_angle: CrankAngleOption = None,
    computation_delay: ComputationDelayOption = 0.0,
    setpoint_weight: SetpointWeightOption = None,
    low: LowOption = None,
    high: HighOption = None,
    command: CommandOption = 10.0,
    load_step: LoadStepOption = 5.0,
    until: UntilOption = 10.0,
    noise: NoiseOption = 0.3,
    jitter: JitterOption = None,
    seed: SeedOption = 0,
    spread: SpreadOption = 0.1,
    max_overshoot: MaxOvershootOption = 0.3,
    max_settling: MaxSettlingOption = 3.0,
    max_droop: MaxDroopOption = None,
    min_reserve: MinReserveOption = 3.0,
    run_unstable: RunUnstableOption = False,
    workers: WorkersOption = 2,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    plot: PlotOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Put a controller through a battery of runs on the nonlinear engine, sampled and limited as an engine computer runs it.

    At each trim: steps of command and load as they are, with noise and jitter, and on engines whose parameters differ; then all gains are
    raised until the loop hunts. The verdict names what was not kept. A verdict of failure is a result: the exit status is 0.
    """
    from revline.design.trials.acceptance import accept
    from revline.engine.spread import spread_engine
    from revline.io.acceptance_records import acceptance_record
    from revline.io.engine_files import load_engine
    from revline.io.json_files import format_json

    shell = Shell(json=json, quiet=quiet)
    shell.prepare_each((out, "acceptance"), (check_plot(plot), "figure"))
    plant = load_engine(engine)
    judged = _controller(controller, plant, (period, crank_angle, computation_delay), (low, high), setpoint_weight)
    shifts = _default_jitter(judged) if jitter is None else jitter
    battery = _battery((command, load_step, until), (noise, shifts, seed), (max_overshoot, max_settling, max_droop, min_reserve))
    asked = _with_unstable(battery) if run_unstable else battery
    plants = {plant.name: plant, **spread_engine(plant, spread)}
    with shell.progress("acceptance") as progress:
        found = accept(plants, judged, _places(throttle, load), asked, workers=workers, progress=progress)
    record = acceptance_record(found, engine=plant.name, provenance={"program": f"revline {__version__}", "controller": controller.name})
    shell.write(out, format_json(record), "acceptance")
    _draw(plot, found)
    shell.warn(*(text for loop in found.linear for text in (loop.verdict, loop.warning) if text))
    shell.show(record, *_parts(found), text_on=out)


def _draw(plot: Path | None, found: "Acceptance") -> None:
    if plot is None:
        return
    from revline.design.trials.acceptance_summary import summarise_acceptance
    from revline.report.acceptance import plot_acceptance

    write_plot(plot, plot_acceptance(summarise_acceptance(found)), "accept")


def _battery(
    steps: tuple[float, float, float], disturbance: tuple[float, float, int], wishes: tuple[float, float, float | None, float]
) -> "Battery":
    from revline.design.loops.sampled_loop import Disturbance
    from revline.design.trials.acceptance import Battery, Requirements

    wish = Requirements(overshoot=wishes[0], settling_time=wishes[1], gain_reserve_db=wishes[3])
    return Battery(
        command=steps[0],
        load=steps[1],
        until=steps[2],
        disturbance=Disturbance(noise=disturbance[0], jitter=disturbance[1], seed=disturbance[2]),
        requirements=wish if wishes[2] is None else replace(wish, droop=wishes[2]),
    )


def _default_jitter(controller: "AnyController") -> float:
    """Shift of samples: of a timer in s, of the crank in rad."""
    from revline.design.controllers.scheduled_pid import law_of
    from revline.sampled import CrankSynchronous

    sampling = law_of(controller).sampling
    return CRANK_JITTER * sampling.angle if isinstance(sampling, CrankSynchronous) else TIMER_JITTER


def _with_unstable(battery: "Battery") -> "Battery":
    from revline.design.trials.acceptance import OfUnstable

    return replace(battery, of_unstable=OfUnstable.RUN)


def _places(throttle: str, load: str) -> list[dict[str, float]]:
    """Each throttle angle with each load."""
    from revline.io.number_lists import parse_numbers

    angles, torques = parse_numbers(throttle, "--throttle [deg]"), parse_numbers(load, "--load [N m]")
    return [{"throttle": angle, "load_torque": torque} for torque, angle in product(torques, angles)]


def _controller(
    path: Path,
    plant: "DelaySystem",
    timing: tuple[float | None, float | None, float],
    limits: tuple[float | None, float | None],
    weight: float | None,
) -> "AnyController":
    """The file's controller, sampled and within the throttle's limits."""
    from revline.engine.lee1995 import lee1995_parameters

    found = read_any_controller(path, TimingChoice(*timing))
    return surrounded(found, weight=weight, limits=limits, saturation=lee1995_parameters(plant).throttle.saturation_angle)


def _parts(found: "Acceptance") -> list[Facts | Grid | str]:
    from revline.design.trials.acceptance_summary import summarise_acceptance

    short = summarise_acceptance(found)
    rows: list[tuple[str, float | str, str]] = [
        ("verdict", "passed" if short.passed else "failed", ""),
        ("runs", float(short.runs), ""),
        ("runs that kept everything", float(short.kept), ""),
    ]
    if found.reserves:
        rows.append(("least gain reserve", found.gain_reserve_db, "dB"))
    heads = ("throttle [deg]", "load [N m]", "Ms", "reserve [dB]", "overshoot", "settling [s]", "droop [rad/s]", "travel [deg]")
    reasons = [f"- {reason}" for reason in found.reasons[:SHOWN]]
    if len(found.reasons) > SHOWN:
        reasons.append(f"- and {len(found.reasons) - SHOWN} more; --json lists all")
    table = [_row(place) for place in short.places]
    return [Facts(f"Acceptance of {short.controller}", rows), Grid("Worst of all runs", heads, table), *reasons]


SHOWN = 12
"""So many reasons are shown."""


def _row(place: "PlaceSummary") -> tuple[str, ...]:
    """A place, and the largest measures of its runs."""
    head = (
        *(f"{value:g}" for _, value in place.place),
        f"{place.ms[0]:.3f}" if place.ms else "unstable",
        f"{place.reserve_db[0]:.2f}" if place.reserve_db else "not run",
    )
    if not place.kinds:
        return (*head, "", "", "", "")
    settling = float(place.settling.max())
    return (
        *head,
        f"{place.overshoot.max():.3f}",
        f"{settling:.2f}" if settling < float("inf") else "never",
        f"{place.droop.max():.2f}",
        f"{place.travel.max():.1f}",
    )
