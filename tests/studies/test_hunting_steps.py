"""The study's limit cycles as orbits, the onset of hunting, and the range of its exact linear model."""

import dataclasses

import numpy as np
import pytest

from revline.analysis.linear_range import HoldsUpTo
from revline.design.loops.outcome import LimitCycle
from revline.errors import AnalysisError
from revline.studies.captions import caption, figure_ids
from revline.studies.checks import check_study
from revline.studies.config import StudyConfig
from revline.studies.content_hunting import not_found
from revline.studies.hunting_record import hunting_record
from revline.studies.hunting_results import HuntingResult, NoCycle
from revline.studies.hunting_steps import find_hunting
from revline.studies.own_figures import ONSET_FIGURE, ORBIT_FIGURE, onset_words
from revline.studies.results import LoopRow
from revline.studies.stability_results import AT_TARGET
from revline.studies.study_results import StudyResults


@pytest.mark.reference
def test_the_orbits_are_the_simulated_cycles(results: StudyResults) -> None:
    """C1 of Lee (1995) hunts from 291.15 to 310.07 rad/s every 0.2088 s; the study's own C1 differs in its last digits."""
    found = results.hunting
    assert [row.controller for row in found.cycles] == ["c1", "c2"]
    assert found.without_cycle == ()
    row = found.cycle("c1")
    assert row is not None
    assert (row.low, row.high) == pytest.approx((291.15, 310.07), abs=0.1)
    assert row.period == pytest.approx(0.2088, abs=2e-4)
    for cycle in found.cycles:
        simulated = results.loops.row(cycle.controller, "engine").run.outcome
        assert isinstance(simulated, LimitCycle)
        assert (cycle.low, cycle.high) == pytest.approx((simulated.low, simulated.high), abs=1e-3 * (cycle.high - cycle.low))
        assert cycle.stable
        assert cycle.multiplier < 1.0 - cycle.multiplier_error
    assert (row.at_low, row.at_high) == (False, False)


def test_the_onset_is_where_the_margins_say(results: StudyResults) -> None:
    """The factor of C1's gains at which hunting begins is the gain margin of its loop with the exact model at the target."""
    (onset,) = results.hunting.onsets
    row = results.stability.margin("c1", AT_TARGET)
    assert row is not None
    assert row.margins.gain_fall is not None
    assert onset.factor == pytest.approx(row.margins.gain_fall.gain_margin, rel=1e-9)
    assert onset.frequency == pytest.approx(row.margins.gain_fall.frequency, rel=1e-9)
    assert onset.kind == "soft"
    sizes = np.array([point.amplitude for point in onset.points])
    factors = np.array([point.factor for point in onset.points])
    own = results.hunting.cycle("c1")
    assert own is not None
    assert np.interp(1.0, factors, sizes) == pytest.approx(0.5 * (own.high - own.low), rel=0.02)


def test_an_onset_is_told_in_words(results: StudyResults) -> None:
    (onset,) = results.hunting.onsets
    assert onset_words(onset).endswith("grow from nothing: the onset is soft.")
    hard = dataclasses.replace(onset, kind="hard", lowest_factor=0.5)
    assert onset_words(hard).endswith("are found down to 0.500: the onset is hard.")


def test_a_simulation_of_another_loop_is_no_confirmation(config: StudyConfig, results: StudyResults) -> None:
    """Planted: the record of C1 with its low end 1 rad/s lower must not pass for the orbit's."""

    def moved(row: LoopRow) -> LoopRow:
        if (row.controller, row.plant) != ("c1", "engine") or not isinstance(row.run.outcome, LimitCycle):
            return row
        outcome = dataclasses.replace(row.run.outcome, low=row.run.outcome.low - 1.0)
        return row._replace(run=dataclasses.replace(row.run, outcome=outcome))

    wrong = dataclasses.replace(results.loops, rows=tuple(moved(row) for row in results.loops.rows))
    with pytest.raises(AnalysisError, match="disagree by"):
        find_hunting(config.load_engine(), results.point, results.controllers, wrong)


def test_what_does_not_hunt_has_no_figures(config: StudyConfig, results: StudyResults) -> None:
    calm = dataclasses.replace(results, hunting=HuntingResult(cycles=(), without_cycle=(), onsets=(), without_onset=()))
    assert set(figure_ids(results)) - set(figure_ids(calm)) == {ORBIT_FIGURE, ONSET_FIGURE}
    assert caption(ORBIT_FIGURE, calm).endswith("There is none.")
    assert hunting_record(calm.hunting) == {"limit_cycles": [], "hunting_onsets": [], "not_computed": []}
    assert not any("limit cycle of C1: orbit" in check.name for check in check_study(config, calm))


def test_what_was_not_found_is_said_with_its_reason(results: StudyResults) -> None:
    missing = HuntingResult(
        cycles=(), without_cycle=(NoCycle("c2d", "it winds too fast"),), onsets=(), without_onset=(NoCycle("c1", "no cycle beyond it"),)
    )
    words = [str(block) for block in not_found(missing)]
    assert len(words) == 2
    assert "The limit cycle of C2d was not found: it winds too fast" in words[0]
    assert "How hunting begins with C1 was not found: no cycle beyond it" in words[1]
    assert list(not_found(results.hunting)) == []


def test_every_controller_that_hunts_has_its_cycle_looked_for(config: StudyConfig, results: StudyResults) -> None:
    """At other points C2d hunts as well; here the record of C2 stands for its, and its cycle is that of C2."""
    c2 = results.loops.row("c2", "engine").run
    rows = tuple(row._replace(run=c2) if (row.controller, row.plant) == ("c2d", "engine") else row for row in results.loops.rows)
    found = find_hunting(config.load_engine(), results.point, results.controllers, dataclasses.replace(results.loops, rows=rows))
    assert [row.controller for row in found.cycles] == ["c1", "c2", "c2d"]
    assert (found.cycles[2].low, found.cycles[2].high) == (found.cycles[1].low, found.cycles[1].high)


def test_the_linear_model_s_range_is_the_narrowest_of_all_frequencies(results: StudyResults) -> None:
    found = results.linear_range
    narrowest = found.narrowest
    assert isinstance(narrowest, HoldsUpTo)
    assert narrowest.error == pytest.approx(0.05, rel=1e-4)
    assert narrowest.amplitude == pytest.approx(6.51, abs=0.01)
    assert narrowest.amplitude == min(entry.amplitude for entry in found.ranges)
