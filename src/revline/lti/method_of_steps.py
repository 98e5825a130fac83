"""Linear delay systems in time, piece by piece: on each piece the delayed readings are known, and the rest is an ordinary equation.

Pieces end at every breakpoint and are no longer than the shortest lag, so that what a channel gives lies wholly in earlier pieces. On each,
states, channels and outputs are polynomials through Chebyshev points; states meet their equation at all of them but the first.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapter 3; collocation at Chebyshev points as in
Trefethen (2000), Spectral Methods in MATLAB, chapters 6 and 11.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from revline.errors import InvalidInputError, NotConvergedError
from revline.lti.breakpoints import SAME_TIME, Breakpoints
from revline.lti.response import Floats
from revline.lti.roots import differentiation_matrix
from revline.lti.state_space import DelayStateSpace

MOST_PIECES = 100_000
"""A record that needs more pieces is refused; so many take a minute."""

MOST_HALVINGS = 40

ROUNDING = 1e-10
"""Last coefficients below this that do not fall as a piece is halved are rounding: signals may cancel."""

VANISHING = 1e-280
"""Signals below this are taken for zero: their last digits are lost to the end of the number range."""

KEPT_FACTORS = 64
"""Factorised equations that are kept, by the length of their piece."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scheme:
    """How a record is cut into pieces.

    Attributes:
        degree: of the polynomials.
        tail: a piece is halved where the last coefficients of its polynomials are larger, relative to the largest value so far.
        longest: longest piece, in s.
    """

    degree: int
    tail: float = math.inf
    longest: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """What moves a system at rest from time 0 on.

    Attributes:
        start: states just after time 0.
        constant: what the inputs are from then on.
    """

    start: Floats
    constant: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record:
    """Outputs in pieces.

    Attributes:
        edges: between the pieces, in s, rising from 0.
        outputs: at the Chebyshev points of each piece, early to late; of shape (pieces, points, outputs).
        largest: largest sum of the magnitudes of an output's terms.
    """

    edges: Floats
    outputs: Floats
    largest: Floats

    def at(self, times: Floats) -> Floats:
        """Evaluate the outputs; at an edge that which comes after.

        Args:
            times: in s, within the record.

        Returns:
            Of shape (times, outputs).
        """
        late = times + 2.0 * SAME_TIME * self.edges[-1]
        return _evaluate(self.edges, self.outputs, times, late)


def march(system: DelayStateSpace, drive: Drive, breakpoints: Breakpoints, *, until: float, scheme: Scheme) -> Record:
    """Follow a linear delay system from rest.

    Args:
        system: at rest before time 0.
        drive: what moves it.
        breakpoints: of its answer.
        until: end of the record, in s.
        scheme: how it is cut into pieces.

    Raises:
        InvalidInputError: the record needs too many pieces, or the answer grew beyond the range of numbers.
        NotConvergedError: a piece was halved without end.
    """
    walk = _Walk(system, drive, scheme, until)
    ends = [*breakpoints.times[breakpoints.times < until].tolist(), until]
    for end, kick in zip(ends, [*breakpoints.kicks[: len(ends) - 1], np.zeros(system.lags.size)], strict=True):
        walk.go(end)
        walk.kick(kick)
    return walk.record()


