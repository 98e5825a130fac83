"""Grids of frequencies on which functions are followed: so fine that nothing is lost between neighbours, and what is read from them.

Crossings are then found by root finding and peaks by minimisation, never read from the grid.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_minimum, find_root

from revline.errors import NotConvergedError
from revline.units import Seconds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Values = NDArray[Any]
Function = Callable[[Values], Floats]

PHASE_STEP = 0.2
"""Largest change of a function's phase between neighbours on the grid, in rad."""

SIZE_STEP = 0.2
"""Largest change of the logarithm of a function's magnitude between neighbours."""

_SLOPE, _SQUARE = math.tan(PHASE_STEP), math.exp(2.0 * SIZE_STEP)
"""The same, as the tangent of the phase and as the square of the magnitude."""

MOST_POINTS = 400_000
"""Most frequencies on the grid."""

ROUNDING = 1e-12
"""A function of size 1 that passes 0 by no more than this between neighbours has not passed it for certain."""


class Followed(NamedTuple):
    """Frequencies in rad/s, shape (n,), and the values of some functions there, shape (functions, n)."""

    grid: Floats
    values: Complexes


def follow(evaluate: Callable[[Floats], Complexes], grid: Floats, *, delay: Seconds, name: str) -> Followed:
    """Follow functions of frequency: refine a grid until neither phase nor magnitude of any changes much between neighbours.

    Args:
        evaluate: frequencies of shape (n,) to values of shape (functions, n).
        grid: frequencies to begin with, above 0, rising.
        delay: the longest that a function contains for certain; its turning alone is never skipped.
        name: what is followed, for messages, for example "the loop c1 on g2d".

    Raises:
        NotConvergedError: a function turns too fast for the grid, or has a pole or a zero on the imaginary axis within it.
    """
    values = evaluate(grid)
    _refuse_poles(grid, values, name)
    fresh = np.arange(grid.size - 1)  # intervals that were not looked at yet, by their lower ends
    while True:
        coarse = fresh[_is_coarse((grid[fresh], grid[fresh + 1]), (values[:, fresh], values[:, fresh + 1]), delay)]
        if not coarse.size:
            return Followed(grid, values)
        low, high = grid[coarse], grid[coarse + 1]
        if grid.size > MOST_POINTS or np.min((high - low) / high) < 1e-13:
            message = f"{name} turns too fast near {high[0]:g} rad/s to be followed with {MOST_POINTS} frequencies"
            raise NotConvergedError(message, frequency=float(high[0]))
        middle = np.sqrt(low * high)
        added = evaluate(middle)
        _refuse_poles(middle, added, name)
        grid, values = np.insert(grid, coarse + 1, middle), np.insert(values, coarse + 1, added, axis=1)
        at = coarse + np.arange(coarse.size)
        fresh = np.stack((at, at + 1), axis=1).ravel()


def _refuse_poles(grid: Floats, values: Complexes, name: str) -> None:
    bad = np.any(~np.isfinite(values) | (values == 0.0), axis=0)
    if np.any(bad):
        place = float(grid[bad][0])
        message = f"{name} has a pole or a zero on the imaginary axis at {place:g} rad/s: no margins there"
        raise NotConvergedError(message, frequency=place)


def _is_coarse(ends: tuple[Floats, Floats], values: tuple[Complexes, Complexes], delay: Seconds) -> NDArray[np.bool_]:
    """Whether a function changes much between two frequencies, or its delay alone may have turned it by much."""
    ratio = values[1] / values[0]
    square = ratio.real**2 + ratio.imag**2
    alike = (np.abs(ratio.imag) <= _SLOPE * ratio.real) & (square >= 1.0 / _SQUARE) & (square <= _SQUARE)
    return np.asarray(~np.all(alike, axis=0) | (delay * (ends[1] - ends[0]) > PHASE_STEP))


