"""The command simulate: an engine in time, from its trim, under an input; resumable."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, QuietOption
from revline.cli.shell import Facts, Shell
from revline.errors import AnalysisError, InvalidInputError, StoppedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from revline.cli.interruption import Interruption
    from revline.dde.trajectory import Trajectory
    from revline.io.run_files import RunOrigin
    from revline.signals import Signal
    from revline.system import DelaySystem

INTERVAL = 1e-3
"""Time between samples where no step is given, in seconds; the step is a part of it."""

FIXED = ("throttle", "load", "signal", "step", "tolerance", "every", "engine")
"""Parameters that a continued run brings along."""

StepOption = Annotated[
    float | None,
    typer.Option(
        "--step",
        metavar="S",
        help="Step of the simulation [s], shorter than every lag. Left out, it is halved until two runs agree within --tolerance.",
        show_default=False,
    ),
]
ToleranceOption = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        metavar="PART",
        help="Largest difference to the run with twice the step, as a part of each state's range; 1e-6 where neither is given.",
        show_default=False,
    ),
]


class _Mesh(NamedTuple):
    """How finely a run is made and stored; without a step, it is found by halving to the tolerance."""

    step: float | None
    tolerance: float | None
    every: int


class _Found(NamedTuple):
    """A run, how far it is from that with twice the step (where that was made), and what else there is to tell."""

    run: "Trajectory"
    difference: float | None
    notes: tuple[str, ...]


def simulate(
    context: typer.Context,
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
    step: StepOption = None,
    tolerance: ToleranceOption = None,
    every: Annotated[int, typer.Option("--every", metavar="N", help="Store every n-th step; without --step, one sample each n ms.")] = 1,
    continued: Annotated[
        Path | None,
        typer.Option("--continue", metavar="FILE.csv", help="Go on from the end of this run; all but --until and --out comes from it."),
    ] = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.csv", help="File to write; one of that name is replaced.")],
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Simulate an engine from its trim under an input, fourth order in the step, with both delays.

    Beside FILE.csv lies FILE.csv.state.npz, from which --continue goes on bit for bit as if the run had not stopped.
    Ctrl-C keeps what there is: the file says that it is partial, and --continue goes on from it.
    """
    from revline.io.run_files import RunOrigin, check_place

    shell = Shell(json=json, quiet=quiet)
    check_place(out, continued)
    shell.prepare(out, "run")
    if continued is None:
        origin = RunOrigin(engine=engine, throttle=throttle, load=load, input=signal, folder=str(Path.cwd()))
        with _watched(shell, out, origin) as told:
            found = _begin(origin, until, _Mesh(step, tolerance, every), told)
    else:
        _refuse_fixed(context)
        origin, found = _go_on(shell, out, continued, until)
    shell.warn(*found.run.notes, *found.notes, *_note_of_end(found.run))
    _write(shell, out, found, origin)
    _show(shell, found, origin, out)


