"""Outcomes and numbers in words, as the report says them."""

import re
from types import MappingProxyType

from revline.design.loops.closed_loop import MISSED, LoopRun, describe_outcome
from revline.design.loops.outcome import Diverged, LimitCycle, Settled
from revline.errors import NotSettledError
from revline.report.numbers import MINUS, format_number
from revline.studies.results import title
from revline.studies.stability_results import AT_START, AT_TARGET

_POWER = re.compile(r"\d+(?:\.\d+)?e[+-]\d+")
_SIGN = re.compile(r"(?<![\w.^)\]])-(?=\d)")

PLANTS = MappingProxyType({"engine": "the engine", AT_START: "the engine at the start", AT_TARGET: "the engine at the target"})
"""Plants that are no fitted model."""


def typographic(text: str) -> str:
    """Set the numbers of a sentence as print does: minus signs, plus or minus, powers of ten raised."""
    text = _POWER.sub(lambda found: format_number(float(found[0]), len(found[0].partition("e")[0].replace(".", ""))), text)
    return _SIGN.sub(MINUS, text.replace("+-", "±"))


def plant_name(plant: str) -> str:
    """A plant as a sentence names it: the engine, G2d."""
    return PLANTS.get(plant, title(plant))


def misses(run: LoopRun) -> bool:
    """Whether a loop comes to rest off its target, as one does whose throttle stays at a limit."""
    return isinstance(run.outcome, Settled) and abs(run.outcome.steady_error) > MISSED * abs(run.command)


def ending(run: LoopRun) -> str:
    """How a loop ends, in a few words."""
    match run.outcome:
        case Settled():
            return "settles off target" if misses(run) else "settles"
        case LimitCycle():
            return "hunts"
        case Diverged():
            return "diverges"
        case _:
            return "stalls"


def outcome_name(run: LoopRun) -> str:
    """How a loop ends, as a table's cell says it."""
    return run.outcome.name.replace("-", " ")


def outcome_text(run: LoopRun) -> str:
    """How a loop on the engine ends, with its numbers in their units."""
    return typographic(describe_outcome(run))


def relative_outcome(run: LoopRun) -> str:
    """How a linear loop ends, with its numbers as parts of the command."""
    outcome = run.outcome
    if isinstance(outcome, Diverged):
        return f"diverges: beyond {abs(outcome.bound / run.command):g} commands from its target after {outcome.time:.3g} s"
    if not isinstance(outcome, Settled):
        return outcome_text(run)
    text = f"settles: overshoot {100.0 * run.overshoot:.1f} %"
    try:
        measures = run.measures()
    except NotSettledError:
        return text
    return f"{text}, within {100.0 * measures.band:g} % of the command from {measures.settling_time:.3g} s on"


def limit_text(run: LoopRun) -> str:
    """How long the throttle is at a limit."""
    seconds = run.saturated_share * float(run.times[-1])
    if seconds == 0.0:
        return "The throttle reaches no limit."
    return f"The throttle is at a limit for {seconds:.2g} s of the {run.times[-1]:.3g} s simulated."


def listed(names: list[str]) -> str:
    """Names in a row: "C1", "C1 and C2", "C1, C2 and C3"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
