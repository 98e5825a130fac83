"""The acceptance battery: what passes, what fails and why, and the measured gain reserve."""

import math
from concurrent.futures import CancelledError
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from revline import signals
from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.gain_schedule import GainSchedule
from revline.design.controllers.pid_controller import PidController
from revline.design.controllers.scheduled_pid import ScheduledController
from revline.design.loops.run_ending import Ending, Seen, judge_ending
from revline.design.loops.sampled_loop import Disturbance, SampledTask, run_sampled_loop
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, operating_point
from revline.design.stability.discrete_loop import find_discrete_margins, sampled_plant_of_system
from revline.design.trials.acceptance import Acceptance, Battery, Kind, OfUnstable, Requirements, accept
from revline.design.trials.acceptance_runs import Probe, measure_run
from revline.design.trials.gain_reserve import RESOLUTION, GainReserve, ReserveSearch, find_gain_reserve
from revline.design.trials.linear_place import find_linear_loop
from revline.engine.lee1995 import lee1995
from revline.engine.spread import spread_engine
from revline.errors import InvalidInputError, NotConvergedError, StepError
from revline.sampled import CrankSynchronous, FixedRate
from tests.design.examples import C2D

MILD = PidGains(kp=0.4, ki=0.6, kd=0.02, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="the engine")
SHORT = Battery(until=6.0)


def sampled(gains: PidGains, period: float = 0.005, **changes: Any) -> PidController:
    return PidController(gains=gains, low=0.0, high=79.46, sampling=FixedRate(period=period), **changes)


def judge(gains: PidGains, *throttles: float, load: float = 0.0, battery: Battery = SHORT, spread: float = 0.0) -> Acceptance:
    engine = lee1995()
    plants = {"lee1995": engine, **(spread_engine(engine, spread) if spread else {})}
    return accept(plants, sampled(gains), [{"throttle": angle, "load_torque": load} for angle in throttles], battery)


def test_mild_gains_pass_on_every_engine_of_the_spread() -> None:
    found = judge(MILD, 25.0, spread=0.1)
    assert found.passed
    assert found.reasons == ()
    assert [run.case.kind for run in found.runs] == [Kind.CLEAN] * 2 + [Kind.NOISY] * 2 + [Kind.SPREAD] * 8
    assert len({run.case.seed for run in found.runs}) == len(found.runs)
    assert found.gain_reserve_db > 12.0
    assert found.linear[0].margins.margins.stable
    first = found.runs[0]
    assert first.measures is not None
    assert first.measures.overshoot < 0.1
    assert first.measures.droop > 0.5
    assert "clean, lee1995, command +10, load +5" in first.case.text


def test_the_thesis_controller_fails_when_sampled_and_the_verdict_says_why() -> None:
    found = judge(C2D, 15.0)
    assert not found.passed
    assert any("overshoot" in reason for reason in found.reasons)
    assert any("a reserve of" in reason and "throttle 15" in reason for reason in found.reasons)


def test_a_place_where_the_linear_loop_is_unstable_fails_unrun_unless_asked() -> None:
    found = judge(C2D, 15.0, load=20.0)
    assert found.runs == ()
    assert found.reserves == ()
    assert len(found.reasons) == 1
    assert found.reasons[0].startswith(
        "throttle 15, load_torque 20: the linear loop is unstable, with 2 roots outside the unit circle; it would be stable below 0.507 "
    )
    with pytest.raises(InvalidInputError, match="no place was run, for the linear loop is unstable at all"):
        _ = found.gain_reserve_db
    run = judge(C2D, 15.0, load=20.0, battery=replace(SHORT, of_unstable=OfUnstable.RUN))
    assert len(run.runs) == 4
    assert run.gain_reserve_db < 0.0


def test_each_requirement_is_asked_for() -> None:
    """Negative control: gains that pass fail in every respect whose requirement is out of reach."""
    wish = Requirements(overshoot=1e-6, settling_time=0.05, steady_error=1e-9, droop=0.1, gain_reserve_db=30.0)
    found = judge(MILD, 25.0, battery=replace(SHORT, requirements=wish))
    for word in ("overshoot", "settles only after", "off its target", "the load's step moves it by", "a reserve of"):
        assert any(word in reason for reason in found.reasons), word


