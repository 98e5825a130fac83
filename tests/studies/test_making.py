"""A report made again says when its numbers were made, not when it was."""

from dataclasses import replace
from pathlib import Path

import pytest

from revline.errors import InvalidInputError
from revline.io.value_files import write_value
from revline.studies.making import MAKING, keep_making, read_making
from revline.studies.study_results import StudyResults

pytestmark = pytest.mark.slow


def test_results_keep_the_note_of_their_making(results: StudyResults, tmp_path: Path) -> None:
    path = tmp_path / MAKING
    keep_making(path, results, 12.5, 3)
    made = read_making(path)
    assert (made.seconds, made.kept) == (12.5, 3)
    keep_making(path, results, 0.1, 13)
    assert read_making(path) == made


def test_other_results_get_a_note_of_their_own(results: StudyResults, tmp_path: Path) -> None:
    path = tmp_path / MAKING
    keep_making(path, results, 12.5, 3)
    keep_making(path, replace(results, guidelines=("another",)), 0.1, 0)
    assert (read_making(path).seconds, read_making(path).kept) == (0.1, 0)


def test_another_value_is_refused(tmp_path: Path) -> None:
    write_value(tmp_path / MAKING, (1.0, 2.0))
    with pytest.raises(InvalidInputError, match="does not say how a study was made"):
        read_making(tmp_path / MAKING)


def test_a_damaged_note_is_written_anew(results: StudyResults, tmp_path: Path) -> None:
    (tmp_path / MAKING).write_text("{")
    keep_making(tmp_path / MAKING, results, 2.0, 0)
    assert read_making(tmp_path / MAKING).seconds == 2.0
