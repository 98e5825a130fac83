"""Margins with exact delay: against closed forms, published values, and the critical gains of the thesis's engine."""

import math

import numpy as np
import pytest

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.stability import axis_grid
from revline.design.stability.margins import Margins, find_margins, find_margins_each
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model, open_loop_of_system
from revline.engine.lee1995 import lee1995
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError
from revline.lti.interconnection import to_state_space
from revline.lti.state_space import DelayStateSpace
from revline.lti.transfer_function import TransferFunction


def pid(kp: float, ki: float = 0.0, kd: float = 0.0, units: tuple[str, str] = ("1", "1")) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit=units[0], output_unit=units[1], rule="by hand", designed_on="test")


def speed_pid(kp: float, ki: float = 0.0, kd: float = 0.0) -> PidGains:
    return pid(kp, ki, kd, ("rad/s", "deg"))


@pytest.fixture(scope="module", params=[25.0, 30.0])
def engine_model(request: pytest.FixtureRequest) -> tuple[float, DelayStateSpace]:
    engine = lee1995()
    return request.param, linearize(engine, find_trim(engine, inputs={"throttle": request.param})).model


def test_a_slow_loop_with_integral_action_follows_at_rest() -> None:
    """Cancelling a lag of 600 s leaves exp(-50 s)/(650 s): with no peak above it, the closed loop's largest gain is that at rest, 1."""
    plant = TransferFunction(numerator=(12.0,), denominator=(1.0, 600.0), delay=50.0)
    found = find_margins(open_loop_of_model(plant, pid(600.0 / 12.0 / 650.0, 1.0 / 12.0 / 650.0)))
    assert found.complementary.value == pytest.approx(1.0, abs=1e-5)
    assert found.gain_crossovers[0].frequency == pytest.approx(1.0 / 650.0, rel=1e-6)


@pytest.mark.parametrize(("gain", "delay"), [(1.0, 0.3), (0.2, 5.0), (40.0, 0.01)])
def test_an_integrator_with_delay_has_its_closed_forms(gain: float, delay: float) -> None:
    """L = K exp(-s tau)/s: crosses 1 at K with 90 deg - K tau, and -180 deg at (4 k + 1) pi/(2 tau) with pi (4 k + 1)/(2 K tau)."""
    plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=delay)
    found = find_margins(open_loop_of_model(plant, pid(gain)))
    assert found.stable is (gain * delay < 0.5 * math.pi)
    assert [c.frequency for c in found.gain_crossovers] == [pytest.approx(gain, rel=1e-12)]
    phase = found.phase
    assert phase is not None
    assert phase.phase_margin_deg == pytest.approx(90.0 - math.degrees(gain * delay), abs=1e-10)
    assert phase.delay_margin == pytest.approx((0.5 * math.pi - gain * delay) / gain, rel=1e-10)
    first = found.phase_crossovers[:5]
    assert [c.frequency for c in first] == pytest.approx([(4 * k + 1) * math.pi / (2 * delay) for k in range(len(first))], rel=1e-12)
    assert [c.gain_margin for c in first] == pytest.approx([(4 * k + 1) * math.pi / (2 * gain * delay) for k in range(len(first))])
    omega = np.linspace(1e-3, 20.0, 400_000) * gain
    dense = np.max(1.0 / np.abs(1.0 + gain * np.exp(-1j * omega * delay) / (1j * omega)))
    assert found.sensitivity.value == pytest.approx(dense, rel=1e-6)


@pytest.mark.reference
def test_disk_margin_of_a_published_example() -> None:
    """L = 25/(s^3 + 10 s^2 + 10 s + 10): gain margin 3.6, phase margin 29.1 deg; disk: gain 0.6273 to 1.5942, phase 25.80 deg.

    Source: Seiler, Packard and Gahinet (2020), IEEE Control Systems Magazine 40(5), 78-95, the example of section "Disk margins".
    """
    plant = TransferFunction(numerator=(25.0,), denominator=(10.0, 10.0, 10.0, 1.0))
    found = find_margins(open_loop_of_model(plant, pid(1.0)))
    assert found.gain_rise is not None
    assert found.phase is not None
    assert found.gain_rise.gain_margin == pytest.approx(3.6, abs=1e-9)
    assert found.gain_rise.gain_margin_db == pytest.approx(20.0 * math.log10(3.6), abs=1e-9)
    assert found.phase.phase_margin_deg == pytest.approx(29.1, abs=0.05)
    alpha = found.disk_margin
    assert ((2.0 - alpha) / (2.0 + alpha), (2.0 + alpha) / (2.0 - alpha)) == pytest.approx((0.6273, 1.5942), abs=5e-5)
    assert 2.0 * math.degrees(math.atan(0.5 * alpha)) == pytest.approx(25.8017, abs=5e-4)