class _Walk:
    """The way so far; lives for one call of `march`."""

    def __init__(self, system: DelayStateSpace, drive: Drive, scheme: Scheme, until: float) -> None:
        self._system, self._scheme, self._until = system, scheme, until
        self._state, self._input = drive.start.copy(), drive.constant
        self._check_pieces(until / float(np.min(system.lags, initial=math.inf)))
        self._limit = min(float(np.min(system.lags, initial=math.inf)), scheme.longest)
        self._edges = [0.0]
        points = scheme.degree + 1
        self._sent = np.zeros((64, points, len(system.channels)))
        self._given = np.zeros((64, points, len(system.outputs)))
        self._seen = np.zeros(len(system.states) + len(system.channels) + len(system.outputs))
        self._largest = np.zeros(len(system.outputs))
        self._next = math.inf
        self._factor = functools.lru_cache(KEPT_FACTORS)(functools.partial(_factorise, system.A, scheme.degree))

    def go(self, end: float) -> None:
        """Walk on to a breakpoint."""
        while self._edges[-1] < end:
            start = self._edges[-1]
            # Pieces of even length: a sliver before the breakpoint would cost as much as any other.
            whole = min(end - start, self._limit, self._next)
            length = (end - start) / math.ceil((end - start) / whole * (1.0 - 1e-12))
            self._step(start, length, last=end)

    def kick(self, readings: Floats) -> None:
        """Let impulses that are read move the states."""
        self._state = self._state + self._system.Bz @ readings

    def record(self) -> Record:
        """Give what was found."""
        return Record(edges=np.array(self._edges), outputs=self._given[: len(self._edges) - 1], largest=self._largest)

    def _step(self, start: float, length: float, *, last: float) -> None:
        before = math.inf
        for _ in range(MOST_HALVINGS):
            end = last if start + length > last - 0.5 * length else start + length
            read = self._readings(start, end)
            states = self._solve(end - start, read)
            sent, given, terms = self._signals(states, read)
            tail, seen = self._tail(np.concatenate((states, sent, given), axis=1))
            if tail <= self._scheme.tail or 0.5 * before < tail <= ROUNDING:
                self._keep(end, states, sent, given)
                self._seen, self._largest = seen, np.maximum(self._largest, terms)
                self._next = 2.0 * length if tail <= 1e-2 * self._scheme.tail else length
                return
            length, before = 0.5 * length, tail
        message = f"the answer near {start:g} s is not smooth on any piece, however short: the system is too fast for the record"
        raise NotConvergedError(message, time=start)

    def _signals(self, states: Floats, read: Floats) -> tuple[Floats, Floats, Floats]:
        s, u = self._system, self._input
        sent = states @ s.Cz.T + s.Dzu @ u + read @ s.Dzz.T
        given = states @ s.Cy.T + s.Dyu @ u + read @ s.Dyz.T
        terms = np.abs(states) @ np.abs(s.Cy).T + np.abs(s.Dyu) @ np.abs(u) + np.abs(read) @ np.abs(s.Dyz).T
        if not (np.all(np.isfinite(sent)) and np.all(np.isfinite(terms)) and np.all(np.isfinite(states))):
            message = f"the response exceeds the range of numbers after {self._edges[-1]:g} s; ask for earlier times"
            raise InvalidInputError(message, time=self._edges[-1])
        return sent, given, np.max(terms, axis=0)

    def _tail(self, values: Floats) -> tuple[float, Floats]:
        """Last coefficients of all signals relative to their largest value so far, and these."""
        seen = np.maximum(self._seen, np.max(np.abs(values), axis=0, initial=0.0))
        last = np.max(np.abs(chebyshev_tail(self._scheme.degree) @ values), axis=0, initial=0.0)
        alive = seen > VANISHING
        return float(np.max(last[alive] / seen[alive], initial=0.0)), seen

    def _readings(self, start: float, end: float) -> Floats:
        """What the channels give at the piece's points: at its ends that which belongs inside."""
        lags, times = self._system.lags, _times(start, end, self._scheme.degree)
        inward = np.clip(0.5 * (start + end) - times, -2.0 * SAME_TIME * self._until, 2.0 * SAME_TIME * self._until)
        read = np.zeros((times.size, lags.size))
        edges = np.array(self._edges)
        for k, lag in enumerate(lags):
            old, located = times - lag, times + inward - lag
            moving = located >= 0.0
            if np.any(moving):
                values = self._sent[: edges.size - 1, :, k : k + 1]
                read[moving, k] = _evaluate(edges, values, old[moving], located[moving])[:, 0]
        return read

    def _solve(self, length: float, read: Floats) -> Floats:
        """States at the piece's points."""
        s, n, degree = self._system, len(self._system.states), self._scheme.degree
        if not n:
            return np.zeros((degree + 1, 0))
        slopes = -differentiation_matrix(degree)
        force = 0.5 * length * (s.Bu @ self._input + read[1:] @ s.Bz.T) - slopes[1:, :1] * self._state
        rest = lu_solve(self._factor(length), force.ravel(), check_finite=False).reshape(degree, n)
        return np.concatenate((self._state[None, :], rest))

    def _keep(self, end: float, states: Floats, sent: Floats, given: Floats) -> None:
        k = len(self._edges) - 1
        self._check_pieces(k)
        if k == len(self._sent):
            self._sent, self._given = (np.concatenate((old, np.zeros_like(old))) for old in (self._sent, self._given))
        self._sent[k], self._given[k] = sent, given
        self._edges.append(end)
        self._state = states[-1].copy() if len(states) else self._state

    def _check_pieces(self, count: float) -> None:
        if count >= MOST_PIECES:
            message = (
                f"a record of {self._until:g} s needs more than {MOST_PIECES} pieces, lags being as short as "
                f"{np.min(self._system.lags, initial=math.inf):g} s; ask for earlier times"
            )
            raise InvalidInputError(message, until=self._until)


