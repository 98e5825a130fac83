"""Contours of the peak sensitivity: against the margins' own search, a closed form, and a scan of the whole plane."""

import numpy as np
import pytest

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.regions import sensitivity_contour
from revline.design.regions.gain_curve import Contour
from revline.design.regions.gain_region import GainRegion, Window, find_gain_region
from revline.design.regions.loop_family import family_of_model, family_of_system
from revline.design.regions.sensitivity_contour import find_peaks, find_sensitivity_contour
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import open_loop_of_model, open_loop_of_system
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.lti.state_space import DelayStateSpace
from revline.lti.transfer_function import TransferFunction

G2D = TransferFunction(numerator=(12.0066,), denominator=(1.0, 0.55159, 0.034396), delay=0.0213)


def pid(kp: float, ki: float, kd: float, units: tuple[str, str] = ("1", "1")) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit=units[0], output_unit=units[1], rule="by hand", designed_on="test")


@pytest.fixture(scope="module")
def engine_model() -> DelayStateSpace:
    engine = lee1995()
    return linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model


@pytest.fixture(scope="module")
def g2d_region() -> GainRegion:
    return find_gain_region(family_of_model(G2D, kd=0.05))


@pytest.mark.parametrize("peak", [1.4, 1.7, 2.0, 3.0])
def test_margins_find_the_peak_at_points_of_the_contour(g2d_region: GainRegion, peak: float) -> None:
    found = find_sensitivity_contour(g2d_region, peak)
    assert found.omega.size > 100
    for k in range(0, found.omega.size, found.omega.size // 12):
        margins = find_margins(open_loop_of_model(G2D, pid(found.kp[k], found.ki[k], 0.05)))
        assert margins.stable
        assert margins.sensitivity.value == pytest.approx(peak, rel=2e-7)
    assert found.deviation < 1e-6


def test_margins_find_the_peak_on_the_engine(engine_model: DelayStateSpace) -> None:
    region = find_gain_region(family_of_system(engine_model))
    found = find_sensitivity_contour(region, 1.7)
    for k in range(0, found.omega.size, found.omega.size // 4):
        loop = open_loop_of_system(engine_model, pid(found.kp[k], found.ki[k], 0.0, ("rad/s", "deg")))
        margins = find_margins(loop)
        assert margins.stable
        assert margins.sensitivity.value == pytest.approx(1.7, rel=1e-7)
        if margins.sensitivity.frequency == pytest.approx(found.omega[k], rel=1e-2):
            continue
        assert abs(1.0 / (1.0 + loop.transfer(1j * found.omega[k]))) == pytest.approx(1.7, rel=1e-7)  # a corner: two peaks alike


def test_an_integrator_with_delay_has_its_known_gain() -> None:
    """P = exp(-s tau)/s: the contour meets ki = 0 at the kp whose Ms the margins confirm, and scales as 1/tau and 1/tau^2."""
    ends = []
    for delay in (0.2, 0.4):
        plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=delay)
        found = find_sensitivity_contour(find_gain_region(family_of_model(plant)), 2.0)
        best = int(np.argmax(found.ki))
        ends.append((found.kp[best] * delay, found.ki[best] * delay**2, found.omega[best] * delay))
    assert ends[0] == pytest.approx(ends[1], rel=0.01)
    assert ends[0][1] == pytest.approx(ends[1][1], rel=1e-4)  # the largest ki is stationary


def test_a_scan_of_the_plane_sees_the_same_inside(g2d_region: GainRegion) -> None:
    """Of random gains, those with a smaller peak lie where the contour says: below it at their kp."""
    found = find_sensitivity_contour(g2d_region, 2.0)
    generator = np.random.default_rng(3)
    kp, ki = generator.uniform(found.kp.min(), found.kp.max(), 300), generator.uniform(0.05, 16.0, 300)
    stable = g2d_region.stabilises(kp, ki)
    low = stable & (find_peaks(g2d_region, kp, ki) < 2.0)
    order = np.argsort(found.kp)
    top = np.interp(kp, found.kp[order], found.ki[order])
    clear = np.abs(ki - top) > 0.1
    assert np.array_equal(low[clear], (ki < top)[clear])
    assert 50 < np.sum(low) < 250


def test_contours_lie_in_one_another_and_in_the_region(g2d_region: GainRegion) -> None:
    tops = [float(np.max(find_sensitivity_contour(g2d_region, peak).ki)) for peak in (1.4, 2.0, 4.0, 30.0)]
    assert tops == sorted(tops)
    assert tops[-1] < np.max(g2d_region.ki[g2d_region.rim])
    assert tops[-1] > 0.93 * np.max(g2d_region.ki[g2d_region.rim])


def test_where_no_gains_are_so_gentle_there_is_no_contour(engine_model: DelayStateSpace) -> None:
    """With kd = 0.1 the derivative alone lets the engine's sensitivity rise above 2."""
    region = find_gain_region(family_of_system(engine_model, kd=0.1))
    assert find_sensitivity_contour(region, 1.4).omega.size == 0
    assert find_peaks(region, [], []).size == 0


def test_a_wrong_envelope_would_be_seen(g2d_region: GainRegion, monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: with wrong slopes of q another frequency has the peak at the points, and all but those near the origin go."""
    right = find_sensitivity_contour(g2d_region, 2.0)
    monkeypatch.setattr(sensitivity_contour, "RADIUS", 0.9)
    monkeypatch.setattr(sensitivity_contour, "NODES", 1)
    assert np.max(find_sensitivity_contour(g2d_region, 2.0).ki) < 0.01 * np.max(right.ki)


def test_unfit_questions_are_refused(g2d_region: GainRegion) -> None:
    with pytest.raises(InvalidInputError, match=r"peak of the sensitivity = 1 .*1\.4, 1\.7 or 2"):
        find_sensitivity_contour(g2d_region, 1.0)
    window = Window(kp_low=-0.5, kp_high=5.0, ki_high=50.0)
    damped = find_gain_region(family_of_model(G2D, contour=Contour(damping=0.1, up_to=30.0)), window)
    with pytest.raises(InvalidInputError, match="asked for in a region of damping"):
        find_sensitivity_contour(damped, 2.0)
