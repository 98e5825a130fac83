"""Closed speed loops in time: on any system with its delays and limits, and on linear models with their delay exact.

Law and conventions: `revline.design.pid_system`; the command is a true step at time 0. Source: Lee (1995), chapter 5.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.analysis.trim import Trim
from revline.connection import connect
from revline.dde.simulate import Start, simulate
from revline.design.classify import Criteria, classify_outcome
from revline.design.controller import PidGains
from revline.design.linear_loop import closed_loop_transfer, closed_loop_transfer_to_control
from revline.design.linear_plant import linear_plant, step_limit
from revline.design.outcome import Diverged, LimitCycle, Outcome, Settled, Stalled
from revline.design.pid_system import pid_system
from revline.design.step_measures import StepMeasures, measure_overshoot, measure_step
from revline.errors import DivergedError, InvalidInputError, SimulationError, StepError, out_of_range
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem
from revline.values import make_read_only

Floats = NDArray[np.float64]

FORM = (
    "u = trim + kp e + ki integral of e - kd dy/dt; derivative on the measurement only, integral from 0, true step command, no anti-windup"
)
"""The form of every closed loop here; other forms give other numbers."""

LEAST_STEPS = 20
"""A run has at least this many steps before it may be cut short by a stall."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopSignals:
    """Names of the signals that close a loop: what the controller drives, what it measures, and that signal's rate."""

    drive: str
    measurement: str
    measurement_rate: str


SPEED_BY_THROTTLE = LoopSignals(drive="throttle", measurement="engine_speed", measurement_rate="engine_acceleration")
"""Engine speed controlled by the throttle."""

OF_LINEAR_MODEL = LoopSignals(drive="input", measurement="output", measurement_rate="output_rate")
"""The signals of `linear_plant`."""


class Limits(NamedTuple):
    """Lower and upper limit of what the controller drives."""

    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopRun:
    """A closed loop after a step of its command, how it ended, and what its controller did.

    Attributes:
        plant: name of the plant.
        gains: of the controller.
        form: control law and conventions, in words.
        limits: of the control.
        command: size of the step, in the measurement's unit.
        start: measurement before the step.
        times: shape (n,), in seconds from the step.
        output: the measurement, shape (n,).
        control: what the controller drives, after its limits, shape (n,).
        terms: proportional, integral and derivative term, shape (n, 3); without rows where the response is an exact formula.
        outcome: how it ended.
        overshoot: as a fraction of the command, of whatever was recorded.
        step: of the simulation, in seconds; 0 where the response is an exact formula.
    """

    plant: str
    gains: PidGains
    form: str
    limits: Limits
    command: float
    start: float
    times: Floats
    output: Floats
    control: Floats
    terms: Floats
    outcome: Outcome
    overshoot: float
    step: float

    def __post_init__(self) -> None:
        if not len(self.times) == len(self.output) == len(self.control):
            message = f"times, output and control have {len(self.times)}, {len(self.output)} and {len(self.control)} samples"
            raise InvalidInputError(message)
        make_read_only(self)

    @property
    def target(self) -> float:
        """Value commanded after the step."""
        return self.start + self.command

    @property
    def is_stable(self) -> bool:
        """Whether the loop came to rest."""
        return isinstance(self.outcome, Settled)

    @property
    def saturated_share(self) -> float:
        """Part of the samples in which the control is at a limit."""
        return float(np.mean((self.control <= self.limits.low) | (self.control >= self.limits.high)))

    def measures(self) -> StepMeasures:
        """Overshoot, rise and settling time.

        Raises:
            NotSettledError: the loop has not settled within the record.
        """
        return measure_step(self.times, self.output, start=0.0, target=self.target, command=self.command)


