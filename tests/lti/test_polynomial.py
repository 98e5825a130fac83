import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.lti.polynomial import newton_form, polynomial_roots, polynomial_values, trim_coefficients

coefficient = st.floats(1e-6, 1e6) | st.floats(-1e6, -1e-6) | st.just(0.0)
nonzero = st.floats(1e-6, 1e6) | st.floats(-1e6, -1e-6)


def residual(coefficients: list[float], root: complex) -> float:
    terms = [abs(c) * abs(root) ** k for k, c in enumerate(coefficients)]
    return abs(complex(polynomial_values(coefficients, root))) / (sum(terms) or 1.0)


@given(st.lists(coefficient, max_size=6), nonzero)
@settings(deadline=None, max_examples=40)
def test_every_root_meets_its_polynomial(lower: list[float], top: float) -> None:
    coefficients = [*lower, top]
    roots = polynomial_roots(coefficients)
    assert roots.size == len(lower)
    assert all(residual(coefficients, root) < 1e-12 for root in roots)
    assert np.all(np.diff(np.abs(roots)) >= 0.0)


@given(st.lists(st.floats(0.001, 1e5), min_size=1, max_size=5, unique=True))
@settings(deadline=None, max_examples=40)
def test_roots_of_a_product_are_found(magnitudes: list[float]) -> None:
    coefficients = np.polynomial.polynomial.polyfromroots(-np.array(magnitudes))
    apart = np.min(np.diff(np.sort(magnitudes)) / np.sort(magnitudes)[1:], initial=1.0)
    found = polynomial_roots(coefficients)
    if apart > 0.3:
        assert found.imag.tolist() == [0.0] * len(magnitudes)
        assert found.real == pytest.approx(-np.sort(magnitudes), rel=1e-9)


def test_complex_roots_come_in_exact_pairs_and_zeros_first() -> None:
    roots = polynomial_roots((0.0, 0.0, 25.0, 6.0, 1.0))
    assert roots.tolist() == pytest.approx([0.0, 0.0, -3.0 - 4.0j, -3.0 + 4.0j], abs=1e-14)
    assert roots[2] == roots[3].conjugate()


def test_a_constant_has_no_root() -> None:
    assert polynomial_roots((3.0,)).size == 0


def test_coefficients_too_far_apart_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="too far apart to find roots"):
        polynomial_roots((1e-250, 1e250, 1e-250))


@given(st.lists(coefficient, min_size=1, max_size=4), st.lists(st.floats(-100.0, -0.01), min_size=4, max_size=5))
@settings(deadline=None, max_examples=40)
def test_newton_form_is_the_same_rational_function(numerator: list[float], poles: list[float]) -> None:
    s = 7.0 + 3.0j
    nodes = np.array(poles, dtype=complex)
    weights = newton_form(numerator, nodes)
    products = np.cumprod(1.0 / (s - nodes))
    expected = complex(polynomial_values(numerator, s)) * products[-1]
    assert abs(weights @ products - expected) < 1e-10 * max(float(np.abs(weights) @ np.abs(products)), 1e-30)


@pytest.mark.parametrize("bad", [(), (1.0, np.nan), (np.inf,)])
def test_unusable_coefficients_are_refused(bad: tuple[float, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"gain coefficients .* not usable"):
        trim_coefficients(bad, "gain")


def test_highest_zeros_are_dropped() -> None:
    assert trim_coefficients([1, 0, 2, 0, 0], "any") == (1.0, 0.0, 2.0)
    assert trim_coefficients([0.0, 0.0], "any") == (0.0,)
