"""Frequency responses as CSV files, own and foreign: quantities and units are told by the column names."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from revline.errors import InvalidInputError, out_of_range
from revline.io.atomic import write_atomically
from revline.io.csv_table import CsvTable, read_csv_table
from revline.io.csv_text import format_csv
from revline.lti.response import Complexes, Floats, FrequencyResponse, count_turns
from revline.units import DEGREE
from revline.values import make_read_only

DEFAULT_AMPLITUDE = 5.0
"""Input amplitude in deg of a file that gives output amplitudes and does not say of which input; that of Lee (1995), Table 4.1."""

_TURNS = ("phase_turns", "counted")
"""The comment of a file whose phases have all their turns, told by more than the values themselves."""

PARTIAL = "partial"
"""The comment of a file that holds only a part of the response asked for: what is missing, and why."""

DISPUTED = "cross_check_failed"
"""The comment of a file whose response another route contradicts: which, where, and by how much."""

_AGREEMENT = 1e-9
_TINY = 1e-300
_FEWEST_FOR_SLOPE = 5
_LARGEST_LEAD = 30.0


@dataclass(frozen=True, slots=True)
class Quantity:
    """A column name that is recognised, what it means, and how to convert it.

    Attributes:
        name: of the column, with the unit.
        role: "frequency", "magnitude" or "phase".
        convert: to rad/s, to a ratio (of an amplitude: to itself), to rad with a lag negative.
        is_amplitude: whether it is an output amplitude, to be divided by that of the input.
    """

    name: str
    role: str
    convert: Callable[[Floats], Floats]
    is_amplitude: bool = False


QUANTITIES = (
    Quantity("frequency_rad_s", "frequency", lambda x: x),
    Quantity("omega_rad_s", "frequency", lambda x: x),
    Quantity("frequency_hz", "frequency", lambda x: x * (2.0 * math.pi)),
    Quantity("magnitude", "magnitude", lambda x: x),
    Quantity("gain", "magnitude", lambda x: x),
    Quantity("magnitude_db", "magnitude", lambda x: np.power(10.0, x / 20.0)),
    Quantity("gain_db", "magnitude", lambda x: np.power(10.0, x / 20.0)),
    Quantity("amplitude_rad_s", "magnitude", lambda x: x, is_amplitude=True),
    Quantity("speed_amplitude_rad_s", "magnitude", lambda x: x, is_amplitude=True),
    Quantity("phase_deg", "phase", lambda x: x * DEGREE),
    Quantity("phase_rad", "phase", lambda x: x),
    Quantity("phase_lag_deg", "phase", lambda x: x * -DEGREE),
    Quantity("phase_lag_rad", "phase", lambda x: -x),
)
"""What a header may name; `columns` of `read_response` maps these names to others."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseFile:
    """What a frequency-response file holds.

    Attributes:
        response: the response, output per input.
        input_amplitude: of the input, in its unit; by it output amplitudes were divided.
        distortion: root of the summed squares of the harmonics over the fundamental, one per frequency; of size 0 where not given.
        metadata: what the comment lines say.
        notes: what was assumed, for people to read.
    """

    response: FrequencyResponse
    input_amplitude: float
    distortion: Floats
    metadata: Mapping[str, str]
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        make_read_only(self)


def read_response(path: str | Path, *, columns: Mapping[str, str] | None = None, amplitude: float | None = None) -> ResponseFile:
    """Read a frequency response from any CSV file with frequency, magnitude (or amplitude) and phase columns.

    A file that `write_response` wrote gives the same response to the last bit.

    Args:
        path: of the file.
        columns: names of columns where the header's own are not recognised or not wanted: from a name of `QUANTITIES`, which tells
            quantity and unit, to the file's, for example {"phase_lag_deg": "lag"}.
        amplitude: of the input, in its unit; by default what the file says, else 5 deg. Used where the file gives output amplitudes.

    Returns:
        The response with what the file says about it, and notes on what was assumed.

    Raises:
        InvalidInputError: the file cannot be read, a column is missing or there are two for one quantity, a cell is no finite number,
            a frequency is not positive, repeated or out of order, or a magnitude is negative; with file, line and column.
    """
    return parse_response(read_csv_table(path), columns=columns, amplitude=amplitude)


