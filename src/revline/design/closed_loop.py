"""Closed speed loops in time: on any system with its delays and limits, and on linear models with their delay exact.

Law and conventions: `revline.design.pid_system`; the command is a true step at time 0. Source: Lee (1995), chapter 5.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.analysis.trim import Trim
from revline.connection import connect
from revline.dde.simulate import Start
from revline.design.classify import Criteria, classify_outcome
from revline.design.controller import PidGains
from revline.design.linear_loop import closed_loop_transfer, closed_loop_transfer_to_control
from revline.design.linear_plant import linear_plant, step_limit
from revline.design.loop_equation import form_loop
from revline.design.loop_simulation import LoopRecord, LoopTrace, Mesh, check_steps, describe_stall, keep_finite, simulate_loop
from revline.design.outcome import Diverged, LimitCycle, Outcome, Settled
from revline.design.pid_system import pid_system
from revline.design.step_measures import StepMeasures, measure_overshoot, measure_step
from revline.design.time_series import MIN_SAMPLES
from revline.errors import DivergedError, InvalidInputError, NotSettledError, out_of_range
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem, index_of
from revline.values import make_read_only

Floats = NDArray[np.float64]

FORM = (
    "u = trim + kp e + ki integral of e - kd dy/dt; derivative on the measurement only, integral from 0, true step command, no anti-windup"
)
"""The form of every closed loop here; other forms give other numbers."""

LARGEST_EXPONENT = 300.0
"""An unstable loop is followed until it has grown by e to this: far beyond any bound, and within the range of numbers."""


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
        times: shape (n,), in seconds from the step; to where it passed its bound for a loop that diverges, to the last step for one that
            stalls.
        output: the measurement, shape (n,).
        control: what the controller drives, after its limits, shape (n,).
        terms: proportional, integral and derivative term, shape (n, 3); without rows where the response is an exact formula.
        outcome: how it ended.
        overshoot: as a fraction of the command, of whatever was recorded; it says nothing of a loop that diverged or stalled.
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
        if len(self.terms) not in (0, len(self.times)):
            message = f"there are {len(self.terms)} samples of the controller's terms and {len(self.times)} of the output"
            raise InvalidInputError(message)
        if not all(np.isfinite(values).all() for values in (self.times, self.output, self.control, self.terms)):
            message = "a closed loop's record holds numbers that are not finite; end it before them"
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

    A step that is longer than a lag which the run comes to is refused. Where a run fails by a lag in another way, it is made again with
    half the step, up to four times, to tell whether the step or the model is at fault; samples stay where they were asked for.
    As the system has limits of its own, it counts as diverged only where its measurement also is further from the target than it was
    from zero at the start.

    Args:
        plant: nonlinear or linear, with its delays.
        point: of rest, for example a trim.
        gains: of the controller.
        task: what is asked.
        wires: which signals close the loop.
        limits: of what the controller drives.

    Raises:
        InvalidInputError: signals are missing, units differ, the limits exclude the trim, the measurement is not that of the states, or
            the step is not below the smallest lag at the start.
        NotSettledError: the record is too short to tell how the loop ends.
        SimulationError: a state that the measurement does not show is no finite number any more.
    """
    loop = close_loop(plant, point, gains, wires=wires, limits=limits)
    measured = index_of(plant.outputs, wires.measurement)
    inputs = {name: value for name, value in point.inputs.items() if name != wires.drive}
    start = Start(states=np.append(point.states, 0.0), inputs=loop.input_vector({**inputs, loop.inputs[-1].name: point.measurement}))
    record = simulate_loop(loop, start, task.command, Mesh(task.until, task.step), measured=measured)
    found, unit = float(record.trace.output[0]), gains.input_unit
    if abs(found - point.measurement) > 1e-6 * max(1.0, abs(found)):
        message = (
            f"{wires.measurement} = {point.measurement:g} {unit} is given for an operating point whose states make it {found:g} {unit}; "
            "give a point of rest, from find_trim() for example"
        )
        raise InvalidInputError(message, given=point.measurement, found=found)
    criteria = replace(task.criteria, bound=max(task.criteria.bound, abs(point.measurement / task.command)))
    run = _judge(plant.name, gains, replace(task, criteria=criteria), record, start=point.measurement, limits=limits, loop=loop)
    at_limit = float(run.control[-1]) in limits
    return run if gains.ki == 0.0 or at_limit else _refuse_creep(run, run.target, task.criteria)


