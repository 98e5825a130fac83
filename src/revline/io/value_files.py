"""Any frozen value of revline as JSON and back to the last bit, so that a study can stop and go on, and a report be made again.

Records (dataclasses and NamedTuples) and enums carry the name of their class; only classes of this package are made again.
Arrays hold their bytes in base 64.
"""

import base64
import importlib
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from revline.errors import InvalidInputError
from revline.io.json_files import read_json, write_json

CLASS, ARRAY, TUPLE, MAPPING, FLOAT, COMPLEX = "class", "array", "tuple", "mapping", "float", "complex"
PACKAGE = "revline."
SCHEMA = "revline.value/1"


def write_value(path: Path, value: object) -> None:
    """Write a value as JSON, whole or not at all.

    Raises:
        InvalidInputError: the value holds something that is no record, array, enum, number, text, tuple or mapping; or the file
            cannot be written.
    """
    write_json(path, {"schema": SCHEMA, "value": encode(value)}, "result file")


def read_value(path: Path) -> Any:
    """Read a value that `write_value` wrote.

    Raises:
        InvalidInputError: there is no such file, or it does not hold such a value.
    """
    record = read_json(path, "result file")
    record.require_schema(SCHEMA)
    try:
        return decode(record.entries["value"])
    except (KeyError, TypeError, ValueError, AttributeError, ImportError) as error:
        message = f"{path} holds a value that cannot be made again ({error}); it may come from another version: remove it"
        raise InvalidInputError(message) from error


def encode(value: object) -> Any:
    """Turn a value into what JSON can hold."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, Enum):
        return {CLASS: _name(value), "member": value.name}
    if isinstance(value, int | float | complex | np.generic):
        return _encode_number(value)
    return _encode_structure(value)


def decode(content: Any) -> Any:
    """Turn what `encode` made back into the value."""
    if not isinstance(content, dict):
        return content
    if CLASS in content:
        return _decode_record(content)
    if MAPPING in content:
        return MappingProxyType({decode(key): decode(entry) for key, entry in content[MAPPING]})
    if TUPLE in content:
        return tuple(decode(item) for item in content[TUPLE])
    return _decode_numbers(content)


def _encode_structure(value: object) -> Any:
    if isinstance(value, np.ndarray):
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        return {ARRAY: value.dtype.str, "shape": list(value.shape), "data": data}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return {TUPLE: [encode(item) for item in value]}
    if isinstance(value, Mapping):
        return {MAPPING: [[encode(key), encode(entry)] for key, entry in value.items()]}
    return {CLASS: _name(value), "fields": {name: encode(getattr(value, name)) for name in _field_names(value)}}


def _decode_record(content: Any) -> Any:
    kind = _find_class(content[CLASS])
    if "member" in content:
        return kind[content["member"]]
    return kind(**{name: decode(entry) for name, entry in content["fields"].items()})


def _decode_numbers(content: Any) -> Any:
    if FLOAT in content:
        return float(content[FLOAT])
    if COMPLEX in content:
        return complex(*(float(part) for part in content[COMPLEX]))
    data = np.frombuffer(base64.b64decode(content["data"]), dtype=np.dtype(content[ARRAY]))
    return data.reshape(content["shape"]).copy()


def _encode_number(value: object) -> Any:
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, complex):
        return {COMPLEX: [repr(plain.real), repr(plain.imag)]}
    if isinstance(plain, float) and not math.isfinite(plain):
        return {FLOAT: repr(plain)}
    return plain


def _field_names(value: object) -> tuple[str, ...]:
    if is_dataclass(value):
        return tuple(field.name for field in fields(value) if field.init)
    names = getattr(value, "_fields", None)
    if names is None:
        message = f"a value of type {type(value).__name__} cannot be written; give records, arrays, numbers, texts, tuples or mappings"
        raise InvalidInputError(message, type=type(value).__name__)
    return tuple(names)


def _name(value: object) -> str:
    return f"{type(value).__module__}:{type(value).__qualname__}"


def _find_class(name: str) -> Any:
    module, _, qualified = name.partition(":")
    if not module.startswith(PACKAGE):
        message = f"{name} is no class of this package"
        raise ValueError(message)
    found: Any = importlib.import_module(module)
    for part in qualified.split("."):
        found = getattr(found, part)
    if not (isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum) or hasattr(found, "_fields"))):
        message = f"{name} is no record"
        raise ValueError(message)
    return found
