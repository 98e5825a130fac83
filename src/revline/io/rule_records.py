"""What tuning rules give as records for JSON, with the margins of the exact loop."""

from collections.abc import Mapping
from typing import Final

from revline.design.controllers.controller import PidGains
from revline.design.stability.margins import Margins, find_margins
from revline.design.tuning.rule_comparison import RuleComparison
from revline.design.tuning.rule_making import recommended_controller
from revline.design.tuning.tuning_plant import TuningPlant
from revline.errors import InvalidInputError
from revline.io.controller_files import controller_record

SCHEMA: Final = "revline.rules/1"


def tuned_record(gains: PidGains, *, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give a rule's gains as the content of a controller file, with the set-point weight that the rule recommends.

    Args:
        gains: from the rule.
        provenance: what writes it, from what.
    """
    return controller_record(recommended_controller(gains), provenance=provenance)


def loop_record(plant: TuningPlant, gains: PidGains) -> Mapping[str, object]:
    """Give the exact margins of a plant under some gains as a record.

    Args:
        plant: that was tuned.
        gains: of the controller.
    """
    loop = plant.loop(gains)
    try:
        return _margins(find_margins(loop))
    except InvalidInputError as error:  # an ideal derivative on a plant that falls too slowly: the gains are as the rule has them
        return {"stable": loop.stable, "note": str(error)}


def loop_words(loop: Mapping[str, object]) -> tuple[str, ...]:
    """Say that a rule's gains make an unstable loop, and which margin it lacks; nothing where it is stable.

    Args:
        loop: from `loop_record`.
    """
    note = loop.get("note")
    if isinstance(note, str):
        return (note,)
    if loop["stable"]:
        return ()
    fall = loop.get("gain_reduction_margin")
    lacks = f"; it would be stable at {fall:.3g} times these gains" if isinstance(fall, float) else ""
    return (f"the loop is unstable under these gains, with {loop['unstable_roots']} roots right of the imaginary axis{lacks}",)


def comparison_record(found: RuleComparison, *, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give what all rules make of a plant as a record.

    Args:
        found: the comparison.
        provenance: what writes it, from what.
    """
    return {
        "schema": SCHEMA,
        "plant": found.plant,
        "rules": [
            {"rule": one.rule, **tuned_record(one.gains, provenance=provenance), "loop": _margins(one.margins)} for one in found.tuned
        ],
        "refused": [{"rule": one.rule, "reason": one.reason} for one in found.refused],
    }


def _margins(margins: Margins) -> Mapping[str, object]:
    record: dict[str, object] = {"stable": margins.stable}
    record |= {"ms": margins.sensitivity.value, "mt": margins.complementary.value} if margins.stable else {}
    record |= {} if margins.stable else {"unstable_roots": round(margins.unstable_poles)}
    record |= {"gain_margin": margins.gain_rise.gain_margin} if margins.gain_rise else {}
    record |= {"gain_reduction_margin": margins.gain_fall.gain_margin} if margins.gain_fall else {}
    record |= {"phase_margin_deg": margins.phase.phase_margin_deg} if margins.phase else {}
    return record
