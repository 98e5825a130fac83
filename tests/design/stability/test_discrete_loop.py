"""Margins of sampled loops against sums in time, against the circle's closed forms, and against simulated loops at their limit."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import PidController
from revline.design.stability.discrete_loop import SampledLoop, find_discrete_margins, sampled_plant_of_model, sampled_plant_of_system
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import open_loop_of_model
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.sampled import CrankSynchronous, FixedRate
from tests.design.examples import C2D, delayed_lag

PERIOD = 0.02
LAG = delayed_lag(0.033)
SECOND = replace(LAG, denominator=(1.0, 0.55, 0.034))
PROPORTIONAL = PidGains(kp=0.3, ki=0.0, kd=0.0, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a lag")
PI = replace(PROPORTIONAL, ki=0.8)


def sampled(gains: PidGains = PI, period: float = PERIOD, **changes: Any) -> PidController:
    sampling = FixedRate(period=period, computation_delay=changes.pop("computation", 0.0))
    return PidController(gains=gains, sampling=sampling, **changes)


def critical_gain_by_roots(period: float, delay: float) -> tuple[float, float]:
    """Gain and frequency at which a lag under sampled proportional control has roots on the unit circle, from its polynomial.

    y[n+1] = a y[n] + b1 u[n-d] + b2 u[n-d-1] with the delay (d + m) periods; the limit is bisected on the largest root.
    """
    whole = math.floor(delay / period + 1e-9)
    part = delay - whole * period
    decay = math.exp(-period / 0.5)
    newer, older = 12.0 * (1.0 - math.exp(-(period - part) / 0.5)), 12.0 * (math.exp(-(period - part) / 0.5) - decay)

    def largest(gain: float) -> tuple[float, float]:
        coefficients = np.zeros(whole + 3)
        coefficients[0], coefficients[1] = 1.0, -decay
        coefficients[-2] += gain * newer
        coefficients[-1] += gain * older
        roots = np.roots(coefficients)
        worst = roots[np.argmax(np.abs(roots))]
        return float(abs(worst)), abs(float(np.angle(worst))) / period

    low, high = 0.0, 100.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest(middle)[0] < 1.0 else (low, middle)
    return low, largest(low)[1]


@pytest.mark.parametrize(
    ("period", "computation"), [(0.02, 0.0), (0.05, 0.0), (0.0165, 0.0), (0.02, 0.011), (0.05, 0.011), (0.0165, 0.011), (0.02, 0.007)]
)
def test_the_gain_margin_of_a_sampled_lag_is_where_its_polynomial_has_roots_on_the_unit_circle(period: float, computation: float) -> None:
    gain, frequency = critical_gain_by_roots(period, LAG.delay + computation)
    found = find_discrete_margins(sampled_plant_of_model(LAG), sampled(PROPORTIONAL, period, computation=computation))
    rise = found.margins.gain_rise
    assert rise is not None
    assert rise.gain_margin * PROPORTIONAL.kp == pytest.approx(gain, rel=1e-8)
    assert rise.frequency == pytest.approx(frequency, rel=1e-7)
    assert found.equivalent_delay == pytest.approx(period / 2.0 + computation)
    for factor, stable in ((0.99, True), (1.01, False)):
        near = sampled(replace(PROPORTIONAL, kp=factor * gain), period, computation=computation)
        margins = find_discrete_margins(sampled_plant_of_model(LAG), near).margins
        assert margins.stable is stable
        assert margins.unstable_poles == (0.0 if stable else 2.0)


def test_the_plant_behind_the_hold_is_the_sum_of_its_pulse_response() -> None:
    """What the aliases add up to is the transform of the samples of the answer to one held sample."""
    plant = sampled_plant_of_model(SECOND)
    unit = replace(PROPORTIONAL, kp=1.0)
    loop = SampledLoop(plant.transfer, sampled(unit), PERIOD, 0.0)
    times = PERIOD * np.arange(4000)
    steps = replace(SECOND, delay=0.0).step_response(np.maximum(times - SECOND.delay, 0.0))
    pulse = steps - np.concatenate([[0.0], steps[:-1]])
    omega = np.array([0.5, 10.0, 60.0, 0.999 * math.pi / PERIOD])
    wanted = np.exp(-1j * np.outer(omega, times)) @ pulse
    assert loop(omega) == pytest.approx(wanted, rel=1e-5)
    assert 0.0 < loop.left_out < 1e-5
    closed = SampledLoop(plant.transfer, sampled(unit), PERIOD, 0.0, held=plant.held)
    assert closed(omega) == pytest.approx(wanted, rel=1e-9)
    assert closed.left_out == 0.0


def test_fast_sampling_gives_the_continuous_margins_and_their_distance_falls_with_the_period() -> None:
    plant = sampled_plant_of_model(SECOND)
    wanted = find_margins(open_loop_of_model(SECOND, PI)).sensitivity.value
    errors = [find_discrete_margins(plant, sampled(period=period)).margins.sensitivity.value - wanted for period in (4e-3, 2e-3)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)
    shifted = replace(SECOND, delay=SECOND.delay + 2e-3)
    nearer = find_margins(open_loop_of_model(shifted, PI)).sensitivity.value
    assert abs(errors[0] + wanted - nearer) < 0.35 * errors[0]


def test_the_engine_sampled_loses_what_the_delay_of_sampling_takes() -> None:
    """C2d has a gain margin of 1.50 without sampling; every 10 ms hardly 1.07. By the crank it is that of the period at this speed."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    plant = sampled_plant_of_system(linearize(engine, trim).model)
    found = find_discrete_margins(plant, sampled(C2D, 0.01))
    rise = found.margins.gain_rise
    assert rise is not None
    assert rise.gain_margin == pytest.approx(1.0715, abs=5e-4)
    assert found.left_out < 1e-5
    speed = trim.output("engine_speed")
    crank = PidController(gains=C2D, sampling=CrankSynchronous(angle=0.01 * speed))
    assert find_discrete_margins(plant, crank, speed=speed).margins.sensitivity.value == pytest.approx(found.margins.sensitivity.value)


