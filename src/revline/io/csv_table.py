"""CSV tables of numbers with a header, units in the column names, and comment lines `# key: value`; errors name line and column."""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from revline.errors import InvalidInputError
from revline.lti.response import Floats

_DELIMITERS = (",", ";", "\t")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CsvTable:
    """The cells of a CSV file, not yet numbers.

    Attributes:
        path: of the file.
        header: column names, stripped.
        rows: cells, as many in each row as there are columns.
        lines: line number of each row in the file, from 1.
        header_line: line number of the header.
        metadata: what the comment lines `# key: value` or `# key = value` say.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    header_line: int
    metadata: Mapping[str, str]

    def position(self, name: str) -> int:
        """Find a column.

        Raises:
            InvalidInputError: there is none of that name, or more than one.
        """
        count = self.header.count(name)
        if count == 0:
            message = f"{self.path}, line {self.header_line}: there is no column {name}; the columns are {', '.join(self.header)}"
            raise InvalidInputError(message, column=name)
        if count > 1:
            message = f"{self.path}, line {self.header_line}: {count} columns are named {name}; keep one"
            raise InvalidInputError(message, column=name)
        return self.header.index(name)

    def numbers(self, name: str) -> Floats:
        """Read a column as finite numbers.

        Raises:
            InvalidInputError: there is no such column, or a cell is no finite number.
        """
        position = self.position(name)
        return np.array([self._number(row[position], line, name) for row, line in zip(self.rows, self.lines, strict=True)])

    def error(self, row: int, name: str, what: str) -> InvalidInputError:
        """Build the error for a cell whose number will not do."""
        return InvalidInputError(f"{self.path}, line {self.lines[row]}, column {name}: {what}", line=float(self.lines[row]), column=name)

    def _number(self, cell: str, line: int, name: str) -> float:
        text = cell.strip()
        try:
            value = math.nan if "_" in text else float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            hint = "write a decimal point, no comma" if "," in text else "write a finite number"
            shown = repr(text) if text else "an empty cell"
            message = f"{self.path}, line {line}, column {name}: {shown} is no finite number; {hint}"
            raise InvalidInputError(message, line=float(line), column=name)
        return value


def read_csv_table(path: str | Path) -> CsvTable:
    """Read a CSV file: UTF-8 with or without byte order mark, any line ends, separated by commas, semicolons or tabs.

    Args:
        path: of the file.

    Returns:
        Header, rows and metadata.

    Raises:
        InvalidInputError: the file cannot be read, is no text, has no header or no rows, mixes separators, or a row has too few or too
            many cells.
    """
    return parse_csv_table(_read_text(Path(path)), Path(path))


def parse_csv_table(text: str, place: Path) -> CsvTable:
    """Take the cells from the text of a CSV file, as `read_csv_table` does.

    Args:
        text: of the file.
        place: what messages call it.

    Raises:
        InvalidInputError: see `read_csv_table`.
    """
    if "\0" in text:
        message = f"{place} is a binary file; give a CSV file"
        raise InvalidInputError(message)
    metadata: dict[str, str] = {}
    table: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("#"):
            metadata.update(_metadata_entry(line))
        elif line.strip(" \t,;"):
            table.append((number, line))
    if not table:
        message = f"{place} is empty; give a CSV file with a header line and rows of numbers"
        raise InvalidInputError(message)
    header_line, first = table[0]
    delimiter = _find_delimiter(place, header_line, first)
    header = _split(place, header_line, first, delimiter)
    if all(_is_number(name) for name in header):
        message = f"{place}, line {header_line}: {first!r} is no header; name the columns and their units in the first line"
        raise InvalidInputError(message)
    rows = tuple(_split(place, number, line, delimiter) for number, line in table[1:])
    if not rows:
        message = f"{place} has a header and no rows; give a row of numbers for each frequency or time"
        raise InvalidInputError(message)
    for row, (number, _) in zip(rows, table[1:], strict=True):
        if len(row) != len(header):
            hint = "; write decimal points, no commas" if delimiter == "," and len(row) > len(header) else ""
            message = f"{place}, line {number}: {len(row)} cells where the header names {len(header)} columns{hint}"
            raise InvalidInputError(message, line=float(number))
    return CsvTable(
        path=place,
        header=header,
        rows=rows,
        lines=tuple(number for number, _ in table[1:]),
        header_line=header_line,
        metadata=MappingProxyType(metadata),
    )


def _read_text(path: Path) -> str:
    try:
        content = path.read_bytes()
    except OSError as problem:
        message = f"cannot read {path}: {problem.strerror or problem}; give the path of a CSV file"
        raise InvalidInputError(message) from problem
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        message = f"{path} is no text in UTF-8 (byte {problem.start}); save it as CSV in UTF-8"
        raise InvalidInputError(message) from problem
    return text


def _metadata_entry(line: str) -> dict[str, str]:
    """The entry of one comment line, none where it is plain text."""
    text = line.lstrip("#").strip()
    separator = next((character for character in text if character in ":="), "")
    if not separator:
        return {}
    key, value = text.split(separator, 1)
    return {key.strip(): value.strip()}


def _find_delimiter(path: Path, line: int, header: str) -> str:
    found = [delimiter for delimiter in _DELIMITERS if delimiter in header]
    if len(found) > 1:
        names = " and ".join(repr(delimiter) for delimiter in found)
        message = f"{path}, line {line}: the header holds {names}; separate the columns by one kind of character"
        raise InvalidInputError(message)
    return found[0] if found else ","


def _split(path: Path, line: int, text: str, delimiter: str) -> tuple[str, ...]:
    try:
        return tuple(cell.strip() for cell in next(csv.reader([text], delimiter=delimiter, strict=True)))
    except csv.Error as problem:
        message = f"{path}, line {line}: {problem}; check the quotation marks"
        raise InvalidInputError(message, line=float(line)) from problem


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
