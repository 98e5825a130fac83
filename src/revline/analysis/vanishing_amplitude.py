"""Harmonic balance at ever smaller amplitudes, extrapolated to none: what the nonlinear equations say of the linear response.

The fundamental over the input is even in the amplitude a of a smooth system: F(a) = G + c a^2 + d a^4 + ... From a, a/2 and a/4 the first
two terms are eliminated; how much the last elimination changes tells what is left. No derivative at the operating point enters.

Source: the elimination is that of Richardson (1911), Philosophical Transactions A 210, 307-357.
"""

from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.balance_attempts import PartialBalance, attempt_balance
from revline.analysis.harmonic_balance import BalanceSettings, HarmonicBalance
from revline.analysis.periodic import Excitation
from revline.analysis.sinestream import MissingAnswer
from revline.analysis.trim import Trim
from revline.errors import AnalysisError
from revline.lti.response import Complexes
from revline.system import DelaySystem, Floats, index_of
from revline.values import make_read_only

FIRST = 1.0 / 16.0
"""Largest amplitude of the first three, as a part of how far the input may go."""

LEAST_REACH = 0.01
"""Amplitudes are not made from one below this part of the input's range, where it has one: what so small a sinusoid moves is lost in
rounding."""

SMALLER = 0.25
"""The next three amplitudes as a part of these, where the extrapolation is not good enough."""

MOST_TRIES = 4
"""How often amplitudes are made smaller; rounding, which grows as they shrink, allows no more."""

GOAL = 1e-6
"""Estimated relative error with which an extrapolation is good enough."""

SETTINGS = BalanceSettings(tolerance=1e-9, most_harmonics=16)
"""Of the orbits: at small amplitudes a few harmonics are enough, unless a limit is near."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VanishingAmplitude:
    """Responses extrapolated to no amplitude.

    Attributes:
        omega: frequencies in rad/s, shape (n_freq,).
        amplitudes: of the input, falling by halves, shape (3, n_freq).
        balanced: responses at these, shape (3, n_freq).
        values: extrapolated, shape (n_freq,).
        error: estimated relative error of these, shape (n_freq,).
        missing: frequencies without, and why.
    """

    omega: Floats
    amplitudes: Floats
    balanced: Complexes
    values: Complexes
    error: Floats
    missing: tuple[MissingAnswer, ...]

    def __post_init__(self) -> None:
        make_read_only(self)


@dataclass(frozen=True, slots=True)
class _Try:
    """An extrapolation from three amplitudes at one frequency."""

    amplitudes: tuple[float, float, float]
    balanced: Complexes
    value: complex
    error: float


def extrapolate_to_rest(system: DelaySystem, trim: Trim, excitation: Excitation, omega: Floats) -> VanishingAmplitude:
    """Balance harmonics at ever smaller amplitudes, and extrapolate the fundamental over the input to none.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        excitation: what is moved and watched; its amplitude, or a hundredth of the input's range if it has one and that is larger, or the
            way to the input's nearest end if that is shorter, is where to start.
        omega: frequencies in rad/s, above 0, strictly rising.

    Returns:
        The extrapolated responses with their estimated errors. A frequency at which there is none is named with the reason: no orbit
        found, or a limit so near that the smallest orbits still meet it.

    Raises:
        InvalidInputError: a name or a frequency cannot be used.
        AnalysisError: the trim is unstable, or the input is at an end of its range.
    """
    amplitude = FIRST * find_reach(system, trim, excitation)
    found: dict[float, _Try] = {}
    reasons: dict[float, str] = {}
    pending = omega
    for _ in range(MOST_TRIES):
        tries, failed = _extrapolate(system, trim, replace(excitation, amplitude=amplitude), pending)
        found |= {w: one for w, one in tries.items() if w not in found or one.error < found[w].error}
        reasons |= failed
        pending = np.array([w for w in pending if w not in found or found[w].error > GOAL])
        amplitude *= SMALLER
        if not pending.size:
            break
    kept = np.array([w for w in omega if w in found])
    best = [found[w] for w in kept]
    return VanishingAmplitude(
        omega=kept,
        amplitudes=np.array([one.amplitudes for one in best]).reshape(-1, 3).T,
        balanced=np.array([one.balanced for one in best], dtype=complex).reshape(-1, 3).T,
        values=np.array([one.value for one in best], dtype=complex),
        error=np.array([one.error for one in best]),
        missing=tuple(MissingAnswer(float(w), reasons[w]) for w in omega if w not in found),
    )


def find_reach(system: DelaySystem, trim: Trim, excitation: Excitation) -> float:
    """Find the amplitude that small ones are parts of: that of the excitation, not too small for rounding, and inside the input's range.

    Raises:
        InvalidInputError: there is no such input.
        AnalysisError: the input is at an end of its range.
    """
    moved = system.inputs[index_of(system.inputs, excitation.input_name)]
    base = trim.input(moved.name)
    least = LEAST_REACH * (moved.high - moved.low)
    reach = min(max(excitation.amplitude, least if np.isfinite(least) else 0.0), base - moved.low, moved.high - base)
    if reach <= 0.0:
        message = f"{moved.name} = {base:g} {moved.unit} is at an end of its range: no sinusoid has room there; move the operating point"
        raise AnalysisError(message, base=base)
    return float(reach)


def _extrapolate(system: DelaySystem, trim: Trim, excitation: Excitation, omega: Floats) -> tuple[dict[float, _Try], dict[float, str]]:
    """Extrapolate from the excitation's amplitude, its half and its quarter: by frequency what was found, and why other is not."""
    failed: dict[float, str] = {}
    by_amplitude: list[dict[float, tuple[complex, float]]] = []
    amplitudes = (excitation.amplitude, 0.5 * excitation.amplitude, 0.25 * excitation.amplitude)
    for amplitude in amplitudes:
        balance, missing = _balance(system, trim, replace(excitation, amplitude=amplitude), omega)
        failed |= missing
        by_amplitude.append(balance)
    tries = {}
    for w in omega:
        if w in failed:
            continue
        (large, e_large), (middle, e_middle), (small, e_small) = (part[w] for part in by_amplitude)
        if max(e_large, e_middle, e_small) > GOAL:
            failed[w] = f"harmonics decay slowly even at an amplitude of {amplitudes[2]:.3g}, as where a limit is near"
            continue
        upper, lower = (4.0 * middle - large) / 3.0, (4.0 * small - middle) / 3.0
        value = lower + (lower - upper) / 15.0
        # The weights of the three are (1, -20, 64) / 45.
        carried = (e_large + 20.0 * e_middle + 64.0 * e_small) / 45.0
        tries[w] = _Try(amplitudes, np.array([large, middle, small]), value, abs((lower - upper) / value) + carried)
    return tries, failed


def _balance(
    system: DelaySystem, trim: Trim, excitation: Excitation, omega: Floats
) -> tuple[dict[float, tuple[complex, float]], dict[float, str]]:
    """By frequency the response with its estimated relative error, and why others are not there."""
    try:
        outcome = attempt_balance(system, trim, excitation, omega, settings=SETTINGS)
    except AnalysisError as error:
        return {}, dict.fromkeys(omega.tolist(), str(error))
    balance: HarmonicBalance = outcome.finished if isinstance(outcome, PartialBalance) else outcome
    errors = balance.error + balance.last_step
    found = {float(w): (complex(v), float(e)) for w, v, e in zip(balance.omega, balance.fundamental.values, errors, strict=True)}
    missing = {entry.omega: entry.reason for entry in outcome.missing} if isinstance(outcome, PartialBalance) else {}
    return found, missing
