"""What a section is made of: paragraphs, formulas, figures, tables, checks, findings. Values only; the renderers decide how they look."""

import math
import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from revline.errors import InvalidInputError
from revline.report.inline import Text, plain
from revline.report.mathematics import Row, parse_formula

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_MOST_IN_A_ROW = 3


def check_name(kind: str, name: str) -> None:
    """Refuse a name that cannot be an anchor.

    Raises:
        InvalidInputError: it holds more than letters, digits, dots, hyphens and underscores.
    """
    if not _NAME.fullmatch(name):
        message = f"{kind} {name!r} cannot be linked to; use letters, digits, dots, hyphens and underscores, such as 4.2a or gain-region"
        raise InvalidInputError(message, name=name)


def check_words(kind: str, text: Text) -> None:
    """Refuse a text without words.

    Raises:
        InvalidInputError: it is empty or white.
    """
    if not plain(text).strip():
        message = f"{kind} is empty; say in words what it is"
        raise InvalidInputError(message)


class Align(Enum):
    """How a column's cells stand: words to the left, numbers by their decimal point or to the right."""

    LEFT = "left"
    CENTRE = "centre"
    RIGHT = "right"
    DECIMAL = "decimal"


class Tone(Enum):
    """What a highlighted cell says."""

    GOOD = "good"
    NOTE = "note"
    CAUTION = "caution"
    BAD = "bad"


class CalloutKind(Enum):
    """What a callout is: a result, a rule to design by, or a limit to mind."""

    FINDING = "finding"
    GUIDELINE = "guideline"
    CAUTION = "caution"


