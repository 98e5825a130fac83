from pathlib import Path

import pytest

from revline.errors import InvalidInputError
from revline.io.texts import read_text, write_text


def test_a_text_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "Größe\n1\n", "note")
    assert path.read_bytes() == "Größe\n1\n".encode()
    assert read_text(path, "note") == "Größe\n1\n"


def test_a_byte_order_mark_and_carriage_returns_are_no_content(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfa\r\nb")
    assert read_text(path, "note") == "a\nb"


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"note .*gone\.txt does not exist; check the path"):
        read_text(tmp_path / "gone.txt", "note")


def test_a_directory_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="is a directory; name a file in it"):
        read_text(tmp_path, "note")


def test_another_encoding_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"one\ntwo\nGr\xf6\xdfe\n")
    with pytest.raises(InvalidInputError, match=r"line 3: not UTF-8 text \(invalid start byte\); save it with the encoding UTF-8"):
        read_text(path, "note")


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000])
def test_an_impossible_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidInputError, match=r"cannot be read: .*; check its name and permissions"):
        read_text(tmp_path / name, "note")
    with pytest.raises(InvalidInputError, match=r"cannot be written: .*; name a file in a folder that may be written"):
        write_text(tmp_path / name, "", "note")


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"its folder .*sub does not exist; make it first"):
        write_text(tmp_path / "sub" / "a.txt", "", "note")


def test_a_directory_is_not_overwritten(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"cannot be written: .*Is a directory"):
        write_text(tmp_path, "", "note")
