"""What a simulation gives, what it refuses, and where it stops with which words."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from revline import signals
from revline.dde.simulate import Options, Start, Trajectory, resume, simulate
from revline.engine.lee1995 import lee1995
from revline.errors import DivergedError, InvalidInputError, LagError, SimulationError, StalledError, StoppedError
from revline.system import DelaySystem, Variable
from tests.dde.probe import Probe, probe, start

TRIM = Start(states=np.array([35.8072, 240.799]), inputs=lee1995().input_vector())


def test_samples_are_every_nth_step_from_the_start_on() -> None:
    run = simulate(probe(Probe(decay=1.0)), start(1.0, time=2.0), {}, until=3.0, step=0.05, options=Options(every=4))
    assert run.times == pytest.approx([2.0, 2.2, 2.4, 2.6, 2.8, 3.0])
    assert run.states[:, 0] == pytest.approx(np.exp(-(run.times - 2.0)), rel=1e-6)
    assert np.array_equal(run.state("x"), run.states[:, 0])
    assert np.array_equal(run.output("x"), run.states[:, 0])
    assert (run.system, run.step, run.notes) == ("probe", 0.05, ())
    assert (run.state_names, run.input_names, run.output_names) == (("x", "clock"), ("u", "shift"), ("x", "u_old", "u_older"))
    assert (run.state_units, run.input_units, run.output_units) == (("m",) * 2, ("m",) * 2, ("m",) * 3)
    with pytest.raises(ValueError, match="read-only"):
        run.states[0, 0] = 1.0


def test_an_input_is_stored_as_it_is_after_its_jump() -> None:
    run = simulate(probe(), start(u=2.0), {"u": signals.step(1.0, start=0.5)}, until=1.0, step=0.25)
    assert np.array_equal(run.input("u"), [2.0, 2.0, 3.0, 3.0, 3.0])
    assert np.array_equal(run.input("shift"), np.zeros(5))


@pytest.mark.parametrize("kind", ["state", "input", "output"])
def test_an_unknown_signal_is_named_with_those_there_are(kind: str) -> None:
    run = simulate(probe(), start(), {}, until=0.5, step=0.25)
    with pytest.raises(InvalidInputError, match=r"^there is no signal speed; there are "):
        getattr(run, kind)("speed")


def test_a_stop_time_off_the_grid_is_moved_on_with_a_note() -> None:
    run = simulate(probe(), start(), {}, until=0.6, step=0.25)
    assert run.times[-1] == 0.75
    assert run.notes == ("stop time 0.6 s is no multiple of the step 0.25 s: moved to 0.75 s",)


@pytest.mark.parametrize(("until", "step"), [(0.3, 0.1), (1e3 + 0.7, 0.1), (7.0, 0.07)])
def test_a_stop_time_that_rounding_alone_moves_off_the_grid_is_on_it(until: float, step: float) -> None:
    run = simulate(probe(), start(), {}, until=until, step=step, options=Options(every=10**9))
    assert run.notes == ()
    assert run.checkpoint.time == pytest.approx(until, rel=1e-14)


def test_channels_hold_what_they_are_given_before_the_start() -> None:
    held = replace(start(u=1.0), channels=np.array([0.0, 5.0, 7.0]))
    run = simulate(probe(Probe(lag=0.3, second_lag=0.5)), held, {}, until=1.0, step=0.1)
    assert run.output("u_old") == pytest.approx(np.where(run.times < 0.3 - 1e-9, 5.0, 1.0))
    # The second channel is fed by the first: its own past, then the first's past, then the input.
    expected = np.select([run.times < 0.5 - 1e-9, run.times < 0.8 - 1e-9], [7.0, 5.0], 1.0)
    assert run.output("u_older") == pytest.approx(expected)


def test_channels_that_follow_each_other_start_with_what_the_first_emits() -> None:
    run = simulate(probe(), start(u=2.5), {}, until=0.5, step=0.1)
    assert np.array_equal(run.output("u_older"), np.full(6, 2.5))


def test_progress_is_told_from_begin_to_end() -> None:
    told: list[float] = []
    simulate(probe(), start(), {}, until=1.0, step=0.1, options=Options(progress=told.append, chunk=3))
    assert told == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])


def test_what_interrupts_a_run_passes_through() -> None:
    def interrupt(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(probe(), start(), {}, until=1.0, step=0.1, options=Options(progress=interrupt, chunk=1))


def test_a_system_without_channels_or_inputs_is_an_ordinary_differential_equation() -> None:
    decay = DelaySystem(
        name="decay",
        parameters=Probe(decay=2.0),
        states=(Variable(name="x", unit="m"),),
        inputs=(),
        channels=(),
        outputs=(),
        emit=lambda p, x, u, zd: (),  # noqa: ARG005 - the form of all equations
        lags=lambda p, x, u, zd: (),  # noqa: ARG005 - the form of all equations
        rate=lambda p, x, u, zd: (-p.decay * x[0],),  # noqa: ARG005 - the form of all equations
        output=lambda p, x, u, zd: (),  # noqa: ARG005 - the form of all equations
    )
    run = simulate(decay, Start(states=np.array([1.0]), inputs=np.array([])), {}, until=1.0, step=0.01)
    assert run.states[-1, 0] == pytest.approx(math.exp(-2.0), rel=1e-8)
    assert run.outputs.shape == (101, 0)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "no step": ({"step": 0.0}, r"^step = 0 s is outside values above 0; give a step such as 0\.001$"),
    "step not finite": ({"step": math.nan}, "^step = nan s is outside values above 0"),
    "step equal to the lag": (
        {"step": 1.0},
        r"^step = 1 s is not below the lag of x_old at the start \(x = 1 m, clock = 0 m\), 1 s; give a",
    ),
    "tiny step": ({"step": 1e-20}, "^step = 1e-20 s is outside steps that 2 s can be counted in; give a longer step$"),
    "stop before start": ({"until": -1.0}, "^stop time = -1 s is outside values after the start at 0 s; give a later stop time$"),
    "stop at start": ({"until": 0.0}, "^stop time = 0 s is outside values after the start at 0 s"),
    "endless": ({"until": math.inf}, "^stop time = inf s is outside values after the start"),
    "too many samples": (
        {"until": 1e13},
        "^100000000000001 samples of 8 numbers do not fit into memory; store fewer of them with every = n",
    ),
    "unknown input": ({"signals": {"v": signals.step(1.0)}}, "^there is no signal v; there are u, shift$"),
    "input leaves its range": (
        {"signals": {"u": signals.step(600.0) + signals.sine(500.0, 1.0)}},
        "^u = 1100 m is outside -1000 to 1000 m; give a value in that range$",
    ),
    "start outside the range": ({"start": start(0.0, u=2e3)}, "^u = 2000 m is outside -1000 to 1000 m"),
    "start not finite": ({"start": start(math.nan)}, "^x = nan m is outside"),
    "start time": ({"start": replace(start(1.0), time=math.inf)}, "^start time = inf s is outside the finite numbers; give one$"),
    "too few states": (
        {"start": Start(states=np.array([1.0]), inputs=np.zeros(2))},
        "^1 states were given where probe has 2: x, clock$",
    ),
    "too many inputs": ({"start": Start(states=np.zeros(2), inputs=np.zeros(3))}, "^3 inputs were given where probe has 2: u, shift$"),
    "too few channels": ({"start": replace(start(1.0), channels=np.zeros(2))}, "^2 channel values were given where probe has 3 channels$"),
    "no lag": (
        {"system": probe(Probe(lag=0.0))},
        r"^the lag of x_old at the start \(x = 1 m, clock = 0 m\) is 0 s, no positive number; start",
    ),
    "negative lag": ({"system": probe(Probe(second_lag=-1.0))}, r"^the lag of u_older at the start .* is -1 s, no positive number"),
    "parameter": ({"system": probe(Probe(second_lag_read=math.nan))}, "^parameter probe.second_lag_read = nan is no number; give one$"),
    "text": ({"system": probe(Probe(lag_input="a"))}, "^parameter probe.lag_input = 'a' is no number; parameters are floats, or"),  # type: ignore[arg-type]  # what is tested
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_be_simulated_is_refused(case: tuple[dict[str, Any], str]) -> None:
    changes, message = case
    arguments = {"system": probe(), "start": start(1.0), "signals": {}, "until": 2.0, "step": 0.1, **changes}
    with pytest.raises(InvalidInputError, match=message):
        simulate(**arguments)


@pytest.mark.parametrize(("make", "name"), [(lambda: Options(every=0), "every"), (lambda: Options(chunk=0), "chunk")])
def test_options_below_one_are_refused(make: Callable[[], Options], name: str) -> None:
    with pytest.raises(InvalidInputError, match=rf"^{name} = 0 steps is outside 1 and above; .* with n = 1, 2, \.\.\.$"):
        make()


def test_channels_that_do_not_settle_at_the_start_must_be_given() -> None:
    restless = replace(probe(), emit=lambda p, x, u, zd: (1.0 - zd[0], u[0] + 0.0, zd[1] + 0.0))  # noqa: ARG005 - the form of all equations
    with pytest.raises(InvalidInputError, match=r"^the channels of probe read each other and do not settle at the start; give the values"):
        simulate(restless, start(), {}, until=1.0, step=0.1)


STOPPED: dict[str, tuple[dict[str, Any], type[SimulationError], str]] = {
    "blow-up": (
        {"system": probe(Probe(growth=1.0)), "start": start(2.0)},
        DivergedError,
        r"^diverged: probe at t = 0\.7 s \(x = \S+ m, clock = 0\.7 m; lag of x_old = 1 s, .*\): x is no finite number any more",
    ),
    "state leaves its range": (
        {"system": probe(Probe(direct=-1.0), low=0.05), "start": start(1.0, u=1.0)},
        StalledError,
        r"^stalled: probe at t = 0\.9 s .*: x goes to -?\S+ m, outside 0\.05 to inf m; give more throttle, less load or smaller gains$",
    ),
    "lag shrinks below the step": (
        {"system": probe(Probe(lag=0.5, lag_state=-0.2, direct=1.0)), "start": start(0.0, u=1.0)},
        LagError,
        r"^step = 0\.1 s is longer than a lag during the run, 0\.08 s of x_old: probe at t = 2 s .*; give a smaller step$",
    ),
    "lag becomes negative at once": (
        {"system": probe(Probe(lag=0.5, lag_input=-1.0)), "signals": {"shift": signals.step(2.0, start=0.95)}},
        LagError,
        r"^probe at t = 0\.95 s .*: the lag of x_old becomes -1\.5 s; lags must be positive: check their equation$",
    ),
    "lag jumps up": (
        {"system": probe(Probe(lag=0.5, lag_input=1.0)), "signals": {"shift": signals.step(2.0, start=0.95)}},
        LagError,
        r"^stalled: probe at t = 0\.95 s .*: the delayed time runs backwards, the lag of x_old grows to 2\.5 s faster than time",
    ),
    "lag grows faster than time": (
        {"system": probe(Probe(lag=0.5, lag_state=1.0, direct=1.0)), "start": start(0.0), "signals": {"u": signals.step(1.1, start=1.0)}},
        LagError,
        r"^stalled: probe at t = 1 s .*the delayed time runs backwards, the lag of x_old grows to",
    ),
}


@pytest.mark.parametrize("case", STOPPED.values(), ids=STOPPED.keys())
def test_a_run_that_cannot_go_on_says_when_and_why(case: tuple[dict[str, Any], type[SimulationError], str]) -> None:
    changes, kind, message = case
    arguments = {"system": probe(), "start": start(1.0), "signals": {}, "until": 5.0, "step": 0.1, **changes}
    with pytest.raises(kind, match=message) as caught:
        simulate(**arguments)
    assert {"time", "x", "clock", "lag of x_old", "lag of u_older"} <= set(caught.value.details)


def test_a_lag_that_falls_at_a_jump_skips_history() -> None:
    """Readings jump over a breakpoint that they never see: the input's pulse passes unread."""
    pulse = signals.step(1.0, start=0.5) + signals.step(-1.0, start=0.7)
    run = simulate(
        probe(Probe(lag=0.9, lag_input=-0.8)), start(), {"u": pulse, "shift": signals.step(1.0, start=1.2)}, until=2.0, step=0.05
    )
    assert np.array_equal(run.output("u_old"), np.zeros(41))
    shorter = {"u": pulse, "shift": signals.step(0.375, start=1.2)}
    run = simulate(probe(Probe(lag=0.9, lag_input=-0.8)), start(), shorter, until=2.0, step=0.05)
    inside = (run.times > 1.2 - 1e-9) & (run.times < 1.3 - 1e-9)
    assert np.array_equal(run.output("u_old"), np.where(inside, 1.0, 0.0))


