"""A frequency response from records of an input and an output, as a test bench logs them, with what it may be wrong by.

Records tell nothing of what happens between samples. What enters a plant between them is therefore asked for, or taken from the record's
look, and divided out: an input held until its next sample has lost sinc(w h/2) and half a sample of time, one that goes straight to it
sinc^2(w h/2). What then is left of frequencies above half the sampling frequency, which samples cannot tell apart from those below, is
bounded by how steeply the response falls. Leakage between frequencies is estimated with the response; see `local_polynomials`.

An input that a controller moved answers what disturbs the output: where disturbances prevail, the spectra of the two tell the controller
turned round, -1/C, as surely as a plant. The command that the controller followed knows nothing of disturbances, so that the response of
the output to it, over that of the input to it, is the plant's.

Source: Pintelon and Schoukens (2012), System Identification: A Frequency Domain Approach, chapters 7 and 13; the
responses to a command: Ljung (1999), System Identification: Theory for the User, chapter 13.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.analysis.local_polynomials import LocalFit, fit_locally
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.response import Complexes, FrequencyResponse
from revline.values import make_read_only

Floats = NDArray[np.float64]

FEWEST_SAMPLES = 256
"""A shorter record tells no response."""

FEWEST_PERIODS = 16
"""The lowest frequency that is told has so many periods in the record."""

NEIGHBOURS = (8, 24)
"""Frequencies on each side that tell the response at one; a third of its distance from 0, in these limits."""

TOP = 0.6
"""Part of half the sampling frequency up to which a response is told: above, what samples cannot tell apart is above a tenth."""

MOST_POINTS = 80
"""So many frequencies at most, spaced alike on a logarithmic axis; of those near each the one with most input."""

EXCITED = 1e-5
"""Frequencies at which the input has less than this part of its largest power, so far as it is no transient, are left out."""

OWN, OWN_OF_FEW = 0.05, 2.0
"""A frequency at which the input has less than this part of its neighbours' mean power is left out: theirs do not tell its response. The
second is for an input of few sinusoids, of which only the lines themselves are told."""

WIDEST_GAP = 5.0
"""A distance between samples that is this many times the usual one is a gap."""

TRUSTED = 0.8
"""Coherence from which on a frequency is kept."""

MOST_BIAS = 0.1
"""A frequency whose bound is larger is left out."""

EVEN = 1e-3
"""Samples this near to an even clock, in distances of samples, are evenly spaced."""

STEEPEST = 1.0
"""Above what is told a response is taken to fall with this power of the frequency at most, as all do that have a lag."""

NEAR_TOP = 0.9
"""The magnitude from which on it falls is the largest above this part of the highest frequency told."""

ALIASES = 60
"""Multiples of the sampling frequency that are summed."""

FEW_LEVELS = 16
"""An input of so few values at most is held between its samples, and switched at them."""


class Between(Enum):
    """What an input does between its samples: stays, goes straight to the next, or has no frequencies above half the sampling frequency."""

    HELD = "held"
    STRAIGHT = "straight"
    SMOOTH = "smooth"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoggedResponse:
    """A response estimated from records, at the frequencies that the records tell.

    Attributes:
        response: output per input.
        coherence: part of the output's power that the input explains, shape (n,); with a command, what it explains of the two, the lesser.
        deviation: one standard deviation of the magnitude, as a fraction of it, shape (n,): its random part.
        bias: bound of the part that is not random, as a fraction of the magnitude, of the complex response, shape (n,): leakage, what lies
            above half the sampling frequency if the response keeps falling there, and samples that are not even. Where `known` is false
            also what an input smooth between its samples would change in the magnitude.
        between: what the input was taken to do between its samples.
        known: whether that was given, or was to be seen; else an input held there instead would have a delay half a sample shorter.
        neighbours: how many frequencies told each one, shape (n,).
        left_out: how many frequencies looked at had too little coherence or input, or too large a bound.
    """

    response: FrequencyResponse
    coherence: Floats
    deviation: Floats
    bias: Floats
    between: Between
    known: bool
    neighbours: NDArray[np.int64]
    left_out: int

    def __post_init__(self) -> None:
        make_read_only(self)


def estimate_response(
    times: ArrayLike,
    moved: ArrayLike,
    watched: ArrayLike,
    *,
    names: tuple[str, str],
    units: tuple[str, str],
    between: Between | None = None,
    command: ArrayLike | None = None,
) -> LoggedResponse:
    """Estimate a frequency response from an input's and an output's record.

    Args:
        times: of the samples, rising, in s, shape (n,); records that are not evenly sampled are interpolated straight.
        moved: the input, shape (n,).
        watched: the output, shape (n,).
        names: of input and output.
        units: of input and output.
        between: what the input does between its samples; where it is not given, one of few values, or one that stands still between
            jumps, is held, any other straight as all recordings are.
        command: what a controller that moved the input was to follow, shape (n,); without one, nothing that moves the output otherwise may
            move the input too.

    Returns:
        The response where the coherence is at least 0.8 and the bias at most 0.1.

    Raises:
        InvalidInputError: the record is too short, has a gap or a value that is not finite, or one of its signals does not move.
        AnalysisError: at no frequency does the input explain the output.
    """
    columns = _columns(times, dict(zip((*names, "command"), (moved, watched, command), strict=True)))
    clock, signals, uneven = _evenly(np.asarray(times, dtype=float), columns)
    held = looks_held(moved)
    shape = between or (Between.HELD if held else Between.STRAIGHT)
    known, step = between is not None or held, float(clock[1] - clock[0])
    sizes = [float(np.ptp(signal)) for signal in signals]
    u, y, *commands = (np.fft.rfft((signal - signal.mean()) / size) for signal, size in zip(signals, sizes, strict=True))
    places = _candidates(commands[0] if commands else u)
    omega = np.asarray(2.0 * math.pi * places / (clock.size * step), dtype=np.float64)
    ratio = _ratio(_told(commands[0], u, places), _told(commands[0], y, places)) if commands else _told(u, y, places)
    answers, told, bias = ratio.values / _shape(shape, omega * step), np.isfinite(ratio.leakage), ratio.leakage.copy()
    if told.any():
        bias[told] += _aliases(omega[told], np.abs(answers[told]), step, shape) + _uncertain(omega[told] * step, shape, known, uneven)
    kept = told & (bias <= MOST_BIAS)
    if not kept.any():
        raise _nothing_told(("the command", " and ".join(names)) if commands else names, ratio.coherence, bias[told])
    response = FrequencyResponse(
        omega=omega[kept],
        values=answers[kept] * (sizes[1] / sizes[0]),
        input_name=names[0],
        input_unit=units[0],
        output_name=names[1],
        output_unit=units[1],
        method="spectra of a record",
    )
    return LoggedResponse(
        response=response,
        coherence=ratio.coherence[kept],
        deviation=ratio.deviation[kept],
        bias=bias[kept],
        between=shape,
        known=known,
        neighbours=np.array([2 * _neighbours(int(k)) + 1 for k in places[kept]]),
        left_out=int(np.count_nonzero(~kept)),
    )


class _Told(NamedTuple):
    """What spectra tell at each frequency; deviation and leakage are relative, and infinite where the spectra do not suffice."""

    values: Complexes
    coherence: Floats
    deviation: Floats
    leakage: Floats


def _told(moved: Complexes, watched: Complexes, places: NDArray[np.intp]) -> _Told:
    fits = [fit_locally(moved, watched, int(k), _neighbours(int(k))) for k in places]
    coherence, told = _judged(fits)
    leakage = np.full(places.size, np.inf)
    if told.any():
        leakage[told] = _leakage([fit for fit, kept in zip(fits, told, strict=True) if kept], places[told])
    values = np.array([fit.value for fit in fits], dtype=complex)
    variances = np.array([fit.variance for fit in fits])
    deviation = np.divide(np.sqrt(0.5 * variances), np.abs(values), out=np.full(places.size, np.inf), where=told)
    return _Told(values, coherence, deviation, leakage)


def _ratio(below: _Told, above: _Told) -> _Told:
    """One response over another to the same signal; their errors add up, for what disturbs one disturbs the other."""
    leakage = below.leakage + above.leakage
    values = np.divide(above.values, below.values, out=np.zeros_like(above.values), where=np.isfinite(leakage))
    return _Told(values, np.minimum(below.coherence, above.coherence), below.deviation + above.deviation, leakage)


def _judged(fits: list[LocalFit]) -> tuple[Floats, NDArray[np.bool_]]:
    """The coherence at each frequency, and at which it and the input suffice."""
    coherence = np.array([fit.explained / (fit.explained + fit.noise) if fit.explained else 0.0 for fit in fits])
    power = np.array([fit.power for fit in fits])
    own = np.array([fit.own > (OWN_OF_FEW if fit.sparse else OWN) for fit in fits])
    return coherence, (power > EXCITED * float(np.max(power, initial=0.0))) & own & (coherence >= TRUSTED)


def looks_held(values: ArrayLike) -> bool:
    """Tell whether an input stays between its samples: it has few values, or most of its samples are those before, with jumps between."""
    u = np.asarray(values, dtype=float)
    extent = float(np.ptp(u))
    if extent == 0.0:
        return False
    rounded = np.round((u - u.min()) / extent, 9)
    moves = np.diff(rounded) != 0.0
    lonely = moves[:-1] & ~moves[1:]
    stands = float(np.mean(moves)) <= 0.5 and np.count_nonzero(lonely) >= 0.8 * np.count_nonzero(moves[:-1])
    return bool(np.unique(rounded).size <= FEW_LEVELS or stands)


def _nothing_told(names: tuple[str, str], coherence: Floats, bias: Floats) -> AnalysisError:
    best = float(np.max(coherence, initial=0.0))
    if bias.size:
        least = float(np.min(bias))
        message = (
            f"at no frequency is the response of {names[1]} to {names[0]} known within {MOST_BIAS:g} of it: the least bound is "
            f"{least:.2g}; log a longer record, or sample faster"
        )
        return AnalysisError(message, bias=least)
    message = (
        f"at no frequency does {names[0]} explain {names[1]}: the largest coherence is {best:.2g}, and {TRUSTED:g} is wanted; log a "
        "longer record in which it moves more"
    )
    return AnalysisError(message, coherence=best)


def _neighbours(place: int) -> int:
    return min(max(place // 3, NEIGHBOURS[0]), NEIGHBOURS[1])


def _candidates(spectrum: Complexes) -> NDArray[np.intp]:
    """Positions of frequencies to look at: in each part of a logarithmic axis the one with most input."""
    top = int(TOP * (spectrum.size - 1))
    edges = np.unique(np.geomspace(FEWEST_PERIODS, top + 1, MOST_POINTS + 1).astype(int))
    return np.array([low + int(np.argmax(np.abs(spectrum[low:high]))) for low, high in itertools.pairwise(edges)])


def _shape(between: Between, turn: Floats) -> Complexes:
    """What the input's course between samples does to it, over the angle in which a frequency turns from sample to sample."""
    part = np.asarray(np.sinc(turn / (2.0 * math.pi)), dtype=complex)
    courses = {Between.HELD: part * np.exp(-0.5j * turn), Between.STRAIGHT: part**2, Between.SMOOTH: np.ones(turn.size)}
    return np.asarray(courses[between], dtype=complex)


