"""Roots and lowest points of many functions at once: against closed forms, and against scipy's searches of the same name."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_minimum, find_root

from revline.design.stability.bracket_search import Ends, Floats, find_lowest, find_roots

DRAW = np.random.default_rng(1995)
SHIFTS = DRAW.uniform(-1.0, 1.0, 60)
STEEP = 10.0 ** DRAW.uniform(-2.0, 2.0, 60)


def curve(x: Floats, k: NDArray[np.intp]) -> Floats:
    """Odd and monotone about a shift, some nearly flat there and some nearly a step."""
    return np.asarray(np.tanh(STEEP[k] * (x - SHIFTS[k])) + 0.1 * (x - SHIFTS[k]) ** 3)


def bowl(x: Floats, k: NDArray[np.intp]) -> Floats:
    return np.asarray(np.cosh(STEEP[k] ** 0.5 * (x - SHIFTS[k])) + 0.3 * np.cos(x))


def test_roots_are_found_to_rounding_and_are_those_of_scipy() -> None:
    low, high, which = np.full(60, -2.0), np.full(60, 2.5), np.arange(60)
    found = find_roots(curve, Ends(low, high, curve(low, which), curve(high, which)))
    assert np.max(np.abs(found - SHIFTS)) < 1e-15
    assert np.array_equal(found, find_root(curve, (low, high), args=(which,)).x)


def test_a_root_at_an_end_and_none_at_all() -> None:
    ends = Ends(np.array([0.0, -1.0]), np.array([1.0, 0.0]), np.array([0.0, -1.0]), np.array([1.0, 0.0]))
    assert find_roots(lambda x, _: x, ends).tolist() == [0.0, 0.0]
    assert find_roots(lambda x, _: x, Ends(*(np.zeros(0) for _ in range(4)))).size == 0


def test_a_function_that_only_halving_can_follow() -> None:
    """A step between neighbouring floating-point numbers is bracketed to the last bit."""
    ends = Ends(np.array([-1.0]), np.array([3.0]), np.array([-1.0]), np.array([1.0]))
    assert find_roots(lambda x, _: np.where(x > math.pi / 2.0, 1.0, -1.0), ends)[0] == pytest.approx(math.pi / 2.0, rel=1e-15)


def test_lowest_points_are_those_of_scipy() -> None:
    which = np.arange(60)
    places = np.full(60, -2.0), np.clip(SHIFTS + 0.1, -1.5, 2.0), np.full(60, 2.5)
    left, middle, right = (bowl(one, which) for one in places)
    kept = (middle <= left) & (middle <= right)
    assert np.sum(kept) > 30
    held = which[kept]
    a, b, c = (one[kept] for one in places)
    found = find_lowest(lambda x, k: bowl(x, held[k]), (a, b, c), (bowl(a, held), bowl(b, held), bowl(c, held)))
    known = find_minimum(bowl, (a, b, c), args=(held,))
    assert np.array_equal(found.values, known.f_x)
    assert np.array_equal(found.places, known.x)
    flat = find_lowest(
        lambda x, _: np.abs(x - 0.25), (np.zeros(1), np.full(1, 0.3), np.ones(1)), (np.full(1, 0.25), np.full(1, 0.05), np.full(1, 0.75))
    )
    assert flat.places[0] == pytest.approx(0.25, abs=1e-8)
