"""Floquet multipliers: against closed forms, characteristic roots, another integrator, and perturbed simulations."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from revline.analysis import floquet
from revline.analysis.floquet import find_floquet_multipliers
from revline.analysis.harmonic_balance import PeriodicOrbit, balance_harmonics
from revline.analysis.periodic import Excitation
from revline.analysis.trim import find_trim
from revline.dde.simulate import Start, simulate
from revline.equations import equation
from revline.errors import InvalidInputError, NotConvergedError
from revline.signals import sine
from revline.system import DelaySystem, Floats, Variable

Vector = tuple[float, ...]


class Pushed(NamedTuple):
    """Parameters of a system whose input moves its coefficients."""

    decay: float = 0.3
    lag: float = 2.0
    lag_slope: float = 0.0
    swinging: float = 1.0


@equation
def level_of(p: Pushed, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def level_lags(p: Pushed, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.lag + p.lag_slope * x[0],)


@equation
def modulated_rate(p: Pushed, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return ((u[0] - p.decay) * zd[0],)


@equation
def pushed_rate(p: Pushed, x: Vector, u: Vector, zd: Vector) -> Vector:
    """Mathieu's equation where `swinging` is 1, a delayed feedback of the first state where it is 0: one kernel for both."""
    swung = x[1], -(1.0 + u[0]) * x[0] - 2.0 * p.decay * x[1]
    driven = u[0] - p.decay * zd[0] - 0.1 * x[0] * x[0] * x[0], -3.0 * x[1]
    return (
        p.swinging * swung[0] + (1.0 - p.swinging) * driven[0],
        p.swinging * swung[1] + (1.0 - p.swinging) * driven[1],
    )


@equation
def input_out(p: Pushed, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0] + u[0],)


def build(rate: object, parameters: Pushed, states: int = 1) -> DelaySystem:
    return DelaySystem(
        name="pushed",
        parameters=parameters,
        states=tuple(Variable(name=f"state{k}", unit="m", search_low=-3.0, search_high=3.0) for k in range(states)),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(Variable(name="echo", unit="m"),),
        outputs=(Variable(name="seen", unit="m"),),
        emit=level_of,
        lags=level_lags,
        rate=rate,  # type: ignore[arg-type]  # a plain function; its exact signature does not matter here
        output=input_out,
    )


def rest(omega: float, amplitude: float, states: int = 1) -> PeriodicOrbit:
    """The orbit at rest of a system whose input moves coefficients only."""
    phases = 2.0 * np.pi * np.arange(17) / 17
    wave = amplitude * np.sin(phases)[:, None]
    return PeriodicOrbit(omega=omega, phases=phases, inputs=wave, states=np.zeros((17, states)), readings=np.zeros((17, 1)), outputs=wave)


def force(amplitude: float) -> Excitation:
    return Excitation(input_name="force", output_name="seen", amplitude=amplitude)


@pytest.mark.parametrize("turns", [1, 2])
def test_a_delay_of_whole_periods_has_its_closed_form(turns: int) -> None:
    """x' = (u - a) x(t - n T) with u of period T and mean 0: mu = exp(-a T / mu^n), so mu = exp(W_k(-n a T) / n)."""
    decay, omega = 0.11, 2.0
    period = 2.0 * np.pi / omega
    found = find_floquet_multipliers(build(modulated_rate, Pushed(decay=decay, lag=turns * period)), rest(omega, 0.4), tolerance=1e-9)
    wanted = np.array([np.exp(lambertw(-turns * decay * period, k) / turns) for k in range(-4, 4)])
    wanted = wanted[np.argsort(-np.abs(wanted))][:4]
    assert np.abs(found.values[:4]) == pytest.approx(np.abs(wanted), rel=1e-7)
    assert np.sort(np.abs(found.values[:4].imag)) == pytest.approx(np.sort(np.abs(wanted.imag)), abs=1e-7)
    assert found.certain


def test_a_small_orbit_has_the_characteristic_roots(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 25.0})
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=1e-4)
    found = balance_harmonics(engine, trim, excitation, [5.0, 20.0, 100.0, 400.0])
    for orbit in found.orbits:
        multipliers = find_floquet_multipliers(engine, orbit)
        wanted = np.exp(2.0 * np.pi / orbit.omega * trim.roots.roots[:2].real)
        assert multipliers.values[:2] == pytest.approx(wanted, rel=1e-6, abs=1e-9)
        assert multipliers.stable


def mathieu_multiplier(decay: float, amplitude: float, omega: float) -> float:
    """Largest multiplier by another integrator."""

    def slope(t: float, x: Floats) -> Floats:
        return np.array([x[1], -(1.0 + amplitude * np.sin(omega * t)) * x[0] - 2.0 * decay * x[1]])

    columns = [solve_ivp(slope, (0.0, 2.0 * np.pi / omega), start, rtol=1e-11, atol=1e-13).y[:, -1] for start in np.eye(2)]
    return float(np.max(np.abs(np.linalg.eigvals(np.array(columns).T))))