def test_a_disk_margin_is_no_larger_than_its_parts() -> None:
    plant = TransferFunction(numerator=(12.0149,), denominator=(1.0, 0.55104, 0.035517), delay=0.0214)
    found = find_margins(open_loop_of_model(plant, pid(1.2, 2.0, 0.1)))
    assert found.gain_rise is not None
    assert found.phase is not None
    alpha = found.disk_margin
    assert (2.0 + alpha) / (2.0 - alpha) <= found.gain_rise.gain_margin
    assert 2.0 * math.degrees(math.atan(0.5 * alpha)) <= found.phase.phase_margin_deg
    assert found.sensitivity.value >= 1.0 / (1.0 - 1.0 / found.gain_rise.gain_margin)


@pytest.mark.reference
def test_critical_gains_of_the_engine(engine_model: tuple[float, DelayStateSpace]) -> None:
    """Converged values of the engine of Lee (1995): proportional control alone, and with C1's ratio ki/kp."""
    angle, model = engine_model
    alone, frequency, with_integral = {25.0: (2.106, 29.8, 1.240), 30.0: (2.794, 38.0, 1.927)}[angle]
    found = find_margins(open_loop_of_system(model, speed_pid(1.0))).gain_rise
    assert found is not None
    assert found.gain_margin == pytest.approx(alone, abs=5e-4)
    assert found.frequency == pytest.approx(frequency, abs=0.05)
    c1 = find_margins(open_loop_of_system(model, speed_pid(1.0, 16.85 / 2.153))).gain_rise
    assert c1 is not None
    assert c1.gain_margin == pytest.approx(with_integral, abs=1e-3)


def test_the_loop_loses_stability_at_its_margins(engine_model: tuple[float, DelayStateSpace]) -> None:
    """The count of unstable roots, which knows nothing of margins, changes where these say."""
    _, model = engine_model
    gains = speed_pid(1.2, 2.0, 0.1)
    found = find_margins(open_loop_of_system(model, gains))
    assert found.stable
    assert found.gain_rise is not None
    edge = found.gain_rise.gain_margin
    for factor, unstable in ((0.999, 0), (1.001, 2)):
        scaled = speed_pid(*(factor * edge * k for k in (1.2, 2.0, 0.1)))
        assert open_loop_of_system(model, scaled).unstable_poles == unstable


def test_a_model_and_its_state_space_have_the_same_margins() -> None:
    plant = TransferFunction(
        numerator=(12.0149,), denominator=(1.0, 0.55104, 0.035517), delay=0.0214, input_unit="deg", output_unit="rad/s"
    )
    gains = speed_pid(1.2, 3.0)
    realised = to_state_space(plant, input_name="throttle", output_name="engine_speed")
    one, two = find_margins(open_loop_of_model(plant, gains)), find_margins(open_loop_of_system(realised, gains))
    assert [c.frequency for c in two.gain_crossovers] == pytest.approx([c.frequency for c in one.gain_crossovers], rel=1e-12)
    assert [c.gain_margin for c in two.phase_crossovers] == pytest.approx([c.gain_margin for c in one.phase_crossovers], rel=1e-9)
    assert two.sensitivity.value == pytest.approx(one.sensitivity.value, rel=1e-9)
    assert (one.stable, two.stable) == (True, True)


def test_a_dropped_delay_would_be_seen() -> None:
    """Negative control: without its delay the model has no gain margin at all."""
    plant = TransferFunction(numerator=(12.0149,), denominator=(1.0, 0.55104, 0.035517))
    assert find_margins(open_loop_of_model(plant, pid(1.2))).gain_rise is None
    assert find_margins(open_loop_of_model(plant.with_delay(0.0214), pid(1.2))).gain_rise is not None


