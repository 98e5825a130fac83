"""Lists as a person types them on a command line: numbers `0.1,1,10`, and pairs `key=value,key=value`."""

import math

from revline.errors import InvalidInputError


def parse_numbers(text: str, what: str) -> tuple[float, ...]:
    """Read numbers separated by commas.

    Args:
        text: for example "0.1, 1, 10".
        what: what they are, with their unit, for messages: "frequencies [rad/s]".

    Raises:
        InvalidInputError: an entry is no finite number, or there is none.
    """
    return tuple(_parse(entry.strip(), what, text) for entry in text.split(","))


def parse_pairs(text: str, what: str) -> dict[str, str]:
    """Read pairs of texts: `key=value,key=value`.

    Args:
        text: the pairs.
        what: where they were given, for messages.

    Raises:
        InvalidInputError: an entry has no key or no value, or a key stands there twice.
    """
    found: dict[str, str] = {}
    for entry in text.split(","):
        key, _, value = (part.strip() for part in entry.partition("="))
        if not key or not value:
            message = f"{what} {text!r}: {entry.strip()!r} is no pair; give KEY=VALUE, separated by commas"
            raise InvalidInputError(message, entry=entry)
        if key in found:
            message = f"{what} {text!r}: {key} stands there twice; keep one"
            raise InvalidInputError(message, entry=entry)
        found[key] = value
    return found


def _parse(entry: str, what: str, text: str) -> float:
    try:
        value = math.nan if "_" in entry else float(entry)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        shown = repr(entry) if entry else "an empty entry"
        message = f"{what} {text!r}: {shown} is no finite number; give numbers separated by commas, for example 0.1,1,10"
        raise InvalidInputError(message, entry=entry)
    return value
