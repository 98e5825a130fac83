"""The sampled form of the PID controller: its equations, once, for simulation and for exported code.

The integral is summed with the present error (backward), the derivative is filtered (backward difference); every operation is
+ - * / or a limit, so that a computer that rounds as IEEE 754 says gives the same bits.

Source: Astrom and Hagglund (2006), Advanced PID Control, section 13.4; Astrom and Wittenmark (1997), Computer-Controlled Systems,
section 8.5.
"""

import functools
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, Continuous, PidController
from revline.equations import equation
from revline.errors import InvalidInputError, out_of_range
from revline.sampled import SampledController
from revline.system import Variable

Vector = tuple[float, ...]

ROUNDING_DOUBLE = 1.5 * 2.0**52
"""Added and taken away again, it leaves a double rounded to a whole number, halves to the even one."""

ROUNDING_SINGLE = 1.5 * 2.0**23
"""The same for a single precision number."""

LARGEST = 1e30
"""Numbers are kept within this, so that no product of finite ones is infinite."""

SHORTEST = 1e-9
"""Seconds that count as no time: what is not longer, infinite or no number adds nothing to the integral, and the derivative waits."""


class PidCode(NamedTuple):
    """Parameters of the sampled law; switches are 1 or 0."""

    kp: float
    ki: float
    kd: float
    setpoint_weight: float
    derivative_weight: float
    filter_time: float
    rest_output: float
    rest_command: float
    low: float
    high: float
    rate_limit: float
    clamping: float
    tracking_rate: float
    dead_zone: float
    measurement_quantised: float
    measurement_step: float
    output_quantised: float
    output_step: float
    hold_samples: float
    safe_output: float
    rounding: float


@equation
def limit(value: float, low: float, high: float) -> float:
    """Keep a value between limits."""
    return np.minimum(np.maximum(value, low), high)


@equation
def choose(switch: float, one: float, other: float) -> float:
    """One value where the switch is 1, the other where it is 0; both must be finite."""
    return switch * one + (1.0 - switch) * other


@equation
def quantise(switch: float, step: float, rounding: float, value: float) -> float:
    """Nearest multiple of a step where the switch is 1."""
    return choose(switch, step * ((value / step + rounding) - rounding), value)


@equation
def is_number(value: float) -> float:
    """1 for a finite number, 0 for infinity and what is no number."""
    return 1.0 + np.fmax(np.minimum(value * 0.0, 0.0), -1.0)


@equation
def trust(value: float, last: float) -> float:
    """The value where it is a finite number, else the last one that was."""
    return choose(is_number(value), np.fmin(np.fmax(value, -LARGEST), LARGEST), last)


@equation
def time_passed(seconds: float) -> tuple[float, float]:
    """Seconds since the sample before, and 1 where they are a finite time; none pass, and 0, where they are not."""
    period = np.fmax(is_number(seconds) * np.fmin(np.fmax(seconds, 0.0), LARGEST), SHORTEST)
    return period, np.fmin(period / SHORTEST - 1.0, 1.0)


@equation
def proportional_term(p: PidCode, command: float, error: float) -> float:
    """Proportional term; the weight acts on the command's distance from that at rest, so that at rest the term is none."""
    return p.kp * (error + (p.setpoint_weight - 1.0) * (command - p.rest_command))


@equation
def error_beyond(p: PidCode, command: float, measurement: float) -> float:
    """Error beyond the dead zone."""
    error = command - measurement
    return error - limit(error, -p.dead_zone, p.dead_zone)


@equation
def integral_bounds(p: PidCode, command: float, proportional: float) -> tuple[float, float]:
    """Range of the integral: what spans the output's limits with the present proportional term, or with that at rest, or lies between.

    At rest the other terms are none but for the set-point weight's. An integral beyond serves neither.
    """
    resting = proportional_term(p, command, 0.0)
    lowest, highest = np.minimum(proportional, resting), np.maximum(proportional, resting)
    return p.low - p.rest_output - highest, p.high - p.rest_output - lowest