def test_a_loop_that_needs_gain_has_a_lower_limit() -> None:
    """An unstable plant k/(s - 1) with delay is stable for gains between two limits; its lower one is 1 at rest."""
    plant = TransferFunction(numerator=(-1.0,), denominator=(1.0, -1.0), delay=0.1)
    found = find_margins(open_loop_of_model(plant, pid(3.0)))
    assert found.stable
    assert found.gain_rise is not None
    assert found.gain_rise.gain_margin > 1.0


def test_slow_integral_action_does_not_hide_its_crossover() -> None:
    """L = 1e-6 P/s crosses 1 at 1.2e-5 rad/s, far below where the search begins."""
    plant = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.5), delay=0.02)
    found = find_margins(open_loop_of_model(plant, pid(0.0, 1e-6)))
    assert found.phase is not None
    assert found.phase.frequency == pytest.approx(1.2e-5, rel=1e-6)
    assert found.phase.phase_margin_deg == pytest.approx(90.0, abs=0.01)


def test_an_ideal_derivative_on_one_lag_is_improper() -> None:
    plant = TransferFunction(numerator=(2.0,), denominator=(1.0, 1.0), delay=0.1)
    with pytest.raises(InvalidInputError, match=r"improper.*filter the derivative"):
        find_margins(open_loop_of_model(plant, pid(1.0, 0.0, 0.1)))
    assert open_loop_of_model(plant, pid(1.0, 0.0, 0.9)).unstable_poles == math.inf


def test_a_resonance_on_the_axis_and_a_loop_too_fast_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    def ringing(s: object) -> np.ndarray:
        points = np.asarray(s)
        return np.where(np.abs(points) < 1.0, np.inf, 1.0 / points**2)

    with pytest.raises(NotConvergedError, match="pole or a zero on the imaginary axis"):
        find_margins(OpenLoop(name="ringing", transfer=ringing, delay=0.0, unstable_poles=0))
    monkeypatch.setattr(axis_grid, "MOST_POINTS", 100)
    plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=1.0)
    with pytest.raises(NotConvergedError, match="turns too fast near"):
        find_margins(open_loop_of_model(plant, pid(1.0)))


def test_unfit_questions_are_refused() -> None:
    plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=1.0)
    for low in (0.0, 1e-300, 1e9, np.nan):
        with pytest.raises(InvalidInputError, match=r"lowest frequency = .* rad/s is outside 1e-100 to 1e\+09 rad/s"):
            find_margins(open_loop_of_model(plant, pid(1.0)), low=low)
    realised = to_state_space(plant, input_name="throttle", output_name="engine_speed")
    with pytest.raises(InvalidInputError, match=r"throttle is in 1 and the controller's gains are for deg"):
        open_loop_of_system(realised, speed_pid(1.0))
    silent = to_state_space(TransferFunction(numerator=(0.0,), denominator=(1.0, 1.0)), input_name="throttle", output_name="engine_speed")
    with pytest.raises(AnalysisError, match="no phase at high frequency"):
        open_loop_of_system(silent, pid(1.0))


@pytest.mark.parametrize("resonance", np.geomspace(3.0, 9.0, 12))
@pytest.mark.parametrize("excess", [1e-3, 1e-6])
def test_a_resonance_that_only_just_passes_1_has_both_its_crossovers(resonance: float, excess: float) -> None:
    """L = k w0^2/(s^2 + 2 z w0 s + w0^2) is 1 in size where ((w/w0)^2 - 1 + 2 z^2)^2 = k^2 - 4 z^2 (1 - z^2)."""
    z = 0.2
    top = 2.0 * z * math.sqrt(1.0 - z**2)
    gain = top * (1.0 + excess)
    plant = TransferFunction(numerator=(gain,), denominator=(1.0, 2.0 * z / resonance, 1.0 / resonance**2))
    found = [crossover.frequency for crossover in find_margins(open_loop_of_model(plant, pid(1.0))).gain_crossovers]
    spread = math.sqrt(gain**2 - top**2)
    assert found == pytest.approx([resonance * math.sqrt(1.0 - 2.0 * z**2 + side * spread) for side in (-1.0, 1.0)], rel=1e-8)
    below = TransferFunction(numerator=(top * (1.0 - excess),), denominator=plant.denominator)
    assert find_margins(open_loop_of_model(below, pid(1.0))).gain_crossovers == ()