def _leakage(fits: list[LocalFit], places: NDArray[np.intp]) -> Floats:
    """What polynomials may be wrong by, relative: twice what two orders more change; where they cannot tell, what one place changes."""
    values = np.array([fit.value for fit in fits])
    change = np.abs(np.diff(values)) / np.diff(places) if values.size > 1 else np.zeros(0)
    steepest = np.maximum(np.append(change, 0.0), np.append(0.0, change))
    found = np.array([2.0 * fit.bias for fit in fits]) + np.where([fit.sparse for fit in fits], steepest, 0.0)
    return np.asarray(found / np.abs(values))


def _aliases(omega: Floats, sizes: Floats, step: float, between: Between) -> Floats:
    """Bound of what lies around the multiples of the sampling frequency, relative to each response, if it falls on as is seen at the end.

    It is taken to fall no steeper than a lag: behind a resonance it falls more steeply at first than it goes on to.
    """
    if between is Between.SMOOTH:
        return np.zeros(omega.size)
    last = omega >= 0.5 * omega[-1]
    slope, top = STEEPEST, float(np.max(sizes[omega >= NEAR_TOP * omega[-1]]))
    if np.count_nonzero(last) >= NEIGHBOURS[0]:
        slope = min(STEEPEST, max(0.0, -float(np.polyfit(np.log(omega[last]), np.log(sizes[last]), 1)[0])))
    multiples = np.concatenate((np.arange(-ALIASES, 0), np.arange(1, ALIASES + 1))) * (2.0 * math.pi / step)
    beyond = np.abs(omega[:, None] + multiples)
    power = 1.0 if between is Between.HELD else 2.0
    sums = np.sum((omega[:, None] / beyond) ** power * (omega[-1] / beyond) ** slope, axis=1)
    return np.asarray(sums * top / sizes)


