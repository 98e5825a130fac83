"""Stabilising gains: against closed forms, and against a count of roots that shares nothing with the boundary."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.regions import gain_curve
from revline.design.regions.gain_curve import LoopFamily
from revline.design.regions.gain_region import GainRegion, Window, find_gain_region, find_window
from revline.design.regions.loop_family import family_of_model, family_of_system
from revline.design.stability.loop_stability import count_unstable_poles
from revline.design.stability.open_loop import open_loop_of_system
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, NotConvergedError
from revline.lti.interconnection import to_state_space
from revline.lti.state_space import DelayStateSpace
from revline.lti.transfer_function import TransferFunction

INTEGRATOR = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=0.4)
G1 = TransferFunction(numerator=(12.2163,), denominator=(1.0, 0.57938))
G2 = TransferFunction(numerator=(12.0066,), denominator=(1.0, 0.55159, 0.034396))
G2D = G2.with_delay(0.0213)
UNSTABLE = TransferFunction(numerator=(-1.0,), denominator=(1.0, -1.0), delay=0.1)
RINGING = TransferFunction(numerator=(1.0,), denominator=(1.0, 0.2, 1.0), delay=2.5)
RIGHT_ZERO = TransferFunction(numerator=(12.0, -1.0), denominator=(1.0, 0.55, 0.035))


def pid(kp: float, ki: float, kd: float, units: tuple[str, str] = ("1", "1")) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit=units[0], output_unit=units[1], rule="by hand", designed_on="test")


@pytest.fixture(scope="module")
def engine_model() -> DelayStateSpace:
    engine = lee1995()
    return linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model


def test_an_integrator_with_delay_has_its_closed_form() -> None:
    """q = s exp(s tau): kp = w sin(w tau), ki = w^2 cos(w tau); without integral action 0 < kp < pi/(2 tau)."""
    found = find_gain_region(family_of_model(INTEGRATOR), Window(kp_low=-1.0, kp_high=6.0, ki_high=20.0))
    turned = found.omega * 0.4
    assert found.kp == pytest.approx(found.omega * np.sin(turned), rel=1e-12, abs=1e-12)
    assert found.ki == pytest.approx(found.omega**2 * np.cos(turned), rel=1e-12, abs=1e-9)
    ((low, high),) = found.kp_ends()
    assert (low, high) == pytest.approx((0.0, math.pi / 0.8), rel=1e-12, abs=1e-12)
    assert found.bounded
    assert np.all(found.omega[found.rim] <= math.pi / 0.8 * (1.0 + 1e-12))


def test_the_window_chosen_holds_all_gains_of_a_slow_plant() -> None:
    """K exp(-s L)/s: kp ends at pi/(2 K L), ki at x^2 cos x/(K L^2) where x tan x = 2: far beyond a loop gain of a hundred at 1 rad/s."""
    gain, delay = 12.0, 0.01
    plant = TransferFunction(numerator=(gain,), denominator=(0.0, 1.0), delay=delay, input_unit="deg", output_unit="rad/s")
    region = find_gain_region(family_of_model(plant, kd=0.0, name="integrator"))
    x = float(brentq(lambda v: v * math.tan(v) - 2.0, 0.5, 1.5))
    assert region.bounded
    assert region.kp_ends()[-1][1] == pytest.approx(math.pi / (2.0 * gain * delay), rel=1e-9)
    assert np.max(region.ki[region.rim]) == pytest.approx(x * x * math.cos(x) / (gain * delay**2), rel=1e-3)


def test_two_lags_have_rouths_line() -> None:
    """a2 s^3 + a1 s^2 + (1 + K kp) s + K ki is stable below ki = a1 (1 + K kp)/(a2 K)."""
    found = find_gain_region(family_of_model(G2), Window(kp_low=-0.5, kp_high=20.0, ki_high=1000.0))
    gain, a1, a2 = 12.0066, 0.55159, 0.034396
    for kp in (-0.05, 0.0, 1.0, 15.0):
        edge = a1 * (1.0 + gain * kp) / (a2 * gain)
        assert found.stabilises(kp, 0.99 * edge)
        assert not found.stabilises(kp, 1.01 * edge)
    assert not found.bounded


def test_the_window_chosen_holds_all_or_stops_at_a_large_loop_gain() -> None:
    window = find_window(family_of_model(G2D))
    found = find_gain_region(family_of_model(G2D), window)
    assert found.bounded
    assert window.ki_high == pytest.approx(1.1 * np.max(found.ki[found.rim]), rel=1e-3)
    assert find_window(family_of_model(G1)).kp_high == pytest.approx(100.0 / 12.2163)


@pytest.mark.parametrize(("throttle", "load", "kd"), [(52.81, 12.94, 0.0437), (41.61, 9.48, 0.0407)])
def test_a_window_chosen_ends_where_the_curve_is_complete(throttle: float, load: float, kd: float) -> None:
    """The region reaches almost as far as the curve: the room about it must not go beyond, or its area cannot be counted."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": throttle, "load_torque": load})
    region = find_gain_region(family_of_system(linearize(engine, trim).model, kd=kd))
    assert region.window.kp_high <= region.reach[0]
    assert region.window.ki_high <= region.reach[1]
    assert region.area.value > 0.0
    assert region.bounded


