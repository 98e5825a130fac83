"""Unwrapping of phases: how many whole turns a phase known up to turns has, told by the exact linear model with its lags.

Frequencies too far apart leave the number of turns open when only neighbouring phases are compared. The linear model is evaluated as
densely as its lags ask for, so that its own turns are certain, and each measured phase takes the turn next to it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.cycle_readings import wrap
from revline.errors import NotConvergedError
from revline.lti.response import Complexes, FrequencyResponse, check_frequencies
from revline.lti.state_space import DelayStateSpace
from revline.system import Floats
from revline.units import DEGREE
from revline.values import make_read_only

LOWEST = 1e-3
"""Where the model's phase is followed from at most, as a part of the lowest frequency."""

SLOW = 0.1
"""The same as a part of the model's slowest rate, and of one over its lags: there no lag and no pole has turned the phase yet."""

SLOWEST = 1e-9
"""Rates below this part of the lowest frequency count as none, as those of integrators."""

LARGEST_JUMP = np.pi / 6.0
"""Largest difference of neighbouring phases of the model, in radians."""

MOST_POINTS = 1_000_000
"""Most frequencies at which the model is evaluated."""

QUARTER = 90.0
"""A measured phase further than this from the model's, in degrees, may have another number of turns."""


TOO_SMALL = 1e-2
"""Where the model answers with less than this part of the measured response, it is no guide."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SineReading:
    """Responses read from all waveforms in one way.

    Attributes:
        values: output over input, shape (n_freq,), a lag having a negative phase.
        phase_deg: its phase with all turns, counted from 0 at low frequency for a positive gain; negative for lag.
        notes: what about the phases is uncertain, in words.
    """

    values: Complexes
    phase_deg: Floats
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        make_read_only(self)


def read_turns(values: Complexes, guide: FrequencyResponse, model: DelayStateSpace) -> SineReading:
    """Count the turns of measured phases with the help of a linear model.

    Args:
        values: measured responses.
        guide: the model's response at the same frequencies.
        model: linear model about the same point.

    Returns:
        The responses with their phases, and notes on what is uncertain about these.
    """
    omega = guide.omega
    weak = np.flatnonzero(guide.magnitude < TOO_SMALL * np.abs(values))
    if weak.size:
        part = guide.magnitude[weak[0]] / abs(values[weak[0]])
        phase_deg, notes = unwrap_alone(values, omega, float(np.max(model.lags, initial=0.0)))
        reason = f"at {omega[weak[0]]:g} rad/s the linear model has {part:.1g} of the answer of {guide.output_name} to {guide.input_name}"
        notes = (f"{reason}: it cannot tell the turns", *notes)
    else:
        phase_deg, notes = take_turns(values, follow_phase(model, omega, guide.input_name, guide.output_name), omega)
    return SineReading(values=values, phase_deg=phase_deg, notes=notes)


def follow_phase(model: DelayStateSpace, omega: ArrayLike, input_name: str, output_name: str) -> Floats:
    """Find the phase of a linear model with all its turns, from the lowest frequency on.

    Args:
        model: with its delays exact.
        omega: frequencies in rad/s, above 0, strictly rising.
        input_name: which input.
        output_name: which output.

    Returns:
        Phases in radians, negative for lag, counted from -pi to pi at a frequency that is slow for the model, at most a thousandth of the
        lowest one.

    Raises:
        InvalidInputError: there is no such signal, or the frequencies cannot be used.
        NotConvergedError: the model does not answer at a frequency, or its phase turns too fast to be followed.
    """
    wanted = check_frequencies(omega)
    rates = np.append(np.abs(np.linalg.eigvals(model.A)), 1.0 / max(float(np.sum(model.lags)), np.finfo(float).tiny))
    lowest = min(LOWEST * wanted[0], SLOW * float(np.min(rates, where=rates > SLOWEST * wanted[0], initial=np.inf)))
    grid = _first_grid(wanted, lowest, float(np.sum(model.lags)))
    while True:
        values = model.response(grid, input_name, output_name).values
        if np.any(values == 0.0):
            where = float(grid[values == 0.0][0])
            message = f"{output_name} does not answer {input_name} in the linear model at {where:g} rad/s: it has no phase there"
            raise NotConvergedError(message, frequency=where)
        jumps = np.abs(np.angle(values[1:] / values[:-1]))
        # Where the response passes zero its phase jumps, however fine the grid.
        wide = (jumps > LARGEST_JUMP) & (np.diff(grid) > 1e-9 * grid[1:])
        if not np.any(wide):
            break
        grid = np.union1d(grid, 0.5 * (grid[:-1] + grid[1:])[wide])
    phases = np.unwrap(np.angle(values))
    found: Floats = phases[np.searchsorted(grid, wanted)]
    return found


def _first_grid(wanted: Floats, lowest: float, total_lag: float) -> Floats:
    highest = wanted[-1]
    spread = np.geomspace(lowest, highest, 2 + int(60 * np.log10(highest / lowest)))
    needed = highest * total_lag / LARGEST_JUMP
    if needed > MOST_POINTS:
        message = f"the lags of {total_lag:g} s turn the phase {needed / 12.0:.3g} times up to {highest:g} rad/s; choose lower frequencies"
        raise NotConvergedError(message, frequency=float(highest), lag=total_lag)
    even = np.linspace(lowest, highest, 2 + 2 * int(needed))
    return np.union1d(np.union1d(spread, even)[1:-1], np.union1d(wanted, [lowest]))


def take_turns(values: Complexes, guide: Floats, omega: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Give each measured phase the turn next to a guide's.

    Args:
        values: measured responses.
        guide: phases in radians with all turns, from `follow_phase`.
        omega: frequencies in rad/s.

    Returns:
        Phases in degrees, and a note for each that is more than a quarter turn from the guide.
    """
    offset = wrap(np.angle(values) - guide)
    phases = (guide + offset) / DEGREE
    far = np.abs(offset) / DEGREE > QUARTER
    notes = (
        f"phase at {w:g} rad/s is {d / DEGREE:.0f} deg from the linear model's: its number of turns is uncertain"
        for w, d in zip(omega[far], offset[far], strict=True)
    )
    return phases, tuple(notes)


def unwrap_alone(values: Complexes, omega: Floats, lag: float) -> tuple[Floats, tuple[str, ...]]:
    """Unwrap phases from neighbour to neighbour after removing a lag, where no model tells their turns.

    Args:
        values: measured responses.
        omega: frequencies in rad/s.
        lag: in s, removed before and added again.

    Returns:
        Phases in degrees, and notes: how they were found, and where a step between neighbours leaves the turns open.
    """
    steps = np.unwrap(np.angle(values * np.exp(1j * omega * lag))) / DEGREE
    wide = np.flatnonzero(np.abs(np.diff(steps)) > QUARTER)
    notes = [f"phases were unwrapped from neighbour to neighbour after removing a lag of {lag:g} s"]
    notes += [f"phase turns by {steps[k + 1] - steps[k]:.0f} deg from {omega[k]:g} to {omega[k + 1]:g} rad/s: too coarse" for k in wide]
    return steps - omega * lag / DEGREE, tuple(notes)