def _uncertain(turn: Floats, between: Between, known: bool, uneven: float) -> Floats:  # noqa: FBT001 - a fact, not a mode
    """What is not known of the course between samples: of the input's magnitude, and of samples that were interpolated."""
    shape = np.zeros(turn.size) if known else 1.0 / np.abs(_shape(between, turn)) - 1.0
    return shape + (0.25 * turn**2 + uneven * turn if uneven > EVEN else 0.0)


def _columns(times: ArrayLike, signals: Mapping[str, ArrayLike | None]) -> list[Floats]:
    """Those signals that are given, in order, as numbers that can be told anything of."""
    t = np.asarray(times, dtype=float)
    if t.size < FEWEST_SAMPLES:
        message = f"a record of {t.size} samples is too short to tell a frequency response; give {FEWEST_SAMPLES} or more"
        raise InvalidInputError(message, samples=float(t.size))
    given = {name: np.asarray(values, dtype=float) for name, values in signals.items() if values is not None}
    for name, values in (("time", t), *given.items()):
        if t.ndim != 1 or values.shape != t.shape:
            message = f"{name} has shape {values.shape} beside times of shape {t.shape}; give columns of equal length"
            raise InvalidInputError(message, quantity=name)
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            message = f"{name} = {values[row]} in sample {row}; leave out what is not finite, or give one stretch without it"
            raise InvalidInputError(message, quantity=name, sample=row)
        if float(np.ptp(values)) == 0.0:
            message = f"{name} does not move in this record; log one in which it does"
            raise InvalidInputError(message, quantity=name)
    if np.any(np.diff(t) <= 0.0):
        row = int(np.argmax(np.diff(t) <= 0.0))
        message = f"time does not rise after sample {row}, at {t[row]:.6g} s; sort the samples and give each once"
        raise InvalidInputError(message, sample=row)
    return list(given.values())


def _evenly(t: Floats, signals: list[Floats]) -> tuple[Floats, list[Floats], float]:
    """Records on an even clock with as many samples, and how far from it the samples were, in distances of samples."""
    steps = np.diff(t)
    usual, widest = float(np.median(steps)), int(np.argmax(steps))
    if float(steps[widest]) > WIDEST_GAP * usual:
        message = (
            f"the record has a gap of {steps[widest]:.4g} s at {t[widest]:.6g} s, where its samples usually lie {usual:.4g} s apart; what "
            "is not recorded tells no response: give one stretch without gaps"
        )
        raise InvalidInputError(message, gap=float(steps[widest]), at=float(t[widest]))
    clock = np.linspace(t[0], t[-1], t.size)
    uneven = float(np.max(np.abs(t - clock))) / (clock[1] - clock[0])
    if uneven <= EVEN:
        return clock, signals, uneven
    return clock, [np.interp(clock, t, signal) for signal in signals], uneven
