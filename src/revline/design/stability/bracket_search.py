"""Roots and lowest points of many real functions at once, each held between known places and never lost.

Each round evaluates all functions that are not done together; what a round costs beside that is a few operations on arrays.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Function = Callable[[Floats, NDArray[np.intp]], Floats]
"""Places, and which of the functions is asked for at each, to values; all of shape (n,)."""

EPS, TINY = float(np.finfo(float).eps), float(np.finfo(float).tiny)
MOST_ROUNDS = 1100
"""Halving alone ends before: there are no more floating-point numbers between two."""

NEAR = math.sqrt(EPS)
"""A lowest place is known no better than this, relative to its size: there the function is flat to rounding."""

MOST_SECTIONS = 100
GOLDEN = 1.5 - 0.5 * math.sqrt(5.0)


class Ends(NamedTuple):
    """Two places for each function and its values there."""

    low: Floats
    high: Floats
    at_low: Floats
    at_high: Floats


class Lowest(NamedTuple):
    """Where each function is lowest, and its value there."""

    places: Floats
    values: Floats


def find_roots(function: Function, ends: Ends) -> Floats:
    """Find one root of each function to rounding.

    Args:
        function: evaluates any of them.
        ends: between which each changes its sign.

    Source:
        Chandrupatla (1997), Advances in Engineering Software 28(3), 145-149: inverse quadratic interpolation where it is certain to
        help, else halving.
    """
    x1, x2, f1, f2 = (np.array(one, dtype=float) for one in ends)
    active, found = np.arange(x1.size), np.empty(x1.size)
    share = np.full(x1.size, 0.5)
    for _ in range(MOST_ROUNDS):
        best = np.where(np.abs(f1) < np.abs(f2), x1, x2)
        width, room = np.abs(x2 - x1), 4.0 * EPS * np.abs(best) + 4.0 * TINY
        going = (np.minimum(np.abs(f1), np.abs(f2)) > TINY) & (width >= room)
        if not going.all():
            found[active[~going]] = best[~going]
            active, x1, x2, f1, f2, share, width, room = (one[going] for one in (active, x1, x2, f1, f2, share, width, room))
            if not active.size:
                break
        least = 0.5 * room / width
        x = x1 + np.minimum(np.maximum(share, least), 1.0 - least) * (x2 - x1)
        f = function(x, active)
        alike = np.sign(f) == np.sign(f1)
        x3, f3 = np.where(alike, x1, x2), np.where(alike, f1, f2)
        x2, f2 = np.where(alike, x2, x1), np.where(alike, f2, f1)
        x1, f1 = x, f
        share = _share((x1, x2, x3), (f1, f2, f3))
    found[active] = np.where(np.abs(f1) < np.abs(f2), x1, x2)
    return found


def _share(places: tuple[Floats, Floats, Floats], values: tuple[Floats, Floats, Floats]) -> Floats:
    """Where between the ends to look next, as a part of their distance: by inverse quadratic interpolation, or in the middle."""
    (x1, x2, x3), (f1, f2, f3) = places, values
    with np.errstate(divide="ignore", invalid="ignore"):
        place, value = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        certain = (1.0 - np.sqrt(1.0 - place) < value) & (value < np.sqrt(place))
        inverse = f1 / (f1 - f2) * f3 / (f3 - f2) - (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f2 - f3)
    return np.where(certain, inverse, 0.5)


def find_lowest(function: Function, places: tuple[Floats, Floats, Floats], values: tuple[Floats, Floats, Floats]) -> Lowest:
    """Find the lowest place of each function, to the square root of rounding, and its value there, to rounding.

    Args:
        function: evaluates any of them.
        places: three for each function, rising, shape (n,) each.
        values: there; the middle one is not above the others.

    Source:
        Chandrupatla (1998), Computer Methods in Applied Mechanics and Engineering 152(1-2), 211-217: a parabola where two in a row
        agree, else golden sectioning.
    """
    (x1, x2, x3), (f1, f2, f3) = ([np.array(one, dtype=float) for one in given] for given in (places, values))
    active, foreseen = np.arange(x2.size), x3.copy()
    found = Lowest(x2.copy(), f2.copy())
    for _ in range(MOST_SECTIONS):
        swapped = np.abs(x3 - x2) < np.abs(x2 - x1)  # the longer side is that of x3
        x1, x3 = np.where(swapped, x3, x1), np.where(swapped, x1, x3)
        f1, f3 = np.where(swapped, f3, f1), np.where(swapped, f1, f3)
        room = NEAR * np.abs(x2) + TINY
        going = (np.abs(x3 - x2) > 2.0 * room) & (f1 - 2.0 * f2 + f3 > 2.0 * TINY * (1.0 + np.abs(f2)))
        if not going.all():
            found.places[active], found.values[active] = x2, f2
            active, x1, x2, x3, f1, f2, f3, room, foreseen = (one[going] for one in (active, x1, x2, x3, f1, f2, f3, room, foreseen))
            if not active.size:
                break
        x, foreseen = _section((x1, x2, x3), (f1, f2, f3), room, foreseen)
        f = function(x, active)
        lower, beyond = f <= f2, (x > x2) == (x3 > x2)
        end, at_end, first = np.where(lower, x2, x), np.where(lower, f2, f), beyond == lower
        x1, x2, x3 = np.where(first, end, x1), np.where(lower, x, x2), np.where(first, x3, end)
        f1, f2, f3 = np.where(first, at_end, f1), np.where(lower, f, f2), np.where(first, f3, at_end)
    found.places[active], found.values[active] = x2, f2
    return found


def _section(
    places: tuple[Floats, Floats, Floats], values: tuple[Floats, Floats, Floats], room: Floats, foreseen: Floats
) -> tuple[Floats, Floats]:
    """Where to look next, and where the parabola is lowest: there if that was foreseen a round ago, else in the longer side."""
    (x1, x2, x3), (f1, f2, f3) = places, values
    left, right = (x2 - x1) * (f3 - f2), (x3 - x2) * (f1 - f2)
    with np.errstate(divide="ignore", invalid="ignore"):
        lowest = 0.5 * (left / (left + right) * (x1 - x3) + x2 + x3)
    trusted = np.abs(lowest - foreseen) < 0.5 * np.abs(x2 - x1)
    aside = np.where(np.abs(lowest - x2) <= room, x2 + np.sign(x3 - x2) * room, lowest)
    return np.where(trusted, aside, x2 + GOLDEN * (x3 - x2)), lowest