def parse_response(table: CsvTable, *, columns: Mapping[str, str] | None = None, amplitude: float | None = None) -> ResponseFile:
    """Take a frequency response from the cells of a CSV file.

    Args:
        table: the cells.
        columns: as for `read_response`.
        amplitude: as for `read_response`.

    Raises:
        InvalidInputError: see `read_response`.
    """
    chosen = {role: _find_quantity(table, role, dict(columns or {})) for role in ("frequency", "magnitude", "phase")} if columns else None
    rectangular = chosen is None and {"gain_real", "gain_imag"} <= set(table.header)
    quantities = chosen or {role: _find_quantity(table, role, {}) for role in ("frequency", "magnitude", "phase")}
    size_quantity = quantities["magnitude"][0]
    used, notes = _find_amplitude(table, amplitude, needed=size_quantity.is_amplitude)
    omega = _read_frequencies(table, *quantities["frequency"])
    sizes = _read_sizes(table, *quantities["magnitude"]) / (used if size_quantity.is_amplitude else 1.0)
    phases = quantities["phase"][0].convert(table.numbers(quantities["phase"][1]))
    values = sizes * np.exp(1j * phases)
    if rectangular:
        values = _read_rectangular(table, values, phases)
    response = _make_response(table, omega, values, is_amplitude=size_quantity.is_amplitude)
    if table.metadata.get(_TURNS[0]) == _TURNS[1]:
        response = replace(response, turns=count_turns(values, phases / DEGREE))
    return ResponseFile(
        response=response,
        input_amplitude=used,
        distortion=table.numbers("distortion") if "distortion" in table.header else np.zeros(0),
        metadata=table.metadata,
        notes=(*notes, *_turn_notes(response, phases), *_lead_notes(response), *_remark_notes(table)),
    )


def write_response(path: str | Path, response: FrequencyResponse, *, amplitude: float, distortion: Floats | None = None) -> None:
    """Write a frequency response as CSV, so that `read_response` gives it back to the last bit.

    Args:
        path: of the file, which is replaced.
        response: what to write.
        amplitude: of the input, in its unit; amplitudes are the magnitude times this.
        distortion: one per frequency, where the method has it.

    Raises:
        InvalidInputError: as for `format_response`; or the file cannot be written.
    """
    write_atomically(path, format_response(response, amplitude=amplitude, distortion=distortion), "frequency response")


def format_response(
    response: FrequencyResponse, *, amplitude: float, distortion: Floats | None = None, partial: str = "", disputed: str = ""
) -> str:
    """Format a frequency response as CSV, so that `read_response` gives it back to the last bit.

    Columns: frequency_rad_s, amplitude_rad_s (magnitude where the output is no speed in rad/s), phase_deg, distortion where given, and
    gain_real and gain_imag, which carry the exact value.

    Args:
        response: what to write.
        amplitude: of the input, in its unit; amplitudes are the magnitude times this.
        distortion: one per frequency, where the method has it.
        partial: what is missing and why, where the response is not whole.
        disputed: how another route contradicts the response, where one does.

    Raises:
        InvalidInputError: the amplitude is not positive, the lengths differ, there is a frequency of 0, a magnitude is beyond the range
            of numbers, or a name holds a line end.
    """
    notes = _metadata(response, amplitude)
    for key, value in notes:
        if not value.isprintable() or value != value.strip():
            message = f"{key} = {value!r} holds a line end, outer blanks or other unprintable characters; take them out"
            raise InvalidInputError(message)
    entries = _columns(response, amplitude, distortion)
    entries += [("gain_real", response.values.real), ("gain_imag", response.values.imag)]
    remarks = {key: text for key, text in ((PARTIAL, partial), (DISPUTED, disputed)) if text}
    return format_csv(entries, notes={**dict(notes), **remarks})


def response_rows(response: FrequencyResponse, *, amplitude: float, distortion: Floats | None = None) -> list[dict[str, float]]:
    """Give a frequency response row by row, with the columns of its file for people.

    Args:
        response: what to give.
        amplitude: of the input, in its unit.
        distortion: one per frequency, where the method has it.

    Raises:
        InvalidInputError: as for `format_response`.
    """
    columns = _columns(response, amplitude, distortion)
    names = [name for name, _ in columns]
    return [dict(zip(names, row, strict=True)) for row in zip(*(values.tolist() for _, values in columns), strict=True)]


