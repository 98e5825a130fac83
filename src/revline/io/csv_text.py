"""CSV text of numbers by column, units in the column names, numbers to the last bit, and comment lines `# key: value` above."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.errors import InvalidInputError

BLOCK = 10_000
"""Rows that are turned into text at once: a long table as Python's numbers would take ten times its memory."""


def format_csv(columns: Sequence[tuple[str, ArrayLike]], *, notes: Mapping[str, str | float]) -> str:
    """Format columns of numbers as CSV; `revline.io.csv_table.read_csv_table` reads it back to the last bit.

    Args:
        columns: names with units, and as many finite numbers in each; truth values become 1 and 0.
        notes: what the comment lines say, by key.

    Raises:
        InvalidInputError: the columns differ in length, or a number is not finite.
    """
    arrays = [_numbers(values) for _, values in columns]
    for (name, _), array in zip(columns, arrays, strict=True):
        if array.shape != arrays[0].shape or array.ndim != 1:
            message = f"column {name} has shape {array.shape} beside one of {arrays[0].shape}; give as many numbers in each"
            raise InvalidInputError(message, column=name)
        if not np.all(np.isfinite(array)):
            row = int(np.argmin(np.isfinite(array)))
            message = f"column {name} holds {array[row]} in row {row + 1}, which no file can hold; leave out what does not exist"
            raise InvalidInputError(message, column=name)
    lines = [f"# {key}: {_one_line(value)}" for key, value in notes.items()]
    lines.append(",".join(name for name, _ in columns))
    length = len(arrays[0]) if arrays else 0
    for first in range(0, length, BLOCK):
        block = (array[first : first + BLOCK].tolist() for array in arrays)
        lines.append("\n".join(",".join(map(repr, row)) for row in zip(*block, strict=True)))
    return "\n".join(lines) + "\n"


def _numbers(values: ArrayLike) -> NDArray[np.float64] | NDArray[np.int64]:
    array = np.asarray(values)
    return array.astype(np.int64) if array.dtype == np.bool_ else array.astype(np.float64)


def _one_line(value: str | float) -> str:
    return " ".join(value.split()) if isinstance(value, str) else repr(value)