def _factorise(A: Floats, degree: int, length: float) -> tuple[Floats, Floats]:
    """Collocation equations for the states at all points but the first, times half the piece's length."""
    inner = -differentiation_matrix(degree)[1:, 1:]
    whole = np.kron(inner, np.eye(len(A))) - np.kron(np.eye(degree), 0.5 * length * A)
    factors: tuple[Floats, Floats] = lu_factor(whole, check_finite=False)
    return factors


def _times(start: float, end: float, degree: int) -> Floats:
    """Chebyshev points of a piece, early to late, its ends exact."""
    points = 0.5 * (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree))
    times: Floats = start + (end - start) * points
    times[-1] = end
    return times


def _evaluate(edges: Floats, values: Floats, times: Floats, located: Floats) -> Floats:
    """Evaluate polynomials in pieces.

    Args:
        edges: of the pieces.
        values: at their Chebyshev points, of shape (pieces, points, signals).
        times: where.
        located: times near these that tell the piece.

    Returns:
        Of shape (times, signals).
    """
    pieces = np.clip(np.searchsorted(edges, located, side="right") - 1, 0, len(values) - 1)
    result = np.empty((times.size, values.shape[2]))
    for piece in np.unique(pieces):
        chosen = pieces == piece
        width = edges[piece + 1] - edges[piece]
        rows = _interpolation_rows(2.0 * (times[chosen] - edges[piece]) / width - 1.0, values.shape[1] - 1)
        result[chosen] = rows @ values[piece]
    return result


def _interpolation_rows(places: Floats, degree: int) -> Floats:
    """Rows that evaluate the polynomial through values at the points -1 to 1. Source: Berrut and Trefethen (2004), SIAM Review 46(3)."""
    k = np.arange(degree + 1)
    gaps = places[:, None] + np.cos(np.pi * k / degree)
    exact = gaps == 0.0
    terms = np.where((k == 0) | (k == degree), 0.5, 1.0) * (-1.0) ** k / np.where(exact, 1.0, gaps)
    rows: Floats = terms / np.sum(terms, axis=1, keepdims=True)
    return np.where(np.any(exact, axis=1, keepdims=True), exact.astype(float), rows)


@functools.cache
def chebyshev_tail(degree: int) -> Floats:
    """Build the rows that give the last two Chebyshev coefficients of the polynomial through values at the points -1 to 1.

    Args:
        degree: of the polynomial.

    Source:
        Trefethen (2000), Spectral Methods in MATLAB, chapter 8.
    """
    k = np.arange(degree + 1)
    ends = np.where((k == 0) | (k == degree), 0.5, 1.0)
    rows = 2.0 / degree * ends * np.cos(np.pi * np.outer((degree - 1, degree), degree - k) / degree) * np.array([[1.0], [0.5]])
    rows.setflags(write=False)
    return rows
