"""Inputs over time as data: steps, ramps, sinusoids, the three test cycles of Lee (1995), recordings, and sums of them.

A signal is a tuple of terms. Each term is a row of numbers that one compiled function evaluates, so that a new signal
needs no new kernel. A term is smooth between its breakpoints; which piece holds is decided by a reference time inside
the piece, so that a value at a jump can be asked for from either side.
"""

import itertools
import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from revline.errors import InvalidInputError, out_of_range

Floats = NDArray[np.float64]

CYCLE_START = 0.1
"""When the test cycles begin, in seconds. Source: Lee (1995), chapter 3."""

PULSE_SHARE = 0.1
"""Part of each period in which the pulse cycle is up. Source: Lee (1995), chapter 3."""

MOST_PERIODS = 1_000_000
"""Periods of a test cycle in one run beyond which it is refused: the list of its edges would fill the memory."""

NEVER = 9
"""Order of a breakpoint that is none."""


class TermKind(IntEnum):
    """How a term's row of numbers is evaluated."""

    RAMP = 1
    SINE = 2
    TRAPEZOIDS = 3
    PULSES = 4
    RECORDED = 5


@dataclass(frozen=True, slots=True)
class Term:
    """One part of a signal: size, start and one or two times or rates, whose meaning its kind gives."""

    kind: TermKind
    size: float
    start: float
    first: float = 0.0
    second: float = 0.0


@dataclass(frozen=True, slots=True)
class Breakpoint:
    """Where a signal is not smooth: order 0 where it jumps, 1 where its slope does."""

    time: float
    order: int


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """An input over time, relative to the value that the input has otherwise; signals add up with `+`.

    Attributes:
        terms: what is summed.
        record: samples of a recorded term, rows of time in seconds and value, shape (n, 2); empty where there is none.
    """

    terms: tuple[Term, ...] = ()
    record: Floats = field(default_factory=lambda: np.empty((0, 2)))

    def __add__(self, other: "Signal") -> "Signal":
        if self.record.size and other.record.size:
            message = "a sum of signals holds at most one recording; add the recordings before reading them"
            raise InvalidInputError(message)
        return Signal(self.terms + other.terms, self.record if self.record.size else other.record)

    def breakpoints(self, start: float, stop: float) -> tuple[Breakpoint, ...]:
        """List where the signal is not smooth, from start to stop (both excluded), in time order, lowest order per time."""
        found: dict[float, int] = {}
        for term in self.terms:
            for time, order in _term_breakpoints(term, stop, self.record):
                if start < time < stop:
                    found[time] = min(order, found.get(time, NEVER))
        return tuple(Breakpoint(time, found[time]) for time in sorted(found))

    def range(self) -> tuple[float, float]:
        """Bounds that the signal never leaves, at no cost; a sum of terms that are not at their largest at once stays well within them."""
        low = high = 0.0
        for term in self.terms:
            if term.kind is TermKind.RECORDED:
                bounds = (float(self.record[:, 1].min()), float(self.record[:, 1].max()))
            elif term.kind in (TermKind.SINE, TermKind.TRAPEZOIDS):
                bounds = (-abs(term.size), abs(term.size))
            else:
                bounds = (min(term.size, 0.0), max(term.size, 0.0))
            low, high = low + bounds[0], high + bounds[1]
        return low, high

    def extremes(self, start: float, stop: float) -> tuple[float, float]:
        """Least and largest value from start to stop, both sides of every jump included; sinusoids count with their whole amplitude."""
        times = [start, *(point.time for point in self.breakpoints(start, stop)), stop]
        rows = self.rows()
        is_sine = rows[:, 0] == TermKind.SINE
        low, high = math.inf, -math.inf
        for left, right in itertools.pairwise(times):
            inside = 0.5 * (left + right)
            swing = float(np.sum(np.abs(rows[is_sine & (rows[:, 2] < inside), 1])))
            for time in (left, right):
                value = sum(evaluate_term(row, self.record, time, inside) for row in rows[~is_sine])
                low, high = min(low, value - swing), max(high, value + swing)
        return low, high

    def __call__(self, time: float) -> float:
        """Value at a time; at a jump that after it."""
        return sum(evaluate_term(row, self.record, time, time) for row in self.rows())

    def rows(self) -> Floats:
        """The terms as rows of numbers, of shape (n_terms, 5)."""
        rows = [(float(t.kind), t.size, t.start, t.first, t.second) for t in self.terms]
        return np.array(rows, dtype=float).reshape(len(rows), 5)

    @property
    def content_digest(self) -> str:
        """Text that stands for the signal's content."""
        return repr((self.terms, self.record.tobytes().hex()))