def test_a_region_that_leaves_the_window_through_a_gap_is_not_bounded() -> None:
    """The top edge crosses the region just below its highest point, over a hundred-thousandth of the window."""
    whole = find_gain_region(family_of_model(G2D))
    top = float(np.max(whole.ki[whole.rim]))
    window = Window(kp_low=-100.0, kp_high=100.0, ki_high=top * (1.0 - 1e-6))
    assert not find_gain_region(family_of_model(G2D), window).bounded
    assert find_gain_region(family_of_model(G2D), Window(kp_low=-100.0, kp_high=100.0, ki_high=top * 1.01)).bounded


def test_an_area_without_delay_has_its_closed_form() -> None:
    """Below Routh's line and between the ends of kp, within a window that the line leaves at its right."""
    gain, a1, a2 = 12.0066, 0.55159, 0.034396
    found = find_gain_region(family_of_model(G2), Window(kp_low=-0.5, kp_high=2.0, ki_high=1000.0))
    wanted = a1 / (a2 * gain) * (1.0 + gain * 2.0) ** 2 / (2.0 * gain)
    assert found.area.value == pytest.approx(wanted, rel=1e-5)
    assert abs(found.area.value - wanted) < 4.0 * found.area.error


def test_one_lag_lets_gains_grow_without_end() -> None:
    found = find_gain_region(family_of_model(G1))
    assert not found.bounded
    assert found.stabilises(5.0, 800.0)
    assert not found.stabilises(-0.1, 1.0)


@pytest.mark.parametrize(
    ("plant", "kd", "window"),
    [
        (INTEGRATOR, 0.0, (-1.0, 6.0, 20.0)),
        (INTEGRATOR, 0.5, (-1.0, 6.0, 20.0)),
        (UNSTABLE, 0.0, (-2.0, 15.0, 20.0)),
        (G2D, 0.05, (-0.5, 10.0, 100.0)),
        (G2D, 0.1, (-0.5, 10.0, 100.0)),
        (RIGHT_ZERO, 0.0, (-2.0, 2.0, 5.0)),
        (RINGING, 0.1, (-2.0, 3.0, 3.0)),
        (TransferFunction(numerator=(12.0,), denominator=(1.0, -0.55, 0.35), delay=0.02), 0.1, (-0.5, 10.0, 100.0)),
    ],
)
def test_the_count_agrees_with_the_principle_of_the_argument(
    plant: TransferFunction, kd: float, window: tuple[float, float, float]
) -> None:
    low, high, top = window
    found = find_gain_region(family_of_model(plant, kd=kd), Window(kp_low=low, kp_high=high, ki_high=top))
    generator = np.random.default_rng(7)
    kp, ki = generator.uniform(low, high, 60), generator.uniform(0.01 * top, top, 60)
    counted = found.unstable_roots(kp, ki)
    for p, i, count in zip(kp, ki, counted, strict=True):
        try:
            wanted = count_unstable_poles(plant, pid(p, i, kd))
        except NotConvergedError:
            continue
        assert count == wanted, (p, i)


@given(st.floats(-0.2, 5.0), st.floats(0.1, 150.0))
@settings(max_examples=40, deadline=None)
def test_the_engines_count_agrees_with_its_roots(engine_region: GainRegion, engine_model: DelayStateSpace, kp: float, ki: float) -> None:
    wanted = open_loop_of_system(engine_model, pid(kp, ki, 0.1, ("rad/s", "deg"))).unstable_poles
    if int(engine_region.unstable_roots(kp, ki)) != wanted:  # nearer to the curve than its chords
        around = [int(engine_region.unstable_roots(kp * (1.0 + d), ki * (1.0 + d))) for d in (-0.01, 0.01)]
        assert wanted in around


@pytest.fixture(scope="module")
def engine_region(engine_model: DelayStateSpace) -> GainRegion:
    family = family_of_system(engine_model, kd=0.1, name="engine")
    return find_gain_region(family)


@pytest.mark.reference
def test_the_engines_limits(engine_model: DelayStateSpace) -> None:
    """Converged: proportional control alone up to 2.106 deg per rad/s; with ki/kp = 7.83 1/s up to kp = 1.240."""
    family = family_of_system(engine_model)
    found = find_gain_region(family)
    assert found.bounded
    ((_, high),) = found.kp_ends()
    assert high == pytest.approx(2.106, abs=5e-4)
    ratio = 16.85 / 2.153
    assert found.stabilises(1.235, 1.235 * ratio)
    assert not found.stabilises(1.245, 1.245 * ratio)
    assert not found.stabilises(2.153, 16.85)


