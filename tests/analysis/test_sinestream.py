import csv
from pathlib import Path

import numpy as np
import pytest

from revline.analysis.cycle_readings import ReadingMethod
from revline.analysis.periodic import Excitation, RunSettings
from revline.analysis.sinestream import PartialSinestream, Sinestream, attempt_sinestream, find_sinestream
from revline.analysis.trim import Trim, find_trim
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError, StalledError
from revline.system import DelaySystem, Floats

OMEGA = np.array([0.05, 0.5, 2.0, 7.0, 25.0, 60.0])


def sine_on(output: str, amplitude: float = 0.25) -> Excitation:
    return Excitation(input_name="force", output_name=output, amplitude=amplitude)


def lag_response(omega: Floats) -> Floats:
    return 3.0 / np.hypot(3.0, omega)


def lag_phase(omega: Floats) -> Floats:
    return -np.degrees(np.arctan(omega / 3.0) + 0.3 * omega)


@pytest.fixture(scope="module")
def trim(wiener: DelaySystem) -> Trim:
    return find_trim(wiener, inputs={"force": 0.5})


@pytest.fixture(scope="module")
def straight(wiener: DelaySystem, trim: Trim) -> Sinestream:
    return find_sinestream(wiener, trim, sine_on("straight"), OMEGA)


def test_a_linear_systems_response_is_its_closed_form(straight: Sinestream) -> None:
    assert straight.amplitude == pytest.approx(0.25 * lag_response(OMEGA), rel=2e-6)
    assert straight.phase_deg == pytest.approx(lag_phase(OMEGA), abs=2e-4)
    assert straight.peak_amplitude == pytest.approx(0.25 * lag_response(OMEGA), rel=5e-6)
    assert straight.peaks.phase_deg == pytest.approx(lag_phase(OMEGA), abs=0.01)
    assert np.all(straight.distortion < 2e-6)
    assert straight.mean == pytest.approx(0.5, abs=1e-6)
    assert np.all((straight.step_error < 1e-6) & (straight.remaining < 1e-6))


def test_the_response_is_the_reading(straight: Sinestream) -> None:
    for method in ReadingMethod:
        response = straight.response(method)
        reading = straight.reading(method)
        assert np.array_equal(response.values, reading.values)
        assert response.method == f"sinestream, {method.value}"
        assert (response.input_name, response.input_unit, response.output_name, response.output_unit) == ("force", "N", "straight", "m")
        assert response.phase_deg == pytest.approx(reading.phase_deg, abs=1e-9)
        assert np.angle(response.values) == pytest.approx(np.angle(np.exp(1j * np.radians(reading.phase_deg))))


def test_a_lead_is_no_lag(straight: Sinestream) -> None:
    """Negative control: the conjugate response fits the magnitudes and is refuted by the phases."""
    turned = np.degrees(np.unwrap(np.angle(np.conj(straight.fourier.values))))
    assert np.abs(turned - lag_phase(OMEGA)).max() > 90.0


def test_a_bent_output_has_the_distortion_and_mean_of_its_bend(wiener: DelaySystem, trim: Trim) -> None:
    """x + c x^2 about x0 = 0.5 with amplitude a: fundamental (1 + 2 c x0) a, second harmonic c a^2 / 2, mean shift c a^2 / 2."""
    stream = find_sinestream(wiener, trim, sine_on("bent"), OMEGA[:4])
    swing = 0.25 * lag_response(OMEGA[:4])
    assert stream.amplitude == pytest.approx(1.2 * swing, rel=2e-6)
    assert stream.phase_deg == pytest.approx(lag_phase(OMEGA[:4]), abs=2e-4)
    assert stream.harmonics[:, 1] == pytest.approx(0.1 * swing**2, rel=1e-5)
    assert stream.distortion == pytest.approx(0.1 * swing / 1.2, rel=1e-5)
    assert stream.rest == pytest.approx(0.55)
    assert stream.mean_shift == pytest.approx(0.1 * swing**2, rel=1e-4)
    assert stream.harmonics.shape == (4, 10)


def test_the_result_does_not_depend_on_the_number_of_workers(wiener: DelaySystem, trim: Trim, straight: Sinestream) -> None:
    done: list[float] = []
    for workers in (1, 3):
        other = find_sinestream(wiener, trim, sine_on("straight"), OMEGA, workers=workers, progress=done.append)
        for name in ("cycles", "step", "step_error", "remaining", "mean", "harmonics", "phase_gap_deg"):
            assert np.array_equal(getattr(other, name), getattr(straight, name))
        assert np.array_equal(other.fourier.values, straight.fourier.values)
        assert np.array_equal(other.peaks.values, straight.peaks.values)
    assert done == pytest.approx([*(np.arange(1, 7) / 6.0)] * 2)


