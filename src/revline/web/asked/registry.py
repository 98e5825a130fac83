"""All single questions by name: what is asked, and what finds the answer."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from revline.web import questions as kinds
from revline.web.asked import gains, loops, responses, rest


class Entry(NamedTuple):
    """A question: its model, what finds its record, and what it is for people."""

    kind: type[kinds.Question]
    find: Callable[[Any], Mapping[str, object]]
    summary: str


ASKED: Final[Mapping[str, Entry]] = MappingProxyType(
    {
        "trim": Entry(kinds.TrimQuestion, rest.find_trim_record, "Steady operating point"),
        "map": Entry(kinds.MapQuestion, rest.find_map_record, "Steady states over the throttle"),
        "linearize": Entry(kinds.LinearizeQuestion, rest.find_linear_record, "Exact linear model about a trim"),
        "response": Entry(kinds.ResponseQuestion, responses.find_response_record, "Frequency response from throttle to speed"),
        "fit": Entry(kinds.FitQuestion, responses.find_fit_record, "Transfer function from a frequency response"),
        "tune": Entry(kinds.TuneQuestion, gains.find_tune_record, "Gains by a rule"),
        "margins": Entry(kinds.MarginsQuestion, gains.find_margins_record, "Margins of a speed loop, every delay exact"),
        "region": Entry(kinds.RegionQuestion, gains.find_region_record, "Gains (kp, ki) that stabilise"),
        "loop": Entry(kinds.LoopQuestion, loops.find_loop_record, "A closed speed loop in time"),
        "limit-cycle": Entry(kinds.LimitCycleQuestion, loops.find_cycle_record, "The cycle that a loop hunts in"),
    }
)
"""The questions, each named as its command."""


def find_record(name: str, entries: Mapping[str, Any]) -> Mapping[str, object]:
    """Answer a question.

    Args:
        name: one of `ASKED`.
        entries: keys and values, as JSON has them.

    Raises:
        InvalidInputError: the question is wrong.
        AnalysisError: it cannot be answered.
    """
    entry = ASKED[name]
    return entry.find(kinds.parse_question(entry.kind, entries))
