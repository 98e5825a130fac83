"""Cycles that cross limits: against exact piecewise solutions, with and without elements that meet the kinks."""

import tracemalloc
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import fsolve

from revline.analysis import kinked_cycles
from revline.analysis.kinked_cycles import KinkedCycle, find_kinked_cycle, solve_on_elements
from revline.analysis.limit_cycles import CycleGuess
from revline.analysis.monodromy import Blocks, Monodromy
from revline.analysis.pieces import Pieces
from revline.dde.simulate import Start, simulate
from revline.equations import equation
from revline.errors import InvalidInputError, NotConvergedError
from revline.lti.batches import solve_each
from revline.system import DelaySystem, Floats, Variable
from tests.analysis.echo import Echo, build_echo

Vector = tuple[float, ...]


class Limited(NamedTuple):
    """How steeply the damping rises beyond a state of 1."""

    gain: float


@equation
def first_of(p: Limited, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def lags(p: Limited, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0,)


@equation
def lienard_rate(p: Limited, x: Vector, u: Vector, zd: Vector) -> Vector:
    """x' = y - F(x), y' = -x, F' = -0.5 inside of |x| = 1 and the gain outside."""
    beyond = np.maximum(x[0], 1.0) - 1.0 + np.minimum(x[0], -1.0) + 1.0
    return x[1] + 0.5 * x[0] - (p.gain + 0.5) * beyond + u[0] + 0.0 * zd[0], -x[0]


@equation
def beside_rate(p: Limited, x: Vector, u: Vector, zd: Vector) -> Vector:
    """The same with two states that rest: at a value, and at 0."""
    return *lienard_rate(p, x, u, zd), 0.3 - x[2], -x[3]


def build(rate: object, parameters: Limited, states: int) -> DelaySystem:
    return DelaySystem(
        name="limited",
        parameters=parameters,
        states=tuple(Variable(name=f"state{k}", unit="m", search_low=-5.0, search_high=5.0) for k in range(states)),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(Variable(name="echo", unit="m"),),
        outputs=(Variable(name="seen", unit="m"),),
        emit=first_of,
        lags=lags,
        rate=rate,  # type: ignore[arg-type]  # a plain function; its exact signature does not matter here
        output=first_of,
    )


def guess(period: float, radius: float, states: int = 1) -> CycleGuess:
    phases = 2.0 * np.pi * np.arange(64) / 64
    return CycleGuess(period=period, states=radius * np.stack((np.cos(phases), -np.sin(phases))[:states], axis=1))


def test_more_kinks_than_memory_holds_are_refused_before_anything_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    """With 400 kinks in a period the equations alone would take a gigabyte; 4 are met all the same."""
    monkeypatch.setattr(kinked_cycles, "find_kinks", lambda *_: (np.empty(0), (np.arange(400) + 0.5) / 400.0))
    tracemalloc.start()
    words = r"the cycle of limited near 1 rad/s has 400 kinks in a period, and elements that meet them have 6015 unknowns \(limit 5000\)"
    with pytest.raises(NotConvergedError, match=words) as caught:
        find_kinked_cycle(build(lienard_rate, Limited(1.0), 2), np.zeros(1), guess(2.0 * np.pi, 1.5, 2))
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    assert caught.value.details["kinks"] == 400


def test_a_past_of_too_many_periods_is_refused_before_anything_is_built() -> None:
    """A channel of 100 periods on 12 elements holds 6,001 values."""
    pieces, blank = Pieces.lay(12, np.empty(0)), np.zeros((60, 1, 1))
    held = Blocks(lags=np.full((60, 1), 200.0), rate_x=blank - 1.0, rate_s=blank, emit_x=blank + 1.0, emit_s=blank)
    words = r"an orbit of 2 s is not found: its channels hold 200 s, which takes \d+ values on its elements \(limit 5000\); simulate it"
    with pytest.raises(NotConvergedError, match=words):
        Monodromy(pieces, 2.0, held).multipliers()
    short = Blocks(lags=np.full((60, 1), 1.0), rate_x=blank - 1.0, rate_s=blank, emit_x=blank + 1.0, emit_s=blank)
    assert np.abs(Monodromy(pieces, 2.0, short).multipliers()[0]) == pytest.approx(np.exp(-2.0), rel=1e-9)


def on(system: DelaySystem, start: CycleGuess, elements: int, meet: int) -> KinkedCycle:
    """The cycle on a given number of elements."""
    return solve_on_elements(system, np.zeros(1), start, elements=elements, meet_kinks=meet)


def exact_lienard(gain: float) -> tuple[float, float, float]:
    """Period, largest x and multiplier from matrix exponentials of the two linear parts; half a period, by symmetry."""
    inner = np.array([[0.5, 1.0], [-1.0, 0.0]])
    outer = np.array([[-gain, 1.0, gain + 0.5], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # the constant as a third state

    def miss(unknown: Floats) -> Floats:
        height, outside, inside = unknown
        back = expm(outer * outside) @ np.array([1.0, height, 1.0])
        across = expm(inner * inside) @ back[:2]
        return np.array([back[0] - 1.0, across[0] + 1.0, across[1] + height])

    height, outside, inside = fsolve(miss, np.array([1.5, 1.5, 1.2]), xtol=1e-13)
    times = np.linspace(0.0, outside, 4001)
    largest = max(float((expm(outer * t) @ np.array([1.0, height, 1.0]))[0]) for t in times[1200:2800])
    return 2.0 * (outside + inside), largest, float(np.exp(2.0 * (0.5 * inside - gain * outside)))


def test_a_piecewise_linear_oscillator_has_its_exact_period_size_and_multiplier() -> None:
    period, largest, multiplier = exact_lienard(1.0)
    system = build(lienard_rate, Limited(1.0), 2)
    found = find_kinked_cycle(system, np.zeros(1), guess(6.5, 1.8, 2), tolerance=1e-9)
    assert found.period == pytest.approx(period, rel=1e-9)
    assert found.extremes(0) == pytest.approx((-largest, largest), abs=1e-6)
    assert found.multipliers[0] == pytest.approx(multiplier, abs=1e-8)
    assert found.switches.size == 4
    assert found.stable
    assert found.certain
    assert found.residual() < 1e-8


def test_states_that_rest_change_nothing() -> None:
    alone = find_kinked_cycle(build(lienard_rate, Limited(1.0), 2), np.zeros(1), guess(6.5, 1.8, 2))
    start = guess(6.5, 1.8, 2)
    states = np.column_stack((start.states, np.full(64, 0.3), np.zeros(64)))
    beside = find_kinked_cycle(build(beside_rate, Limited(1.0), 4), np.zeros(1), CycleGuess(period=6.5, states=states))
    assert beside.period == pytest.approx(alone.period, rel=1e-9)
    assert beside.multipliers[0] == pytest.approx(alone.multipliers[0], abs=1e-8)
    assert max(beside.error, beside.multiplier_error) <= 1e-6
    assert beside.residual() < 1e-4


def errors(system: DelaySystem, start: CycleGuess, exact: tuple[float, float], meet: int) -> Floats:
    """Errors of period and multiplier on 8, 16 and 32 elements."""
    found = [on(system, start, elements, meet) for elements in (8, 16, 32)]
    return np.array([[abs(f.period - exact[0]), abs(f.multipliers[0] - exact[1])] for f in found])


def test_elements_that_meet_the_kinks_keep_the_order_and_others_lose_it() -> None:
    """Negative control: on equal elements the same computation is of low order, so that the kinks are what makes the difference."""
    period, _, multiplier = exact_lienard(1.0)
    system = build(lienard_rate, Limited(1.0), 2)
    met = errors(system, guess(6.5, 1.8, 2), (period, multiplier), 1)
    unmet = errors(system, guess(6.5, 1.8, 2), (period, multiplier), -1)
    assert np.all(met[1] < 1e-8)
    assert np.all(unmet[2] > 1e3 * met[1])
    assert np.all(np.log2(unmet[0] / unmet[2]) / 2.0 < 4.0)


@pytest.mark.parametrize("gain", [1.8, 2.5, 5.0])
def test_a_delayed_limited_feedback_has_period_four_lags(gain: float) -> None:
    """x' = -f(x(t - 1)) with odd f: Kaplan and Yorke (1974); here the kinks pass through the channel."""
    found = find_kinked_cycle(build_echo(Echo(gain), "limited"), np.zeros(1), guess(4.1, 0.8), tolerance=1e-8)
    assert found.period == pytest.approx(4.0, abs=1e-10)
    level = np.arange(400) / 400
    x = found.output(0, level)
    echo = found.output(0, level - 1.0 / found.period)

    def energy(v: Floats) -> Floats:
        return np.where(np.abs(v) * gain <= 1.0, 0.5 * gain * v * v, np.abs(v) - 0.5 / gain)

    assert np.ptp(energy(x) + energy(echo)) < 1e-9
    assert found.kinks.size > found.switches.size > 0
    assert found.trivial_error < 1e-8


def test_kinks_followed_through_a_channel_raise_the_accuracy() -> None:
    """Negative control: elements that end only where the equations themselves switch do worse than those that meet the echo too."""
    system = build_echo(Echo(2.5, lag_slope=0.1), "limited")
    fine = on(system, guess(4.1, 0.8), 64, 2)
    followed, alone = (abs(on(system, guess(4.1, 0.8), 12, meet).period - fine.period) for meet in (2, 0))
    assert followed < 1e-8
    assert alone > 30.0 * followed


@pytest.mark.slow
def test_a_perturbed_simulation_nears_the_cycle_at_the_rate_of_the_largest_multiplier() -> None:
    """With a lag that moves with the state, on a cycle that touches its limits."""
    system = build_echo(Echo(1.6, lag_slope=0.3), "limited")
    found = find_kinked_cycle(system, np.zeros(1), guess(4.1, 1.0), tolerance=1e-8)
    assert found.switches.size > 0
    largest = float(found.multipliers[0].real)
    assert 0.2 < largest < 0.99
    run = simulate(system, Start(states=np.array([0.5 * found.extremes(0)[1]]), inputs=np.zeros(1)), {}, until=140.0, step=0.0025)
    x, t = run.states[:, 0], run.times
    tops = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:])) + 1
    near = np.linspace(-0.0025, 0.0025, 101)
    heights = np.array([np.max(np.polyval(np.polyfit(t[k - 2 : k + 3] - t[k], x[k - 2 : k + 3], 4), near)) for k in tops])
    assert heights[-1] == pytest.approx(found.extremes(0)[1], abs=1e-6)
    short = heights[-1] - heights
    at = next(k for k in range(short.size) if abs(short[k]) < 5e-4)
    assert short[at + 1] / short[at] == pytest.approx(largest, rel=0.005)