@equation
def update(p: PidCode, xd: Vector, y: Vector, r: Vector, t: Vector) -> Vector:
    """One sample: new states, then the output and what it is made of."""
    integral, derivative, weighted_before, output_before, measurement_before, command_before, missing = xd
    period, timed = time_passed(t[0])
    good = is_number(y[0])
    trusted, command = trust(y[0], measurement_before), trust(r[0], command_before)
    measurement = quantise(p.measurement_quantised, p.measurement_step, p.rounding, trusted)
    error = error_beyond(p, command, measurement)
    proportional = proportional_term(p, command, error)
    weighted = p.derivative_weight * command - measurement
    slope = (p.filter_time * derivative + p.kd * (weighted - weighted_before)) / (p.filter_time + period)
    derivative = choose(timed, slope, derivative)

    low = np.maximum(p.low, output_before - p.rate_limit * period)
    high = np.minimum(p.high, output_before + p.rate_limit * period)
    before = p.rest_output + proportional + integral + derivative
    wish = good * (p.ki * period * error)
    step = choose(p.clamping, limit(wish, np.minimum(0.0, low - before), np.maximum(0.0, high - before)), wish)
    smallest, largest = integral_bounds(p, command, proportional)
    integral = limit(integral + step, smallest, largest)
    wanted = p.rest_output + proportional + integral + derivative
    allowed = limit(wanted, low, high)
    follow = np.minimum(p.tracking_rate * period, 1.0)  # a slow crank may sample more rarely than the tracking time
    integral = limit(integral + follow * (allowed - wanted), smallest, largest)

    missing = (1.0 - good) * np.minimum(missing + 1.0, p.hold_samples + 1.0)
    lost = limit(missing - p.hold_samples, 0.0, 1.0)
    kept = choose(lost, p.safe_output, allowed)
    output = limit(quantise(p.output_quantised, p.output_step, p.rounding, kept), p.low, p.high)
    return (
        integral, derivative, weighted, kept, trusted, command, missing,
        output, wanted, proportional, integral, derivative, measurement,
    )  # fmt: skip


@equation
def start(p: PidCode, y: Vector, r: Vector, u: Vector) -> Vector:
    """States from which the first output is the one given, and what the integral adds in one sample, where nothing moves.

    What is no number counts as rest: an output as that at rest, a command likewise, a measurement as the command; then nothing has been
    measured that could be held, and a first sample without a measurement gives the safe output.
    """
    command = trust(r[0], p.rest_command)
    trusted = trust(y[0], command)
    measurement = quantise(p.measurement_quantised, p.measurement_step, p.rounding, trusted)
    proportional = proportional_term(p, command, error_beyond(p, command, measurement))
    smallest, largest = integral_bounds(p, command, proportional)
    output = limit(trust(u[0], p.rest_output), p.low, p.high)
    integral = limit(output - p.rest_output - proportional, smallest, largest)
    missing = (1.0 - is_number(y[0])) * p.hold_samples
    return integral, 0.0, p.derivative_weight * command - measurement, output, trusted, command, missing


def sampled_pid(controller: PidController, *, output: float, measurement: float, rounding: float = ROUNDING_DOUBLE) -> SampledController:
    """Build the sampled form of a PID controller about a point of rest.

    Args:
        controller: with its limits and its sampling.
        output: at rest, in the output's unit: the trim's.
        measurement: at rest, in the measurement's unit.
        rounding: of the arithmetic that will run it, for quantisation; that of double precision by default.

    Raises:
        InvalidInputError: the controller is continuous, the limits exclude the point of rest, a value at rest is no finite number, or the
            limits are more quantisation steps apart than the arithmetic resolves.
    """
    gains = controller.gains
    if isinstance(controller.sampling, Continuous):
        message = "a continuous controller has no sampled form; give it a sampling, for example FixedRate(period=0.01)"
        raise InvalidInputError(message)
    for name, value, unit in (("output at rest", output, gains.output_unit), ("measurement at rest", measurement, gains.input_unit)):
        if not math.isfinite(value):
            raise out_of_range(name, value, unit, "the finite numbers", "give one")
    if not controller.low <= output <= controller.high:
        limits = f"the controller's limits {controller.low:g} to {controller.high:g} {gains.output_unit}"
        raise out_of_range("output at rest", output, gains.output_unit, limits, "widen the limits or choose another operating point")
    _check_resolution(controller, output, measurement, rounding)
    return _form(gains.output_unit, gains.input_unit).with_parameters(_code(controller, output, measurement, rounding))


