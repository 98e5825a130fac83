"""Tables: whole in CSV, rounded in the document."""

import csv
import io
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.report.blocks import Align, CellMark, Tone
from revline.report.inline import Math
from revline.report.tables import Compared, NumberColumn, Table, Value, comparison_table, unit_in_header, write_tables

COLUMNS = (
    NumberColumn(name="model", heading="Model"),
    NumberColumn(name="frequency", heading="Frequency", unit="rad/s", digits=3),
    NumberColumn(name="deviation", heading="Deviation", unit="%", decimals=1, signed=True),
)


def table(*rows: tuple[Value, ...], name: str = "models") -> Table:
    return Table(name=name, columns=COLUMNS, rows=rows)


@pytest.mark.parametrize(
    ("unit", "word"),
    [("rad/s", "rad_s"), ("rad/s per deg", "rad_s_per_deg"), ("1/s", "per_s"), ("%", "percent"), ("1", ""), ("", ""), ("kg m2", "kg_m2")],
)
def test_headers_name_the_unit(unit: str, word: str) -> None:
    assert unit_in_header(unit) == word
    assert NumberColumn(name="x", heading="X", unit=unit).header == (f"x_{word}" if word else "x")


def test_the_document_shows_rounded_numbers_and_the_file_whole_ones() -> None:
    third = table(("g1", 1.0 / 3.0, 0.25))
    assert third.as_block("Models").rows == (("g1", "0.333", "+0.2"),)
    assert third.as_csv() == f"model,frequency_rad_s,deviation_percent\ng1,{1.0 / 3.0!r},0.25\n"


def test_columns_of_numbers_stand_by_their_decimal_point_and_words_to_the_left() -> None:
    block = table(("g1", 1.0, 0.0)).as_block("Models", id="6.1", notes=("a note",), marks=(CellMark(0, 1, Tone.GOOD),))
    assert [column.align for column in block.columns] == [Align.LEFT, Align.DECIMAL, Align.DECIMAL]
    assert (block.anchor, block.notes, block.tone(0, 1), block.tone(0, 0)) == ("table-6.1", ("a note",), "good", "")


def test_cells_that_are_no_numbers_are_words_in_both() -> None:
    mixed = table(("g,1", None, True))
    assert mixed.as_block("Models").rows == (("g,1", "\u2013", "yes"),)
    assert mixed.as_csv().splitlines()[1] == '"g,1",,true'


def test_numpys_numbers_are_written_as_numbers() -> None:
    assert table(("g1", np.float64(0.1), 3)).as_csv().splitlines()[1] == "g1,0.1,3"


@given(
    st.lists(st.tuples(st.text(st.characters(exclude_characters="\r\0", codec="utf-8")), st.floats(allow_nan=False, allow_infinity=False)))
)
def test_files_read_back_to_the_last_bit(rows: list[tuple[str, float]]) -> None:
    written = Table(name="x", columns=COLUMNS[:2], rows=tuple(rows)).as_csv()
    _, *back = csv.reader(io.StringIO(written, newline=""))
    assert [(name, float(value)) for name, value in back] == rows


@pytest.mark.parametrize("name", ["", "Frequency", "a b", "1st"])
def test_a_column_name_that_makes_no_header_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match="makes no CSV header"):
        NumberColumn(name=name, heading="X")


def test_tables_that_make_no_file_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"table name '\.\./x' is no file name"):
        table(name="../x")
    with pytest.raises(InvalidInputError, match="2 columns are named model"):
        Table(name="x", columns=(COLUMNS[0], COLUMNS[0]), rows=())
    with pytest.raises(InvalidInputError, match="row 0: 1 values for 3 columns"):
        table(("g1",))
    with pytest.raises(InvalidInputError, match="row 0, column frequency_rad_s: inf is no finite number"):
        table(("g1", math.inf, 0.0))


def test_a_comparison_shows_ours_beside_the_reference_with_the_deviation() -> None:
    numbers, block = comparison_table(
        "table_4_2",
        "Models",
        (
            Compared(quantity="G1 gain", ours=12.2163, reference=12.216, shown=(Math("G_1"), " gain")),
            Compared(quantity="lag", ours=1.1, reference=1.0, unit="s"),
        ),
        id="4.2",
        limit_percent=1.0,
    )
    assert numbers.as_csv().splitlines()[0] == "quantity,unit,reference_in_unit,revline_in_unit,deviation_percent"
    assert block.rows[0] == ((Math("G_1"), " gain"), "", "12.216", "12.216", "0.00")
    assert block.rows[1] == ("lag", "s", "1.0000", "1.1000", "+10.00")
    assert [(mark.row, mark.column) for mark in block.marks] == [(1, 4)]


def test_tables_are_written_into_a_folder_made_for_them(tmp_path: Path) -> None:
    folder = tmp_path / "out" / "tables"
    (path,) = write_tables(folder, (table(("g1", 1.0, 2.0)),))
    assert path == folder / "models.csv"
    assert path.read_bytes() == b"model,frequency_rad_s,deviation_percent\ng1,1.0,2.0\n"
    assert [entry.name for entry in folder.iterdir()] == ["models.csv"]


def test_tables_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="2 tables are named models"):
        write_tables(tmp_path, (table(), table()))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError, match=r"folder '.*file/tables' cannot be made"):
        write_tables(tmp_path / "file" / "tables", ())


def test_a_file_that_cannot_be_written_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "models.csv").mkdir()
    with pytest.raises(InvalidInputError, match=r"table '.*models\.csv' cannot be written"):
        write_tables(tmp_path, (table(),))
    assert [entry.name for entry in tmp_path.iterdir()] == ["models.csv"]
