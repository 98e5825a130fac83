"""The relay experiment, its prediction from the exact model, and the ultimate point by every way."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.controller import PidGains
from revline.design.plants.loop_signals import operating_point
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model
from revline.design.tuning.relay import RelayTask, predict_relay, run_relay
from revline.design.tuning.tuning_plant import tuning_plant
from revline.design.tuning.ultimate import UltimatePoint, UltimateSource, find_ultimate_point
from revline.design.tuning.ultimate_comparison import compare_ultimate_points
from revline.engine.lee1995 import lee1995
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError, NotSettledError
from revline.lti.transfer_function import TransferFunction

UNIT = PidGains(kp=1.0, ki=0.0, kd=0.0, input_unit="1", output_unit="1", rule="proportional", designed_on="a model")


def trim(throttle: float = 25.0) -> Trim:
    return find_trim(lee1995(), inputs={"throttle": throttle})


def model(**changes: Any) -> TransferFunction:
    return replace(TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=0.2), **changes)


def loop_at(plant: TransferFunction) -> Callable[[float], OpenLoop]:
    return lambda kp: open_loop_of_model(plant, UNIT.scaled(kp=kp))


def test_an_integrator_with_delay_has_its_closed_form() -> None:
    """G = exp(-L s)/s: the ultimate gain is pi/(2 L), the period 4 L."""
    found = find_ultimate_point(loop_at(model()))
    assert found.gain == pytest.approx(math.pi / 0.4, rel=1e-9)
    assert found.period == pytest.approx(0.8, rel=1e-9)
    assert found.frequency == pytest.approx(2.0 * math.pi / 0.8)


def test_a_relay_around_an_integrator_with_delay_makes_a_triangle() -> None:
    """The relay switches L after the output passes zero: slopes of +-d for 2 L each, so that the period is 4 L and the amplitude d L."""
    found = predict_relay(lambda s: np.exp(-0.2 * s) / s, 3.0, 2.0 * math.pi / 0.8)
    assert found.period == pytest.approx(0.8, rel=1e-6)
    assert found.amplitude == pytest.approx(0.6, rel=2e-3)
    assert found.gain == pytest.approx(4.0 * 3.0 / (math.pi * 0.6), rel=2e-3)
    with_hysteresis = predict_relay(lambda s: np.exp(-0.2 * s) / s, 3.0, 6.0, hysteresis=0.15)
    assert with_hysteresis.amplitude == pytest.approx(0.75, rel=2e-3)
    assert with_hysteresis.period == pytest.approx(4.0 * 0.25, rel=1e-5)


def test_a_lag_with_delay_under_a_relay_is_the_textbooks() -> None:
    """K/(T s + 1) exp(-L s): amplitude K d (1 - exp(-L/T)), period 2 T ln(2 exp(L/T) - 1). Source: Astrom and Hagglund (2006), 2.7."""
    gain, lag, delay, size = 2.0, 0.5, 0.3, 1.5
    found = predict_relay(lambda s: gain * np.exp(-delay * s) / (lag * s + 1.0), size, 6.0)
    assert found.period == pytest.approx(2.0 * lag * math.log(2.0 * math.exp(delay / lag) - 1.0), rel=1e-5)
    assert found.amplitude == pytest.approx(gain * size * (1.0 - math.exp(-delay / lag)), rel=2e-3)


def test_the_engine_under_a_relay_is_foretold_by_its_exact_model_and_off_its_ultimate_gain() -> None:
    """The small relay agrees with Tsypkin's condition, not with the describing function: the bias is the harmonics'."""
    found = compare_ultimate_points(lee1995(), trim(), RelayTask(amplitude=0.5, until=8.0), command=0.1)
    assert found.exact.gain == pytest.approx(2.1064, abs=2e-4)
    assert found.predicted.gain == pytest.approx(1.9625, abs=5e-4)
    assert found.relay.ultimate.gain == pytest.approx(found.predicted.gain, rel=3e-3)
    assert found.relay.period == pytest.approx(found.predicted.period, rel=2e-3)
    assert found.relay.ultimate.gain < 0.95 * found.exact.gain
    assert found.relay.gain_by_fundamental == pytest.approx(found.relay.ultimate.gain, rel=0.02)
    assert found.bisection.gain == pytest.approx(found.sampled.gain, rel=0.01)
    assert found.sampled.gain == pytest.approx(2.064, abs=2e-3)
    assert found.bisection.source is UltimateSource.BISECTION
    assert re.match(r"the relay reads -6\.[78] % off the exact gain: -6\.8 % because its square wave has harmonics", found.reasons[0])
    small = found.without_hysteresis.gain
    assert small == pytest.approx(found.predicted.gain, rel=1e-12)
    wide = replace(found.relay, task=replace(found.relay.task, hysteresis=0.1))
    told = replace(found, predicted=found.predicted._replace(gain=0.7 * small), relay=wide).reasons[0]
    assert re.search(r"-6\.8 % because its square wave has .* -30\.0 % because of its hysteresis of 0\.1, ", told)
    assert re.match(r"the bisection is -[12]\.\d % off: -2\.0 % because its loop samples every 1 ms", found.reasons[1])


def test_a_bisection_that_ends_otherwise_than_by_hunting_is_no_ultimate_gain() -> None:
    """A command out of reach keeps the throttle at its limit: the period of that is no ultimate period."""
    with pytest.raises(
        AnalysisError, match=r"finds no hunting of lee1995 after a step of 600: at a gain of .* its output stays at a limit"
    ):
        compare_ultimate_points(lee1995(), trim(), RelayTask(amplitude=0.5, until=4.0), command=600.0)


def test_a_large_relay_shows_the_engines_nonlinearity() -> None:
    point = operating_point(trim())
    small, large = (run_relay(lee1995(), point, RelayTask(amplitude=size)) for size in (1.0, 8.0))
    assert abs(small.mean_shift) < 0.05
    assert large.mean_shift > 0.3
    assert abs(large.duty - 0.5) > 0.03


@pytest.mark.parametrize(
    ("run", "error", "message"),
    [
        (
            lambda: UltimatePoint(gain=-1.0, period=1.0, source=UltimateSource.GIVEN),
            InvalidInputError,
            "ultimate gain = -1 is outside the",
        ),
        (lambda: RelayTask(amplitude=0.0), InvalidInputError, "relay's amplitude = 0 is outside the positive numbers"),
        (lambda: RelayTask(amplitude=1.0, step=0.0), InvalidInputError, "time step = 0 s is outside the positive numbers"),
        (lambda: RelayTask(amplitude=1.0, hysteresis=-1.0), InvalidInputError, "relay's hysteresis = -1 is outside 0 and above"),
        (
            lambda: run_relay(lee1995(), operating_point(trim()), RelayTask(amplitude=40.0)),
            InvalidInputError,
            "relay's amplitude = 40 deg is outside 0 to 25 deg at 25 deg; give a smaller one",
        ),
        (
            lambda: run_relay(lee1995(), operating_point(trim()), RelayTask(amplitude=1.0, until=1.0)),
            NotSettledError,
            r"the relay made \d cycles in 1 s and 7 are needed; let it run longer",
        ),
        (
            lambda: run_relay(lee1995(), operating_point(trim()), RelayTask(amplitude=5.0, until=1.8)),
            NotSettledError,
            r"the last 6 cycles under the relay differ by .* let it run longer than 1.8 s",
        ),
        (
            lambda: run_relay(lee1995(), operating_point(trim()), RelayTask(amplitude=1e-8, until=3.0)),
            NotSettledError,
            r"the output moves by .* under the relay, no more than its hysteresis or what rounding leaves at 240.799; give a larger relay",
        ),
        (
            lambda: compare_ultimate_points(lee1995(), trim(), RelayTask(amplitude=0.5, until=4.0), command=1e6),
            AnalysisError,
            "finds no hunting of lee1995 after a step of 1e.06: .* give a smaller step",
        ),
        (lambda: predict_relay(lambda s: 1.0 / (s + 1.0), 0.0, 1.0), InvalidInputError, "relay's amplitude = 0 is outside"),
        (
            lambda: predict_relay(lambda s: 1.0 / (s + 1.0), 1.0, 5.0),
            NotConvergedError,
            "no oscillation under this relay between 2.5 and 10",
        ),
        (
            lambda: find_ultimate_point(loop_at(model(denominator=(1.0, 1.0), delay=0.0))),
            AnalysisError,
            "under proportional.* has no ultimate gain: its phase never reaches -180 degrees",
        ),
    ],
)
def test_what_gives_no_ultimate_point_is_refused(run: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        run()


def test_a_loop_without_an_upper_limit_is_refused() -> None:
    """An unstable lag is held by any gain above a least one."""
    unstable = model(denominator=(-1.0, 1.0, 0.001), delay=0.0, numerator=(3.0,))
    with pytest.raises(AnalysisError, match="no ultimate gain"):
        find_ultimate_point(loop_at(unstable))


@pytest.mark.parametrize("delay", [0.01, 1e-4])
def test_a_short_delay_has_an_ultimate_gain_too(delay: float) -> None:
    """Far above the gain at rest: where atan(w) + w L is pi, the gain is |1 + j w|."""
    turn = brentq(lambda w: math.atan(w) + w * delay - math.pi, 1.0, 4.0 / delay, xtol=1e-9)
    found = tuning_plant(model(denominator=(1.0, 1.0), delay=delay), name="a lag").ultimate
    assert (found.gain, found.period) == pytest.approx((math.hypot(1.0, turn), 2.0 * math.pi / turn), rel=1e-9)


def test_an_unstable_plant_has_the_upper_end_of_its_stabilising_gains_or_none() -> None:
    """2 exp(-0.1 s)/(s - 1) is stable for gains from 0.5 up to |j w - 1|/2 where atan(w) = 0.1 w; with the sign turned for none."""
    turn = brentq(lambda w: math.atan(w) - 0.1 * w, 1.0, 20.0, xtol=1e-12)
    held = tuning_plant(model(numerator=(2.0,), denominator=(-1.0, 1.0), delay=0.1), name="it")
    assert held.ultimate.gain == pytest.approx(0.5 * math.hypot(1.0, turn), rel=1e-9)
    with pytest.raises(AnalysisError, match="no ultimate gain: there is none up to which it is stable"):
        _ = tuning_plant(model(numerator=(1.0,), denominator=(1.0, -1.0), delay=0.1), name="it").ultimate


def test_a_plant_that_integrates_or_rests_at_0_has_its_ultimate_gain() -> None:
    assert tuning_plant(model(), name="an integrator").ultimate.gain == pytest.approx(math.pi / 0.4, rel=1e-9)
    turn = brentq(lambda w: math.pi / 2.0 - 2.0 * math.atan(w) - 0.2 * w + math.pi, 2.0, 40.0, xtol=1e-12)
    washed = tuning_plant(model(numerator=(0.0, 1.0), denominator=(1.0, 2.0, 1.0)), name="a plant")
    assert washed.ultimate.gain == pytest.approx((1.0 + turn**2) / turn, rel=1e-9)
