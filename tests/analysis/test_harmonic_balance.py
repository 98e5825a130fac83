"""Periodic answers by harmonic balance: against closed forms, published values, and simulation."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.special import jv

from revline.analysis.exact_response import find_exact_response
from revline.analysis.harmonic_balance import BalanceSettings, HarmonicBalance, balance_harmonics
from revline.analysis.periodic import Excitation, RunSettings
from revline.analysis.sinestream import find_sinestream
from revline.analysis.trim import find_trim
from revline.equations import equation
from revline.errors import AnalysisError, InvalidInputError, LagError, NotConvergedError
from revline.system import DelaySystem, Variable

OMEGA = np.array([0.05, 0.5, 2.0, 7.0, 25.0, 60.0])
Vector = tuple[float, ...]


def sine_on(output: str, amplitude: float = 0.25) -> Excitation:
    return Excitation(input_name="force", output_name=output, amplitude=amplitude)


def throttle(amplitude: float) -> Excitation:
    return Excitation(input_name="throttle", output_name="engine_speed", amplitude=amplitude)


def balance_engine(engine: DelaySystem, angle: float, amplitude: float, omega: object, load: float = 0.0) -> HarmonicBalance:
    trim = find_trim(engine, inputs={"throttle": angle, "load_torque": load})
    return balance_harmonics(engine, trim, throttle(amplitude), np.asarray(omega))


def test_a_linear_system_answers_as_its_closed_form(wiener: DelaySystem) -> None:
    trim = find_trim(wiener, inputs={"force": 0.5})
    found = balance_harmonics(wiener, trim, sine_on("straight"), OMEGA)
    assert found.fundamental.values == pytest.approx(3.0 / (3.0 + 1j * OMEGA) * np.exp(-0.3j * OMEGA), rel=1e-12)
    assert found.phase_deg == pytest.approx(-np.degrees(np.arctan(OMEGA / 3.0) + 0.3 * OMEGA), abs=1e-9)
    assert np.all(found.distortion < 1e-12)
    assert found.mean == pytest.approx(0.5, rel=1e-13)
    assert found.notes == ()
    assert found.response().method == "harmonic balance"
    assert found.response().phase_deg == pytest.approx(found.phase_deg, abs=1e-6)


def test_a_bent_output_has_the_distortion_and_mean_of_its_bend(wiener: DelaySystem) -> None:
    """x + c x^2 about x0 = 0.5 with amplitude a: fundamental (1 + 2 c x0) a, second harmonic c a^2 / 2, mean shift c a^2 / 2."""
    trim = find_trim(wiener, inputs={"force": 0.5})
    found = balance_harmonics(wiener, trim, sine_on("bent"), OMEGA)
    swing = 0.25 * 3.0 / np.hypot(3.0, OMEGA)
    assert found.amplitude == pytest.approx(1.2 * swing, rel=1e-12)
    assert found.harmonics[:, 1] == pytest.approx(0.1 * swing**2, rel=1e-10)
    assert found.distortion == pytest.approx(0.1 * swing / 1.2, rel=1e-10)
    assert found.mean_shift == pytest.approx(0.1 * swing**2, rel=1e-9)


class Swinging(NamedTuple):
    """Parameters of a delay that the input itself lengthens."""

    pole: float = 2.0
    lag: float = 0.8
    lag_slope: float = 0.3


@equation
def swinging_emit(p: Swinging, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def swinging_lags(p: Swinging, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.lag + p.lag_slope * u[0],)


@equation
def swinging_rate(p: Swinging, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.pole * (u[0] - x[0]),)


@equation
def swinging_output(p: Swinging, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (zd[0],)


def build_swinging(parameters: Swinging) -> DelaySystem:
    return DelaySystem(
        name="swinging",
        parameters=parameters,
        states=(Variable(name="level", unit="m", search_low=-3.0, search_high=3.0),),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(Variable(name="sent", unit="m"),),
        outputs=(Variable(name="late", unit="m"),),
        emit=swinging_emit,
        lags=swinging_lags,
        rate=swinging_rate,
        output=swinging_output,
    )


def test_a_varying_delay_modulates_as_bessel_functions_say() -> None:
    """x(t - lag - s a sin(w t)) of a linear x: the Jacobi-Anger expansion gives every harmonic."""
    parameters = Swinging()
    system = build_swinging(parameters)
    omega, amplitude = np.array([0.3, 2.0, 5.0]), 0.6
    found = balance_harmonics(system, find_trim(system), sine_on("late", amplitude), omega, settings=BalanceSettings(tolerance=1e-11))
    forward = parameters.pole / (parameters.pole + 1j * omega) * np.exp(-1j * omega * parameters.lag)
    depth = omega * parameters.lag_slope * amplitude
    for k in range(omega.size):
        # a Im{G exp(j(p - d sin p))}: coefficient of exp(j m p) in exp(j(p - d sin p)) is J_{1-m}(d)
        number = np.arange(9)
        positive, negative = jv(1 - number, depth[k]), jv(1 + number, depth[k])
        coefficients = amplitude * (forward[k] * positive - np.conj(forward[k]) * negative) / 1j
        assert found.fundamental.values[k] * amplitude == pytest.approx(1j * coefficients[1], rel=1e-10)
        assert found.harmonics[k] == pytest.approx(np.abs(coefficients[1:9]), abs=1e-11)
        assert found.mean[k] == pytest.approx(0.5 * coefficients[0].real, abs=1e-12)


def test_a_delay_taken_as_constant_is_seen() -> None:
    """Negative control of the test above: the same system with its lag held gives another answer."""
    omega, amplitude = np.array([2.0, 5.0]), 0.6
    varying, held = (build_swinging(Swinging(lag_slope=slope)) for slope in (0.3, 0.0))
    values = [balance_harmonics(s, find_trim(s), sine_on("late", amplitude), omega).fundamental.values for s in (varying, held)]
    assert np.all(np.abs(values[0] - values[1]) > 0.01 * np.abs(values[1]))


@pytest.mark.reference
def test_the_engine_answers_as_converged_simulations(engine: DelaySystem) -> None:
    """Converged values for the engine of Lee (1995) at 25 +- 5 deg, computed twice independently, to their last digit."""
    omega = np.array([0.1, 1.0, 5.0, 10.0, 20.0, 50.0, 100.0])
    found = balance_engine(engine, 25.0, 5.0, omega)
    assert found.amplitude == pytest.approx([60.0056, 54.0116, 22.0666, 10.8232, 4.4082, 0.9495, 0.2535], abs=6e-5)
    assert found.phase_deg == pytest.approx([-3.164, -29.874, -87.620, -116.793, -153.450, -218.974, -295.286], abs=6e-4)
    assert found.distortion[[0, 1, 2, 3, 6]] == pytest.approx([0.0017, 0.017, 0.037, 0.034, 0.014], abs=5e-4)
    assert found.mean[[0, 2, 6]] == pytest.approx([240.77, 243.02, 243.64], abs=6e-3)
    assert np.all(found.error < 1e-7)


def test_vanishing_amplitude_gives_the_exact_response(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 25.0})
    omega = np.geomspace(0.1, 100.0, 13)
    exact = find_exact_response(engine, trim, omega, input_name="throttle", output_name="engine_speed")
    errors = []
    for amplitude in (0.04, 0.02):
        found = balance_harmonics(engine, trim, throttle(amplitude), omega, settings=BalanceSettings(tolerance=1e-10))
        errors.append(np.max(np.abs(found.fundamental.values / exact.values - 1.0)))
    assert errors[1] < 2e-6
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.01)


def test_channels_that_follow_and_feed_one_another_agree_with_simulation(chain_out: DelaySystem) -> None:
    trim = find_trim(chain_out)
    omega = np.array([0.2, 1.0, 2.5])
    found = balance_harmonics(chain_out, trim, sine_on("level", 0.05), omega)
    stream = find_sinestream(chain_out, trim, sine_on("level", 0.05), omega, settings=RunSettings(tolerance=1e-8, step_tolerance=1e-8))
    assert found.fundamental.values == pytest.approx(stream.fourier.values, rel=1e-6)
    assert found.harmonics[:, 1] == pytest.approx(stream.harmonics[:, 1], rel=1e-4)


def test_a_limit_makes_the_error_larger_and_it_is_stated(engine: DelaySystem) -> None:
    """At 60 +- 20 deg the throttle's characteristic saturates: harmonics decay algebraically."""
    trim, excitation, omega = find_trim(engine, inputs={"throttle": 60.0}), throttle(20.0), np.array([0.1, 1.0, 5.0])
    found = {}
    for most in (16, 32, 128):
        found[most] = balance_harmonics(engine, trim, excitation, omega, settings=BalanceSettings(most_harmonics=most))
    for most in (16, 32):
        true = np.abs(found[most].fundamental.values / found[128].fundamental.values - 1.0)
        assert np.all(true <= found[most].error)
        assert np.all(found[most].error <= 1e3 * true)
        assert len(found[most].notes) == omega.size
        assert f"with {most} of them" in found[most].notes[0]


