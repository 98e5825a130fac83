import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction

TIMES = np.linspace(0.0, 5.0, 301)
LAG = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.5), input_unit="deg", output_unit="rad/s")
DELAYS = st.floats(0.0, 2.0)


def test_coefficients_are_normalised_to_one_at_zero_frequency() -> None:
    model = TransferFunction(numerator=(24.0, 0.0), denominator=(2.0, 1.0, 0.0))
    assert model.numerator == (12.0,)
    assert model.denominator == (1.0, 0.5)
    integrator = TransferFunction(numerator=(3.0,), denominator=(0.0, 2.0))
    assert integrator.denominator == (0.0, 1.0)
    assert integrator.numerator == (1.5,)
    assert TransferFunction(numerator=(24.0,), denominator=(2.0, 1.0)) == TransferFunction(numerator=(12.0,), denominator=(1.0, 0.5))


@given(DELAYS, st.floats(0.0, 200.0))
@settings(deadline=None, max_examples=40)
def test_the_delay_is_exact(delay: float, omega: float) -> None:
    value = complex(LAG.with_delay(delay)(1j * omega))
    assert value == pytest.approx(12.0 / (1.0 + 0.5j * omega) * np.exp(-1j * omega * delay), rel=1e-14)
    assert abs(value) == pytest.approx(abs(complex(LAG(1j * omega))), rel=1e-14)


def test_a_pade_approximant_would_be_seen() -> None:
    """Negative control: a first-order Pade delay fails the comparison of the test above."""
    pade = (1.0 - 1j * 30.0 * 0.02 / 2.0) / (1.0 + 1j * 30.0 * 0.02 / 2.0)
    assert abs(pade - np.exp(-1j * 30.0 * 0.02)) > 1e-3


def test_poles_zeros_orders_and_gains() -> None:
    model = TransferFunction(numerator=(6.0, 3.0), denominator=(25.0, 6.0, 1.0), delay=0.1)
    assert model.poles.tolist() == pytest.approx([-3.0 - 4.0j, -3.0 + 4.0j], rel=1e-14)
    assert model.zeros.tolist() == pytest.approx([-2.0])
    assert (model.order, model.relative_degree, model.is_proper, model.is_strictly_proper) == (2, 1, True, True)
    assert model.static_gain == pytest.approx(0.24)
    assert model.high_frequency_gain == 0.0
    assert model.is_stable
    assert not TransferFunction(numerator=(1.0,), denominator=(1.0, -1.0)).is_stable
    assert TransferFunction(numerator=(0.0,), denominator=(1.0,)).zeros.size == 0


def test_a_lead_passes_straight_through() -> None:
    lead = TransferFunction(numerator=(1.0, 0.4), denominator=(1.0, 0.1), delay=0.5)
    assert lead.high_frequency_gain == pytest.approx(4.0)
    assert not lead.is_strictly_proper
    assert lead.step_response(TIMES) == pytest.approx(np.where(TIMES >= 0.5, 1.0 + 3.0 * np.exp(-(TIMES - 0.5) / 0.1), 0.0), abs=1e-12)


@given(DELAYS)
@settings(deadline=None, max_examples=40)
def test_step_and_impulse_of_a_lag_with_delay(delay: float) -> None:
    model = LAG.with_delay(delay)
    on = delay <= TIMES
    late = np.where(on, TIMES - delay, 0.0)
    assert model.step_response(TIMES) == pytest.approx(np.where(on, 12.0 * -np.expm1(-late / 0.5), 0.0), abs=1e-12)
    assert model.impulse_response(TIMES) == pytest.approx(np.where(on, 24.0 * np.exp(-late / 0.5), 0.0), abs=1e-12)


@pytest.mark.parametrize("split", [0.0, 1e-13, 1e-9, 1e-5, 1e-2])
def test_equal_and_nearly_equal_poles(split: float) -> None:
    """1/(s+1)^2 has step 1 - (1+t) exp(-t); poles a little apart change it by less than the split."""
    model = TransferFunction(numerator=(1.0,), denominator=((1.0 + split) * (1.0 - split), 2.0, 1.0))
    assert model.step_response(TIMES) == pytest.approx(1.0 - (1.0 + TIMES) * np.exp(-TIMES), abs=1e-12 + split**2)


