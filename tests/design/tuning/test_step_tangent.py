import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from revline.design.tuning.step_tangent import TangentReading, measure_step_tangent
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction

G2 = TransferFunction(numerator=(12.006617,), denominator=(1.0, 0.551588, 0.0343956), input_unit="deg", output_unit="rad/s")


def plant(numerator: tuple[float, ...], denominator: tuple[float, ...], delay: float = 0.0) -> TransferFunction:
    return TransferFunction(numerator=numerator, denominator=denominator, delay=delay)


@pytest.mark.reference
@pytest.mark.parametrize(("delay", "dead_time"), [(0.0, 0.0417), (0.0213, 0.0630)])
def test_tangent_of_the_second_order_engine_models(delay: float, dead_time: float) -> None:
    """Exact values for G2 and G2d, recomputed from the models of Lee (1995), Table 4.2; read there as 0.04, 0.66 and 0.07, 0.65."""
    tangent = measure_step_tangent(G2.with_delay(delay))
    assert tangent.dead_time == pytest.approx(dead_time, abs=5e-5)
    assert tangent.rise_time == pytest.approx(0.670, abs=5e-4)
    assert tangent.final_value == 12.006617
    assert (tangent.reading.input_unit, tangent.reading.output_unit) == ("deg", "rad/s")


@given(
    lag=st.floats(0.01, 10.0),
    ratio=st.floats(1.001, 1e4),
    gain=st.floats(0.1, 20.0),
    sign=st.sampled_from([1, -1]),
    delay=st.floats(0.0, 1.0),
)
def test_two_lags_have_their_closed_form_tangent(lag: float, ratio: float, gain: float, sign: int, delay: float) -> None:
    fast, gain = lag / ratio, gain * sign
    tangent = measure_step_tangent(plant((gain,), (1.0, lag + fast, lag * fast), delay))
    time = fast * math.log(ratio) / (1.0 - fast / lag)
    slope = gain * (math.exp(-time / lag) - math.exp(-time / fast)) / (lag - fast)
    value = gain * (1.0 - (lag * math.exp(-time / lag) - fast * math.exp(-time / fast)) / (lag - fast))
    assert tangent.inflection_time == pytest.approx(delay + time, rel=1e-6)
    assert tangent.slope == pytest.approx(slope, rel=1e-9)
    assert tangent.dead_time == pytest.approx(delay + time - value / slope, abs=1e-8 * lag)
    assert tangent.inflection_value == pytest.approx(value, abs=1e-7 * abs(gain))


@pytest.mark.parametrize("lags", [(1.0, 1.0), (1.0, 1.3, 1.7), (0.1, 0.7, 1.0, 4.0), (0.01, 0.02, 0.5, 0.9, 3.0)])
def test_several_lags_agree_with_their_partial_fractions(lags: tuple[float, ...]) -> None:
    tangent = measure_step_tangent(
        plant((2.0,), tuple(np.polynomial.polynomial.polyfromroots([-1.0 / lag for lag in lags]) * np.prod(lags)))
    )
    if lags == (1.0, 1.0):
        assert tangent.slope == pytest.approx(2.0 * math.exp(-1.0), rel=1e-12)
        assert tangent.inflection_time == pytest.approx(1.0, rel=1e-6)
        return
    poles = -1.0 / np.array(lags)
    residues = [2.0 / np.prod(lags) / np.prod([p - q for q in poles if q != p]) for p in poles]
    bend = brentq(lambda t: float(np.sum(residues * poles * np.exp(poles * t))), 0.05 * sum(lags), sum(lags), xtol=1e-14)
    assert tangent.inflection_time == pytest.approx(bend, rel=1e-8)
    assert tangent.slope == pytest.approx(float(np.sum(residues * np.exp(poles * bend))), rel=1e-8)


@settings(max_examples=30)
@given(damping=st.floats(0.002, 0.95), frequency=st.floats(0.1, 100.0))
def test_an_oscillating_plant_is_steepest_in_its_first_swing(damping: float, frequency: float) -> None:
    tangent = measure_step_tangent(plant((3.0,), (1.0, 2.0 * damping / frequency, frequency**-2)))
    exact = math.acos(damping) / (frequency * math.sqrt(1.0 - damping**2))
    assert tangent.inflection_time == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_a_lag_of_first_order_is_steepest_at_its_start(delay: float) -> None:
    tangent = measure_step_tangent(plant((12.0,), (1.0, 0.58), delay))
    assert (tangent.dead_time, tangent.inflection_time, tangent.inflection_value) == (delay, delay, 0.0)
    assert tangent.rise_time == pytest.approx(0.58, rel=1e-12)


def test_a_plant_with_a_zero_may_be_steepest_at_its_start_or_later() -> None:
    early = measure_step_tangent(plant((1.0, 0.9), (1.0, 2.0, 1.0)))
    assert early.inflection_time == 0.0
    assert early.rise_time == pytest.approx(1.0 / 0.9, rel=1e-12)
    inverse = measure_step_tangent(plant((1.0, -0.5), (1.0, 2.0, 1.0)))
    assert inverse.inflection_time == pytest.approx(4.0 / 3.0, rel=1e-6)


def test_the_response_never_rises_above_its_steepest_tangent_slope() -> None:
    g4 = plant((12.0065,), (1.0, 0.5564, 0.0344, 0.0005, 5e-6))
    tangent = measure_step_tangent(g4)
    slopes = g4.impulse_response(np.linspace(0.0, 2.0, 4001))
    assert slopes.max() <= tangent.slope * (1.0 + 1e-12)
    assert slopes.max() == pytest.approx(tangent.slope, rel=1e-4)


@pytest.mark.parametrize(
    ("numerator", "denominator", "message"),
    [
        ((1.0, 1.0), (1.0, 2.0), "step response jumps"),
        ((1.0,), (0.0, 1.0), r"settles nowhere \(poles at 0"),
        ((1.0,), (1.0, -1.0), r"settles nowhere \(poles at 1 rad/s\)"),
        ((0.0,), (1.0,), r"settles nowhere \(poles at none"),
        ((0.0, 1.0), (1.0, 2.0, 1.0), "static gain is 0"),
    ],
)
def test_a_plant_without_such_a_tangent_is_refused(numerator: tuple[float, ...], denominator: tuple[float, ...], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        measure_step_tangent(plant(numerator, denominator))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dead_time": math.nan}, "dead time = nan s is outside the finite numbers"),
        ({"rise_time": 0.0}, "rise time = 0 s is outside the positive numbers"),
        ({"rise_time": math.inf}, "rise time = inf s is outside"),
        ({"final_value": 0.0}, "final value = 0 1 per 1 is outside the finite numbers other than 0"),
    ],
)
def test_an_impossible_reading_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        TangentReading(**{"dead_time": 0.1, "rise_time": 1.0, "final_value": 2.0, **change})