def test_an_unstable_trim_is_refused(engine: DelaySystem) -> None:
    with pytest.raises(AnalysisError, match="not open-loop stable"):
        balance_engine(engine, 4.0, 0.1, [1.0])


def test_a_frequency_of_zero_is_refused(engine: DelaySystem) -> None:
    with pytest.raises(InvalidInputError, match="frequency = 0 rad/s"):
        balance_engine(engine, 25.0, 1.0, [0.0, 1.0])


def test_where_newton_leads_to_states_that_mean_nothing_the_amplitude_is_raised_instead(engine: DelaySystem) -> None:
    """From the linear answer Newton's method ends at another solution here, with pressures from -44 to 194 kPa."""
    trim = find_trim(engine, inputs={"throttle": 29.150, "load_torque": 10.0})
    found = balance_harmonics(engine, trim, throttle(21.9), [0.14489])
    stream = find_sinestream(engine, trim, throttle(21.9), [0.14489])
    assert found.fundamental.values == pytest.approx(stream.fourier.values, rel=1e-6)
    pressures = found.orbits[0].states[:, 0]
    assert np.all((pressures > 0.0) & (pressures < 100.0))


def test_an_output_without_fundamental_is_refused(wiener: DelaySystem) -> None:
    trim = find_trim(wiener, inputs={"force": 0.0})
    for output in ("constant", "square"):
        with pytest.raises(AnalysisError, match=f"output {output} of wiener has no fundamental"):
            balance_harmonics(wiener, trim, sine_on(output), OMEGA)


