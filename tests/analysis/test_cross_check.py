"""Three routes to a frequency response agree; planted faults in each of them are found, with the right numbers."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from revline.analysis import jacobians
from revline.analysis.cross_check import (
    FLOOR,
    LARGE_SIGNAL,
    LOOSEST,
    PROBES,
    SMALL_SIGNAL,
    CrossCheck,
    compare_routes,
    cross_check,
    simulation_error,
)
from revline.analysis.exact_response import find_exact_response
from revline.analysis.harmonic_balance import HarmonicBalance, balance_harmonics
from revline.analysis.linearize import linearize
from revline.analysis.periodic import Excitation, RunSettings
from revline.analysis.sinestream import Sinestream, find_sinestream
from revline.analysis.trim import Trim, find_trim
from revline.analysis.vanishing_amplitude import extrapolate_to_rest, find_reach
from revline.engine.lee1995 import lee1995_parameters
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.response import FrequencyResponse
from revline.lti.state_space import DelayStateSpace
from revline.system import DelaySystem

OMEGA = np.array([1.0, 10.0, 60.0])
SINE = Excitation(input_name="throttle", output_name="engine_speed", amplitude=5.0)


@pytest.fixture(scope="module")
def trim(engine: DelaySystem) -> Trim:
    return find_trim(engine, inputs={"throttle": 25.0})


@pytest.fixture(scope="module")
def model(engine: DelaySystem, trim: Trim) -> DelayStateSpace:
    return linearize(engine, trim).model


@pytest.fixture(scope="module")
def exact(model: DelayStateSpace) -> FrequencyResponse:
    return model.response(OMEGA, "throttle", "engine_speed")


@pytest.fixture(scope="module")
def stream(engine: DelaySystem, trim: Trim) -> Sinestream:
    return find_sinestream(engine, trim, SINE, OMEGA)


@pytest.fixture(scope="module")
def slow_engine(engine: DelaySystem) -> DelaySystem:
    """The engine with the lag from intake to torque 1 % longer; it rests where the other does."""
    parameters = lee1995_parameters(engine)
    rotations = parameters.delays._replace(intake_to_torque=1.01 * parameters.delays.intake_to_torque)
    return engine.with_parameters(parameters._replace(delays=rotations))


def drop_delay(model: DelayStateSpace) -> DelayStateSpace:
    return replace(model, lags=np.full(model.lags.size, 1e-12))


def drop_channel(model: DelayStateSpace) -> DelayStateSpace:
    return replace(model, Bz=model.Bz * np.array([0.0, 1.0]))


def lengthen_lag(model: DelayStateSpace) -> DelayStateSpace:
    return replace(model, lags=model.lags * np.array([1.01, 1.0]))


Plant = Callable[[DelayStateSpace], DelayStateSpace]


def test_the_routes_agree_on_the_engine(engine: DelaySystem, trim: Trim, exact: FrequencyResponse, stream: Sinestream) -> None:
    found = compare_routes(engine, trim, SINE, exact, stream=stream)
    assert found.agreed
    assert found.unchecked == ()
    found.require_agreement()
    small, large = found.comparison(SMALL_SIGNAL), found.comparison(LARGE_SIGNAL)
    assert np.all(small.tolerance < 1e-6)
    assert np.all(large.tolerance < 1e-5)
    assert np.all(np.abs(small.difference.magnitude) < 1e-9)
    assert np.all(small.used < 1.0)
    assert small.difference.omega[2:].tolist() == large.difference.omega.tolist() == OMEGA.tolist()
    assert np.all(small.tolerance_deg == np.degrees(small.tolerance))
    assert np.all(small.amplitude <= SINE.amplitude / 16.0)
    assert np.all(large.amplitude == SINE.amplitude)


def test_all_three_routes_are_found_and_checked_in_one_call(wiener: DelaySystem) -> None:
    sine = Excitation(input_name="force", output_name="bent", amplitude=0.25)
    found = cross_check(wiener, find_trim(wiener, inputs={"force": 0.5}), sine, [0.5, 7.0])
    assert found.agreed
    assert [c.difference.routes for c in found.comparisons] == [SMALL_SIGNAL, LARGE_SIGNAL]
    omega = found.comparison(SMALL_SIGNAL).difference.omega
    closed_form = 1.2 * 3.0 / (3.0 + 1j * omega) * np.exp(-0.3j * omega)
    assert found.vanishing.values == pytest.approx(closed_form, rel=1e-8)


def test_channels_that_follow_one_another_are_checked_too(chain_out: DelaySystem) -> None:
    sine = Excitation(input_name="force", output_name="level", amplitude=0.05)
    assert cross_check(chain_out, find_trim(chain_out), sine, [0.2, 2.5]).agreed


def test_the_rest_falls_with_the_square_of_the_amplitude(slow_engine: DelaySystem) -> None:
    trim = find_trim(slow_engine, inputs={"throttle": 12.0})
    omega = np.geomspace(2.0, 30.0, 5)
    exact = linearize(slow_engine, trim).model.response(omega, "throttle", "engine_speed")
    found = compare_routes(slow_engine, trim, replace(SINE, amplitude=3.0), exact)
    assert found.falls_by.size >= 5
    assert found.falls_by == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("plant", [drop_delay, drop_channel, lengthen_lag], ids=lambda f: f.__name__)
def test_a_fault_planted_in_the_linear_model_is_found(plant: Plant, engine: DelaySystem, trim: Trim, model: DelayStateSpace) -> None:
    wrong = plant(model).response(OMEGA, "throttle", "engine_speed")
    right = model.response(OMEGA, "throttle", "engine_speed")
    found = compare_routes(engine, trim, SINE, wrong)
    assert not found.agreed
    comparison = found.comparison(SMALL_SIGNAL)
    assert comparison.disagreeing.tolist() == [False, False, True, True, True]
    ratio = wrong.values / right.values
    assert comparison.difference.magnitude[2:] == pytest.approx(np.abs(ratio) - 1.0, abs=1e-8)
    assert comparison.difference.phase_deg[2:] == pytest.approx(np.degrees(np.angle(ratio)), abs=1e-6)
    with pytest.raises(
        AnalysisError, match=r"cross-check failed at 3 of 5 frequencies: engine_speed of lee1995 answers throttle at "
    ) as caught:
        found.require_agreement()
    details = caught.value.details
    k = OMEGA.tolist().index(float(details["frequency"]))
    assert details["first_magnitude"] == pytest.approx(abs(wrong.values[k]))
    assert details["second_magnitude"] == pytest.approx(abs(right.values[k]), rel=1e-8)
    assert details["routes"] == "exact small-signal response / harmonic balance at vanishing amplitude"
    assert "a delay or a channel of the linear model is not what the equations say" in str(caught.value)


@pytest.mark.parametrize("plant", [drop_delay, drop_channel, lengthen_lag], ids=lambda f: f.__name__)
def test_a_wrong_linear_model_does_not_steer_harmonic_balance(
    plant: Plant, engine: DelaySystem, trim: Trim, model: DelayStateSpace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault sits where the linear model is built, for the exact route and for the start of harmonic balance alike."""
    right = {amplitude: balance_harmonics(engine, trim, replace(SINE, amplitude=amplitude), OMEGA) for amplitude in (0.1, 5.0)}
    wrong = plant(model)
    for module in ("linearize", "harmonic_balance"):
        monkeypatch.setattr(f"revline.analysis.{module}.build_model", lambda *_: wrong)
    assert linearize(engine, trim).model is wrong
    for amplitude, before in right.items():
        after = balance_harmonics(engine, trim, replace(SINE, amplitude=amplitude), OMEGA)
        assert after.fundamental.values == pytest.approx(before.fundamental.values, rel=1e-9)
    found = compare_routes(engine, trim, SINE, linearize(engine, trim).model.response(OMEGA, "throttle", "engine_speed"))
    assert np.all(found.comparison(SMALL_SIGNAL).disagreeing)