def test_a_computation_that_outlasts_a_sample_fails_where_the_speed_rises() -> None:
    """At 240.8 rad/s a turn by pi takes 13.05 ms, at 250.8 rad/s 12.53 ms; the computation takes 12.8 ms."""
    engine = lee1995()
    slow = replace(sampled(MILD.scaled(kp=0.25, ki=0.25, kd=1.0)), sampling=CrankSynchronous(angle=math.pi, computation_delay=0.0128))
    battery = Battery(until=4.0, disturbance=Disturbance(noise=0.3, jitter=1e-3))
    found = accept({"e": engine}, slow, [{"throttle": 25.0}], battery)
    assert ["not ready before the next sample" in " ".join(run.reasons) for run in found.runs] == [True, False, True, False]


def test_the_verdict_does_not_depend_on_the_threads() -> None:
    engine, places, brief = lee1995(), [{"throttle": 25.0}], Battery(until=3.0)
    one, two = (accept({"e": engine}, sampled(C2D), places, brief, workers=workers) for workers in (1, 2))
    assert [run.measures for run in one.runs] == [run.measures for run in two.runs]
    assert [reserve.factor for reserve in one.reserves] == [reserve.factor for reserve in two.reserves]


def test_the_reserve_is_the_exact_margin_of_the_sampled_loop_for_small_steps() -> None:
    """10.7 % for C2d every 10 ms, which `test_discrete_loop` has from the exact linear model; the bisection ends within 1 %."""
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    found = find_gain_reserve(engine, point, sampled(C2D, 0.01), ReserveSearch(command=0.1), place={"throttle": 25.0})
    assert found.factor <= 1.0715 <= 1.005 * found.hunts
    assert found.hunts <= 1.01 * found.factor
    assert 2.0 * math.pi / found.period == pytest.approx(54.1, abs=0.3)


def test_a_reserve_that_is_not_reached_is_a_lower_bound() -> None:
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    tiny = MILD.scaled(kp=1e-3, ki=1e-3, kd=0.0)
    found = find_gain_reserve(engine, point, sampled(tiny), ReserveSearch(command=1.0, until=1.0), place={})
    assert (found.hunts, found.ending) == (math.inf, Ending.RESTS)
    assert found.decibels == pytest.approx(20.0 * math.log10(64.0))
    with pytest.raises(InvalidInputError, match="step of the command = 0 is outside the finite numbers but 0"):
        find_gain_reserve(engine, point, sampled(tiny), ReserveSearch(command=0.0), place={})

    def ends(_: float) -> None:
        raise CancelledError

    with pytest.raises(CancelledError):  # before any run, so that an interruption need not wait for a whole search
        find_gain_reserve(engine, point, sampled(tiny), ReserveSearch(command=1.0, until=1e6), place={}, progress=ends)


INTEGRAL = PidGains(kp=0.0, ki=0.3, kd=0.0, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="the engine")


def reserve_at_25(controller: PidController, **search: Any) -> GainReserve:
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    return find_gain_reserve(engine, point, controller, ReserveSearch(**search), place={"throttle": 25.0})


def test_a_slow_oscillation_is_seen_whatever_length_is_asked_for() -> None:
    """Integral action alone hunts with a period of 1.18 s, at 4.178 times its gain by the exact linear model; runs begin with 1 s."""
    engine = lee1995()
    model = linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model
    rise = find_discrete_margins(sampled_plant_of_system(model), sampled(INTEGRAL)).margins.gain_rise
    assert rise is not None
    found = reserve_at_25(sampled(INTEGRAL), command=0.5, until=1.0)
    assert found.factor <= rise.gain_margin <= 1.01 * found.hunts
    assert found.ending is Ending.HUNTS
    assert 2.0 * math.pi / found.period == pytest.approx(rise.frequency, rel=5e-3)
    with pytest.raises(NotConvergedError, match=r"no run of 0.2 to 12.8 s tells whether the loop comes to rest or hunts"):
        reserve_at_25(sampled(INTEGRAL), command=0.5, until=0.2)


