import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controllers.controller import PidGains
from revline.design.loops.step_measures import measure_overshoot, measure_step
from revline.design.stability.linear_loop import (
    HALF_POWER,
    closed_loop_response,
    closed_loop_transfer,
    find_bandwidth,
    measure_closed_loop,
)
from revline.design.tuning.rules_step import tune_pi_pole_placement
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.transfer_function import TransferFunction

G1 = TransferFunction(numerator=(12.21634,), denominator=(1.0, 0.579381), input_unit="deg", output_unit="rad/s", output_name="speed")
G2 = TransferFunction(numerator=(12.006617,), denominator=(1.0, 0.551588, 0.0343956), input_unit="deg", output_unit="rad/s")
G2D = G2.with_delay(0.0213)
C1 = tune_pi_pole_placement(G1, natural_frequency=18.85, damping=1.25, designed_on="g1")


def gains(kp: float, ki: float, kd: float) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="test")


@pytest.mark.reference
def test_first_controller_has_its_published_overshoot_and_band() -> None:
    """C1 on G1, recomputed from Lee (1995), section 5.1: overshoot 7.7 %, band 51.57 rad/s at 1/sqrt(2), 51.48 at -3.000 dB."""
    assert find_bandwidth(G1, C1) == pytest.approx(51.57, abs=5e-3)
    assert find_bandwidth(G1, C1, level=10.0 ** (-3.0 / 20.0)) == pytest.approx(51.48, abs=5e-3)
    times = np.linspace(0.0, 1.5, 1501)
    measures = measure_step(times, closed_loop_transfer(G1, C1).step_response(times), start=0.0, target=1.0, command=1.0)
    assert measures.overshoot == pytest.approx(0.0769, abs=1e-4)


@pytest.mark.reference
@pytest.mark.parametrize(("ki", "overshoot", "tolerance"), [(250.0, 0.20, 0.01), (110.0, 0.10, 0.005)])
def test_second_controller_has_its_known_overshoot(ki: float, overshoot: float, tolerance: float) -> None:
    """C2 on G2 (kp 20, kd 0.4), recomputed from Lee (1995), chapter 5: 20 % with ki 250, 10 % with about 110."""
    times = np.linspace(0.0, 1.0, 4001)
    response = closed_loop_transfer(G2, gains(20.0, ki, 0.4)).step_response(times)
    assert measure_overshoot(times, response, start=0.0, target=1.0, command=1.0) == pytest.approx(overshoot, abs=tolerance)


@given(kp=st.floats(0.1, 20.0), ki=st.floats(0.1, 100.0))
def test_measures_of_a_second_order_loop_agree_with_their_closed_form(kp: float, ki: float) -> None:
    """PI on a lag: |T|^2 = K^2 (ki^2 + kp^2 x) / ((K ki - T x)^2 + (1 + K kp)^2 x) with x = w^2, quadratic where it has a given value."""
    gain, lag = G1.numerator[0], G1.denominator[1]
    measures = measure_closed_loop(G1, gains(kp, ki, 0.0))
    squared = np.array([gain**2 * ki**2, gain**2 * kp**2])
    below = np.array([gain**2 * ki**2, (1.0 + gain * kp) ** 2 - 2.0 * gain * ki * lag, lag**2])
    edge = np.roots((2.0 * np.append(squared, 0.0) - below)[::-1])
    assert measures.bandwidth == pytest.approx(math.sqrt(float(np.max(edge[np.abs(edge.imag) < 1e-9].real))), rel=1e-10)
    slope = np.polynomial.polynomial.polysub(
        np.polynomial.polynomial.polymul(squared[1:], below), np.convolve(squared, np.polynomial.polynomial.polyder(below))
    )
    steady = np.roots(slope[::-1])
    places = np.array([0.0, *(r.real for r in steady if abs(r.imag) < 1e-9 and r.real > 0.0)])
    heights = np.sqrt(np.polyval(squared[::-1], places) / np.polyval(below[::-1], places))
    assert measures.peak == pytest.approx(float(heights.max()), rel=1e-9)
    assert measures.peak_frequency == pytest.approx(math.sqrt(places[int(np.argmax(heights))]), rel=1e-6, abs=1e-4)
    assert measures.static_gain == 1.0
    assert measures.level == HALF_POWER