@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        (
            {"throttle": signals.step(-25.0, start=0.1)},
            SimulationError,
            r"^stalled: lee1995 at t = \S+ s \(manifold_pressure = \S+ kPa, engine_speed",
        ),
        (
            {"load_torque": signals.step(300.0, start=0.1)},
            SimulationError,
            r"^stalled: lee1995 at t = .* engine_speed = \S+ rad/s; lag of ",
        ),
    ],
)
def test_an_engine_that_stalls_says_so(given: dict[str, signals.Signal], kind: type[SimulationError], message: str) -> None:
    with pytest.raises(kind, match=message) as caught:
        simulate(lee1995(), TRIM, given, until=60.0, step=1e-3)
    assert {"time", "engine_speed", "manifold_pressure"} <= set(caught.value.details)


def test_an_engine_that_speeds_up_shortens_its_lags_below_a_long_step() -> None:
    with pytest.raises(
        LagError, match=r"^step = 0\.005 s is longer than a lag during the run, 0\.00\d+ s of spark_influence: lee1995 at t = "
    ):
        simulate(lee1995(), TRIM, {"throttle": signals.step(5.0)}, until=20.0, step=0.005)


def test_long_runs_meet_breakpoints_where_time_is_coarse() -> None:
    """At t = 1e7 s neighbouring times are 2e-9 s apart, more than a part of 1e-9 of the step."""
    begin = 1e7
    shifted = signals.step(1.0, start=begin + 0.3) + signals.step(-1.0, start=begin + 0.5)
    run = simulate(probe(Probe(decay=1.0, feed=1.0, lag=0.25)), start(time=begin), {"u": shifted}, until=begin + 2.0, step=0.01)
    exact = (1.0 - math.exp(-0.2)) * math.exp(-(2.0 - 0.75))
    assert run.states[-1, 0] == pytest.approx(exact, rel=1e-6)


