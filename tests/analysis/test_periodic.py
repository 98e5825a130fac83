import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from revline.analysis.cycle_readings import read_fourier
from revline.analysis.periodic import (
    Excitation,
    PeriodicAnswer,
    RunSettings,
    SettlingWatch,
    check_excitation,
    continue_periodic,
    plan_mesh,
    run_until_periodic,
)
from revline.analysis.trim import Trim, find_trim
from revline.errors import AnalysisError, InvalidInputError, LagError, NotSettledError, StalledError
from revline.system import DelaySystem

STRAIGHT = Excitation(input_name="force", output_name="straight", amplitude=0.25)


@pytest.fixture(scope="module")
def trim(wiener: DelaySystem) -> Trim:
    return find_trim(wiener, inputs={"force": 0.5})


def settle(system: DelaySystem, trim: Trim, omega: float, tolerance: float = 1e-6) -> PeriodicAnswer:
    return run_until_periodic(system, trim, STRAIGHT, plan_mesh(omega, trim, RunSettings()), tolerance=tolerance)


def exact(omega: float) -> complex:
    return complex(3.0 * np.exp(-0.3j * omega) / (3.0 + 1j * omega))


@pytest.mark.parametrize("omega", [0.02, 0.7, 3.0, 11.0, 80.0])
def test_the_settled_answer_is_exact_and_its_estimated_error_covers_the_true_one(wiener: DelaySystem, trim: Trim, omega: float) -> None:
    answer = settle(wiener, trim, omega)
    value = read_fourier(answer.moved, answer.answered).value
    assert answer.remaining < 1e-6
    assert abs(value / exact(omega) - 1.0) < 2.0 * answer.remaining + 2e-7


@pytest.mark.parametrize(("omega", "tolerance"), [(11.0, 1e-3), (30.0, 1e-4), (80.0, 1e-5), (200.0, 1e-3)])
def test_the_estimated_error_bounds_that_of_the_waveform(wiener: DelaySystem, trim: Trim, omega: float, tolerance: float) -> None:
    """Of one mode the estimate is the error a period before the window, at most 1 / 0.15 times that in the window here."""
    mesh = plan_mesh(omega, trim, RunSettings())
    answer = run_until_periodic(wiener, trim, STRAIGHT, replace(mesh, first=mesh.block), tolerance=tolerance)
    count = answer.answered.size
    angle = 2.0 * math.pi * (answer.cycles + np.arange(1 - count, 1) / answer.mesh.samples)
    settled = 0.5 + 0.25 * (exact(omega) * np.exp(1j * angle)).imag
    error = float(np.max(np.abs(answer.answered.ravel() - settled))) / (0.25 * abs(exact(omega)))
    assert 0.1 * answer.remaining < error < 1.1 * answer.remaining < 1.1 * tolerance


SLOW = 0.99
"""Factor per period of a transient of 1e-3 that stands behind a large and fast one."""


def watch_modes(fast: float, decay: float) -> list[SettlingWatch]:
    """Look every 8 periods at a sinusoid with two transients."""
    count, looks = 64, 45
    periods = np.arange(count * 8 * (looks + 1)) / count
    outputs = np.sin(2.0 * math.pi * periods) + fast**periods + 1e-3 * SLOW**periods
    watch = SettlingWatch(period=count, block=8 * count, tolerance=1e-4, decay=decay)
    found = []
    for k in range(looks):
        watch = watch.look(outputs[: count * 8 * (k + 2)])
        found.append(watch)
    return found


def left_after(look: int) -> float:
    return 1e-3 * SLOW ** (8.0 * (look + 1))


@pytest.mark.parametrize(("fast", "decay"), [(0.3, 0.0), (0.5, SLOW), (0.3, SLOW)])
def test_a_slow_small_mode_behind_a_fast_large_one_is_not_overlooked(fast: float, decay: float) -> None:
    seen = watch_modes(fast, decay)
    last = next(k for k, watch in enumerate(seen) if watch.settled)
    assert left_after(last) < 1.1 * seen[last].remaining < 1.1e-4
    assert left_after(last) > 0.8e-4


def test_one_look_alone_would_overlook_it() -> None:
    """Negative control for two estimates in a row: one passes while the error left is eight times the tolerance."""
    first = next(k for k, watch in enumerate(watch_modes(0.3, 0.0)) if watch.remaining < 1e-4)
    assert left_after(first) > 5e-4


