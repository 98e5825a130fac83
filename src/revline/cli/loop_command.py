"""The command loop: a closed speed loop in time, on an engine or on a linear model."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from revline.cli.loop_runs import LoopOptions, run_files
from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, TimeStepOption
from revline.cli.plants import EngineChoice
from revline.cli.shell import Facts, Shell
from revline.studies.loop_runs import LoopResult, TimingChoice, load_step_of, loop_task

FilesArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="[MODEL.json] CONTROLLER.json",
        help="Controller file, or a gain map with a schedule; before it a model file, to run that instead of an engine.",
    ),
]
TrimOption = Annotated[
    float | None,
    typer.Option("--throttle", metavar="DEG", help="Throttle angle of the trim that the loop starts from [deg]; a model needs none."),
]
StepOption = Annotated[float, typer.Option("--step", metavar="RAD_S", help="Step of the speed command at time 0 [rad/s].")]
UntilOption = Annotated[float, typer.Option("--until", metavar="S", help="Stop time [s].")]
LowOption = Annotated[
    float | None, typer.Option("--low", metavar="DEG", help="Lower limit of the throttle [deg]; else the file's, else 0 for an engine.")
]
HighOption = Annotated[
    float | None,
    typer.Option(
        "--high", metavar="DEG", help="Upper limit of the throttle [deg]; else the file's, else for an engine where it saturates."
    ),
]
LoadStepOption = Annotated[
    float | None, typer.Option("--load-step", metavar="N_M", help="Also step the load torque by so much [N m], on an engine.")
]
LoadAtOption = Annotated[
    float | None, typer.Option("--load-at", metavar="S", help="When the load steps [s]; by default at a third of the stop time.")
]
PeriodOption = Annotated[
    float | None, typer.Option("--period", metavar="S", help="Run the controller sampled, each so many seconds [s]; else as its file says.")
]
CrankAngleOption = Annotated[
    float | None, typer.Option("--crank-angle", metavar="RAD", help="Run it sampled, each so many radians of the crank [rad].")
]
ComputationDelayOption = Annotated[
    float, typer.Option("--computation-delay", metavar="S", help="Time from a sample to its output [s], with one of the two above.")
]
NoiseOption = Annotated[
    float, typer.Option("--noise", metavar="RAD_S", help="Standard deviation of the measured speed's noise [rad/s], where it is sampled.")
]
JitterOption = Annotated[
    float, typer.Option("--jitter", metavar="S", help="Standard deviation of each sample's shift [s; rad by the crank's angle].")
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of noise and jitter.")]
SamplesOption = Annotated[
    Path | None, typer.Option("--samples", metavar="FILE", help="CSV file of what the controller did at each of its samples.")
]


def loop(
    *,
    files: FilesArgument,
    throttle: TrimOption = None,
    load: LoadOption = 0.0,
    step: StepOption = 60.0,
    until: UntilOption = 20.0,
    time_step: TimeStepOption = 1e-3,
    low: LowOption = None,
    high: HighOption = None,
    load_step: LoadStepOption = None,
    load_at: LoadAtOption = None,
    period: PeriodOption = None,
    crank_angle: CrankAngleOption = None,
    computation_delay: ComputationDelayOption = 0.0,
    noise: NoiseOption = 0.0,
    jitter: JitterOption = 0.0,
    seed: SeedOption = 0,
    samples: SamplesOption = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Close the speed loop with a controller, step its command, and tell how it ends: settled, hunting, diverged or stalled.

    The controller runs as its file says, set-point weights, filter, limits, anti-windup and sampling included, or sampled by --period or
    --crank-angle: revline loop controller.json --throttle 25 --period 0.005 --noise 0.3. A gain map with a schedule runs too, each 5 ms.
    A model runs with its delay exact; with --throttle it is placed at the engine's trim, else all values are deviations from it. Where
    the linear loop at the trim is unstable, a warning names its margin.
    """
    from revline.design.loops.closed_loop import describe_outcome
    from revline.design.loops.sampled_loop import Disturbance
    from revline.io.loop_records import format_loop
    from revline.io.sampled_loop_records import format_sampled_loop, format_samples

    shell = Shell(json=json, quiet=quiet)
    shell.prepare_each((out, "closed-loop record"), (samples, "controller's samples"))
    options = LoopOptions(
        choice=EngineChoice(engine, throttle, load),
        limits=(low, high),
        timing=TimingChoice(period, crank_angle, computation_delay),
        disturbance=Disturbance(noise=noise, jitter=jitter, seed=seed),
        load=load_step_of(load_step, load_at, until),
        samples=samples,
    )
    with shell.busy("running the loop; the first run of all compiles it, which takes some seconds"):
        result = run_files(files, loop_task((step, until, time_step), options.load), options)
    found = result.sampled
    shell.warn(*result.warnings)
    shell.write(out, format_loop(result.run) if found is None else format_sampled_loop(found), "closed-loop record")
    if found is not None:
        shell.write(samples, format_samples(found), "controller's samples")
    title = f"{result.run.gains.rule} controller on {result.run.plant}"
    shell.show(result.record, Facts(title, _facts(result)), describe_outcome(result.run), text_on=out)


FACTS = (
    ("start_rad_s", "speed before the step", "rad/s"),
    ("target_rad_s", "speed commanded", "rad/s"),
    ("overshoot", "overshoot", "of the command"),
    ("settling_time_s", "settling time", "s"),
    ("bandwidth_rad_s", "bandwidth", "rad/s"),
    ("throttle_low_deg", "lowest throttle", "deg"),
    ("throttle_high_deg", "highest throttle", "deg"),
    ("sampling_period_s", "sampled each", "s at rest"),
    ("equivalent_delay_s", "equivalent delay", "s"),
)
"""Fields of a record that people are shown: name, words, unit."""

FURTHER = (
    ("windup", "largest_deg", "most wanted beyond a limit", "deg"),
    ("load_step", "droop_rad_s", "droop after the load's step", "rad/s"),
    ("load_step", "settling_time_s", "settling time after it", "s"),
    ("disturbed", "deviation_rms_rad_s", "noise and jitter move the speed by", "rad/s rms"),
    ("linear_loop", "gain_margin", "gain may rise by", "times, of the linear loop"),
)
"""The same of fields within a field."""


def _facts(result: LoopResult) -> list[tuple[str, float | str, str]]:
    """What a record says of a closed loop, for people."""
    record = result.record
    rows: list[tuple[str, float | str, str]] = [("stable", "yes" if record["stable"] else "no", "")]
    rows += [(text, value, unit) for key, text, unit in FACTS if isinstance(value := record.get(key), float)]
    for field, key, text, unit in FURTHER:
        inner = record.get(field)
        value = inner.get(key) if isinstance(inner, Mapping) else None
        if isinstance(value, float) and value != 0.0:
            rows.append((text, value, unit))
    return rows
