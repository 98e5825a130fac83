"""The whole turns of a response's phases, counted anew: small orbits are followed from low frequency on, without the linear model's phase.

Each orbit fulfils the nonlinear equations, whatever the linear model from which its search starts, so that a turn which the linear model
tells wrongly shows. Neighbouring orbits are as close as the lags at rest ask for, and closer where the phase still moves fast.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from revline.analysis.balance_attempts import attempt_balance
from revline.analysis.harmonic_balance import BalanceSettings, HarmonicBalance
from revline.analysis.periodic import Excitation
from revline.analysis.trim import Trim
from revline.analysis.vanishing_amplitude import FIRST, find_reach
from revline.errors import AnalysisError, NotConvergedError
from revline.lti.response import FrequencyResponse
from revline.system import DelaySystem, Floats
from revline.values import make_read_only

LOWEST = 1e-2
"""Where the phase is followed from at most, as a part of the lowest frequency."""

SLOW = 0.1
"""The same as a part of the slowest rate at the trim, and of one over its lags: there no lag and no root has turned the phase yet."""

LARGEST_JUMP = np.pi / 3.0
"""Largest difference of neighbouring phases, in radians."""

PER_DECADE = 8
"""Fewest orbits per decade of frequency."""

MOST_ORBITS = 2000
"""Most orbits, some seconds of computing."""

SETTINGS = BalanceSettings(tolerance=1e-3, most_harmonics=8)
"""Of the orbits: only the quarter of a turn in which each answer lies matters."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnCheck:
    """Phases as they are given, and as small orbits count them.

    Attributes:
        omega: frequencies in rad/s, shape (n_freq,), as all arrays.
        given_deg: phases with all turns, in degrees.
        counted_deg: phases of small orbits, followed from low frequency on.
        orbits: how many were computed.
    """

    omega: Floats
    given_deg: Floats
    counted_deg: Floats
    orbits: int

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def turns(self) -> NDArray[np.int64]:
        """Whole turns by which the phases differ; what is left is the effect of the amplitude."""
        return np.rint((self.given_deg - self.counted_deg) / 360.0).astype(np.int64)

    @property
    def agreed(self) -> bool:
        """Whether all phases have the same turns."""
        return not np.any(self.turns)

    def require_agreement(self) -> None:
        """Raise where a phase has other turns.

        Raises:
            AnalysisError: names the first frequency, both phases, and how many frequencies there are.
        """
        if self.agreed:
            return
        k = int(np.argmax(self.turns != 0))
        message = (
            f"cross-check failed at {np.count_nonzero(self.turns)} of {self.omega.size} frequencies: at {self.omega[k]:.6g} rad/s the "
            f"phase is given as {self.given_deg[k]:.6g} deg, but small orbits followed from low frequency have "
            f"{self.counted_deg[k]:.6g} deg: the whole turns differ by {self.turns[k]:d}; the turns that the linear model tells, or its "
            "lags, are wrong"
        )
        raise AnalysisError(message, frequency=float(self.omega[k]), turns=float(self.turns[k]))


def check_turns(system: DelaySystem, trim: Trim, excitation: Excitation, response: FrequencyResponse) -> TurnCheck:
    """Count the turns of a response's phases by following orbits at a small amplitude from low frequency on.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        excitation: what is moved and watched; its amplitude limits that of the orbits.
        response: with all turns of its phases, at frequencies above 0.

    Returns:
        Both phases at each frequency, with the turns by which they differ.

    Raises:
        AnalysisError: the trim is unstable, an orbit is not found, or the output does not answer.
        NotConvergedError: too many orbits would be needed.
    """
    small = replace(excitation, amplitude=0.25 * FIRST * find_reach(system, trim, excitation))
    omega = response.omega
    grid = _first_grid(omega, trim)
    values = _balance(system, trim, small, grid)
    while True:
        jumps = np.abs(np.angle(values[1:] / values[:-1]))
        # Where the response passes zero its phase jumps, however close the orbits.
        wide = (jumps > LARGEST_JUMP) & (np.diff(grid) > 1e-6 * grid[1:])
        if not np.any(wide):
            break
        more = 0.5 * (grid[:-1] + grid[1:])[wide]
        _limit(grid.size + more.size, omega)
        order = np.argsort(np.concatenate((grid, more)))
        values = np.concatenate((values, _balance(system, trim, small, more)))[order]
        grid = np.concatenate((grid, more))[order]
    phases = np.degrees(np.unwrap(np.angle(values)))
    return TurnCheck(omega=omega, given_deg=response.phase_deg, counted_deg=phases[np.searchsorted(grid, omega)], orbits=grid.size)


def _first_grid(wanted: Floats, trim: Trim) -> Floats:
    total_lag, highest = float(np.sum(trim.lags)), wanted[-1]
    lowest = min(LOWEST * wanted[0], SLOW * abs(trim.roots.spectral_abscissa), SLOW / max(total_lag, np.finfo(float).tiny))
    needed = highest * total_lag / LARGEST_JUMP
    _limit(needed, wanted)
    spread = np.geomspace(lowest, highest, 2 + int(PER_DECADE * np.log10(highest / lowest)))[:-1]
    even = np.linspace(lowest, highest, 2 + 2 * int(needed))[:-1]
    grid = np.union1d(np.union1d(spread, even), wanted)
    _limit(grid.size, wanted)
    return grid


def _limit(orbits: float, omega: Floats) -> None:
    if orbits > MOST_ORBITS:
        message = (
            f"to count the turns of the phase up to {omega[-1]:g} rad/s takes more than {MOST_ORBITS} orbits; choose lower frequencies"
        )
        raise NotConvergedError(message, frequency=float(omega[-1]))


def _balance(system: DelaySystem, trim: Trim, excitation: Excitation, omega: Floats) -> NDArray[np.complex128]:
    outcome = attempt_balance(system, trim, excitation, omega, settings=SETTINGS)
    if isinstance(outcome, HarmonicBalance):
        return outcome.fundamental.values
    first = outcome.missing[0]
    message = f"turns cannot be counted past {first.omega:g} rad/s: {first.reason}"
    raise NotConvergedError(message, frequency=first.omega)