def test_frequencies_far_apart_keep_their_turns(wiener: DelaySystem, trim: Trim) -> None:
    far = np.array([11.0, 60.0])
    stream = find_sinestream(wiener, trim, sine_on("straight"), far)
    assert stream.phase_deg == pytest.approx(lag_phase(far), abs=2e-4)
    assert stream.response().phase_deg == pytest.approx(lag_phase(far), abs=2e-4)
    assert find_sinestream(wiener, trim, sine_on("straight"), [60.0]).phase_deg == pytest.approx(lag_phase(far[1:]), abs=2e-4)


def test_without_a_linear_answer_the_turns_come_from_the_neighbours_and_that_is_noted(wiener: DelaySystem) -> None:
    """x^3 about 0 has no slope; under amplitude a its fundamental is 3 a^3 / 4 in phase with x."""
    rest = find_trim(wiener, inputs={"force": 0.0})
    grid = np.array([0.5, 2.0, 5.0])
    stream = find_sinestream(wiener, rest, sine_on("cube", 0.5), grid)
    assert stream.amplitude == pytest.approx(0.75 * (0.5 * lag_response(grid)) ** 3, rel=1e-5)
    assert stream.phase_deg == pytest.approx(lag_phase(grid), abs=1e-3)
    assert stream.notes[0].startswith("at 0.5 rad/s the linear model has ")
    assert stream.notes[1] == "phases were unwrapped from neighbour to neighbour after removing a lag of 0.3 s"


def test_an_answer_of_harmonics_alone_is_refused(wiener: DelaySystem) -> None:
    rest = find_trim(wiener, inputs={"force": 0.0})
    with pytest.raises(AnalysisError, match=r"output square of wiener answers force at 2 rad/s with harmonics alone"):
        find_sinestream(wiener, rest, sine_on("square"), [2.0], settings=RunSettings(tolerance=1e-10))


def test_a_lag_that_shrinks_gets_a_shorter_step(shrinking: DelaySystem) -> None:
    """The first step, 0.35 of the lag at rest, would be doubled for the check and pass the shortest lag."""
    rest = find_trim(shrinking, inputs={"force": 0.0})
    stream = find_sinestream(shrinking, rest, sine_on("straight", 1.0), [0.5], settings=RunSettings(max_step=1.0))
    assert 2.0 * stream.step[0] < 0.06 - 0.05 * stream.amplitude[0]
    assert stream.step_error[0] < 1e-6


def test_a_step_that_always_matters_is_refused(wiener: DelaySystem, trim: Trim) -> None:
    settings = RunSettings(step_tolerance=1e-10)
    with pytest.raises(NotConvergedError, match=r"the step still matters at 5 rad/s: halving it to .* s leaves a relative error of .*e-"):
        find_sinestream(wiener, trim, sine_on("limited", 0.5), [5.0], settings=settings)


def test_a_stall_in_any_run_is_raised(wiener: DelaySystem) -> None:
    low = find_trim(wiener, inputs={"force": -2.0})
    with pytest.raises(StalledError, match=r"under a sinusoid at 0.2 rad/s"):
        find_sinestream(wiener, low, sine_on("straight", 2.5), [0.2, 50.0])


def test_a_frequency_that_fails_leaves_the_others(wiener: DelaySystem) -> None:
    low = find_trim(wiener, inputs={"force": -2.0})
    found = attempt_sinestream(wiener, low, sine_on("straight", 2.5), [0.2, 50.0, 60.0])
    assert isinstance(found, PartialSinestream)
    whole = find_sinestream(wiener, low, sine_on("straight", 2.5), [50.0, 60.0])
    assert np.array_equal(found.finished.fourier.values, whole.fourier.values)
    assert found.finished.phase_deg == pytest.approx(whole.phase_deg)
    assert [entry.omega for entry in found.missing] == [0.2]
    assert str(found).startswith("2 of 3 frequencies are finished; missing: 0.2 rad/s (under a sinusoid at 0.2 rad/s: stalled")


def test_an_attempt_without_failures_is_the_whole_response(wiener: DelaySystem, trim: Trim, straight: Sinestream) -> None:
    found = attempt_sinestream(wiener, trim, sine_on("straight"), OMEGA)
    assert isinstance(found, Sinestream)
    assert np.array_equal(found.fourier.values, straight.fourier.values)