def close_loop(plant: DelaySystem, point: OperatingPoint, gains: PidGains, *, wires: LoopSignals, limits: Limits) -> DelaySystem:
    """Make one system of a plant and a controller that holds it at a point of rest; the command is its last input.

    Raises:
        InvalidInputError: signals are missing or units differ, or the limits exclude the trim.
    """
    index_of(plant.inputs, wires.drive)
    if wires.drive not in point.inputs:
        message = f"the operating point has no value for {wires.drive}, which the controller drives; it has {', '.join(point.inputs)}"
        raise InvalidInputError(message, name=wires.drive)
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
        task: what is asked; the step is divided where the model asks for it, the samples stay where they were asked for.
        name: of the model, for people.
        base: input and output at the trim that the model belongs to.

    Raises:
        InvalidInputError: the model is not strictly proper, its units are not the controller's, or its delay is too short to be
            simulated for so long.
        NotSettledError: the record is too short to tell how the loop ends.
    """
    record = _record_linear_loop(model, gains, task)
    trace = record.trace._replace(output=record.trace.output + base[1], control=record.trace.control + base[0])
    run = _judge(name, gains, task, LoopRecord(trace, record.failure), start=base[1], limits=Limits())
    if gains.kp == gains.ki == 0.0:  # the command reaches nothing
        return run
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = form_loop(model, gains).static_gain
    return _refuse_creep(run, base[1] + rest * task.command, task.criteria) if math.isfinite(rest) else run


def trace_linear_loop(model: TransferFunction, gains: PidGains, task: LoopTask) -> LoopTrace:
    """Answer of a closed loop around a linear model to a step of its command, relative to the trim; see `run_linear_loop`.

    Raises:
        InvalidInputError: as for `run_linear_loop`.
        DivergedError: the loop grows beyond the range of numbers.
    """
    record = _record_linear_loop(model, gains, task)
    if record.failure is not None:
        raise record.failure
    return record.trace


def _record_linear_loop(model: TransferFunction, gains: PidGains, task: LoopTask) -> LoopRecord:
    if model.delay == 0.0:
        return LoopRecord(_trace_rational(model, gains, task), None)
    plant = linear_plant(model)
    rest = OperatingPoint(states=np.zeros(len(plant.states)), inputs={OF_LINEAR_MODEL.drive: 0.0}, measurement=0.0)
    loop = close_loop(plant, rest, gains, wires=OF_LINEAR_MODEL, limits=Limits())
    start = Start(states=np.zeros(len(loop.states)), inputs=loop.input_vector({}))
    mesh = Mesh(task.until, task.step, math.ceil(task.step / step_limit(model)))
    return simulate_loop(loop, start, task.command, mesh, measured=0)


def _trace_rational(model: TransferFunction, gains: PidGains, task: LoopTask) -> LoopTrace:
    to_output, to_control = closed_loop_transfer(model, gains), closed_loop_transfer_to_control(model, gains)
    growth = float(np.max(to_output.poles.real, initial=0.0))
    until = min(task.until, LARGEST_EXPONENT / growth) if growth > 0.0 else task.until
    check_steps(Mesh(until, task.step))
    times: Floats = task.step * np.arange(math.floor(until / task.step + 1e-9) + 1, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        output = task.command * to_output.step_response(times)
        control = task.command * to_control.step_response(times)
    return keep_finite(LoopTrace(times=times, output=output, control=control, terms=np.empty((0, 3)), step=0.0))


def _judge(
    name: str, gains: PidGains, task: LoopTask, record: LoopRecord, *, start: float, limits: Limits, loop: DelaySystem | None = None
) -> LoopRun:
    target, trace = start + task.command, record.trace
    outcome = _decide(task, record, target, loop)
    if isinstance(outcome, Diverged):
        trace = trace.first(max(int(np.searchsorted(trace.times, outcome.time, side="right")), MIN_SAMPLES))
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


def _decide(task: LoopTask, record: LoopRecord, target: float, loop: DelaySystem | None) -> Outcome:
    """Tell how a loop ended; numbers beyond the range of numbers are believed only if the measurement had left its bound before."""
    trace, failure = record
    if failure is not None and loop is not None and not isinstance(failure, DivergedError):
        return describe_stall(failure, loop)
    try:
        outcome = classify_outcome(trace.times, trace.output, target=target, command=task.command, criteria=task.criteria)
    except NotSettledError as undecided:
        raise (failure or undecided) from undecided
    if failure is not None and not isinstance(outcome, Diverged):
        raise failure
    return outcome


def _refuse_creep(run: LoopRun, end: float, criteria: Criteria) -> LoopRun:
    """Refuse a run that looks at rest elsewhere than where the loop can rest: it still creeps there.

    Raises:
        NotSettledError: the run is so; with where it goes.
    """
    outcome, unit = run.outcome, run.gains.input_unit
    if not isinstance(outcome, Settled) or abs(end - outcome.value) <= criteria.rest * abs(run.command) + outcome.residual:
        return run
    message = (
        f"the record of {run.times[-1]:g} s ends near {outcome.value:.6g} {unit} but the loop can rest at {end:.6g} {unit} only: it still "
        "creeps there; simulate much longer, or raise the integral gain"
    )
    raise NotSettledError(message, value=outcome.value, end=end, ki=run.gains.ki)


MISSED = 0.01
"""A loop that comes to rest further from its target than this part of the command is said to miss it."""


def describe_outcome(run: LoopRun) -> str:
    """Say in a line how a loop ended, with its numbers."""
    outcome, unit = run.outcome, run.gains.input_unit
    if isinstance(outcome, Settled):
        off, side = abs(outcome.steady_error), "below" if outcome.steady_error > 0.0 else "above"
        missed = f", {off:.4g} {unit} {side} what is commanded" if off > MISSED * abs(run.command) else ""
        return f"settles at {outcome.value:.6g} {unit}, overshoot {100.0 * run.overshoot:.1f} % of the command{missed}"
    if isinstance(outcome, LimitCycle):
        return f"hunts between {outcome.low:.6g} and {outcome.high:.6g} {unit}, period {outcome.period:.4g} s"
    if isinstance(outcome, Diverged):
        return f"diverges: beyond {outcome.bound:g} {unit} from its target after {outcome.time:.3g} s"
    return f"stalls after {outcome.time:.3g} s: {outcome.state} = {outcome.value:.4g}"
