import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.analysis.linearize import linearize
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_system import pid_system
from revline.errors import InvalidInputError
from revline.system import DelaySystem


def gains(kp: float, ki: float, kd: float, unit: str = "rad/s") -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit=unit, output_unit="deg", rule="by hand", designed_on="test")


@dataclass(frozen=True)
class Rest:
    states: np.ndarray
    inputs: np.ndarray
    channels: np.ndarray


number = st.floats(-1e3, 1e3)


@given(kp=number, ki=number, kd=number, e=number, integral=number, slope=number, bias=st.floats(-10.0, 20.0))
def test_terms_add_up_to_the_wanted_output_which_is_limited(
    kp: float, ki: float, kd: float, e: float, integral: float, slope: float, bias: float
) -> None:
    controller = pid_system(gains(kp, ki, kd), bias=bias, low=-10.0, high=20.0)
    control, wanted, *terms = controller.output(controller.parameters, (integral,), (e + 7.0, 7.0, slope), ())
    error = (e + 7.0) - 7.0
    assert terms == [kp * error, ki * integral, -kd * slope]
    assert wanted == pytest.approx(bias + sum(terms), rel=1e-12, abs=1e-9)
    assert control == min(max(wanted, -10.0), 20.0)
    assert controller.rate(controller.parameters, (integral,), (e + 7.0, 7.0, slope), ()) == (error,)


def test_its_frequency_response_is_that_of_the_gains() -> None:
    """From command kp + ki/s; from the measurement its negative, the derivative through the rate's own input."""
    law = gains(1.2, 2.0, 0.1)
    controller = pid_system(law, bias=25.0, low=0.0, high=79.46)
    trim = Rest(np.zeros(1), np.array([3.0, 3.0, 0.0]), np.zeros(0))
    s = 1j * np.geomspace(0.01, 100.0, 30)
    response = linearize(controller, trim).model.transfer(s)[:, 0, :]
    np.testing.assert_allclose(response[:, 0], law.setpoint_transfer(s), rtol=1e-13)
    np.testing.assert_allclose(response[:, 1], -law.setpoint_transfer(s), rtol=1e-13)
    np.testing.assert_allclose(response[:, 2], -0.1, rtol=1e-13)


@pytest.mark.parametrize(("unit", "rate", "integral"), [("rad/s", "rad/s2", "rad"), ("kPa", "kPa/s", "kPa s"), ("m/s", "m/s2", "m")])
def test_units_follow_those_of_the_gains(unit: str, rate: str, integral: str) -> None:
    controller: DelaySystem = pid_system(gains(1.0, 1.0, 1.0, unit), bias=0.0)
    assert [v.unit for v in controller.inputs] == [unit, unit, rate]
    assert controller.states[0].unit == integral
    assert {v.unit for v in controller.outputs} == {"deg"}


@pytest.mark.parametrize(("bias", "low", "high"), [(-1.0, 0.0, 80.0), (81.0, 0.0, 80.0), (1.0, 2.0, 0.0), (math.nan, 0.0, 1.0)])
def test_limits_that_exclude_the_trim_are_refused(bias: float, low: float, high: float) -> None:
    with pytest.raises(InvalidInputError, match=rf"the output at the trim, {bias:g} deg, lies outside the limits {low:g} to {high:g} deg"):
        pid_system(gains(1.0, 1.0, 1.0), bias=bias, low=low, high=high)


def test_an_infinite_trim_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"the output at the trim, inf deg, lies outside the limits -inf to inf deg"):
        pid_system(gains(1.0, 1.0, 1.0), bias=math.inf)
