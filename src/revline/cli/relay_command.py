"""The command relay: the ultimate gain by a relay experiment on the engine, beside the exact one and that of a bisection."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from revline import __version__
from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption, TimeStepOption
from revline.cli.plants import EngineChoice, find_engine_trim
from revline.cli.shell import Grid, Shell

if TYPE_CHECKING:
    from revline.design.tuning.ultimate_comparison import UltimateComparison


def relay(
    *,
    throttle: ThrottleOption,
    load: LoadOption = 0.0,
    amplitude: Annotated[float, typer.Option("--amplitude", metavar="DEG", help="Amplitude of the relay about the trim [deg].")] = 1.0,
    hysteresis: Annotated[float, typer.Option("--hysteresis", metavar="RAD_S", help="Half the width of its hysteresis [rad/s].")] = 0.0,
    until: Annotated[float, typer.Option("--until", metavar="S", help="Length of the experiment [s].")] = 8.0,
    command: Annotated[float, typer.Option("--command", metavar="RAD_S", help="Step of the speed command in the bisection [rad/s].")] = 0.1,
    time_step: TimeStepOption = 1e-3,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Measure the ultimate gain and period with a relay on the nonlinear engine, and show why they are not the exact ones.

    Side by side: the exact linear model; what its own oscillation under the relay would read; the relay on the engine; and the
    proportional gain at which the engine itself begins to hunt, by bisection.
    """
    from revline.design.tuning.relay import RelayTask
    from revline.design.tuning.ultimate_comparison import compare_ultimate_points
    from revline.io.json_files import format_json
    from revline.io.ultimate_records import ultimate_record

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "ultimate points")
    system, trim = find_engine_trim(EngineChoice(engine, throttle, load), "a relay experiment needs --throttle [deg]")
    task = RelayTask(amplitude=amplitude, hysteresis=hysteresis, until=until, step=time_step)
    with shell.busy("running the relay, then the bisection"):
        found = compare_ultimate_points(system, trim, task, command=command)
    record = ultimate_record(found, engine=system.name, place=(throttle, load), provenance={"program": f"revline {__version__}"})
    shell.write(out, format_json(record), "ultimate points")
    title = f"Ultimate points of {system.name} at {throttle:g} deg, {load:g} N m"
    shell.show(
        record, Grid(title, ("way", f"gain [{found.unit}]", "period [s]", "frequency [rad/s]"), _rows(found)), *found.reasons, text_on=out
    )


def _rows(found: "UltimateComparison") -> list[tuple[str, str, str, str]]:
    return [(name, f"{gain:.4f}", f"{period:.5f}", f"{2.0 * math.pi / period:.3f}") for name, gain, period in found.ways]
