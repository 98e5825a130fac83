"""Gain limits against closed forms and published numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.gain_limit import GainLimit, NoGainLimit, find_gain_limit
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction

size = st.floats(0.2, 5.0)


@given(gain=size, lag=size, ratio=st.sampled_from([0.0, 0.1]))
def test_three_equal_lags_stand_a_gain_of_eight(gain: float, lag: float, ratio: float) -> None:
    """K/(Ts + 1)^3 is marginal at K kp = 8, oscillating at sqrt(3)/T; a little integral action lowers both."""
    plant = TransferFunction(
        numerator=(gain,), denominator=tuple(np.poly([-1.0 / lag] * 3)[::-1] * lag**3), input_unit="1", output_unit="1"
    )
    found = find_gain_limit(plant, integral_ratio=ratio / lag)
    assert isinstance(found, GainLimit)
    if ratio:
        assert 6.0 < gain * found.kp < 8.0
        assert found.frequency < math.sqrt(3.0) / lag
    else:
        assert gain * found.kp == pytest.approx(8.0, rel=1e-9)
        assert found.frequency == pytest.approx(math.sqrt(3.0) / lag, rel=1e-9)


@given(delay=st.floats(0.01, 2.0))
def test_a_delayed_integrator_stands_half_pi_over_its_delay(delay: float) -> None:
    plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=delay, input_unit="1", output_unit="1")
    found = find_gain_limit(plant)
    assert isinstance(found, GainLimit)
    assert found.kp == pytest.approx(math.pi / 2.0 / delay, rel=1e-9)


def test_two_lags_have_no_limit_and_say_how_far_was_looked() -> None:
    plant = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034), input_unit="deg", output_unit="rad/s")
    found = find_gain_limit(plant, high=500.0)
    assert isinstance(found, NoGainLimit)
    assert found.searched_to == 500.0


@pytest.mark.parametrize(
    ("options", "message"), [({"low": 2.0, "high": 1.0}, "highest frequency"), ({"integral_ratio": -1.0}, "ratio of ki")]
)
def test_questions_without_sense_are_refused(options: dict[str, float], message: str) -> None:
    plant = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), input_unit="1", output_unit="1")
    with pytest.raises(InvalidInputError, match=message):
        find_gain_limit(plant, **options)