def test_a_state_beyond_its_range_is_refused(wiener: DelaySystem) -> None:
    trim = find_trim(wiener, inputs={"force": -1.0})
    with pytest.raises(AnalysisError, match=r"level of wiener goes from -4\.\d+ to .* m on the orbit at 0\.05 rad/s, outside its range"):
        balance_harmonics(wiener, trim, sine_on("straight", 3.9), [0.05])


def test_delayed_time_that_runs_backwards_is_refused() -> None:
    system = build_swinging(Swinging(lag=5.0, lag_slope=1.0))
    with pytest.raises(LagError, match=r"channel sent of swinging delivers nothing .*rate of its delayed time falls to -0\.\d+ s/s"):
        balance_harmonics(system, find_trim(system), sine_on("late", 0.6), [2.0])


def test_a_lag_that_vanishes_is_refused() -> None:
    system = build_swinging(Swinging(lag=0.5, lag_slope=1.0))
    with pytest.raises(LagError, match=r"its lag falls to -0\.\d+ s \(limit 0\)"):
        balance_harmonics(system, find_trim(system), sine_on("late", 0.6), [0.5])


@equation
def softening_rate(p: Swinging, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0] * x[0] * x[0] - x[0] + u[0] + 0.0 * zd[0],)


def test_an_orbit_that_does_not_exist_is_an_error_that_says_how_far_it_got() -> None:
    """x' = x^3 - x + u: slowly driven it holds up to the fold at 2 / sqrt(27) = 0.385, and then runs away."""
    swinging = build_swinging(Swinging(lag_slope=0.0))
    system = replace(swinging, rate=softening_rate, output=swinging_emit, states=(replace(swinging.states[0], low=-1.0, high=1.0),))
    trim = find_trim(system, near={"level": 0.0})
    assert balance_harmonics(system, trim, sine_on("late", 0.37), [0.001]).error[0] < 1e-3
    with pytest.raises(NotConvergedError, match=r"no periodic answer of swinging found at 0\.001 rad/s with 0\.6 N .* one up to 0\.3[89]"):
        balance_harmonics(system, trim, sine_on("late", 0.6), [0.001])


@pytest.mark.parametrize(("name", "value"), [("tolerance", 0.0), ("tolerance", 1.0), ("most_harmonics", 4), ("most_harmonics", 5000)])
def test_settings_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidInputError, match=f"{name} = "):
        BalanceSettings(**{name: value})  # type: ignore[arg-type]  # one of two fields
