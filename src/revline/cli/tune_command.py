"""The command tune: gains by a rule, for a model or for the engine, with the margins of the exact loop."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from revline import __version__
from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption
from revline.cli.plants import EngineChoice, linearise_engine, refuse_engine
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.controllers.controller import PidGains
    from revline.design.tuning.rule_making import RuleValue, TuningRule
    from revline.design.tuning.tuning_plant import TuningPlant

PROGRAM = f"revline {__version__}"
"""What files say of their origin."""

WANTED = (
    "give a model file, or --throttle for the engine, and --rule, for example `revline tune g2.json --rule ziegler-nichols`; "
    "--list shows the rules, --compare tries all"
)

NUMBERS_AND_NAMES = frozenset(
    {"natural_frequency", "damping", "closed_loop_lag", "reading", "ultimate_gain", "ultimate_period"}
    | {"free", "overshoot_limit", "objective", "horizon"}
)
"""Options of the command that are options of a rule of the same name."""

ObjectiveChoice = Literal["setpoint-error", "load-error"]
ReadingChoice = Literal["tangent", "63"]


def rule_names() -> list[str]:
    """Names of the tuning rules, for the shell's completion."""
    from revline.design.tuning.rules import TUNING_RULES

    return [rule.name for rule in TUNING_RULES]


ModelArgument = Annotated[
    Path | None, typer.Argument(metavar="[MODEL.json]", help="Model file, for example from `revline fit`; without one, the engine.")
]
RuleOption = Annotated[str | None, typer.Option("--rule", help="Name of the rule; --list shows them.", autocompletion=rule_names)]
TrimOption = Annotated[
    float | None, typer.Option("--throttle", metavar="DEG", help="Throttle angle of the engine's trim [deg], in place of a model.")
]
NaturalFrequencyOption = Annotated[
    float | None, typer.Option("--natural-frequency", metavar="RAD_S", help="Natural frequency of the closed loop [rad/s].")
]
DampingOption = Annotated[float | None, typer.Option("--damping", metavar="RATIO", help="Damping ratio of the closed loop [1].")]
ClosedLoopLagOption = Annotated[
    float | None, typer.Option("--closed-loop-lag", metavar="S", help="Lag wanted in closed loop by simc and lambda [s].")
]
ReadingOption = Annotated[
    ReadingChoice | None, typer.Option("--reading", help="How a lag is read from the step response: by its tangent, or up to 63 %.")
]
UltimateGainOption = Annotated[
    float | None,
    typer.Option(
        "--ultimate-gain", metavar="GAIN", help="Measured ultimate gain [deg/(rad/s) of an engine], with --ultimate-period; else exact."
    ),
]
UltimatePeriodOption = Annotated[
    float | None, typer.Option("--ultimate-period", metavar="S", help="Measured ultimate period [s], for example from `revline relay`.")
]
CompareOption = Annotated[bool, typer.Option("--compare", help="Tune by every rule and show the exact margins side by side.")]
ListOption = Annotated[bool, typer.Option("--list", help="List the rules with their options, ranges and sources.")]
StartOption = Annotated[
    Path | None,
    typer.Option("--start", metavar="CONTROLLER.json", help="Gains that fine tuning begins from; else those of ziegler-nichols."),
]
FreeOption = Annotated[
    str | None, typer.Option("--free", metavar="GAIN,..", help="Gains that fine tuning may move, of kp,ki,kd; ki by default.")
]
LimitOption = Annotated[
    float | None,
    typer.Option("--overshoot-limit", metavar="FRACTION", help="Largest overshoot that fine tuning allows, of the command; else 0.1."),
]
ObjectiveOption = Annotated[
    ObjectiveChoice | None,
    typer.Option(
        "--objective",
        help="What fine tuning minimises: the integral of the absolute error after a step of the command (the default), "
        "or the integrated error after a step of a load, 1/ki.",
    ),
]
HorizonOption = Annotated[
    float | None, typer.Option("--horizon", metavar="S", help="Time over which fine tuning judges a loop [s]; 4 by default.")
]


