import math

import numpy as np
import pytest

from revline import signals
from revline.dde.simulate import Start
from revline.dde.tolerance import ConvergedRun, compare_runs, simulate_to_tolerance
from revline.engine.lee1995 import lee1995
from revline.errors import DivergedError, InvalidInputError, NotConvergedError
from tests.dde.probe import Probe, probe, solve_by_steps, solve_forced, start

LOOP = Probe(feedback=-1.5, lag=0.37)


def run_loop(tolerance: float) -> ConvergedRun:
    return simulate_to_tolerance(probe(LOOP), start(1.0), {}, until=4.0, interval=0.1, tolerance=tolerance)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_the_true_error_is_below_the_difference_and_that_below_the_tolerance(tolerance: float) -> None:
    found = run_loop(tolerance)
    run = found.trajectory
    error = np.max(np.abs(run.output("x") - solve_by_steps(-1.5, 0.37)(run.times))) / np.ptp(run.output("x"))
    assert error < found.difference <= tolerance
    assert found.tolerance == tolerance
    assert run.times == pytest.approx(np.arange(41) * 0.1)
    assert run.notes == ()


def test_the_step_is_halved_and_no_more_often_than_needed() -> None:
    found = run_loop(1e-9)
    assert np.diff(np.log2(found.steps)) == pytest.approx(-np.ones(len(found.steps) - 1))
    assert found.trajectory.step == found.steps[-1]
    assert found.difference > 1e-9 / 64.0


def test_a_finer_tolerance_costs_a_finer_step() -> None:
    assert run_loop(1e-9).trajectory.step < run_loop(1e-5).trajectory.step


def test_a_fast_sinusoid_is_not_missed_by_coarse_steps() -> None:
    """At steps of the sample interval, whole periods of the input, all runs would agree on nothing at all."""
    parameters = Probe(decay=1.0, direct=1.0, lag=10.0)
    fast = signals.sine(1.0, 20.0 * math.pi)
    found = simulate_to_tolerance(probe(parameters), start(), {"u": fast}, until=2.0, interval=0.1)
    run = found.trajectory
    assert run.output("x") == pytest.approx(solve_forced(parameters, 2.0, u=fast)(run.times), abs=1e-6)


def test_a_first_step_above_a_lag_on_the_way_is_halved() -> None:
    shrinking = probe(Probe(lag=0.5, lag_state=-0.2, direct=1.0))
    found = simulate_to_tolerance(shrinking, start(u=1.0), {}, until=2.4, interval=0.2)
    assert found.trajectory.times[-1] == pytest.approx(2.4)
    assert found.steps[0] < 0.5 - 0.2 * 2.4


def test_an_engine_at_rest_is_no_matter_of_rounding() -> None:
    engine = lee1995()
    rest = Start(states=np.array([35.80718, 240.79901]), inputs=engine.input_vector())
    found = simulate_to_tolerance(engine, rest, {}, until=1.0, interval=0.01, tolerance=1e-4)
    assert found.difference < 1e-4
    assert len(found.steps) == 2


def test_a_state_that_is_nothing_agrees_with_itself() -> None:
    run = simulate_to_tolerance(probe(), start(), {}, until=1.0, interval=0.5).trajectory
    assert compare_runs(run, run) == 0.0


def test_a_stop_time_between_samples_is_moved_on_with_a_note() -> None:
    found = simulate_to_tolerance(probe(), start(), {}, until=0.7, interval=0.5)
    assert found.trajectory.times[-1] == 1.0
    assert found.trajectory.notes == ("stop time 0.7 s is no multiple of the sample interval 0.5 s: moved to 1 s",)


def test_runs_that_do_not_agree_say_by_how_much(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("revline.dde.tolerance.MOST_STEPS", 100_000)
    message = r"^runs of probe to t = 4 s still differ by \S+ of a state's range at step = \S+ s \(limit 1e-16\); give a larger tolerance"
    with pytest.raises(NotConvergedError, match=message):
        run_loop(1e-16)


def test_what_ends_a_run_ends_the_search() -> None:
    with pytest.raises(DivergedError, match=r"^diverged: probe at t = "):
        simulate_to_tolerance(probe(Probe(growth=1.0)), start(2.0), {}, until=2.0, interval=0.1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"interval": 0.0}, r"^sample interval = 0 s is outside values above 0; give one such as 0\.01$"),
        ({"interval": math.nan}, r"^sample interval = nan s"),
        ({"tolerance": 0.0}, r"^tolerance = 0 of each state's range is outside 0 to 1; give one such as 1e-06$"),
        ({"tolerance": math.nan}, r"^tolerance = nan of each"),
        ({"until": -1.0}, r"^stop time = -1 s is outside values after the start at 0 s"),
        ({"until": math.inf}, r"^stop time = inf s is outside values after the start at 0 s"),
        (
            {"until": 1e9},
            r"^a run to t = 1e\+09 s takes 2e\+10 steps at step = 0\.05 s, which the inputs and lags ask for, and at most 2e\+08 are",
        ),
    ],
)
def test_wrong_wishes_are_refused(changes: dict[str, float], message: str) -> None:
    wishes = {"until": 1.0, "interval": 0.1, "tolerance": 1e-6, **changes}
    with pytest.raises(InvalidInputError, match=message):
        simulate_to_tolerance(probe(), start(), {}, until=wishes["until"], interval=wishes["interval"], tolerance=wishes["tolerance"])
