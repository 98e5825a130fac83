"""Simulation of a delay system: from a start and input signals to samples, resumable, with clear errors.

Source of the procedure: Lee (1995), chapter 3; of the numerics: `revline.dde.kernel`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from revline.dde import run as runs
from revline.dde.events import ROUNDING, TOLERANCE
from revline.dde.failures import explain
from revline.dde.inputs import check_resolved, tabulate_signals
from revline.dde.kernel import STANDARD, Method, build_kernel
from revline.dde.memory import as_floats, attach_tables, flatten
from revline.dde.run import Floats
from revline.dde.trajectory import Checkpoint, Run, Trajectory, make_room
from revline.errors import InvalidInputError, StoppedError, out_of_range
from revline.signals import Signal
from revline.system import DelaySystem, check_range
from revline.values import fingerprint

__all__ = ("Checkpoint", "Options", "Start", "Trajectory", "resume", "simulate")

Progress = Callable[[float], None]
"""Told from time to time which part of the run is done, 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """Where a run begins: states and held inputs. Before, the channels hold what these emit.

    Attributes:
        states: shape (n_states,).
        inputs: shape (n_inputs,), held before the start and the base of the input signals after it.
        time: of the start, in seconds.
        channels: what the channels held before the start, shape (n_channels,), where it is not what states and inputs emit.
    """

    states: Floats
    inputs: Floats
    time: float = 0.0
    channels: Floats | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How a simulation is run and stored.

    Attributes:
        every: each how-manieth step is stored.
        method: what integrates.
        progress: told from time to time which part of the run is done.
        stopped: asked from time to time whether the run shall stop before its end.
        chunk: steps between two looks at progress and interruption; results do not depend on it.

    Raises:
        InvalidInputError: `every` or `chunk` is below 1.
    """

    every: int = 1
    method: Method = STANDARD
    progress: Progress | None = None
    stopped: Callable[[], bool] | None = None
    chunk: int = 200_000

    def __post_init__(self) -> None:
        for name, value, what in (("every", self.every, "store"), ("chunk", self.chunk, "look at progress")):
            if value < 1:
                raise out_of_range(name, value, "steps", "1 and above", f"{what} every n-th step with n = 1, 2, ...")


def simulate(
    system: DelaySystem,
    start: Start,
    signals: Mapping[str, Signal],
    *,
    until: float,
    step: float,
    options: Options | None = None,
) -> Trajectory:
    """Simulate a system from a start under input signals, on a fixed mesh that meets every breakpoint.

    Args:
        system: what to simulate.
        start: states and base inputs; for example `Trim.start`.
        signals: by input name, added to the base inputs.
        until: stop time in seconds; one that is no multiple of the step is moved to the next, with a note.
        step: of the mesh, in seconds; below the smallest lag.
        options: storing, method and progress.

    Returns:
        Samples at every n-th grid step, first and start included.

    Raises:
        InvalidInputError: an input leaves its range, the step is not below the smallest lag or too long for a sinusoid, the stop time is
            before the start, a parameter is no finite number.
        StalledError: a state left its range.
        StepError: a lag fell below the step.
        LagError: a lag became no positive number, or the delayed time ran backwards.
        DivergedError: a state is no finite number any more.
        StoppedError: `options.stopped` said so; the error holds the run until then.
    """
    options = options or Options()
    check_resolved(signals, step)
    as_floats(system.parameters, system.name)
    run = new_run(system, start, step, options.every)
    return _advance(system, signals, run, fingerprint(dict(signals)), until=until, options=options)


def resume(
    system: DelaySystem, signals: Mapping[str, Signal], checkpoint: Checkpoint, *, until: float, options: Options | None = None
) -> Trajectory:
    """Go on with a stopped run, bit for bit as if it had not stopped; the first sample is the one after its last.

    Args:
        system: that of the run.
        signals: those of the run.
        checkpoint: of the run.
        until: stop time in seconds, after the run's end.
        options: with the method and the storing of the run, which are also the default.

    Raises:
        InvalidInputError: system, signals or options are not those of the run, or the stop time is not after its end.
        SimulationError: as for `simulate`.
    """
    options = options or Options(every=checkpoint.every, method=checkpoint.method)
    if system.content_digest != checkpoint.system_digest:
        message = f"this run was made with another system or other parameters than {system.name} has now; start a new run"
        raise InvalidInputError(message)
    digest = fingerprint(dict(signals))
    if digest != checkpoint.signal_digest:
        message = "this run was made with other input signals; continue it with the same, or start a new run"
        raise InvalidInputError(message)
    if options.method != checkpoint.method:
        message = "this run was made with another method; continue it with the same, or start a new run"
        raise InvalidInputError(message)
    if options.every != checkpoint.every:
        message = f"this run stores each {checkpoint.every}. step; continue it with every = {checkpoint.every}, not {options.every}"
        raise InvalidInputError(message, every=checkpoint.every)
    return _advance(system, signals, checkpoint.run.copy(), digest, until=until, options=options)


def held_channels(system: DelaySystem, start: Start) -> Floats:
    """What the channels held before the start: given, or what states and inputs emit when each channel reads itself.

    Raises:
        InvalidInputError: the number given is not that of the channels, or the channels' values do not settle.
    """
    if start.channels is not None:
        if start.channels.shape != (len(system.channels),):
            message = f"{start.channels.size} channel values were given where {system.name} has {len(system.channels)} channels"
            raise InvalidInputError(message)
        return np.array(start.channels, dtype=float)
    x, u = tuple(map(float, start.states)), tuple(map(float, start.inputs))
    values = np.zeros(len(system.channels))
    for _ in range(100):
        following = np.array(system.emit(system.parameters, x, u, tuple(values)), dtype=float)
        if np.array_equal(following, values):
            return values
        values = following
    message = f"the channels of {system.name} read each other and do not settle at the start; give the values that they held before"
    raise InvalidInputError(message)


def new_run(system: DelaySystem, start: Start, step: float, every: int) -> Run:
    """Make the state of a run at its start.

    Raises:
        InvalidInputError: the start does not fit the system, or a lag there is no positive number above the step.
    """
    for variables, values, what in ((system.states, start.states, "states"), (system.inputs, start.inputs, "inputs")):
        if np.shape(values) != (len(variables),):
            message = (
                f"{np.size(values)} {what} were given where {system.name} has {len(variables)}: {', '.join(v.name for v in variables)}"
            )
            raise InvalidInputError(message)
        for variable, value in zip(variables, values, strict=True):
            check_range(variable, float(value))
    if not math.isfinite(start.time):
        raise out_of_range("start time", start.time, "s", "the finite numbers", "give one")
    initial = held_channels(system, start)
    _check_lags(system, start, initial, step)
    state = np.zeros(1, dtype=runs.state_type(system))
    s = state[0]
    s["time"], s["origin"], s["step"], s["store_every"] = start.time, start.time, step, every
    largest = np.finfo(float).max
    for field, values in (
        ("x", start.states),
        ("low", np.maximum([v.low for v in system.states], -largest)),
        ("high", np.minimum([v.high for v in system.states], largest)),
        ("base", start.inputs),
        ("initial", initial),
        ("zd", initial),
        ("zd_next", initial),
    ):
        s[field][: len(values)] = values
    runs.write_structure(system, s)
    columns = len(system.channels)
    for field in ("boundary_time", "passing_time", "event", "sample_time", "act_time"):
        s[field] = np.inf
    s["tolerance"] = TOLERANCE * step + ROUNDING * abs(start.time)
    s["grid_time"], s["landing"], s["search_channel"] = start.time, start.time, -1  # the start is a breakpoint
    return Run(state=state, nodes=np.zeros((0, runs.NODE_VALUES + columns)), segments=np.zeros((1, runs.SEGMENT_ORDERS + columns)))


def _check_lags(system: DelaySystem, start: Start, initial: Floats, step: float) -> None:
    """Refuse a start whose lags are no positive numbers or not above the step."""
    x, u = tuple(map(float, start.states)), tuple(map(float, start.inputs))
    with np.errstate(all="ignore"):
        try:
            lags = system.lags(system.parameters, x, u, tuple(map(float, initial)))
        except ZeroDivisionError:
            lags = (math.inf,) * len(system.channels)
    values = ", ".join(f"{v.name} = {value:g} {v.unit}" for v, value in zip(system.states, x, strict=True))
    for variable, lag in zip(system.channels, map(float, lags), strict=True):
        if not (math.isfinite(lag) and lag > 0.0):
            message = f"the lag of {variable.name} at the start ({values}) is {lag:g} s, no positive number; start from other states"
            raise InvalidInputError(message, lag=lag, channel=variable.name)
        if lag <= step:
            message = f"step = {step:g} s is not below the lag of {variable.name} at the start ({values}), {lag:g} s; "
            raise InvalidInputError(message + f"give a step below {lag:g} s", step=step, lag=lag, channel=variable.name)


def grid_target(s: runs.Record, until: float) -> tuple[int, tuple[str, ...]]:
    """Grid point at which a run stops, and a note where that is not the time asked for."""
    present, origin, step = float(s["time"]), float(s["origin"]), float(s["step"])
    if not (math.isfinite(until) and until > present):
        raise out_of_range("stop time", until, "s", f"values after the start at {present:g} s", "give a later stop time")
    count = (until - origin) / step
    if count > 2**52:
        raise out_of_range("step", step, "s", f"steps that {until - origin:g} s can be counted in", "give a longer step")
    nearest = round(count)
    on_grid = abs(count - nearest) <= 1e-9 + 1e-15 * abs(count)
    target = nearest if on_grid else math.ceil(count)
    if target < max(int(s["grid_index"]), 1):
        raise out_of_range("stop time", until, "s", f"values a step after the start at {present:g} s", "give a later stop time")
    if on_grid:
        return target, ()
    return target, (f"stop time {until:g} s is no multiple of the step {step:g} s: moved to {origin + target * step:.12g} s",)


def _advance(
    system: DelaySystem, signals: Mapping[str, Signal], run: Run, signal_digest: str, *, until: float, options: Options
) -> Trajectory:
    s = run.state[0]
    target, notes = grid_target(s, until)
    span = (float(s["origin"]), float(s["origin"]) + (target + 1) * float(s["step"]))
    inputs = tabulate_signals(system, s["base"][: len(system.inputs)], signals, span)
    samples = reserve_samples(system, s, target)
    parameters = np.array([list(flatten(as_floats(system.parameters, system.name)))])
    tables = {**inputs, "parameters": parameters, "samples": samples}
    kernel = build_kernel(system, options.method)
    begun = done = max(int(s["grid_index"]) - 1, 0)
    s["stored"] = 0
    while done < target:
        if options.progress is not None:
            options.progress((done - begun) / (target - begun))
        s["grid_target"] = min(target, done + options.chunk)
        run = make_room(run, int(s["grid_target"]) - done)
        attach_tables(run.state, {**tables, "nodes": run.nodes, "segments": run.segments})
        status = kernel(run.state)
        if status == runs.REFUSED:
            raise explain(system, s)
        done = int(s["grid_index"]) - 1
        if done < target and options.stopped is not None and options.stopped():
            break
    if options.progress is not None and done == target:
        options.progress(1.0)
    kept = make_room(run, 0)
    checkpoint = Checkpoint(system_digest=system.content_digest, signal_digest=signal_digest, method=options.method, run=kept)
    if done == target:
        return make_trajectory(system, samples, notes, checkpoint)
    place = f"{system.name} at t = {checkpoint.time:.6g} s of {until:g} s"
    run_so_far = make_trajectory(system, samples[: int(s["stored"])], notes, checkpoint)
    raise StoppedError(f"{place}, stopped from outside", run=run_so_far, time=checkpoint.time)


def reserve_samples(system: DelaySystem, s: runs.Record, target: int) -> Floats:
    """Make room for all samples up to a grid point.

    Raises:
        InvalidInputError: they do not fit into memory.
    """
    every = int(s["store_every"])
    rows = target // every - (int(s["grid_index"]) - 1) // every
    columns = 1 + len(system.states) + len(system.inputs) + len(system.outputs)
    try:
        return np.empty((rows, columns))
    except (MemoryError, ValueError) as error:
        message = f"{rows} samples of {columns} numbers do not fit into memory; store fewer of them with every = n, or stop earlier"
        raise InvalidInputError(message, samples=rows) from error


def make_trajectory(system: DelaySystem, samples: Floats, notes: tuple[str, ...], checkpoint: Checkpoint) -> Trajectory:
    """Give what was stored as a trajectory."""
    first, second = 1 + len(system.states), 1 + len(system.states) + len(system.inputs)
    return Trajectory(
        system=system.name,
        times=samples[:, 0],
        states=samples[:, 1:first],
        inputs=samples[:, first:second],
        outputs=samples[:, second:],
        state_names=tuple(v.name for v in system.states),
        input_names=tuple(v.name for v in system.inputs),
        output_names=tuple(v.name for v in system.outputs),
        state_units=tuple(v.unit for v in system.states),
        input_units=tuple(v.unit for v in system.inputs),
        output_units=tuple(v.unit for v in system.outputs),
        step=checkpoint.step,
        notes=notes,
        checkpoint=checkpoint,
    )