@pytest.mark.parametrize("amplitude", [0.1, 0.19, 0.21, 0.5])
def test_parametric_resonance_agrees_with_another_integrator(amplitude: float) -> None:
    """x'' + 2 d x' + (1 + a sin 2 t) x = 0 is unstable from about a = 4 d on."""
    found = find_floquet_multipliers(build(pushed_rate, Pushed(decay=0.05), states=2), rest(2.0, amplitude, states=2))
    assert found.largest == pytest.approx(mathieu_multiplier(0.05, amplitude, 2.0), rel=1e-6)
    assert found.stable is (amplitude < 0.2)
    assert found.certain


def decay_per_period(system: DelaySystem, states: Floats, inputs: Floats, excitation: Excitation, omega: float) -> float:
    """Factor per period by which a run from somewhere nears, or leaves, its orbit."""
    period = 2.0 * np.pi / omega
    steps = 1024
    signals = {excitation.input_name: sine(excitation.amplitude, omega)}
    run = simulate(system, Start(states=states, inputs=inputs), signals, until=15.75 * period, step=period / steps)
    at = run.states[:, 0]
    differences = [at[(k + 1) * steps] - at[k * steps] for k in (13, 14)]
    return float(differences[1] / differences[0])


def test_a_planted_unstable_orbit_is_found_and_a_perturbed_run_leaves_it() -> None:
    system = build(pushed_rate, Pushed(decay=0.05), states=2)
    found = find_floquet_multipliers(system, rest(2.0, 0.5, states=2))
    assert not found.stable
    assert found.largest > 1.2
    growth = decay_per_period(system, np.array([1e-3, 0.0]), np.zeros(1), force(0.5), 2.0)
    assert abs(growth) == pytest.approx(found.largest, rel=1e-5)


def test_a_perturbed_run_nears_the_engines_orbit_by_the_largest_multiplier(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 25.0})
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=5.0)
    orbit = balance_harmonics(engine, trim, excitation, [20.0]).orbits[0]
    found = find_floquet_multipliers(engine, orbit)
    assert decay_per_period(engine, trim.states, trim.inputs, excitation, 20.0) == pytest.approx(found.largest, rel=1e-4)


def test_a_lag_that_moves_with_the_state_changes_the_multiplier_as_simulated() -> None:
    """With a steep lag the multiplier is that of the simulation, and not that of the same orbit with the lag held."""
    system = build(pushed_rate, Pushed(decay=0.2, lag=0.8, lag_slope=0.5, swinging=0.0), states=2)
    trim = find_trim(system)
    orbit = balance_harmonics(system, trim, force(0.7), [1.5]).orbits[0]
    found = find_floquet_multipliers(system, orbit, tolerance=1e-9)
    assert found.values[0].imag == 0.0
    aside = trim.states + np.array([0.1, 0.0])
    assert decay_per_period(system, aside, trim.inputs, force(0.7), 1.5) == pytest.approx(found.largest, rel=1e-5)
    mean = float(np.mean(orbit.states[:, 0]))
    held = build(pushed_rate, Pushed(decay=0.2, lag=0.8 + 0.5 * mean, swinging=0.0), states=2)
    assert abs(find_floquet_multipliers(held, orbit).largest / found.largest - 1.0) > 1e-3


def test_an_unresolved_multiplier_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    system = build(pushed_rate, Pushed(decay=0.05), states=2)
    monkeypatch.setattr(floquet, "MOST_ELEMENTS", 8)
    with pytest.raises(NotConvergedError, match=r"orbit of pushed at 2 rad/s is not resolved with 8 elements"):
        find_floquet_multipliers(system, rest(2.0, 0.5, states=2))
    monkeypatch.setattr(floquet, "MOST_ELEMENTS", 256)
    monkeypatch.setattr(floquet, "MOST_UNKNOWNS", 10)
    with pytest.raises(NotConvergedError, match="give a larger tolerance"):
        find_floquet_multipliers(system, rest(2.0, 0.5, states=2))


def test_a_multiplier_of_about_one_is_uncertain() -> None:
    found = find_floquet_multipliers(build(pushed_rate, Pushed(decay=0.05), states=2), rest(2.0, 0.1, states=2))
    assert not replace(found, values=np.array([1.0 + 0.5 * found.error])).certain


@pytest.mark.parametrize(("name", "value"), [("tolerance", 0.0), ("tolerance", 2.0), ("count", 0)])
def test_wrong_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidInputError, match=f"{name} = "):
        find_floquet_multipliers(build(pushed_rate, Pushed(), states=2), rest(2.0, 0.1, states=2), **{name: value})  # type: ignore[arg-type]  # one of two
