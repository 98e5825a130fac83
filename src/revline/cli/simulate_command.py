"""The command simulate: an engine in time, from its trim, under an input; resumable."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, QuietOption
from revline.cli.shell import Facts, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from revline.dde.trajectory import Checkpoint, Trajectory
    from revline.io.run_files import RunOrigin

STEP = 1e-3


def simulate(
    *,
    throttle: Annotated[float, typer.Option("--throttle", metavar="DEG", help="Throttle angle of the trim [deg], 0 to 90.")] = 25.0,
    load: LoadOption = 0.0,
    signal: Annotated[
        str,
        typer.Option(
            "--input",
            metavar="SPEC",
            help="Input beside the trim: step:5@0.5, ramp:5@0.5/0.2, sine:5@10, trapezoids:5/2, sinecycle:5/2, pulses:5/2, "
            "file:drive.csv; sums with +; another input as load_torque=step:10@1.",
        ),
    ] = "",
    until: Annotated[float, typer.Option("--until", metavar="S", help="Stop time [s].")] = 10.0,
    step: Annotated[float, typer.Option("--step", metavar="S", help="Step of the simulation [s], shorter than every lag.")] = STEP,
    every: Annotated[int, typer.Option("--every", metavar="N", help="Store every n-th step.")] = 1,
    continued: Annotated[
        Path | None, typer.Option("--continue", metavar="FILE.csv", help="Go on from the end of this run; all but --until comes from it.")
    ] = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.csv", help="File to write; one of that name is replaced.")],
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Simulate an engine from its trim under an input, fourth order in the step, with both delays.

    Beside FILE.csv lies FILE.csv.state.npz, from which --continue goes on bit for bit as if the run had not stopped.
    """
    from revline.io.run_files import RunOrigin, format_run, read_run_state, write_run_state

    shell = Shell(json=json, quiet=quiet)
    if str(out) == "-":
        message = "a run has two files, its samples and its state; name a file after --out"
        raise InvalidInputError(message)
    shell.prepare(out, "run")
    with shell.progress("simulating; the first run of all compiles, which takes some seconds") as told:
        if continued is None:
            origin = RunOrigin(engine=engine, throttle=throttle, load=load, input=signal)
            run = _begin(origin, until, (step, every), told)
        else:
            saved = read_run_state(continued)
            origin = saved.origin
            run = _go_on(origin, saved.checkpoint, until, told)
    shell.warn(*run.notes)
    shell.write(out, format_run(run, origin), "run")
    write_run_state(out, run, origin)
    _show(shell, run, origin, out)


def _show(shell: Shell, run: "Trajectory", origin: "RunOrigin", out: Path) -> None:
    speed, pressure = float(run.output("engine_speed")[-1]), float(run.output("manifold_pressure")[-1])
    record = {
        "engine": origin.engine,
        "throttle_deg": origin.throttle,
        "load_n_m": origin.load,
        "input": origin.input,
        "step_s": run.step,
        "samples": len(run.times),
        "from_s": float(run.times[0]),
        "to_s": float(run.times[-1]),
        "speed_rad_s": speed,
        "pressure_kpa": pressure,
        "file": str(out),
    }
    facts = (
        ("samples", f"{len(run.times)}", ""),
        ("from", float(run.times[0]), "s"),
        ("to", float(run.times[-1]), "s"),
        ("engine speed at the end", speed, "rad/s"),
        ("manifold pressure at the end", pressure, "kPa"),
    )
    shell.show(record, Facts(f"{origin.engine} from {origin.throttle:g} deg", facts), text_on=out)


def _begin(origin: "RunOrigin", until: float, mesh: tuple[float, int], told: "Callable[[float], None]") -> "Trajectory":
    from revline.analysis.trim import find_trim
    from revline.dde.simulate import Options, Start
    from revline.dde.simulate import simulate as run
    from revline.io.engine_files import load_engine
    from revline.io.input_text import parse_input

    system = load_engine(origin.engine)
    trim = find_trim(system, inputs={"throttle": origin.throttle, "load_torque": origin.load})
    base = {v.name: float(value) for v, value in zip(system.inputs, trim.inputs, strict=True)}
    signals = parse_input(origin.input, system, base) if origin.input else {}
    options = Options(every=mesh[1], progress=told)
    return run(system, Start(states=trim.states, inputs=trim.inputs), signals, until=until, step=mesh[0], options=options)


def _go_on(origin: "RunOrigin", checkpoint: "Checkpoint", until: float, told: "Callable[[float], None]") -> "Trajectory":
    from dataclasses import replace

    from revline.dde.simulate import Options, resume
    from revline.io.engine_files import load_engine
    from revline.io.input_text import parse_input

    system = load_engine(origin.engine)
    given = {"throttle": origin.throttle, "load_torque": origin.load}
    base = {v.name: given.get(v.name, v.nominal) for v in system.inputs}
    signals = parse_input(origin.input, system, base) if origin.input else {}
    options = replace(Options(every=checkpoint.every, method=checkpoint.method), progress=told)
    return resume(system, signals, checkpoint, until=until, options=options)