def test_a_lag_of_whole_periods_at_the_only_frequency_is_found(engine: DelaySystem, trim: Trim, model: DelayStateSpace) -> None:
    """There a dropped delay makes no difference; the frequencies added below it show it."""
    omega = np.array([2.0 * np.pi / trim.lag("charge")])
    dropped = replace(model, lags=model.lags * np.array([1e-9, 1.0]))
    assert dropped.response(omega, "throttle", "engine_speed").values == pytest.approx(
        model.response(omega, "throttle", "engine_speed").values, rel=1e-6
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("revline.analysis.linearize.build_model", lambda *_: dropped)
        found = compare_routes(engine, trim, SINE, dropped.response(omega, "throttle", "engine_speed"))
    assert found.comparison(SMALL_SIGNAL).disagreeing[:2].tolist() == [True, True]


def test_a_wrong_simulation_is_found(
    engine: DelaySystem, slow_engine: DelaySystem, trim: Trim, model: DelayStateSpace, stream: Sinestream
) -> None:
    """The simulated engine has a lag 1 % longer: to first order in the amplitude its phase is off as the linear model's would be."""
    exact = model.response(OMEGA, "throttle", "engine_speed")
    wrong = find_sinestream(slow_engine, trim, SINE, OMEGA)
    found = compare_routes(engine, trim, SINE, exact, stream=wrong)
    assert found.comparison(SMALL_SIGNAL).agreed
    assert np.all(found.comparison(LARGE_SIGNAL).disagreeing)
    late = lengthen_lag(model).response(OMEGA, "throttle", "engine_speed")
    ahead = np.degrees(np.angle(exact.values / late.values))
    assert found.comparison(LARGE_SIGNAL).difference.phase_deg == pytest.approx(ahead, rel=0.1)
    with pytest.raises(AnalysisError, match=r"by sinestream by simulation: .* the system may have several periodic answers") as caught:
        found.require_agreement()
    k = OMEGA.tolist().index(float(caught.value.details["frequency"]))
    assert caught.value.details["second_magnitude"] == pytest.approx(abs(wrong.fourier.values[k]))
    assert caught.value.details["first_magnitude"] == pytest.approx(abs(stream.fourier.values[k]), rel=1e-6)


def test_a_wrong_harmonic_balance_is_found(
    engine: DelaySystem, slow_engine: DelaySystem, trim: Trim, exact: FrequencyResponse, stream: Sinestream
) -> None:
    wrong = balance_harmonics(slow_engine, trim, SINE, OMEGA)
    comparison = compare_routes(engine, trim, SINE, exact, balance=wrong, stream=stream).comparison(LARGE_SIGNAL)
    assert np.all(comparison.disagreeing)
    ratio = wrong.fundamental.values / stream.fourier.values
    assert comparison.difference.magnitude == pytest.approx(np.abs(ratio) - 1.0, rel=1e-9)


def test_a_system_whose_equations_are_wrong_for_complex_steps_is_found(wiener: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Derivatives 1 % too large, for the linear model and for Newton's method alike: orbits still fulfil the equations themselves."""

    def wrong(*arguments: object) -> tuple[np.ndarray, ...]:
        return tuple(1.01 * part for part in plain(*arguments))  # type: ignore[arg-type]  # handed on as they came

    plain = jacobians.differentiate_by
    trim, sine = find_trim(wiener, inputs={"force": 0.5}), Excitation(input_name="force", output_name="bent", amplitude=0.25)
    monkeypatch.setattr(jacobians, "differentiate_by", wrong)
    monkeypatch.setattr("revline.analysis.orbit_equations.differentiate_by", wrong)
    found = compare_routes(wiener, trim, sine, linearize(wiener, trim).model.response(OMEGA, "force", "bent"))
    assert found.vanishing.values[2:] == pytest.approx(1.2 * 3.0 / (3.0 + 1j * OMEGA) * np.exp(-0.3j * OMEGA), rel=1e-6)
    assert np.all(found.comparison(SMALL_SIGNAL).disagreeing)


def at_limit(wiener: DelaySystem, force: float) -> CrossCheck:
    trim = find_trim(wiener, inputs={"force": force})
    sine = Excitation(input_name="force", output_name="limited", amplitude=0.25)
    return compare_routes(wiener, trim, sine, linearize(wiener, trim).model.response(OMEGA, "force", "limited"))


def test_at_a_kink_no_linear_model_is_checked_and_that_is_said(wiener: DelaySystem) -> None:
    found = at_limit(wiener, 0.6)
    assert found.comparisons == ()
    assert found.falls_by.size == 0
    assert "a limit is near" in str(found.unchecked[0])
    with pytest.raises(InvalidInputError, match=r"exact small-signal response and harmonic .* were not compared; ask for"):
        found.comparison(SMALL_SIGNAL)


def test_near_a_kink_amplitudes_shrink_until_they_do_not_meet_it(wiener: DelaySystem) -> None:
    found = at_limit(wiener, 0.599)
    assert found.comparison(SMALL_SIGNAL).agreed
    assert np.max(found.vanishing.amplitudes) <= 1.1e-3 * np.max(np.abs(1.0 + 1j * OMEGA / 3.0))
    assert found.vanishing.amplitudes[0, 0] < 0.25 / 16.0


def test_an_unstable_operating_point_is_not_checked_and_that_is_said(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 5.0})
    found = compare_routes(engine, trim, SINE, linearize(engine, trim).model.response(OMEGA, "throttle", "engine_speed"))
    assert found.comparisons == ()
    assert found.agreed
    assert len(found.unchecked) == 1
    said = str(found.unchecked[0])
    assert "exact small-signal response was not checked against harmonic balance at vanishing amplitude" in said
    assert "at 0.381966, 0.618034, 1, 10 and 1 more rad/s" in said
    assert "not open-loop stable" in str(found.unchecked[0])


def test_an_input_at_the_end_of_its_range_is_not_checked_and_that_is_said(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 90.0})
    with pytest.raises(AnalysisError, match=r"throttle = 90 deg is at an end of its range: no sinusoid has room there"):
        extrapolate_to_rest(engine, trim, SINE, OMEGA)
    found = compare_routes(engine, trim, SINE, linearize(engine, trim).model.response(OMEGA, "throttle", "engine_speed"))
    assert "is at an end of its range" in found.unchecked[0].reason


