"""Closed loops whose gains are all multiplied by one factor, which is an input of the loop: what is needed to follow how cycles begin.

Law: u = bias + f (kp e + ki integral(e) dt - kd dy/dt), limited; with f = 1 that of `revline.design.controllers.pid_system`. Without
integral action there is no integral among the states, which would not be periodic.
"""

import math

import numpy as np

from revline.analysis.linearize import rate_unit
from revline.connection import connect
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_system import PidParameters
from revline.design.loops.closed_loop import Limits
from revline.design.plants.loop_signals import LoopSignals, OperatingPoint
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable, index_of

Vector = tuple[float, ...]

FACTOR = "gain_factor"
"""Name of the input that multiplies all gains; it is the last one of the loop, the command the one before."""


@equation
def nothing(p: PidParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Nothing is delayed, or changes."""
    return ()


@equation
def error_rate(p: PidParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The integral grows with the error."""
    return (u[0] - u[1],)


@equation
def limited(p: PidParameters, wanted: float) -> Vector:
    """Keep within the limits."""
    return (np.minimum(np.maximum(wanted, p.low), p.high),)


@equation
def output(p: PidParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Limited output with integral action."""
    command, measurement, measurement_rate, factor = u
    return limited(p, p.bias + factor * (p.kp * (command - measurement) + p.ki * x[0] - p.kd * measurement_rate))


@equation
def output_without_integral(p: PidParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Limited output without integral action."""
    command, measurement, measurement_rate, factor = u
    return limited(p, p.bias + factor * (p.kp * (command - measurement) - p.kd * measurement_rate))


def close_ray(plant: DelaySystem, point: OperatingPoint, gains: PidGains, *, wires: LoopSignals, limits: Limits) -> DelaySystem:
    """Make one system of a plant and a controller all of whose gains are multiplied by its last input; the command is the one before.

    Raises:
        InvalidInputError: signals are missing, units differ, the limits exclude the operating point, or all gains are 0.
    """
    if gains.kp == gains.ki == gains.kd == 0.0:
        raise InvalidInputError("all gains are 0: there is no loop that could hunt; give a controller that acts")
    index_of(plant.inputs, wires.drive)
    bias = point.inputs[wires.drive]
    if not limits.low <= bias <= limits.high:
        unit = gains.output_unit
        message = (
            f"{wires.drive} at the trim, {bias:g} {unit}, lies outside the limits {limits.low:g} to {limits.high:g} {unit}; widen them"
        )
        raise InvalidInputError(message, bias=bias)
    unit = gains.input_unit
    measurement = Variable(name="measurement", unit=unit)
    integral = Variable(name="error_integral", unit=f"{unit} s")
    controller = DelaySystem(
        name="controller",
        parameters=PidParameters(gains.kp, gains.ki, gains.kd, bias, limits.low, limits.high),
        states=(integral,) if gains.ki else (),
        inputs=(
            Variable(name="command", unit=unit),
            measurement,
            Variable(name="measurement_rate", unit=rate_unit(measurement)),
            Variable(name=FACTOR, unit="1", low=-math.inf, nominal=1.0),
        ),
        channels=(),
        outputs=(Variable(name="control", unit=gains.output_unit),),
        emit=nothing,
        lags=nothing,
        rate=error_rate if gains.ki else nothing,
        output=output if gains.ki else output_without_integral,
    )
    return connect(
        plant,
        controller,
        to_first={wires.drive: "control"},
        to_second={"measurement": wires.measurement, "measurement_rate": wires.measurement_rate},
        name=f"{plant.name} with controller",
    )
