"""Values in JSON: found by their path, compared, and altered on purpose."""

import copy
import math
from typing import Any


def find(record: Any, path: str) -> Any:
    """Follow a dotted path of keys and positions; nothing where it ends early."""
    for part in path.split("."):
        if isinstance(record, dict):
            record = record.get(part)
        elif isinstance(record, list) and part.lstrip("-").isdigit() and -len(record) <= int(part) < len(record):
            record = record[int(part)]
        else:
            return None
    return record


def agrees(found: Any, wanted: Any, tolerance: float) -> bool:
    """Whether a value is the one wanted: numbers within a tolerance, all else exactly."""
    if isinstance(wanted, float):
        is_number = isinstance(found, int | float) and not isinstance(found, bool)
        return is_number and math.isfinite(found) and abs(found - wanted) <= tolerance
    return type(found) is type(wanted) and bool(found == wanted)


def move(record: Any, path: str, tolerance: float) -> Any:
    """A record with one value altered beyond its tolerance."""
    altered = copy.deepcopy(record)
    *way, last = path.split(".")
    parent = find(altered, ".".join(way)) if way else altered
    key: Any = int(last) if isinstance(parent, list) else last
    value = parent[key]
    if isinstance(value, bool):
        parent[key] = not value
    elif isinstance(value, int | float):
        parent[key] = value + 3.0 * tolerance + 1e-9 * max(1.0, abs(value))
    else:
        parent[key] = f"not {value}"
    return altered