def test_what_harmonic_balance_lacks_is_named(
    engine: DelaySystem, trim: Trim, exact: FrequencyResponse, stream: Sinestream, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = balance_harmonics(engine, trim, SINE, OMEGA[:2])
    found = compare_routes(engine, trim, SINE, exact, balance=some, stream=stream)
    assert found.comparison(LARGE_SIGNAL).difference.omega.tolist() == OMEGA[:2].tolist()
    assert [(left.omega.tolist(), left.reason) for left in found.unchecked] == [([60.0], "there is no harmonic balance at this frequency")]

    def fail(*_: object, **__: object) -> HarmonicBalance:
        message = "no orbit"
        raise AnalysisError(message)

    monkeypatch.setattr("revline.analysis.cross_check.attempt_balance", fail)
    found = compare_routes(engine, trim, SINE, exact, stream=stream)
    assert [c.difference.routes for c in found.comparisons] == [SMALL_SIGNAL]
    assert [(left.omega.size, left.reason) for left in found.unchecked] == [(3, "no orbit")]


def test_a_tolerance_too_wide_to_prove_anything_is_no_check(
    engine: DelaySystem, trim: Trim, exact: FrequencyResponse, stream: Sinestream
) -> None:
    rough = replace(stream, step_error=np.array([1e-9, 0.1, 1e-9]))
    found = compare_routes(engine, trim, SINE, exact, stream=rough)
    assert found.comparison(LARGE_SIGNAL).difference.omega.tolist() == [1.0, 60.0]
    assert found.comparison(LARGE_SIGNAL).tolerance.max() < LOOSEST
    assert "known no better than to 0.3 of themselves" in found.unchecked[0].reason
    unknown = replace(stream, step_error=np.full(3, 0.1))
    assert [c.difference.routes for c in compare_routes(engine, trim, SINE, exact, stream=unknown).comparisons] == [SMALL_SIGNAL]


def test_tolerances_are_made_of_the_routes_own_errors(
    engine: DelaySystem, trim: Trim, exact: FrequencyResponse, stream: Sinestream
) -> None:
    balance = balance_harmonics(engine, trim, SINE, OMEGA)
    found = compare_routes(engine, trim, SINE, exact, balance=balance, stream=stream)
    assert found.comparison(LARGE_SIGNAL).tolerance == pytest.approx(
        3.0 * (balance.error + balance.last_step + simulation_error(stream)) + FLOOR, rel=1e-12
    )
    assert found.comparison(SMALL_SIGNAL).tolerance == pytest.approx(found.vanishing.error + FLOOR, rel=1e-12)


@pytest.mark.slow
def test_orbits_that_meet_a_limit_are_compared_with_their_own_larger_error(engine: DelaySystem) -> None:
    trim, sine = find_trim(engine, inputs={"throttle": 60.0}), replace(SINE, amplitude=20.0)
    stream = find_sinestream(engine, trim, sine, [0.5, 5.0])
    exact = linearize(engine, trim).model.response([0.5, 5.0], "throttle", "engine_speed")
    comparison = compare_routes(engine, trim, sine, exact, stream=stream).comparison(LARGE_SIGNAL)
    assert comparison.agreed
    assert np.all(comparison.tolerance > 1e-6)
    off = replace(stream, fourier=replace(stream.fourier, values=stream.fourier.values * 1.001))
    assert not compare_routes(engine, trim, sine, exact, stream=off).agreed


@pytest.mark.slow
def test_no_false_alarm_at_random_points_limits_included(engine: DelaySystem) -> None:
    """Half of the orbits meet the throttle's limit at 79.56 deg, where harmonics and steps converge slowly."""
    generator = np.random.default_rng(1995)
    parts: list[float] = []
    for k in range(40):
        angle, load = float(generator.uniform(20.0, 79.0)), float(generator.uniform(0.0, 40.0))
        room = min(angle - 8.0, 79.5 - angle)
        reach = (
            float(generator.uniform(1.02, 1.5) * (79.56 - angle)) if k % 2 and angle > 50.0 else float(generator.uniform(0.05, 0.9) * room)
        )
        sine, omega = replace(SINE, amplitude=min(reach, 89.9 - angle)), [float(np.exp(generator.uniform(-1.0, 4.0)))]
        trim = find_trim(engine, inputs={"throttle": angle, "load_torque": load})
        exact = linearize(engine, trim).model.response(omega, "throttle", "engine_speed")
        found = compare_routes(engine, trim, sine, exact, stream=find_sinestream(engine, trim, sine, omega))
        found.require_agreement()
        assert found.unchecked == (), f"{angle:.4g} +- {sine.amplitude:.4g} deg, {load:.3g} N m, {omega[0]:.4g} rad/s"
        parts += [float(comparison.used.max()) for comparison in found.comparisons]
    assert len(parts) == 80
    assert max(parts) < 1.0


@pytest.mark.parametrize("amplitude", [1e-9, 1e-5, 1e-3])
def test_however_small_the_amplitude_asked_for_the_check_is_made(amplitude: float, engine: DelaySystem, trim: Trim) -> None:
    """The smallest of these used to be lost in rounding, so that nothing was checked, or all but the tolerance was used up."""
    omega = np.array([0.01, 10.0, 300.0])
    response = find_exact_response(engine, trim, omega, input_name="throttle", output_name="engine_speed")
    check = compare_routes(engine, trim, replace(SINE, amplitude=amplitude), response)
    assert check.unchecked == ()
    (comparison,) = check.comparisons
    assert comparison.difference.omega.size == omega.size + len(PROBES)
    assert np.max(comparison.used) < 0.3
    wrong = replace(response, values=response.values * (1.0 + 1e-6))
    assert not compare_routes(engine, trim, replace(SINE, amplitude=amplitude), wrong).agreed


def test_an_input_without_a_range_is_moved_no_further_than_asked_for(wiener: DelaySystem) -> None:
    unbounded = replace(wiener, inputs=tuple(replace(v, low=-np.inf, high=np.inf) for v in wiener.inputs))
    trim = find_trim(unbounded, inputs={"force": 0.5})
    sine = Excitation(input_name="force", output_name="straight", amplitude=1e-3)
    assert find_reach(unbounded, trim, sine) == 1e-3
    bounded = replace(wiener, inputs=tuple(replace(v, low=-1.0, high=1.0) for v in wiener.inputs))
    assert find_reach(bounded, trim, sine) == pytest.approx(0.02)
    assert find_reach(bounded, trim, replace(sine, amplitude=0.7)) == pytest.approx(0.5)


def test_a_frequency_of_zero_is_refused(engine: DelaySystem, trim: Trim) -> None:
    with pytest.raises(InvalidInputError, match="frequency = 0 rad/s is outside values above 0; no sinusoid can be compared there"):
        cross_check(engine, trim, SINE, [0.0, 1.0], settings=RunSettings())


@pytest.mark.reference
def test_the_effect_of_the_amplitude_is_that_computed_twice_independently(engine: DelaySystem, trim: Trim) -> None:
    """The exact response over that to 5 deg, as recomputed for the engine of Lee (1995): 0.12 % at 0.1 rad/s to 1.5 % at 7 to 8 rad/s."""
    omega = np.array([0.1, 1.0, 5.0, 7.0, 7.5, 8.0, 20.0, 60.0, 80.0, 100.0])
    exact = find_exact_response(engine, trim, omega, input_name="throttle", output_name="engine_speed")
    balance = balance_harmonics(engine, trim, SINE, omega)
    above = exact.magnitude * SINE.amplitude / balance.amplitude - 1.0
    assert above[2] == pytest.approx(0.014, abs=5e-4)
    assert above[:2] == pytest.approx([0.0012, 0.0017], abs=5e-5)
    assert above[3:6] == pytest.approx(0.015, abs=5e-4)
    assert above[6] == pytest.approx(0.0094, abs=5e-5)
    assert np.all(np.abs(above[7:]) < 1e-3)
    fine = np.geomspace(0.1, 100.0, 121)
    all_above = np.abs(find_exact_response(engine, trim, fine, input_name="throttle", output_name="engine_speed").magnitude) * 5.0
    balanced = balance_harmonics(engine, trim, SINE, fine)
    whole = all_above / balanced.amplitude - 1.0
    assert 7.0 <= fine[int(np.argmax(whole))] <= 8.0
    lag = exact.phase_deg - balance.phase_deg
    assert lag[-1] == pytest.approx(-1.71, abs=5e-3)
    gap = find_exact_response(engine, trim, fine, input_name="throttle", output_name="engine_speed").phase_deg - balanced.phase_deg
    assert np.max(np.abs(gap[fine <= 10.0])) == pytest.approx(0.34, abs=5e-3)