def roots_between(function: Callable[[Floats], Floats], grid: Floats, values: Floats) -> Floats:
    """Find the roots of a real function over a grid, all at once: also the two of a peak that only just passes 0 between neighbours.

    Args:
        function: frequencies of shape (n,) to values of shape (n,), of size 1 near its roots.
        grid: frequencies above 0, rising, between whose neighbours the function has at most one peak.
        values: the function there.
    """
    return find_features((Sought(lambda w: w, (function,), (), grid, (values,)),))[0].roots[0]


def highest(function: Callable[[Floats], Floats], grid: Floats, sizes: Floats) -> tuple[float, float]:
    """Find the largest value of a real function over a grid, improved between the neighbours of each point at which it peaks.

    Args:
        function: frequencies of shape (n,) to values of shape (n,).
        grid: frequencies above 0, rising, between whose neighbours the function has at most one peak.
        sizes: the function on the grid.

    Returns:
        The value and its frequency.
    """
    return find_features((Sought(lambda w: w, (), (function,), grid, (sizes,)),))[0].peaks[0]


class Features(NamedTuple):
    """Roots of each of some functions, in rad/s; and of each of others the largest value and its frequency in rad/s."""

    roots: tuple[Floats, ...]
    peaks: tuple[tuple[float, float], ...]


NO_BRACKET, VALUELESS = -1, -3
"""What scipy's `find_minimum` says of a middle that is not below its neighbours, and of a function that is no finite number."""


class _Extremes(NamedTuple):
    """Points of a grid at which a function, times a sign, is not above its neighbours: which function, where, and the sign."""

    which: NDArray[np.intp]
    at: NDArray[np.intp]
    sign: Floats


class Sought(NamedTuple):
    """Real functions of one that is dear to evaluate, whose roots and peaks are sought.

    Attributes:
        evaluate: frequencies of shape (n,) to what the functions are of, shape (n,).
        crossings: functions whose roots are sought as by `roots_between`.
        measures: functions whose largest values are sought as by `highest`.
        grid: frequencies above 0, rising, between whose neighbours each function has at most one peak.
        values: the crossings there, then the measures.
    """

    evaluate: Callable[[Floats], Values]
    crossings: Sequence[Function]
    measures: Sequence[Function]
    grid: Floats
    values: Sequence[Floats]


def find_features(sought: Sequence[Sought]) -> tuple[Features, ...]:
    """Find roots and peaks of real functions, those of all that are sought in the same rounds.

    Args:
        sought: the functions, in groups of what each is of.

    Raises:
        NotConvergedError: a function has no finite value between frequencies at which it has.
    """
    extremes = [_extremes_of(one) for one in sought]
    filled, peaks = [], []
    for one, found, (places, lowest) in zip(sought, extremes, _lowest(sought, extremes), strict=True):
        reached = found.sign * lowest
        rows = []
        for k in range(len(one.crossings)):
            passed = (lowest < -ROUNDING) & (found.which == k)
            where = np.searchsorted(one.grid, places[passed])
            rows.append((np.insert(one.grid, where, places[passed]), np.insert(one.values[k], where, reached[passed])))
        filled.append(rows)
        peaks.append(tuple(_peak(one, k, places, reached, found.which == k) for k in range(len(one.crossings), len(one.values))))
    return tuple(Features(*both) for both in zip(_roots(sought, filled), peaks, strict=True))


def _peak(one: Sought, k: int, places: Floats, reached: Floats, mine: NDArray[np.bool_]) -> tuple[float, float]:
    """The largest value of a function and its frequency, on the grid or where one was improved."""
    sizes = np.append(one.values[k], reached[mine])
    top = int(np.argmax(sizes))
    return float(sizes[top]), float(np.append(one.grid, places[mine])[top])


