"""Limit cycles by harmonic balance: against known oscillators and simulation, with their stability."""

from typing import NamedTuple

import numpy as np
import pytest

from revline.analysis import limit_cycles
from revline.analysis.harmonic_balance import BalanceSettings
from revline.analysis.limit_cycles import CycleGuess, find_cycle, judge_cycle
from revline.dde.simulate import Start, simulate
from revline.equations import equation
from revline.errors import InvalidInputError, NotConvergedError
from revline.system import DelaySystem, Variable
from tests.analysis.echo import Echo, build_echo

Vector = tuple[float, ...]
FINE = BalanceSettings(tolerance=1e-10, most_harmonics=256)


class Strength(NamedTuple):
    """The one parameter of an oscillator."""

    strength: float


@equation
def first_of(p: Strength, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def unit_lag(p: Strength, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0,)


@equation
def van_der_pol_rate(p: Strength, x: Vector, u: Vector, zd: Vector) -> Vector:
    return x[1], p.strength * (1.0 - x[0] * x[0]) * x[1] - x[0] + u[0] + 0.0 * zd[0]


@equation
def beside_rate(p: Strength, x: Vector, u: Vector, zd: Vector) -> Vector:
    """Van der Pol's oscillator with two states that rest: at a value, and at 0."""
    return *van_der_pol_rate(p, x, u, zd), 0.3 - x[2], -x[3]


@equation
def subcritical_rate(p: Strength, x: Vector, u: Vector, zd: Vector) -> Vector:
    """A circle of radius 1 that is left on both sides."""
    square = x[0] * x[0] + x[1] * x[1]
    pull = p.strength * (square - 1.0)
    return pull * x[0] + x[1] + u[0] + 0.0 * zd[0], pull * x[1] - x[0]


def build(rate: object, strength: float, states: int) -> DelaySystem:
    return DelaySystem(
        name="oscillator",
        parameters=Strength(strength),
        states=tuple(Variable(name=f"state{k}", unit="m", search_low=-5.0, search_high=5.0) for k in range(states)),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(Variable(name="echo", unit="m"),),
        outputs=(Variable(name="seen", unit="m"),),
        emit=first_of,
        lags=unit_lag,
        rate=rate,  # type: ignore[arg-type]  # a plain function; its exact signature does not matter here
        output=first_of,
    )


def circle(period: float, radius: float, states: int = 2) -> CycleGuess:
    phases = 2.0 * np.pi * np.arange(16) / 16
    waves = (np.cos(phases), -np.sin(phases))[:states]
    return CycleGuess(period=period, states=radius * np.stack(waves, axis=1))


@pytest.mark.reference
def test_van_der_pols_oscillator() -> None:
    """Period 6.6632868593 and amplitude 2.0086198608 at strength 1: Andersen and Geer (1982), SIAM J. Appl. Math. 42(3), 678-693."""
    system = build(van_der_pol_rate, 1.0, 2)
    found = find_cycle(system, np.zeros(1), circle(6.3, 2.0), settings=FINE)
    assert found.period == pytest.approx(6.6632868593, abs=2e-10)
    assert found.extremes(0) == pytest.approx((-2.0086198608, 2.0086198608), abs=1e-6)
    assert found.error < 1e-10
    # The multiplier beside 1 is exp of the integral of the divergence.
    orbit = found.orbit
    wanted = np.exp(found.period * np.mean(1.0 - orbit.states[:, 0] ** 2))
    judged = judge_cycle(system, found)
    assert judged.stable
    assert judged.multipliers.values[0] == pytest.approx(wanted, abs=1e-7)
    assert judged.trivial_error < 1e-6


@pytest.mark.parametrize("settings", [FINE, BalanceSettings(tolerance=1e-12, most_harmonics=16)], ids=["by harmonics", "by change"])
def test_states_that_rest_change_nothing(settings: BalanceSettings) -> None:
    start = circle(6.3, 2.0)
    alone = find_cycle(build(van_der_pol_rate, 1.0, 2), np.zeros(1), start, settings=settings)
    states = np.column_stack((start.states, np.full(16, 0.3), np.zeros(16)))
    beside = find_cycle(build(beside_rate, 1.0, 4), np.zeros(1), CycleGuess(period=6.3, states=states), settings=settings)
    assert beside.period == pytest.approx(alone.period, rel=1e-12)
    assert beside.orbit.harmonics == alone.orbit.harmonics
    assert beside.error == pytest.approx(alone.error, rel=1e-6)


@pytest.mark.parametrize("strength", [1.7, 2.5, 4.0])
def test_a_delayed_negative_feedback_has_period_four_lags(strength: float) -> None:
    """x' = -f(x(t - 1)) with odd f: Kaplan and Yorke (1974), J. Math. Anal. Appl. 48(2), 317-324; also x(t - 2) = -x(t)."""
    system = build_echo(Echo(strength, smooth=1.0), "oscillator")
    found = find_cycle(system, np.zeros(1), circle(4.1, 1.0, states=1), settings=FINE)
    assert found.period == pytest.approx(4.0, abs=1e-9)
    # With y = x(t - 1), ln(1 + x^2) + ln(1 + y^2) stays constant.
    x, y = found.orbit.states[:, 0], found.orbit.readings[:, 0]
    energy = np.log1p(x**2) + np.log1p(y**2)
    assert np.ptp(energy) < 1e-8
    assert judge_cycle(system, found).stable


def test_an_unstable_cycle_is_found_and_judged_so() -> None:
    """The circle of radius 1 is left by every neighbour: its multiplier is exp(2 a 2 pi)."""
    system = build(subcritical_rate, 0.1, 2)
    found = find_cycle(system, np.zeros(1), circle(6.0, 1.2), settings=FINE)
    assert found.period == pytest.approx(2.0 * np.pi, rel=1e-10)
    assert found.extremes(0) == pytest.approx((-1.0, 1.0), abs=1e-9)
    judged = judge_cycle(system, found)
    assert not judged.stable
    assert judged.multipliers.largest == pytest.approx(np.exp(0.4 * np.pi), rel=1e-6)


def test_a_simulation_leads_to_its_cycle() -> None:
    system = build_echo(Echo(2.5, smooth=1.0), "oscillator")
    run = simulate(system, Start(states=np.array([0.1]), inputs=np.zeros(1)), {}, until=120.0, step=0.01)
    found = find_cycle(system, np.zeros(1), CycleGuess.from_run(run.times, run.states, 4.02))
    assert found.period == pytest.approx(4.0, abs=1e-6)
    assert found.extremes(0)[1] == pytest.approx(np.max(run.states[-500:, 0]), abs=1e-4)


def test_a_guess_without_a_cycle_is_an_error() -> None:
    system = build_echo(Echo(1.2, smooth=1.0), "oscillator")  # below pi / 2 the equilibrium is stable and there is none
    with pytest.raises(NotConvergedError, match="no limit cycle of oscillator"):
        find_cycle(system, np.zeros(1), circle(4.1, 0.1, states=1))


def test_newtons_method_that_comes_to_rest_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limit_cycles, "NO_SWING", 1e9)
    with pytest.raises(NotConvergedError, match=r"leads to the equilibrium at state0 = 2 m, state1 = -?0 m"):
        find_cycle(build(van_der_pol_rate, 1.0, 2), np.zeros(1), circle(6.3, 2.0))


def test_a_multiplier_that_should_be_one_and_is_not_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    system = build(van_der_pol_rate, 1.0, 2)
    found = find_cycle(system, np.zeros(1), circle(6.3, 2.0))
    monkeypatch.setattr(limit_cycles, "TRIVIAL", 1e-16)
    with pytest.raises(NotConvergedError, match="a shift along it has multiplier"):
        judge_cycle(system, found)


def test_unusable_guesses_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"period = 0 s"):
        circle(0.0, 1.0)
    with pytest.raises(InvalidInputError, match=r"shape \(4, 2\) is no cycle"):
        CycleGuess(period=1.0, states=np.zeros((4, 2)))
    with pytest.raises(InvalidInputError, match="the guess has 1 states where oscillator has 2"):
        find_cycle(build(van_der_pol_rate, 1.0, 2), np.zeros(1), circle(6.0, 1.0, states=1))
    with pytest.raises(InvalidInputError, match=r"period = 3 s .*longer run"):
        CycleGuess.from_run(np.array([0.0, 1.0]), np.zeros((2, 1)), 3.0)
