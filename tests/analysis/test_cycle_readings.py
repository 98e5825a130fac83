import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.analysis.cycle_readings import read_fourier, read_peaks, wrap
from revline.errors import InvalidInputError
from revline.system import Floats


def waves(count: int, cycles: int, *parts: tuple[float, float], mean: float = 0.0) -> Floats:
    """Sum over harmonics k = 1, 2, ... of amplitude sin(k angle + phase)."""
    angle = 2.0 * np.pi * np.arange(count * cycles) / count
    total = mean + sum(amplitude * np.sin((k + 1) * angle + phase) for k, (amplitude, phase) in enumerate(parts))
    return np.asarray(total).reshape(cycles, count)


@given(
    amplitude=st.floats(1e-3, 1e3),
    phase=st.floats(-3.1, 3.1),
    second=st.floats(0.0, 0.5),
    third=st.floats(0.0, 0.5),
    mean=st.floats(-10.0, 10.0),
    cycles=st.integers(1, 4),
)
def test_fourier_finds_every_part_exactly(amplitude: float, phase: float, second: float, third: float, mean: float, cycles: int) -> None:
    moved = waves(64, cycles, (2.0, 0.3), mean=7.0)
    answered = waves(64, cycles, (amplitude, 0.3 + phase), (amplitude * second, 1.0), (amplitude * third, -2.0), mean=mean)
    reading = read_fourier(moved, answered)
    assert reading.value == pytest.approx(0.5 * amplitude * np.exp(1j * phase), rel=1e-9, abs=1e-12)
    assert reading.amplitude == pytest.approx(amplitude, rel=1e-9)
    assert reading.harmonics[:2] == pytest.approx([amplitude * second, amplitude * third], abs=1e-12 * (amplitude + 10.0))
    assert reading.distortion == pytest.approx(np.hypot(second, third), rel=1e-9, abs=1e-8)
    assert reading.mean == pytest.approx(mean, abs=1e-11 * (1.0 + amplitude))


@given(amplitude=st.floats(0.1, 10.0), phase=st.floats(-3.0, 3.0), mean=st.floats(-10.0, 10.0))
def test_peaks_of_a_sinusoid_are_found_between_samples(amplitude: float, phase: float, mean: float) -> None:
    reading = read_peaks(waves(128, 2, (2.0, 0.1)), waves(128, 2, (amplitude, 0.1 + phase), mean=mean))
    assert abs(reading.value) == pytest.approx(0.5 * amplitude, rel=1e-6)
    assert np.angle(reading.value) == pytest.approx(phase, abs=5e-5)
    assert reading.gap_deg == pytest.approx(0.0, abs=5e-3)


def test_a_sample_alone_is_no_peak() -> None:
    """Negative control: without the parabola the nearest sample is up to half a sample off."""
    moved, answered = waves(64, 1, (1.0, 0.0)), waves(64, 1, (1.0, -1.0))
    by_sample = 2.0 * np.pi * (int(np.argmax(moved)) - int(np.argmax(answered))) / 64.0
    assert abs(by_sample + 1.0) > 0.01
    assert np.angle(read_peaks(moved, answered).value) == pytest.approx(-1.0, abs=2e-4)


def test_maxima_and_minima_differ_under_a_second_harmonic() -> None:
    # sin a + 0.1 cos 2a: the extremes keep their times and shift together.
    bent = read_peaks(waves(256, 1, (1.0, 0.0)), waves(256, 1, (1.0, 0.0), (0.1, 0.5 * np.pi)))
    assert abs(bent.value) == pytest.approx(1.0, rel=1e-6)
    assert bent.gap_deg == pytest.approx(0.0, abs=1e-6)
    # sin a + 0.1 sin 2a: the maximum is where cos a + 0.2 cos 2a = 0, the minimum at minus that.
    cosine = (-1.0 + np.sqrt(1.0 + 4.0 * 0.4 * 0.2)) / 0.8
    early = 90.0 - np.degrees(np.arccos(cosine))
    skewed = read_peaks(waves(256, 1, (1.0, 0.0)), waves(256, 1, (1.0, 0.0), (0.1, 0.0)))
    assert skewed.gap_deg == pytest.approx(-2.0 * early, abs=0.01)
    assert np.degrees(np.angle(skewed.value)) == pytest.approx(0.0, abs=0.01)


def test_a_flat_top_has_its_height_and_its_middle() -> None:
    moved = waves(64, 1, (1.0, 0.0))
    flat = read_peaks(moved, np.clip(waves(64, 1, (1.0, -2.0 * np.pi * 5 / 64)), -0.5, 0.5))
    assert abs(flat.value) == pytest.approx(0.5, rel=1e-12)
    assert np.angle(flat.value) == pytest.approx(-2.0 * np.pi * 5 / 64, abs=1e-9)


@given(angle=st.floats(-50.0, 50.0))
def test_wrap_takes_whole_turns_away(angle: float) -> None:
    wrapped = float(wrap(np.array(angle)))
    assert -np.pi - 1e-9 <= wrapped <= np.pi + 1e-9
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-9)


@pytest.mark.parametrize("read", [read_fourier, read_peaks])
def test_waves_of_other_shapes_are_refused(read: object) -> None:
    with pytest.raises(InvalidInputError, match=r"waves have shapes \(1, 64\) and \(2, 64\)"):
        read(waves(64, 1, (1.0, 0.0)), waves(64, 2, (1.0, 0.0)))  # type: ignore[operator]  # one of the two functions above


def test_an_input_at_rest_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="the input does not move"):
        read_fourier(np.ones((1, 64)), waves(64, 1, (1.0, 0.0)))