def test_what_cannot_be_resolved_is_an_error_with_its_numbers() -> None:
    system = build(lienard_rate, Limited(1.0), 2)
    with pytest.raises(NotConvergedError, match=r"limit cycle of limited at .* rad/s is not resolved with .* elements per period"):
        find_kinked_cycle(system, np.zeros(1), guess(6.5, 1.8, 2), tolerance=1e-9, most_unknowns=300)


def test_a_rough_cycle_whose_stability_is_certain_is_given_with_its_error() -> None:
    system = build(lienard_rate, Limited(1.0), 2)
    found = find_kinked_cycle(system, np.zeros(1), guess(6.5, 1.8, 2), tolerance=1e-10, most_unknowns=500)
    assert 1e-10 < max(found.error, found.multiplier_error) < 1e-3
    assert abs(found.period / exact_lienard(1.0)[0] - 1.0) < found.error


def test_newtons_method_that_fails_says_so() -> None:
    with pytest.raises(NotConvergedError, match=r"the cycle of limited near .* rad/s is not found on .* elements: the last step"):
        find_kinked_cycle(build(lienard_rate, Limited(-0.2), 2), np.zeros(1), guess(6.5, 1.8, 2))


def test_kinks_that_do_not_stay_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinked_cycles, "MOST_LAYOUTS", 1)
    with pytest.raises(NotConvergedError, match="do not stay where they are found"):
        find_kinked_cycle(build(lienard_rate, Limited(1.0), 2), np.zeros(1), guess(6.5, 1.8, 2))


