import math
import pickle
from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controllers.controller import PidGains
from revline.errors import InvalidInputError
from revline.values import fingerprint

C2D = PidGains(kp=1.2, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="fine-tuned", designed_on="g2d")

gains = st.floats(-100.0, 100.0)
points = st.complex_numbers(min_magnitude=1e-3, max_magnitude=1e3)


def test_gains_carry_units_and_convention() -> None:
    assert dict(C2D.gain_units) == {"kp": "deg/(rad/s)", "ki": "deg/(rad/s)/s", "kd": "deg/(rad/s) s"}
    assert C2D.derivative_acts_on == "measurement"


@given(kp=gains, ki=gains, kd=gains, s=points)
def test_transfers_are_the_law(kp: float, ki: float, kd: float, s: complex) -> None:
    controller = replace(C2D, kp=kp, ki=ki, kd=kd)
    assert complex(controller.setpoint_transfer(s)) == pytest.approx(kp + ki / s, rel=1e-12, abs=1e-12)
    assert complex(controller.feedback_transfer(s)) == pytest.approx(kp + ki / s + kd * s, rel=1e-12, abs=1e-12)


def test_transfer_keeps_the_shape() -> None:
    s = 1j * np.array([[1.0, 2.0, 4.0]])
    assert C2D.feedback_transfer(s).shape == (1, 3)
    np.testing.assert_allclose(C2D.feedback_transfer(s), 1.2 + 2.0 / s + 0.1 * s, rtol=1e-15)


def test_integral_action_has_no_value_at_zero() -> None:
    with pytest.raises(InvalidInputError, match=r"no value at s = 0 rad/s.*ki = 2"):
        C2D.feedback_transfer([0.0, 1j])
    assert complex(replace(C2D, ki=0.0).setpoint_transfer(0.0)) == 1.2


def test_reduced_gain_is_a_tenth_of_kp_alone() -> None:
    reduced = C2D.scaled(kp=0.1)
    assert (reduced.kp, reduced.ki, reduced.kd) == (0.1 * C2D.kp, C2D.ki, C2D.kd)
    assert reduced.rule == "fine-tuned, kp times 0.1"
    assert reduced.details["kp_factor"] == 0.1
    assert reduced.designed_on == "g2d"


def test_scaling_by_one_changes_nothing() -> None:
    assert C2D.scaled() is C2D


@pytest.mark.parametrize("gain", ["kp", "ki", "kd"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_gain_that_is_not_finite_is_refused(gain: str, value: float) -> None:
    changes: dict[str, Any] = {gain: value}
    with pytest.raises(InvalidInputError, match=rf"{gain} = (nan|inf) deg/\(rad/s\).* is not finite"):
        replace(C2D, **changes)


@pytest.mark.parametrize("field", ["input_unit", "output_unit", "rule", "designed_on"])
def test_an_origin_left_empty_is_refused(field: str) -> None:
    changes: dict[str, Any] = {field: ""}
    with pytest.raises(InvalidInputError, match=f"the controller's {field} is empty"):
        replace(C2D, **changes)


def test_gains_cannot_change() -> None:
    with pytest.raises(FrozenInstanceError):
        C2D.kp = 2.0  # type: ignore[misc] # that it fails is what the test shows
    with pytest.raises(TypeError):
        C2D.details["note"] = 1.0  # type: ignore[index] # that it fails is what the test shows


def test_equal_gains_have_equal_fingerprints() -> None:
    assert fingerprint(C2D) == fingerprint(replace(C2D, kp=1.2))
    assert fingerprint(C2D) != fingerprint(replace(C2D, kp=1.2000001))


def test_gains_go_to_another_process_and_come_back() -> None:
    gains = PidGains(
        kp=1.2, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="test", designed_on="g2d", details={"phase_margin_deg": 60.0}
    )
    back = pickle.loads(pickle.dumps(gains))  # noqa: S301 - what was pickled a moment ago
    assert [getattr(back, entry.name) for entry in fields(back)] == [getattr(gains, entry.name) for entry in fields(gains)]
    with pytest.raises(TypeError, match="does not support item assignment"):
        back.details["phase_margin_deg"] = 0.0