@pytest.mark.parametrize("zero", np.geomspace(0.5, 2.0, 12))
@pytest.mark.parametrize("excess", [1e-3, 1e-6])
def test_a_phase_that_only_just_passes_180_degrees_has_both_its_crossovers(zero: float, excess: float) -> None:
    """L = (s + z)^2/(s^3 (s/p + 1)^2): its phase is -180 deg where w^2 - (p - z) w + z p = 0."""
    pole = (3.0 + math.sqrt(8.0)) * zero * (1.0 + excess)
    plant = TransferFunction(numerator=(zero**2, 2.0 * zero, 1.0), denominator=(0.0, 0.0, 0.0, 1.0, 2.0 / pole, pole**-2))
    found = [crossover.frequency for crossover in find_margins(open_loop_of_model(plant, pid(1.0))).phase_crossovers]
    middle = 0.5 * (pole - zero)
    spread = math.sqrt(middle**2 - zero * pole)
    assert found == pytest.approx([middle - spread, middle + spread], rel=1e-8)


def test_of_many_peaks_of_nearly_one_height_the_highest_is_told() -> None:
    """A resonance in the turns of a long delay: the eight largest points all lay beside lower peaks, and Ms was a fifth too small."""
    resonance, quality, gain, lift, delay = 22.1953, 0.0217, 0.9202, 1.0813, 15.3288
    poles = np.poly1d([1.0 / resonance**2, 2.0 * quality / resonance, 1.0]) * np.poly1d([0.0076, 1.0]) ** 4
    numerator = gain * np.array([1.0, 2.0 * quality * lift / resonance, 1.0 / resonance**2])
    plant = TransferFunction(numerator=tuple(numerator), denominator=tuple(poles.coefficients[::-1]), delay=delay)
    loop = open_loop_of_model(plant, pid(1.0))
    values = loop.transfer(1j * np.linspace(0.6, 1.4, 400_001) * resonance)
    found = find_margins(loop)
    assert float(np.max(1.0 / np.abs(1.0 + values))) <= found.sensitivity.value * (1.0 + 1e-9)
    assert float(np.max(np.abs(values / (1.0 + values)))) <= found.complementary.value * (1.0 + 1e-9)


def test_margins_found_together_are_those_found_alone() -> None:
    """A loop that has none is told in its own place: one that is improper, and one whose search fails between points of its grid."""
    plain = [TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034), delay=delay) for delay in (0.0, 0.021)]
    torn = OpenLoop(name="torn", transfer=_torn, delay=0.0, unstable_poles=0.0)
    loops = [open_loop_of_model(plain[0], pid(0.5, 1.0)), open_loop_of_model(plain[1], pid(0.5, 1.0, 0.01))]
    improper = OpenLoop(name="improper", transfer=lambda s: np.ones(np.shape(s), dtype=complex), delay=0.0, unstable_poles=0.0)
    found = find_margins_each([loops[0], improper, torn, loops[1]])
    for mine, loop in ((found[0], loops[0]), (found[3], loops[1])):
        alone = find_margins(loop)
        assert isinstance(mine, Margins)
        assert (mine.gain_crossovers, mine.phase_crossovers) == (alone.gain_crossovers, alone.phase_crossovers)
        assert (mine.sensitivity, mine.complementary, mine.disk) == (alone.sensitivity, alone.complementary, alone.disk)
    assert isinstance(found[1], InvalidInputError)
    assert isinstance(found[2], NotConvergedError)
    assert "no finite value near" in str(found[2])
    assert find_margins_each([]) == ()


def _torn(s: object) -> np.ndarray:
    """A loop that has values on a grid, but none where its peak is sought."""
    points = np.asarray(s, dtype=complex)
    values = 1.0 / (points * (1.0 + 0.2 * points) * (1.0 + 0.1 * points))
    return np.full(points.shape, np.nan) if points.size < 60 and np.all(np.abs(points) > 0.01) else values