def step(size: float, *, start: float = 0.0, rise: float = 0.0) -> Signal:
    """Step up or down: instantaneous, or a steep ramp where a rise time is given.

    Args:
        size: height, in the input's unit.
        start: when it begins, in seconds.
        rise: how long it takes, in seconds.

    Raises:
        InvalidInputError: a value is not finite, or the rise is negative.

    Source:
        Lee (1995), chapter 3.
    """
    _finite("step size", size)
    _finite("step start", start)
    if not (math.isfinite(rise) and rise >= 0.0):
        raise out_of_range("step rise", rise, "s", "0 and above", "give how long the rise takes, or leave it out")
    return Signal((Term(TermKind.RAMP, size, start, rise),))


def ramp(rate: float, *, start: float = 0.0, limit: float) -> Signal:
    """Ramp that stops at a limit.

    Args:
        rate: slope, in the input's unit per second; its sign is that of the limit.
        start: when it begins, in seconds.
        limit: height at which it stops.

    Raises:
        InvalidInputError: rate and limit do not point the same way, or a value is not finite.
    """
    _finite("ramp limit", limit)
    _finite("ramp rate", rate)
    if rate * limit <= 0.0:
        message = f"ramp rate = {rate:g} and limit = {limit:g} must both be above or both below 0"
        raise InvalidInputError(message, rate=rate, limit=limit)
    return step(limit, start=start, rise=limit / rate)


def sine(amplitude: float, frequency: float, *, start: float = 0.0, phase: float = 0.0) -> Signal:
    """Sinusoid that begins at a time and is zero before.

    Args:
        amplitude: in the input's unit.
        frequency: in rad/s, above 0.
        start: when it begins, in seconds.
        phase: angle at its start, in radians.

    Raises:
        InvalidInputError: the frequency is not above 0, or a value is not finite.
    """
    for name, value in (("sine amplitude", amplitude), ("sine start", start), ("sine phase", phase)):
        _finite(name, value)
    if not (math.isfinite(frequency) and frequency > 0.0):
        raise out_of_range("sine frequency", frequency, "rad/s", "values above 0", "give the frequency in rad/s")
    return Signal((Term(TermKind.SINE, amplitude, start, frequency, phase),))


def trapezoid_cycle(size: float, duration: float) -> Signal:
    """Test cycle 1: up over d, hold d, down to minus the size over 2 d, hold d, back over d, every 6 d from 0.1 s on.

    Source:
        Lee (1995), chapter 3.
    """
    _finite("cycle size", size)
    return Signal((Term(TermKind.TRAPEZOIDS, size, CYCLE_START, _duration(duration)),))


def sine_cycle(size: float, duration: float) -> Signal:
    """Test cycle 2: a sinusoid of period d from 0.1 s on, phase zero there. Source: Lee (1995), chapter 3."""
    return sine(size, 2.0 * math.pi / _duration(duration), start=CYCLE_START)


def pulse_cycle(size: float, duration: float) -> Signal:
    """Test cycle 3: up in the first tenth of each period d, from 0.1 s on, edges instantaneous. Source: Lee (1995), chapter 3."""
    _finite("cycle size", size)
    return Signal((Term(TermKind.PULSES, size, CYCLE_START, _duration(duration)),))


def recorded(times: Floats, values: Floats) -> Signal:
    """Recording, straight between its samples and held before the first and after the last.

    Args:
        times: shape (n,), rising strictly, in seconds.
        values: shape (n,), in the input's unit.

    Raises:
        InvalidInputError: the shapes differ, there are fewer than two samples, times do not rise, or a number is not finite.
    """
    times, values = np.array(times, dtype=float), np.array(values, dtype=float)
    if times.ndim != 1 or times.shape != values.shape or times.size < 2:
        message = f"a recording needs two or more times and as many values, not shapes {times.shape} and {values.shape}"
        raise InvalidInputError(message)
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        message = "a recording holds numbers that are not finite; remove those samples"
        raise InvalidInputError(message)
    if np.any(np.diff(times) <= 0.0):
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        message = f"recorded times must rise strictly: sample {row} is at {times[row]:g} s after {times[row - 1]:g} s"
        raise InvalidInputError(message, row=row)
    return Signal((Term(TermKind.RECORDED, 1.0, float(times[0]), 0.0, float(times.size)),), np.column_stack([times, values]))


