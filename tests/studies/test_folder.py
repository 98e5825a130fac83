"""A study's folder: kept from other studies, and rid of what answered other questions."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from revline.errors import InvalidInputError
from revline.studies.chain import FOLDER
from revline.studies.folder import WRITTEN, Written, is_finished, keep_written, read_written, remove_files, study_folder

HOLD = """
import sys
from pathlib import Path
from revline.studies.folder import study_folder
with study_folder(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""


def written(*files: str, questions: str = "q", code: str = "c", is_whole: bool = True) -> Written:
    return Written(questions=questions, code=code, is_whole=is_whole, files=files)


def test_a_second_study_in_the_folder_is_refused_until_the_first_ends(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as first:  # noqa: S603 - our own program
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        with (
            pytest.raises(InvalidInputError, match=r"another study is at work in .*; wait for its end, or name another"),
            study_folder(tmp_path),
        ):
            pass
        first.kill()
    with study_folder(tmp_path) as steps:
        assert steps == tmp_path / FOLDER


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with (
        pytest.raises(InvalidInputError, match=r"the folder .*file cannot be written: .*; name one that may be written with --out"),
        study_folder(tmp_path / "file"),
    ):
        pass
    assert (tmp_path / "file").read_text() == "mine"


def test_only_the_very_study_counts_as_finished(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    assert is_finished(tmp_path, written("a"), "q", "c")
    for other in (written("a", questions="x"), written("a", code="x"), written("a", is_whole=False), written("a", "gone"), None):
        assert not is_finished(tmp_path, other, "q", "c")


def test_what_was_written_is_noted_and_a_damaged_note_is_none(tmp_path: Path) -> None:
    assert read_written(tmp_path) is None
    keep_written(tmp_path, written("a", "b"))
    assert read_written(tmp_path) == written("a", "b")
    (tmp_path / WRITTEN).write_text("{")
    assert read_written(tmp_path) is None
    (tmp_path / WRITTEN).write_text(json.dumps({"schema": "revline.value/1", "value": 1.0}))
    assert read_written(tmp_path) is None


def test_only_files_of_the_folder_are_removed(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    folder.mkdir()
    for path in (folder / "ours", folder / "yours", tmp_path / "outside"):
        path.write_text("")
    remove_files(folder, ("ours", "gone", "../outside", str(tmp_path / "outside")))
    assert sorted(path.name for path in tmp_path.rglob("*") if path.is_file()) == ["outside", "yours"]
