import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.lti.response import FrequencyResponse, count_turns
from revline.values import fingerprint


def response(omega: object = (1.0, 2.0), values: object = (1.0, 1.0j), known_delay: float = 0.0) -> FrequencyResponse:
    return FrequencyResponse(omega=np.array(omega), values=np.array(values), known_delay=known_delay)


def test_magnitude_and_phase_of_known_numbers() -> None:
    found = response(values=(10.0, -1.0j))
    assert found.magnitude.tolist() == [10.0, 1.0]
    assert found.magnitude_db.tolist() == [20.0, 0.0]
    assert found.phase_deg.tolist() == pytest.approx([0.0, -90.0])


@given(st.floats(0.0, 5.0))
@settings(deadline=None, max_examples=40)
def test_phase_is_unwrapped_after_removing_the_known_delay(delay: float) -> None:
    omega = np.array([0.1, 1.0, 10.0, 100.0])
    found = response(omega, np.exp(-1j * omega * delay), delay)
    assert found.phase_deg == pytest.approx(-np.degrees(omega * delay), abs=1e-9)


def test_phase_loses_turns_where_the_delay_is_not_known() -> None:
    """Negative control: on this grid the delay turns the phase by more than half a turn between points."""
    omega = np.array([0.1, 1.0, 10.0, 100.0])
    assert abs(response(omega, np.exp(-1j * omega)).phase_deg[-1] + np.degrees(100.0)) > 300.0


def test_known_turns_are_added_to_the_phases_of_the_values() -> None:
    omega = np.array([1.0, 30.0])
    values, phases = np.exp(-1j * omega), np.degrees(-omega)
    found = FrequencyResponse(omega=omega, values=values, turns=count_turns(values, phases))
    assert found.turns.tolist() == [0, -5]
    assert found.phase_deg == pytest.approx(phases, abs=1e-9)
    with pytest.raises(InvalidInputError, match=r"2 frequencies with turns of shape \(1,\); give one number for each frequency, or none"):
        FrequencyResponse(omega=omega, values=values, turns=np.array([1]))


def test_a_response_cannot_change_and_does_not_lock_what_it_was_made_from() -> None:
    omega, values = np.array([1.0, 2.0]), np.array([1.0 + 0j, 2.0])
    found = FrequencyResponse(omega=omega, values=values)
    omega[0], values[0] = 0.5, 7.0
    assert found.omega[0] == 1.0
    assert found.values[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        found.values[0] = 3.0


def test_fingerprint_follows_the_content() -> None:
    assert fingerprint(response()) == fingerprint(response())
    assert fingerprint(response()) != fingerprint(response(values=(1.0, 1.0000001j)))


@pytest.mark.parametrize(
    ("omega", "values", "delay", "message"),
    [
        ((), (), 0.0, "at least one frequency"),
        ((1.0, 2.0), (1.0,), 0.0, "one complex value for each frequency"),
        ((1.0, -2.0), (1.0, 1.0), 0.0, r"frequency = -2 rad/s is outside 0 to infinity"),
        ((1.0, np.nan), (1.0, 1.0), 0.0, "frequency = nan rad/s"),
        ((1.0, 1.0), (1.0, 1.0), 0.0, "1 rad/s follows 1 rad/s; sort"),
        ((2.0, 1.0), (1.0, 1.0), 0.0, "1 rad/s follows 2 rad/s; sort"),
        ((1.0, 2.0), (1.0, np.inf), 0.0, "response at 2 rad/s is not finite"),
        ((1.0, 2.0), (1.0, 1.0), -0.1, r"delay = -0.1 s is outside"),
        ((1.0, 2.0), (1.0, 1.0), np.nan, r"delay = nan s is outside"),
    ],
)
def test_a_response_that_makes_no_sense_is_refused(omega: object, values: object, delay: float, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        response(omega, values, delay)


def test_zero_has_no_decibels() -> None:
    with pytest.raises(InvalidInputError, match="magnitude at 2 rad/s is 0 and has no decibels"):
        _ = response(values=(1.0, 0.0)).magnitude_db
