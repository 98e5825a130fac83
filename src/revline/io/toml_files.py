"""TOML files of foreign hand, read key by key with errors that name file, line, key, value and remedy."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time
from types import MappingProxyType
from typing import Any

from revline.errors import InvalidInputError, suggestion

KINDS = MappingProxyType(
    {
        bool: "a boolean",
        str: "a text",
        int: "an integer",
        float: "a number",
        list: "an array",
        dict: "a table",
        datetime: "a date or time",
        date: "a date or time",
        time: "a date or time",
    }
)
"""How messages call the types that TOML has."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TomlFile:
    """The content of a TOML file with one level of sections, and the way to read it with good errors.

    Attributes:
        place: where it comes from, for messages: "engine file e.toml".
        text: the file's text, where errors look up their line.
        content: what `tomllib` made of it.
        remedy: where a correct file is to be had, at the end of messages about the file as a whole.
    """

    place: str
    text: str
    content: Mapping[str, Any]
    remedy: str

    def error(self, section: str, key: str, message: str, **details: float | str) -> InvalidInputError:
        """Build the error for a key: its file and line stand before the message."""
        line = find_line(self.text, section, key)
        where = f"{self.place}, line {line}" if line else self.place
        return InvalidInputError(f"{where}: {message}", section=section, key=key, line=line, **details)

    def table(self, section: str) -> Mapping[str, Any]:
        """Read a section.

        Raises:
            InvalidInputError: it is missing or no table.
        """
        if section not in self.content:
            message = f"{self.place}: section [{section}] is missing; add it ({self.remedy})"
            raise InvalidInputError(message, section=section)
        table = self.content[section]
        if not isinstance(table, dict):
            message = f"{section} = {table!r} is {kind_of(table)}, not a section; write [{section}] with its keys below"
            raise self.error("", section, message)
        return table

    def refuse_unknown(self, section: str, known: Sequence[str]) -> None:
        """Refuse keys that mean nothing in a section; "" stands for the top of the file.

        Raises:
            InvalidInputError: there is one; the message suggests the nearest known.
        """
        table = self.table(section) if section else self.content
        for key in table:
            if key not in known:
                what = f"unknown key {section}.{key}" if section else f"unknown key or section {key}"
                message = f"{what}{suggestion(key, known)}; known are {', '.join(known)}"
                raise self.error(section, key, message)

    def value(self, section: str, key: str, expected: str) -> Any:
        """Read a key; "" as section stands for the top of the file.

        Raises:
            InvalidInputError: it is missing; the message says what is expected.
        """
        table = self.table(section) if section else self.content
        if key not in table:
            place = f"under [{section}]" if section else "at the top"
            message = f"{dotted(section, key)} is missing; add {key} = <{expected}> {place} ({self.remedy})"
            raise self.error("", section or key, message)
        return table[key]

    def number(self, section: str, key: str, unit: str) -> float:
        """Read a number; an integer is one too, a boolean is not.

        Raises:
            InvalidInputError: it is missing, of another type, or not finite.
        """
        value = self.value(section, key, f"number in {unit}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            shown = str(value).lower() if isinstance(value, bool) else repr(value)
            message = f"{dotted(section, key)} = {shown} is {kind_of(value)}; give a number in {unit}, without quotes"
            raise self.error(section, key, message)
        try:
            number = float(value)
        except OverflowError as error:
            message = f"{dotted(section, key)} is too large an integer; give a number in {unit}"
            raise self.error(section, key, message) from error
        if number - number != 0.0:
            message = f"{dotted(section, key)} = {number} is no finite number; give one in {unit}"
            raise self.error(section, key, message)
        return number

    def line_of_text(self, section: str, key: str) -> str:
        """Read a printable text of one line.

        Raises:
            InvalidInputError: it is missing, of another type, empty or not printable.
        """
        value = self.value(section, key, "text in quotes")
        if not isinstance(value, str):
            message = f"{dotted(section, key)} = {value!r} is {kind_of(value)}; give a text in quotes"
            raise self.error(section, key, message)
        if not value.strip() or not value.isprintable():
            message = f"{dotted(section, key)} = {value!r} is no printable text of one line; give one"
            raise self.error(section, key, message)
        return value

    def choice(self, section: str, key: str, choices: Sequence[str]) -> str:
        """Read one of some texts.

        Raises:
            InvalidInputError: it is missing, no text, or none of them; the message lists them.
        """
        value = self.line_of_text(section, key)
        if value not in choices:
            listed = ", ".join(f'"{choice}"' for choice in choices)
            message = f'{dotted(section, key)} = "{value}" is unknown{suggestion(value, choices)}; there are {listed}'
            raise self.error(section, key, message)
        return value


def parse_toml(text: str, *, place: str, schema: str, remedy: str) -> TomlFile:
    """Parse the text of a TOML file and check which schema it follows.

    Args:
        text: the file's text.
        place: where it comes from, for messages.
        schema: what its key `schema` must say.
        remedy: where a correct file is to be had, for messages.

    Raises:
        InvalidInputError: the text is no TOML, or of another schema or version.
    """
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        message = f"{place} is no valid TOML: {error}; mend that line ({remedy})"
        raise InvalidInputError(message) from error
    file = TomlFile(place=place, text=text, content=content, remedy=remedy)
    found = file.value("", "schema", f'"{schema}"')
    if found != schema:
        message = f'schema = {found!r} cannot be read; this version reads "{schema}" ({remedy})'
        raise file.error("", "schema", message)
    return file


def kind_of(value: object) -> str:
    """Say in words of which type a value of a TOML file is."""
    return KINDS.get(type(value), f"a {type(value).__name__}")


def dotted(section: str, key: str) -> str:
    """Name a key with its section, as messages do."""
    return f"{section}.{key}" if section else key


def find_line(text: str, section: str, key: str) -> int:
    """Find the line of a key, or of a section where `section` is "", in a TOML file's text.

    Returns:
        The line, counted from 1; 0 where the key is written in a form that this does not follow (inline tables).
    """
    heading, current = re.compile(r"""\s*\[\s*["']?([\w.-]+)["']?\s*\]"""), ""
    wanted = re.compile(rf"""\s*["']?{re.escape(key)}["']?\s*(=|\.)""")
    whole = re.compile(rf"""\s*["']?{re.escape(section)}["']?\s*\.\s*["']?{re.escape(key)}["']?\s*=""")
    for number, line in enumerate(text.split("\n"), start=1):
        found = heading.match(line)
        if found:
            current = found[1]
            if not section and current == key:
                return number
        elif (current == section and wanted.match(line)) or (section and not current and whole.match(line)):
            return number
    return 0