@functools.lru_cache(maxsize=64)
def _form(drive: str, measured: str) -> SampledController:
    """The controller without parameters that mean anything: its equations are traced once for each pair of units."""
    return SampledController(
        name="pid",
        parameters=PidCode(*(1.0 for _ in PidCode._fields)),
        states=_states(drive, measured),
        measurements=(Variable(name="measurement", unit=measured, description="measured value"),),
        commands=(Variable(name="command", unit=measured, description="wanted value"),),
        outputs=_outputs(drive, measured),
        drives=1,
        update=update,
        start=start,
    )


def _code(controller: PidController, output: float, measurement: float, rounding: float) -> PidCode:
    """Parameters of the sampled law about a point of rest."""
    gains = controller.gains
    return PidCode(
        kp=gains.kp,
        ki=gains.ki,
        kd=gains.kd,
        setpoint_weight=controller.setpoint_weight,
        derivative_weight=controller.derivative_weight,
        filter_time=controller.filter_time,
        rest_output=output,
        rest_command=measurement,
        low=controller.low,
        high=controller.high,
        rate_limit=controller.rate_limit,
        clamping=float(controller.anti_windup is AntiWindup.CLAMPING),
        tracking_rate=1.0 / controller.tracking_time if controller.tracking_time is not None else 0.0,
        dead_zone=controller.dead_zone,
        measurement_quantised=float(controller.measurement_step > 0.0),
        measurement_step=controller.measurement_step or 1.0,
        output_quantised=float(controller.output_step > 0.0),
        output_step=controller.output_step or 1.0,
        hold_samples=float(controller.hold_samples),
        safe_output=output if controller.safe_output is None else controller.safe_output,
        rounding=rounding,
    )


def parameter_units(gains: PidGains) -> Mapping[str, str]:
    """Units of the parameters of `PidCode`, by name; those not named are numbers or switches.

    Args:
        gains: with the units of input and output.
    """
    drive, measured = gains.output_unit, gains.input_unit
    of_output = dict.fromkeys(("rest_output", "low", "high", "output_step", "safe_output"), drive)
    of_measurement = dict.fromkeys(("rest_command", "dead_zone", "measurement_step"), measured)
    others = {"filter_time": "s", "rate_limit": f"{drive}/s", "tracking_rate": "1/s", "hold_samples": "samples"}
    return MappingProxyType({**gains.gain_units, **of_output, **of_measurement, **others})


def _states(drive: str, measured: str) -> tuple[Variable, ...]:
    return (
        Variable(name="integral", unit=drive, description="integral term"),
        Variable(name="derivative", unit=drive, description="derivative term"),
        Variable(name="weighted_before", unit=measured, description="what the derivative acted on, a sample before"),
        Variable(name="output_before", unit=drive, description="output before its quantisation, a sample before"),
        Variable(name="measurement_before", unit=measured, description="last measurement that was a number"),
        Variable(name="command_before", unit=measured, description="last command that was a number"),
        Variable(name="missing", unit="1", description="samples without a measurement"),
    )


def _outputs(drive: str, measured: str) -> tuple[Variable, ...]:
    return (
        Variable(name="control", unit=drive, description="output"),
        Variable(name="control_wanted", unit=drive, description="output before its limits"),
        Variable(name="proportional", unit=drive, description="proportional term"),
        Variable(name="integral", unit=drive, description="integral term after anti-windup"),
        Variable(name="derivative", unit=drive, description="derivative term"),
        Variable(name="measurement_used", unit=measured, description="measurement after quantisation"),
    )


def _check_resolution(controller: PidController, output: float, measurement: float, rounding: float) -> None:
    """Refuse steps so fine that the arithmetic cannot count them."""
    unit = controller.gains
    reach = max(abs(bound) for bound in (controller.low, controller.high, output) if math.isfinite(bound))
    for name, step, value, symbol in (
        ("measurement step", controller.measurement_step, 10.0 * abs(measurement), unit.input_unit),
        ("output step", controller.output_step, reach, unit.output_unit),
    ):
        finest = value / (rounding / 3.0)
        if 0.0 < step < finest:
            raise out_of_range(name, step, symbol, f"{finest:.3g} {symbol} and above", "give a coarser one, or 0 for none")
