"""Tuning rules from a step response's tangent, and by pole placement for a lag: those of the thesis, and the original beside them."""

import math

from revline.design.controllers.controller import PidGains
from revline.design.tuning.step_tangent import StepTangent, TangentReading
from revline.errors import InvalidInputError, out_of_range
from revline.lti.transfer_function import TransferFunction
from revline.units import Dimensionless, RadiansPerSecond

Tangent = StepTangent | TangentReading


def tune_pi_pole_placement(
    plant: TransferFunction, *, natural_frequency: RadiansPerSecond, damping: Dimensionless, designed_on: str = "a first-order lag"
) -> PidGains:
    """Tune a PI controller so that a lag of first order and it have given closed-loop poles.

    With K/(T s + 1) the closed loop's denominator is s^2 + (1 + K kp)/T s + K ki/T; the rule sets it to s^2 + 2 zeta wn s + wn^2.

    Args:
        plant: first order, without zero and without delay.
        natural_frequency: wn wanted.
        damping: zeta wanted.
        designed_on: name of the plant, kept with the gains.

    Raises:
        InvalidInputError: the plant is of another form, or a wish is out of range.

    Source:
        Astrom and Hagglund (2006), Advanced PID Control, section 6.4; used so by Lee (1995), chapter 5.

    Example:
        >>> plant = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.5))
        >>> gains = tune_pi_pole_placement(plant, natural_frequency=4.0, damping=1.0)
        >>> gains.kp, gains.ki
        (1.5, 4.0)
    """
    for name, value, unit in (("natural frequency", natural_frequency, "rad/s"), ("damping ratio", damping, "")):
        if not (math.isfinite(value) and value > 0.0):
            raise out_of_range(name, value, unit, "the positive numbers", "give a positive one")
    if plant.order != 1 or plant.denominator[0] == 0.0 or len(plant.numerator) != 1 or plant.numerator[0] == 0.0:
        message = (
            f"pole placement for PI needs a plant K/(T s + 1); this one has {plant.order} poles and {len(plant.zeros)} "
            "zeros, or a pole at s = 0; fit a model with one pole and no zero"
        )
        raise InvalidInputError(message, order=plant.order)
    if plant.delay != 0.0:
        message = (
            f"pole placement for PI needs a plant without delay; this one has {plant.delay:g} s, under which the poles would not be "
            "those asked for; use a rule that counts the delay"
        )
        raise InvalidInputError(message, delay=plant.delay)
    gain, lag = plant.numerator[0], plant.denominator[1]
    turn = 2.0 * damping * natural_frequency * lag
    if lag > 0.0 and turn <= 1.0:
        message = (
            f"2 zeta wn = {turn / lag:g} rad/s is not above the plant's own 1/T = {1.0 / lag:g} rad/s, so kp would work "
            "against the command; ask for a higher natural frequency or damping ratio"
        )
        raise InvalidInputError(message, wanted=turn / lag, own=1.0 / lag)
    return PidGains(
        kp=(turn - 1.0) / gain,
        ki=natural_frequency * natural_frequency * lag / gain,
        kd=0.0,
        input_unit=plant.output_unit,
        output_unit=plant.input_unit,
        rule="pole-placement",
        designed_on=designed_on,
        details={"natural_frequency_rad_s": natural_frequency, "damping_ratio": damping},
    )


def tune_pid_ziegler_nichols(tangent: Tangent, *, designed_on: str = "a step response") -> PidGains:
    """Tune a PID controller from a step response by the rule of Ziegler and Nichols.

    With dead time L, rise time T and static gain K: kp = 1.2 T/(K L), integral time 2 L, derivative time L/2.

    Args:
        tangent: of the plant's unit step response, measured or read off a plot.
        designed_on: name of the plant, kept with the gains.

    Raises:
        InvalidInputError: the tangent has no dead time.

    Source:
        Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.

    Example:
        >>> gains = tune_pid_ziegler_nichols(TangentReading(dead_time=0.25, rise_time=1.0, final_value=4.0))
        >>> round(gains.kp, 12), round(gains.ki, 12), round(gains.kd, 12)
        (1.2, 2.4, 0.15)
    """
    reading = _reading(tangent, "ziegler-nichols")
    kp = 1.2 * reading.rise_time / (reading.final_value * reading.dead_time)
    return _ziegler_nichols(reading, kp, "ziegler-nichols", designed_on)


def tune_pid_ziegler_nichols_without_gain(tangent: Tangent, *, designed_on: str = "a step response") -> PidGains:
    """Tune a PID controller by the rule as Lee (1995) prints it, which forgets the plant's gain: kp = 1.2 T/L.

    It is here to repeat that work. Where the static gain K is not 1 its gains are K times those of Ziegler and Nichols.

    Args:
        tangent: of the plant's unit step response, measured or read off a plot.
        designed_on: name of the plant, kept with the gains.

    Raises:
        InvalidInputError: the tangent has no dead time.

    Source:
        Lee (1995), chapter 5; after Ziegler and Nichols (1942).
    """
    reading = _reading(tangent, "ziegler-nichols-without-gain")
    return _ziegler_nichols(reading, 1.2 * reading.rise_time / reading.dead_time, "ziegler-nichols-without-gain", designed_on)


def _reading(tangent: Tangent, rule: str) -> TangentReading:
    """Take the numbers of a tangent, and refuse one without dead time."""
    if not tangent.dead_time > 0.0:
        message = (
            f"{rule} needs a dead time; the tangent crosses zero at {tangent.dead_time:g} s, as that of a lag of first order without "
            "delay does, and the gains would be infinite; use pole placement, or a model of second order or with delay"
        )
        raise InvalidInputError(message, dead_time=tangent.dead_time)
    return tangent.reading if isinstance(tangent, StepTangent) else tangent


def _ziegler_nichols(tangent: TangentReading, kp: float, rule: str, designed_on: str) -> PidGains:
    return PidGains(
        kp=kp,
        ki=kp / (2.0 * tangent.dead_time),
        kd=kp * tangent.dead_time / 2.0,
        input_unit=tangent.output_unit,
        output_unit=tangent.input_unit,
        rule=rule,
        designed_on=designed_on,
        details={"dead_time_s": tangent.dead_time, "rise_time_s": tangent.rise_time, "static_gain": tangent.final_value},
    )
