"""Stability as the cost of a loop sees it, against the roots of characteristic polynomials."""

import numpy as np
import pytest

from revline.design.optimum.loop_cost import Terms, find_cost
from revline.design.optimum.optimum_problem import make_grid
from revline.lti.transfer_function import TransferFunction


@pytest.mark.parametrize("pole", [-1.0, 1.0])
@pytest.mark.parametrize("kp", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("ki", [-0.1, 0.5])
def test_stability_is_that_of_the_roots(pole: float, kp: float, ki: float) -> None:
    grid = make_grid(TransferFunction(numerator=(1.0,), denominator=(-pole, 1.0)), horizon=8.0)
    polynomial = [1.0, kp - pole, ki]
    assert find_cost(grid, Terms(kp, ki, 0.0, 1.0)).stable == bool(np.all(np.roots(polynomial).real < 0.0))
