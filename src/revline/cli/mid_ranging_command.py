"""The command mid-ranging: speed by spark and throttle after a step of the load, beside the throttle alone."""

from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption
from revline.cli.plots import PlotOption, check_plot, write_plot
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import out_of_range
from revline.studies.loop_runs import throttle_limits

if TYPE_CHECKING:
    from revline.design.two_inputs.mid_ranging_comparison import MidRangingComparison, PlantCase
    from revline.system import DelaySystem

RUNS = (
    "plant",
    "controller",
    "worst droop [rad/s]",
    "IAE [rad]",
    "settled [s]",
    "spark travel [deg]",
    "spark back [s]",
    "reserve used [%]",
    "at the spark's limit [%]",
)


StepOption = Annotated[float, typer.Option("--load-step", metavar="N_M", help="Step of the load torque at time 0 [N m].")]
SparkOption = Annotated[
    float | None,
    typer.Option("--spark", metavar="DEG", help="Set-point of the spark [deg from best torque]; else the engine's nominal one."),
]
LowOption = Annotated[
    float | None,
    typer.Option("--spark-low", metavar="DEG", help="Lower limit of the spark [deg from best torque]; else as far from --spark as 0 is."),
]
HighOption = Annotated[
    float | None,
    typer.Option("--spark-high", metavar="DEG", help="Upper limit of the spark [deg from best torque]; else as far from --spark as 0 is."),
]
MsOption = Annotated[float, typer.Option("--ms", metavar="MS", help="Largest peak sensitivity of every loop, above 1 up to 3.")]
ShareOption = Annotated[
    float, typer.Option("--fast-share", metavar="SHARE", help="Part of Ms - 1 that the spark loop takes by itself, above 0 and below 1.")
]
SeparationOption = Annotated[float, typer.Option("--separation", metavar="FACTOR", help="Least ratio of the two crossovers.")]
SpreadOption = Annotated[
    float, typer.Option("--lag-spread", metavar="PERCENT", help="Also run with all lags this much shorter and longer; 0: not.")
]


def mid_ranging(
    *,
    throttle: ThrottleOption,
    load_step: StepOption,
    load: LoadOption = 0.0,
    spark: SparkOption = None,
    spark_low: LowOption = None,
    spark_high: HighOption = None,
    ms: MsOption = 2.0,
    fast_share: ShareOption = 0.5,
    separation: SeparationOption = 3.0,
    lag_spread: SpreadOption = 20.0,
    until: Annotated[float, typer.Option("--until", metavar="S", help="Stop time [s].")] = 20.0,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    plot: PlotOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Hold the speed against a load by spark at once and by throttle for good, beside the throttle alone of the same Ms.

    The spark acts on the speed, and the throttle brings the spark back to its set-point: mid-ranging, or valve-position control. Both
    loops are designed with every delay exact, then run on the nonlinear engine with its limits.
    """
    from revline.design.two_inputs.load_steps import LoadStep
    from revline.design.two_inputs.mid_ranging import MidRangingBounds, design_mid_ranging
    from revline.design.two_inputs.mid_ranging_comparison import OutputLimits, compare_mid_ranging
    from revline.engine.lee1995 import lee1995_parameters
    from revline.io.engine_files import load_engine
    from revline.io.mid_ranging_records import mid_ranging_csv, mid_ranging_record

    shell = Shell(json=json, quiet=quiet)
    check_plot(plot)
    shell.prepare_each((out, "load steps"), (plot, "figure"))
    if not 0.0 <= lag_spread < 100.0:
        raise out_of_range("--lag-spread", lag_spread, "%", "0 to below 100 %", "give one such as 20")
    system = load_engine(engine)
    task, bounds = LoadStep(size=load_step, until=until), MidRangingBounds(ms=ms, fast_share=fast_share, separation=separation)
    inputs = {"throttle": throttle, "load_torque": load} | ({} if spark is None else {"spark": spark})
    low, high = throttle_limits((None, None), lee1995_parameters(system).throttle.saturation_angle)
    plants = _plants(system, inputs, lag_spread)
    with shell.busy("designing both loops"):
        design = design_mid_ranging(system, plants[0].trim, bounds=bounds)
    with shell.progress("steps of the load; the first run of all compiles the loop") as progress:
        found = compare_mid_ranging(design, plants, task, limits=OutputLimits(spark_low, spark_high, low, high), progress=progress)
    shell.warn(*found.all_warnings())
    shell.write(out, mid_ranging_csv(found) if out else "", "load steps")
    if plot is not None:
        from revline.report.mid_ranging import plot_load_steps

        write_plot(plot, plot_load_steps(found.own.runs), "mid-ranging")
    title = f"Mid-ranging on {system.name} at {throttle:g} deg, {load:g} N m, spark {design.reserve.rest:g} deg"
    shell.show(mid_ranging_record(found), *_parts(found, title), text_on=out)


def _parts(found: "MidRangingComparison", title: str) -> list[Facts | Grid | str]:
    from revline.io.mid_ranging_records import describe_design, describe_margins_of, describe_runs

    margins = found.own.margins
    return [
        Facts(title, describe_design(found)),
        Grid("Margins, delays exact", ("loop broken at", "Ms", "gain margin [dB]", "delay margin [ms]"), describe_margins_of(margins)),
        f"both inputs at once, each by itself: disk margin {margins.disk.margin:.4g} at {margins.disk.frequency:.4g} rad/s",
        Grid(f"Load step of {found.task.size:g} N m on the nonlinear engine", RUNS, describe_runs(found)),
    ]


def _plants(system: "DelaySystem", inputs: dict[str, float], spread: float) -> "list[PlantCase]":
    """The engine, and where asked for the same with shorter and with longer lags, each with its trim."""
    from revline.analysis.trim import find_trim
    from revline.design.two_inputs.mid_ranging_comparison import PlantCase
    from revline.engine.lee1995 import lee1995, lee1995_parameters

    parameters = lee1995_parameters(system)
    plants = [PlantCase("nominal", system, find_trim(system, inputs=inputs))]
    for sign in (-1.0, 1.0) if spread > 0.0 else ():
        factor = 1.0 + sign * spread / 100.0
        delays = type(parameters.delays)(*(factor * angle for angle in parameters.delays))
        other = lee1995(parameters._replace(delays=delays))
        plants.append(PlantCase(f"lags {sign * spread:+g} %", other, find_trim(other, inputs=inputs)))
    return plants
