"""Stability as the cost of a loop sees it, against the roots of characteristic polynomials."""

import numpy as np
import pytest

from revline.design.loop_cost import LoopGrid, Terms, find_cost


@pytest.mark.parametrize("pole", [-1.0, 1.0])
@pytest.mark.parametrize("kp", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("ki", [-0.1, 0.0, 0.5])
def test_stability_is_that_of_the_roots(pole: float, kp: float, ki: float) -> None:
    s, omega = 1j * np.linspace(0.0, 200.0, 513), np.geomspace(1e-3, 1e3, 900)
    grid = LoopGrid(
        s=s + 1e-9, plant=1 / (s + 1e-9 - pole), load=1 / (s + 1e-9 - pole), omega=omega, at_peaks=1 / (1j * omega - pole),
        horizon=8.0, filter_time=0.0, unstable_poles=int(pole > 0.0),
    )  # fmt: skip
    polynomial = [1.0, kp - pole, ki] if ki != 0.0 else [1.0, kp - pole]
    assert find_cost(grid, Terms(kp, ki, 0.0, 1.0)).stable == bool(np.all(np.roots(polynomial).real < 0.0))