class LoopTrace(NamedTuple):
    """What a closed loop did: times (n,), measurement (n,), control (n,), its terms (n, 3) or none, and the simulation's step."""

    times: Floats
    output: Floats
    control: Floats
    terms: Floats
    step: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopTask:
    """What is asked of a closed loop: the step of its command, and how long and how finely it is run."""

    command: float
    until: float
    step: float = 1e-3
    criteria: Criteria = field(default_factory=Criteria)

    def __post_init__(self) -> None:
        if not math.isfinite(self.command) or self.command == 0.0:
            message = f"command step = {self.command:g} moves nothing; give a size other than 0"
            raise InvalidInputError(message, command=self.command)
        for name, value in (("stop time", self.until), ("time step", self.step)):
            if not (math.isfinite(value) and value > 0.0):
                raise out_of_range(name, value, "s", "values above 0", "give a time in seconds")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OperatingPoint:
    """Where a loop starts: states, inputs and measurement at rest."""

    states: Floats
    inputs: Mapping[str, float]
    measurement: float


def operating_point(trim: Trim, wires: LoopSignals = SPEED_BY_THROTTLE) -> OperatingPoint:
    """Start a loop from a trim."""
    inputs = {variable.name: trim.input(variable.name) for variable in trim.input_variables}
    return OperatingPoint(states=trim.states, inputs=inputs, measurement=trim.output(wires.measurement))


def run_loop(
    plant: DelaySystem,
    point: OperatingPoint,
    gains: PidGains,
    task: LoopTask,
    *,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    limits: Limits = Limits(),  # noqa: B008 - an immutable tuple
) -> LoopRun:
    """Close a loop around a system at rest, step its command, and tell how it ends.

    Args:
        plant: nonlinear or linear, with its delays.
        point: of rest, for example a trim.
        gains: of the controller.
        task: what is asked.
        wires: which signals close the loop.
        limits: of what the controller drives.

    Raises:
        InvalidInputError: signals are missing, units differ, or the limits exclude the trim.
        NotSettledError: the record is too short to tell how the loop ends.
        StepError: a lag fell below the step.
    """
    loop = close_loop(plant, point, gains, wires=wires, limits=limits)
    free = {v.name for v in loop.inputs}
    inputs = {name: value for name, value in point.inputs.items() if name in free}
    start = Start(states=np.append(point.states, 0.0), inputs=loop.input_vector({**inputs, "command": point.measurement}))
    command = {"command": signals.step(task.command)}
    try:
        record, end = simulate(loop, start, command, until=task.until, step=task.step), None
    except StepError:
        raise
    except SimulationError as error:
        end = _ending(error, loop, task)
        last = max(math.floor(float(error.details["time"]) / task.step) - 1, LEAST_STEPS) * task.step
        record = simulate(loop, start, command, until=last, step=task.step)
    trace = LoopTrace(
        times=record.times,
        output=record.output(wires.measurement),
        control=record.output("control"),
        terms=np.column_stack([record.output(term) for term in ("proportional", "integral", "derivative")]),
        step=record.step,
    )
    return _judge(plant.name, gains, task, trace, start=point.measurement, limits=limits, end=end)


def close_loop(plant: DelaySystem, point: OperatingPoint, gains: PidGains, *, wires: LoopSignals, limits: Limits) -> DelaySystem:
    """Make one system of a plant and a controller that holds it at a point of rest."""
    controller = pid_system(gains, bias=point.inputs[wires.drive], low=limits.low, high=limits.high)
    return connect(
        plant,
        controller,
        to_first={wires.drive: "control"},
        to_second={"measurement": wires.measurement, "measurement_rate": wires.measurement_rate},
        name=f"{plant.name} with pid",
    )


def run_linear_loop(
    model: TransferFunction, gains: PidGains, task: LoopTask, *, name: str, base: tuple[float, float] = (0.0, 0.0)
) -> LoopRun:
    """Close a loop around a linear model without limits, its delay exact: simulated through its channel, or by formula without delay.

    Args:
        model: strictly proper.
        gains: of the controller.
        task: what is asked; the step is shortened where the model asks for it.
        name: of the model, for people.
        base: input and output at the trim that the model belongs to.

    Raises:
        InvalidInputError: the model is not strictly proper, or its units are not the controller's.
        NotSettledError: the record is too short to tell how the loop ends.
    """
    trace = trace_linear_loop(model, gains, task)
    shifted = replace_trace(trace, base)
    return _judge(name, gains, task, shifted, start=base[1], limits=Limits(), end=None)


