"""A frequency response from records of an input and an output, as a test bench logs them: spectra averaged over overlapping stretches.

With U and Y the spectra of a stretch, H = <U* Y>/<U* U> and the coherence |<U* Y>|^2/(<U* U><Y* Y>), averages over all stretches. Noise
on the output alone leaves H without bias. One standard deviation of |H| as a fraction of it is sqrt((1 - c)/(2 c n)), c the coherence
and n the number of stretches that are independent.

Source: Welch (1967), IEEE Transactions on Audio and Electroacoustics 15(2), 70-73; Bendat and Piersol (2010), Random Data, chapter 9.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from revline.errors import AnalysisError, InvalidInputError
from revline.lti.response import FrequencyResponse
from revline.values import make_read_only

Floats = NDArray[np.float64]

FEWEST_SAMPLES = 256
"""A shorter record tells no response."""

STRETCHES = 8
"""Into so many independent stretches a record is cut."""

FEWEST_PER_STRETCH = 64
"""Samples of a stretch at least; a shorter record has fewer stretches."""

LONGEST_PERIODS = 3.0
"""The lowest frequency that is told has so many periods in a stretch: below, leakage through the window falsifies it."""

TOP = 0.6
"""Part of half the sampling frequency up to which a response is told: above, interpolation between samples falsifies it."""

MOST_POINTS = 80
"""So many frequencies at most, spaced alike on a logarithmic axis."""

EXCITED = 1e-6
"""Frequencies at which the input has less than this part of its largest power are left out."""

WIDEST_GAP = 5.0
"""A distance between samples that is this many times the usual one is a gap."""

TRUSTED = 0.8
"""Coherence from which on a frequency is kept."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoggedResponse:
    """A response estimated from records, at the frequencies that the records tell.

    Attributes:
        response: output per input.
        coherence: part of the output's power that the input explains, shape (n,).
        deviation: one standard deviation of the magnitude, as a fraction of it, shape (n,): its random part alone, without what leaks
            from one frequency to another or is lost between samples, which near the top of the band can be much more.
        stretches: how many independent ones were averaged.
        left_out: how many frequencies in the band had too little coherence or input.
    """

    response: FrequencyResponse
    coherence: Floats
    deviation: Floats
    stretches: int
    left_out: int

    def __post_init__(self) -> None:
        make_read_only(self)


def estimate_response(
    times: ArrayLike, moved: ArrayLike, watched: ArrayLike, *, names: tuple[str, str], units: tuple[str, str]
) -> LoggedResponse:
    """Estimate a frequency response from an input's and an output's record.

    Args:
        times: of the samples, rising, in s, shape (n,); records that are not evenly sampled are interpolated straight.
        moved: the input, shape (n,).
        watched: the output, shape (n,).
        names: of input and output.
        units: of input and output.

    Returns:
        The response where the coherence is at least 0.8.

    Raises:
        InvalidInputError: the record is too short or has a gap, or the input or the output does not move.
        AnalysisError: at no frequency does the input explain the output.
    """
    clock, u, y = _evenly(times, moved, watched)
    for name, values in zip(names, (u, y), strict=True):
        if float(np.ptp(values)) == 0.0:
            message = f"{name} does not move in this record; log one in which it does"
            raise InvalidInputError(message, quantity=name)
    step = float(clock[1] - clock[0])
    length = max(FEWEST_PER_STRETCH, clock.size // STRETCHES)
    options = {"fs": 1.0 / step, "nperseg": length, "detrend": "linear"}
    frequency, power = signal.welch(u, **options)
    _, cross = signal.csd(u, y, **options)
    _, coherence = signal.coherence(u, y, **options)
    band = (frequency * length * step >= LONGEST_PERIODS) & (frequency <= TOP * 0.5 / step)
    with np.errstate(invalid="ignore"):
        told = band & (power > EXCITED * float(np.max(power[band], initial=0.0))) & (coherence >= TRUSTED)
    if not told.any():
        best = float(np.max(coherence[band], initial=0.0))
        message = (
            f"at no frequency does {names[0]} explain {names[1]}: the largest coherence is {best:.2g}, and {TRUSTED:g} is wanted; log a "
            "longer record in which it moves more"
        )
        raise AnalysisError(message, coherence=best)
    kept = _spread(frequency, np.flatnonzero(told))
    stretches = clock.size // length
    response = FrequencyResponse(
        omega=2.0 * math.pi * frequency[kept],
        values=cross[kept] / power[kept],
        input_name=names[0],
        input_unit=units[0],
        output_name=names[1],
        output_unit=units[1],
        method="spectra of a record",
    )
    c = np.minimum(coherence[kept], 1.0)
    return LoggedResponse(
        response=response,
        coherence=c,
        deviation=np.sqrt((1.0 - c) / (2.0 * c * stretches)),
        stretches=stretches,
        left_out=int(np.count_nonzero(band) - np.count_nonzero(told)),
    )


def _evenly(times: ArrayLike, moved: ArrayLike, watched: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Records on an even clock with as many samples."""
    t, u, y = (np.asarray(values, dtype=float) for values in (times, moved, watched))
    if t.size < FEWEST_SAMPLES:
        message = f"a record of {t.size} samples is too short to tell a frequency response; give {FEWEST_SAMPLES} or more"
        raise InvalidInputError(message, samples=float(t.size))
    steps = np.diff(t)
    usual, widest = float(np.median(steps)), int(np.argmax(steps))
    if float(steps[widest]) > WIDEST_GAP * usual:
        message = (
            f"the record has a gap of {steps[widest]:.4g} s at {t[widest]:.6g} s, where its samples usually lie {usual:.4g} s apart; what "
            "is not recorded tells no response: give one stretch without gaps"
        )
        raise InvalidInputError(message, gap=float(steps[widest]), at=float(t[widest]))
    clock = np.linspace(t[0], t[-1], t.size)
    return clock, np.interp(clock, t, u), np.interp(clock, t, y)


def _spread(frequency: Floats, told: NDArray[np.intp]) -> NDArray[np.intp]:
    """Of the frequencies that are told some, spaced alike on a logarithmic axis."""
    if told.size <= MOST_POINTS:
        return told
    wanted = np.geomspace(frequency[told[0]], frequency[told[-1]], MOST_POINTS)
    nearest = np.abs(frequency[told][None, :] - wanted[:, None]).argmin(axis=1)
    return told[np.unique(nearest)]
