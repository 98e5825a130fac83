"""The study's cross-check: in its results, checks, figure and words, and what a disagreement does."""

from dataclasses import replace

import numpy as np
import pytest

from revline.analysis import linearize
from revline.analysis.cross_check import LARGE_SIGNAL, SMALL_SIGNAL
from revline.errors import AnalysisError
from revline.studies import routes
from revline.studies.checks import check_study
from revline.studies.config import StudyConfig
from revline.studies.record import study_record
from revline.studies.routes import RoutesResult, check_routes, route_caption, route_curves, route_words
from revline.studies.steps import find_point
from revline.studies.study_results import StudyResults


def test_all_frequencies_are_compared_by_all_routes(results: StudyResults) -> None:
    check = results.routes.check
    assert check.agreed
    assert check.unchecked == ()
    assert check.comparison(LARGE_SIGNAL).difference.omega.tolist() == results.response.omega.tolist()
    assert check.comparison(SMALL_SIGNAL).difference.omega[2:].tolist() == results.response.omega.tolist()


def test_results_hold_harmonic_balance_and_the_cross_check(config: StudyConfig, results: StudyResults) -> None:
    record = study_record(config, results, (), (), 1.0)
    rows = [row for row in record["frequency_response"] if row["method"] == "harmonic-balance"]
    assert len(rows) == len(record["frequency_response"]) / 4 == 42
    fourier = [row for row in record["frequency_response"] if row["method"] == "fourier"]
    for key, tolerance in (("amplitude_rad_s", 1e-6), ("distortion", 1e-4)):
        assert [row[key] for row in rows] == pytest.approx([row[key] for row in fourier], rel=tolerance)
    found = record["cross_check"]
    assert (found["agreed"], found["unchecked"], len(found["comparisons"])) == (True, [], 2)
    assert found["effect_of_amplitude"]["largest_magnitude_difference"] == pytest.approx(0.015, abs=5e-4)
    assert found["difference_falls_with_power_of_amplitude"] == pytest.approx([2.0, 2.0], abs=0.01)


@pytest.mark.reference
def test_checks_hold_the_effect_of_the_amplitude(config: StudyConfig, results: StudyResults) -> None:
    """The exact response over that to 5 deg, recomputed twice for the engine of Lee (1995)."""
    checks = {check.name: check for check in check_study(config, results)}
    assert checks["exact response over that of harmonic balance at 1 rad/s, less one"].measured == pytest.approx(0.0017, abs=5e-5)
    assert checks["harmonic balance against sinestream by simulation: largest part of the tolerance"].measured < 1.0
    assert all(check.passed for check in checks.values())


def test_the_figure_shows_differences_and_tolerances(results: StudyResults) -> None:
    effect, *curves = route_curves(results.routes)
    assert effect.y.max() == pytest.approx(np.radians(1.71), abs=1e-3)
    for difference, allowed in zip(curves[::2], curves[1::2], strict=True):
        assert np.all(difference.y < allowed.y)
        assert allowed.label == f"allowed, {difference.label}"
    assert "take at most" in route_caption(results.routes)
    assert "the effect of the amplitude: +1.5 % at 7 rad/s and -1.7 deg at 100 rad/s" in route_words(results.routes)


def test_rough_orbits_are_one_warning(results: StudyResults) -> None:
    (balance,) = results.routes.balances
    rough = replace(balance, error=np.where(balance.omega > 50.0, 1e-4 * balance.omega, balance.error))
    (warning,) = routes.route_warnings(replace(results.routes, balances=(rough,)))
    assert warning.startswith("harmonic balance is rough at 5 of 42 frequencies")
    assert warning.endswith("the fundamental is known to 0.01 of itself at worst, at 100 rad/s")


def wrong_lags(monkeypatch: pytest.MonkeyPatch) -> None:
    right = linearize.build_model
    monkeypatch.setattr(linearize, "build_model", lambda system, jacobians, lags: right(system, jacobians, 1.01 * lags))


def test_a_disagreement_fails_the_step_with_the_numbers(
    config: StudyConfig, results: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lag of the linear model 1 % too long."""
    engine = config.load_engine()
    wrong_lags(monkeypatch)
    with pytest.raises(AnalysisError, match=r"cross-check failed at 4[0-9] of 44 frequencies"):
        check_routes(engine, find_point(engine, config), results.response)


def test_what_harmonic_balance_does_not_find_is_a_warning(
    config: StudyConfig, results: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        message = "no orbit"
        raise AnalysisError(message)

    monkeypatch.setattr(routes, "attempt_balance", fail)
    monkeypatch.setattr("revline.analysis.cross_check.attempt_balance", fail)
    found: RoutesResult = check_routes(config.load_engine(), results.point, results.response)
    assert (found.balances, found.effects) == ((), ())
    assert [text for text in routes.route_warnings(found) if text.endswith("no orbit")]
    assert routes.balance_rows(found) == []
    assert "effect_of_amplitude" not in routes.routes_fields(found)