def test_a_sinusoid_that_the_step_cannot_follow_is_refused() -> None:
    """It would pass for a slower one: at 20 pi rad/s and a step of 0.1 s, for none."""
    fast = {"u": signals.sine(1.0, 20.0 * math.pi)}
    message = (
        r"^sine frequency of u = 62\.8319 rad/s is outside what a step of 0\.1 s resolves, up to 10 rad/s; give a step of at most 0\.0159 s"
    )
    with pytest.raises(InvalidInputError, match=message):
        simulate(probe(Probe(decay=1.0, direct=1.0)), start(), fast, until=1.0, step=0.1)
    simulate(probe(Probe(decay=1.0, direct=1.0)), start(), fast, until=1.0, step=0.0159)


def test_a_run_that_is_stopped_keeps_what_there_is_and_goes_on() -> None:
    system, given = probe(Probe(decay=1.0, feed=0.5, direct=1.0)), {"u": signals.pulse_cycle(1.0, 0.7)}
    asked = iter([False, False, True])
    options = Options(every=7, chunk=100, stopped=lambda: next(asked))
    with pytest.raises(StoppedError, match=r"^probe at t = 3 s of 9 s, stopped from outside$") as caught:
        simulate(system, start(1.0), given, until=9.0, step=0.01, options=options)
    part = caught.value.run
    assert isinstance(part, Trajectory)
    rest = resume(system, given, part.checkpoint, until=9.0)
    whole = simulate(system, start(1.0), given, until=9.0, step=0.01, options=Options(every=7))
    assert len(part.times) == 43
    assert np.concatenate([part.states, rest.states]).tobytes() == whole.states.tobytes()


def test_a_run_that_is_done_is_not_stopped() -> None:
    run = simulate(probe(), start(), {}, until=1.0, step=0.01, options=Options(stopped=lambda: True))
    assert run.times[-1] == pytest.approx(1.0)
    assert run.end == tuple(run.states[-1])
