import numpy as np
import pytest

from revline.design.fitting.fit_problem import make_problem
from revline.design.fitting.output_error import minimise
from revline.lti.polynomial import polynomial_roots

OMEGA = np.geomspace(0.1, 50.0, 25)


@pytest.mark.parametrize(("zeros", "poles", "free"), [(0, 1, 0), (1, 2, 1), (2, 3, 1), (0, 0, 1)])
def test_the_jacobian_is_that_of_the_residuals(zeros: int, poles: int, free: int) -> None:
    """Central differences, whose own error is about 1e-9 here."""
    generator = np.random.default_rng(3)
    problem = make_problem(
        OMEGA, np.asarray(np.exp(-0.1j * OMEGA) / (1.0 + 0.3j * OMEGA)), 0.5 + generator.random(OMEGA.size), zeros, poles, free
    )
    x = 0.5 + generator.random(problem.size)
    jacobian = problem.jacobian(x)
    for k in range(problem.size):
        h = np.zeros(problem.size)
        h[k] = 1e-5
        difference = (problem.residuals(x + h) - problem.residuals(x - h)) / 2e-5
        assert jacobian[:, k] == pytest.approx(difference, abs=1e-7 * float(np.abs(difference).max()))


def test_scaled_and_plain_units_describe_one_model() -> None:
    values = np.asarray(7.0 / (1.0 + 0.3j * OMEGA) * np.exp(-0.02j * OMEGA))
    problem = make_problem(OMEGA, values, np.ones(OMEGA.size), 0, 1, 1)
    found = minimise(problem)
    assert (*found.numerator, *found.denominator, found.delay) == pytest.approx((7.0, 1.0, 0.3, 0.02))
    assert problem.model(np.array([7.0, 0.3, 0.02]) / problem.units) * problem.gain == pytest.approx(values)


def test_the_lowest_of_several_minima_is_taken_and_the_starts_that_missed_are_named() -> None:
    """Two poles can meet one of three resonances only; the sum over the frequencies says which is best."""
    omega = np.geomspace(0.1, 50.0, 60)
    s = 1j * omega
    values = np.asarray(sum(1.0 / (1.0 + 0.04 * s / w + s**2 / w**2) for w in (1.0, 5.0, 20.0)))
    found = minimise(make_problem(omega, values, np.ones(omega.size), 0, 2, 0))
    assert found.residual_sum == min(start.residual_sum for start in found.starts)
    assert 2 <= found.starts_agreeing < len(found.starts)
    assert {start.agrees for start in found.starts if start.residual_sum > 1.1 * found.residual_sum} == {False}


def test_a_large_residual_converges_too() -> None:
    """Gauss-Newton alone stops at a gradient of 2e-9 here: the curvature of the residuals counts."""
    omega = np.geomspace(0.1, 50.0, 60)
    s = 1j * omega
    values = np.asarray(sum(a / (1.0 + 0.2 * s / w + s**2 / w**2) for a, w in ((1.0, 1.0), (0.9, 3.0), (1.0, 10.0))))
    assert minimise(make_problem(omega, values, np.ones(omega.size), 1, 2, 0)).gradient < 1e-12


def test_covariance_has_the_order_of_the_parameters() -> None:
    generator = np.random.default_rng(5)
    values = np.asarray(7.0 / (1.0 + 0.3j * OMEGA) + 0.01 * generator.standard_normal(OMEGA.size))
    found = minimise(make_problem(OMEGA, values, np.ones(OMEGA.size), 0, 1, 0))
    assert found.covariance.shape == (2, 2)
    assert found.covariance == pytest.approx(found.covariance.T)
    s = 1j * OMEGA
    bottom = 1.0 + found.denominator[1] * s
    columns = np.stack([1.0 / bottom, -found.numerator[0] * s / bottom**2], axis=1)
    information = (columns.conj().T @ columns).real
    variance = found.residual_sum / (2 * OMEGA.size - 2)
    assert found.covariance == pytest.approx(np.linalg.inv(information) * variance, rel=1e-9)
    assert polynomial_roots(found.denominator).real < 0.0
