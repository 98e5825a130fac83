import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from revline.design.controllers.controller import PidGains
from revline.design.stability import loop_stability
from revline.design.stability.loop_equation import LoopEquation, form_loop
from revline.design.stability.loop_stability import (
    HighFrequencyUnstableLoop,
    StableLoop,
    UnstableLoop,
    count_unstable_poles,
    judge_loop_stability,
)
from revline.errors import AnalysisError, NotConvergedError
from revline.lti.polynomial import polynomial_roots
from revline.lti.transfer_function import TransferFunction

G1 = TransferFunction(numerator=(12.21634,), denominator=(1.0, 0.579381))
G2 = TransferFunction(numerator=(12.006617,), denominator=(1.0, 0.551588, 0.0343956))
G2D = G2.with_delay(0.0213)


def gains(kp: float, ki: float = 0.0, kd: float = 0.0) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="1", output_unit="1", rule="by hand", designed_on="test")


C1 = gains(2.1531268, 16.851782)
C2 = gains(20.0, 250.0, 0.4)
C2D = gains(1.2, 2.0, 0.1)


@pytest.mark.reference
@pytest.mark.parametrize(
    ("controller", "plant", "stable"),
    [
        (C1, G1, True),
        (C1, G2, True),
        (C1, G2D, False),
        (C2, G1, True),
        (C2, G2, True),
        (C2, G2D, False),
        (C2D, G2D, True),
        (C2D.scaled(kp=0.1), G2, True),
    ],
)
def test_controllers_of_the_thesis_are_stable_where_they_are_there(controller: PidGains, plant: TransferFunction, *, stable: bool) -> None:
    """Lee (1995), chapter 5: C1 and C2 diverge on G2d, all others settle; the integral gains illegible there are chosen here."""
    verdict = judge_loop_stability(plant, controller)
    assert verdict.stable is stable
    assert count_unstable_poles(plant, controller) == (0 if stable else 2)


def test_critical_gain_on_the_delayed_model() -> None:
    """With C1's ratio ki/kp = 7.83 per second G2d is stable up to kp = 1.026, and there a pole pair crosses the axis."""
    low, high = 0.5, 2.0
    while high - low > 1e-9:
        middle = (low + high) / 2.0
        low, high = (middle, high) if judge_loop_stability(G2D, gains(middle, 7.83 * middle)).stable else (low, middle)
    assert low == pytest.approx(1.026, abs=5e-4)
    phase_crossing = 1j * np.linspace(10.0, 40.0, 300001)
    open_loop = G2D(phase_crossing) * gains(1.0, 7.83).feedback_transfer(phase_crossing)
    at_crossing = open_loop[int(np.argmin(np.abs(np.angle(-open_loop))))]
    assert low == pytest.approx(1.0 / abs(at_crossing), rel=1e-5)


@pytest.mark.parametrize("delay", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("product", [0.5, 1.5, 1.6, 7.0, 8.0, 50.0, 500.0])
def test_delayed_integrator_has_its_closed_form_count(product: float, delay: float) -> None:
    """s + k exp(-s tau): a pair crosses to the right whenever k tau passes pi/2 + 2 pi m."""
    plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=delay)
    expected = 2 * (math.floor((product - math.pi / 2.0) / (2.0 * math.pi)) + 1)
    assert count_unstable_poles(plant, gains(product / delay)) == expected


@given(
    denominator=st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=4),
    numerator=st.floats(-3.0, 3.0),
    kp=st.floats(-3.0, 3.0),
    ki=st.floats(-3.0, 3.0),
    kd=st.floats(-0.3, 0.3),
)
def test_count_without_delay_is_that_of_the_polynomial_roots(
    denominator: list[float], numerator: float, kp: float, ki: float, kd: float
) -> None:
    assume(abs(numerator) > 0.1 and abs(ki) > 0.05)
    plant = TransferFunction(numerator=(numerator,), denominator=(1.0, *denominator, 0.7))
    controller = gains(kp, ki, kd)
    roots = polynomial_roots(form_loop(plant, controller).own)
    assume(np.min(np.abs(roots.real)) > 1e-5)
    assert count_unstable_poles(plant, controller) == np.count_nonzero(roots.real > 0.0)