@dataclass(frozen=True, slots=True, eq=False)
class Paragraph:
    """Words."""

    text: Text


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ItemList:
    """Points, with bullets or numbered."""

    items: tuple[Text, ...]
    numbered: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DefinitionList:
    """Terms and what they mean."""

    items: tuple[tuple[Text, Text], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CodeBlock:
    """Lines of a program, a file or a terminal, shown as they are."""

    text: str
    caption: Text = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Equation:
    """A formula on a line of its own.

    Attributes:
        source: in the language of `revline.report.mathematics`.
        id: its number, such as "2.17", shown at its right and linked to as `equation-2.17`; none where empty.

    Raises:
        InvalidInputError: the formula cannot be read, or the number cannot be linked to.
    """

    source: str
    id: str = ""

    def __post_init__(self) -> None:
        parse_formula(self.source)
        if self.id:
            check_name("equation", self.id)

    @property
    def formula(self) -> Row:
        """The formula as a tree."""
        return parse_formula(self.source)

    @property
    def anchor(self) -> str:
        """What links name it by; empty where it has no number."""
        return f"equation-{self.id}" if self.id else ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FigureBlock:
    """A figure from its files.

    Attributes:
        id: its number, such as "4.2a", shown before the caption and linked to as `figure-4.2a`.
        caption: what the reader should see in it.
        shows: what is drawn, for those who cannot see it.
        png: file at twice the screen's resolution.
        svg: file with the same as curves, if there is one; shown instead where it is not too heavy.

    Raises:
        InvalidInputError: the number cannot be linked to, or the caption or the description is empty.
    """

    id: str
    caption: Text
    shows: str
    png: Path
    svg: Path | None = None

    def __post_init__(self) -> None:
        check_name("figure", self.id)
        check_words(f"the caption of figure {self.id}", self.caption)
        check_words(f"the description of figure {self.id}", self.shows)

    @property
    def anchor(self) -> str:
        """What links name it by."""
        return f"figure-{self.id}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FigureRow:
    """Two or three small figures side by side, such as 4.2a and 4.2b.

    Raises:
        InvalidInputError: there are fewer than two or more than three.
    """

    figures: tuple[FigureBlock, ...]

    def __post_init__(self) -> None:
        if not 1 < len(self.figures) <= _MOST_IN_A_ROW:
            message = f"{len(self.figures)} figures cannot stand side by side; give 2 or {_MOST_IN_A_ROW}"
            raise InvalidInputError(message, figures=float(len(self.figures)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Column:
    """A column of a table.

    Attributes:
        heading: its name.
        unit: symbol, shown under the name; none where empty or "1".
        align: how its cells stand.
        group: heading above this and its neighbours of the same group; none where empty.
    """

    heading: Text
    unit: str = ""
    align: Align = Align.LEFT
    group: str = ""


@dataclass(frozen=True, slots=True)
class CellMark:
    """A highlighted cell, by row and column from 0."""

    row: int
    column: int
    tone: Tone


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TableBlock:
    """A table of cells ready to be shown; the first column names the rows.

    Attributes:
        caption: what it compares or lists.
        columns: from left to right.
        rows: as many cells in each as there are columns.
        id: its number, such as "4.2", linked to as `table-4.2`; none where empty.
        notes: below it.
        marks: highlighted cells.

    Raises:
        InvalidInputError: there is no column, a row has too few or too many cells, a mark lies outside, the caption is empty, or the
            number cannot be linked to.
    """

    caption: Text
    columns: tuple[Column, ...]
    rows: tuple[tuple[Text, ...], ...]
    id: str = ""
    notes: tuple[Text, ...] = ()
    marks: tuple[CellMark, ...] = ()

    def __post_init__(self) -> None:
        check_words(f"the caption of table {self.id}".strip(), self.caption)
        name = plain(self.caption)
        if self.id:
            check_name("table", self.id)
        if not self.columns:
            message = f"table {name!r} has no column; name at least one"
            raise InvalidInputError(message, table=name)
        for number, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                message = f"table {name!r}, row {number}: {len(row)} cells for {len(self.columns)} columns; give one for each"
                raise InvalidInputError(message, table=name, row=float(number))
        for mark in self.marks:
            if not (0 <= mark.row < len(self.rows) and 0 <= mark.column < len(self.columns)):
                message = (
                    f"table {name!r}: the mark at row {mark.row}, column {mark.column} lies outside "
                    f"its {len(self.rows)} rows and {len(self.columns)} columns; count both from 0"
                )
                raise InvalidInputError(message, table=name, row=float(mark.row), column=float(mark.column))

    @property
    def anchor(self) -> str:
        """What links name it by; empty where it has no number."""
        return f"table-{self.id}" if self.id else ""

    def tone(self, row: int, column: int) -> str:
        """How a cell is highlighted: the value of its `Tone`, empty where it is plain."""
        return next((mark.tone.value for mark in self.marks if (mark.row, mark.column) == (row, column)), "")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Check:
    """A number measured against the one expected; it passes within the tolerance.

    Raises:
        InvalidInputError: a number is not finite, the tolerance is negative, or the name is empty.
    """

    name: str
    measured: float
    expected: float
    tolerance: float
    unit: str = ""

    def __post_init__(self) -> None:
        check_words("the name of a check", self.name)
        for what, value in (("measured", self.measured), ("expected", self.expected), ("tolerance", self.tolerance)):
            if not math.isfinite(value):
                message = f"check {self.name!r}: {what} = {value} is no finite number; leave out a check that could not be made"
                raise InvalidInputError(message, check=self.name)
        if self.tolerance < 0.0:
            message = f"check {self.name!r}: tolerance = {self.tolerance:g} is negative; give 0 or more"
            raise InvalidInputError(message, check=self.name, tolerance=self.tolerance)

    @property
    def passed(self) -> bool:
        """Whether the deviation is within the tolerance."""
        return abs(self.measured - self.expected) <= self.tolerance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckTable:
    """Checks of the study on itself, each with its verdict."""

    checks: tuple[Check, ...]
    caption: Text = "Measured against expected"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WarningList:
    """What the reader must know before using the results."""

    items: tuple[Text, ...]


TextBlock = Paragraph | ItemList | DefinitionList | CodeBlock | Equation
"""Blocks that may stand inside a callout."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Callout:
    """A finding, guideline or caution, set apart.

    Raises:
        InvalidInputError: the title is empty.
    """

    kind: CalloutKind
    title: Text
    blocks: tuple[TextBlock, ...] = ()

    def __post_init__(self) -> None:
        check_words(f"the title of a {self.kind.value}", self.title)


Block = TextBlock | FigureBlock | FigureRow | TableBlock | CheckTable | WarningList | Callout
"""All blocks."""
