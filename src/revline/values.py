"""Frozen values: read-only arrays, and a fingerprint of the content of any value."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum

import numpy as np

from revline.errors import InvalidInputError


def make_read_only(value: object) -> None:
    """Give a frozen dataclass locked copies of its array fields, so that a result cannot change after it was checked.

    The arrays it was made from stay as they are; an array that is locked and owns its data is kept without a copy.
    """
    if not is_dataclass(value):
        message = f"{type(value).__name__} is no dataclass"
        raise TypeError(message)
    for field in fields(value):
        entry = getattr(value, field.name)
        if isinstance(entry, np.ndarray) and (entry.flags.writeable or not entry.flags.owndata):
            copy = entry.copy()
            copy.setflags(write=False)
            object.__setattr__(value, field.name, copy)


def fingerprint(*values: object) -> str:
    """Digest the content of values: equal content gives equal text, in any process and on any day.

    Args:
        values: numbers, strings, arrays, enums, tuples, mappings and dataclasses of these; an object with an attribute
            `content_digest` (a system: its equations and parameters) stands for that text.

    Returns:
        32 hexadecimal digits.

    Raises:
        InvalidInputError: a value has no content that could be digested.
    """
    digest = hashlib.sha256()
    for part in _parts(values):
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:32]


def _parts(value: object) -> Iterator[bytes]:
    kind = type(value)
    if kind is str or kind is float or kind is int or kind is bool:  # most of them
        yield f"{kind.__name__}:{value!r}".encode()
        return
    own = getattr(value, "content_digest", None)
    if isinstance(own, str):
        yield own.encode()
    elif isinstance(value, np.generic):
        yield from _parts(value.item())
    elif isinstance(value, Enum):
        yield f"{type(value).__name__}.{value.name}".encode()
    elif value is None or isinstance(value, bool | int | float | complex | str | bytes):
        yield f"{type(value).__name__}:{value!r}".encode()
    elif isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            message = "no fingerprint for an array of Python objects: give an array of numbers"
            raise InvalidInputError(message)
        yield f"array:{value.dtype.str}:{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    else:
        yield from _inner_parts(value)


def _inner_parts(value: object) -> Iterator[bytes]:
    if isinstance(value, Mapping):
        yield f"mapping:{len(value)}".encode()
        for entry in sorted(value.items(), key=_sort_key):
            yield from _parts(entry)
    elif isinstance(value, tuple | list | frozenset):
        yield f"{type(value).__name__}:{len(value)}".encode()
        for item in sorted(value, key=_sort_key) if isinstance(value, frozenset) else value:
            yield from _parts(item)
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__name__}:{len(fields(value))}".encode()
        for field in fields(value):
            yield field.name.encode()
            yield from _parts(getattr(value, field.name))
    else:
        message = f"no fingerprint for a value of type {type(value).__name__}: give numbers, texts, arrays or frozen records of them"
        raise InvalidInputError(message, type=type(value).__name__)


def _sort_key(value: object) -> tuple[bytes, ...]:
    """An order that is the same in every process, which that of texts in a set is not."""
    return tuple(_parts(value))
