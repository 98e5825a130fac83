"""Tuning rules for PI and PID controllers as a table: what each needs, its range, its source.

A new rule is one function and one entry in `TUNING_RULES`, with its tests.
"""

from dataclasses import replace
from typing import Final

from revline.design.controllers.controller import PidGains
from revline.design.tuning import rule_making as making
from revline.design.tuning import rules_lag as lags
from revline.design.tuning import rules_ultimate as ultimates
from revline.design.tuning.rule_making import (
    CLOSED_LOOP_LAG,
    READING,
    STEP_RANGE,
    ULTIMATE,
    ULTIMATE_RANGE,
    Options,
    RuleOption,
    TuningRule,
)
from revline.design.tuning.rules_step import tune_pi_pole_placement, tune_pid_ziegler_nichols_without_gain
from revline.design.tuning.tuning_plant import TuningPlant, tuning_plant
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction

ZIEGLER_NICHOLS: Final = "Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768"
COHEN_COON: Final = "Cohen and Coon (1953), Transactions of the ASME 75, 827-834"
SKOGESTAD: Final = "Skogestad (2003), Journal of Process Control 13(4), 291-309"
ADVANCED_PID: Final = "Astrom and Hagglund (2006), Advanced PID Control"

TUNING_RULES: Final = (
    TuningRule(
        name="pole-placement",
        summary="PI for a lag of first order without delay: closed-loop poles of given natural frequency and damping ratio",
        source=f"{ADVANCED_PID}, section 6.4",
        validity="lags of first order without delay",
        options=(
            RuleOption(name="natural_frequency", unit="rad/s", description="natural frequency of the closed loop"),
            RuleOption(name="damping", unit="1", description="damping ratio of the closed loop"),
        ),
        tune=lambda plant, options: tune_pi_pole_placement(
            plant.model,
            natural_frequency=making.number_option(options, "natural_frequency"),
            damping=making.number_option(options, "damping"),
            designed_on=plant.name,
        ),
    ),
    TuningRule(
        name="ziegler-nichols",
        summary="PID from the tangent to the step response, kp = 1.2 T/(K L)",
        source=ZIEGLER_NICHOLS,
        validity="stable plants whose tangent has a dead time, up to its rise time",
        options=(),
        tune=making.tune_ziegler_nichols,
    ),
    TuningRule(
        name="ziegler-nichols-p",
        summary="P from the step response, kp = T/(K L)",
        source=ZIEGLER_NICHOLS,
        validity=STEP_RANGE,
        options=(READING,),
        tune=making.from_lag("ziegler-nichols-p", lags.tune_p_ziegler_nichols),
    ),
    TuningRule(
        name="ziegler-nichols-pi",
        summary="PI from the step response, kp = 0.9 T/(K L)",
        source=ZIEGLER_NICHOLS,
        validity=STEP_RANGE,
        options=(READING,),
        tune=making.from_lag("ziegler-nichols-pi", lags.tune_pi_ziegler_nichols),
    ),
    TuningRule(
        name="ziegler-nichols-without-gain",
        summary="as Lee (1995) prints it, kp = 1.2 T/L: forgets the plant's gain K, so K times too hot; to repeat that work only",
        source="Lee (1995), chapter 5",
        validity="stable plants whose tangent has a dead time",
        options=(),
        tune=lambda plant, _: tune_pid_ziegler_nichols_without_gain(plant.tangent, designed_on=plant.name),
    ),
    TuningRule(
        name="ziegler-nichols-ultimate-p",
        summary="P from the ultimate gain",
        source=ZIEGLER_NICHOLS,
        validity=ULTIMATE_RANGE,
        options=ULTIMATE,
        tune=making.from_ultimate("ziegler-nichols-ultimate-p", ultimates.tune_p_ultimate),
    ),
    TuningRule(
        name="ziegler-nichols-ultimate-pi",
        summary="PI from the ultimate gain and period",
        source=ZIEGLER_NICHOLS,
        validity=ULTIMATE_RANGE,
        options=ULTIMATE,
        tune=making.from_ultimate("ziegler-nichols-ultimate-pi", ultimates.tune_pi_ultimate),
    ),
    TuningRule(
        name="ziegler-nichols-ultimate",
        summary="PID from the ultimate gain and period",
        source=ZIEGLER_NICHOLS,
        validity=ULTIMATE_RANGE,
        options=ULTIMATE,
        tune=making.from_ultimate("ziegler-nichols-ultimate", ultimates.tune_pid_ultimate),
    ),
    TuningRule(
        name="tyreus-luyben-pi",
        summary="PI from the ultimate gain and period, milder",
        source="Tyreus and Luyben (1992), Industrial and Engineering Chemistry Research 31(11), 2625-2628",
        validity=ULTIMATE_RANGE,
        options=ULTIMATE,
        tune=making.from_ultimate("tyreus-luyben-pi", ultimates.tune_pi_tyreus_luyben),
    ),
    TuningRule(
        name="tyreus-luyben",
        summary="PID from the ultimate gain and period, milder",
        source="Luyben (1996), Industrial and Engineering Chemistry Research 35(10), 3480-3483",
        validity=ULTIMATE_RANGE,
        options=ULTIMATE,
        tune=making.from_ultimate("tyreus-luyben", ultimates.tune_pid_tyreus_luyben),
    ),
    TuningRule(
        name="cohen-coon-pi",
        summary="PI from the step response, for a quarter decay",
        source=COHEN_COON,
        validity=STEP_RANGE,
        options=(READING,),
        tune=making.from_lag("cohen-coon-pi", lags.tune_pi_cohen_coon),
    ),
    TuningRule(
        name="cohen-coon",
        summary="PID from the step response, for a quarter decay",
        source=COHEN_COON,
        validity=STEP_RANGE,
        options=(READING,),
        tune=making.from_lag("cohen-coon", lags.tune_pid_cohen_coon),
    ),
    TuningRule(
        name="simc-pi",
        summary="PI for a wanted closed-loop lag, by the half rule where the model has more lags",
        source=SKOGESTAD,
        validity="models with real stable poles; engines by the lag that their step response is like",
        options=(CLOSED_LOOP_LAG, READING),
        tune=lambda plant, options: making.tune_simc(plant, options, 1),
    ),
    TuningRule(
        name="simc",
        summary="PID of series form for a wanted closed-loop lag, whose derivative cancels the second lag",
        source=SKOGESTAD,
        validity="models with two real stable poles or more",
        options=(CLOSED_LOOP_LAG, READING),
        tune=lambda plant, options: making.tune_simc(plant, options, 2),
    ),
    TuningRule(
        name="amigo-pi",
        summary="PI for a maximum sensitivity near 1.4",
        source=f"{ADVANCED_PID}, section 7.4",
        validity="stable plants with a delay",
        options=(replace(READING, default="63"),),
        tune=making.from_weighted_lag("amigo-pi", lags.tune_pi_amigo),
    ),
    TuningRule(
        name="amigo",
        summary="PID for a maximum sensitivity near 1.4, with its set-point weight",
        source=f"{ADVANCED_PID}, section 7.5",
        validity="stable plants with a delay",
        options=(replace(READING, default="63"),),
        tune=making.from_weighted_lag("amigo", lags.tune_pid_amigo),
    ),
    TuningRule(
        name="lambda",
        summary="PI that cancels the lag, for a wanted closed-loop lag",
        source="Dahlin (1968), Instruments and Control Systems 41(6), 77-83",
        validity="stable plants",
        options=(replace(CLOSED_LOOP_LAG, default="the plant's lag"), READING),
        tune=making.tune_lambda,
    ),
    TuningRule(
        name="fine-tuning",
        summary="gains set free, moved from a start to the least error after a step under a limit on overshoot, the delay exact",
        source="after Lee (1995), section 5.3; Nelder and Mead (1965), The Computer Journal 7(4), 308-313",
        validity="models as transfer functions",
        options=(
            RuleOption(name="start", unit="file", description="controller file to begin from", default="the gains of ziegler-nichols"),
            RuleOption(name="free", unit="names", description="gains set free, of kp,ki,kd", default="ki"),
            RuleOption(name="overshoot_limit", unit="1", description="largest overshoot, as a fraction of the command", default="0.1"),
            RuleOption(name="objective", unit="name", description="what is minimised", default="setpoint-error"),
            RuleOption(name="horizon", unit="s", description="time over which loops are judged", default="4"),
        ),
        tune=making.tune_finely,
    ),
)
"""All tuning rules."""


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


def tune_by_rule(name: str, plant: TransferFunction | TuningPlant, *, options: Options, designed_on: str = "") -> PidGains:
    """Tune a controller by a rule of the table.

    Args:
        name: of the rule.
        plant: the model to tune for, or a plant from `tuning_plant`, which has its name.
        options: what the rule asks for, by name.
        designed_on: name of the model, kept with the gains.

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
    known = plant if isinstance(plant, TuningPlant) else tuning_plant(plant, name=designed_on)
    return rule.tune(known, options)
