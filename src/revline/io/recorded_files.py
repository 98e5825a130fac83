"""Recorded inputs as CSV: a column of times and one of values, units in their names.

time_s,throttle_deg
0.0,25
0.5,27.5
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from revline.errors import InvalidInputError
from revline.io.csv_table import CsvTable, read_csv_table
from revline.io.headers import header_of
from revline.lti.response import Floats
from revline.signals import Signal, recorded
from revline.system import DelaySystem, Variable, check_range, index_of
from revline.values import make_read_only

TIME = "time_s"

SAME = 1e-9
"""Values closer than this part of themselves make no jump."""


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
        path: of a CSV file with a column `time_s` and one named after the input and its unit, `throttle_deg`; others do not matter. Files
            that `revline simulate` writes are such.
        variable: the input.

    Raises:
        InvalidInputError: the file cannot be read, is empty or ragged, a column is missing or there twice, a cell is no finite number,
            a time repeats or falls, there are fewer than two rows, or a value lies outside the input's range; with file, line and column.
    """
    table = read_csv_table(path)
    column = _column_of(table, variable)
    times, values = table.numbers(TIME), table.numbers(column)
    if len(times) < 2:
        message = f"{table.path} has one row; a recording needs two or more"
        raise InvalidInputError(message, path=str(table.path))
    check_times(table, times)
    for row, value in enumerate(values):
        try:
            check_range(variable, float(value))
        except InvalidInputError as error:
            raise table.error(row, column, str(error)) from error
    return Recording(name=variable.name, times=times, values=values)


def recording_notes(
    signals: Mapping[str, Signal], system: DelaySystem, base: Mapping[str, float], span: tuple[float, float]
) -> tuple[str, ...]:
    """Say where recordings do not cover a run, and what is taken instead; and where one that begins at 0 s begins with a jump.

    Args:
        signals: by input.
        system: whose inputs they drive.
        base: value that each input has otherwise, by name: held before 0 s.
        span: start and stop time of the run, in seconds.
    """
    notes = []
    for name, signal in signals.items():
        if not signal.record.size:
            continue
        variable = system.inputs[index_of(system.inputs, name)]
        times, values = signal.record[:, 0], signal.record[:, 1] + base[name]
        if times[0] > span[0]:
            notes.append(f"the recording of {name} begins at {times[0]:g} s: before, its first value is held, {_say(variable, values[0])}")
        if times[-1] < span[1]:
            held = f"from there on its last value is held, {_say(variable, values[-1])}"
            notes.append(f"the recording of {name} ends at {times[-1]:g} s, before the stop time {span[1]:g} s: {held}")
        first = float(np.interp(0.0, times, values))
        if span[0] == 0.0 and abs(first - base[name]) > SAME * max(abs(first), abs(base[name])):
            jump = f"from the trim's {_say(variable, base[name])} to the recorded {_say(variable, first)}"
            notes.append(f"{name} jumps at 0 s {jump}; to begin at rest, start from a trim at that value")
    return tuple(notes)


def _say(variable: Variable, value: float) -> str:
    return f"{value:g}" if variable.unit == "1" else f"{value:g} {variable.unit}"


def _column_of(table: CsvTable, variable: Variable) -> str:
    """Column of an input: its name with the unit; one without a unit may bear its name alone."""
    column = header_of(variable)
    return variable.name if variable.unit == "1" and column not in table.header else column


def check_times(table: CsvTable, times: Floats) -> None:
    """Refuse times that do not rise.

    Raises:
        InvalidInputError: one repeats or falls; with file, line and column.
    """
    falls = np.flatnonzero(np.diff(times) <= 0.0)
    if falls.size:
        row = int(falls[0]) + 1
        before = f"{times[row - 1]:.12g} s in line {table.lines[row - 1]}"
        fault = f"repeats {before}; keep one of the two" if times[row] == times[row - 1] else f"comes after {before}; sort the rows by time"
        raise table.error(row, TIME, f"{times[row]:.12g} s {fault}")