def _refuse_fixed(context: typer.Context) -> None:
    """Refuse options that the continued run brings along, so that none is silently left aside."""
    given = [name for name in FIXED if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE"]
    if given:
        options = ", ".join("--input" if name == "signal" else f"--{name}" for name in given)
        message = f"{options} cannot be given with --continue: a run goes on as it was begun; leave it out, or begin a new run"
        raise InvalidInputError(message)


class _Told(NamedTuple):
    """What a run reports to, and asks whether to stop."""

    progress: "Callable[[float], None]"
    interruption: "Interruption"

    def tell(self, done: float) -> None:
        """Pass progress on; from the first word on there is something to keep."""
        self.interruption.begin()
        self.progress(done)


@contextlib.contextmanager
def _watched(shell: Shell, out: Path, origin: "RunOrigin") -> "Iterator[_Told]":
    """Show progress; where Ctrl-C stops the run, write what there is and end with the reason."""
    from revline.cli.interruption import interruptible

    try:
        with (
            shell.progress("simulating") as progress,
            interruptible() as interruption,
        ):
            yield _Told(progress, interruption)
    except StoppedError as stop:
        run: Trajectory = stop.run  # type: ignore[assignment]  # the simulation's own
        _write(shell, out, _Found(run, None, ()), origin, partial=f"interrupted at {run.checkpoint.time:.6g} s")
        kept = f"{out} holds the {len(run.times)} samples until then and says that it is partial"
        message = f"interrupted: {stop}; {kept}; `revline simulate --continue {out}` goes on from there"
        raise AnalysisError(message, **stop.details) from stop


def _write(shell: Shell, out: Path, found: _Found, origin: "RunOrigin", *, partial: str = "") -> None:
    from revline.io.run_files import drop_run_state, format_run, write_run_state

    notes: dict[str, str | float] = {} if found.difference is None else {"difference_to_twice_the_step": found.difference}
    if partial:
        notes["partial"] = partial
    drop_run_state(out)  # an older run's, which must not be taken for this one's
    with shell.busy(f"writing {out}"):
        shell.write(out, format_run(found.run, origin, notes), "run")
    write_run_state(out, found.run, origin)


def _note_of_end(run: "Trajectory") -> tuple[str, ...]:
    """Say where the end of a run is no sample."""
    stop, every = run.checkpoint.time, run.checkpoint.every
    if len(run.times) and run.times[-1] == stop:
        return ()
    last = f"the last sample is at {run.times[-1]:.12g} s" if len(run.times) else "no sample was stored"
    return (f"the run stops at {stop:.12g} s, and {last}: each {every}. step is stored",)


def _show(shell: Shell, found: _Found, origin: "RunOrigin", out: Path) -> None:
    run = found.run
    end = dict(zip(run.state_names, run.end, strict=True))
    speed, pressure = end["engine_speed"], end["manifold_pressure"]
    times = run.times.tolist()
    record: dict[str, object] = {
        "engine": origin.engine,
        "throttle_deg": origin.throttle,
        "load_n_m": origin.load,
        "input": origin.input,
        "step_s": run.step,
        "samples": len(times),
        **({"from_s": times[0]} if times else {}),
        "to_s": run.checkpoint.time,
        "speed_rad_s": speed,
        "pressure_kpa": pressure,
        "file": str(out),
    }
    facts: list[tuple[str, float | str, str]] = [("samples", f"{len(times)}", "")]
    if times:
        facts.append(("from", times[0], "s"))
    facts += [("to", run.checkpoint.time, "s"), ("step", run.step, "s")]
    if found.difference is not None:
        record["difference_to_twice_the_step"] = found.difference
        facts.append(("difference to twice the step", f"{found.difference:.1e}", "of each state's range"))
    facts += [("engine speed at the end", speed, "rad/s"), ("manifold pressure at the end", pressure, "kPa")]
    shell.show(record, Facts(f"{origin.engine} from {origin.throttle:g} deg", facts), text_on=out)


def _begin(origin: "RunOrigin", until: float, mesh: _Mesh, told: _Told) -> _Found:
    from revline.analysis.trim import find_trim
    from revline.dde.simulate import Options, Start
    from revline.dde.simulate import simulate as run
    from revline.dde.tolerance import DEFAULT_TOLERANCE, simulate_to_tolerance
    from revline.io.run_files import check_samples

    if mesh.step is not None and mesh.tolerance is not None:
        message = "--step fixes the step, and --tolerance has it found; give one of them"
        raise InvalidInputError(message)
    system, signals, notes = _read(origin, (0.0, until))
    options = Options(every=mesh.every, progress=told.tell, stopped=told.interruption.wished)
    check_samples(until, INTERVAL if mesh.step is None else mesh.step, mesh.every)
    trim = find_trim(system, inputs={"throttle": origin.throttle, "load_torque": origin.load})
    if not trim.stable:
        notes += (f"the trim at {origin.throttle:g} deg is unstable: a run leaves it by rounding alone, and amplifies every error",)
    start = Start(states=trim.states, inputs=trim.inputs)
    if mesh.step is not None:
        return _Found(run(system, start, signals, until=until, step=mesh.step, options=options), None, notes)
    accuracy = DEFAULT_TOLERANCE if mesh.tolerance is None else mesh.tolerance
    found = simulate_to_tolerance(system, start, signals, until=until, interval=INTERVAL, tolerance=accuracy, options=options)
    return _Found(found.trajectory, found.difference, notes)


def _go_on(shell: Shell, out: Path, continued: Path, until: float) -> "tuple[RunOrigin, _Found]":
    from revline.dde.simulate import Options, resume
    from revline.io.run_files import check_samples, read_run_state

    saved = read_run_state(continued)
    checkpoint = saved.checkpoint
    system, signals, notes = _read(saved.origin, (checkpoint.time, until))
    check_samples(until - checkpoint.time, checkpoint.step, checkpoint.every)
    with _watched(shell, out, saved.origin) as told:
        options = Options(every=checkpoint.every, method=checkpoint.method, progress=told.tell, stopped=told.interruption.wished)
        return saved.origin, _Found(resume(system, signals, checkpoint, until=until, options=options), None, notes)


def _read(origin: "RunOrigin", span: tuple[float, float]) -> "tuple[DelaySystem, Mapping[str, Signal], tuple[str, ...]]":
    """Read the engine and the inputs of a run, from where it was begun, and what there is to say of recordings."""
    from revline.engine.catalogue import engine_names
    from revline.io.engine_files import load_engine
    from revline.io.input_text import parse_input
    from revline.io.recorded_files import recording_notes

    folder = Path(origin.folder)
    here = folder == Path.cwd()
    system = load_engine(origin.engine if here or origin.engine in engine_names() else folder / origin.engine)
    given = {"throttle": origin.throttle, "load_torque": origin.load}
    base = {v.name: given.get(v.name, v.nominal) for v in system.inputs}
    signals = parse_input(origin.input, system, base, folder=Path() if here else folder) if origin.input else {}
    return system, signals, recording_notes(signals, system, base, span)