def _columns(response: FrequencyResponse, amplitude: float, distortion: Floats | None) -> list[tuple[str, Floats]]:
    """Columns for people: frequency, amplitude or magnitude, phase, and distortion where there is one."""
    _check_amplitude(amplitude, response.input_unit)
    is_speed = response.output_unit == "rad/s"
    with np.errstate(over="ignore"):
        sizes = response.magnitude * (amplitude if is_speed else 1.0)
    if response.omega[0] == 0.0 or not np.all(np.isfinite(sizes)):
        message = f"the response has a frequency of 0 or a magnitude of up to {sizes.max():g}, which no file can hold; leave that row out"
        raise InvalidInputError(message)
    entries = [
        ("frequency_rad_s", response.omega),
        ("amplitude_rad_s" if is_speed else "magnitude", sizes),
        ("phase_deg", response.phase_deg),
    ]
    if distortion is not None:
        if distortion.shape != response.omega.shape:
            message = f"{distortion.size} distortions for {response.omega.size} frequencies; give one for each"
            raise InvalidInputError(message)
        entries.append(("distortion", distortion))
    return entries


def _metadata(response: FrequencyResponse, amplitude: float) -> tuple[tuple[str, str], ...]:
    return (
        ("input_name", response.input_name),
        ("input_unit", response.input_unit),
        ("input_amplitude", repr(float(amplitude))),
        ("output_name", response.output_name),
        ("output_unit", response.output_unit),
        ("method", response.method),
        ("known_delay_s", repr(float(response.known_delay))),
        *((_TURNS,) if response.turns.size else ()),
    )


def _find_quantity(table: CsvTable, role: str, columns: dict[str, str]) -> tuple[Quantity, str]:
    """The quantity that plays a role, and the name of its column."""
    known = {quantity.name: quantity for quantity in QUANTITIES}
    for name in columns:
        if name not in known:
            message = f"{name} is no quantity of a frequency response; name one of {', '.join(known)}"
            raise InvalidInputError(message, quantity=name)
    named = [(known[name], column) for name, column in columns.items() if known[name].role == role]
    present = named or [(quantity, quantity.name) for quantity in QUANTITIES if quantity.role == role and quantity.name in table.header]
    wanted = ", ".join(quantity.name for quantity in QUANTITIES if quantity.role == role)
    if not present:
        message = f"{table.path}, line {table.header_line}: no {role} column among {', '.join(table.header)}; name one {wanted},"
        message += " or say which column it is, as --columns QUANTITY=COLUMN does"
        raise InvalidInputError(message, role=role)
    if len(present) > 1:
        names = " and ".join(column for _, column in present)
        message = f"{table.path}, line {table.header_line}: {names} both give the {role}; say which to use, or leave one out"
        raise InvalidInputError(message, role=role)
    return present[0]


def _find_amplitude(table: CsvTable, given: float | None, *, needed: bool) -> tuple[float, tuple[str, ...]]:
    """The input amplitude, and what was assumed about it."""
    entry = next((key for key in ("input_amplitude", "input_amplitude_deg") if key in table.metadata), "")
    stated = _metadata_number(table, entry) if entry else None
    value = next((v for v in (given, stated) if v is not None), DEFAULT_AMPLITUDE)
    _check_amplitude(value, table.metadata.get("input_unit", "deg"))
    if not needed:
        return value, () if given is None else (f"{table.path} gives ratios: the input amplitude of {value:g} was not needed",)
    if given is None and stated is None:
        return value, (f"{table.path} does not give the input amplitude: {value:g} deg assumed",)
    if given is not None and stated is not None and given != stated:
        return value, (f"{table.path} says that the input amplitude is {stated:g}; {value:g} was used as asked",)
    return value, ()


def _metadata_number(table: CsvTable, key: str) -> float:
    try:
        return float(table.metadata[key])
    except ValueError as problem:
        message = f"{table.path}: {key} = {table.metadata[key]!r} is no number; mend or remove that comment line"
        raise InvalidInputError(message) from problem


def _check_amplitude(amplitude: float, unit: str) -> None:
    if not (math.isfinite(amplitude) and amplitude > 0.0):
        raise out_of_range("amplitude", amplitude, unit, "above 0 and finite", "give that of the sine")


