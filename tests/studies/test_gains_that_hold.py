"""The study's steps on rules and the optimum, the operating map, acceptance, and two inputs."""

import dataclasses
import json

import pytest

from revline.design.maps.gain_map import LostPoint
from revline.engine.lee1995 import lee1995
from revline.errors import AnalysisError
from revline.report.blocks import Paragraph, TableBlock
from revline.report.inline import plain
from revline.studies.captions import caption, figure_ids
from revline.studies.checks import check_study
from revline.studies.config import StudyConfig
from revline.studies.content_design import design_section
from revline.studies.made import Made
from revline.studies.material import Material
from revline.studies.operating_map import MAP_FIGURE, SCHEDULE_FIGURE, MapResult, limit_words, lost_words, map_fields, map_words
from revline.studies.results import NotFound, attempt
from revline.studies.rivals import FIGURE as RIVALS_FIGURE
from revline.studies.rivals import rivals_fields, rivals_words
from revline.studies.study_results import StudyResults
from revline.studies.tables import study_tables
from revline.studies.trials import FIGURE as TRIALS_FIGURE
from revline.studies.trials import FIXED, SCHEDULE, TrialsResult, map_points, rest_places, trials_fields
from revline.studies.two_inputs import FIGURE as TWO_INPUTS_FIGURE
from revline.studies.two_inputs import TwoInputsResult, find_two_inputs, two_inputs_fields, two_inputs_words
from revline.studies.writing import find_warnings
from revline.web.parameters import THESIS

NOTHING = (NotFound("a part", "it was not there."),)


def without(results: StudyResults) -> StudyResults:
    """The study of an engine for which none of these steps finds anything."""
    compared = dataclasses.replace(results.rivals.compared, competitors=())
    lost = tuple(dataclasses.replace(point, best=None) for point in results.operating_map.gains.found)
    return dataclasses.replace(
        results,
        rivals=dataclasses.replace(results.rivals, compared=compared, ultimate=(), missing=NOTHING),
        operating_map=MapResult(
            gains=dataclasses.replace(results.operating_map.gains, points=lost), box=(), limit=(), nodes=(), schedule=(), missing=NOTHING
        ),
        trials=TrialsResult(optimum=(), trials=(), missing=NOTHING),
        two_inputs=TwoInputsResult(plants=(), spark=-20.0, limited_by="", warnings=(), missing=NOTHING),
    )


def test_the_optimum_under_its_bounds_is_nowhere_worse_than_the_controller(results: StudyResults) -> None:
    rows = {one.name: one for one in results.rivals.compared.competitors}
    assert {"C2d", "ziegler-nichols", "simc-pi", "amigo"} <= set(rows)
    assert max(one.ratio for one in rows.values()) <= 1.0 + 1e-3
    assert rows["C2d"].ratio < 0.2
    assert {one.name for one in results.rivals.compared.left_out} >= {"C1", "C2"}
    assert rivals_words(results.rivals).startswith(f"Of {len(rows)} controllers and rules")


def test_the_schedule_keeps_its_bound_where_no_gains_do_and_is_accepted(results: StudyResults) -> None:
    found = results.operating_map
    (schedule,), (box,) = found.schedule, found.box
    assert schedule.worst <= schedule.peak == 2.0
    assert 0.2 < box.share < 0.5
    (limit,) = found.limit
    assert limit.complete
    assert box.share <= limit.share <= 1.25 * box.share
    assert f"more than {100.0 * limit.share:.0f} % of the map: {len(limit.ruled)} proofs, each by a cover" in map_words(found)
    cut = dataclasses.replace(limit, complete=False)
    assert limit_words(cut).endswith("nearer to the box that was found they could not be brought.")
    assert "only if it does little" in map_words(found)
    trials = {one.name: one.summary for one in results.trials.trials}
    assert trials[SCHEDULE].passed
    assert len(trials[SCHEDULE].places) == 6
    assert not trials["c2d"].passed
    assert trials["optimum"].passed
    assert trials[FIXED].passed
    assert [dict(place.place) for place in trials[FIXED].places] == [{"throttle": a, "load_torque": b} for a, b in box.box.corners]


def test_points_that_cannot_be_tried_are_told() -> None:
    """Under 100 N m the engine does not rest at 15.5 deg, so that the schedule is tried at fewer points, and that is said."""
    config = StudyConfig(map_load_n_m=(0.0, 100.0))
    engine = lee1995()
    places, lost = rest_places({engine.name: engine}, SCHEDULE, map_points(config))
    assert len(places) == 5
    ((what, reason),) = lost
    assert what == "schedule at 15.5 deg, 100 N m, lee1995"
    assert "no trim" in reason


