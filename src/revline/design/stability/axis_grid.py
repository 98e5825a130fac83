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
    return find_features(lambda w: w, (function,), (), grid, (values,)).roots[0]


def highest(function: Callable[[Floats], Floats], grid: Floats, sizes: Floats) -> tuple[float, float]:
    """Find the largest value of a real function over a grid, improved between the neighbours of each point at which it peaks.

    Args:
        function: frequencies of shape (n,) to values of shape (n,).
        grid: frequencies above 0, rising, between whose neighbours the function has at most one peak.
        sizes: the function on the grid.

    Returns:
        The value and its frequency.
    """
    return find_features(lambda w: w, (), (function,), grid, (sizes,)).peaks[0]


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


def find_features(
    evaluate: Callable[[Floats], Values],
    crossings: Sequence[Function],
    measures: Sequence[Function],
    grid: Floats,
    values: Sequence[Floats],
) -> Features:
    """Find roots and peaks of real functions of one that is dear to evaluate, all in the same rounds.

    Args:
        evaluate: frequencies of shape (n,) to what the functions are of, shape (n,).
        crossings: functions whose roots are sought as by `roots_between`.
        measures: functions whose largest values are sought as by `highest`.
        grid: frequencies above 0, rising, between whose neighbours each function has at most one peak.
        values: the crossings there, then the measures.

    Raises:
        NotConvergedError: a function has no finite value between frequencies at which it has.
    """
    functions, count = (*crossings, *measures), len(crossings)
    extremes = [_towards_zero(k, one) if k < count else _largest(k, one) for k, one in enumerate(values)]
    found = _Extremes(*(np.concatenate(parts) for parts in zip(*extremes, strict=True)))
    places, lowest = _lowest(lambda k, w: _chosen(functions, k, evaluate(w)), grid, found, np.stack(values))
    which, sign = found.which, found.sign
    reached = sign * lowest
    filled = []
    for k in range(count):
        passed = (lowest < -ROUNDING) & (which == k)
        where = np.searchsorted(grid, places[passed])
        filled.append((np.insert(grid, where, places[passed]), np.insert(values[k], where, reached[passed])))
    peaks = []
    for k, sizes in enumerate(values[count:], start=count):
        mine = which == k
        all_sizes = np.append(sizes, reached[mine])
        top = int(np.argmax(all_sizes))
        peaks.append((float(all_sizes[top]), float(np.append(grid, places[mine])[top])))
    return Features(_roots(evaluate, crossings, filled), tuple(peaks))


def _lowest(function: Callable[..., Floats], grid: Floats, extremes: _Extremes, values: NDArray[Any]) -> tuple[Floats, Floats]:
    """Where functions times their signs are lowest about points of a grid, on the logarithm of the frequency, and their values there."""
    which, at, sign = extremes
    if not at.size:
        return np.empty(0), np.empty(0)
    x = np.log(grid)
    found = find_minimum(lambda places, side, k: side * function(k, np.exp(places)), (x[at - 1], x[at], x[at + 1]), args=(sign, which))
    if np.any(found.status == VALUELESS):
        place = float(grid[at[found.status == VALUELESS][0]])
        message = f"a loop has no finite value near {place:g} rad/s, between frequencies at which it has: its peak there is not known"
        raise NotConvergedError(message, frequency=place)
    flat = found.status == NO_BRACKET  # equal to rounding, so that the point of the grid is as good as any
    return np.where(flat, grid[at], np.exp(found.x)), np.where(flat, sign * values[which, at], found.f_x)


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


def _roots(
    evaluate: Callable[[Floats], Values], functions: Sequence[Function], filled: Sequence[tuple[Floats, Floats]]
) -> tuple[Floats, ...]:
    """Roots of each function between neighbours of its own grid at which its sign differs."""
    changes = [np.flatnonzero((sizes[1:] > 0.0) != (sizes[:-1] > 0.0)) for _, sizes in filled]
    which = np.repeat(np.arange(len(changes)), [at.size for at in changes])
    if not which.size:
        return tuple(np.array([]) for _ in functions)
    low, high = (np.concatenate([places[at + after] for (places, _), at in zip(filled, changes, strict=True)]) for after in (0, 1))
    found = np.asarray(find_root(lambda w, k: _chosen(functions, k, evaluate(w)), (low, high), args=(which,)).x)
    return tuple(found[which == k] for k in range(len(functions)))


def _chosen(functions: Sequence[Function], which: NDArray[np.intp], values: Values) -> Floats:
    """Of each value the function that is asked for there."""
    chosen = np.empty(which.shape)
    for k, function in enumerate(functions):
        here = np.flatnonzero(which == k)
        if here.size:
            chosen[here] = function(values[here])
    return chosen
