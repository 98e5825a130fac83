"""Linear systems with delay channels: exact transfer functions, and what is refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import AnalysisError, InvalidInputError
from revline.lti.state_space import DelayStateSpace, Signal, position

Build = Callable[..., DelayStateSpace]
POINTS = np.array([0.0, 1j, 2.0 - 3j, -0.5 + 10j])


@pytest.fixture(scope="module")
def lagged(build: Build) -> DelayStateSpace:
    """x' = -x + u(t - 0.2); y = 3 x(t - 0.5)."""
    return build([0.2, 0.5], A=-1.0, Bz=[[1.0, 0.0]], Cz=[[0.0], [1.0]], Dzu=[[1.0], [0.0]], Dyz=[[0.0, 3.0]])


def test_delays_at_input_and_output(lagged: DelayStateSpace) -> None:
    exact = 3.0 * np.exp(-0.7 * POINTS) / (POINTS + 1.0)
    assert lagged.transfer(POINTS)[:, 0, 0] == pytest.approx(exact, rel=1e-14)


def test_delay_in_the_loop(build: Build) -> None:
    """x' = -2 x(t - 0.3) + u, y = x + 0.5 u."""
    system = build([0.3], A=0.0, Bu=1.0, Bz=-2.0, Cy=1.0, Dyu=0.5, Cz=1.0)
    exact = 1.0 / (POINTS + 2.0 * np.exp(-0.3 * POINTS)) + 0.5
    assert system.transfer(POINTS)[:, 0, 0] == pytest.approx(exact, rel=1e-14)


def test_delay_after_delay(build: Build) -> None:
    """y(t) = 4 u(t - 0.3): one channel of 0.1 s that another of 0.2 s reads."""
    system = build([0.1, 0.2], Dzu=[[2.0], [0.0]], Dzz=[[0.0, 0.0], [2.0, 0.0]], Dyz=[[0.0, 1.0]])
    assert system.transfer(POINTS)[:, 0, 0] == pytest.approx(4.0 * np.exp(-0.3 * POINTS), rel=1e-14)


def test_loop_of_channels(build: Build) -> None:
    """z = u + z(t - 1)/2 is a geometric series of echoes."""
    system = build([1.0], Dzu=1.0, Dzz=0.5, Dyz=1.0)
    echo = np.exp(-POINTS)
    assert system.transfer(POINTS)[:, 0, 0] == pytest.approx(echo / (1.0 - 0.5 * echo), rel=1e-14)


@given(st.floats(-3.0, 3.0), st.floats(-20.0, 20.0))
def test_transfer_of_conjugate_is_conjugate(real: float, imaginary: float) -> None:
    one = np.ones((1, 1))
    signal = (Signal("a"),)
    blocks = {"A": -one, "Bu": one, "Bz": -2.0 * one, "Cy": one, "Dyu": one, "Dyz": one, "Cz": one, "Dzu": one, "Dzz": 0.1 * one}
    system = DelayStateSpace(**blocks, lags=np.array([0.3]), states=signal, inputs=signal, outputs=signal, channels=signal)
    s = complex(real, imaginary)
    assert system.transfer(s.conjugate())[0, 0] == pytest.approx(system.transfer(s)[0, 0].conjugate(), rel=1e-12)


def test_response_names_its_signals(lagged: DelayStateSpace) -> None:
    response = lagged.response([0.5, 2.0], "u0", "y0")
    assert response.values == pytest.approx(lagged.transfer(np.array([0.5j, 2j]))[:, 0, 0])
    assert (response.input_name, response.input_unit, response.output_name, response.output_unit) == ("u0", "N", "y0", "V")
    assert response.method == "exact"


def test_static_gain(lagged: DelayStateSpace) -> None:
    assert lagged.static_gain("u0", "y0") == pytest.approx(3.0)


def test_integrator_has_no_static_gain(build: Build) -> None:
    system = build([], A=0.0, Bu=1.0, Cy=1.0)
    with pytest.raises(AnalysisError, match="the transfer function has a pole at a point asked for"):
        system.static_gain("u0", "y0")


def test_transfer_keeps_the_shape_of_its_points(lagged: DelayStateSpace) -> None:
    assert lagged.transfer(POINTS.reshape(2, 2)).shape == (2, 2, 1, 1)
    assert lagged.transfer(1j).shape == (1, 1)


def test_blocks_are_copied_and_read_only(build: Build) -> None:
    array = np.array([[-1.0]])
    system = build([], A=array)
    array[0, 0] = 5.0
    assert system.A[0, 0] == -1.0
    with pytest.raises(ValueError, match="read-only"):
        system.A[0, 0] = 1.0


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        ({"A": np.zeros((2, 2))}, r"block A has shape \(2, 2\) where the signals ask for \(1, 1\)"),
        ({"Bz": np.array([[0.0, np.nan]])}, r"block Bz holds nan in row 0, column 1; give finite numbers"),
        ({"lags": np.array([0.2])}, r"1 lags for 2 channels"),
        ({"lags": np.array([0.2, 0.0])}, r"lag of z1 = 0 s is outside 0 to infinity, without the ends; give a positive lag"),
        ({"lags": np.array([np.inf, 0.1])}, r"lag of z0 = inf s is outside"),
        ({"channels": (Signal("z"), Signal("z"))}, r"two channels are named z"),
    ],
)
def test_what_does_not_fit_is_refused(lagged: DelayStateSpace, change: dict[str, object], pattern: str) -> None:
    with pytest.raises(InvalidInputError, match=pattern):
        replace(lagged, **change)  # type: ignore[arg-type]  # the changes differ in their fields


def test_unknown_signal_is_refused(lagged: DelayStateSpace) -> None:
    with pytest.raises(InvalidInputError, match="there is no signal speed; there are u0"):
        lagged.response([1.0], "speed", "y0")
    assert position(lagged.channels, "z1") == 1
