"""The study's judgement of every loop with the delay exact."""

import dataclasses

import numpy as np
import pytest

from revline.studies.checks import check_study
from revline.studies.config import StudyConfig
from revline.studies.content_stability import _target_words, regions_in_words
from revline.studies.stability_record import stability_record
from revline.studies.stability_results import AT_START, AT_TARGET, RegionRow
from revline.studies.stability_steps import collect_plants, find_stability, find_target
from revline.studies.study_results import StudyResults


def test_each_region_agrees_with_each_margin(results: StudyResults) -> None:
    """Two methods judge each controller on each plant: the count of roots across the boundary, and the loop's own roots."""
    found = results.stability
    seen = 0
    for row in found.margins:
        kd = results.controllers.gains[row.controller].kd
        region = next(r for r in found.of_kd(kd) if r.plant == row.plant)
        assert (row.controller in region.inside) == row.margins.stable
        assert (row.controller in region.outside) != row.margins.stable
        seen += 1
    assert seen == 13


def test_improper_loops_have_a_reason_instead_of_margins(results: StudyResults) -> None:
    """A derivative on a first-order lag never falls: its margins would mean nothing."""
    without = results.stability.without_margins
    assert {(row.controller, row.plant) for row in without} == {("c2", "g1"), ("c2d", "g1")}
    assert all("improper" in row.reason for row in without)


@pytest.mark.reference
def test_the_boundary_has_roots_on_the_imaginary_axis(config: StudyConfig, results: StudyResults) -> None:
    """Each point of each boundary makes 1 + L vanish; 2.106 and 2.794 deg per rad/s end the proportional gains of the exact models."""
    engine = config.load_engine()
    plants = collect_plants(engine, results.point, results.models, results.stability.target)
    for row in results.stability.regions:
        if not row.omega.size:
            continue
        s = 1j * row.omega
        inverse = plants.family(row.plant, row.kd).inverse(np.asarray(s, dtype=np.complex128))
        assert np.max(np.abs((inverse + row.kp + row.ki / s + row.kd * s) / inverse)) < 1e-9
    ends = {row.plant: row.intervals[-1][1] for row in results.stability.of_kd(0.0)}
    assert (ends[AT_START], ends[AT_TARGET]) == pytest.approx((2.106, 2.794), abs=5e-4)


def test_c2_s_derivative_gain_leaves_the_engine_no_stabilising_gains(results: StudyResults) -> None:
    kd = results.controllers.gains["c2"].kd
    empty = {row.plant for row in results.stability.of_kd(kd) if row.is_empty}
    assert empty == {"g2d", AT_START, AT_TARGET}
    words = list(regions_in_words(results))
    assert words[0].startswith("C1 lies inside the region of G1 and G2, but outside that of G2d, the engine at the start")
    assert "no kp and ki at all stabilise G2d" in words[1]
    assert words[2] == "C2d lies inside the region of every plant."


def test_a_command_beyond_the_engine_s_speeds_leaves_no_target(config: StudyConfig, results: StudyResults) -> None:
    engine = config.load_engine()
    beyond = dataclasses.replace(results.loops, command=5000.0)
    assert find_target(engine, results.point, beyond) == ()
    found = find_stability(engine, results.point, results.models, results.controllers, beyond)
    assert found.target == ()
    assert AT_TARGET not in {row.plant for row in found.regions}
    assert "target_point" not in stability_record(found)
    assert _target_words(found) == " (where the command leads, no steady state of the engine was found)"
    assert "where the command leads them, 3" in _target_words(results.stability)


def test_a_wrong_boundary_fails_its_check(config: StudyConfig, results: StudyResults) -> None:
    """Negative control: a gain limit that is 1 % off must be seen."""

    def moved(row: RegionRow) -> RegionRow:
        return dataclasses.replace(row, intervals=tuple((low, 1.01 * high) for low, high in row.intervals))

    wrong = dataclasses.replace(results.stability, regions=tuple(moved(row) for row in results.stability.regions))
    failed = {c.name for c in check_study(config, dataclasses.replace(results, stability=wrong)) if not c.passed}
    assert failed == {f"exact model at {angle} deg: kp at which proportional control alone loses stability" for angle in (25, 30)}


def test_what_is_missing_fails_its_check_instead_of_leaving_it_out(config: StudyConfig, results: StudyResults) -> None:
    """Negative control: a study of the thesis without regions, margins, cycles, gaps or orbits must not pass for one that checked them."""
    whole = {check.name for check in check_study(config, results)}
    bare = dataclasses.replace(
        results,
        stability=dataclasses.replace(results.stability, regions=(), margins=()),
        hunting=dataclasses.replace(results.hunting, cycles=(), onsets=()),
        distance=dataclasses.replace(results.distance, rows=()),
        routes=dataclasses.replace(results.routes, balances=(), effects=()),
    )
    failed = {check.name for check in check_study(config, bare) if not check.passed}
    assert failed == {
        *(f"exact model at {angle} deg: kp at which proportional control alone loses stability" for angle in (25, 30)),
        *(f"exact model at {angle} deg: kp at which a controller of C1's ratio loses stability" for angle in (25, 30)),
        "limit cycles computed as orbits",
        "onsets of hunting found",
        "models compared with the engine by the nu-gap",
        "frequencies with an answer by harmonic balance",
    }
    assert failed <= whole