def test_kinks_that_hardly_move_leave_an_error_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinked_cycles, "MOST_LAYOUTS", 3)
    monkeypatch.setattr(kinked_cycles, "MOVED", -1.0)  # they never count as still
    exact_period = exact_lienard(1.0)[0]
    found = find_kinked_cycle(build(lienard_rate, Limited(1.0), 2), np.zeros(1), guess(6.5, 1.8, 2), tolerance=1e-4)
    assert abs(found.period / exact_period - 1.0) <= found.error <= 1e-4
    monkeypatch.setattr(kinked_cycles, "ROUGH", -1.0)
    with pytest.raises(NotConvergedError, match="do not stay where they are found"):
        find_kinked_cycle(build(lienard_rate, Limited(1.0), 2), np.zeros(1), guess(6.5, 1.8, 2), tolerance=1e-4)


def test_a_cycle_that_finer_elements_do_not_find_is_given_by_the_coarser(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails_beyond(most: int) -> None:
        def solve(matrices: Floats, right: Floats) -> Floats:
            return np.full_like(right, np.nan) if right.size > most else solve_each(matrices, right)

        monkeypatch.setattr(kinked_cycles, "solve_each", solve)

    system = build(lienard_rate, Limited(1.0), 2)
    fails_beyond(500)  # 12, 24 and 48 elements, and those that kinks add, have 286, 466 and 856 unknowns
    found = find_kinked_cycle(system, np.zeros(1), guess(6.5, 1.8, 2), tolerance=1e-10)
    assert 1e-10 < max(found.error, found.multiplier_error) < kinked_cycles.ROUGH
    fails_beyond(300)
    with pytest.raises(NotConvergedError, match="is not found on"):
        find_kinked_cycle(system, np.zeros(1), guess(6.5, 1.8, 2), tolerance=1e-10)


def test_unusable_requests_are_refused() -> None:
    system = build(lienard_rate, Limited(1.0), 2)
    with pytest.raises(InvalidInputError, match="tolerance = 2 "):
        find_kinked_cycle(system, np.zeros(1), guess(6.5, 1.8, 2), tolerance=2.0)
    with pytest.raises(InvalidInputError, match="cannot be followed -2 times"):
        find_kinked_cycle(system, np.zeros(1), guess(6.5, 1.8, 2), meet_kinks=-2)
