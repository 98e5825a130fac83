"""Hunting loops: their cycles computed and held against simulation, and how hunting begins."""

from dataclasses import replace

import numpy as np
import pytest

from revline.analysis.cycle_branches import follow_cycles
from revline.analysis.kinked_cycles import find_kinked_cycle
from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.controller import PidGains
from revline.design.loops import hunting, loop_simulation, onset
from revline.design.loops.closed_loop import Limits, LoopRun, LoopTask, run_loop
from revline.design.loops.hunting import HuntingOrbit, UnrefinedCycle, confirm_cycle, refine_cycle, run_to_its_end
from revline.design.loops.onset import RayTask, find_onset
from revline.design.loops.outcome import LimitCycle, Settled
from revline.design.plants.loop_signals import OperatingPoint, operating_point
from revline.engine.lee1995 import lee1995
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError, NotSettledError
from revline.system import DelaySystem

LIMITS = Limits(0.0, 79.46)


def gains(kp: float, ki: float, kd: float = 0.0) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="test")


C1 = gains(2.153, 16.85)


@pytest.fixture(scope="module")
def engine() -> DelaySystem:
    return lee1995()


@pytest.fixture(scope="module")
def trim(engine: DelaySystem) -> Trim:
    return find_trim(engine, inputs={"throttle": 25.0})


@pytest.fixture(scope="module")
def point(trim: Trim) -> OperatingPoint:
    return operating_point(trim)


def hunt(engine: DelaySystem, point: OperatingPoint, controller: PidGains, command: float) -> LoopRun:
    return run_to_its_end(engine, point, controller, LoopTask(command=command, until=20.0), limits=LIMITS)


@pytest.mark.reference
def test_the_larger_cycle_touches_the_limit_and_is_known_to_eight_digits(engine: DelaySystem, point: OperatingPoint) -> None:
    """Lee's C1 after a step of 1 rad/s, converged simulation: 222 to 259 rad/s, 0.304 s, the throttle touches its lower limit."""
    run = hunt(engine, point, C1, 1.0)
    found = confirm_cycle(engine, point, run)
    fine = run_loop(engine, point, C1, LoopTask(command=1.0, until=12.0, step=2.5e-4), limits=LIMITS)
    assert isinstance(fine.outcome, LimitCycle)
    assert (found.low, found.high) == pytest.approx((fine.outcome.low, fine.outcome.high), abs=2e-6)
    assert found.period == pytest.approx(fine.outcome.period, rel=2e-7)
    assert (found.low, found.high, found.period) == pytest.approx((222.04058, 258.90687, 0.30416422), abs=1e-5)
    assert found.at_low
    assert not found.at_high
    assert found.control_low == 0.0
    assert found.cycle.error < 1e-6
    assert found.cycle.stable
    assert found.cycle.trivial_error < 1e-6
    assert found.start == hunting.BALANCE


