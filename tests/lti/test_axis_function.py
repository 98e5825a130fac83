import cmath
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from revline.errors import NotConvergedError
from revline.lti.axis_function import MOST_INTERVALS, argument_change, make_axis_function, sign_changes

coefficients = st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=5)


@given(plain=coefficients, turning=coefficients, delay=st.floats(0.0, 5.0), w=st.floats(0.0, 20.0))
def test_values_slopes_products_and_sums(plain: list[float], turning: list[float], delay: float, w: float) -> None:
    function = make_axis_function(plain, turning, delay)

    def exact(point: complex) -> complex:
        return complex(np.polyval(plain[::-1], point) + np.polyval(turning[::-1], point) * cmath.exp(-1j * point * delay))

    size = 1.0 + sum(abs(c) * w**k for row in (plain, turning) for k, c in enumerate(row))
    assert abs(complex(function(w)) - exact(w)) <= 1e-13 * size
    around = [w + 1e-4 * cmath.exp(2j * math.pi * k / 8) for k in range(8)]
    slope = sum(exact(point) / (point - w) for point in around) / 8.0
    assert abs(complex(function.derivative()(w)) - slope) <= 1e-6 * size * (1.0 + delay)
    doubled = function.times([1.0, 2.0]).plus(function)
    assert abs(complex(doubled(w)) - (2.0 + 2.0 * w) * exact(w)) <= 1e-12 * size * (1.0 + w)
    bend = complex(function.derivative().derivative()(w))
    assert abs(bend) <= float(np.polynomial.polynomial.polyval(w, function.bend_bound())) * (1.0 + 1e-12)


@pytest.mark.parametrize("roots", [[29.0, 70.0, 70.125, 71.0, 72.0], [11.454199, 34.0, 71.0, 71.12457, 72.160036, 72.419922]])
def test_no_root_is_lost_to_rounding_between_intervals(roots: list[float]) -> None:
    """Terms of 1e9 that cancel down to their rounding over intervals that have to be narrow."""
    function = make_axis_function(np.polynomial.polynomial.polyfromroots(roots), [0.0], 0.0)
    found = sign_changes(function, 100.0)
    assert found.size == len(roots)
    assert np.max(np.min(np.abs(found[:, None] - roots), axis=0)) < 1e-4


@given(roots=st.lists(st.floats(0.01, 90.0), min_size=1, max_size=6, unique=True))
def test_all_roots_of_a_polynomial_are_found(roots: list[float]) -> None:
    kept = [r for k, r in enumerate(sorted(roots)) if k == 0 or r - sorted(roots)[k - 1] > 0.05]
    function = make_axis_function(np.polynomial.polynomial.polyfromroots(kept), [0.0], 0.0)
    told = function.noise(np.array(kept)) / np.abs(function.derivative()(np.array(kept)))  # what rounding leaves of each root's place
    assume(np.all(told < 1e-3))
    found = sign_changes(function, 100.0)
    assert found.size == len(kept)
    assert np.all(np.abs(found - kept) <= told + 1e-12 * np.array(kept))


def test_double_roots_change_no_sign_and_near_ones_do() -> None:
    touching = make_axis_function([9.0, -6.0, 1.0], [0.0], 0.0)
    assert sign_changes(touching, 10.0).size % 2 == 0
    near = make_axis_function([9.0 - 1e-8, -6.0, 1.0], [0.0], 0.0)
    np.testing.assert_allclose(sign_changes(near, 10.0), [3.0 - 1e-4, 3.0 + 1e-4], rtol=1e-9)


def test_all_roots_of_a_cosine_are_found() -> None:
    np.testing.assert_allclose(
        sign_changes(make_axis_function([0.0], [1.0], 3.0), 200.0), (np.arange(191) + 0.5) * math.pi / 3.0, rtol=1e-13
    )


def test_a_root_where_intervals_meet_is_found_once() -> None:
    np.testing.assert_allclose(sign_changes(make_axis_function([-1.0, 0.0, 1.0], [0.0], 0.0), 2.0), [1.0], rtol=1e-14)
    np.testing.assert_allclose(sign_changes(make_axis_function([-1.0, 1.0], [0.0], 0.0), 4.0), [1.0], rtol=1e-14)


def test_the_root_at_zero_is_left_out() -> None:
    np.testing.assert_allclose(sign_changes(make_axis_function([0.0, -2.0, 1.0], [0.0], 0.0), 5.0), [2.0], rtol=1e-14)


@given(
    left=st.lists(st.complex_numbers(min_magnitude=0.3, max_magnitude=20.0), min_size=0, max_size=4),
    delay=st.floats(0.0, 3.0),
)
def test_argument_is_followed_over_all_turns(left: list[complex], delay: float) -> None:
    """A product of (jw - p) and exp(-jw tau) turns by the sum of its factors' turns, each known in closed form."""
    poles = [complex(p.real if abs(p.real) > 0.05 else 0.05, p.imag) for p in left]
    along = np.polynomial.polynomial.polyfromroots(poles).astype(complex) * 1j ** np.arange(len(poles) + 1)
    change = argument_change(make_axis_function([0.0], along, delay), 50.0)
    exact = -50.0 * delay
    for p in poles:
        exact += cmath.phase((50j - p) / -p) if p.imag == 0.0 else _turn(p)
    assert change == pytest.approx(exact, abs=1e-9)


def _turn(pole: complex) -> float:
    """Turn of jw - p from w = 0 to 50: its real part keeps its sign, so atan of imaginary over real is continuous."""
    return math.atan((50.0 - pole.imag) / -pole.real) - math.atan(-pole.imag / -pole.real)


@pytest.mark.parametrize("place", [0.0, 1.0, 7.3])
def test_a_root_on_the_axis_is_refused_with_its_place(place: float) -> None:
    with pytest.raises(NotConvergedError, match=rf"a root lies on the imaginary axis at {place:.1g}") as caught:
        argument_change(make_axis_function([-place, 1.0], [0.0], 0.0), 20.0)
    assert caught.value.details["frequency"] == pytest.approx(place, abs=1e-10)


def test_a_delay_of_too_many_turns_is_refused() -> None:
    with pytest.raises(NotConvergedError, match=rf"intervals up to 1e\+06 rad/s are still undecided \(limit {MOST_INTERVALS}\)"):
        sign_changes(make_axis_function([0.0], [1.0], 100.0), 1e6)
