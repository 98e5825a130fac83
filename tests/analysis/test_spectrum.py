import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.analysis.periodic import Excitation, RunSettings
from revline.analysis.spectrum import STUDIED, SpectralCheck, Spectrum, check_spectra, find_spectrum, next_power_of_two
from revline.analysis.trim import Trim, find_trim
from revline.errors import AnalysisError, InvalidInputError
from revline.system import DelaySystem, Floats


def record(count: int, cycles: float, amplitude: float = 1.0, mean: float = 0.0) -> tuple[Floats, Floats]:
    """A cosine over some cycles at 2 rad/s."""
    times = np.linspace(0.0, cycles * np.pi, count, endpoint=False)
    return times, mean + amplitude * np.cos(2.0 * times)


def test_the_lines_of_a_cosine_are_its_mean_and_its_amplitude() -> None:
    found = find_spectrum(*record(512, 8, 3.0, mean=7.5), initial=5.0)
    assert (found.peak_omega, found.peak_amplitude) == pytest.approx((2.0, 3.0))
    assert found.zero_line == pytest.approx(2.5)
    assert found.amplitude[8] == pytest.approx(3.0)
    assert np.delete(found.amplitude, [0, 8]) == pytest.approx(0.0, abs=1e-12)
    assert found.duration == pytest.approx(8.0 * np.pi)
    assert found.resolution == found.bin_width == pytest.approx(0.25)
    assert (found.samples, found.padded, found.initial) == (512, 512, 5.0)


def test_lines_at_zero_and_at_the_nyquist_frequency_are_not_doubled() -> None:
    times = np.arange(16.0)
    found = find_spectrum(times, 1.0 + 2.0 * np.cos(np.pi * times), initial=0.0)
    assert (found.zero_line, found.amplitude[-1]) == pytest.approx((1.0, 2.0))
    assert found.omega[-1] == pytest.approx(np.pi)


def test_padding_keeps_heights_and_resolution_and_narrows_the_bins() -> None:
    """Scaled by the length before padding: 384 samples of 3 cycles, padded to 512, of which a line still falls on the cosine."""
    found = find_spectrum(*record(384, 3, 3.0), initial=0.0)
    assert found.padded == 512
    assert found.resolution == pytest.approx(2.0 / 3.0)
    assert found.bin_width == pytest.approx(0.5)
    assert (found.peak_omega, found.peak_amplitude) == pytest.approx((2.0, 3.0))


def test_the_first_value_is_subtracted_where_none_is_given() -> None:
    times, values = record(64, 1, 1.0, mean=4.0)
    assert find_spectrum(times, values).initial == 5.0
    assert find_spectrum(times, values).zero_line == pytest.approx(1.0)


@pytest.mark.parametrize("cycles", [3, 5])
def test_the_leakage_of_the_line_at_zero_is_no_peak(cycles: int) -> None:
    """With a mean three times the amplitude and padding, lines beside zero are higher than that of the cosine."""
    found = find_spectrum(*record(128 * cycles, cycles, 1.0, mean=3.0), initial=0.0)
    naive = found.omega[1 + int(np.argmax(found.amplitude[1:]))]
    assert abs(naive - 2.0) > found.resolution
    assert abs(found.peak_omega - 2.0) <= 0.5 * found.bin_width


@given(values=st.lists(st.floats(-10.0, 10.0), min_size=16, max_size=64))
def test_power_is_kept(values: list[float]) -> None:
    """Parseval, written for doubled lines: sum of squares over n = a0^2 + sum a^2 / 2 + aN^2, over the padded length."""
    record_of = np.array(values)
    found = find_spectrum(np.arange(record_of.size, dtype=float), record_of, initial=0.0)
    weights = np.full(found.amplitude.size, 0.5)
    weights[[0, -1]] = 1.0
    power = float(weights @ found.amplitude**2) * record_of.size / found.padded
    assert power == pytest.approx(float(np.mean(record_of**2)), rel=1e-9, abs=1e-12)


@given(count=st.integers(1, 10**9))
def test_the_next_power_of_two(count: int) -> None:
    power = next_power_of_two(count)
    assert power >= count > power // 2
    assert power & (power - 1) == 0


def test_records_without_a_spectrum_are_refused() -> None:
    times, values = record(64, 1)
    with pytest.raises(InvalidInputError, match=r"needs 8 or more times and as many values, not shapes \(64,\) and \(63,\)"):
        find_spectrum(times, values[1:])
    with pytest.raises(InvalidInputError, match="needs 8 or more times"):
        find_spectrum(times[:7], values[:7])
    with pytest.raises(InvalidInputError, match="numbers that are not finite"):
        find_spectrum(times, np.where(times > 1.0, np.nan, values))
    with pytest.raises(InvalidInputError, match="sampled unevenly: steps differ from"):
        find_spectrum(times**2, values)
    with pytest.raises(InvalidInputError, match="initial value = nan"):
        find_spectrum(times, values, initial=float("nan"))


