"""Grids of frequencies on which functions are followed: so fine that nothing is lost between neighbours, and what is read from them.

Crossings are then found by root finding and peaks by minimisation, never read from the grid.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_minimum, find_root

from revline.errors import NotConvergedError
from revline.units import Seconds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PHASE_STEP = 0.2
"""Largest change of a function's phase between neighbours on the grid, in rad."""

SIZE_STEP = 0.2
"""Largest change of the logarithm of a function's magnitude between neighbours."""

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
    while True:
        bad = np.any(~np.isfinite(values) | (values == 0.0), axis=0)
        if np.any(bad):
            place = float(grid[bad][0])
            message = f"{name} has a pole or a zero on the imaginary axis at {place:g} rad/s: no margins there"
            raise NotConvergedError(message, frequency=place)
        ratio = values[:, 1:] / values[:, :-1]
        coarse = np.any((np.abs(np.angle(ratio)) > PHASE_STEP) | (np.abs(np.log(np.abs(ratio))) > SIZE_STEP), axis=0)
        coarse |= delay * np.diff(grid) > PHASE_STEP
        if not np.any(coarse):
            return Followed(grid, values)
        if grid.size > MOST_POINTS or np.min(np.diff(grid)[coarse] / grid[1:][coarse]) < 1e-13:
            where = float(grid[1:][coarse][0])
            message = f"{name} turns too fast near {where:g} rad/s to be followed with {MOST_POINTS} frequencies"
            raise NotConvergedError(message, frequency=where)
        middle = np.sqrt(grid[:-1][coarse] * grid[1:][coarse])
        places = np.flatnonzero(coarse) + 1
        grid = np.insert(grid, places, middle)
        values = np.insert(values, places, evaluate(middle), axis=1)


def roots_between(function: Callable[[Floats], Floats], grid: Floats, values: Floats) -> Floats:
    """Find the roots of a real function over a grid, all at once: also the two of a peak that only just passes 0 between neighbours.

    Args:
        function: frequencies of shape (n,) to values of shape (n,), of size 1 near its roots.
        grid: frequencies above 0, rising, between whose neighbours the function has at most one peak.
        values: the function there.
    """
    grid, values = _with_passing_peaks(function, grid, values)
    changes = np.flatnonzero((values[1:] > 0.0) != (values[:-1] > 0.0))
    if not changes.size:
        return np.array([])
    return np.asarray(find_root(function, (grid[changes], grid[changes + 1])).x)


def _with_passing_peaks(function: Callable[[Floats], Floats], grid: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Add the peaks towards 0 that pass it although no point of the grid does."""
    sides = np.where(values > 0.0, 1.0, -1.0)
    sizes = sides * values
    alike = (sides[:-2] == sides[1:-1]) & (sides[2:] == sides[1:-1])
    at = np.flatnonzero(alike & (sizes[1:-1] < sizes[:-2]) & (sizes[1:-1] <= sizes[2:])) + 1
    if not at.size:
        return grid, values
    logarithm = np.log(grid)
    brackets = (logarithm[at - 1], logarithm[at], logarithm[at + 1])
    result = find_minimum(lambda x, side: side * function(np.exp(x)), brackets, args=(sides[at],))
    passed = result.f_x < -ROUNDING
    peaks = np.exp(result.x[passed])
    places = np.searchsorted(grid, peaks)
    return np.insert(grid, places, peaks), np.insert(values, places, sides[at][passed] * result.f_x[passed])


def highest(function: Callable[[Floats], Floats], grid: Floats, sizes: Floats) -> tuple[float, float]:
    """Find the largest value of a real function over a grid, improved between the neighbours of its largest points.

    Args:
        function: frequencies of shape (n,) to values of shape (n,).
        grid: frequencies above 0, rising, between whose neighbours the function has at most one peak.
        sizes: the function on the grid.

    Returns:
        The value and its frequency.
    """
    inner = np.flatnonzero((sizes[1:-1] >= sizes[:-2]) & (sizes[1:-1] >= sizes[2:])) + 1
    best = int(np.argmax(sizes))
    found = (float(sizes[best]), float(grid[best]))
    if not inner.size:
        return found
    tops = inner[np.argsort(-sizes[inner])][:MOST_PEAKS]
    logarithm = np.log(grid)
    result = find_minimum(lambda x: -function(np.exp(x)), (logarithm[tops - 1], logarithm[tops], logarithm[tops + 1]))
    top = int(np.argmin(result.f_x))
    if -float(result.f_x[top]) > found[0]:
        found = (-float(result.f_x[top]), math.exp(float(result.x[top])))
    return found
