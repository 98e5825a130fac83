"""The continuous PID controller as a system, so that a closed loop is a system too.

Law: u = bias + kp e + ki integral(e) dt - kd dy/dt, limited; e = command - y; no anti-windup, the integral starts at zero.
Source: Lee (1995), chapter 5, with the conventions that its closed loops are computed by.
"""

import math
from typing import NamedTuple

import numpy as np

from revline.analysis.linearize import rate_unit
from revline.design.controllers.controller import PidGains
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]


class PidParameters(NamedTuple):
    """Gains, the output at zero error, and the limits of the output."""

    kp: float
    ki: float
    kd: float
    bias: float
    low: float
    high: float


@equation
def control_terms(p: PidParameters, x: Vector, u: Vector) -> tuple[float, float, float]:
    """Proportional, integral and derivative term; the derivative acts on the measurement."""
    command, measurement, measurement_rate = u
    return p.kp * (command - measurement), p.ki * x[0], -p.kd * measurement_rate


@equation
def emit(p: PidParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Nothing is delayed."""
    return ()


@equation
def rate(p: PidParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The integral grows with the error."""
    command, measurement, _ = u
    return (command - measurement,)


@equation
def output(p: PidParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Limited output, and the terms that it is made of."""
    proportional, integral, derivative = control_terms(p, x, u)
    wanted = p.bias + proportional + integral + derivative
    return np.minimum(np.maximum(wanted, p.low), p.high), wanted, proportional, integral, derivative


def pid_system(gains: PidGains, *, bias: float, low: float = -math.inf, high: float = math.inf) -> DelaySystem:
    """Build a PID controller as a system.

    Args:
        gains: with their units.
        bias: output at zero error: the trim's.
        low: lower limit of the output, in its unit.
        high: upper limit.

    Raises:
        InvalidInputError: the limits exclude the bias, or the bias is not finite.
    """
    if not (math.isfinite(bias) and low <= bias <= high):
        message = f"the output at the trim, {bias:g} {gains.output_unit}, lies outside the limits {low:g} to {high:g} {gains.output_unit}"
        raise InvalidInputError(message, bias=bias, low=low, high=high)
    return DelaySystem(
        name="pid",
        parameters=PidParameters(gains.kp, gains.ki, gains.kd, bias, low, high),
        states=(Variable(name="error_integral", unit=_integral_unit(gains.input_unit), description="integral of the error"),),
        inputs=controller_inputs(gains),
        channels=(),
        outputs=controller_outputs(gains),
        emit=emit,
        lags=emit,
        rate=rate,
        output=output,
    )


def _integral_unit(unit: str) -> str:
    return unit.removesuffix("/s") if unit.endswith("/s") else f"{unit} s"


def controller_inputs(gains: PidGains) -> tuple[Variable, ...]:
    """What a continuous controller reads, in the units of its gains."""
    measurement = Variable(name="measurement", unit=gains.input_unit, description="measured value")
    return (
        Variable(name="command", unit=gains.input_unit, description="wanted value"),
        measurement,
        Variable(name="measurement_rate", unit=rate_unit(measurement), description="its rate of change"),
    )


def controller_outputs(gains: PidGains) -> tuple[Variable, ...]:
    """What a continuous controller gives, in the units of its gains: what drives, then what it is made of."""
    drive = gains.output_unit
    return (
        Variable(name="control", unit=drive, description="output after its limits"),
        Variable(name="control_wanted", unit=drive, description="output before its limits"),
        Variable(name="proportional", unit=drive, description="proportional term"),
        Variable(name="integral", unit=drive, description="integral term"),
        Variable(name="derivative", unit=drive, description="derivative term"),
    )