def test_a_lower_frequency_than_the_inputs_does_not_follow() -> None:
    """Negative control: an output at half the frequency is told from one at the input's."""
    spectrum = find_spectrum(*record(1024, 8, 1.0, mean=0.3), initial=0.0)
    same, double = (SpectralCheck(omega=w, spectrum=spectrum, cycles=8, distortion=0.1, remaining=0.0) for w in (2.0, 4.0))
    assert same.follows
    assert not double.follows
    assert double.offset == pytest.approx(2.0)
    assert str(double).startswith("does not follow 4 rad/s: peak 1 at 2 rad/s, line at zero 0.3, resolution 0.25 rad/s, distortion 10 %")
    assert str(same).endswith("8 periods after the transient, 128 samples each, padded from 1024 to 1024, no window")


@pytest.fixture(scope="module")
def level(wiener: DelaySystem) -> Trim:
    return find_trim(wiener, inputs={"force": 0.5})


def excite(output: str, amplitude: float = 0.25) -> Excitation:
    return Excitation(input_name="force", output_name=output, amplitude=amplitude)


def test_a_bent_answer_has_the_lines_of_its_bend(wiener: DelaySystem, level: Trim) -> None:
    """x + 0.2 x^2 about 0.5: lines 1.2 a at the input's frequency and 0.1 a^2 at zero and at twice it."""
    checks = check_spectra(wiener, level, excite("bent"), [0.5, 2.0])
    for check in checks:
        swing = 0.25 * 3.0 / np.hypot(3.0, check.omega)
        assert check.follows
        assert check.samples_per_cycle >= 64
        assert check.spectrum.peak_omega == pytest.approx(check.omega)
        assert check.spectrum.peak_amplitude == pytest.approx(1.2 * swing, rel=1e-5)
        assert check.spectrum.zero_line == pytest.approx(0.1 * swing**2, rel=1e-3)
        assert check.spectrum.amplitude[16] == pytest.approx(0.1 * swing**2, rel=1e-3)
        assert check.distortion == pytest.approx(0.1 * swing / 1.2, rel=1e-4)
        assert check.remaining < 1e-6


def test_a_square_answers_at_twice_the_frequency(wiener: DelaySystem) -> None:
    """x^2 about 0.02 under 0.5: the second harmonic is the highest line, and the check says that it does not follow."""
    rest = find_trim(wiener, inputs={"force": 0.02})
    check = check_spectra(wiener, rest, excite("square", 0.5), [2.0])[0]
    assert not check.follows
    assert check.spectrum.peak_omega == pytest.approx(4.0)
    assert check.distortion > 1.0


def test_the_checks_do_not_depend_on_workers_and_keep_the_cycles_asked_for(wiener: DelaySystem, level: Trim) -> None:
    settings = RunSettings(cycles=5)
    one, two = (check_spectra(wiener, level, excite("bent"), [0.5, 2.0, 5.0], settings=settings, workers=w) for w in (1, 2))
    for first, second in zip(one, two, strict=True):
        assert np.array_equal(first.spectrum.amplitude, second.spectrum.amplitude)
        assert (first.cycles, first.spectrum.samples) == (5, 5 * first.samples_per_cycle)
        assert first.follows


def test_an_unstable_trim_is_refused(runaway: DelaySystem) -> None:
    with pytest.raises(AnalysisError, match="not open-loop stable"):
        check_spectra(runaway, find_trim(runaway, inputs={"force": 0.5}), excite("bent"), [1.0])


@pytest.mark.reference
@pytest.mark.slow
def test_the_engine_follows_at_the_studied_frequencies(engine: DelaySystem) -> None:
    """Lee (1995), Figs 4.3-4.9: the peak lies at the input's frequency."""
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=5.0)
    checks = check_spectra(engine, find_trim(engine, inputs={"throttle": 25.0}), excitation)
    assert tuple(check.omega for check in checks) == STUDIED
    for check in checks:
        assert check.follows
        assert check.offset <= 1e-9
    assert 2.75 < max(check.spectrum.zero_line for check in checks) < 2.85
    assert checks[-1].spectrum.zero_line > checks[-1].spectrum.peak_amplitude


def test_a_spectrum_is_read_only() -> None:
    found: Spectrum = find_spectrum(*record(64, 1))
    with pytest.raises(ValueError, match="read-only"):
        found.amplitude[0] = 1.0