@pytest.mark.parametrize("integral", [-0.1, -0.01])
def test_a_loop_that_drifts_to_a_bound_does_not_come_to_rest(integral: float) -> None:
    """The wrong sign of the integral is a real root outside the unit circle: nothing oscillates, and the integral ends at its bound."""
    found = reserve_at_25(sampled(replace(MILD, ki=integral)), command=10.0)
    assert (found.factor, found.ending) == (0.0, Ending.DRIFTS)
    assert found.decibels == -math.inf


@pytest.mark.parametrize(("period", "until"), [(0.005, 0.02), (0.5, 2.0)])
def test_a_run_that_the_plants_delay_or_a_few_samples_fill_tells_nothing(period: float, until: float) -> None:
    """Within 20 ms no torque has changed yet, and every 0.5 s only one sample falls into the last fifth of 2 s: neither is rest."""
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    run = run_sampled_loop(engine, point, sampled(INTEGRAL, period), SampledTask(command=signals.step(10.0), until=until))
    assert judge_ending(run, 10.0, long=False) == ()


def test_a_command_out_of_reach_leaves_the_output_at_its_limit() -> None:
    """No reserve is told where nothing is controlled; all samples but the first count as at the limit, though their sums round."""
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    run = run_sampled_loop(engine, point, sampled(MILD), SampledTask(command=signals.step(700.0), until=5.0))
    assert run.saturated_share == 1.0
    assert judge_ending(run, 700.0, long=False) == (Seen(Ending.DRIFTS),)


def test_the_resolution_of_the_output_is_no_hunting() -> None:
    """Steps of 0.1 deg keep the throttle moving by one of them for ever, at any gain; the exact margin without is 5.57."""
    found = reserve_at_25(sampled(MILD, output_step=0.1), command=10.0, until=6.0)
    assert 4.9 < found.factor < 5.57
    assert found.ending is Ending.HUNTS


def test_a_step_longer_than_a_lag_is_no_fault_of_the_gains() -> None:
    with pytest.raises(StepError, match="longer than a lag during the run"):
        reserve_at_25(sampled(MILD), command=100.0, until=2.0, step=5e-3)
    with pytest.raises(StepError, match="longer than a lag during the run"):
        accept({"e": lee1995()}, sampled(MILD), [{"throttle": 25.0}], Battery(command=100.0, until=2.0, step=5e-3))


def test_measures_are_those_of_the_record() -> None:
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    probe = Probe(command=10.0, load=5.0, until=6.0)
    task = SampledTask(command=probe.command_signal, until=6.0, loads={"load_torque": probe.load_signal}, disturbance=Disturbance())
    run = run_sampled_loop(engine, point, sampled(MILD), task)
    found = measure_run(run, probe, band=0.05, noise=0.0)
    error = run.output - run.start - 10.0
    assert found.overshoot == pytest.approx(max(0.0, error[run.times < 3.0].max()) / 10.0)
    assert found.droop == pytest.approx(-error[run.times >= 3.0].min())
    late = run.times[run.times < 3.0][np.abs(error[run.times < 3.0]) > 0.5].max()
    assert found.command_settling_time == pytest.approx(late)
    assert found.travel == pytest.approx(np.abs(np.diff(run.of_controller("control"))).sum())
    assert found.load_iae == pytest.approx(np.abs(error[run.times >= 3.0]).sum() * 1e-3, rel=1e-2)


