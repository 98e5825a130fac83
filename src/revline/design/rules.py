"""Tuning rules for PI and PID controllers, as functions and as a table for the command line.

A new rule is one function and one entry in `TUNING_RULES`, with its tests.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from revline.design.controller import PidGains
from revline.design.fine_tuning import Objective, fine_tune
from revline.design.step_tangent import StepTangent, TangentReading, measure_step_tangent
from revline.errors import InvalidInputError, out_of_range
from revline.lti.transfer_function import TransferFunction
from revline.units import Dimensionless, RadiansPerSecond

Tangent = StepTangent | TangentReading

RuleValue = float | str | PidGains
"""What an option of a rule may be: a number, a text, or the gains to begin from."""


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
        ki=natural_frequency**2 * lag / gain,
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


def _tune_finely(plant: TransferFunction, options: Mapping[str, RuleValue], name: str) -> PidGains:
    """Fine tuning from given gains, else from those of Ziegler and Nichols; the details say what was minimised, from where to where."""
    start = options.get("start")
    if not isinstance(start, PidGains):
        start = tune_pid_ziegler_nichols(measure_step_tangent(plant), designed_on=name)
    wish = str(options.get("objective", Objective.SETPOINT_ERROR.value))
    if wish not in {objective.value for objective in Objective}:
        message = f"fine-tuning knows no objective {wish!r}; it minimises {' or '.join(objective.value for objective in Objective)}"
        raise InvalidInputError(message, objective=wish)
    tuned = fine_tune(
        plant,
        start,
        overshoot_limit=_number(options, "overshoot_limit", 0.1),
        free=tuple(gain.strip() for gain in str(options.get("free", "ki")).split(",")),
        objective=Objective(wish),
        until=_number(options, "horizon", 4.0),
    )
    origin: dict[str, float | str] = {"start_rule": start.rule, "start_kp": start.kp, "start_ki": start.ki, "start_kd": start.kd}
    outcome: dict[str, float | str] = {"overshoot": tuned.overshoot, "objective": wish, "summary": tuned.text}
    return replace(tuned.gains, designed_on=name, details={**tuned.gains.details, **origin, **outcome})


def _number(options: Mapping[str, RuleValue], name: str, default: float = math.nan) -> float:
    """An option that is a number."""
    value = options.get(name, default)
    if not isinstance(value, float | int):
        message = f"option {name} = {value!r} is no number; give one"
        raise InvalidInputError(message, option=name)
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleOption:
    """What a rule asks for besides the plant.

    Attributes:
        name: with underscores, as in the rule's function.
        unit: its unit symbol; of what is no number, what it is.
        description: a few words for people.
        default: what holds where it is not given, in words; empty where it must be given.
    """

    name: str
    unit: str
    description: str
    default: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningRule:
    """A tuning rule as data.

    Attributes:
        name: as the command line knows it.
        summary: what it does, in a line.
        source: author, year and place.
        options: what it asks for besides the plant.
        tune: from plant, options by name and the plant's name to gains.
    """

    name: str
    summary: str
    source: str
    options: tuple[RuleOption, ...]
    tune: Callable[[TransferFunction, Mapping[str, RuleValue], str], PidGains]


TUNING_RULES: Final = (
    TuningRule(
        name="pole-placement",
        summary="PI for a lag of first order without delay: closed-loop poles of given natural frequency and damping ratio",
        source="Astrom and Hagglund (2006), Advanced PID Control, section 6.4",
        options=(
            RuleOption(name="natural_frequency", unit="rad/s", description="natural frequency of the closed loop"),
            RuleOption(name="damping", unit="1", description="damping ratio of the closed loop"),
        ),
        tune=lambda plant, options, name: tune_pi_pole_placement(
            plant, natural_frequency=_number(options, "natural_frequency"), damping=_number(options, "damping"), designed_on=name
        ),
    ),
    TuningRule(
        name="ziegler-nichols",
        summary="PID from the tangent to the step response, kp = 1.2 T/(K L)",
        source="Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768",
        options=(),
        tune=lambda plant, _, name: tune_pid_ziegler_nichols(measure_step_tangent(plant), designed_on=name),
    ),
    TuningRule(
        name="ziegler-nichols-without-gain",
        summary="as Lee (1995) prints it, kp = 1.2 T/L: forgets the plant's gain K, so K times too hot; to repeat that work only",
        source="Lee (1995), chapter 5",
        options=(),
        tune=lambda plant, _, name: tune_pid_ziegler_nichols_without_gain(measure_step_tangent(plant), designed_on=name),
    ),
    TuningRule(
        name="fine-tuning",
        summary="gains set free, moved from a start to the least error after a step under a limit on overshoot, the delay exact",
        source="after Lee (1995), section 5.3; Nelder and Mead (1965), The Computer Journal 7(4), 308-313",
        options=(
            RuleOption(name="start", unit="file", description="controller file to begin from", default="the gains of ziegler-nichols"),
            RuleOption(name="free", unit="names", description="gains set free, of kp,ki,kd", default="ki"),
            RuleOption(name="overshoot_limit", unit="1", description="largest overshoot, as a fraction of the command", default="0.1"),
            RuleOption(name="objective", unit="name", description="what is minimised", default="setpoint-error"),
            RuleOption(name="horizon", unit="s", description="time over which loops are judged", default="4"),
        ),
        tune=_tune_finely,
    ),
)


def find_tuning_rule(name: str) -> TuningRule:
    """Look a rule up by name.

    Raises:
        InvalidInputError: there is none; the message lists those there are.
    """
    for rule in TUNING_RULES:
        if rule.name == name:
            return rule
    message = f"there is no tuning rule {name!r}; there are {', '.join(rule.name for rule in TUNING_RULES)}"
    raise InvalidInputError(message, rule=name)


def tune_by_rule(name: str, plant: TransferFunction, *, options: Mapping[str, RuleValue], designed_on: str) -> PidGains:
    """Tune a controller by a rule of the table.

    Args:
        name: of the rule.
        plant: the model to tune for.
        options: what the rule asks for, by name.
        designed_on: name of the plant, kept with the gains.

    Raises:
        InvalidInputError: there is no such rule, an option is missing or unknown, or the rule refuses the plant or an option.
        NotConvergedError: fine tuning finds no gains that do; see `fine_tune`.
    """
    rule = find_tuning_rule(name)
    wanted = {option.name: option for option in rule.options}
    missing = [option for key, option in wanted.items() if key not in options and not option.default]
    if missing:
        message = f"tuning rule {name} needs {', '.join(f'{o.name} [{o.unit}] ({o.description})' for o in missing)}; give it"
        raise InvalidInputError(message, rule=name)
    unknown = sorted(set(options) - set(wanted))
    if unknown:
        message = f"tuning rule {name} knows no option {', '.join(unknown)}; it takes {', '.join(wanted) or 'none'}"
        raise InvalidInputError(message, rule=name)
    return rule.tune(plant, options, designed_on)
