"""Transfer functions by elimination are those of the matrix for each number, and where elimination would not do that is used."""

from collections.abc import Callable

import numpy as np
import pytest

from revline.errors import AnalysisError
from revline.lti import transfer_values as module
from revline.lti.state_space import DelayStateSpace
from revline.lti.transfer_values import transfer_values

Build = Callable[..., DelayStateSpace]
POINTS = np.concatenate((1j * np.geomspace(1e-3, 1e4, 60), [0.3 - 2j, -0.5 + 10j]))


def random_system(build: Build, draw: np.random.Generator, n: int, m: int) -> DelayStateSpace:
    """Stable, some of its gains zero, the last channel unmoved."""
    blocks = {
        name: draw.normal(size=shape) * (draw.random(shape) < 0.7) for name, shape in (("Bz", (n, m)), ("Cz", (m, n)), ("Dzu", (m, 1)))
    }
    blocks["Cz"][-1] = blocks["Dzu"][-1] = 0.0
    A = draw.normal(size=(n, n)) - 3.0 * np.eye(n)
    outputs = {"Cy": draw.normal(size=(2, n)), "Dyu": draw.normal(size=(2, 1)), "Dyz": draw.normal(size=(2, m))}
    return build(draw.uniform(0.01, 0.5, m), A=A, Bu=draw.normal(size=(n, 1)), **blocks, **outputs)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 2), (3, 1), (4, 2), (6, 2)])
def test_values_are_those_of_the_matrix(build: Build, n: int, m: int) -> None:
    draw = np.random.default_rng(10 * n + m)
    for _ in range(6):
        system = random_system(build, draw, n, m)
        prepared = transfer_values(system)
        assert bool(prepared.rates) == (n <= module.MOST_STATES)
        exact = np.moveaxis(system.transfer(POINTS)[..., 0], -1, 0)
        assert np.max(np.abs(prepared(POINTS) - exact) / np.max(np.abs(exact), axis=1, keepdims=True)) < 1e-13
        assert prepared(POINTS[:4].reshape(2, 2)).shape == (2, 2, 2)


def test_rows_that_would_grow_are_solved_with_exchange(build: Build) -> None:
    """x1' = 1e-9 x1 - x2, x2' = x1 - x2 + u: at s near 0 the first pivot is nearly nothing."""
    system = build([], A=[[1e-9, -1.0], [1.0, -1.0]], Bu=[[0.0], [1.0]], Cy=[[1.0, 0.0], [0.0, 1.0]])
    s = np.array([1e-12j, 1j])
    assert transfer_values(system)(s) == pytest.approx(np.moveaxis(system.transfer(s)[..., 0], -1, 0), rel=1e-14)
    assert transfer_values(system)._eliminated(s) is None  # noqa: SLF001 - the way is what is tried


def test_channels_that_feed_channels_are_left_to_the_matrix(build: Build) -> None:
    system = build([0.1, 0.2], A=-1.0, Bz=[[0.0, 1.0]], Cy=1.0, Dzu=[[2.0], [0.0]], Dzz=[[0.0, 0.0], [2.0, 0.0]])
    assert transfer_values(system)(POINTS)[0] == pytest.approx(4.0 * np.exp(-0.3 * POINTS) / (POINTS + 1.0), rel=1e-12)


def test_a_pole_is_refused(build: Build) -> None:
    with pytest.raises(AnalysisError, match="the transfer function has a pole at a point asked for"):
        transfer_values(build([], A=0.0, Bu=1.0, Cy=1.0))(0.0)
