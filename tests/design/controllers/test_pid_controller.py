import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controllers.pid_controller import AntiWindup, Continuous, PidController
from revline.design.controllers.pid_forms import IdealForm, SeriesForm, ideal_of_parallel
from revline.errors import InvalidInputError
from revline.sampled import FixedRate
from tests.design.examples import C2D

positive = st.floats(1e-3, 1e3)
POINTS = (0.3j, 2.0 + 1.0j, 40.0j)


@given(gain=positive, integral_time=positive, share=st.floats(0.0, 0.25))
def test_the_forms_are_the_same_law_there_and_back(gain: float, integral_time: float, share: float) -> None:
    ideal = IdealForm(gain=gain, integral_time=integral_time, derivative_time=share * integral_time)
    kp, ki, kd = ideal.to_parallel()
    series = ideal.to_series()
    for s in POINTS:
        law = kp + ki / s + kd * s
        assert ideal.gain * (1.0 + 1.0 / (ideal.integral_time * s) + ideal.derivative_time * s) == pytest.approx(law, rel=1e-9)
        assert series.gain * (1.0 + 1.0 / (series.integral_time * s)) * (1.0 + series.derivative_time * s) == pytest.approx(law, rel=1e-9)
    back = series.to_ideal()
    assert (back.gain, back.integral_time) == pytest.approx((gain, integral_time), rel=1e-9)
    assert back.derivative_time == pytest.approx(ideal.derivative_time, rel=1e-6, abs=1e-12)
    assert series.to_parallel() == pytest.approx((kp, ki, kd), rel=1e-6, abs=1e-12)
    again = ideal_of_parallel(kp, ki, kd)
    assert (again.gain, again.integral_time, again.derivative_time) == pytest.approx(
        (gain, integral_time, ideal.derivative_time), rel=1e-12, abs=1e-15
    )


def test_no_integral_action_is_an_infinite_time() -> None:
    ideal = ideal_of_parallel(2.0, 0.0, 0.5)
    assert ideal == IdealForm(gain=2.0, integral_time=math.inf, derivative_time=0.25)
    assert ideal.to_series() == SeriesForm(gain=2.0, integral_time=math.inf, derivative_time=0.25)
    assert ideal.to_parallel() == (2.0, 0.0, 0.5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: IdealForm(gain=1.0, integral_time=1.0, derivative_time=0.3).to_series(),
            r"integral time = 1 s is outside 1.2 s \(4 Td\) and",
        ),
        (lambda: IdealForm(gain=0.0, integral_time=1.0), "controller gain = 0 is outside the finite numbers but 0"),
        (lambda: SeriesForm(gain=1.0, integral_time=0.0), "integral time = 0 s is outside the positive numbers"),
        (lambda: SeriesForm(gain=1.0, integral_time=1.0, derivative_time=-1.0), "derivative time = -1 s is outside 0 and above"),
        (lambda: ideal_of_parallel(0.0, 1.0, 0.0), "kp = 0 with ki = 1 and kd = 0 has no ideal form"),
    ],
)
def test_a_form_that_is_none_is_refused(make: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        make()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"setpoint_weight": math.nan}, "set-point weight = nan is outside the finite numbers from 0 on"),
        ({"hold_samples": 2.5}, "hold samples = 2.5 samples is outside the whole numbers from 0 on"),
        ({"filter_time": -0.1}, "filter time = -0.1 s is outside"),
        ({"low": 5.0, "high": 5.0}, "the lower limit of the output, 5 deg, is not below the upper, 5 deg; give low < high"),
        ({"rate_limit": 0.0}, "rate limit = 0 deg/s is outside the positive numbers"),
        ({"safe_output": 90.0, "high": 80.0}, "safe output = 90 deg is outside the output's limits -inf to 80 deg"),
        ({"anti_windup": AntiWindup.BACK_CALCULATION}, "anti-windup back-calculation without a tracking time; back-calculation needs one"),
        ({"tracking_time": 1.0}, "anti-windup clamping with a tracking time"),
        (
            {"anti_windup": AntiWindup.BACK_CALCULATION, "tracking_time": 0.001, "sampling": FixedRate(period=0.01)},
            "tracking time = 0.001 s is outside the sampling period of 0.01 s and above",
        ),
    ],
)
def test_a_value_outside_its_range_is_refused(changes: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        PidController(gains=C2D, **changes)


def test_what_is_more_than_gains_is_told() -> None:
    plain = PidController(gains=C2D, anti_windup=AntiWindup.NONE, low=0.0, high=80.0)
    assert plain.extras == ()
    assert isinstance(plain.sampling, Continuous)
    assert replace(plain, sampling=FixedRate(period=0.01), filter_time=0.02).extras == ("a derivative filter", "sampling")
    assert plain.integral_time == pytest.approx(0.6)
    assert replace(plain, gains=replace(C2D, ki=0.0)).integral_time == math.inf
