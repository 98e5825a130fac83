"""How sampled loops end, against the continuous loop, the exact margins of the samples, and what must hold of any run."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from revline import signals
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, Continuous, PidController
from revline.design.loops.closed_loop import run_loop
from revline.design.loops.load_response import LoadStep, measure_load_response
from revline.design.loops.loop_run import Limits, LoopTask, describe_form
from revline.design.loops.outcome import Diverged, LimitCycle, Settled, Stalled
from revline.design.loops.sampled_loop import Disturbance
from revline.design.loops.sampled_step import SampledStep, run_sampled_linear_step, run_sampled_step
from revline.design.plants.loop_signals import OperatingPoint, operating_point
from revline.design.stability.discrete_loop import find_discrete_margins, sampled_plant_of_model
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, NotSettledError
from revline.sampled import CrankSynchronous, FixedRate
from revline.system import DelaySystem
from tests.design.examples import C2D, delayed_lag

MODEL = delayed_lag(0.0213)
GAINS = PidGains(kp=0.8, ki=1.5, kd=0.005, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a lag")
NOISE = Disturbance(noise=0.2, jitter=1e-4, seed=4)


@pytest.fixture(scope="module")
def engine() -> tuple[DelaySystem, OperatingPoint]:
    plant = lee1995()
    return plant, operating_point(find_trim(plant, inputs={"throttle": 25.0}))


def sampled(gains: PidGains = C2D, period: float = 0.005, **changes: Any) -> PidController:
    values: dict[str, Any] = {"low": 0.0, "high": 79.46, "sampling": FixedRate(period=period)}
    return PidController(gains=gains, **values | changes)


def on_model(controller: PidController, **changes: Any) -> SampledStep:
    values: dict[str, Any] = {"command": 10.0, "until": 8.0, "step": 2e-3}
    disturbance = changes.pop("disturbance", None)
    return run_sampled_linear_step(MODEL, controller, LoopTask(**values | changes), name="lag", disturbance=disturbance)


def test_sampled_each_millisecond_it_ends_as_the_continuous_loop(engine: tuple[DelaySystem, OperatingPoint]) -> None:
    plant, point = engine
    task = LoopTask(command=10.0, until=8.0)
    wanted = run_loop(plant, point, C2D, task, limits=Limits(0.0, 79.46))
    found = run_sampled_step(plant, point, sampled(period=0.001, anti_windup=AntiWindup.NONE), task)
    assert isinstance(found.run.outcome, Settled)
    assert found.run.overshoot == pytest.approx(wanted.overshoot, abs=0.01)
    assert found.run.measures().settling_time == pytest.approx(wanted.measures().settling_time, abs=0.02)
    assert (found.equivalent_delay, found.disturbed, found.notes) == (0.0005, None, ())
    samples = found.samples
    assert samples.wanted == pytest.approx(25.0 + samples.terms.sum(axis=1), abs=1e-9)
    assert np.array_equal(samples.windup, samples.wanted - np.clip(samples.wanted, 0.0, 79.46))
    assert found.run.terms == pytest.approx(samples.terms[np.searchsorted(samples.times, found.run.times + 1e-9, side="right") - 1])


def test_it_hunts_beyond_its_samples_gain_margin_and_rests_below(engine: tuple[DelaySystem, OperatingPoint]) -> None:
    """Of C2d each 10 ms the exact margin is 1.0715 at the trim; a small step stays near it."""
    plant, point = engine
    for factor, ending in ((1.05, Settled), (1.10, LimitCycle)):
        gains = C2D.scaled(kp=factor, ki=factor, kd=factor)
        run = run_sampled_step(plant, point, sampled(gains, 0.01), LoopTask(command=1.0, until=20.0)).run
        assert isinstance(run.outcome, ending)


def test_on_a_model_it_diverges_beyond_the_margin() -> None:
    margin = find_discrete_margins(sampled_plant_of_model(MODEL), sampled(GAINS, 0.02)).margins.gain_rise
    assert margin is not None
    for factor, ending in ((0.9, Settled), (1.1, Diverged)):
        scaled = GAINS.scaled(**dict.fromkeys(("kp", "ki", "kd"), factor * margin.gain_margin))
        found = on_model(sampled(scaled, 0.02, low=-math.inf, high=math.inf))
        assert isinstance(found.run.outcome, ending)
        assert found.samples.times[-1] <= found.run.times[-1]


def test_noise_moves_a_linear_loop_in_proportion_and_does_not_touch_the_judgement() -> None:
    """Without limits and jitter, twice the noise is twice the deviation, to rounding; equal seeds are equal runs."""
    free = sampled(GAINS, low=-1e3, high=1e3)
    one, two, again = (on_model(free, disturbance=Disturbance(noise=n, seed=4), until=4.0) for n in (0.1, 0.2, 0.1))
    quiet = on_model(free, until=4.0)
    assert one.disturbed is not None
    assert two.disturbed is not None
    assert again.disturbed is not None
    assert two.disturbed.deviation == pytest.approx(2.0 * one.disturbed.deviation, abs=1e-9)
    assert np.array_equal(one.disturbed.deviation, again.disturbed.deviation)
    assert 0.0 < one.disturbed.rms < one.disturbed.largest
    assert one.disturbed.travel > one.disturbed.quiet_travel > 0.0
    assert np.array_equal(one.run.output, quiet.run.output)
    other = on_model(free, disturbance=Disturbance(noise=0.1, seed=5), until=4.0)
    assert other.disturbed is not None
    assert not np.array_equal(other.disturbed.deviation, one.disturbed.deviation)


def test_resolution_and_dead_zone_count_as_rest_and_are_told() -> None:
    coarse = on_model(sampled(GAINS, low=-80.0, measurement_step=0.5))
    assert isinstance(coarse.run.outcome, Settled)
    assert abs(coarse.run.outcome.steady_error) <= 1.0
    assert coarse.notes == () or "the controller's resolution leaves that" in coarse.notes[0]
    stepped = on_model(sampled(GAINS, low=-80.0, output_step=0.2))
    assert "the controller's resolution leaves that" in stepped.notes[0]
    dead = on_model(sampled(GAINS, low=-80.0, dead_zone=0.3))
    assert isinstance(dead.run.outcome, Settled)
    assert 0.01 < abs(dead.run.outcome.steady_error) <= 0.3 + 1e-6


def test_a_loop_that_stalls_tells_when_and_keeps_its_samples(engine: tuple[DelaySystem, OperatingPoint]) -> None:
    plant, point = engine
    found = run_sampled_step(plant, point, sampled(), LoopTask(command=-300.0, until=10.0), disturbance=NOISE)
    assert isinstance(found.run.outcome, Stalled)
    assert found.run.outcome.state == "engine_speed"
    assert 0.9 < found.run.times[-1] <= found.run.outcome.time
    assert found.samples.times[-1] <= found.run.times[-1] + 1e-9
    assert found.notes == ("the loop ends before its time even without noise and jitter, which were left out",)
    assert found.samples.saturated_share(found.run.limits) > 0.5


def test_a_step_of_the_load_is_measured_from_where_it_comes(engine: tuple[DelaySystem, OperatingPoint]) -> None:
    plant, point = engine
    load = LoadStep(size=8.0, at=6.0)
    task = LoopTask(command=10.0, until=20.0, loads=(("load_torque", signals.step(load.size, start=load.at)),))
    law = sampled(PidGains(kp=0.4, ki=0.6, kd=0.02, input_unit="rad/s", output_unit="deg", rule="mild", designed_on="engine"))
    for run in (run_sampled_step(plant, point, law, task).run, run_loop(plant, point, law.gains, task, limits=Limits(0.0, 79.46))):
        found = measure_load_response(run, load)
        assert found is not None
        after = run.times >= load.at
        error = run.target - run.output[after]
        assert found.droop == pytest.approx(error.max())
        assert 1.0 < found.droop < 20.0
        assert 0.0 < found.settling_time < 4.0
        assert abs(error[run.times[after] > load.at + found.settling_time]).max() <= found.band
        assert run.first_part(load.at).times[-1] < load.at
        assert measure_load_response(run.first_part(5.0), load) is None


def test_unlike_cycles_and_late_outputs_are_told(engine: tuple[DelaySystem, OperatingPoint]) -> None:
    plant, point = engine
    hunting = run_sampled_step(plant, point, sampled(period=0.03), LoopTask(command=60.0, until=30.0))
    assert isinstance(hunting.run.outcome, LimitCycle)
    assert "samples fall differently into each" in hunting.notes[0]
    mild = PidGains(kp=0.3, ki=0.5, kd=0.0, input_unit="rad/s", output_unit="deg", rule="mild", designed_on="engine")
    late = sampled(mild, sampling=CrankSynchronous(angle=math.pi, computation_delay=0.0115))
    found = run_sampled_step(plant, point, late, LoopTask(command=60.0, until=10.0))
    assert isinstance(found.run.outcome, Settled)
    assert found.samples.overruns > 100
    assert found.notes == (f"{found.samples.overruns} outputs were not ready before the next sample; compute faster or sample more slowly",)


def test_what_a_sampled_loop_refuses(engine: tuple[DelaySystem, OperatingPoint]) -> None:
    plant, point = engine
    task = LoopTask(command=10.0, until=8.0)
    with pytest.raises(InvalidInputError, match="a continuous controller is not sampled"):
        run_sampled_step(plant, point, PidController(gains=C2D, low=0.0, high=79.46), task)
    with pytest.raises(InvalidInputError, match=r"sampling period = 1e-06 s is outside 8e-06 s and above for runs of 8 s"):
        run_sampled_step(plant, point, sampled(period=1e-6), task)
    with pytest.raises(InvalidInputError, match="a linear model has no input but throttle"):
        on_model(sampled(GAINS), loads=(("load_torque", signals.step(1.0)),))
    with pytest.raises(NotSettledError, match="it decides nothing"):
        on_model(sampled(GAINS, low=-80.0), until=0.2)
    with pytest.raises(InvalidInputError, match="step of the load = 0 moves nothing"):
        LoadStep(size=0.0, at=1.0)
    with pytest.raises(InvalidInputError, match="time of the load's step = 0 s is outside values above 0"):
        LoadStep(size=1.0, at=0.0)


def test_the_form_says_what_was_run() -> None:
    full = sampled(
        rate_limit=200.0,
        measurement_step=0.1,
        output_step=0.05,
        dead_zone=0.2,
        filter_time=0.01,
        derivative_weight=0.5,
        setpoint_weight=0.7,
        sampling=CrankSynchronous(angle=math.pi, computation_delay=0.001),
    )
    text = describe_form(full)
    for part in (
        "kp (0.7 r - y)",
        "kd s/(0.01 s + 1) (0.5 r - y)",
        "sampled each 3.14159 rad of the crank, the output held from 0.001 s after the sample on",
        "rate at most 200 deg/s",
        "measured to 0.1 rad/s",
        "output in steps of 0.05 deg",
        "anti-windup by clamping",
        "errors within 0.2 rad/s count as none",
    ):
        assert part in text
    followed = replace(full, anti_windup=AntiWindup.BACK_CALCULATION, tracking_time=0.3)
    assert "anti-windup by back-calculation over 0.3 s" in describe_form(followed)
    without = replace(full, anti_windup=AntiWindup.NONE, low=0.0)
    assert "no anti-windup but that the integral stays where the output can follow it" in describe_form(without)
    assert "no anti-windup; errors" in describe_form(replace(without, sampling=Continuous()))
