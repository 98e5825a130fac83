"""JSON files: finite numbers only, both ways, and errors that name file, key and value."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from revline.errors import InvalidInputError
from revline.io.atomic import write_atomically

Json = Any
"""What a JSON text may hold: mappings, lists, texts, numbers, true and false."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JsonRecord:
    """The object that a JSON file holds, read key by key; keys that nobody asks for are left alone.

    Attributes:
        where: what and which file it is, for messages: "controller file c1.json".
        entries: the object.
    """

    where: str
    entries: Mapping[str, Json]

    def require_schema(self, schema: str) -> None:
        """Check the schema where the file names one.

        Args:
            schema: with version, for example "revline.controller/1".

        Raises:
            InvalidInputError: the file is of another kind or version.
        """
        if self.entries.get("schema", schema) != schema:
            message = f'{self.where}: its schema is {self.entries["schema"]!r}, and "{schema}" is wanted; give the right file'
            raise InvalidInputError(message)

    def number(self, key: str) -> float:
        """Read a finite number.

        Raises:
            InvalidInputError: it is missing, or something else.
        """
        return self._finite(key, self._value(key, "a number; give it, 0 for none"))

    def numbers(self, key: str) -> tuple[float, ...]:
        """Read a list of finite numbers, at least one.

        Raises:
            InvalidInputError: it is missing, or something else.
        """
        value = self._value(key, "a list of numbers")
        if not isinstance(value, list) or not value:
            raise self._wrong(key, value, "a list of at least one number, for example [12.0, 0.5]")
        return tuple(self._finite(f"{key}[{k}]", entry) for k, entry in enumerate(value))

    def text(self, key: str, default: str) -> str:
        """Read a text that is not empty; the default where it is missing.

        Raises:
            InvalidInputError: it is something else, or empty.
        """
        value = self.entries.get(key, default)
        if not isinstance(value, str) or not value:
            raise self._wrong(key, value, "a text")
        return value

    def notes(self, key: str) -> Mapping[str, float | str]:
        """Read an object of numbers and texts; an empty one where it is missing.

        Raises:
            InvalidInputError: it, or an entry of it, is something else.
        """
        value = self.entries.get(key, {})
        if not isinstance(value, dict):
            raise self._wrong(key, value, "an object of numbers and texts")
        return {name: entry if isinstance(entry, str) else self._finite(f"{key}.{name}", entry) for name, entry in value.items()}

    def _value(self, key: str, wanted: str) -> Json:
        if key not in self.entries:
            message = f'{self.where}: "{key}" is missing, {wanted}'
            raise InvalidInputError(message, key=key)
        return self.entries[key]

    def _finite(self, key: str, value: Json) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._wrong(key, value, "a number")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self._wrong(key, value, "a finite number")
        return number

    def _wrong(self, key: str, value: Json, wanted: str) -> InvalidInputError:
        shown = json.dumps(value, default=str)
        shown = shown if len(shown) <= 60 else f"{shown[:57]}..."
        return InvalidInputError(f'{self.where}: "{key}" is {shown} ({_kind(value)}), and {wanted} is wanted', key=key)


def read_json(path: str | Path, what: str) -> JsonRecord:
    """Read a JSON file that holds one object.

    Args:
        path: the file, in UTF-8.
        what: what it should be, for messages: "controller file".

    Raises:
        InvalidInputError: the file cannot be read, is no JSON, holds NaN, infinity or a key twice, or holds no object.
    """
    where = f"{what} {path}"
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"{where}: not UTF-8 text ({error.reason} at byte {error.start}); save it with the encoding UTF-8"
        raise InvalidInputError(message, path=str(path)) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        message = f"{what} {str(path)!r} cannot be read: {reason}; check its name and permissions"
        raise InvalidInputError(message, path=str(path)) from error
    return parse_json(text, where)


def parse_json(text: str, where: str) -> JsonRecord:
    """Parse a JSON text that holds one object.

    Args:
        text: the JSON.
        where: where it stands, for messages.

    Raises:
        InvalidInputError: it is no JSON, holds NaN, infinity or a key twice, or holds no object.
    """
    try:
        entries = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique)
    except json.JSONDecodeError as error:
        message = f"{where}, line {error.lineno}, column {error.colno}: no JSON ({error.msg}); mend it there"
        raise InvalidInputError(message, line=error.lineno) from error
    except RecursionError as error:
        message = f"{where}: nested too deeply to be read"
        raise InvalidInputError(message) from error
    except ValueError as error:
        message = f"{where}: {error}"
        raise InvalidInputError(message) from error
    if not isinstance(entries, dict):
        message = f'{where}: holds {_kind(entries)}, and an object is wanted: {{"key": value, ...}}'
        raise InvalidInputError(message)
    return JsonRecord(where=where, entries=entries)


def write_json(path: str | Path, record: Mapping[str, object], what: str) -> None:
    """Write an object to a JSON file, whole or not at all; numbers keep every bit.

    Args:
        path: the file; replaced if it is there.
        record: texts, finite numbers, truth values, lists, arrays and mappings of these.
        what: what it is, for messages.

    Raises:
        InvalidInputError: a value has no JSON form, or the file cannot be written.
    """
    write_atomically(path, format_json(record), what)


def format_json(record: Mapping[str, object]) -> str:
    """Format an object as JSON text that ends with a newline; numbers keep every bit.

    Args:
        record: texts, finite numbers, truth values, lists, arrays and mappings of these.

    Raises:
        InvalidInputError: a value is NaN, infinite, or of a type without JSON form; the message names its key.
    """
    return json.dumps(_plain(record, ""), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def format_compact_json(record: Mapping[str, object]) -> str:
    """Format an object as JSON text on one line without blanks, for sending; raises as `format_json`."""
    try:  # at once where it goes; None, which would pass as null, and all that is refused is looked for key by key
        text = json.dumps(record, separators=(",", ":"), ensure_ascii=False, allow_nan=False, default=lambda value: _plain(value, ""))
    except (InvalidInputError, TypeError, ValueError):
        text = "null"
    return json.dumps(_plain(record, ""), separators=(",", ":"), ensure_ascii=False, allow_nan=False) if "null" in text else text


def _plain(value: object, key: str) -> Json:
    """Turn a value into what `json` writes, or refuse it with the key at which it stands."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(entry, f"{key}.{name}" if key else str(name)) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry, f"{key}[{k}]") for k, entry in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        message = f'"{key}" is {value} and has no JSON form: leave out what does not exist'
        raise InvalidInputError(message, key=key)
    if isinstance(value, str | bool | int | float):
        return value
    message = f'"{key}" is of type {type(value).__name__} and has no JSON form: give numbers, texts, lists and mappings of them'
    raise InvalidInputError(message, key=key)


def _refuse_constant(name: str) -> float:
    message = f"{name} is no JSON number; give a finite one, or leave the key out"
    raise ValueError(message)


def _unique(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    result = dict(pairs)
    if len(result) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        message = f'"{twice}" stands there twice; keep one'
        raise ValueError(message)
    return result


def _kind(value: Json) -> str:
    for kinds, name in ((bool, "true or false"), (str, "text"), (dict, "object"), (list, "list"), ((int, float), "number")):
        if isinstance(value, kinds):
            return name
    return "null"
