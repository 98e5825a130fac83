"""The continuous controller with weights, a filter, a dead zone and back-calculation, as a system.

Law, with e beyond the dead zone for the error, w = c command - y, and the limited output v of the wanted one u:

    u = bias + kp (e + (b - 1)(command - command at rest)) + I + D,   dI/dt = ki e + (v - u)/Tt
    D = kd (w - x)/Tf,   dx/dt = (w - x)/Tf,   or without a filter D = -kd dy/dt

The right-hand side is continuous, so that nothing is lost between steps. What jumps or has a memory of its own has no such form:
clamping, a limit of the rate, quantisation; those are refused, and run sampled.

Source: Astrom and Hagglund (2006), Advanced PID Control, sections 3.3 to 3.5.
"""

import math
from typing import NamedTuple

import numpy as np

from revline.design.controllers.pid_controller import AntiWindup, PidController, continuous_law
from revline.design.controllers.pid_system import controller_inputs, controller_outputs, emit
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]


class ContinuousPid(NamedTuple):
    """Parameters of the law; `ideal` is 1 where the derivative has no filter, whose rate is 0 then."""

    kp: float
    ki: float
    kd: float
    setpoint_weight: float
    derivative_weight: float
    filter_rate: float
    ideal: float
    tracking_rate: float
    dead_zone: float
    rest_command: float
    bias: float
    low: float
    high: float


@equation
def error_beyond(p: ContinuousPid, error: float) -> float:
    """Error beyond the dead zone."""
    return error - np.minimum(np.maximum(error, -p.dead_zone), p.dead_zone)


@equation
def proportional(p: ContinuousPid, u: Vector) -> float:
    """Proportional term; the weight acts on the command's distance from that at rest."""
    command, measurement, _ = u
    return p.kp * (error_beyond(p, command - measurement) + (p.setpoint_weight - 1.0) * (command - p.rest_command))


@equation
def derivative(p: ContinuousPid, x: Vector, u: Vector) -> float:
    """Derivative term: filtered, or of the measurement alone."""
    command, measurement, measurement_rate = u
    filtered = p.filter_rate * (p.derivative_weight * command - measurement - x[1])
    return p.kd * (filtered - p.ideal * measurement_rate)


@equation
def limited(p: ContinuousPid, wanted: float) -> float:
    """Output within its limits."""
    return np.minimum(np.maximum(wanted, p.low), p.high)


@equation
def rate(p: ContinuousPid, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The integral grows with the error and follows what the limits take away; the filter follows its input."""
    command, measurement, _ = u
    wanted = p.bias + proportional(p, u) + x[0] + derivative(p, x, u)
    growth = p.ki * error_beyond(p, command - measurement) + p.tracking_rate * (limited(p, wanted) - wanted)
    return growth, p.filter_rate * (p.derivative_weight * command - measurement - x[1])


@equation
def output(p: ContinuousPid, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Limited output, and the terms that it is made of."""
    of_error, of_rate = proportional(p, u), derivative(p, x, u)
    wanted = p.bias + of_error + x[0] + of_rate
    return limited(p, wanted), wanted, of_error, 1.0 * x[0], of_rate


def continuous_pid(controller: PidController, *, bias: float, measurement: float) -> DelaySystem:
    """Build a continuous controller as a system; it rests where its second state is `filter_state`.

    Args:
        controller: with the limits of its output, absolute.
        bias: output at rest: the trim's.
        measurement: at rest, which is the command there.

    Raises:
        InvalidInputError: the controller samples or has what no continuous form has, its limits exclude the bias, or a value at rest is
            not finite.
    """
    check_continuous(controller)
    gains, low, high = controller.gains, controller.low, controller.high
    if not (math.isfinite(bias) and math.isfinite(measurement) and low <= bias <= high):
        message = (
            f"the output at the trim, {bias:g} {gains.output_unit} at {measurement:g} {gains.input_unit}, lies outside the limits "
            f"{low:g} to {high:g} {gains.output_unit}"
        )
        raise InvalidInputError(message, bias=bias, low=low, high=high)
    filtered = controller.filter_time > 0.0
    return DelaySystem(
        name="pid",
        parameters=ContinuousPid(
            kp=gains.kp,
            ki=gains.ki,
            kd=gains.kd,
            setpoint_weight=controller.setpoint_weight,
            derivative_weight=controller.derivative_weight,
            filter_rate=1.0 / controller.filter_time if filtered else 0.0,
            ideal=0.0 if filtered else 1.0,
            tracking_rate=1.0 / controller.tracking_time if controller.tracking_time is not None else 0.0,
            dead_zone=controller.dead_zone,
            rest_command=measurement,
            bias=bias,
            low=low,
            high=high,
        ),
        states=(
            Variable(name="integral_term", unit=gains.output_unit, description="integral term"),
            Variable(name="derivative_filter", unit=gains.input_unit, description="what the derivative acts on, filtered"),
        ),
        inputs=controller_inputs(gains),
        channels=(),
        outputs=controller_outputs(gains),
        emit=emit,
        lags=emit,
        rate=rate,
        output=output,
    )


def filter_state(controller: PidController, measurement: float) -> float:
    """State of the derivative's filter at rest, where the command is the measurement."""
    return (controller.derivative_weight - 1.0) * measurement


def check_continuous(controller: PidController) -> None:
    """Refuse what a controller has that no continuous form has.

    Raises:
        InvalidInputError: it has; the message says what to do instead.
    """
    continuous_law(controller)
    jumps = (
        (math.isfinite(controller.rate_limit), "a rate limit"),
        (controller.measurement_step > 0.0, "a quantised measurement"),
        (controller.output_step > 0.0, "a quantised output"),
    )
    found = [text for there, text in jumps if there]
    if found:
        message = (
            f"the controller has {', '.join(found)}, which jumps or has a memory of its own and no exact continuous form; give it a "
            "sampling, in its file or with --period, or leave that out"
        )
        raise InvalidInputError(message)
    bounded = math.isfinite(controller.low) or math.isfinite(controller.high)
    if controller.anti_windup is AntiWindup.CLAMPING and bounded and controller.gains.ki != 0.0:
        message = (
            "anti-windup by clamping switches the integral on and off and has no exact continuous form; use back-calculation with a "
            "tracking_time_s, or give the controller a sampling, in its file or with --period"
        )
        raise InvalidInputError(message)