def _read_frequencies(table: CsvTable, quantity: Quantity, column: str) -> Floats:
    omega = quantity.convert(table.numbers(column))
    for row, value in enumerate(omega):
        if not (value > 0.0 and math.isfinite(value)):
            raise table.error(row, column, f"frequency {table.rows[row][table.position(column)]} is not positive; leave that row out")
        if row and value <= omega[row - 1]:
            fault = "repeats that of" if value == omega[row - 1] else "is below that of"
            raise table.error(row, column, f"the frequency {fault} line {table.lines[row - 1]}; sort the rows and give each frequency once")
    return omega


def _read_sizes(table: CsvTable, quantity: Quantity, column: str) -> Floats:
    with np.errstate(over="ignore"):
        sizes = quantity.convert(table.numbers(column))
    for row, value in enumerate(sizes):
        if not (value >= 0.0 and math.isfinite(value)):
            cell = table.rows[row][table.position(column)]
            raise table.error(row, column, f"{cell} is no magnitude; give one that is finite and not negative, and put a sign in the phase")
    return sizes


def _read_rectangular(table: CsvTable, polar: Complexes, phases: Floats) -> Complexes:
    """The exact values, which must agree with those of the columns for people."""
    values = np.empty(polar.size, dtype=complex)
    values.real, values.imag = table.numbers("gain_real"), table.numbers("gain_imag")
    for row, value in enumerate(values):
        rounding = _AGREEMENT + 4.0 * np.finfo(float).eps * abs(phases[row])
        if not abs(value - polar[row]) <= rounding * abs(value) + _TINY:
            what = f"{value:.6g} contradicts magnitude and phase of that line, {polar[row]:.6g}"
            raise table.error(row, "gain_real, gain_imag", f"{what}; remove the columns that are out of date, or undo the change")
    return values


def _make_response(table: CsvTable, omega: Floats, values: Complexes, *, is_amplitude: bool) -> FrequencyResponse:
    says = table.metadata
    return FrequencyResponse(
        omega=omega,
        values=values,
        input_name=says.get("input_name", "input"),
        input_unit=says.get("input_unit", "deg" if is_amplitude else "1"),
        output_name=says.get("output_name", "output"),
        output_unit=says.get("output_unit", "rad/s" if is_amplitude else "1"),
        method=says.get("method", f"file {table.path.name}"),
        known_delay=_metadata_number(table, "known_delay_s") if "known_delay_s" in says else 0.0,
    )


def _remark_notes(table: CsvTable) -> tuple[str, ...]:
    said = ((PARTIAL, "is partial"), (DISPUTED, "holds a response that another route contradicts"))
    return tuple(f"{table.path} {what}: {table.metadata[key]}" for key, what in said if key in table.metadata)


def _turn_notes(response: FrequencyResponse, phases: Floats) -> tuple[str, ...]:
    """Say where the phase of the file has other full turns than the phase that the values alone give."""
    turns = np.round((response.phase_deg - phases / DEGREE) / 360.0)
    if not np.any(turns):
        return ()
    first = float(response.omega[np.flatnonzero(turns)[0]])
    return (f"the phase in the file and the phase unwrapped from the lowest frequency differ by full turns from {first:g} rad/s on",)


def _lead_notes(response: FrequencyResponse) -> tuple[str, ...]:
    """Say where the phase leads what the slope of the magnitude allows a stable system: a lag given as positive, or radians as degrees.

    Source: Bode (1945), Network Analysis and Feedback Amplifier Design, chapter 14: a slope of n in the logarithms is worth n times 90 deg.
    """
    if response.omega.size < _FEWEST_FOR_SLOPE or not np.all(response.magnitude > 0.0):
        return ()
    logarithm = np.log(response.omega)
    if not np.all(np.diff(logarithm) > 0.0):
        return ()  # frequencies that agree to rounding: the magnitude has no slope between them
    slope = np.gradient(np.log(response.magnitude), logarithm)
    lead = response.phase_deg - 90.0 * slope
    lead -= 180.0 * np.round(lead[0] / 180.0)
    if float(np.median(lead)) <= _LARGEST_LEAD:
        return ()
    message = (
        f"the phase leads by {np.median(lead):.0f} deg (median) what the slope of the magnitude allows a stable system: if the column"
        " holds a lag as a positive number name it phase_lag_deg, and if it holds radians phase_rad (or say so with --columns);"
        " else the plant is unstable"
    )
    return (message,)
