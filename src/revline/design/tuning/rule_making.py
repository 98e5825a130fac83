"""What makes a tuning rule of a function: its plant read, its options checked, its gains with their origin."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, PidController
from revline.design.controllers.pid_forms import ParallelForm
from revline.design.tuning import rules_lag as lags
from revline.design.tuning.fine_tuning import Objective, fine_tune
from revline.design.tuning.rules_step import tune_pid_ziegler_nichols
from revline.design.tuning.tuning_plant import LagReading, TuningPlant, reduce_by_half_rule
from revline.design.tuning.ultimate import UltimatePoint, UltimateSource
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction

RuleValue = float | str | PidGains
"""What an option of a rule may be: a number, a text, or the gains to begin from."""

Options = Mapping[str, RuleValue]
Details = dict[str, float | str]


def tune_finely(plant: TuningPlant, options: Mapping[str, RuleValue]) -> PidGains:
    """Fine tuning from given gains, else from those of Ziegler and Nichols; the details say what was minimised, from where to where."""
    start = options.get("start")
    if not isinstance(start, PidGains):
        start = tune_pid_ziegler_nichols(plant.tangent, designed_on=plant.name)
    wish = str(options.get("objective", Objective.SETPOINT_ERROR.value))
    if wish not in {objective.value for objective in Objective}:
        message = f"fine-tuning knows no objective {wish!r}; it minimises {' or '.join(objective.value for objective in Objective)}"
        raise InvalidInputError(message, objective=wish)
    tuned = fine_tune(
        plant.model,
        start,
        overshoot_limit=number_option(options, "overshoot_limit", 0.1),
        free=tuple(gain.strip() for gain in str(options.get("free", "ki")).split(",")),
        objective=Objective(wish),
        until=number_option(options, "horizon", 4.0),
    )
    origin: dict[str, float | str] = {"start_rule": start.rule, "start_kp": start.kp, "start_ki": start.ki, "start_kd": start.kd}
    outcome: dict[str, float | str] = {"overshoot": tuned.overshoot, "objective": wish, "summary": tuned.text}
    return replace(tuned.gains, designed_on=plant.name, details={**tuned.gains.details, **origin, **outcome})


def number_option(options: Mapping[str, RuleValue], name: str, default: float = math.nan) -> float:
    """An option that is a number."""
    value = options.get(name, default)
    if not isinstance(value, float | int):
        message = f"option {name} = {value!r} is no number; give one"
        raise InvalidInputError(message, option=name)
    return value


def recommended_controller(gains: PidGains) -> PidGains | PidController:
    """Give what a rule recommends: its gains, with its set-point weight where it has one other than 1.

    Args:
        gains: made by a rule.
    """
    weight = float(gains.details.get("setpoint_weight", 1.0))
    return gains if weight == 1.0 else PidController(gains=gains, setpoint_weight=weight, anti_windup=AntiWindup.NONE)


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
        validity: which plants it is for; others are refused.
        options: what it asks for besides the plant.
        tune: from plant and options by name to gains.
    """

    name: str
    summary: str
    source: str
    validity: str
    options: tuple[RuleOption, ...]
    tune: Callable[[TuningPlant, Options], PidGains]


READING: Final = RuleOption(name="reading", unit="name", description="how the lag is read: tangent or 63", default="tangent")
CLOSED_LOOP_LAG: Final = RuleOption(
    name="closed_loop_lag", unit="s", description="lag wanted in closed loop", default="the effective delay"
)
ULTIMATE: Final = (
    RuleOption(name="ultimate_gain", unit="output/input", description="measured, with its period", default="the exact model's"),
    RuleOption(name="ultimate_period", unit="s", description="measured, with its gain", default="the exact model's"),
)
"""What several rules ask for."""

STEP_RANGE: Final = "stable plants with a delay, up to the lag: 0 < L/T <= 1"
ULTIMATE_RANGE: Final = "plants that a proportional gain makes oscillate"


def _gains(plant: TuningPlant, rule: str, form: ParallelForm, details: Details) -> PidGains:
    return PidGains(
        kp=form.kp,
        ki=form.ki,
        kd=form.kd,
        input_unit=plant.output_unit,
        output_unit=plant.input_unit,
        rule=rule,
        designed_on=plant.name,
        details=details,
    )


