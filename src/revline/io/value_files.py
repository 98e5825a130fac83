"""Any frozen value of revline as JSON and back to the last bit, so that a study can stop and go on, and a report be made again.

Records (dataclasses and NamedTuples) and enums carry the name of their class; only classes that this package itself defines are
written and made again, so that a file from elsewhere can name no other code. Arrays hold their bytes in base 64 and come back locked.
"""

import base64
import importlib
import math
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from revline.errors import InvalidInputError, RevlineError
from revline.io.json_files import read_json, write_json

CLASS, ARRAY, TUPLE, MAPPING, FLOAT, COMPLEX = "class", "array", "tuple", "mapping", "float", "complex"
PACKAGE = "revline."
SCHEMA = "revline.value/1"

KINDS = re.compile(r"[<>|=]?[biufc]\d+|[<>=]U\d+")
"""Types of arrays that are kept: truth values, numbers and texts."""

UNREADABLE = (ArithmeticError, AttributeError, ImportError, LookupError, RecursionError, RevlineError, TypeError, ValueError)
"""What a damaged or forged file may bring about while it is read."""


def write_value(path: Path, value: object) -> None:
    """Write a value as JSON, whole or not at all.

    Raises:
        InvalidInputError: the value holds something that is no record of this package, array, enum, number, text, tuple or mapping, or
            a NaN; or the file cannot be written.
    """
    write_json(path, {"schema": SCHEMA, "value": encode(value)}, "result file")


def read_value(path: Path) -> Any:
    """Read a value that `write_value` wrote.

    Raises:
        InvalidInputError: there is no such file, or it does not hold such a value.
    """
    record = read_json(path, "result file")
    if "schema" not in record.entries or "value" not in record.entries:
        message = f"{path} holds no value that was kept: its schema or its value is missing; give another file"
        raise InvalidInputError(message, path=str(path))
    record.require_schema(SCHEMA)
    try:
        return decode(record.entries["value"])
    except UNREADABLE as error:
        message = f"{path} holds a value that cannot be made again ({error}); it may come from another version: remove it"
        raise InvalidInputError(message, path=str(path)) from error


def encode(value: object) -> Any:
    """Turn a value into what JSON can hold.

    Raises:
        InvalidInputError: see `write_value`.
    """
    if isinstance(value, Enum):
        return {CLASS: _name(value), "member": value.name}
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float | complex | np.generic):
        return _encode_number(value)
    return _encode_structure(value)


def decode(content: Any) -> Any:
    """Turn what `encode` made back into the value."""
    if isinstance(content, bool | str | int | float):
        return content
    if not isinstance(content, dict):
        message = f"there is a {type(content).__name__} where a value is wanted"
        raise TypeError(message)
    if CLASS in content:
        return _decode_record(content)
    if MAPPING in content:
        return MappingProxyType({decode(key): decode(entry) for key, entry in content[MAPPING]})
    if TUPLE in content:
        return tuple(decode(item) for item in content[TUPLE])
    return _decode_numbers(content)


def _encode_structure(value: object) -> Any:
    if isinstance(value, np.ndarray):
        return _encode_array(value)
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return {TUPLE: [encode(item) for item in value]}
    if isinstance(value, Mapping):
        return {MAPPING: [[encode(key), encode(entry)] for key, entry in value.items()]}
    return {CLASS: _name(value), "fields": {name: encode(getattr(value, name)) for name in _field_names(value)}}


def _encode_array(value: np.ndarray) -> Any:
    if not KINDS.fullmatch(value.dtype.str):
        message = f"an array of type {value.dtype} cannot be written; give truth values, numbers or texts"
        raise InvalidInputError(message, type=str(value.dtype))
    if value.dtype.kind in "fc" and np.isnan(value).any():
        message = "an array holds NaN and cannot be written; leave out what does not exist"
        raise InvalidInputError(message)
    return {ARRAY: value.dtype.str, "shape": list(value.shape), "data": base64.b64encode(value.tobytes()).decode()}


def _decode_record(content: Any) -> Any:
    kind = _find_class(content[CLASS])
    if issubclass(kind, Enum):
        return kind[content["member"]]
    return kind(**{name: decode(entry) for name, entry in content["fields"].items()})


def _decode_numbers(content: Any) -> Any:
    if FLOAT in content:
        return _without_nan(float(content[FLOAT]))
    if COMPLEX in content:
        real, imaginary = content[COMPLEX]
        return complex(_without_nan(float(real)), _without_nan(float(imaginary)))
    return _decode_array(content)


def _decode_array(content: Any) -> np.ndarray:
    if not KINDS.fullmatch(content[ARRAY]):
        message = f"an array of type {content[ARRAY]} is none that is kept"
        raise ValueError(message)
    dtype, shape = np.dtype(content[ARRAY]), tuple(content["shape"])
    data = base64.b64decode(content["data"], validate=True)
    if any(length < 0 for length in shape) or len(data) != math.prod(shape) * dtype.itemsize:
        message = f"{len(data)} bytes are no array of shape {shape} and type {dtype}"
        raise ValueError(message)
    array = np.zeros(shape, dtype=dtype)
    if array.size:
        array[...] = np.frombuffer(data, dtype=dtype).reshape(shape)
    array.setflags(write=False)
    return array


def _encode_number(value: object) -> Any:
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, complex):
        return {COMPLEX: [repr(_refuse_nan(plain.real)), repr(_refuse_nan(plain.imag))]}
    if isinstance(plain, float) and not math.isfinite(plain):
        return {FLOAT: repr(_refuse_nan(plain))}
    if isinstance(plain, str | bool | int | float):
        return plain
    message = f"a number of type {type(value).__name__} cannot be written; give one of 64 bits"
    raise InvalidInputError(message, type=type(value).__name__)


def _refuse_nan(value: float) -> float:
    if math.isnan(value):
        message = "a value is NaN and cannot be written; leave out what does not exist"
        raise InvalidInputError(message)
    return value


def _without_nan(value: float) -> float:
    if math.isnan(value):
        message = "a number is NaN"
        raise ValueError(message)
    return value


def _field_names(value: object) -> tuple[str, ...]:
    if is_dataclass(value):
        return tuple(field.name for field in fields(value) if field.init)
    names: tuple[str, ...] = getattr(value, "_fields", ())
    return names


def _name(value: object) -> str:
    """Name the class of a record or an enum, by which it is found again."""
    kind = type(value)
    name = f"{kind.__module__}:{kind.__qualname__}"
    try:
        found = _find_class(name)
    except (ValueError, AttributeError, ImportError):
        found = None
    if found is not kind:
        message = (
            f"a value of type {kind.__name__} cannot be written; give records of this package, arrays, numbers, texts, tuples or mappings"
        )
        raise InvalidInputError(message, type=kind.__name__)
    return name


def _find_class(name: str) -> Any:
    """Find a record or an enum that a module of this package defines itself, not what it imports."""
    module, _, qualified = name.partition(":")
    if not module.startswith(PACKAGE):
        message = f"{name} is no class of this package"
        raise ValueError(message)
    found: Any = importlib.import_module(module)
    for part in qualified.split("."):
        found = vars(found).get(part)
        if not (isinstance(found, type) and found.__module__ == module):
            message = f"{name} is no class that this package defines"
            raise ValueError(message)
    if not (is_dataclass(found) or issubclass(found, Enum) or (issubclass(found, tuple) and hasattr(found, "_fields"))):
        message = f"{name} is no record"
        raise ValueError(message)
    return found