@given(lag=st.floats(0.02, 2.0), kp=st.floats(0.1, 20.0), ki=st.floats(0.0, 40.0), kd=st.floats(-0.5, 0.5), delay=st.floats(0.01, 1.0))
def test_count_with_delay_is_that_of_a_dense_winding(lag: float, kp: float, ki: float, kd: float, delay: float) -> None:
    """The same count from a million points and unwrapped angles; with derivative action on a lag the equation is neutral."""
    plant = TransferFunction(numerator=(1.0,), denominator=(1.0, lag), delay=delay)
    controller = gains(kp, ki, kd * lag)
    loop = form_loop(plant, controller)
    grid = np.linspace(0.0, loop.frequency_beyond(math.inf), 200_001)
    values = loop.characteristic()(grid)
    assume(np.min(np.abs(values) / (1.0 + grid) ** loop.order) > 1e-3)
    angle = np.unwrap(np.angle(values))
    beyond = np.angle(values[-1] / (loop.own[-1] * (1j * grid[-1]) ** loop.order))
    count = loop.order / 2.0 - (angle[-1] - angle[0] - beyond) / math.pi
    assert count == pytest.approx(round(count), abs=1e-9)
    assert count_unstable_poles(plant, controller) == round(count)


def test_neutral_loop_is_stable_only_below_gain_one() -> None:
    """s + 1 + kd s exp(-s): stable for |kd| < 1, infinitely many unstable poles from 1 on."""
    plant = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=1.0)
    for kd in (0.5, -0.9, 0.99):
        verdict = judge_loop_stability(plant, gains(0.01, 0.0, kd))
        assert isinstance(verdict, StableLoop)
        assert verdict.high_frequency_gain == pytest.approx(abs(kd))
    verdict = judge_loop_stability(plant, gains(0.01, 0.0, 1.2))
    assert isinstance(verdict, HighFrequencyUnstableLoop)
    assert not verdict.stable
    with pytest.raises(AnalysisError, match=r"infinitely many poles are unstable: kd = 1.2 leaves a loop gain of 1.2 at infinite"):
        count_unstable_poles(plant, gains(0.01, 0.0, 1.2))


def test_without_delay_the_high_frequency_gain_is_told_but_not_counted() -> None:
    verdict = judge_loop_stability(G1, C2)
    assert isinstance(verdict, StableLoop)
    assert verdict.high_frequency_gain == pytest.approx(0.4 * 12.21634 / 0.579381)
    assert isinstance(judge_loop_stability(G1.with_delay(1e-4), C2), HighFrequencyUnstableLoop)


def test_no_gain_leaves_the_plant_as_it_is() -> None:
    nothing = gains(0.0)
    assert count_unstable_poles(G2D, nothing) == 0
    unstable = TransferFunction(numerator=(1.0,), denominator=(1.0, -3.0, 1.0), delay=0.2)
    verdict = judge_loop_stability(unstable, nothing)
    assert isinstance(verdict, UnstableLoop)
    assert verdict.unstable_poles == 2
    static = TransferFunction(numerator=(0.0,), denominator=(1.0,), delay=0.2)
    assert count_unstable_poles(static, gains(1.0)) == 0


def test_integral_action_on_a_plant_without_static_gain_is_marginal() -> None:
    plant = TransferFunction(numerator=(0.0, 1.0), denominator=(1.0, 2.0, 1.0), delay=0.1)
    with pytest.raises(NotConvergedError, match=r"a root lies on the imaginary axis at (0|\d.*e-\d+) rad/s"):
        judge_loop_stability(plant, gains(0.1, 0.1))


def test_a_count_that_is_no_whole_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_stability, "argument_change", lambda *_: 0.5)
    with pytest.raises(AnalysisError, match=r"counted 1.\d+ unstable poles, which is no whole number"):
        judge_loop_stability(G2D, C2D)


def test_scaling_of_time_changes_no_count() -> None:
    for scale in (1e-4, 1e4):
        plant = TransferFunction(
            numerator=G2D.numerator,
            denominator=tuple(c * scale**k for k, c in enumerate(G2D.denominator)),
            delay=G2D.delay * scale,
        )
        assert count_unstable_poles(plant, gains(2.1531268, 16.851782 / scale)) == 2
        assert count_unstable_poles(plant, gains(1.2, 2.0 / scale, 0.1 * scale)) == 0


def test_equations_are_read_only() -> None:
    loop = form_loop(G2D, C1)
    assert isinstance(loop, LoopEquation)
    with pytest.raises(ValueError, match="read-only"):
        loop.own[0] = 1.0
    assert replace(loop, delay=0.1).delay == 0.1
