import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controllers.controller import PidGains
from revline.design.stability.loop_equation import form_loop
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction

G2D = TransferFunction(numerator=(12.0, -0.2), denominator=(1.0, 0.55, 0.034), delay=0.02, input_unit="deg", output_unit="rad/s")


def gains(kp: float, ki: float, kd: float) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="test")


@given(
    kp=st.floats(0.1, 5.0),
    ki=st.one_of(st.just(0.0), st.floats(0.1, 50.0)),
    kd=st.floats(0.0, 0.1),
    delay=st.sampled_from([0.0, 0.02]),
    s=st.complex_numbers(min_magnitude=0.01, max_magnitude=30.0),
)
def test_closed_loop_is_the_textbook_formula(kp: float, ki: float, kd: float, delay: float, s: complex) -> None:
    plant, controller = G2D.with_delay(delay), gains(kp, ki, kd)
    value = complex(plant(s))
    denominator = 1.0 + value * complex(controller.feedback_transfer(s))
    loop = form_loop(plant, controller)
    if abs(denominator) > 1e-3:
        expected = value * complex(controller.setpoint_transfer(s)) / denominator
        assert complex(loop.closed_loop(s)) == pytest.approx(expected, rel=1e-9)


@given(kp=st.floats(0.1, 5.0), ki=st.floats(0.0, 50.0), w=st.floats(0.01, 100.0))
def test_functions_along_the_axis(kp: float, ki: float, w: float) -> None:
    loop = form_loop(G2D, gains(kp, ki, 0.05))
    below = complex(loop.characteristic()(w))
    assert float(loop.characteristic_squared()(w).real) == pytest.approx(abs(below) ** 2, rel=1e-9, abs=1e-9 * w**6)
    above = float(np.polynomial.polynomial.polyval(w, loop.command_squared()))
    assert math.sqrt(above) == pytest.approx(abs(complex(loop.closed_loop(1j * w)) * below), rel=1e-9)


@given(kp=st.floats(0.1, 5.0), ki=st.floats(0.0, 50.0), kd=st.floats(0.0, 0.1), level=st.floats(0.01, 0.9))
def test_beyond_the_frequency_found_the_loop_stays_below_the_level(kp: float, ki: float, kd: float, level: float) -> None:
    loop = form_loop(G2D, gains(kp, ki, kd))
    beyond = loop.frequency_beyond(level) * np.logspace(0.0, 4.0, 400)
    assert np.all(np.abs(loop.closed_loop(1j * beyond)) < level)


def test_static_gain() -> None:
    assert form_loop(G2D, gains(1.0, 2.0, 0.0)).static_gain == 1.0
    assert form_loop(G2D, gains(1.0, 0.0, 0.0)).static_gain == pytest.approx(12.0 / 13.0)


def test_derivative_on_a_lag_of_first_order_leaves_gain_at_high_frequency() -> None:
    lag = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.6), input_unit="deg", output_unit="rad/s")
    assert form_loop(lag, gains(1.0, 1.0, -0.02)).high_frequency_gain == pytest.approx(0.4)
    assert form_loop(G2D, gains(1.0, 1.0, 0.02)).high_frequency_gain == pytest.approx(0.02 * 0.2 / 0.034)
    with pytest.raises(InvalidInputError, match=r"kd = -0.05 deg/\(rad/s\) s cancels the plant's highest derivative"):
        form_loop(lag, gains(1.0, 1.0, -0.05))


def test_what_does_not_fit_is_refused() -> None:
    other = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), input_unit="deg", output_unit="rpm")
    with pytest.raises(InvalidInputError, match="the plant goes from deg to rpm, the controller from rad/s to deg"):
        form_loop(other, gains(1.0, 0.0, 0.0))
    direct = TransferFunction(numerator=(1.0, 1.0), denominator=(1.0, 2.0), input_unit="deg", output_unit="rad/s")
    with pytest.raises(InvalidInputError, match="passes its input straight through"):
        form_loop(direct, gains(1.0, 0.0, 0.0))
