import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.engine import torque
from revline.engine.lee1995 import LEE_1995

MIXTURE, SPARK, DELAYS = LEE_1995.mixture, LEE_1995.spark, LEE_1995.delays
BURNING = 90.0 / 7.3834
"""How far the air/fuel ratio may be from that of best torque."""


def test_mixture_influence_by_hand() -> None:
    """Full at 13.5; at 15 the cosine of 1.5 * 7.3834 = 11.0751 degrees."""
    assert torque.mixture_influence(MIXTURE, 13.5) == 1.0
    assert torque.mixture_influence(MIXTURE, 15.0) == pytest.approx(math.cos(math.radians(11.0751)), rel=1e-14)
    assert torque.mixture_influence(MIXTURE, 15.0) == pytest.approx(0.98138, abs=5e-6)


@pytest.mark.parametrize("away", [1.0 + 1e-9, 1.5, 2.0, 3.0, 4.0, 7.0, 10.0])
def test_a_mixture_too_rich_or_too_lean_gives_nothing(away: float) -> None:
    """At four times the limit the bare cosine would be 1 again."""
    assert torque.mixture_influence(MIXTURE, 13.5 + away * BURNING) == 0.0
    assert torque.mixture_influence(MIXTURE, 13.5 - away * BURNING) == 0.0


@given(st.floats(min_value=0.0, max_value=100.0), st.floats(min_value=0.0, max_value=100.0))
def test_mixture_influence_falls_with_the_distance_from_the_best(near: float, far: float) -> None:
    near, far = sorted((near, far))
    for side in (-1.0, 1.0):
        assert torque.mixture_influence(MIXTURE, 13.5 + side * far) <= torque.mixture_influence(MIXTURE, 13.5 + side * near) + 1e-15


def test_spark_influence_by_hand() -> None:
    """Full at the spark of best torque; cos(10 deg)^2.875 = exp(2.875 ln 0.98480775) at 10 degrees, none at 90."""
    assert torque.spark_influence(SPARK, 0.0) == 1.0
    assert torque.spark_influence(SPARK, 10.0) == pytest.approx(math.exp(2.875 * math.log(0.984807753012208)), rel=1e-13)
    assert torque.spark_influence(SPARK, 60.0) == pytest.approx(0.5**2.875, rel=1e-13)
    assert torque.spark_influence(SPARK, 90.0) == pytest.approx(0.0, abs=1e-40)
    assert torque.spark_influence(SPARK, -90.0) == pytest.approx(0.0, abs=1e-40)


@given(st.floats(min_value=0.0, max_value=90.0))
def test_spark_influence_is_even(advance: float) -> None:
    assert torque.spark_influence(SPARK, advance) == torque.spark_influence(SPARK, -advance)


def test_lags_by_hand() -> None:
    """At 240.799 rad/s 22.76 ms from intake and 5.40 ms from spark. Source: Lee (1995), eqs. 2.13 and 2.14."""
    assert torque.crank_lag(DELAYS.intake_to_torque, 240.799) == pytest.approx(0.0227576, rel=1e-5)
    assert torque.crank_lag(DELAYS.spark_to_torque, 240.799) == pytest.approx(0.00539869, rel=1e-5)


def test_torques_by_hand() -> None:
    assert torque.indicated_torque(LEE_1995.combustion, 1e-4, 0.5) == pytest.approx(24.9318, rel=1e-14)
    assert torque.friction_torque(LEE_1995.friction, 0.0) == 15.1
    assert torque.friction_torque(LEE_1995.friction, 100.0) == pytest.approx(25.66, rel=1e-15)
    assert torque.acceleration(LEE_1995.rotation, 14.54) == pytest.approx(100.0, rel=1e-14)


@given(st.floats(min_value=1.5, max_value=25.5), st.floats(min_value=-89.0, max_value=89.0), st.floats(min_value=10.0, max_value=1500.0))
def test_complex_step_gives_the_derivatives(derivatives_agree: Callable[..., None], ratio: float, advance: float, speed: float) -> None:
    derivatives_agree(torque.mixture_influence, MIXTURE, (ratio,), 1.0)
    derivatives_agree(torque.spark_influence, SPARK, (advance,), 1.0)
    derivatives_agree(torque.crank_lag, DELAYS.intake_to_torque, (speed,), 0.01)
    derivatives_agree(torque.indicated_torque, LEE_1995.combustion, (1e-4, 0.5), 50.0)
    derivatives_agree(torque.friction_torque, LEE_1995.friction, (speed,), 20.0)
    derivatives_agree(torque.acceleration, LEE_1995.rotation, (ratio,), 10.0)
