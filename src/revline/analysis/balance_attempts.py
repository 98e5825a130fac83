"""Harmonic balance at many frequencies in batches, keeping what is found where a frequency has no answer or the whole is interrupted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.harmonic_balance import BalanceSettings, HarmonicBalance, balance_each, excited_case
from revline.analysis.linearize import linearize
from revline.analysis.periodic import Excitation
from revline.analysis.phase_turns import read_turns
from revline.analysis.sinestream import MissingAnswer
from revline.analysis.threads import Progress
from revline.analysis.trim import Trim
from revline.errors import RevlineError, out_of_range
from revline.lti.response import check_frequencies
from revline.system import DelaySystem, Floats

BATCH = 48
"""Frequencies at once: orbits with the most harmonics then take some hundred megabytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartialBalance:
    """What is found of a response by harmonic balance, and what is not.

    Attributes:
        finished: the answers at the frequencies that have one.
        missing: the others.
        reach: amplitude up to which an orbit was found at each of these too; none where one of them was not tried.
    """

    finished: HarmonicBalance
    missing: tuple[MissingAnswer, ...]
    reach: float | None = None

    def __str__(self) -> str:
        """Say what is missing, and why."""
        count = self.finished.omega.size
        missing = "; ".join(f"{entry.omega:g} rad/s ({entry.reason})" for entry in self.missing)
        asked, unit = self.finished.excitation.amplitude, self.finished.moved.unit
        reach = "" if self.reach is None else f" with {asked:g} {unit}, each of them has an answer up to {self.reach:.4g} {unit}"
        return f"{count} of {count + len(self.missing)} frequencies are finished{reach}; missing: {missing}"


def attempt_balance(
    system: DelaySystem,
    trim: Trim,
    excitation: Excitation,
    frequencies: ArrayLike,
    *,
    settings: BalanceSettings | None = None,
    progress: Progress | None = None,
) -> HarmonicBalance | PartialBalance:
    """Balance harmonics as `balance_harmonics` does, and keep what is found where a frequency has no answer.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        excitation: what is moved, how far, and what is watched.
        frequencies: in rad/s, above 0, strictly rising; any number of them.
        settings: tolerance and most harmonics.
        progress: told which part of the frequencies is done.

    Returns:
        All answers, or those found with the reason why each other frequency is missing.

    Raises:
        InvalidInputError, AnalysisError, KeyboardInterrupt: as for `balance_harmonics`; of the frequencies' own errors the first, where
            none has an answer.
    """
    omega = check_frequencies(frequencies)
    if omega[0] == 0.0:
        raise out_of_range("frequency", 0.0, "rad/s", "values above 0", "ask for the steady map instead")
    case = replace(excited_case(system, trim, excitation, settings or BalanceSettings()), seek_limits=True)
    parts: list[HarmonicBalance] = []
    failures: list[tuple[float, RevlineError | KeyboardInterrupt]] = []
    done = 0
    try:
        for batch in np.array_split(omega, -(-omega.size // BATCH)):
            found, refusals = balance_each(case, trim, batch)
            parts += [] if found is None else [found]
            failures += [(float(batch[row]), refusals[row]) for row in sorted(refusals)]
            done += batch.size
            if progress is not None:
                progress(done / omega.size)
    except KeyboardInterrupt as interruption:
        failures += [(float(w), interruption) for w in omega[done:]]
    if not parts:
        raise failures[0][1]
    whole = _merge(system, trim, parts)
    if not failures:
        return whole
    missing = tuple(MissingAnswer(w, str(error) or "interrupted") for w, error in failures)
    return PartialBalance(finished=whole, missing=missing, reach=_reach([error for _, error in failures]))


def _reach(errors: Sequence[BaseException]) -> float | None:
    """The amplitude that all refusals tell an orbit up to."""
    reached = [error.details.get("amplitude") for error in errors if isinstance(error, RevlineError)]
    known = [amplitude for amplitude in reached if isinstance(amplitude, float)]
    return min(known) if len(known) == len(errors) else None


def _merge(system: DelaySystem, trim: Trim, parts: list[HarmonicBalance]) -> HarmonicBalance:
    """Put batches together; turns are counted over all frequencies, as from the lowest one."""
    if len(parts) == 1:
        return parts[0]
    first = parts[0]

    def joined(name: str) -> Floats:
        return np.concatenate([getattr(part, name) for part in parts])

    starts = np.cumsum([0, *(part.omega.size for part in parts[:-1])])
    omega, model = joined("omega"), linearize(system, trim).model
    values = np.concatenate([part.fundamental.values for part in parts])
    fundamental = read_turns(values, model.response(omega, first.moved.name, first.watched.name), model)
    return replace(
        first,
        omega=omega,
        fundamental=fundamental,
        batches=tuple(replace(batch, rows=batch.rows + ahead) for part, ahead in zip(parts, starts, strict=True) for batch in part.batches),
        notes=(*fundamental.notes, *(note for part in parts for note in part.notes[len(part.fundamental.notes) :])),
        harmonics=joined("harmonics"),
        distortion=joined("distortion"),
        mean=joined("mean"),
        error=joined("error"),
        last_step=joined("last_step"),
    )
