import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.loops.time_series import Series, check_series, crossing_time, first_reach, refine_extreme, upward_crossings
from revline.errors import InvalidInputError

TIMES = np.linspace(0.0, 10.0, 1001)


@given(vertex=st.floats(3.0, 7.0), height=st.floats(-50.0, 50.0), curvature=st.floats(0.1, 10.0))
def test_a_parabola_is_refined_exactly(vertex: float, height: float, curvature: float) -> None:
    series = Series(TIMES, height - curvature * (TIMES - vertex) ** 2)
    extreme = refine_extreme(series, int(np.argmax(series.values)))
    assert extreme.time == pytest.approx(vertex, abs=1e-5)
    assert extreme.value == pytest.approx(height, abs=1e-9)


@given(phase=st.floats(0.0, 2.0 * math.pi))
def test_error_of_a_refined_extreme_covers_its_true_error(phase: float) -> None:
    times = np.arange(0.0, 10.0, 0.1)
    series = Series(times, np.sin(2.0 * times + phase))
    extreme = refine_extreme(series, 10 + int(np.argmax(series.values[10:60])))
    assert abs(extreme.value - 1.0) <= extreme.error + 1e-6
    assert extreme.error < 5e-4


def test_uneven_sampling_is_allowed() -> None:
    times = np.cumsum(0.02 + 0.01 * np.sin(np.arange(300.0)))
    series = Series(times, np.cos(times - 3.0))
    extreme = refine_extreme(series, int(np.argmax(series.values)))
    assert extreme.time == pytest.approx(3.0, abs=1e-6)
    assert extreme.value == pytest.approx(1.0, abs=1e-9)


def test_an_extreme_at_the_end_or_beside_it_stays_in_the_record() -> None:
    rising = Series(TIMES, TIMES)
    assert refine_extreme(rising, 1000) == (10.0, 10.0, 0.0)
    beside = Series(TIMES, -((TIMES - 0.011) ** 2))
    assert refine_extreme(beside, 1).time == pytest.approx(0.011, abs=1e-9)
    flat = Series(TIMES, np.zeros_like(TIMES))
    assert refine_extreme(flat, 500).value == 0.0


def test_crossings_are_found_between_samples_to_fourth_order() -> None:
    crossings = upward_crossings(Series(TIMES, np.sin(3.0 * TIMES - 1.0)), 0.3, 0.1)
    exact = (1.0 + math.asin(0.3) + 2.0 * math.pi * np.arange(5)) / 3.0
    np.testing.assert_allclose(crossings, exact, atol=1e-8)


def test_hysteresis_ignores_ripple_about_the_level() -> None:
    ripple = np.sin(TIMES) + 0.05 * np.sin(150.0 * TIMES)
    assert upward_crossings(Series(TIMES, ripple), 0.0, 0.2).size == 1
    assert upward_crossings(Series(TIMES, ripple), 0.0, 0.0).size > 1


def test_a_crossing_at_the_border_or_over_a_jump_uses_a_straight_line() -> None:
    jumps = np.where(TIMES < 5.0, -1.0, 1.0)
    assert 4.99 <= upward_crossings(Series(TIMES, jumps), 0.0, 0.5)[0] <= 5.0
    assert upward_crossings(Series(TIMES, TIMES - 0.004), 0.0, 0.001)[0] == pytest.approx(0.004)


def test_first_reach() -> None:
    series = Series(TIMES, 2.0 * TIMES)
    assert first_reach(series, 3.003) == pytest.approx(1.5015)
    assert first_reach(series, -1.0) == 0.0
    assert crossing_time(series, 100, 2.01) == pytest.approx(1.005)
    with pytest.raises(InvalidInputError, match="never reach 21; their largest is 20"):
        first_reach(series, 21.0)


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        (TIMES, TIMES[:-1], r"times of shape \(1001,\) and values of shape \(1000,\)"),
        (TIMES[:5], TIMES[:5], "5 samples is too short"),
        (TIMES, np.where(TIMES == 5.0, np.nan, 0.0), r"sample 500 \(time 5.0 s, value nan\) is not finite"),
        (np.where(TIMES == 5.0, 4.0, TIMES), TIMES, "time does not rise after sample 499: 4.99 s, then 4 s"),
    ],
)
def test_what_is_no_series_is_refused(times: np.ndarray, values: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        check_series(times, values)
