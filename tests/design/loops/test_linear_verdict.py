"""The verdict on the linear loop beside a run: its counts, and the gains that would mend it."""

import math
from dataclasses import replace

import pytest
from scipy.optimize import brentq

from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, PidController
from revline.design.loops.linear_verdict import judge_linear_model, judge_linear_system
from revline.engine.lee1995 import lee1995
from revline.lti.transfer_function import TransferFunction
from revline.sampled import CrankSynchronous, FixedRate
from revline.system import DelaySystem
from tests.design.examples import C2D


def law(kp: float, ki: float = 0.0, kd: float = 0.0) -> PidController:
    gains = PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="nothing")
    return PidController(gains=gains, anti_windup=AntiWindup.NONE)


def model(*denominator: float, delay: float = 0.0) -> TransferFunction:
    return TransferFunction(numerator=(1.0,), denominator=denominator, delay=delay, input_unit="deg", output_unit="rad/s")


@pytest.fixture(scope="module")
def trimmed() -> tuple[DelaySystem, Trim]:
    plant = lee1995()
    return plant, find_trim(plant, inputs={"throttle": 25.0})


@pytest.mark.reference
def test_c1_lacks_the_margin_that_is_known(trimmed: tuple[DelaySystem, Trim]) -> None:
    """C1 of Lee (1995) has kp = 2.153, and the exact linear engine stands 1.240 with its ratio of gains."""
    found = judge_linear_system(*trimmed, law(2.153, 16.85))
    assert (found.stable, found.unstable_poles) == (False, 2.0)
    assert found.stable_range is not None
    assert found.stable_range[0] == 0.0
    assert found.stable_range[1] == pytest.approx(1.240 / 2.153, abs=5e-4)
    assert "unstable, with 2 poles right of the imaginary axis; it would be stable below 0.576" in found.warning
    assert "(gain margin -4.79 dB)" in found.warning


def test_a_sampled_loop_is_judged_as_its_samples_see_it(trimmed: tuple[DelaySystem, Trim]) -> None:
    """C2d is stable, each 10 ms still, and at every half turn of the crank, 13 ms at this speed, no more."""
    stable = PidController(gains=C2D, sampling=FixedRate(period=0.01))
    found = judge_linear_system(*trimmed, stable)
    assert (found.stable, found.warning, found.stable_range) == (True, "", None)
    assert found.margins is not None
    assert found.margins.gain_rise is not None
    assert found.margins.gain_rise.gain_margin == pytest.approx(1.0715, abs=5e-4)
    assert found.slow == ""
    slow = judge_linear_system(*trimmed, replace(stable, sampling=FixedRate(period=0.03)))
    assert "the controller samples every 0.03 s, longer than the plant's delay of 0.0228 s" in slow.slow
    crank = judge_linear_system(*trimmed, replace(stable, sampling=CrankSynchronous(angle=math.pi)))
    assert "with 2 poles outside the unit circle, as its samples see it; it would be stable below 0.99" in crank.warning


def test_gains_that_are_too_small_for_an_unstable_plant_are_told_so() -> None:
    """1/(s - 1) with a delay of 0.1 s under kp is stable from 1 on, up to where the delay makes it oscillate."""
    plant = model(-1.0, 1.0, delay=0.1)
    found = judge_linear_model(plant, law(0.5))
    omega = float(brentq(lambda w: math.tan(0.1 * w) - w, 1.0, 0.499 * math.pi / 0.1))  # the phase is -180 degrees there
    highest = math.hypot(1.0, omega)
    assert found.unstable_poles == 1.0
    assert found.stable_range is not None
    assert list(found.stable_range) == pytest.approx([2.0, 2.0 * highest], rel=1e-6)
    assert f"it would be stable with 2 to {2.0 * highest:.4g} times its gains (gain margin 6.02 dB)" in found.warning
    hot = judge_linear_model(plant, law(2.0 * highest))
    assert hot.stable_range is not None
    assert list(hot.stable_range) == pytest.approx([0.5 / highest, 0.5], rel=1e-6)
    assert "times its gains (gain margin -6.02 dB)" in hot.warning
    sampled = replace(law(0.5), sampling=FixedRate(period=0.01))
    of_samples = judge_linear_model(model(-1.0, 0.99, 0.01, delay=0.1), sampled).stable_range
    assert of_samples is not None
    assert of_samples[0] == pytest.approx(2.0)
    assert 0.5 * highest < of_samples[1] < 2.0 * highest


def test_what_no_factor_mends_and_what_has_no_margins_is_told_so() -> None:
    wrong = judge_linear_model(model(1.0, 1.0, delay=0.1), law(0.5, -0.5))
    assert "no common factor of its gains was found to mend it" in wrong.warning
    ideal = judge_linear_model(model(1.0, 1.0, delay=0.1), law(0.5, 0.5, 1.5))
    assert ideal.unstable_poles == math.inf
    assert ideal.margins is None
    assert ideal.warning == "the linear loop at the operating point is unstable, with infinitely many poles right of the imaginary axis"
    nothing = judge_linear_model(model(1.0, 1.0, delay=0.1), law(0.0))
    assert (nothing.stable, nothing.warning) == (True, "")
    sampled = replace(law(0.5, 0.5), sampling=FixedRate(period=0.05))
    assert judge_linear_model(model(1.0, 2.0, 1.0, delay=0.1), sampled).stable


def test_the_crossing_at_half_the_sampling_frequency_is_one(trimmed: tuple[DelaySystem, Trim]) -> None:
    """The loop is real there in any case; a root of its phase that the cut-off sum puts just below is the same crossing."""
    found = judge_linear_system(*trimmed, replace(law(0.4, 0.66), sampling=FixedRate(period=0.3)))
    assert found.unstable_poles == 1.0
    assert found.margins is not None
    (only,) = found.margins.phase_crossovers
    assert only.frequency == pytest.approx(math.pi / 0.3)
    assert found.stable_range == (0.0, only.gain_margin)
