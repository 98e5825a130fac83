"""Two studies side by side: what differs is found, and nothing else."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from revline.errors import InvalidInputError
from revline.studies.comparison import compare_studies

RECORD: dict[str, Any] = {
    "schema": "revline.study/1",
    "engine": "lee1995",
    "seconds": 12.0,
    "operating_point": {"speed_rad_s": 240.8, "stable": True},
    "frequency_response": [
        {"method": "peaks", "frequency_rad_s": 1.0, "amplitude_rad_s": 54.0},
        {"method": "fourier", "frequency_rad_s": 1.0, "amplitude_rad_s": 54.1},
    ],
    "closed_loops": [{"controller": "c1", "plant": "engine", "outcome": "limit-cycle", "steady_error_rad_s": 1e-14}],
    "models": {"g1": {"numerator": [12.2], "poles": [[-1.7, 0.0]]}},
    "guidelines": ["words"],
}


def write(folder: Path, record: dict[str, Any]) -> Path:
    folder.mkdir()
    (folder / "results.json").write_text(json.dumps(record))
    return folder


@pytest.fixture
def first(tmp_path: Path) -> Path:
    return write(tmp_path / "first", RECORD)


def changed(tmp_path: Path, **entries: object) -> Path:
    return write(tmp_path / "second", {**copy.deepcopy(RECORD), **entries})


def test_a_study_is_the_same_as_itself_run_again(first: Path, tmp_path: Path) -> None:
    found = compare_studies(first, changed(tmp_path, seconds=3.0, guidelines=["other words"]))
    assert found.same
    assert found.compared == 10


def test_entries_are_matched_by_their_names(first: Path, tmp_path: Path) -> None:
    swapped = list(reversed(RECORD["frequency_response"]))
    assert compare_studies(first, changed(tmp_path, frequency_response=swapped)).same


def test_a_number_and_an_outcome_that_differ_are_found_the_largest_first(first: Path, tmp_path: Path) -> None:
    loops = [{"controller": "c1", "plant": "engine", "outcome": "settled", "steady_error_rad_s": -2e-14}]
    response = copy.deepcopy(RECORD["frequency_response"])
    response[1]["amplitude_rad_s"] *= 1.0 + 1e-6
    other = changed(tmp_path, closed_loops=loops, frequency_response=response)
    found = compare_studies(first, other)
    assert [d.path for d in found.differences] == ["closed_loops[c1, engine].outcome", "frequency_response[fourier, 1].amplitude_rad_s"]
    assert [d.relative for d in found.differences] == pytest.approx([1.0, 1e-6], rel=1e-5)
    assert (found.differences[0].first, found.differences[0].second) == ("limit-cycle", "settled")
    assert len(compare_studies(first, other, tolerance=1e-5).differences) == 1


def test_what_only_one_has_is_named(first: Path, tmp_path: Path) -> None:
    found = compare_studies(first, changed(tmp_path, frequency_response=RECORD["frequency_response"][:1], extra=1.0))
    assert found.only_first == ("frequency_response[fourier, 1].amplitude_rad_s",)
    assert found.only_second == ("extra",)
    assert not found.same


def test_entries_of_one_name_do_not_hide_one_another(tmp_path: Path) -> None:
    twice = [{"controller": "c1", "plant": "engine", "value": value} for value in (1.0, 2.0)]
    other = write(tmp_path / "third", {**copy.deepcopy(RECORD), "closed_loops": [{**twice[0], "value": 3.0}, twice[1]]})
    found = compare_studies(changed(tmp_path, closed_loops=twice), other)
    assert [d.path for d in found.differences] == ["closed_loops[c1, engine].value"]


def test_a_truth_value_is_no_number(first: Path, tmp_path: Path) -> None:
    found = compare_studies(first, changed(tmp_path, operating_point={"speed_rad_s": 240.8, "stable": 1}))
    assert [d.path for d in found.differences] == ["operating_point.stable"]


def test_what_is_no_study_is_refused(first: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="tolerance = 2"):
        compare_studies(first, first, tolerance=2.0)
    with pytest.raises(InvalidInputError, match="cannot be read"):
        compare_studies(first, tmp_path / "absent")
    with pytest.raises(InvalidInputError, match=r"revline\.engine/1"):
        compare_studies(first, write(tmp_path / "engine", {"schema": "revline.engine/1"}))
    with pytest.raises(InvalidInputError, match="holds no study: there is no operating_point"):
        compare_studies(first, write(tmp_path / "empty", {}))