def test_an_attempt_that_finishes_nothing_raises(wiener: DelaySystem) -> None:
    low = find_trim(wiener, inputs={"force": -2.0})
    with pytest.raises(StalledError, match=r"under a sinusoid at 0.1 rad/s"):
        attempt_sinestream(wiener, low, sine_on("straight", 2.5), [0.1, 0.2])


def test_no_workers_are_refused(wiener: DelaySystem, trim: Trim) -> None:
    with pytest.raises(InvalidInputError, match="workers = 0 threads is outside 1 and above"):
        find_sinestream(wiener, trim, sine_on("straight"), [1.0], workers=0)


def test_frequencies_that_fall_are_refused(wiener: DelaySystem, trim: Trim) -> None:
    with pytest.raises(InvalidInputError, match="sort the frequencies"):
        find_sinestream(wiener, trim, sine_on("straight"), [2.0, 1.0])


@pytest.fixture(scope="module")
def table() -> Floats:
    path = Path(__file__).parents[1] / "reference" / "table_4_1.csv"
    rows = list(csv.DictReader(path.read_text().splitlines()))
    names = ("frequency_rad_s", "speed_amplitude_rad_s", "phase_lag_deg")
    return np.array([[float(row[name]) for name in names] for row in rows])


@pytest.fixture(scope="module")
def thesis(engine: DelaySystem, table: Floats) -> Sinestream:
    trim = find_trim(engine, inputs={"throttle": 25.0})
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=5.0)
    return find_sinestream(engine, trim, excitation, table[:, 0])


HARMONIC_BALANCE = np.array(
    [
        [0.1, 60.00558, -3.1644],
        [1.0, 54.01155, -29.8740],
        [5.0, 22.06655, -87.6199],
        [10.0, 10.82323, -116.7925],
        [20.0, 4.408247, -153.4502],
        [50.0, 0.949534, -218.9742],
        [100.0, 0.253493, -295.2858],
    ]
)
"""Frequency, speed amplitude and phase at 25 +- 5 deg, by harmonic balance with 32 samples per period."""


def test_the_engine_answers_as_harmonic_balance_says(thesis: Sinestream) -> None:
    rows = np.searchsorted(thesis.omega, HARMONIC_BALANCE[:, 0])
    assert thesis.amplitude[rows] == pytest.approx(HARMONIC_BALANCE[:, 1], rel=3e-6)
    assert thesis.phase_deg[rows] == pytest.approx(HARMONIC_BALANCE[:, 2], abs=1e-4)
    assert 100.0 * thesis.distortion[rows[[0, 1, 2, 3, 6]]] == pytest.approx([0.17, 1.7, 3.7, 3.4, 1.4], abs=0.05)
    assert thesis.mean[rows[[0, 2, 6]]] == pytest.approx([240.77, 243.02, 243.64], abs=0.005)
    assert thesis.notes == ()
    assert np.all(thesis.step_error < 1e-6)


@pytest.mark.reference
@pytest.mark.parametrize(("method", "mean", "worst", "phase"), [("fourier", 0.39, 1.40, 1.58), ("peaks", 0.50, 1.40, 1.72)])
def test_table_4_1_is_met(thesis: Sinestream, table: Floats, method: str, mean: float, worst: float, phase: float) -> None:
    """Lee (1995), Table 4.1, its misprint at 6 rad/s mended; the deviations are those of the table's rounding and reading."""
    reading = thesis.reading(ReadingMethod(method))
    off = 100.0 * np.abs(5.0 * np.abs(reading.values) / table[:, 1] - 1.0)
    assert (off.mean(), off.max()) == pytest.approx((mean, worst), abs=0.005)
    assert np.abs(reading.phase_deg + table[:, 2]).max() == pytest.approx(phase, abs=0.005)


def test_maxima_and_minima_give_phases_up_to_nine_degrees_apart(thesis: Sinestream) -> None:
    assert 7.0 < np.abs(thesis.phase_gap_deg).max() < 9.0


def test_a_large_sinusoid_that_stalls_the_engine_names_the_frequency(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 10.0})
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=9.9)
    with pytest.raises(AnalysisError, match=r"under a sinusoid at 0.1 rad/s"):
        find_sinestream(engine, trim, excitation, [0.1])


def test_an_unstable_engine_is_refused(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 4.0})
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=0.1)
    with pytest.raises(AnalysisError, match="lee1995 is not open-loop stable at throttle = 4 deg: 2 roots"):
        find_sinestream(engine, trim, excitation, [1.0])
