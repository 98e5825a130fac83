"""Simulation of a delay system: from a start and input signals to samples, resumable, with clear errors.

Source of the procedure: Lee (1995), chapter 3; of the numerics: `revline.dde.kernel`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from revline.dde import run as runs
from revline.dde.kernel import STANDARD, Method, build_kernel
from revline.dde.run import Floats
from revline.dde.tables import attach_tables
from revline.errors import DivergedError, InvalidInputError, LagError, SimulationError, StalledError, out_of_range
from revline.signals import NEVER, Signal, TermKind
from revline.system import DelaySystem, check_range, index_of
from revline.values import fingerprint, make_read_only

Progress = Callable[[float], None]
"""Told from time to time which part of the run is done, 0 to 1."""

CHUNK = 200_000
"""Grid steps between two looks at progress and interruption."""


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """What a simulation gave, sample by sample, and the state from which it goes on.

    Attributes:
        system: its name.
        times: shape (n,), in seconds.
        states: shape (n, n_states).
        inputs: shape (n, n_inputs); at a jump the value after it.
        outputs: shape (n, n_outputs).
        state_names, input_names, output_names: what the columns are.
        step: of the mesh, in seconds.
        notes: what was adjusted, in words.
        checkpoint: from which `resume` continues as if the run had not stopped.
    """

    system: str
    times: Floats
    states: Floats
    inputs: Floats
    outputs: Floats
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    step: float
    notes: tuple[str, ...]
    checkpoint: "Checkpoint"

    def __post_init__(self) -> None:
        make_read_only(self)

    def output(self, name: str) -> Floats:
        """Samples of one output, shape (n,).

        Raises:
            InvalidInputError: there is no such output.
        """
        return _column(self.outputs, self.output_names, name)

    def input(self, name: str) -> Floats:
        """Samples of one input, shape (n,).

        Raises:
            InvalidInputError: there is no such input.
        """
        return _column(self.inputs, self.input_names, name)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Checkpoint:
    """A stopped run: all arrays of its state, and digests of what it ran with."""

    system_digest: str
    signal_digest: str
    run: "Run"


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A run's state (an array of one record, see `revline.dde.run.state_type`) and its history."""

    state: np.ndarray
    nodes: Floats
    segments: Floats

    def copy(self) -> "Run":
        """Copy all arrays, so that a checkpoint stays what it was."""
        return Run(self.state.copy(), self.nodes.copy(), self.segments.copy())


