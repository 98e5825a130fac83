"""Tables of numbers: kept whole for CSV files, rounded for the reader, and compared with a reference."""

import csv
import io
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from revline.errors import InvalidInputError
from revline.report.blocks import Align, CellMark, Column, TableBlock, Tone
from revline.report.files import write_whole
from revline.report.inline import Text
from revline.report.numbers import deviation_percent, format_decimals, format_number, format_unit

Value = float | int | str | bool | None
"""A cell: a number, a word, yes or no, or nothing where the quantity does not exist."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_UNIT_WORDS = (("%", "percent"), ("deg C", "celsius"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NumberColumn:
    """A column of values.

    Attributes:
        name: in lower case with underscores, without the unit: the CSV header is "<name>_<unit>".
        heading: as the reader sees it.
        unit: symbol as in `revline.units`; "1" for pure numbers, empty for words.
        digits: significant digits shown.
        decimals: decimals shown instead, for columns whose numbers share a resolution.
        signed: whether positive numbers show their sign, as deviations do.
        group: heading above this and its neighbours of the same group.

    Raises:
        InvalidInputError: the name would make no header.
    """

    name: str
    heading: Text
    unit: str = ""
    digits: int = 4
    decimals: int | None = None
    signed: bool = False
    group: str = ""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            message = f"column name {self.name!r} makes no CSV header; use lower-case letters, digits and underscores"
            raise InvalidInputError(message, column=self.name)

    @property
    def header(self) -> str:
        """Name and unit as CSV has them: "frequency_rad_s", "gain_rad_s_per_deg"; a pure number has its name alone."""
        unit = unit_in_header(self.unit)
        return f"{self.name}_{unit}" if unit else self.name

    def show(self, value: Value) -> str:
        """A value as the reader sees it; a dash where there is none."""
        if value is None:
            return "\u2013"
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, str):
            return value
        text = format_number(value, self.digits) if self.decimals is None else format_decimals(value, self.decimals)
        return f"+{text}" if self.signed and value > 0.0 and text.strip("0.") else text


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """A table by name, with its numbers whole.

    Attributes:
        name: of its CSV file, without ".csv".
        columns: from left to right.
        rows: as many values in each as there are columns.

    Raises:
        InvalidInputError: the name is no file name, two columns share a header, a row has too few or too many values, or a number is
            not finite.
    """

    name: str
    columns: tuple[NumberColumn, ...]
    rows: tuple[tuple[Value, ...], ...]

    def __post_init__(self) -> None:
        if not _FILE_NAME.fullmatch(self.name):
            message = f"table name {self.name!r} is no file name; use letters, digits, dots, hyphens and underscores"
            raise InvalidInputError(message, table=self.name)
        headers = [column.header for column in self.columns]
        for header in headers:
            if headers.count(header) > 1:
                message = f"table {self.name}: {headers.count(header)} columns are named {header}; give each its own name"
                raise InvalidInputError(message, table=self.name, column=header)
        for number, row in enumerate(self.rows):
            if len(row) != len(headers):
                message = f"table {self.name}, row {number}: {len(row)} values for {len(headers)} columns; give one for each"
                raise InvalidInputError(message, table=self.name, row=float(number))
            for header, value in zip(headers, row, strict=True):
                if value is not None and not isinstance(value, str) and not math.isfinite(value):
                    message = (
                        f"table {self.name}, row {number}, column {header}: {value} is no finite number; give None where there is none"
                    )
                    raise InvalidInputError(message, table=self.name, row=float(number), column=header)

    def as_block(
        self,
        caption: Text,
        *,
        id: str = "",  # noqa: A002 - as in TableBlock
        notes: tuple[Text, ...] = (),
        marks: tuple[CellMark, ...] = (),
    ) -> TableBlock:
        """The table as the document shows it, numbers rounded and aligned by their decimal points.

        Args:
            caption: what it compares or lists.
            id: its number, such as "4.2".
            notes: below it.
            marks: highlighted cells.
        """
        return TableBlock(
            caption=caption,
            id=id,
            columns=tuple(
                Column(heading=column.heading, unit=column.unit, group=column.group, align=Align.DECIMAL if column.unit else Align.LEFT)
                for column in self.columns
            ),
            rows=tuple(tuple(column.show(value) for column, value in zip(self.columns, row, strict=True)) for row in self.rows),
            notes=notes,
            marks=marks,
        )

    def as_csv(self) -> str:
        """The table as CSV with a header that names the units; numbers read back to the last bit, what does not exist is empty."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.header for column in self.columns])
        writer.writerows([[_csv_cell(value) for value in row] for row in self.rows])
        return text.getvalue()


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A quantity of ours beside its reference.

    Attributes:
        quantity: its name in words, in the document and in the CSV file.
        ours: computed here.
        reference: published; not 0, as the deviation is in per cent of it.
        unit: of both.
        shown: the name with markup, where the document should show it so.
    """

    quantity: str
    ours: float
    reference: float
    unit: str = "1"
    shown: Text = ""


def comparison_table(
    name: str,
    caption: Text,
    rows: Iterable[Compared],
    *,
    id: str = "",  # noqa: A002 - as in TableBlock
    digits: int = 5,
    limit_percent: float | None = None,
) -> tuple[Table, TableBlock]:
    """Set quantities beside their references with the deviation in per cent, each row in its own unit.

    Args:
        name: of the CSV file.
        caption: what is compared.
        rows: the quantities.
        id: number of the table.
        digits: significant digits shown.
        limit_percent: deviations beyond it are highlighted; none where absent.

    Returns:
        The numbers for CSV, and the block for the document.

    Raises:
        InvalidInputError: a number is not finite, or a reference is 0.
    """
    compared = tuple(rows)
    deviations = tuple(deviation_percent(row.ours, row.reference) for row in compared)
    table = Table(
        name=name,
        columns=(
            NumberColumn(name="quantity", heading="Quantity"),
            NumberColumn(name="unit", heading="Unit"),
            NumberColumn(name="reference_in_unit", heading="Thesis", unit="1", digits=digits),
            NumberColumn(name="revline_in_unit", heading="revline", unit="1", digits=digits),
            NumberColumn(name="deviation", heading="Deviation", unit="%", decimals=2, signed=True),
        ),
        rows=tuple(
            (row.quantity, row.unit, row.reference, row.ours, deviation) for row, deviation in zip(compared, deviations, strict=True)
        ),
    )
    beyond = tuple(
        CellMark(place, len(table.columns) - 1, Tone.CAUTION)
        for place, deviation in enumerate(deviations)
        if limit_percent is not None and abs(deviation) > limit_percent
    )
    block = table.as_block(caption, id=id, marks=beyond)
    named = tuple((row.shown or row.quantity, format_unit(row.unit), *cells[2:]) for row, cells in zip(compared, block.rows, strict=True))
    return table, TableBlock(caption=caption, id=id, columns=block.columns, rows=named, marks=beyond)


def unit_in_header(unit: str) -> str:
    """A unit symbol as part of a CSV header: "rad/s" gives "rad_s", "1/s" "per_s", "%" "percent"; nothing for words and pure numbers."""
    if unit in {"", "1"}:
        return ""
    for symbol, word in _UNIT_WORDS:
        unit = unit.replace(symbol, word)
    if unit.startswith("1/"):
        unit = f"per {unit[2:]}"
    return re.sub(r"[^a-z0-9]+", "_", unit.lower()).strip("_")


def write_tables(folder: str | Path, tables: Iterable[Table]) -> tuple[Path, ...]:
    """Write each table as "<name>.csv" into a folder, which is made where it is missing.

    Args:
        folder: where to.
        tables: with names of their own.

    Returns:
        The files, in the order of the tables.

    Raises:
        InvalidInputError: two tables share a name, or the folder cannot be made or written.
    """
    ready = tuple(tables)
    names = [table.name for table in ready]
    for name in names:
        if names.count(name) > 1:
            message = f"{names.count(name)} tables are named {name}; give each its own name"
            raise InvalidInputError(message, table=name)
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"folder {str(folder)!r} cannot be made: {error.strerror}; name a folder that may be made"
        raise InvalidInputError(message, path=str(folder)) from error
    paths = tuple(place / f"{name}.csv" for name in names)
    for table, path in zip(ready, paths, strict=True):
        write_whole(path, table.as_csv().encode(), "table")
    return paths


def _csv_cell(value: Value) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    return str(value) if isinstance(value, int) else repr(float(value))  # numpy's floats have a repr of their own
