import os
from pathlib import Path
from typing import Any

import pytest

from revline.errors import InvalidInputError
from revline.io.atomic import check_writable, write_atomically


def test_a_file_is_written_and_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_atomically(path, "ü\n", "test file")
    write_atomically(str(path), "second\n", "test file")
    assert path.read_bytes() == b"second\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_file_gets_the_usual_permissions(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.write_text("", encoding="utf-8")
    write_atomically(tmp_path / "atomic", "", "test file")
    assert (tmp_path / "atomic").stat().st_mode == plain.stat().st_mode


def test_a_link_is_followed(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old", encoding="utf-8")
    link.symlink_to(target)
    write_atomically(link, "new", "test file")
    assert link.is_symlink()
    assert target.read_text(encoding="utf-8") == "new"


def test_what_is_no_regular_file_is_written_to_directly() -> None:
    write_atomically(os.devnull, "gone", "test file")
    assert not Path(os.devnull).is_file()


def test_a_failure_leaves_the_old_file_and_no_part_of_the_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    path.write_text("old", encoding="utf-8")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        InvalidInputError, match=r"test file '.*a.json' cannot be written: No space left on device; name a file in a folder"
    ):
        write_atomically(path, "new", "test file")
    assert path.read_text(encoding="utf-8") == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_folder_that_may_not_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(self: Path, *_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", forbidden)
    with pytest.raises(InvalidInputError, match=r"cannot be written: Permission denied; name a file in a folder that may be written"):
        write_atomically(tmp_path / "a.json", "new", "test file")


def test_impossible_places_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"test file .*a.json cannot be written: its folder .*missing does not exist"):
        write_atomically(tmp_path / "missing" / "a.json", "x", "test file")
    with pytest.raises(InvalidInputError, match=r"cannot be written: it is a folder; name a file in it"):
        write_atomically(tmp_path, "x", "test file")
    with pytest.raises(InvalidInputError, match=r"cannot be written: .*null"):
        write_atomically("a\0b", "x", "test file")
    with pytest.raises(InvalidInputError, match=r"cannot be written: .*surrogates not allowed"):
        write_atomically(tmp_path / "a.json", "\udc80", "test file")
    assert not list(tmp_path.iterdir())


def test_a_writable_place_passes_and_stays_as_it_was(tmp_path: Path) -> None:
    check_writable(tmp_path / "new.csv", "table")
    check_writable("/dev/null", "table")
    assert list(tmp_path.iterdir()) == []
    path = tmp_path / "old.csv"
    path.write_text("kept")
    check_writable(path, "table")
    assert path.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [path]


def test_a_place_that_cannot_be_written_is_refused_beforehand(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"absent.a\.csv cannot be written: its folder .*absent does not exist; make it"):
        check_writable(tmp_path / "absent" / "a.csv", "table")
    with pytest.raises(InvalidInputError, match="it is a folder; name a file in it"):
        check_writable(tmp_path, "table")
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError, match="cannot be written: Not a directory"):
        check_writable(tmp_path / "file" / "a.csv", "table")