@pytest.mark.parametrize("plant", [G2, G2D])
@pytest.mark.parametrize("controller", [gains(1.2, 2.0, 0.1), gains(0.12, 2.0, 0.1), gains(0.8, 0.0, 0.05), gains(0.9, 5.0, 0.0)])
def test_no_grid_point_contradicts_the_measures(plant: TransferFunction, controller: PidGains) -> None:
    measures = measure_closed_loop(plant, controller)
    response = closed_loop_response(plant, controller, np.linspace(0.001, 300.0, 100_000))
    assert response.magnitude.max() <= measures.peak * (1.0 + 1e-12)
    assert measures.peak_db == pytest.approx(20.0 * math.log10(measures.peak))
    assert np.all(response.magnitude[response.omega < measures.bandwidth] >= HALF_POWER)
    edge = closed_loop_response(plant, controller, [measures.bandwidth * 0.999, measures.bandwidth, measures.bandwidth * 1.001])
    assert edge.magnitude[1] == pytest.approx(HALF_POWER, rel=1e-12)
    assert edge.magnitude[0] > HALF_POWER > edge.magnitude[2]


def test_a_notch_ends_the_band_before_a_later_resonance() -> None:
    """The lowest crossing counts: a grid from the top, or the last crossing, would give another number."""
    plant = TransferFunction(numerator=(1.0, 0.0, 1.0), denominator=(1.0, 3.0, 3.0, 1.0), input_unit="deg", output_unit="rad/s")
    bandwidth = find_bandwidth(plant, gains(15.0, 0.5, 0.0))
    assert bandwidth < 1.0
    later = closed_loop_response(plant, gains(15.0, 0.5, 0.0), np.linspace(1.2, 3.0, 50))
    assert later.magnitude.max() > HALF_POWER


def test_a_narrow_resonance_is_not_missed() -> None:
    """A resonance at 1000 rad/s, 0.02 rad/s wide: a grid of a thousand points per decade passes over it."""
    sharp = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0 + 2e-8, 2e-8 + 1e-6, 1e-6), input_unit="deg", output_unit="rad/s")
    measures = measure_closed_loop(sharp, gains(9e-6, 0.0, 0.0), level=1e-6)
    response = closed_loop_response(sharp, gains(9e-6, 0.0, 0.0), np.linspace(999.0, 1001.0, 200_001))
    assert measures.peak >= response.magnitude.max()
    assert measures.peak == pytest.approx(response.magnitude.max(), rel=1e-3)


def test_closed_loop_response_is_named_and_unwrapped() -> None:
    plant = TransferFunction(numerator=G2D.numerator, denominator=G2D.denominator, delay=0.0213, input_unit="deg", output_unit="rad/s")
    response = closed_loop_response(plant, gains(1.2, 2.0, 0.1), [0.1, 5.0, 50.0, 500.0])
    assert (response.input_unit, response.output_unit, response.known_delay) == ("rad/s", "rad/s", 0.0213)
    assert response.input_name == "output command"
    assert response.method == "closed loop, delay exact"
    fine = closed_loop_response(plant, gains(1.2, 2.0, 0.1), np.linspace(0.1, 500.0, 100_000))
    assert response.phase_deg[-1] == pytest.approx(fine.phase_deg[-1], abs=1e-9)


def test_closed_loop_transfer_has_the_placed_poles() -> None:
    closed = closed_loop_transfer(G1, C1)
    exact = np.sort(18.85 * (-1.25 + np.array([-0.75, 0.75])))
    np.testing.assert_allclose(np.sort(closed.poles.real), exact, rtol=1e-9)
    assert closed.static_gain == pytest.approx(1.0, rel=1e-14)
    assert (closed.input_name, closed.input_unit) == ("speed command", "rad/s")
    with pytest.raises(InvalidInputError, match=r"around a delay of 0.0213 s is no rational transfer function"):
        closed_loop_transfer(G2D, C1)


def test_unstable_loops_have_no_band() -> None:
    with pytest.raises(AnalysisError, match=r"closed loop is unstable \(2 poles right of the imaginary axis\)"):
        measure_closed_loop(G2D, C1)
    with pytest.raises(AnalysisError, match=r"closed loop is unstable \(infinitely many poles"):
        find_bandwidth(G1.with_delay(0.01), gains(1.0, 0.0, 0.4))


def test_a_loop_that_passes_too_little_has_no_band() -> None:
    with pytest.raises(AnalysisError, match=r"magnitude at zero frequency is 0.5456, not above the level of 0.7071"):
        find_bandwidth(G2, gains(0.1, 0.0, 0.0))
    assert find_bandwidth(G2, gains(0.1, 0.0, 0.0), level=0.5) > 0.0


@pytest.mark.parametrize("level", [0.0, -1.0, math.nan])
def test_an_impossible_level_is_refused(level: float) -> None:
    with pytest.raises(InvalidInputError, match=r"level = .* is no magnitude"):
        find_bandwidth(G1, C1, level=level)
