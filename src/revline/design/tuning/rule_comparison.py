"""All tuning rules on one plant: gains, exact margins, and for those refused the reason."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from revline.design.controllers.controller import PidGains
from revline.design.stability.margins import Margins, find_margins
from revline.design.tuning.rule_making import RuleValue
from revline.design.tuning.rules import TUNING_RULES, tune_by_rule
from revline.design.tuning.tuning_plant import TuningPlant
from revline.errors import RevlineError

LEFT_OUT = frozenset({"fine-tuning", "ziegler-nichols-without-gain"})
"""Rules that are no rule of thumb for a plant: one moves given gains, one repeats a misprint."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TunedLoop:
    """What a rule gives for a plant.

    Attributes:
        rule: its name.
        gains: that it gives.
        margins: of the exact loop.
    """

    rule: str
    gains: PidGains
    margins: Margins


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedRule:
    """A rule that is not for this plant, or whose loop has no margins.

    Attributes:
        rule: its name.
        reason: its own words.
    """

    rule: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RuleComparison:
    """All rules on one plant, in the table's order.

    Attributes:
        plant: its name.
        tuned: what each rule gives.
        refused: the rules that are not for this plant.
    """

    plant: str
    tuned: tuple[TunedLoop, ...]
    refused: tuple[RefusedRule, ...]


def compare_rules(plant: TuningPlant, *, options: Mapping[str, Mapping[str, RuleValue]] | None = None) -> RuleComparison:
    """Tune a plant by every rule of the table and find the exact margins of each.

    Args:
        plant: from `tuning_plant`.
        options: for rules that need some, by the rule's name.
    """
    given = options or MappingProxyType({})
    tuned, refused = [], []
    for rule in TUNING_RULES:
        if rule.name in LEFT_OUT:
            continue
        try:
            gains = tune_by_rule(rule.name, plant, options=given.get(rule.name, {}))
            tuned.append(TunedLoop(rule=rule.name, gains=gains, margins=find_margins(plant.loop(gains))))
        except RevlineError as error:
            refused.append(RefusedRule(rule=rule.name, reason=str(error)))
    return RuleComparison(plant=plant.name, tuned=tuple(tuned), refused=tuple(refused))