def trace_linear_loop(model: TransferFunction, gains: PidGains, task: LoopTask) -> LoopTrace:
    """Answer of a closed loop around a linear model to a step of its command, relative to the trim; see `run_linear_loop`."""
    if model.delay == 0.0:
        return _trace_rational(model, gains, task)
    plant = linear_plant(model)
    loop = close_loop(
        plant,
        OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": 0.0}, measurement=0.0),
        gains,
        wires=OF_LINEAR_MODEL,
        limits=Limits(),
    )
    start = Start(states=np.zeros(len(loop.states)), inputs=loop.input_vector({}))
    command = {"command": signals.step(task.command)}
    record = simulate(loop, start, command, until=task.until, step=min(task.step, step_limit(model)))
    return LoopTrace(
        times=record.times,
        output=record.output("output"),
        control=record.output("control"),
        terms=np.column_stack([record.output(term) for term in ("proportional", "integral", "derivative")]),
        step=record.step,
    )


def replace_trace(trace: LoopTrace, base: tuple[float, float]) -> LoopTrace:
    """Shift a trace from deviations to absolute values of control and output."""
    return trace._replace(output=trace.output + base[1], control=trace.control + base[0])


def _trace_rational(model: TransferFunction, gains: PidGains, task: LoopTask) -> LoopTrace:
    times: Floats = task.step * np.arange(math.floor(task.until / task.step + 1e-9) + 1, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        output = task.command * closed_loop_transfer(model, gains).step_response(times)
        control = task.command * closed_loop_transfer_to_control(model, gains).step_response(times)
    whole = np.isfinite(output) & np.isfinite(control)
    kept = len(times) if whole.all() else int(np.argmin(whole))
    return LoopTrace(times=times[:kept], output=output[:kept], control=control[:kept], terms=np.empty((0, 3)), step=0.0)


def _judge(
    name: str, gains: PidGains, task: LoopTask, trace: LoopTrace, *, start: float, limits: Limits, end: Diverged | Stalled | None
) -> LoopRun:
    target = start + task.command
    outcome = end or classify_outcome(trace.times, trace.output, target=target, command=task.command, criteria=task.criteria)
    return LoopRun(
        plant=name,
        gains=gains,
        form=FORM,
        limits=limits,
        command=task.command,
        start=start,
        times=trace.times,
        output=trace.output,
        control=trace.control,
        terms=trace.terms,
        outcome=outcome,
        overshoot=measure_overshoot(trace.times, trace.output, start=0.0, target=target, command=task.command),
        step=trace.step,
    )


def _ending(error: SimulationError, loop: DelaySystem, task: LoopTask) -> Diverged | Stalled:
    """Outcome of a run that could not go on."""
    time = float(error.details["time"])
    if isinstance(error, DivergedError):
        return Diverged(time=time, value=math.inf, bound=task.criteria.bound * abs(task.command))
    left = [v for v in loop.states if not v.low < float(error.details[v.name]) < v.high]
    state = (left or loop.states[-2:])[0]
    return Stalled(time=time, state=state.name, value=float(error.details[state.name]))


def describe_outcome(run: LoopRun) -> str:
    """Say in a line how a loop ended, with its numbers."""
    outcome, unit = run.outcome, run.gains.input_unit
    if isinstance(outcome, Settled):
        return f"settles at {outcome.value:.6g} {unit}, overshoot {100.0 * run.overshoot:.1f} % of the command"
    if isinstance(outcome, LimitCycle):
        return f"hunts between {outcome.low:.6g} and {outcome.high:.6g} {unit}, period {outcome.period:.4g} s"
    if isinstance(outcome, Diverged):
        return f"diverges: beyond {outcome.bound:g} {unit} from its target after {outcome.time:.3g} s"
    return f"stalls after {outcome.time:.3g} s: {outcome.state} = {outcome.value:.4g}"
