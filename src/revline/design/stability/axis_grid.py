"""Grids of frequencies on which functions are followed: so fine that nothing is lost between neighbours, and what is read from them.

Crossings are then found by root finding and peaks by minimisation, never read from the grid.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.stability.bracket_search import Ends, find_lowest, find_roots
from revline.errors import NotConvergedError
from revline.units import Seconds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Values = NDArray[Any]

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

MOST_PEAKS = 8
"""So many of the largest points of a grid are improved, each between its neighbours."""


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
    return roots_of_each(lambda w: w, (function,), grid, (values,))[0]


def roots_of_each(
    evaluate: Callable[[Floats], Values], functions: Sequence[Callable[[Values], Floats]], grid: Floats, values: Sequence[Floats]
) -> tuple[Floats, ...]:
    """Find the roots of some real functions of one that is dear to evaluate, as `roots_between` does, all in the same rounds.

    Args:
        evaluate: frequencies of shape (n,) to what the functions are of, shape (n,).
        functions: each of size 1 near its roots.
        grid: frequencies above 0, rising, between whose neighbours each function has at most one peak.
        values: the functions there.
    """
    filled = _with_passing_peaks(evaluate, functions, grid, values)
    changes = [np.flatnonzero((sizes[1:] > 0.0) != (sizes[:-1] > 0.0)) for _, sizes in filled]
    which = np.repeat(np.arange(len(changes)), [at.size for at in changes])
    if not which.size:
        return tuple(np.array([]) for _ in functions)
    ends = (
        np.concatenate([entry[what][at + after] for entry, at in zip(filled, changes, strict=True)]) for what in (0, 1) for after in (0, 1)
    )
    found = find_roots(lambda w, k: _chosen(functions, which[k], evaluate(w)), Ends(*ends))
    return tuple(found[which == k] for k in range(len(functions)))


def _chosen(functions: Sequence[Callable[[Values], Floats]], which: NDArray[np.intp], values: Values) -> Floats:
    """Of each value the function that is asked for there."""
    chosen = np.empty(which.shape)
    for k, function in enumerate(functions):
        here = which == k
        if here.any():
            chosen[here] = function(values[here])
    return chosen


def _about(at: NDArray[np.intp], which: NDArray[np.intp], values: Sequence[Floats], sign: Floats) -> tuple[Floats, Floats, Floats]:
    """Values of functions at points of the grid and at their neighbours, each with its sign."""
    stacked = np.stack(values)
    return sign * stacked[which, at - 1], sign * stacked[which, at], sign * stacked[which, at + 1]


def _with_passing_peaks(
    evaluate: Callable[[Floats], Values], functions: Sequence[Callable[[Values], Floats]], grid: Floats, values: Sequence[Floats]
) -> list[tuple[Floats, Floats]]:
    """Grid and values of each function with the peaks towards 0 that pass it although no point of the grid does."""
    sides = [np.where(sizes > 0.0, 1.0, -1.0) for sizes in values]
    tops = []
    for side, value in zip(sides, values, strict=True):
        sizes = side * value
        alike = (side[:-2] == side[1:-1]) & (side[2:] == side[1:-1])
        tops.append(np.flatnonzero(alike & (sizes[1:-1] < sizes[:-2]) & (sizes[1:-1] <= sizes[2:])) + 1)
    at = np.concatenate(tops)
    if not at.size:
        return [(grid, sizes) for sizes in values]
    which = np.repeat(np.arange(len(tops)), [one.size for one in tops])
    towards = np.concatenate([side[one] for side, one in zip(sides, tops, strict=True)])
    logarithm = np.log(grid)
    brackets = (logarithm[at - 1], logarithm[at], logarithm[at + 1])
    heights = _about(at, which, values, towards)
    result = find_lowest(lambda x, k: towards[k] * _chosen(functions, which[k], evaluate(np.exp(x))), brackets, heights)
    filled = []
    for k, sizes in enumerate(values):
        passed = (result.values < -ROUNDING) & (which == k)
        peaks = np.exp(result.places[passed])
        places = np.searchsorted(grid, peaks)
        filled.append((np.insert(grid, places, peaks), np.insert(sizes, places, towards[passed] * result.values[passed])))
    return filled


def highest(function: Callable[[Floats], Floats], grid: Floats, sizes: Floats) -> tuple[float, float]:
    """Find the largest value of a real function over a grid, improved between the neighbours of its largest points.

    Args:
        function: frequencies of shape (n,) to values of shape (n,).
        grid: frequencies above 0, rising, between whose neighbours the function has at most one peak.
        sizes: the function on the grid.

    Returns:
        The value and its frequency.
    """
    return highest_of_each(lambda w: w, (function,), grid, (sizes,))[0]


def highest_of_each(
    evaluate: Callable[[Floats], Values], functions: Sequence[Callable[[Values], Floats]], grid: Floats, sizes: Sequence[Floats]
) -> tuple[tuple[float, float], ...]:
    """Find the largest values of some real functions of one that is dear to evaluate, as `highest` does, all in the same rounds.

    Args:
        evaluate: frequencies of shape (n,) to what the functions are of, shape (n,).
        functions: each of them.
        grid: frequencies above 0, rising, between whose neighbours each function has at most one peak.
        sizes: the functions on the grid.

    Returns:
        Each value and its frequency.
    """
    best = [int(np.argmax(one)) for one in sizes]
    found = [(float(one[top]), float(grid[top])) for one, top in zip(sizes, best, strict=True)]
    tops = []
    for one in sizes:
        inner = np.flatnonzero((one[1:-1] >= one[:-2]) & (one[1:-1] >= one[2:])) + 1
        tops.append(inner[np.argsort(-one[inner])][:MOST_PEAKS])
    at = np.concatenate(tops)
    if not at.size:
        return tuple(found)
    which = np.repeat(np.arange(len(tops)), [one.size for one in tops])
    logarithm = np.log(grid)
    brackets = (logarithm[at - 1], logarithm[at], logarithm[at + 1])
    heights = _about(at, which, sizes, np.full(at.size, -1.0))
    result = find_lowest(lambda x, k: -_chosen(functions, which[k], evaluate(np.exp(x))), brackets, heights)
    for k in range(len(found)):
        mine = np.flatnonzero(which == k)
        if mine.size:
            top = mine[int(np.argmin(result.values[mine]))]
            if -float(result.values[top]) > found[k][0]:
                found[k] = (-float(result.values[top]), math.exp(float(result.places[top])))
    return tuple(found)