def test_integrators() -> None:
    ramp = TransferFunction(numerator=(2.0,), denominator=(0.0, 1.0), delay=0.25)
    assert ramp.step_response(TIMES) == pytest.approx(2.0 * np.maximum(TIMES - 0.25, 0.0), abs=1e-12)
    double = TransferFunction(numerator=(1.0,), denominator=(0.0, 0.0, 1.0))
    assert double.step_response(TIMES) == pytest.approx(TIMES**2 / 2.0, abs=1e-12)
    assert double.impulse_response(TIMES) == pytest.approx(TIMES, abs=1e-12)


def test_a_lightly_damped_mode() -> None:
    zeta, wn = 0.02, 60.0
    model = TransferFunction(numerator=(1.0,), denominator=(1.0, 2.0 * zeta / wn, 1.0 / wn**2))
    wd = wn * math.sqrt(1.0 - zeta**2)
    expected = 1.0 - np.exp(-zeta * wn * TIMES) * (np.cos(wd * TIMES) + zeta * wn / wd * np.sin(wd * TIMES))
    assert model.step_response(TIMES) == pytest.approx(expected, abs=1e-12)


@given(st.lists(st.floats(0.01, 1e4), min_size=1, max_size=4, unique=True), st.floats(-2.0, 2.0))
@settings(deadline=None, max_examples=40)
def test_partial_fractions_of_distinct_poles(magnitudes: list[float], lead: float) -> None:
    poles = -np.sort(magnitudes)
    if np.min(np.diff(np.abs(poles)) / np.abs(poles)[1:], initial=1.0) < 0.2:
        return
    denominator = np.polynomial.polynomial.polyfromroots(poles)
    numerator = (denominator[0],) if poles.size == 1 else (denominator[0], lead * denominator[0])
    model = TransferFunction(numerator=numerator, denominator=tuple(denominator))
    slopes = np.polynomial.polynomial.polyval(poles, np.polynomial.polynomial.polyder(denominator))
    residues = np.polynomial.polynomial.polyval(poles, numerator) / slopes
    terms = residues / poles * np.expm1(np.outer(TIMES, poles))
    assert model.step_response(TIMES) == pytest.approx(terms.sum(axis=1), abs=1e-12 * (1.0 + float(np.abs(terms).max())))


def test_the_impulse_response_is_the_slope_of_the_step_response() -> None:
    model = TransferFunction(numerator=(12.0, -0.17), denominator=(1.0, 0.54, 0.0266), delay=0.02)
    times, h = np.linspace(0.1, 2.0, 40), 1e-5
    slope = (model.step_response(times + h) - model.step_response(times - h)) / (2.0 * h)
    assert model.impulse_response(times) == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_a_constant_gain() -> None:
    gain = TransferFunction(numerator=(3.0,), denominator=(1.0,), delay=1.0)
    assert gain.step_response([0.5, 1.0, -2.0, 4.0]).tolist() == [0.0, 3.0, 0.0, 3.0]
    assert TransferFunction(numerator=(0.0,), denominator=(1.0,)).impulse_response([1.0]).tolist() == [0.0]


@given(DELAYS, st.integers(-300, 300).map(lambda k: k / 100.0))
@settings(deadline=None, max_examples=40)
def test_phase_is_continuous_on_any_grid(delay: float, lead: float) -> None:
    model = TransferFunction(numerator=(1.0, lead), denominator=(1.0, 0.3, 0.05, 0.004), delay=delay)
    fine = np.geomspace(1e-3, 1e3, 8000)
    assert model.phase_deg(fine) == pytest.approx(model.response(fine).phase_deg, abs=1e-6)
    assert model.phase_deg(fine[::-4000]) == pytest.approx(model.phase_deg(fine)[::-4000], abs=0.0)


def test_phase_of_integrators_and_negative_gains() -> None:
    assert TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0)).phase_deg([1.0]).tolist() == [-90.0]
    assert TransferFunction(numerator=(0.0, 1.0), denominator=(1.0,)).phase_deg([1.0]).tolist() == [90.0]
    assert TransferFunction(numerator=(-1.0,), denominator=(1.0,)).phase_deg([1.0]).tolist() == [180.0]