def test_without_the_slowest_mode_known_it_may_be_overlooked() -> None:
    """Negative control for the least factor: both estimates mix the two modes."""
    last = next(k for k, watch in enumerate(watch_modes(0.5, 0.0)) if watch.settled)
    assert left_after(last) > 5e-4


def test_what_rounding_leaves_is_settled_and_what_grows_is_not() -> None:
    angle = 2.0 * math.pi * np.arange(640) / 64.0
    watch = SettlingWatch(period=64, block=64, tolerance=1e-9, decay=0.0)
    for end in (128, 192):
        watch = watch.look(np.sin(angle[:end]))
    assert watch.settled
    grown = SettlingWatch(period=64, block=64, tolerance=0.9, decay=0.0)
    for end in range(128, 641, 64):
        grown = grown.look((np.sin(angle) + 1e-3 * 1.3 ** (angle / 6.0))[:end])
        assert not grown.settled


@pytest.mark.parametrize("omega", [11.0, 15.0, 20.0])
def test_without_a_settling_test_the_answer_is_wrong(wiener: DelaySystem, trim: Trim, omega: float) -> None:
    """Negative control: looks after each period, with a tolerance that all pass, leave the transient in."""
    mesh = plan_mesh(omega, trim, RunSettings())
    hasty = replace(mesh, block=mesh.count, first=mesh.count)
    early = run_until_periodic(wiener, trim, STRAIGHT, hasty, tolerance=0.99)
    assert abs(read_fourier(early.moved, early.answered).value / exact(omega) - 1.0) > 1e-4


def test_a_long_lag_before_a_fast_mode_is_waited_for(wiener: DelaySystem) -> None:
    """Nothing arrives for many periods and many time constants: at rest is not settled."""
    slow = wiener.with_parameters(wiener.parameters._replace(lag=4.0, pole=30.0))
    rest = find_trim(slow, inputs={"force": 0.5})
    answer = settle(slow, rest, 25.0)
    assert answer.mesh.first * answer.mesh.step > 8.0 * 4.0
    assert read_fourier(answer.moved, answer.answered).value == pytest.approx(30.0 * np.exp(-100.0j) / (30.0 + 25.0j), rel=1e-6)


def test_a_slower_mode_takes_more_cycles(wiener: DelaySystem, trim: Trim) -> None:
    assert settle(wiener, trim, 0.02).cycles < 1.2
    assert settle(wiener, trim, 11.0).cycles > 3.0
    assert settle(wiener, trim, 11.0, tolerance=1e-9).cycles > settle(wiener, trim, 11.0).cycles


def test_the_run_goes_on_where_it_stopped(wiener: DelaySystem, trim: Trim) -> None:
    answer = settle(wiener, trim, 3.0)
    more = continue_periodic(wiener, STRAIGHT, answer, cycles=2)
    assert more.times.size == 2 * answer.mesh.samples
    assert more.output("straight")[: answer.mesh.samples] == pytest.approx(answer.answered[-1], abs=1e-6)


@given(omega=st.floats(1e-3, 1e3), max_step=st.floats(1e-4, 1.0))
def test_steps_are_whole_parts_of_the_period_and_blocks_of_both(trim: Trim, omega: float, max_step: float) -> None:
    settings = RunSettings(max_step=max_step)
    assume(2.0 * math.pi / omega / max_step < 1e6)
    mesh = plan_mesh(omega, trim, settings)
    assert mesh.step <= min(max_step, 0.35 * 0.3) * (1.0 + 1e-9)
    assert mesh.step * mesh.count == pytest.approx(2.0 * math.pi / omega)
    assert mesh.samples in (128, 256)
    assert mesh.coarser().samples >= 64
    for variant in (mesh, mesh.coarser(), mesh.finer()):
        assert variant.count % variant.every == variant.block % variant.every == variant.first % variant.block == 0
        assert variant.first >= variant.count
    assert max(mesh.block, mesh.count) % min(mesh.block, mesh.count) == 0


@pytest.mark.parametrize("omega", [0.0, -1.0, math.nan, math.inf])
def test_frequencies_not_above_zero_are_refused(trim: Trim, omega: float) -> None:
    with pytest.raises(InvalidInputError, match=r"frequency = .* rad/s is outside values above 0"):
        plan_mesh(omega, trim, RunSettings())


@pytest.mark.parametrize("omega", [1e-7, 1e8])
def test_frequencies_that_need_too_many_steps_are_refused(trim: Trim, omega: float) -> None:
    with pytest.raises(InvalidInputError, match=r"frequency = .* is outside .* to .* rad/s, which steps of at most 0.002 s can resolve"):
        plan_mesh(omega, trim, RunSettings())