def test_the_spread_changes_one_parameter_at_a_time() -> None:
    engine = lee1995()
    found = spread_engine(engine, 0.1)
    assert list(found) == [f"{name} {sign}10 %" for name in ("inertia", "transport delays", "manifold volume", "torque") for sign in "+-"]
    heavier = found["inertia +10 %"].parameters
    assert heavier.rotation.inertia == pytest.approx(1.1 * engine.parameters.rotation.inertia)
    assert heavier._replace(rotation=engine.parameters.rotation) == engine.parameters
    assert found["transport delays -10 %"].parameters.delays.spark_to_torque == pytest.approx(1.17)
    assert spread_engine(engine, 0.0) == {}
    with pytest.raises(InvalidInputError, match=r"spread of the parameters = 0.6 is outside 0 to 0.5; give a share, for example 0.1"):
        spread_engine(engine, 0.6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Requirements(gain_reserve_db=math.nan), "required gain reserve = nan dB is outside 0 and above; give one, 0 for none"),
        (lambda: Requirements(overshoot=0.0), "required overshoot = 0 of the command is outside the positive numbers"),
        (lambda: Battery(command=0.0), "the step of the command is 0; give a finite size that is not 0"),
        (lambda: Battery(load=math.inf), "the step of the load is inf"),
        (lambda: Battery(until=0.0), "length of a run = 0 s is outside the positive numbers"),
        (lambda: accept({"e": lee1995()}, sampled(MILD), []), "accepted on one plant and at one operating point at least"),
        (lambda: accept({"e": lee1995()}, sampled(MILD), [{"throttle": 25.0}] * 2), "operating point throttle = 25 is given twice"),
    ],
)
def test_what_cannot_be_judged_is_refused(make: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        make()


def test_a_reserve_is_found_from_anywhere_it_is_expected_and_by_fewer_runs_where_it_is() -> None:
    engine, point = lee1995(), operating_point(find_trim(lee1995(), inputs={"throttle": 25.0, "load_torque": 0.0}))

    def find(near: float | None) -> GainReserve:
        search = ReserveSearch(command=0.1, near=near)
        return find_gain_reserve(engine, point, sampled(C2D, 0.01), search, place={})

    blind = find(None)
    for found in map(find, (1.5 * blind.factor, 0.93 * blind.factor, 1e-3)):
        assert found.factor < RESOLUTION * blind.hunts
        assert blind.factor < RESOLUTION * found.hunts
    assert find(blind.factor).runs < blind.runs


def scheduled(**changes: Any) -> ScheduledController:
    table = GainSchedule(
        names=("engine_speed", "load_torque"),
        units=("rad/s", "N m"),
        gain_unit="deg/(rad/s)",
        first=np.array([100.0, 245.0]),
        second=np.array([0.0, 20.0]),
        kp=np.full((2, 2), 0.4),
        ki=np.full((2, 2), 0.6),
        kd=np.zeros((2, 2)),
    )
    return ScheduledController(controller=sampled(MILD), schedule=replace(table, **changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"names": ("shaft_speed", "load_torque")}, "over shaft_speed, and the controller measures engine_speed"),
        ({"names": ("engine_speed", "wind")}, "there is no signal wind"),
        ({"units": ("rad/s", "lbf ft")}, "counts load_torque in lbf ft and lee1995 has it in N m"),
    ],
)
def test_a_schedule_over_other_signals_is_refused(changes: dict[str, Any], words: str) -> None:
    """Gains looked up by another signal than the measured one, or in another unit, would be others than those designed."""
    with pytest.raises(InvalidInputError, match=words):
        accept({"lee1995": lee1995()}, scheduled(**changes), [{"throttle": 25.0}])


def test_a_place_outside_the_schedule_is_told() -> None:
    """At 25 deg the engine turns with 240.8 rad/s, at 30 deg with 300.8: beyond the table, whose last gains hold there."""
    engine = lee1995()
    inside, outside = (
        find_linear_loop(engine, find_trim(engine, inputs={"throttle": angle}), scheduled(), {"throttle": angle}, SPEED_BY_THROTTLE)
        for angle in (25.0, 30.0)
    )
    assert inside.warning == ""
    assert outside.warning == (
        "throttle 30: outside the gain schedule, whose edge's gains hold there: engine_speed = 300.778 rad/s is not all within 100 to "
        "245 rad/s"
    )