def test_decibels_in_any_order() -> None:
    assert LAG.magnitude_db([2.0, 0.0]) == pytest.approx([20.0 * math.log10(12.0 / math.sqrt(2.0)), 20.0 * math.log10(12.0)])


@given(DELAYS, DELAYS)
@settings(deadline=None, max_examples=40)
def test_series_multiplies(first: float, second: float) -> None:
    other = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=second, input_unit="rad/s", output_unit="rad")
    both = LAG.with_delay(first).series(other)
    s = np.array([0.3 + 2.0j, -1.0 - 4.0j])
    assert both(s) == pytest.approx(LAG.with_delay(first)(s) * other(s), rel=1e-13)
    assert (both.input_unit, both.output_unit, both.delay) == ("deg", "rad", first + second)
    assert LAG.scaled(-2.0).static_gain == -24.0


def test_the_response_carries_names_units_and_the_delay() -> None:
    found = LAG.with_delay(0.5).response([1.0, 100.0])
    assert (found.input_unit, found.output_unit, found.known_delay) == ("deg", "rad/s", 0.5)
    assert found.phase_deg[-1] == pytest.approx(-math.degrees(math.atan(50.0)) - math.degrees(50.0))


def test_what_is_no_transfer_function_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"numerator coefficients .* not usable"):
        TransferFunction(numerator=(), denominator=(1.0,))
    with pytest.raises(InvalidInputError, match=r"denominator coefficients .* not usable"):
        TransferFunction(numerator=(1.0,), denominator=(1.0, np.nan))
    with pytest.raises(InvalidInputError, match="the denominator is zero"):
        TransferFunction(numerator=(1.0,), denominator=(0.0, 0.0))
    with pytest.raises(InvalidInputError, match="normalised numerator"):
        TransferFunction(numerator=(1e300,), denominator=(1e-300,))
    with pytest.raises(InvalidInputError, match="delay = -1 s"):
        LAG.with_delay(-1.0)


def test_what_cannot_be_answered_is_refused() -> None:
    integrator = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0))
    with pytest.raises(InvalidInputError, match=r"integrates .* no static gain"):
        _ = integrator.static_gain
    with pytest.raises(InvalidInputError, match=r"no finite value at s = 0\+0j"):
        integrator(0.0)
    with pytest.raises(InvalidInputError, match="zero has no phase"):
        TransferFunction(numerator=(0.0,), denominator=(1.0,)).phase_deg([1.0])
    differentiator = TransferFunction(numerator=(0.0, 1.0), denominator=(1.0,))
    for ask in (lambda: differentiator.step_response([1.0]), lambda: differentiator.high_frequency_gain):
        with pytest.raises(InvalidInputError, match="is not proper: it differentiates; add a filter pole"):
            ask()
    with pytest.raises(InvalidInputError, match="its answer holds an impulse; use step_response"):
        TransferFunction(numerator=(1.0, 1.0), denominator=(1.0, 2.0)).impulse_response([1.0])
    with pytest.raises(InvalidInputError, match="a time is not finite"):
        LAG.step_response([np.nan])
    with pytest.raises(InvalidInputError, match=r"exceeds the range of numbers within 1000 s"):
        TransferFunction(numerator=(1.0,), denominator=(1.0, -1.0)).step_response([1000.0])
    with pytest.raises(InvalidInputError, match="output in rad/s feeds an input in deg"):
        LAG.series(LAG)


@pytest.mark.parametrize("pole", [1.0, 0.3, 20.0])
@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_a_multiple_pole_s_step_is_exact(order: int, pole: float) -> None:
    """1/(1 + s/p)^n: 1 - exp(-p t) sum of (p t)^k / k!; roots that come as a cluster lose no digit."""
    denominator = np.poly1d([1.0 / pole, 1.0]) ** order
    model = TransferFunction(numerator=(1.0,), denominator=tuple(denominator.coeffs[::-1]))
    times = np.linspace(0.0, 8.0 / pole, 50)
    x = pole * times
    exact = 1.0 - np.exp(-x) * sum(x**k / math.factorial(k) for k in range(order))
    assert model.step_response(times) == pytest.approx(exact, abs=1e-12)
