"""Closed speed loops in time: on any system with its delays and limits, and on linear models with their delay exact.

Law and conventions: `revline.design.pid_system`; the command is a true step at time 0. Source: Lee (1995), chapter 5.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.connection import connect
from revline.dde.simulate import Options, Start, Trajectory, simulate
from revline.design.classify import Criteria, classify_outcome
from revline.design.controller import PidGains
from revline.design.linear_loop import closed_loop_transfer, closed_loop_transfer_to_control
from revline.design.linear_plant import linear_plant, step_limit
from revline.design.outcome import Diverged, LimitCycle, Outcome, Settled, Stalled
from revline.design.pid_system import pid_system
from revline.design.step_measures import StepMeasures, measure_overshoot, measure_step
from revline.errors import DivergedError, InvalidInputError, SimulationError
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


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopTask:
    """What is asked of a closed loop: the step of its command, and how long and how finely it is run."""

    command: float
    until: float
    step: float = 1e-3
    criteria: Criteria = Criteria()

    def __post_init__(self) -> None:
        if not math.isfinite(self.command) or self.command == 0.0:
            message = f"command step = {self.command:g} moves nothing; give a size other than 0"
            raise InvalidInputError(message, command=self.command)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OperatingPoint:
    """Where a loop starts: states, inputs and measurement at rest."""

    states: Floats
    inputs: Mapping[str, float]
    measurement: float


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
        LagError: the step is longer than a lag during the run.
    """
    loop = close_loop(plant, point, gains, wires=wires, limits=limits)
    free = {v.name for v in loop.inputs}
    inputs = {name: value for name, value in point.inputs.items() if name in free}
    start = Start(states=np.append(point.states, 0.0), inputs=loop.input_vector({**inputs, "command": point.measurement}))
    command = {"command": signals.step(task.command)}
    try:
        record = simulate(loop, start, command, until=task.until, step=task.step)
        end: SimulationError | None = None
    except SimulationError as error:
        end = error
        last = max(math.floor(float(error.details["time"]) / task.step) - 1, LEAST_STEPS) * task.step
        record = simulate(loop, start, command, until=last, step=task.step, options=Options())
    return _loop_run(plant.name, record, gains, task, wires=wires, limits=limits, point=point, end=end)


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
    if model.delay == 0.0:
        return _run_rational_loop(model, gains, task, name=name, base=base)
    step = min(task.step, step_limit(model))
    plant = linear_plant(model, base_input=base[0], base_output=base[1])
    point = OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": base[0]}, measurement=base[1])
    fitting = LoopTask(command=task.command, until=task.until, step=step, criteria=task.criteria)
    run = run_loop(plant, point, gains, fitting, wires=OF_LINEAR_MODEL)
    return replace(run, plant=name)


def _run_rational_loop(model: TransferFunction, gains: PidGains, task: LoopTask, *, name: str, base: tuple[float, float]) -> LoopRun:
    times = np.arange(math.floor(task.until / task.step + 1e-9) + 1) * task.step
    with np.errstate(over="ignore", invalid="ignore"):
        output = base[1] + task.command * closed_loop_transfer(model, gains).step_response(times)
        control = base[0] + task.command * closed_loop_transfer_to_control(model, gains).step_response(times)
    whole = np.isfinite(output) & np.isfinite(control)
    if not whole.all():
        kept = int(np.argmin(whole))
        times, output, control = times[:kept], output[:kept], control[:kept]
    target = base[1] + task.command
    return LoopRun(
        plant=name,
        gains=gains,
        form=FORM,
        limits=Limits(),
        command=task.command,
        start=base[1],
        times=times,
        output=output,
        control=control,
        terms=np.empty((0, 3)),
        outcome=classify_outcome(times, output, target=target, command=task.command, criteria=task.criteria),
        overshoot=measure_overshoot(times, output, start=0.0, target=target, command=task.command),
        step=0.0,
    )


def _loop_run(
    name: str,
    record: Trajectory,
    gains: PidGains,
    task: LoopTask,
    *,
    wires: LoopSignals,
    limits: Limits,
    point: OperatingPoint,
    end: SimulationError | None,
) -> LoopRun:
    output = record.output(wires.measurement)
    target = point.measurement + task.command
    return LoopRun(
        plant=name,
        gains=gains,
        form=FORM,
        limits=limits,
        command=task.command,
        start=point.measurement,
        times=record.times,
        output=output,
        control=record.output("control"),
        terms=np.column_stack([record.output(term) for term in ("proportional", "integral", "derivative")]),
        outcome=_outcome(record, output, target, task, end),
        overshoot=measure_overshoot(record.times, output, start=0.0, target=target, command=task.command),
        step=record.step,
    )


def _outcome(record: Trajectory, output: Floats, target: float, task: LoopTask, end: SimulationError | None) -> Outcome:
    if end is None:
        return classify_outcome(record.times, output, target=target, command=task.command, criteria=task.criteria)
    if isinstance(end, DivergedError):
        bound = task.criteria.bound * abs(task.command)
        return Diverged(time=float(end.details["time"]), value=float(output[-1]), bound=bound)
    state = record.state_names[int(np.argmin(record.states[-1] / np.maximum(np.abs(record.states[0]), 1e-300)))]
    return Stalled(time=float(end.details["time"]), state=state, value=float(end.details[state]))


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
