"""Polynomials on elements: reading, derivative, and where the equations switch."""

from typing import NamedTuple

import numpy as np
import pytest

from revline.analysis.pieces import DEGREE, Pieces, late_basis, radau
from revline.analysis.switching import switching_values
from revline.equations import equation
from revline.system import DelaySystem, Floats, Variable

Vector = tuple[float, ...]


class Nothing(NamedTuple):
    """No parameters but one."""

    limit: float = 2.0


@equation
def out(p: Nothing, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (np.minimum(x[0], p.limit),)


@equation
def lag(p: Nothing, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0,)


@equation
def rate(p: Nothing, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (np.maximum(np.exp(x[0]) * 2.0, 3.0) + u[0] - zd[0],)


SYSTEM = DelaySystem(
    name="switching",
    parameters=Nothing(),
    states=(Variable(name="level", unit="m"),),
    inputs=(Variable(name="force", unit="N"),),
    channels=(Variable(name="echo", unit="m"),),
    outputs=(Variable(name="seen", unit="m"),),
    emit=out,
    lags=lag,
    rate=rate,
    output=out,
)


def wave(times: Floats) -> Floats:
    return np.asarray(np.sin(2.0 * np.pi * times) + 0.3 * np.cos(6.0 * np.pi * times))


@pytest.mark.parametrize("kinks", [[], [0.3], [0.0, 0.123456, 0.9]])
def test_smooth_functions_are_read_between_the_nodes_and_across_the_end(kinks: list[float]) -> None:
    pieces = Pieces.lay(40, np.array(kinks))
    values, times = wave(pieces.times)[:, None], np.linspace(-1.3, 2.2, 301)
    assert np.max(np.abs(pieces.read(values, times)[:, 0] - wave(times))) < 1e-6
    assert np.array_equal(pieces.reading(times) @ values, pieces.read(values, times)) or np.allclose(
        pieces.reading(times) @ values, pieces.read(values, times), atol=1e-13
    )
    slope = 2.0 * np.pi * (np.cos(2.0 * np.pi * times) - 0.9 * np.sin(6.0 * np.pi * times))
    assert np.max(np.abs(pieces.slope_reading(times) @ values[:, 0] - slope)) < 1e-3
    assert (
        np.max(
            np.abs(
                pieces.derivative @ values[:, 0] - 2.0 * np.pi * (np.cos(2 * np.pi * pieces.times) - 0.9 * np.sin(6 * np.pi * pieces.times))
            )
        )
        < 1e-3
    )


def test_elements_end_at_kinks_and_know_that_they_begin_there() -> None:
    pieces = Pieces.lay(8, np.array([0.3, 0.3 + 1e-12, 0.77]))
    assert np.all(np.isin([0.3, 0.77], pieces.ends))
    assert np.array_equal(pieces.ends[:-1][pieces.fresh], [0.3, 0.77])
    assert np.all(pieces.lengths > 0.0)
    assert Pieces.lay(8, np.array([0.0])).fresh[0]


def test_one_element_wraps_onto_itself() -> None:
    pieces = Pieces.lay(1, np.empty(0))
    assert pieces.count == DEGREE
    assert np.allclose(pieces.reading(np.linspace(0.0, 1.0, 7)).sum(axis=1), 1.0)


def test_the_late_basis_ignores_the_left_end() -> None:
    points = radau()[0]
    values = points**4 - points
    spoilt = values.copy()
    spoilt[0] = 99.0
    assert late_basis() @ spoilt == pytest.approx(values, abs=1e-12)


def test_switches_are_the_differences_of_the_arguments() -> None:
    x = np.array([[0.0], [3.0]])
    found = switching_values(SYSTEM, x, np.zeros((2, 1)), np.zeros((2, 1)))
    assert found == pytest.approx(np.array([[-2.0, -1.0], [1.0, 2.0 * np.exp(3.0) - 3.0]]))
