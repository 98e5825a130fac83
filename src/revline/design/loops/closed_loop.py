"""Closed speed loops in time: on any system with its delays and limits, and on linear models with their delay exact.

Law and conventions: `revline.design.controllers.pid_system`; the command is a true step at time 0. Source: Lee (1995), chapter 5.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from revline.connection import connect
from revline.dde.simulate import Start
from revline.design.controllers.continuous_pid import continuous_pid, filter_state
from revline.design.controllers.pid_controller import AnyPid, PidController, continuous_law
from revline.design.controllers.pid_system import pid_system
from revline.design.loops.loop_run import (
    FORM,
    MISSED,
    Limits,
    LoopFrame,
    LoopRun,
    LoopTask,
    describe_form,
    describe_outcome,
    judge_loop,
    refuse_creep,
)
from revline.design.loops.loop_simulation import LoopRecord, LoopTrace, Mesh, check_steps, keep_finite, simulate_loop
from revline.design.plants.linear_plant import linear_plant, step_limit
from revline.design.plants.loop_signals import OF_LINEAR_MODEL, SPEED_BY_THROTTLE, LoopSignals, OperatingPoint
from revline.design.stability.linear_loop import closed_loop_transfer, closed_loop_transfer_to_control
from revline.design.stability.loop_equation import form_loop
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction, step_responses
from revline.system import DelaySystem, index_of

__all__ = (
    "FORM",
    "MISSED",
    "Limits",
    "LoopRun",
    "LoopTask",
    "close_loop",
    "describe_outcome",
    "record_loop",
    "run_linear_loop",
    "run_loop",
    "trace_linear_loop",
)

Floats = NDArray[np.float64]

LARGEST_EXPONENT = 300.0
"""An unstable loop is followed until it has grown by e to this: far beyond any bound, and within the range of numbers."""


def run_loop(
    plant: DelaySystem,
    point: OperatingPoint,
    law: AnyPid,
    task: LoopTask,
    *,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    limits: Limits = Limits(),  # noqa: B008 - an immutable tuple
) -> LoopRun:
    """Close a loop around a system at rest, step its command, and tell how it ends.

    A step that is longer than a lag which the run comes to is refused. Where a run fails by a lag in another way, it is made again with
    half the step, up to four times, to tell whether the step or the model is at fault; samples stay where they were asked for.
    Of a run of more than a million steps so many are recorded, evenly spaced.
    As the system has limits of its own, it counts as diverged only where its measurement also is further from the target than it was
    from zero at the start.

    Args:
        plant: nonlinear or linear, with its delays.
        point: of rest, for example a trim.
        law: gains alone, or a continuous controller.
        task: what is asked.
        wires: which signals close the loop.
        limits: of what the controller drives; where the controller has limits too, the narrower ones.

    Raises:
        InvalidInputError: signals are missing, units differ, the controller samples or has no continuous form, the limits exclude the
            trim, the measurement is not that of the states, or the step is not below the smallest lag at the start.
        NotSettledError: the record is too short to tell how the loop ends.
        SimulationError: a state that the measurement does not show is no finite number any more.
    """
    controller = continuous_law(law)
    gains, limits = controller.gains, _narrower(controller, limits)
    loop, record = record_loop(plant, point, law, task, wires=wires, limits=limits)
    criteria = replace(task.criteria, bound=max(task.criteria.bound, abs(point.measurement / task.command)))
    frame = LoopFrame(plant.name, gains, describe_form(controller), limits, start=point.measurement, rest=point.inputs[wires.drive])
    run = judge_loop(frame, replace(task, criteria=criteria), record, loop)
    at_limit = float(run.control[-1]) in limits
    return run if gains.ki == 0.0 or at_limit else refuse_creep(run, run.target, task.criteria, spare=controller.dead_zone)


def record_loop(
    plant: DelaySystem,
    point: OperatingPoint,
    law: AnyPid,
    task: LoopTask,
    *,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    limits: Limits = Limits(),  # noqa: B008 - an immutable tuple
) -> tuple[DelaySystem, LoopRecord]:
    """Close a loop and run it as `run_loop` does, without a judgement of how it ends: the loop, and what it did as far as it went.

    Raises:
        InvalidInputError, SimulationError: as for `run_loop`.
    """
    controller = continuous_law(law)
    gains, limits = controller.gains, _narrower(controller, limits)
    loop = close_loop(plant, point, law, wires=wires, limits=limits)
    measured = index_of(plant.outputs, wires.measurement)
    inputs = {name: value for name, value in point.inputs.items() if name != wires.drive}
    start = Start(
        states=np.append(point.states, _states(controller, point.measurement)),
        inputs=loop.input_vector({**inputs, loop.inputs[-1].name: point.measurement}),
    )
    mesh = Mesh(task.until, task.step, max(1, math.ceil(task.step / _step_limit(controller)))).thinned()
    record = simulate_loop(loop, start, task.command, mesh, measured=measured, loads=task.loads)
    found, unit = float(record.trace.output[0]), gains.input_unit
    if abs(found - point.measurement) > 1e-6 * max(1.0, abs(found)):
        message = (
            f"{wires.measurement} = {point.measurement:g} {unit} is given for an operating point whose states make it {found:g} {unit}; "
            "give a point of rest, from find_trim() for example"
        )
        raise InvalidInputError(message, given=point.measurement, found=found)
    return loop, record


def _narrower(controller: PidController, limits: Limits) -> Limits:
    return Limits(max(limits.low, controller.low), min(limits.high, controller.high))


def _states(controller: PidController, measurement: float) -> list[float]:
    """States of a controller at rest."""
    return [0.0, filter_state(controller, measurement)] if controller.extras else [0.0]


def close_loop(plant: DelaySystem, point: OperatingPoint, law: AnyPid, *, wires: LoopSignals, limits: Limits) -> DelaySystem:
    """Make one system of a plant and a controller that holds it at a point of rest; the command is its last input.

    Raises:
        InvalidInputError: signals are missing or units differ, the controller samples or has no continuous form, or the limits exclude
            the trim.
    """
    index_of(plant.inputs, wires.drive)
    if wires.drive not in point.inputs:
        message = f"the operating point has no value for {wires.drive}, which the controller drives; it has {', '.join(point.inputs)}"
        raise InvalidInputError(message, name=wires.drive)
    controller, bias = continuous_law(law), point.inputs[wires.drive]
    if controller.extras:
        bounded = replace(controller, low=limits.low, high=limits.high)
        system = continuous_pid(bounded, bias=bias, measurement=point.measurement)
    else:
        system = pid_system(controller.gains, bias=bias, low=limits.low, high=limits.high)
    return connect(
        plant,
        system,
        to_first={wires.drive: "control"},
        to_second={"measurement": wires.measurement, "measurement_rate": wires.measurement_rate},
        name=f"{plant.name} with pid",
    )


def run_linear_loop(model: TransferFunction, law: AnyPid, task: LoopTask, *, name: str, base: tuple[float, float] = (0.0, 0.0)) -> LoopRun:
    """Close a loop around a linear model, its delay exact: simulated through its channel, or by formula without delay.

    Args:
        model: strictly proper.
        law: gains alone, or a continuous controller; its limits are those of the input itself, so that the base must be the trim's.
        task: what is asked; the step is divided where the model asks for it, the samples stay where they were asked for.
        name: of the model, for people.
        base: input and output at the trim that the model belongs to.

    Raises:
        InvalidInputError: the model is not strictly proper, its units are not the controller's, its delay is too short to be
            simulated for so long, or it has none and the controller limits or a dead zone, for which there is no formula.
        NotSettledError: the record is too short to tell how the loop ends.
    """
    controller = continuous_law(law)
    gains, limits = controller.gains, Limits(controller.low, controller.high)
    record = _record_linear_loop(model, replace(controller, low=limits.low - base[0], high=limits.high - base[0]), task)
    terms = record.trace.terms if len(record.trace.terms) else _rational_terms(model, controller, task.command, record.trace)
    trace = record.trace._replace(output=record.trace.output + base[1], control=record.trace.control + base[0], terms=terms)
    frame = LoopFrame(name, gains, describe_form(controller), limits, start=base[1], rest=base[0])
    run = judge_loop(frame, task, LoopRecord(trace, record.failure))
    if gains.kp == gains.ki == 0.0:  # the command reaches nothing
        return run
    if run.windup[-1] != 0.0:
        return run
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = form_loop(model, law).static_gain
    spare = controller.dead_zone
    return refuse_creep(run, base[1] + rest * task.command, task.criteria, spare=spare) if math.isfinite(rest) else run


def trace_linear_loop(model: TransferFunction, law: AnyPid, task: LoopTask) -> LoopTrace:
    """Answer of a closed loop around a linear model to a step of its command, relative to the trim; see `run_linear_loop`.

    Raises:
        InvalidInputError: as for `run_linear_loop`.
        DivergedError: the loop grows beyond the range of numbers.
    """
    record = _record_linear_loop(model, continuous_law(law), task)
    if record.failure is not None:
        raise record.failure
    return record.trace


def _record_linear_loop(model: TransferFunction, controller: PidController, task: LoopTask) -> LoopRecord:
    if task.loads:
        message = f"a linear model has no input but {model.input_name}; a load is stepped on an engine"
        raise InvalidInputError(message)
    limits = Limits(controller.low, controller.high)
    if model.delay == 0.0:
        if limits != Limits() or controller.dead_zone > 0.0:
            message = (
                "the loop of a model without delay is computed by formula, in which limits and a dead zone have no place; leave them out "
                "of the file, or run the controller sampled"
            )
            raise InvalidInputError(message)
        return LoopRecord(_trace_rational(model, controller, task), None)
    plant = linear_plant(model)
    rest = OperatingPoint(states=np.zeros(len(plant.states)), inputs={OF_LINEAR_MODEL.drive: 0.0}, measurement=0.0)
    loop = close_loop(plant, rest, controller, wires=OF_LINEAR_MODEL, limits=limits)
    start = Start(states=np.zeros(len(loop.states)), inputs=loop.input_vector({}))
    mesh = Mesh(task.until, task.step, math.ceil(task.step / min(step_limit(model), _step_limit(controller))))
    return simulate_loop(loop, start, task.command, mesh, measured=0)


def _step_limit(controller: PidController) -> float:
    """Longest step that the filter and back-calculation stand, in seconds."""
    times = (controller.filter_time, controller.tracking_time or 0.0)
    return min((0.25 * time for time in times if time > 0.0), default=math.inf)


def _trace_rational(model: TransferFunction, controller: PidController, task: LoopTask) -> LoopTrace:
    to_output, to_control = closed_loop_transfer(model, controller), closed_loop_transfer_to_control(model, controller)
    growth = float(np.max(to_output.poles.real, initial=0.0))
    until = min(task.until, LARGEST_EXPONENT / growth) if growth > 0.0 else task.until
    check_steps(Mesh(until, task.step))
    times: Floats = task.step * np.arange(math.floor(until / task.step + 1e-9) + 1, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        output, control = (task.command * answer for answer in step_responses((to_output, to_control), times))
    return keep_finite(LoopTrace(times=times, output=output, control=control, terms=np.empty((0, 3)), step=0.0))


def _rational_terms(model: TransferFunction, controller: PidController, command: float, trace: LoopTrace) -> Floats:
    """Proportional, integral and derivative term of a loop by formula, shape (n, 3); the integral is the answer of ki (1 - T)/s."""
    gains, closed = controller.gains, closed_loop_transfer(model, controller)
    proportional = gains.kp * (controller.setpoint_weight * command - trace.output)
    integral = np.zeros(trace.times.size)
    if gains.ki != 0.0:
        error = np.array(closed.denominator)
        error[: len(closed.numerator)] -= closed.numerator
        grown = replace(closed, numerator=tuple((gains.ki * error[1:]).tolist()), output_unit=gains.output_unit)
        integral = command * grown.step_response(trace.times)
    return np.column_stack([proportional, integral, trace.control - proportional - integral])