def _lowest(sought: Sequence[Sought], extremes: Sequence[_Extremes]) -> list[tuple[Floats, Floats]]:
    """Where functions times their signs are lowest about points of their grids, on the logarithm of the frequency, and their values."""
    cuts = np.cumsum([found.at.size for found in extremes])[:-1]
    which, at, sign = (np.concatenate(parts) for parts in zip(*extremes, strict=True))
    if not at.size:
        return [(np.empty(0), np.empty(0)) for _ in extremes]
    owner = np.repeat(np.arange(len(extremes)), [found.at.size for found in extremes])
    ends = [np.concatenate([np.log(one.grid)[found.at + by] for one, found in zip(sought, extremes, strict=True)]) for by in (-1, 0, 1)]
    values = np.concatenate([np.stack(one.values)[found.which, found.at] for one, found in zip(sought, extremes, strict=True)])
    middle = np.concatenate([one.grid[found.at] for one, found in zip(sought, extremes, strict=True)])
    found = find_minimum(lambda x, side, group, k: side * _chosen(sought, group, k, np.exp(x)), tuple(ends), args=(sign, owner, which))
    if np.any(found.status == VALUELESS):
        place = float(middle[found.status == VALUELESS][0])
        message = f"a loop has no finite value near {place:g} rad/s, between frequencies at which it has: its peak there is not known"
        raise NotConvergedError(message, frequency=place)
    flat = found.status == NO_BRACKET  # equal to rounding, so that the point of the grid is as good as any
    places, lowest = np.where(flat, middle, np.exp(found.x)), np.where(flat, sign * values, found.f_x)
    return list(zip(np.split(places, cuts), np.split(lowest, cuts), strict=True))


def _extremes_of(one: Sought) -> _Extremes:
    """Where a search for roots and peaks begins: where a crossing comes near 0, and where a measure is large."""
    count = len(one.crossings)
    parts = [_towards_zero(k, sizes) if k < count else _largest(k, sizes) for k, sizes in enumerate(one.values)]
    return _Extremes(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _towards_zero(k: int, sizes: Floats) -> _Extremes:
    """Where a function comes nearest to 0 without passing it, as far as the grid shows."""
    side = np.where(sizes > 0.0, 1.0, -1.0)
    alike = (side[:-2] == side[1:-1]) & (side[2:] == side[1:-1])
    sizes = side * sizes
    at = np.flatnonzero(alike & (sizes[1:-1] < sizes[:-2]) & (sizes[1:-1] <= sizes[2:])) + 1
    return _Extremes(np.full(at.size, k), at, side[at])


def _largest(k: int, sizes: Floats) -> _Extremes:
    """Where a function peaks, as far as the grid shows: of peaks of nearly one height the grid does not tell the highest."""
    at = np.flatnonzero((sizes[1:-1] >= sizes[:-2]) & (sizes[1:-1] >= sizes[2:])) + 1
    return _Extremes(np.full(at.size, k), at, np.full(at.size, -1.0))


def _roots(sought: Sequence[Sought], filled: Sequence[Sequence[tuple[Floats, Floats]]]) -> list[tuple[Floats, ...]]:
    """Roots of each function between neighbours of its own grid at which its sign differs."""
    brackets = []
    for group, rows in enumerate(filled):
        for k, (places, sizes) in enumerate(rows):
            at = np.flatnonzero((sizes[1:] > 0.0) != (sizes[:-1] > 0.0))
            brackets.append((places[at], places[at + 1], np.full(at.size, group), np.full(at.size, k)))
    if not any(low.size for low, *_ in brackets):
        return [tuple(np.array([]) for _ in rows) for rows in filled]
    low, high, owner, which = (np.concatenate(column) for column in zip(*brackets, strict=True))
    found = np.asarray(find_root(lambda w, group, k: _chosen(sought, group, k, w), (low, high), args=(owner, which)).x)
    return [tuple(found[(owner == group) & (which == k)] for k in range(len(rows))) for group, rows in enumerate(filled)]


def _chosen(sought: Sequence[Sought], owner: NDArray[np.intp], which: NDArray[np.intp], omega: Floats) -> Floats:
    """At each frequency the function that is asked for there: which one, and of which group."""
    chosen = np.empty(which.shape)
    for group, one in enumerate(sought):
        mine = np.flatnonzero(owner == group)
        if not mine.size:
            continue
        values, asked = one.evaluate(omega[mine]), which[mine]
        for k, function in enumerate((*one.crossings, *one.measures)):
            here = np.flatnonzero(asked == k)
            if here.size:
                chosen[mine[here]] = function(values[here])
    return chosen
