"""Recorded inputs as CSV: a column of times and one of values, units in their names.

time_s,throttle_deg
0.0,25
0.5,27.5
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from revline.errors import InvalidInputError
from revline.io.csv_table import CsvTable, read_csv_table
from revline.io.headers import header_of
from revline.lti.response import Floats
from revline.signals import Signal, recorded
from revline.system import Variable, check_range
from revline.values import make_read_only

TIME = "time_s"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """A recorded input, straight between its samples and held outside them.

    Attributes:
        name: of the input.
        times: shape (n,), rising, in seconds.
        values: shape (n,), of the input itself, in its unit.
    """

    name: str
    times: Floats
    values: Floats

    def __post_init__(self) -> None:
        make_read_only(self)

    def signal(self, base: float) -> Signal:
        """Give what is added to an input that otherwise has a base value."""
        return recorded(self.times, self.values - base)


def read_recording(path: str | Path, variable: Variable) -> Recording:
    """Read a recorded input.

    Args:
        path: of a CSV file with a column `time_s` and one named after the input and its unit, `throttle_deg`; others do not matter.
        variable: the input.

    Raises:
        InvalidInputError: the file cannot be read, is empty or ragged, a column is missing or there twice, a cell is no finite number,
            a time repeats or falls, there are fewer than two rows, or a value lies outside the input's range; with file, line and column.
    """
    table = read_csv_table(path)
    column = header_of(variable)
    times, values = table.numbers(TIME), table.numbers(column)
    if len(times) < 2:
        message = f"{table.path} has one row; a recording needs two or more"
        raise InvalidInputError(message, path=str(table.path))
    _check_times(table, times)
    for row, value in enumerate(values):
        try:
            check_range(variable, float(value))
        except InvalidInputError as error:
            raise table.error(row, column, str(error)) from error
    return Recording(name=variable.name, times=times, values=values)


def _check_times(table: CsvTable, times: Floats) -> None:
    falls = np.flatnonzero(np.diff(times) <= 0.0)
    if falls.size:
        row = int(falls[0]) + 1
        before = f"{times[row - 1]:.12g} s in line {table.lines[row - 1]}"
        fault = f"repeats {before}; keep one of the two" if times[row] == times[row - 1] else f"comes after {before}; sort the rows by time"
        raise table.error(row, TIME, f"{times[row]:.12g} s {fault}")