def test_an_unstable_plant_and_a_high_gain_are_counted() -> None:
    unstable = replace(LAG, denominator=(-1.0, 0.5), numerator=(12.0,))
    plant = sampled_plant_of_model(unstable)
    assert plant.unstable_poles == 1
    held = find_discrete_margins(plant, sampled(PROPORTIONAL, 0.005)).margins
    assert held.stable
    weak = find_discrete_margins(plant, sampled(replace(PROPORTIONAL, kp=0.05), 0.005)).margins
    assert (weak.stable, weak.unstable_poles) == (False, 1.0)
    filtered = sampled(replace(PI, kd=0.05), filter_time=0.02)
    assert find_discrete_margins(sampled_plant_of_model(SECOND), filtered).margins.stable


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (lambda: find_discrete_margins(sampled_plant_of_model(LAG), PidController(gains=PI)), "a continuous controller has no samples"),
        (
            lambda: find_discrete_margins(sampled_plant_of_model(LAG), PidController(gains=PI, sampling=CrankSynchronous(angle=3.0))),
            "sampling by the crank's angle has a period at a speed only; give the speed",
        ),
        (lambda: sampled_plant_of_model(replace(LAG, numerator=(1.0, 1.0))), "model has as many zeros as poles or more"),
        (lambda: sampled_plant_of_model(replace(LAG, denominator=(0.0, 1.0))), "model has a pole on the imaginary axis, an integrator"),
        (
            lambda: find_discrete_margins(sampled_plant_of_model(LAG), sampled(replace(PI, input_unit="rpm"))),
            "the controller has the measurement in rpm and model in rad/s; convert the gains",
        ),
        (
            lambda: find_discrete_margins(
                replace(sampled_plant_of_model(replace(LAG, denominator=(1.0, 1e-6))), held=None), sampled(PROPORTIONAL, 0.5)
            ),
            "sampling period = 0.5 s is outside periods at which the sum over 5120 aliases settles to 0.0001",
        ),
    ],
)
def test_what_has_no_sampled_margins_is_refused(run: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        run()