def test_points_between_the_nodes_that_were_lost_are_told(results: StudyResults) -> None:
    (schedule,) = results.operating_map.schedule
    assert lost_words(schedule) == ""
    cut = dataclasses.replace(schedule, lost=(LostPoint(place=(100.0, 40.0), reason="it stalls"),))
    assert lost_words(cut) == " 1 more could not be tried (the first: it stalls)."


def test_the_workbench_offers_the_controllers_that_the_study_finds(results: StudyResults) -> None:
    for name, *offered, _ in THESIS:
        gains = results.controllers.gains[name.lower()]
        assert offered == pytest.approx([gains.kp, gains.ki, gains.kd], rel=1e-6), name


def test_the_spark_halves_the_droop(results: StudyResults) -> None:
    (plant,) = results.two_inputs.plants
    assert "falls by 1.22 rad/s with spark and throttle, by 2.85 with the throttle alone" in two_inputs_words(results.two_inputs)
    assert plant.margins.stable


def test_fields_are_finite_json_with_units_in_their_names(config: StudyConfig, results: StudyResults) -> None:
    for found, words in ((results, "load_iae"), (without(results), "it was not there.")):
        record = {
            **rivals_fields(found.rivals, engine=config.engine, place=(25.0, 0.0)),
            **map_fields(found.operating_map),
            **trials_fields(found.trials),
            **two_inputs_fields(found.two_inputs),
        }
        text = json.dumps(record, allow_nan=False)
        assert "null" not in text
        assert words in text
        assert set(record) >= {"optimum_comparison", "operating_map", "acceptance", "two_inputs"}


def material(config: StudyConfig, results: StudyResults, folder: object) -> Material:
    made = Made(on="", version="", code="", questions="", answers="", software=(), seconds_of_numbers=0.0)
    return Material(
        config=config,
        engine=config.load_engine(),
        results=results,
        checks=(),
        warnings=(),
        figures=folder,  # type: ignore[arg-type]  # a path, from pytest
        made=made,
    )


def test_what_was_not_found_is_said_and_not_drawn(config: StudyConfig, results: StudyResults, tmp_path: object) -> None:
    none = without(results)
    drawn = {RIVALS_FIGURE, MAP_FIGURE, SCHEDULE_FIGURE, TRIALS_FIGURE, TWO_INPUTS_FIGURE}
    assert set(figure_ids(results)) - set(figure_ids(none)) == drawn
    section = design_section(material(config, none, tmp_path))
    words = [plain(block.text) for part in section.sections for block in part.blocks if isinstance(block, Paragraph)]
    assert sum("it was not there." in text for text in words) == 4
    assert not any(isinstance(block, TableBlock) for part in section.sections for block in part.blocks)
    assert sum("a part: it was not there." in text for text in find_warnings(config, none)) == 4
    assert "There is none." in caption(TRIALS_FIGURE, none)
    failed = {check.name for check in check_study(config, none) if not check.passed}
    assert {"schedule: passes the acceptance (1) or not (0)", "load steps with two inputs run to their end (1) or not (0)"} <= failed


def test_the_section_has_a_table_for_each_comparison(config: StudyConfig, results: StudyResults, tmp_path: object) -> None:
    section = design_section(material(config, results, tmp_path))
    tables = [block for part in section.sections for block in part.blocks if isinstance(block, TableBlock)]
    assert [len(table.rows) for table in tables] == [len(results.rivals.compared.competitors), 5, 12]
    names = {table.name for table in study_tables(config, results)}
    assert {"optimum_comparison", "gain_schedule", "acceptance"} <= names


def test_a_point_without_rest_has_no_design_and_a_reason(config: StudyConfig) -> None:
    away = find_two_inputs(config.load_engine(), dataclasses.replace(config, throttle_deg=3.0, amplitude_deg=1.0, half_range_deg=1.0))
    assert away.plants == ()
    assert two_inputs_words(away).startswith("No design was found: ")


def test_an_attempt_takes_the_projects_errors_alone() -> None:
    def fail() -> float:
        message = "too far"
        raise AnalysisError(message)

    assert attempt("a root", fail) == ((), (NotFound("a root", "too far"),))
    assert attempt("a root", lambda: 1.0) == ((1.0,), ())
    with pytest.raises(ZeroDivisionError):
        attempt("a root", lambda: 1 / 0)