def test_every_rim_point_lies_on_the_imaginary_axis(engine_region: GainRegion, engine_model: DelayStateSpace) -> None:
    at = np.flatnonzero(engine_region.rim)[::10]
    for w, kp, ki in zip(engine_region.omega[at], engine_region.kp[at], engine_region.ki[at], strict=True):
        value = open_loop_of_system(engine_model, pid(kp, ki, 0.1, ("rad/s", "deg"))).transfer(np.array([1j * w]))[0]
        assert abs(1.0 + value) < 1e-9


def test_a_system_and_its_transfer_function_have_one_region() -> None:
    named = TransferFunction(numerator=G2D.numerator, denominator=G2D.denominator, delay=G2D.delay, input_unit="deg", output_unit="rad/s")
    window = Window(kp_low=-0.5, kp_high=10.0, ki_high=100.0)
    system = to_state_space(named, input_name="throttle", output_name="engine_speed")
    one, two = find_gain_region(family_of_model(named), window), find_gain_region(family_of_system(system), window)
    assert two.kp == pytest.approx(one.kp, rel=1e-9)
    assert two.ki == pytest.approx(one.ki, rel=1e-9, abs=1e-9)
    assert np.array_equal(one.rim, two.rim)


def test_a_dropped_delay_would_be_seen() -> None:
    """Negative control: without delay G2 has no largest kp."""
    window = Window(kp_low=-0.5, kp_high=10.0, ki_high=100.0)
    assert find_gain_region(family_of_model(G2), window).kp_ends()[-1][1] == 10.0
    assert find_gain_region(family_of_model(G2D), window).kp_ends()[-1][1] < 3.0


def test_unfit_questions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidInputError, match="largest kp = 1"):
        Window(kp_low=2.0, kp_high=1.0, ki_high=1.0)
    with pytest.raises(InvalidInputError, match="largest ki = 0"):
        Window(kp_low=0.0, kp_high=1.0, ki_high=0.0)
    window = Window(kp_low=-0.5, kp_high=1.0, ki_high=1.0)
    with pytest.raises(InvalidInputError, match=r"ki = -1 .*turn the sign"):
        find_gain_region(family_of_model(G2D), window).unstable_roots(1.0, -1.0)
    with pytest.raises(InvalidInputError, match=r"magnitude of kp = 1\.5 +is outside 0 to 1; find the region in a window"):
        find_gain_region(family_of_model(G2D), window).unstable_roots([0.5, -1.5], 0.5)
    with pytest.raises(InvalidInputError, match="does not answer at rest"):
        family_of_model(TransferFunction(numerator=(0.0, 1.0), denominator=(1.0, 1.0)))
    silent = TransferFunction(numerator=(0.0, 1.0), denominator=(1.0, 1.0, 1.0))
    with pytest.raises(InvalidInputError, match="does not answer at rest"):
        family_of_system(to_state_space(silent, input_name="throttle", output_name="engine_speed"))
    with pytest.raises(InvalidInputError, match="infinitely many roots of model"):
        family_of_model(TransferFunction(numerator=(2.0,), denominator=(1.0, 1.0), delay=0.1), kd=0.9)
    improper = LoopFamily(
        name="lead", inverse=lambda s: np.asarray(0.5 + 0.5 * s, dtype=np.complex128), at_rest=0.5, kd=-0.5, base=0.0, unstable=0
    )
    with pytest.raises(InvalidInputError, match=r"lead with kd = -0\.5 answers at any frequency"):
        find_gain_region(improper, window)
    monkeypatch.setattr(gain_curve, "MOST_POINTS", 10)
    with pytest.raises(NotConvergedError, match="turns too fast near"):
        find_gain_region(family_of_model(G2D), window)


@pytest.mark.reference
def test_the_largest_kp_of_a_lag_with_delay_is_that_of_silva_datta_and_bhattacharyya() -> None:
    """Silva, Datta and Bhattacharyya (2005), chapter 7: of all kd, kp up to (T/L a sin a - cos a)/k with tan a = -a T/(T + L)."""
    gain, lag, delay = 2.0, 0.8, 0.3
    angle = float(brentq(lambda x: (lag + delay) * math.sin(x) + lag * x * math.cos(x), 1.0, math.pi, xtol=1e-15))
    wanted = (lag / delay * angle * math.sin(angle) - math.cos(angle)) / gain
    plant = TransferFunction(numerator=(gain,), denominator=(1.0, lag), delay=delay)
    found = []
    for share in (0.0, 0.2, 0.4, 0.6, 0.8):
        region = find_gain_region(family_of_model(plant, kd=share * lag / gain))
        found.append(float(np.max(region.kp[region.rim])))
    assert all(kp <= wanted * (1.0 + 1e-12) for kp in found)
    assert max(found) == pytest.approx(wanted, rel=1e-6)
    assert found[0] < 0.92 * wanted
