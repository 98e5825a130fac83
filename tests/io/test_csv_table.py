from pathlib import Path

import pytest

from revline.errors import InvalidInputError
from revline.io.csv_table import read_csv_table


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "table.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_ends_separators_and_byte_order_marks_make_no_difference(tmp_path: Path, newline: str, delimiter: str, mark: str) -> None:
    rows = ["# kind: test", f"a{delimiter} b", f"1{delimiter}2.5", "", f'"3"{delimiter}-4e-3', ""]
    table = read_csv_table(write(tmp_path, mark + newline.join(rows)))
    assert table.header == ("a", "b")
    assert table.numbers("a").tolist() == [1.0, 3.0]
    assert table.numbers("b").tolist() == [2.5, -4e-3]
    assert table.lines == (3, 5)
    assert table.header_line == 2
    assert dict(table.metadata) == {"kind": "test"}


def test_metadata_comes_in_two_forms_and_plain_comments_are_passed_over(tmp_path: Path) -> None:
    table = read_csv_table(write(tmp_path, "# made by hand\n# a: 1 = 2\n#b = x: y\na\n1\n# late: yes\n2\n"))
    assert dict(table.metadata) == {"a": "1 = 2", "b": "x: y", "late": "yes"}
    assert table.numbers("a").tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty; give a CSV file"),
        ("\n  \n# only: words\n", "is empty; give a CSV file"),
        ("a,b\n", "has a header and no rows"),
        ("1,2\n3,4\n", "line 1: '1,2' is no header; name the columns"),
        ("a,b\n1,2\n3\n", "line 3: 1 cells where the header names 2 columns$"),
        ("a,b\n0,5,1,5\n", "line 2: 4 cells where the header names 2 columns; write decimal points, no commas"),
        ("a;b,c\n1;2\n", "line 1: the header holds ',' and ';'; separate the columns by one kind"),
        ('a,b\n1,"2\n', "line 2: .*; check the quotation marks"),
        (b"\x89PNG\r\n\x1a\n\0\0", r"is no text in UTF-8 \(byte 0\)"),
        (b"a,b\n1,\xb0\n", r"is no text in UTF-8 \(byte 6\)"),
        (b"\0\0\0\0", "is a binary file"),
        ("a,b\n1,2\n".encode("utf-16"), "is no text in UTF-8"),
    ],
)
def test_a_file_that_is_no_table_is_refused(tmp_path: Path, content: str | bytes, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message) as caught:
        read_csv_table(write(tmp_path, content))
    assert "table.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("x", "line 3, column b: 'x' is no finite number; write a finite number"),
        ("", "line 3, column b: an empty cell is no finite number"),
        ("nan", "line 3, column b: 'nan' is no finite number"),
        ("-inf", "line 3, column b: '-inf' is no finite number"),
        ("1e999", "line 3, column b: '1e999' is no finite number"),
        ("1_000", "line 3, column b: '1_000' is no finite number"),
        ("0,5", "line 3, column b: '0,5' is no finite number; write a decimal point, no comma"),
    ],
)
def test_a_cell_that_is_no_number_is_named(tmp_path: Path, cell: str, message: str) -> None:
    table = read_csv_table(write(tmp_path, f"a;b\n1;2\n3;{cell}\n"))
    with pytest.raises(InvalidInputError, match=message):
        table.numbers("b")


def test_a_column_that_is_missing_or_double_is_named(tmp_path: Path) -> None:
    table = read_csv_table(write(tmp_path, "a,b,b\n1,2,3\n"))
    with pytest.raises(InvalidInputError, match="line 1: there is no column c; the columns are a, b, b"):
        table.numbers("c")
    with pytest.raises(InvalidInputError, match="line 1: 2 columns are named b; keep one"):
        table.numbers("b")


def test_what_is_no_readable_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"cannot read .*absent.csv: No such file"):
        read_csv_table(tmp_path / "absent.csv")
    with pytest.raises(InvalidInputError, match=r"cannot read .*: Is a directory"):
        read_csv_table(tmp_path)