def tune(
    *,
    model: ModelArgument = None,
    rule: RuleOption = None,
    throttle: TrimOption = None,
    load: LoadOption = 0.0,
    natural_frequency: NaturalFrequencyOption = None,
    damping: DampingOption = None,
    closed_loop_lag: ClosedLoopLagOption = None,
    reading: ReadingOption = None,
    ultimate_gain: UltimateGainOption = None,
    ultimate_period: UltimatePeriodOption = None,
    start: StartOption = None,
    free: FreeOption = None,
    overshoot_limit: LimitOption = None,
    objective: ObjectiveOption = None,
    horizon: HorizonOption = None,
    compare: CompareOption = False,
    listed: ListOption = False,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Tune a PI or PID controller for a model by a rule; the gains are in deg of throttle per rad/s for an engine's model."""
    options = {name: value for name, value in locals().items() if name in NUMBERS_AND_NAMES and value is not None} | _start(start)
    from revline.design.tuning.rules import tune_by_rule
    from revline.io.json_files import format_json
    from revline.io.rule_records import loop_record, loop_words, tuned_record

    shell = Shell(json=json, quiet=quiet)
    if listed:
        _list_rules(shell)
        return
    shell.prepare(out, "comparison" if compare else "controller file")
    plant, origin = _plant(model, EngineChoice(engine, throttle, load))
    if compare:
        _compare(shell, plant, rule, options, out)
        return
    if rule is None:
        raise InvalidInputError(WANTED)
    gains = tune_by_rule(rule, plant, options=options)
    loop = loop_record(plant, gains)
    record = {**tuned_record(gains, provenance={"program": PROGRAM, **origin}), "loop": loop}
    shell.write(out, format_json(record), "controller file")
    shell.warn(*loop_words(loop))
    rows = [(gain, getattr(gains, gain), unit) for gain, unit in gains.gain_units.items()]
    details = [(key, value, "") for key, value in gains.details.items() if key != "summary"]
    evidence = [(key, value, "") for key, value in loop.items() if isinstance(value, float)]
    facts = Facts(f"Controller for {plant.name} by {gains.rule}", [*rows, *details, *evidence])
    shell.show(record, facts, str(gains.details.get("summary", "")), text_on=out)


def _start(path: Path | None) -> "dict[str, float | str | PidGains]":
    """The option of fine tuning that is a file."""
    from revline.io.controller_files import read_controller

    return {} if path is None else {"start": read_controller(path).gains}


def _plant(model: Path | None, choice: EngineChoice) -> "tuple[TuningPlant, dict[str, str]]":
    """What is tuned: a model file, or the engine linearised at a trim; and what files say of it."""
    from revline.design.tuning.tuning_plant import tuning_plant
    from revline.io.model_files import read_model

    if model is None:
        name, system = linearise_engine(choice, WANTED)
        return tuning_plant(system, name=name), {"engine": name}
    refuse_engine(choice)
    file = read_model(model)
    return tuning_plant(file.model, name=file.name), {"model": model.name}


def _compare(shell: Shell, plant: "TuningPlant", rule: str | None, options: "Mapping[str, RuleValue]", out: Path | None) -> None:
    """Show what every rule gives."""
    from revline.design.tuning.rule_comparison import compare_rules
    from revline.io.json_files import format_json
    from revline.io.rule_records import comparison_record

    if rule is not None or options:
        message = "--compare shows every rule with its defaults; leave --rule and the rules' options out"
        raise InvalidInputError(message)
    found = compare_rules(plant)
    record = comparison_record(found, provenance={"program": PROGRAM})
    shell.write(out, format_json(record), "comparison")
    rows = [
        (
            one.rule,
            *(f"{value:.4g}" for value in (one.gains.kp, one.gains.ki, one.gains.kd)),
            f"{one.margins.sensitivity.value:.3f}" if one.margins.stable else "unstable",
            f"{one.margins.complementary.value:.3f}" if one.margins.stable else "unstable",
            f"{one.margins.gain_rise.gain_margin:.3f}" if one.margins.gain_rise else "none",
            f"{one.margins.phase.phase_margin_deg:.1f}" if one.margins.phase else "none",
        )
        for one in found.tuned
    ]
    heads = ("rule", "kp", "ki [1/s]", "kd [s]", "Ms", "Mt", "gain margin", "phase margin [deg]")
    words = [f"not {one.rule}: {one.reason}" for one in found.refused]
    shell.show(record, Grid(f"Rules for {plant.name}", heads, rows), *words, text_on=out)


def _list_rules(shell: Shell) -> None:
    from revline.design.tuning.rules import TUNING_RULES

    record = {
        "rules": [
            {
                "name": rule.name,
                "summary": rule.summary,
                "source": rule.source,
                "validity": rule.validity,
                "options": [
                    {"name": o.name, "unit": o.unit, "description": o.description} | ({"default": o.default} if o.default else {})
                    for o in rule.options
                ],
            }
            for rule in TUNING_RULES
        ]
    }
    rows = [(rule.name, _option_words(rule), f"{rule.summary}; for {rule.validity}", rule.source) for rule in TUNING_RULES]
    shell.show(record, Grid("", ("rule", "options", "what it does, and for which plants", "source"), rows))


def _option_words(rule: "TuningRule") -> str:
    return ", ".join(f"--{option.name.replace('_', '-')} [{option.unit}]" for option in rule.options) or "none"