def evaluate_term(row: Floats, record: Floats, time: float, reference: float) -> float:
    """Value of one term at a time, by the piece in which the reference time lies; compiled into the kernels.

    Args:
        row: kind, size, start and two numbers more, as `Signal.rows` gives them.
        record: samples of all recordings, one after the other, as rows of time and value.
        time: in seconds.
        reference: a time inside the smooth piece meant.
    """
    kind, size, start, first, second = row[0], row[1], row[2], row[3], row[4]
    value = 0.0
    if kind == 5.0:
        offset, count = int(first), int(second)
        value = size * read_record(record[offset : offset + count], time, reference)
    elif reference < start:
        value = 0.0
    elif kind == 1.0:
        value = size * (time - start) / first if reference < start + first else size
    elif kind == 2.0:
        value = size * math.sin(first * (time - start) + second)
    elif kind == 3.0:
        value = size * trapezoid((time - start) / first, (reference - start) / first)
    elif (reference - start) / first - math.floor((reference - start) / first) < PULSE_SHARE:
        value = size
    return value


def trapezoid(time: float, reference: float) -> float:
    """Height of the trapezoid cycle, time in units of its ramp: 0 1 1 -1 -1 0 at 0 1 2 4 5 6."""
    turns = 6.0 * math.floor(reference / 6.0)
    phase, piece = time - turns, reference - turns
    if piece < 1.0:
        height = phase
    elif piece < 2.0:
        height = 1.0
    elif piece < 4.0:
        height = 3.0 - phase
    elif piece < 5.0:
        height = -1.0
    else:
        height = phase - 6.0
    return height


def read_record(record: Floats, time: float, reference: float) -> float:
    """Straight line between the samples around the reference time, held outside the record."""
    last = record.shape[0] - 1
    if reference <= record[0, 0]:
        return record[0, 1]
    if reference >= record[last, 0]:
        return record[last, 1]
    left, right = 0, last
    while right - left > 1:
        middle = (left + right) // 2
        if record[middle, 0] <= reference:
            left = middle
        else:
            right = middle
    share = (time - record[left, 0]) / (record[right, 0] - record[left, 0])
    return record[left, 1] + share * (record[right, 1] - record[left, 1])


def _term_breakpoints(term: Term, stop: float, record: Floats) -> list[tuple[float, int]]:
    if term.kind is TermKind.RAMP:
        return [(term.start, 0)] if term.first == 0.0 else [(term.start, 1), (term.start + term.first, 1)]
    if term.kind is TermKind.SINE:
        return [(term.start, 1 if math.sin(term.second) == 0.0 else 0)]
    if term.kind is TermKind.RECORDED:
        return [(float(time), 1) for time in record[:, 0]]
    if term.kind is TermKind.TRAPEZOIDS:
        period, order, shares = 6.0 * term.first, 1, [0.0, 1 / 6, 1 / 3, 2 / 3, 5 / 6]
    else:
        period, order, shares = term.first, 0, [0.0, PULSE_SHARE]
    count = max(0, math.ceil((stop - term.start) / period))
    if count > MOST_PERIODS:
        limit = f"durations whose periods are at most {MOST_PERIODS} until {stop:g} s"
        raise out_of_range("cycle duration", term.first, "s", limit, "give a longer one, or an earlier stop time")
    return [(term.start + (k + share) * period, order) for k in range(count) for share in shares]


def _finite(name: str, value: float) -> None:
    if not math.isfinite(value):
        message = f"{name} = {value} is no finite number; give one"
        raise InvalidInputError(message, quantity=name)


def _duration(duration: float) -> float:
    if not (math.isfinite(duration) and duration > 0.0):
        raise out_of_range("cycle duration", duration, "s", "values above 0", "give the duration in seconds")
    return duration
