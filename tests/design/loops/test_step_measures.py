import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.loops.step_measures import measure_overshoot, measure_step
from revline.errors import InvalidInputError, NotSettledError

TIMES = np.linspace(0.0, 20.0, 20001)


def second_order(times: np.ndarray, damping: float, frequency: float) -> np.ndarray:
    """Unit step response of w^2 / (s^2 + 2 zeta w s + w^2), exact."""
    damped = frequency * math.sqrt(1.0 - damping**2)
    decay = np.exp(-damping * frequency * times)
    return 1.0 - decay * (np.cos(damped * times) + damping * frequency / damped * np.sin(damped * times))


@given(damping=st.floats(0.2, 0.8), frequency=st.floats(2.0, 10.0), command=st.sampled_from([60.0, -5.0]), before=st.floats(-10.0, 300.0))
def test_second_order_response_has_its_closed_form_overshoot(damping: float, frequency: float, command: float, before: float) -> None:
    values = before + command * second_order(TIMES, damping, frequency)
    measures = measure_step(TIMES, values, start=0.0, target=before + command, command=command)
    overshoot = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert measures.overshoot == pytest.approx(overshoot, abs=1e-9)
    assert measures.peak == pytest.approx(before + command * (1.0 + overshoot), abs=1e-7)
    assert measures.peak_time == pytest.approx(math.pi / (frequency * math.sqrt(1.0 - damping**2)), abs=1e-5)
    assert abs(measures.steady_error) <= 2.0 * abs(command) * math.exp(-18.0 * damping * frequency) + 1e-9


@pytest.mark.parametrize("samples", [201, 2001, 20001])
def test_first_order_lag_has_its_closed_form_times(samples: int) -> None:
    """Settling at T ln 50 and rise time T ln 9, whatever the sampling; no overshoot."""
    times = np.linspace(0.0, 20.0, samples)
    values = np.where(times < 1.0, 3.0, 3.0 + 2.0 * -np.expm1(-(times - 1.0) / 1.7))
    measures = measure_step(times, values, start=1.0, target=5.0, command=2.0)
    resolution = 0.2 * (times[1] - times[0]) ** 2
    assert measures.settling_time == pytest.approx(1.7 * math.log(50.0), abs=resolution)
    assert measures.rise_time == pytest.approx(1.7 * math.log(9.0), abs=resolution)
    assert measures.overshoot == 0.0
    assert measures.peak_time == 19.0


def test_a_steady_error_within_the_band_is_measured() -> None:
    measures = measure_step(TIMES, 0.99 * -np.expm1(-TIMES), start=0.0, target=1.0, command=1.0)
    assert measures.steady_error == pytest.approx(0.01, abs=1e-6)


def test_a_response_at_its_target_from_the_start_settles_at_once() -> None:
    measures = measure_step(TIMES, np.full_like(TIMES, 7.0), start=0.0, target=7.0, command=2.0)
    assert (measures.settling_time, measures.rise_time, measures.overshoot) == (0.0, 0.0, 0.0)


def test_a_response_outside_the_band_at_the_end_is_not_settled() -> None:
    with pytest.raises(NotSettledError, match=r"not settled: 20 s after the step the response is 0.5 of the command off its target"):
        measure_step(TIMES, np.full_like(TIMES, 0.5), start=0.0, target=1.0, command=1.0)


def test_a_record_that_ends_just_after_the_last_entry_proves_nothing() -> None:
    times = TIMES[TIMES <= 4.5]
    with pytest.raises(NotSettledError, match=r"entered the band of 0.02 for the last time 3.9120\d s after the step.*at least 5.868\d* s"):
        measure_step(times, -np.expm1(-times), start=0.0, target=1.0, command=1.0)


def test_overshoot_alone_needs_no_settled_response() -> None:
    times = np.linspace(0.0, 6.0, 601)
    values = 1.0 - 1.2 * np.cos(2.0 * times)
    assert measure_overshoot(times, values, start=0.0, target=1.0, command=1.0) == pytest.approx(1.2, abs=1e-9)
    assert measure_overshoot(times, values, start=0.0, target=3.0, command=3.0) == 0.0


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({"start": 0.0, "target": 1.0, "command": 0.0}, "a step of 0 to 1 at 0 s cannot be measured"),
        ({"start": math.nan, "target": 1.0, "command": 1.0}, "a step of 1 to 1 at nan s cannot be measured"),
        ({"start": 19.9999, "target": 1.0, "command": 1.0}, "ends at 20 s, with 1 samples after the step at 19.9999 s"),
        ({"start": 0.0, "target": 1.0, "command": 1.0, "band": 0.0}, "settling band = 0 of the command is outside 0 to 1"),
    ],
)
def test_an_unusable_step_is_refused(step: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        measure_step(TIMES, TIMES, **step)
