"""Outcomes and numbers in words."""

import dataclasses

import pytest

from revline.design.loops.closed_loop import LoopRun
from revline.design.loops.outcome import Stalled
from revline.studies.study_results import StudyResults
from revline.studies.words import ending, limit_text, listed, outcome_text, relative_outcome, typographic


@pytest.mark.parametrize(
    ("plain", "set_"),
    [
        ("reaches -8.6 dB at 100 rad/s", "reaches \N{MINUS SIGN}8.6 dB at 100 rad/s"),
        ("a lag of 2.05e+03 s", "a lag of 2050 s"),
        ("a lag of 2.05e+07 s", "a lag of 2.05\N{MULTIPLICATION SIGN}10⁷ s"),
        ("5e-06", "5\N{MULTIPLICATION SIGN}10⁻⁶"),
        ("s = 1.2 +- 3.4j", "s = 1.2 ± 3.4j"),
        ("zero-padded, Figs 6-7, G2-like, 1/s", "zero-padded, Figs 6-7, G2-like, 1/s"),
    ],
)
def test_numbers_are_set_as_print_does(plain: str, set_: str) -> None:
    assert typographic(plain) == set_


def test_names_stand_in_a_row() -> None:
    assert [listed(["a"]), listed(["a", "b"]), listed(["a", "b", "c"])] == ["a", "a and b", "a, b and c"]


@pytest.mark.slow
class TestOutcomes:
    """Words about loops of the study itself."""

    def run(self, results: StudyResults, controller: str, plant: str) -> LoopRun:
        return results.loops.row(controller, plant).run

    def test_each_outcome_has_its_verb(self, results: StudyResults) -> None:
        pairs = (("c1", "g1"), ("c1", "g2d"), ("c1", "engine"))
        assert [ending(self.run(results, *pair)) for pair in pairs] == ["settles", "diverges", "hunts"]

    def test_a_linear_loop_is_told_in_commands_as_its_figure_draws_it(self, results: StudyResults) -> None:
        settled, diverged = self.run(results, "c1", "g1"), self.run(results, "c1", "g2d")
        time = settled.measures().settling_time
        assert relative_outcome(settled) == f"settles: overshoot 7.7 %, within 2 % of the command from {time:.3g} s on"
        assert relative_outcome(diverged).startswith("diverges: beyond 10 commands from its target after ")

    def test_a_throttle_at_its_limit_for_an_instant_is_not_told_as_never(self, results: StudyResults) -> None:
        run = self.run(results, "c2d", "engine")
        assert 0.0 < run.saturated_share < 0.005
        assert limit_text(run).startswith("The throttle is at a limit for 0.0")
        free = dataclasses.replace(run, limits=run.limits._replace(low=-1e9, high=1e9))
        assert limit_text(free) == "The throttle reaches no limit."

    def test_a_stall_names_the_state_in_words(self, results: StudyResults) -> None:
        run = dataclasses.replace(
            self.run(results, "c1", "engine"), outcome=Stalled(time=0.7291, state="engine_speed", value=37.141, unit="rad/s")
        )
        assert outcome_text(run) == "stalls after 0.729 s, at engine speed 37.14 rad/s"
        assert ending(run) == "stalls"
