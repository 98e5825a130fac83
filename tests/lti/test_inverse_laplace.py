import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.lti.inverse_laplace import inverse_laplace

TIMES = np.linspace(0.0, 4.0, 81)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize("pole", [0.0, -1.0, -30.0])
def test_equal_poles(count: int, pole: float) -> None:
    """1/(s-p)^n is t^(n-1)/(n-1)! exp(p t)."""
    expected = TIMES ** (count - 1) / math.factorial(count - 1) * np.exp(pole * TIMES)
    assert inverse_laplace([1.0], np.full(count, pole, dtype=complex), TIMES) == pytest.approx(expected, abs=1e-13)


@given(st.floats(0.0, 2.0), st.floats(0.5, 40.0))
@settings(deadline=None, max_examples=40)
def test_a_pole_split_from_zero_to_far(apart: float, speed: float) -> None:
    """1/((s+a)(s+b)) is (exp(-at) - exp(-bt)) / (b-a), written without cancellation."""
    middle, half = -(speed + apart / 2.0) * TIMES, apart / 2.0 * TIMES
    ratio = np.divide(np.sinh(half), half, out=np.ones_like(half), where=half > 1e-8)
    poles = np.array([-speed, -speed - apart], dtype=complex)
    assert inverse_laplace([1.0], poles, TIMES) == pytest.approx(TIMES * np.exp(middle) * ratio, abs=1e-14)


@pytest.mark.parametrize("ratio", [10.0, 1e3, 1e6, 1e9])
def test_a_stiff_pair_loses_no_digit(ratio: float) -> None:
    expected = (np.exp(-TIMES) - np.exp(-ratio * TIMES)) / (ratio - 1.0)
    assert inverse_laplace([1.0], np.array([-1.0, -ratio], dtype=complex), TIMES) == pytest.approx(expected, rel=2e-13, abs=1e-300)


def test_a_close_pair_beside_a_fast_pole() -> None:
    """1/((s+1)^2 (s+a)): partial fractions (t/(a-1) - 1/(a-1)^2) exp(-t) + exp(-at)/(a-1)^2."""
    a = 5000.0
    expected = (TIMES / (a - 1.0) - 1.0 / (a - 1.0) ** 2) * np.exp(-TIMES) + np.exp(-a * TIMES) / (a - 1.0) ** 2
    for split in (0.0, 1e-12, 1e-9):
        poles = np.array([-1.0 - split, -1.0 + split, -a], dtype=complex)
        assert a * inverse_laplace([1.0], poles, TIMES) == pytest.approx(a * expected, abs=1e-14)


def test_even_times_are_answered_as_uneven_ones() -> None:
    """Evenly spaced times take a shorter way; the largest difference of 40 random answers is rounding, as is that at any one time."""
    draw = np.random.default_rng(1995)
    for _ in range(40):
        size = 10.0 ** draw.uniform(-1.0, 2.0)
        pair = size * np.exp(1j * draw.uniform(0.5, 1.0) * np.pi)
        poles = np.array([0.0, pair, np.conj(pair), *(-(10.0 ** draw.uniform(-2.0, 3.5, 2)))])
        times = 10.0 ** draw.uniform(-4.0, -2.0) * np.arange(1001)
        numerator = (draw.normal(size=5) * np.cumprod(np.abs(poles) + 0.1)[::-1]).tolist()
        uneven = inverse_laplace(numerator, poles, np.append(times, 0.0))[:-1]
        even = inverse_laplace(numerator, poles, times)
        assert np.max(np.abs(even - uneven)) < 1e-12 * np.max(np.abs(uneven))
        assert inverse_laplace(numerator, poles, times[777:778])[0] == pytest.approx(even[777], rel=1e-9, abs=1e-12 * np.max(np.abs(even)))


def test_a_zero_numerator_and_no_time() -> None:
    assert inverse_laplace([0.0], np.array([-1.0, -1.0], dtype=complex), TIMES).tolist() == [0.0] * TIMES.size
    assert inverse_laplace([1.0], np.array([-1.0], dtype=complex), np.zeros(0)).size == 0


def test_overflow_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="exceeds the range of numbers within 4 s; ask for earlier times"):
        inverse_laplace([1.0], np.array([300.0], dtype=complex), TIMES)


def test_times_that_are_nearly_even_are_not_taken_for_even() -> None:
    times = 0.01 * np.arange(1.0, 101.0)
    times[40] += 1e-4
    assert inverse_laplace([1.0], np.array([-1.0], dtype=complex), times) == pytest.approx(np.exp(-times), abs=1e-14)
