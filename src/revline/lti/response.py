"""Frequency responses as values: how one output answers a small sine on one input."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.errors import InvalidInputError, out_of_range
from revline.units import DEGREE, Seconds
from revline.values import make_read_only

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Turns = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrequencyResponse:
    """How one output answers a small sine on one input, about one operating point.

    Attributes:
        omega: frequencies in rad/s, strictly rising, none negative.
        values: complex response at each, in output units per input unit; a lag has a negative phase.
        input_name, input_unit: the signal that is moved.
        output_name, output_unit: the signal that answers.
        method: how the values were found, for example "peaks" or "exact".
        known_delay: delay in s that the values are known to contain; the phase is unwrapped after removing it, so that a grid too
            coarse for the delay still gives the right number of turns.
        turns: whole turns to add to each value's own phase, where they are known otherwise; of size 0 where the phase is unwrapped.

    Raises:
        InvalidInputError: no frequency, unequal lengths, values that are not finite, frequencies that do not rise, or a negative delay.
    """

    omega: Floats
    values: Complexes
    input_name: str = "input"
    input_unit: str = "1"
    output_name: str = "output"
    output_unit: str = "1"
    method: str = ""
    known_delay: Seconds = 0.0
    turns: Turns = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        omega, values = check_frequencies(self.omega), np.array(self.values, dtype=complex)
        if values.shape != omega.shape:
            message = f"{omega.size} frequencies with values of shape {values.shape}; give one complex value for each frequency"
            raise InvalidInputError(message)
        if not np.all(np.isfinite(values)):
            bad = float(omega[~np.isfinite(values)][0])
            message = f"the response at {bad:g} rad/s is not finite; leave that frequency out"
            raise InvalidInputError(message, frequency=bad)
        if self.turns.size and self.turns.shape != omega.shape:
            message = f"{omega.size} frequencies with turns of shape {self.turns.shape}; give one number for each frequency, or none"
            raise InvalidInputError(message)
        check_delay(self.known_delay)
        object.__setattr__(self, "omega", omega)
        object.__setattr__(self, "values", values)
        make_read_only(self)

    @property
    def magnitude(self) -> Floats:
        """Magnitude, in output units per input unit."""
        return np.abs(self.values)

    @property
    def magnitude_db(self) -> Floats:
        """Magnitude in decibels, 20 log10.

        Raises:
            InvalidInputError: a magnitude is zero and has no decibels.
        """
        return to_decibels(self.magnitude, self.omega)

    @property
    def phase_deg(self) -> Floats:
        """Phase in degrees, negative for lag: with its known turns, else unwrapped from the lowest frequency on without the known delay."""
        if self.turns.size:
            return np.angle(self.values) / DEGREE + 360.0 * self.turns
        lag = self.omega * self.known_delay
        return (np.unwrap(np.angle(self.values * np.exp(1j * lag))) - lag) / DEGREE


def count_turns(values: Complexes, phase_deg: Floats) -> Turns:
    """Count the whole turns by which known phases differ from those that complex values have by themselves.

    Args:
        values: complex responses.
        phase_deg: their phases in degrees, with all turns.
    """
    found: Turns = np.round((phase_deg - np.angle(values) / DEGREE) / 360.0).astype(np.int64)
    return found


def check_frequencies(omega: ArrayLike) -> Floats:
    """Copy frequencies into an array, or refuse them.

    Args:
        omega: frequencies in rad/s.

    Returns:
        A new array, of one dimension.

    Raises:
        InvalidInputError: there are none, one is negative or not finite, or they do not rise strictly.
    """
    grid = np.array(omega, dtype=float)
    if grid.ndim != 1 or grid.size == 0:
        message = f"frequencies have shape {grid.shape}; give a list of at least one frequency in rad/s"
        raise InvalidInputError(message)
    wrong = ~(np.isfinite(grid) & (grid >= 0.0))
    if np.any(wrong):
        raise out_of_range("frequency", float(grid[wrong][0]), "rad/s", "0 to infinity", "give finite frequencies that are not negative")
    falling = np.flatnonzero(np.diff(grid) <= 0.0)
    if falling.size:
        low, high = float(grid[falling[0]]), float(grid[falling[0] + 1])
        message = f"frequency {high:g} rad/s follows {low:g} rad/s; sort the frequencies and give each once"
        raise InvalidInputError(message, frequency=high, previous=low)
    return grid


def check_delay(delay: Seconds) -> None:
    """Refuse a delay that is negative or not finite.

    Raises:
        InvalidInputError: it is.
    """
    if not (math.isfinite(delay) and delay >= 0.0):
        raise out_of_range("delay", delay, "s", "0 to infinity", "give a finite delay that is not negative")


def to_decibels(magnitude: Floats, omega: Floats) -> Floats:
    """Convert magnitudes at some frequencies to decibels.

    Raises:
        InvalidInputError: a magnitude is zero.
    """
    if np.any(magnitude == 0.0):
        zero = float(omega[magnitude == 0.0][0])
        message = f"the magnitude at {zero:g} rad/s is 0 and has no decibels; leave that frequency out"
        raise InvalidInputError(message, frequency=zero)
    decibels: Floats = 20.0 * np.log10(magnitude)
    return decibels