def simulate(
    system: DelaySystem,
    start: Start,
    signals: Mapping[str, Signal],
    *,
    until: float,
    step: float,
    options: "Options | None" = None,
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
        InvalidInputError: an input leaves its range, the step is not below the smallest lag, the stop time is before the start.
        StalledError: a state left its range.
        LagError: a lag became no positive number, fell below the step, or the delayed time ran backwards.
        DivergedError: a state is no finite number any more.
    """
    options = options or Options()
    check_mesh(start.time, until, step, options.every)
    run = _new_run(system, start, step, options.every)
    return _advance(system, signals, run, until, options)


def resume(
    system: DelaySystem, signals: Mapping[str, Signal], checkpoint: Checkpoint, *, until: float, options: "Options | None" = None
) -> Trajectory:
    """Go on with a stopped run, bit for bit as if it had not stopped; the first sample is the one after its last.

    Raises:
        InvalidInputError: system or signals are not those of the run, or the stop time is not after its end.
    """
    options = options or Options()
    if system.content_digest != checkpoint.system_digest:
        message = f"this run was made with another system or other parameters than {system.name} has now; start a new run"
        raise InvalidInputError(message)
    if fingerprint(dict(signals)) != checkpoint.signal_digest:
        message = "this run was made with other input signals; continue it with the same, or start a new run"
        raise InvalidInputError(message)
    run = checkpoint.run.copy()
    check_mesh(float(run.state["time"][0]), until, float(run.state["step"][0]), 1)
    return _advance(system, signals, run, until, options)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How a simulation is run and stored; `every` keeps every n-th step."""

    every: int = 1
    method: Method = STANDARD
    progress: Progress | None = None


def check_mesh(start: float, until: float, step: float, every: int) -> None:
    """Refuse times and steps that make no mesh."""
    if not (math.isfinite(step) and step > 0.0):
        raise out_of_range("step", step, "s", "values above 0", "give a step such as 0.001")
    if not (math.isfinite(until) and until > start):
        raise out_of_range("stop time", until, "s", f"values after the start at {start:g} s", "give a later stop time")
    if every < 1:
        raise out_of_range("every", every, "steps", "1 and above", "store every n-th step with n = 1, 2, ...")
    if (until - start) / step > 2**53:
        raise out_of_range("step", step, "s", f"steps that {until - start:g} s can be counted in", "give a longer step")


def _new_run(system: DelaySystem, start: Start, step: float, every: int) -> "Run":
    for variable, value in zip((*system.states, *system.inputs), (*start.states, *start.inputs), strict=True):
        check_range(variable, float(value))
    initial = held_channels(system, start)
    x, u = tuple(map(float, start.states)), tuple(map(float, start.inputs))
    for variable, lag in zip(system.channels, system.lags(system.parameters, x, u, tuple(initial)), strict=True):
        if not (math.isfinite(lag) and lag > step):
            message = f"step = {step:g} s is not below the lag of {variable.name} at the start, {lag:g} s; give a step below {lag:g} s"
            raise InvalidInputError(message, step=step, lag=float(lag), channel=variable.name)
    state = np.zeros(1, dtype=runs.state_type(system))
    s = state[0]
    s["time"], s["origin"], s["step"], s["store_every"] = start.time, start.time, step, every
    for field, values in (
        ("x", start.states),
        ("low", [v.low for v in system.states]),
        ("high", [v.high for v in system.states]),
        ("base", start.inputs),
        ("initial", initial),
        ("zd", initial),
    ):
        s[field][: len(values)] = values
    runs.write_structure(system, s)
    columns = len(system.channels)
    return Run(state=state, nodes=np.zeros((0, runs.NODE_VALUES + columns)), segments=np.zeros((1, runs.SEGMENT_ORDERS + columns)))


def held_channels(system: DelaySystem, start: Start) -> Floats:
    """What the channels held before the start: given, or what states and inputs emit when each channel reads itself.

    Raises:
        InvalidInputError: the number given is not that of the channels, or the channels' values do not settle.
    """
    if start.channels is not None:
        if start.channels.shape != (len(system.channels),):
            message = f"{start.channels.shape[0]} channel values were given where {system.name} has {len(system.channels)} channels"
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


def tabulate_signals(system: DelaySystem, base: Floats, signals: Mapping[str, Signal], span: tuple[float, float]) -> tuple[Floats, ...]:
    """Collect all terms of all signals in one table, their recordings in another, and their breaks in a span of time in a third.

    Raises:
        InvalidInputError: there is no such input, or the signal leaves the input's range.
    """
    terms, record = [np.empty((0, 6))], [np.empty((0, 2))]
    breaks: dict[float, list[int]] = {}
    for name, signal in signals.items():
        owner = index_of(system.inputs, name)
        for bound in signal.range():
            check_range(system.inputs[owner], float(base[owner]) + bound)
        rows = signal.rows()
        rows[rows[:, 0] == TermKind.RECORDED, 3] += sum(len(samples) for samples in record)
        terms.append(np.column_stack([np.full(len(rows), owner), rows]))
        record.append(signal.record)
        for point in signal.breakpoints(*span):
            breaks.setdefault(point.time, [NEVER] * len(base))[owner] = point.order
    table = np.array([[time, *breaks[time]] for time in sorted(breaks)], dtype=float).reshape(len(breaks), 1 + len(base))
    return np.concatenate(terms), np.concatenate(record), table


def _advance(system: DelaySystem, signals: Mapping[str, Signal], run: "Run", until: float, options: "Options") -> Trajectory:
    kernel = build_kernel(system, options.method)
    s = run.state[0]
    origin, step, begun = float(s["origin"]), float(s["step"]), int(s["grid_index"])
    target = math.ceil((until - origin) / step - 1e-9)
    stop = origin + target * step
    notes: tuple[str, ...] = ()
    if abs(stop - until) > 1e-9 * step:
        notes = (f"stop time {until:g} s is no multiple of the step {step:g} s: moved to {stop:.12g} s",)
    fresh = int(s["newest_segment"]) == 0
    every = int(s["store_every"])
    columns = 1 + len(system.states) + len(system.inputs) + len(system.outputs)
    s["stored"] = 0
    samples = np.empty((target // every - begun // every + int(fresh), columns))
    base = run.state["base"][0][: len(system.inputs)]
    inputs = dict(zip(("terms", "record", "breaks"), tabulate_signals(system, base, signals, (origin, stop + step)), strict=True))
    done = begun
    while done < target:
        if options.progress is not None:
            options.progress((done - begun) / (target - begun))
        s["grid_target"] = min(target, done + CHUNK)
        run = make_room(run, int(s["grid_target"]) - done)
        attach_tables(run.state, {"nodes": run.nodes, "segments": run.segments, **inputs, "samples": samples})
        status = kernel(system.parameters, run.state)
        if status not in (runs.DONE, runs.NEEDS_ROOM):
            raise explain(system, s, status)
        done = int(s["grid_index"])
    if options.progress is not None:
        options.progress(1.0)
    checkpoint = Checkpoint(system_digest=system.content_digest, signal_digest=fingerprint(dict(signals)), run=make_room(run, 0))
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
        step=step,
        notes=notes,
        checkpoint=checkpoint,
    )


def make_room(run: "Run", steps: int) -> "Run":
    """Drop nodes and segments that no reading can reach any more, and make room for a number of grid steps; changes the state's indices."""
    s = run.state[0]
    channels = run.nodes.shape[1] - runs.NODE_VALUES
    newest, count = int(s["newest_segment"]), int(s["node_count"])
    oldest = min((int(k) for k in s["segment"][:channels]), default=newest)
    first = 0
    if oldest > 0:
        first = int(run.segments[oldest, runs.SEGMENT_START])
        used = min((int(k) for k in s["node"][:channels]), default=count)
        if oldest == newest:
            first = max(first, min(used, count) - 8)
    dropped = max(oldest - 1, 0)
    segments = np.zeros((newest - dropped + 16 * runs.ROOM_SEGMENTS, run.segments.shape[1]))
    kept = run.segments[dropped + 1 : newest + 1]
    segments[1 : 1 + len(kept)] = kept
    segments[1 : 1 + len(kept), runs.SEGMENT_START] = np.maximum(kept[:, runs.SEGMENT_START] - first, 0)
    nodes = np.zeros((count - first + steps + steps // 4 + 4 * runs.ROOM_NODES, run.nodes.shape[1]))
    nodes[: count - first] = run.nodes[first:count]
    s["segment"] = np.maximum(s["segment"] - dropped, 0)
    s["node"] = np.maximum(s["node"] - first, 0)
    s["cell_end"] = s["cell_start"]
    s["node_count"], s["newest_segment"] = count - first, newest - dropped
    return Run(state=run.state, nodes=nodes, segments=segments)


def explain(system: DelaySystem, s: runs.Record, status: int) -> SimulationError:
    """Build the error for a run that could not go on, with time, states and lags."""
    time, step = float(s["time"]), float(s["step"])
    values = dict(zip((v.name for v in system.states), map(float, s["x"]), strict=False))
    states = ", ".join(f"{v.name} = {values[v.name]:g} {v.unit}" for v in system.states)
    lags = ", ".join(f"lag of {v.name} = {time - r:g} s" for v, r in zip(system.channels, map(float, s["read_time"]), strict=False))
    place = f"{system.name} at t = {time:g} s ({states}; {lags or 'no lags'})"
    if status == runs.OUT_OF_RANGE:
        left = [(v, float(x)) for v, x in zip(system.states, s["x_new"], strict=False) if not v.low <= x <= v.high]
        gone = "; ".join(f"{v.name} goes to {x:g} {v.unit}, outside {v.low:g} to {v.high:g} {v.unit}" for v, x in left)
        return StalledError(f"stalled: {place}: {gone}; give more throttle, less load or smaller gains", time=time, **values)
    if status == runs.NOT_FINITE:
        return DivergedError(
            f"diverged: {place}: a state is no finite number any more; give smaller gains or a smaller step", time=time, **values
        )
    if status == runs.SHORT_LAG:
        return LagError(f"step = {step:g} s is longer than a lag during the run: {place}; give a smaller step", time=time, **values)
    if status == runs.BACKWARD:
        message = (
            f"stalled: {place}: the delayed time runs backwards, as the lag grows faster than time passes; give more throttle or less load"
        )
        return LagError(message, time=time, **values)
    return LagError(f"{place}: a lag is no positive number; check the equation of the lags", time=time, **values)


def _column(table: Floats, names: tuple[str, ...], name: str) -> Floats:
    if name not in names:
        message = f"there is no signal {name}; there are {', '.join(names)}"
        raise InvalidInputError(message, name=name)
    return table[:, names.index(name)]