def tune_ziegler_nichols(plant: TuningPlant, _: Options) -> PidGains:
    """PID of Ziegler and Nichols from the tangent, for dead times up to its rise time."""
    tangent = plant.tangent
    gains = tune_pid_ziegler_nichols(tangent, designed_on=plant.name)
    lags.require_short_delay(lags.Lag(plant.static_gain, tangent.rise_time, tangent.dead_time), gains.rule)
    return gains


def from_lag(rule: str, tune: Callable[[lags.Lag], ParallelForm]) -> Callable[[TuningPlant, Options], PidGains]:
    """Make a rule of a function of a lag with delay, which is read from the step response."""

    def apply(plant: TuningPlant, options: Options) -> PidGains:
        lag, details = _lag(plant, options)
        return _gains(plant, rule, tune(lag), details)

    return apply


def from_weighted_lag(rule: str, tune: Callable[[lags.Lag], lags.Weighted]) -> Callable[[TuningPlant, Options], PidGains]:
    """The same of a rule that recommends a set-point weight, and whose lag is read at 63.2 %."""

    def apply(plant: TuningPlant, options: Options) -> PidGains:
        lag, details = _lag(plant, options, LagReading.SHARE)
        found = tune(lag)
        return _gains(plant, rule, found.gains, {**details, "setpoint_weight": found.setpoint_weight})

    return apply


def _lag(plant: TuningPlant, options: Options, usual: LagReading = LagReading.TANGENT) -> tuple[lags.Lag, Details]:
    """Lag with delay of a plant, and what it is like."""
    wish = str(options.get("reading", usual.value))
    if wish not in {reading.value for reading in LagReading}:
        message = f"there is no reading {wish!r} of a step response; there are {', '.join(reading.value for reading in LagReading)}"
        raise InvalidInputError(message, reading=wish)
    found = plant.lag(LagReading(wish))
    details: Details = {
        "static_gain": found.gain,
        "lag_s": found.lag,
        "delay_s": found.delay,
        "reading": found.reading.value,
        "largest_step_difference": found.largest_difference,
    }
    return lags.Lag(found.gain, found.lag, found.delay), details


def from_ultimate(rule: str, tune: Callable[[UltimatePoint], ParallelForm]) -> Callable[[TuningPlant, Options], PidGains]:
    """Make a rule of a function of the ultimate point."""

    def apply(plant: TuningPlant, options: Options) -> PidGains:
        point = _ultimate(plant, options)
        details: Details = {"ultimate_gain": point.gain, "ultimate_period_s": point.period, "ultimate_source": point.source.value}
        return _gains(plant, rule, tune(point), details)

    return apply


def _ultimate(plant: TuningPlant, options: Options) -> UltimatePoint:
    """The ultimate point that is given, else the exact one."""
    given = [name for name in ("ultimate_gain", "ultimate_period") if name in options]
    if len(given) == 1:
        message = f"{given[0]} alone is half an ultimate point; give ultimate_gain and ultimate_period, or neither for the exact ones"
        raise InvalidInputError(message)
    if not given:
        return plant.ultimate
    gain, period = number_option(options, "ultimate_gain"), number_option(options, "ultimate_period")
    return UltimatePoint(gain=gain, period=period, source=UltimateSource.GIVEN)


def tune_simc(plant: TuningPlant, options: Options, order: int) -> PidGains:
    """SIMC from the half rule where the plant is a transfer function, else from the lag that its step response is like."""
    second = 0.0
    if isinstance(plant.plant, TransferFunction):
        gain, lag, second, delay = reduce_by_half_rule(plant.model, order=order)
        details: Details = {"static_gain": gain, "lag_s": lag, "second_lag_s": second, "delay_s": delay, "reading": "half rule"}
        found = lags.Lag(gain, lag, delay)
    else:
        found, details = _lag(plant, options)
    wish = number_option(options, "closed_loop_lag", found.delay)
    form = lags.tune_pi_simc(found, closed_loop_lag=wish) if order == 1 else lags.tune_pid_simc(found, second, closed_loop_lag=wish)
    return _gains(plant, "simc-pi" if order == 1 else "simc", form, {**details, "closed_loop_lag_s": wish})


def tune_lambda(plant: TuningPlant, options: Options) -> PidGains:
    """Lambda tuning from the lag that the step response is like."""
    lag, details = _lag(plant, options)
    wish = number_option(options, "closed_loop_lag", lag.lag)
    return _gains(plant, "lambda", lags.tune_pi_lambda(lag, closed_loop_lag=wish), {**details, "closed_loop_lag_s": wish})