def test_the_range_of_frequencies_that_is_told_is_that_of_what_can_be_run(trim: Trim) -> None:
    with pytest.raises(InvalidInputError) as caught:
        plan_mesh(1e-7, trim, RunSettings())
    low, _, high = str(caught.value.details["limit"]).partition(" rad/s")[0].partition(" to ")
    for omega in (1.01 * float(low), 0.99 * float(high)):
        assert plan_mesh(omega, trim, RunSettings()).omega == omega
    for omega in (0.99 * float(low), 1.01 * float(high)):
        with pytest.raises(InvalidInputError, match="can resolve"):
            plan_mesh(omega, trim, RunSettings())


@pytest.mark.parametrize("amplitude", [0.0, -1.0, math.nan])
def test_amplitudes_not_above_zero_are_refused(amplitude: float) -> None:
    with pytest.raises(InvalidInputError, match=r"sine amplitude = .* is outside values above 0"):
        Excitation(input_name="force", output_name="straight", amplitude=amplitude)


@pytest.mark.parametrize("name", ["max_step", "longest", "tolerance", "step_tolerance", "cycles"])
def test_settings_out_of_range_are_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=f"{name} = 0 .* is outside"):
        replace(RunSettings(), **{name: 0})


def test_a_sinusoid_that_leaves_the_inputs_range_is_refused(wiener: DelaySystem, trim: Trim) -> None:
    excitation = Excitation(input_name="force", output_name="straight", amplitude=4.6)
    with pytest.raises(InvalidInputError, match=r"amplitude 4.6 N about 0.5 N goes too far: force = 5.1 N is outside -5 to 5 N"):
        check_excitation(wiener, trim, excitation)


@pytest.mark.parametrize(("moved", "watched"), [("torque", "straight"), ("force", "speed")])
def test_unknown_signals_are_refused(wiener: DelaySystem, trim: Trim, moved: str, watched: str) -> None:
    with pytest.raises(InvalidInputError, match="there is no signal"):
        check_excitation(wiener, trim, Excitation(input_name=moved, output_name=watched, amplitude=0.1))


def test_an_unstable_trim_is_refused(runaway: DelaySystem) -> None:
    with pytest.raises(AnalysisError, match=r"wiener is not open-loop stable at force = 0.5 N: 1 roots .* right-most at 1 rad/s"):
        check_excitation(runaway, find_trim(runaway, inputs={"force": 0.5}), STRAIGHT)


def test_a_run_that_may_not_last_says_how_far_it_came(wiener: DelaySystem, trim: Trim) -> None:
    mesh = plan_mesh(11.0, trim, RunSettings(longest=3.5))
    with pytest.raises(
        NotSettledError, match=r"straight does not repeat itself at 11 rad/s after .* s .* remaining error .* \(limit 1e-06\)"
    ):
        run_until_periodic(wiener, trim, STRAIGHT, mesh)


def test_an_output_at_rest_is_refused(wiener: DelaySystem, trim: Trim) -> None:
    excitation = Excitation(input_name="force", output_name="constant", amplitude=0.1)
    with pytest.raises(AnalysisError, match="output constant of wiener does not answer input force at 3 rad/s"):
        run_until_periodic(wiener, trim, excitation, plan_mesh(3.0, trim, RunSettings()))


def test_a_stall_names_the_frequency(wiener: DelaySystem) -> None:
    low = find_trim(wiener, inputs={"force": -2.0})
    excitation = Excitation(input_name="force", output_name="straight", amplitude=2.5)
    with pytest.raises(StalledError, match=r"under a sinusoid at 0.5 rad/s: stalled") as caught:
        run_until_periodic(wiener, low, excitation, plan_mesh(0.5, low, RunSettings()))
    assert caught.value.details["frequency"] == 0.5
    assert "level" in caught.value.details


def test_a_lag_that_shrinks_below_the_step_names_the_frequency(shrinking: DelaySystem) -> None:
    rest = find_trim(shrinking, inputs={"force": 0.0})
    mesh = plan_mesh(0.5, rest, RunSettings(max_step=1.0))
    excitation = Excitation(input_name="force", output_name="straight", amplitude=1.0)
    with pytest.raises(LagError, match=r"under a sinusoid at 0.5 rad/s: step = .* is longer than a lag"):
        run_until_periodic(shrinking, rest, excitation, mesh.coarser())