def test_a_run_of_very_many_steps_is_recorded_thinly_and_leads_to_the_same_cycle(
    engine: DelaySystem, point: OperatingPoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of an engine with a delay of microseconds, whose samples would take gigabytes: every sixth of its samples is kept."""
    whole = run_loop(engine, point, C1, LoopTask(command=1.0, until=12.0, step=5e-4), limits=LIMITS)
    monkeypatch.setattr(loop_simulation, "MOST_RECORDED", 4000)
    thin = run_loop(engine, point, C1, LoopTask(command=1.0, until=12.0, step=5e-4), limits=LIMITS)
    assert (whole.times.size, thin.times.size, thin.step) == (24001, 4001, whole.step)
    assert thin.output.tolist() == whole.output[::6].tolist()
    orbits = [confirm_cycle(engine, point, run, tolerance=1e-3) for run in (whole, thin)]
    assert orbits[1].period == pytest.approx(orbits[0].period, rel=1e-6)
    assert orbits[1].gap <= orbits[1].tolerance


def test_the_engines_neighbours_near_the_limited_cycle_at_the_rate_of_its_multiplier(engine: DelaySystem, point: OperatingPoint) -> None:
    """A proportional controller whose cycle touches the lower limit: highs of a run from a smaller oscillation, cycle by cycle."""
    controller = gains(4.0, 0.0)
    found = confirm_cycle(engine, point, hunt(engine, point, controller, 60.0))
    assert found.at_low
    run = run_loop(engine, point, controller, LoopTask(command=60.0, until=8.0, step=2e-4), limits=LIMITS)
    y, t = run.output, run.times
    tops = np.flatnonzero((y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])) + 1
    tops = tops[y[tops] > 305.0]
    near = np.linspace(-2e-4, 2e-4, 41)
    heights = np.array([np.max(np.polyval(np.polyfit(t[k - 3 : k + 4] - t[k], y[k - 3 : k + 4] - y[k], 4), near)) + y[k] for k in tops])
    off = np.abs(heights - heights[-1])
    at = next(k for k in range(off.size) if off[k] < 3e-2)
    assert (off[at + 2] / off[at]) ** 0.5 == pytest.approx(found.cycle.largest, rel=0.02)


@pytest.mark.slow
def test_a_cycle_too_sharp_for_harmonic_balance_starts_from_its_simulation(engine: DelaySystem, point: OperatingPoint) -> None:
    """Integral action alone swings from limit to limit; what is not resolved to the tolerance says by how much."""
    found = confirm_cycle(engine, point, hunt(engine, point, gains(0.0, 8.0), 20.0), tolerance=1e-3)
    assert found.start == hunting.SIMULATION
    assert found.at_low
    assert found.at_high
    assert found.cycle.certain
    assert found.gap < 2e-3


def test_cycle_and_run_that_disagree_are_an_error(engine: DelaySystem, point: OperatingPoint, monkeypatch: pytest.MonkeyPatch) -> None:
    run = hunt(engine, point, C1, 60.0)
    assert isinstance(run.outcome, LimitCycle)
    wrong = replace(run, outcome=replace(run.outcome, high=run.outcome.high + 0.1))
    with pytest.raises(AnalysisError, match=r"291\.147 to 310\.074 rad/s in 0\.208767 s, and the simulated one, .* disagree by 0\.0053"):
        confirm_cycle(engine, point, wrong)

    def repelling(*arguments: object, **options: object) -> object:
        cycle = find_kinked_cycle(*arguments, **options)  # type: ignore[arg-type]  # passed on as they came
        return replace(cycle, multipliers=np.array([1.5 + 0.0j]))

    monkeypatch.setattr(hunting, "find_kinked_cycle", repelling)
    with pytest.raises(AnalysisError, match=r"repels what is near it: its largest multiplier is 1\.5"):
        confirm_cycle(engine, point, run)


def test_what_cannot_be_confirmed_is_refused(engine: DelaySystem, point: OperatingPoint) -> None:
    calm = hunt(engine, point, gains(0.5, 1.0), 20.0)
    assert isinstance(calm.outcome, Settled)
    with pytest.raises(InvalidInputError, match="the run ends settled: there is no limit cycle"):
        confirm_cycle(engine, point, calm)
    run = hunt(engine, point, C1, 60.0)
    with pytest.raises(InvalidInputError, match="tolerance = 2 "):
        confirm_cycle(engine, point, run, tolerance=2.0)


def test_a_record_that_does_not_decide_is_made_longer(engine: DelaySystem, point: OperatingPoint, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = C1.scaled(kp=0.91, ki=0.91)
    assert hunt(engine, point, slow, 60.0).times[-1] > 30.0
    monkeypatch.setattr(hunting, "LONGER", 1.0)
    with pytest.raises(NotSettledError, match="simulate longer than 20 s"):
        hunt(engine, point, slow, 60.0)


@pytest.mark.reference
def test_c1s_onset_is_the_linear_boundary_and_soft(engine: DelaySystem, trim: Trim, point: OperatingPoint) -> None:
    """Critical kp at C1's ratio ki/kp: 1.927 deg per rad/s at 30 deg; frequency and kp by another search, too."""
    found = find_onset(engine, trim, C1, RayTask(command=60.0, largest=2.0), limits=LIMITS)
    assert found.gains.kp == pytest.approx(1.927, abs=5e-4)
    model = linearize(engine, find_trim(engine, outputs={"engine_speed": found.rest.measurement}, free=("throttle",))).model
    s = 1j * found.frequency
    plant = complex(model.transfer(np.array([s]))[0, 0, 0])
    assert abs(1.0 + found.factor * (C1.kp + C1.ki / s) * plant) < 1e-9  # the characteristic equation
    assert found.kind == "soft"
    assert found.lowest_factor == found.factor
    assert all(p.stable and p.certain and p.factor > found.factor for p in found.points)
    # Simulated on both sides: below the onset a small disturbance dies out, above it ends in a small cycle of the family.
    there = operating_point(find_trim(engine, outputs={"engine_speed": found.rest.measurement}, free=("throttle",)))
    below = run_to_its_end(
        engine, there, C1.scaled(kp=0.97 * found.factor, ki=0.97 * found.factor), LoopTask(command=0.1, until=40.0), limits=LIMITS
    )
    assert isinstance(below.outcome, Settled)
    beyond = found.points[-1]
    above = run_to_its_end(engine, point, C1.scaled(kp=beyond.factor, ki=beyond.factor), LoopTask(command=60.0, until=120.0), limits=LIMITS)
    assert isinstance(above.outcome, LimitCycle)
    assert above.outcome.amplitude == pytest.approx(beyond.amplitude, rel=5e-3)
    assert above.outcome.period == pytest.approx(beyond.period, rel=1e-4)


def test_the_family_leads_to_the_cycle_that_the_loop_hunts_in(engine: DelaySystem, trim: Trim, point: OperatingPoint) -> None:
    """At the amplitude of C1's cycle the family has the factor 1: the two ways to the cycle share neither start nor equations."""
    orbit = confirm_cycle(engine, point, hunt(engine, point, C1, 60.0))
    found = find_onset(engine, trim, C1, RayTask(command=60.0, largest=float(orbit.harmonics[0])), limits=LIMITS)
    assert found.points[-1].factor == pytest.approx(1.0, abs=1e-6)
    assert found.points[-1].period == pytest.approx(orbit.period, rel=1e-6)


def test_without_integral_action_the_onset_is_judged_at_the_trim(engine: DelaySystem, trim: Trim) -> None:
    found = find_onset(engine, trim, gains(1.0, 0.0), RayTask(command=60.0, largest=1.0), limits=LIMITS)
    assert found.gains.kp == pytest.approx(2.106, abs=5e-4)
    assert found.rest.inputs["throttle"] == 25.0


def test_at_small_throttle_hunting_begins_hard(engine: DelaySystem) -> None:
    """At 12 deg with ki/kp of 3 per s: below the onset the loop is stable by its roots, and a cycle that repels lies about it."""
    trim = find_trim(engine, inputs={"throttle": 12.0})
    found = find_onset(engine, trim, gains(2.0, 6.0), RayTask(command=0.0, largest=5.0), limits=LIMITS)
    assert found.kind == "hard"
    assert found.lowest_factor < found.factor
    assert found.lowest_is_fold  # followed beyond the amplitude asked for, until it turns
    assert found.points[-1].amplitude > 10.0
    assert found.points[-1].factor > found.points[-2].factor
    last = found.points[9]
    assert last.factor < found.factor
    assert not last.stable
    assert last.certain
    # Simulated below the onset, from a speed off its rest: what begins within the cycle dies out, what begins beyond it does not.
    below = gains(2.0, 6.0).scaled(kp=last.factor, ki=last.factor)
    ends = [
        run_to_its_end(engine, knocked(trim, by), below, LoopTask(command=-by, until=400.0), limits=LIMITS).outcome for by in (2.0, 15.0)
    ]
    assert isinstance(ends[0], Settled)
    assert not isinstance(ends[1], Settled)


@pytest.mark.slow
def test_below_the_fold_of_a_hard_onset_no_knock_starts_hunting(engine: DelaySystem) -> None:
    """Simulated at 12 deg from many speeds: 3 % below the fold all come to rest, 3 % above it some do not."""
    trim = find_trim(engine, inputs={"throttle": 12.0})
    found = find_onset(engine, trim, gains(2.0, 6.0), RayTask(command=0.0, largest=5.0), limits=LIMITS)

    def ends(share: float) -> list[bool]:
        near = gains(2.0, 6.0).scaled(kp=share * found.lowest_factor, ki=share * found.lowest_factor)
        tries = (
            run_to_its_end(engine, knocked(trim, by), near, LoopTask(command=-by, until=200.0), limits=LIMITS)
            for by in (5.0, 20.0, 40.0, 60.0)
        )
        return [isinstance(run.outcome, Settled) for run in tries]

    assert all(ends(0.97))
    assert not all(ends(1.03))


@pytest.mark.slow
def test_a_family_too_small_for_the_amplitude_asked_for_is_followed_in_smaller_steps(engine: DelaySystem) -> None:
    """At 70 deg the throttle's limit holds cycles below 2 rad/s: a first amplitude of that is none, smaller ones are."""
    trim = find_trim(engine, inputs={"throttle": 70.0})
    found = find_onset(engine, trim, gains(1.0, 3.0), RayTask(command=2.0, largest=22.0), limits=LIMITS)
    assert len(found.points) >= onset.FEWEST
    assert found.points[0].amplitude < 2.0
    assert found.kind == "soft"


def test_cycles_that_cannot_be_judged_do_not_hide_the_others(engine: DelaySystem, trim: Trim, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails_at_first(system: DelaySystem, inputs: np.ndarray, *arguments: object, **options: object) -> object:
        if not tried:
            tried.append(1)
            raise NotConvergedError("the kinks do not stay")
        return find_kinked_cycle(system, inputs, *arguments, **options)  # type: ignore[arg-type]  # passed on as they came

    tried: list[int] = []
    monkeypatch.setattr(onset, "find_kinked_cycle", fails_at_first)
    found = find_onset(engine, trim, C1, RayTask(command=60.0, largest=2.0), limits=LIMITS)
    assert [point.reason for point in found.unjudged] == ["the kinks do not stay"]
    assert found.unjudged[0].factor > found.factor
    assert len(found.points) == onset.POINTS - 1


def test_a_family_without_smooth_cycles_is_an_error(engine: DelaySystem, trim: Trim, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onset, "SMALLER", 0)
    monkeypatch.setattr(onset, "COARSE", -1.0)
    with pytest.raises(NotConvergedError, match=r"no cycle near the onset at 30\.\d+ rad/s is smooth enough"):
        find_onset(engine, trim, C1, RayTask(command=60.0, largest=2.0), limits=LIMITS)
    monkeypatch.setattr(onset, "follow_cycles", lambda *_, **__: (_ for _ in ()).throw(NotConvergedError("begin with a smaller one")))
    with pytest.raises(NotConvergedError, match="begin with a smaller one"):
        find_onset(engine, trim, C1, RayTask(command=60.0, largest=2.0), limits=LIMITS)


def test_a_cycle_that_cannot_be_computed_is_given_as_simulated(
    engine: DelaySystem, point: OperatingPoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = hunt(engine, point, C1, 60.0)
    assert isinstance(refine_cycle(engine, point, run), HuntingOrbit)

    def fails(*_: object, **__: object) -> object:
        raise NotConvergedError("not resolved with 65 elements")

    monkeypatch.setattr(hunting, "find_kinked_cycle", fails)
    found = refine_cycle(engine, point, run)
    assert isinstance(found, UnrefinedCycle)
    assert found.simulated is run.outcome
    assert found.reason == "not resolved with 65 elements"


def knocked(trim: Trim, by: float) -> OperatingPoint:
    """The trim with its speed raised."""
    point = operating_point(trim)
    return replace(point, states=point.states + np.array([0.0, by]), measurement=point.measurement + by)


def test_onsets_that_are_none_are_errors(engine: DelaySystem, trim: Trim, monkeypatch: pytest.MonkeyPatch) -> None:
    task = RayTask(command=60.0, largest=1.0)
    with pytest.raises(AnalysisError, match="no factor of the gains kp = -1, ki = -5"):
        find_onset(engine, trim, gains(-1.0, -5.0), task, limits=LIMITS)
    with pytest.raises(InvalidInputError, match="all gains are 0"):
        find_onset(engine, trim, gains(0.0, 0.0), task, limits=LIMITS)
    with pytest.raises(AnalysisError, match=r"the command leads to throttle = 30\.0017 deg, not within the limits 0 to 28 deg"):
        find_onset(engine, trim, C1, task, limits=Limits(0.0, 28.0))
    with pytest.raises(InvalidInputError, match="lies outside the limits 30 to 40 deg"):
        find_onset(engine, trim, C1, task, limits=Limits(30.0, 40.0))
    monkeypatch.setattr(onset, "FLAT", 1.0)
    with pytest.raises(NotConvergedError, match="whether hunting begins softly or hard is not decided"):
        find_onset(engine, trim, C1, task, limits=LIMITS)
    for unusable in ({"command": np.inf, "largest": 1.0}, {"command": 1.0, "largest": 0.0}):
        with pytest.raises(InvalidInputError, match=r"command step = inf|largest amplitude = 0"):
            RayTask(**unusable)


def test_first_cycles_that_contradict_one_another_tell_no_kind(engine: DelaySystem, trim: Trim, monkeypatch: pytest.MonkeyPatch) -> None:
    def turned(*arguments: object, **options: object) -> object:
        found = follow_cycles(*arguments, **options)  # type: ignore[arg-type]  # passed on as they came
        return (replace(found[0], parameter=0.89), replace(found[1], parameter=0.5), *found[2:])

    monkeypatch.setattr(onset, "follow_cycles", turned)
    with pytest.raises(NotConvergedError, match="tell no kind of onset"):
        find_onset(engine, trim, C1, RayTask(command=60.0, largest=1.0), limits=LIMITS)
