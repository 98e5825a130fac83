"""The study's nu-gaps between its models and the engine, and its models with other delays."""

import dataclasses

import numpy as np
import pytest

from revline.studies.captions import caption, figure_ids
from revline.studies.config import StudyConfig
from revline.studies.delay_models import delay_blocks, find_delay_models
from revline.studies.model_distance import FIGURE, DistanceResult, distance_fields, distance_words
from revline.studies.record import error_records
from revline.studies.stability_results import AT_START, AT_TARGET
from revline.studies.study_results import StudyResults


def test_what_is_sure_is_stable_and_what_hunts_is_not_sure(results: StudyResults) -> None:
    """C1 on G1 and C2 on G2 promise nothing for the engine; C2d on G2d does at the operating point; no promise is broken."""
    verdicts = {(row.controller, row.model, row.plant): row.verdict for row in results.distance.rows}
    assert len(verdicts) == 8
    for (controller, model, plant), verdict in verdicts.items():
        assert verdict.stable or not verdict.guaranteed
        row = results.stability.margin(controller, plant)
        assert row is not None
        assert row.margins.stable == verdict.stable, (controller, model, plant)
    assert [verdicts[key].guaranteed for key in (("c1", "g1", AT_START), ("c2", "g2", AT_START), ("c2d", "g2d", AT_START))] == [
        False,
        False,
        True,
    ]
    assert verdicts["c1", "g1", AT_START].gap.value == pytest.approx(0.853, abs=2e-3)
    assert verdicts["c1", "g1", AT_TARGET].gap.value == pytest.approx(0.790, abs=2e-3)


def test_the_words_are_those_of_the_numbers(results: StudyResults) -> None:
    words = distance_words(results.distance)
    assert "exceeds C1's margin 0.63" in words
    assert words.count("says nothing about this loop on the engine at the start") == 2
    assert "is sure to stabilise the engine at the start" in words
    none = dataclasses.replace(results, distance=DistanceResult(rows=(), missing=()))
    assert set(figure_ids(results)) - set(figure_ids(none)) == {FIGURE}
    assert distance_fields(none.distance) == []
    assert "C2d on G2d: nu-gap" in caption(FIGURE, results)


def test_a_delay_fitted_with_the_poles_errs_less_in_time(config: StudyConfig, results: StudyResults) -> None:
    found = results.delay_models
    assert found.missing == ()
    assert found.angle == pytest.approx(5.48, abs=1e-9)
    assert found.fixed[0].delay == pytest.approx(results.point.trim.lag("charge"), rel=1e-12)
    for plain, other in zip(results.errors.records, found.records, strict=True):
        assert other.models == ("g2d_free", "g2_fixed_lag", "g2_varying_lag")
        assert all(other.swing(name) < plain.swing("g2d") for name in other.models)
        assert np.array_equal(other.speed, plain.speed)
    step = found.records[0]
    assert step.rms("g2_varying_lag") < step.rms("g2_fixed_lag") < 0.6 * results.errors.records[0].rms("g2d")
    names = {row["model"] for row in error_records((*results.errors.records, *found.records))}
    assert names == {"g1", "g2", "g2d", "g2d_free", "g2_fixed_lag", "g2_varying_lag"}
    assert len(list(delay_blocks(found, results.errors))) == 2
    twice = find_delay_models(results.point, results.models, results.errors, 2.0 * config.amplitude_deg)
    assert twice.records[0].rms("g2d_free") > 10.0 * step.rms("g2d_free")


def test_a_lag_that_cannot_be_simulated_is_named(config: StudyConfig, results: StudyResults) -> None:
    """An amplitude that drives the model's speed to nothing leaves no varying lag; the others are there."""
    found = find_delay_models(results.point, results.models, results.errors, -20.0 * config.amplitude_deg)
    assert "g2_varying_lag" not in found.records[0].models
    assert found.missing
    assert all(text.startswith("G2, lag over speed: ") for text in found.missing)
