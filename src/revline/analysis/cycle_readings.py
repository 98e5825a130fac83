"""Reading amplitude and phase from whole periods of a sinusoid and its answer: by Fourier correlation, and by peaks."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from revline.errors import InvalidInputError
from revline.lti.response import Complexes
from revline.system import Floats
from revline.values import make_read_only


class ReadingMethod(Enum):
    """How amplitude and phase are read from periodic waveforms."""

    FOURIER = "fourier"
    PEAKS = "peaks"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FourierReading:
    """Fundamental and harmonics of a periodic answer.

    Attributes:
        value: fundamental of the output over that of the input, a lag having a negative phase.
        amplitude: of the output's fundamental.
        harmonics: amplitudes of the output's harmonics from the second on.
        mean: of the output.
    """

    value: complex
    amplitude: float
    harmonics: Floats
    mean: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def distortion(self) -> float:
        """Root of the summed squares of the harmonics over the fundamental."""
        return float(np.sqrt(np.sum(self.harmonics**2))) / self.amplitude


@dataclass(frozen=True, slots=True, kw_only=True)
class PeakReading:
    """Amplitude and phase by maxima and minima.

    Attributes:
        value: half of maximum minus minimum of the output over that of the input, with the phase below.
        gap_deg: phase by the minima less phase by the maxima.
    """

    value: complex
    gap_deg: float


def read_fourier(moved: Floats, answered: Floats) -> FourierReading:
    """Correlate input and output over whole periods with sines and cosines; exact for samples at whole parts of the period.

    Args:
        moved: input, shape (n_cycles, n_samples).
        answered: output, of the same shape.

    Raises:
        InvalidInputError: the shapes differ, there are fewer than 8 samples per period, or the input does not move.
    """
    _check_waves(moved, answered)
    source = _coefficients(moved)
    target = _coefficients(answered)
    size = np.abs(target)
    return FourierReading(
        value=complex(target[1] / source[1]),
        amplitude=float(size[1]),
        harmonics=size[2 : 1 + (moved.shape[1] - 1) // 2],
        mean=float(target[0].real) / 2.0,
    )


def read_peaks(moved: Floats, answered: Floats) -> PeakReading:
    """Read amplitude and phase cycle by cycle from the heights and times of maxima and minima, and average over the cycles.

    A height and its time are those of the parabola through the extreme sample and its neighbours. The phase is the mean of that between
    the maxima of input and output and that between their minima.

    Args:
        moved: input, shape (n_cycles, n_samples).
        answered: output, of the same shape.

    Raises:
        InvalidInputError: the shapes differ, there are fewer than 8 samples per period, or the input does not move.

    Source:
        Lee (1995), chapter 4.
    """
    _check_waves(moved, answered)
    high_time, high = _peak_of_each(moved)
    low_time, low = _peak_of_each(-moved)
    answer_high_time, answer_high = _peak_of_each(answered)
    answer_low_time, answer_low = _peak_of_each(-answered)
    turn = 2.0 * np.pi / moved.shape[1]
    by_high, by_low = turn * (high_time - answer_high_time), turn * (low_time - answer_low_time)
    gap = wrap(by_low - by_high)
    ratio = (answer_high + answer_low) / (high + low)
    direction = np.mean(np.exp(1j * (by_high + 0.5 * gap)))
    value = np.mean(ratio) * direction / np.abs(direction)
    return PeakReading(value=complex(value), gap_deg=float(np.degrees(np.mean(gap))))


def wrap(angle: Floats) -> Floats:
    """Bring angles in radians to -pi to pi by whole turns."""
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def _coefficients(waves: Floats) -> Complexes:
    """Amplitudes and phases of the mean period, harmonic by harmonic."""
    return np.asarray(np.fft.rfft(np.mean(waves, axis=0)) * (2.0 / waves.shape[1]), dtype=complex)


def _peak_of_each(waves: Floats) -> tuple[Floats, Floats]:
    """Time in samples and height of each period's maximum; of a flat one the middle."""
    rows, count = np.arange(waves.shape[0]), waves.shape[1]
    top = np.argmax(waves, axis=1)
    left, middle, right = waves[rows, top - 1], waves[rows, top], waves[rows, (top + 1) % count]
    level = waves == middle[:, None]
    flat = np.sum(level, axis=1) > 2
    curvature = np.where(flat, 1.0, left - 2.0 * middle + right)
    shift = np.where(flat, 0.0, 0.5 * (left - right) / curvature)
    centre = np.angle(level @ np.exp(2j * np.pi * np.arange(count) / count)) * count / (2.0 * np.pi)
    return np.where(flat, centre, top + shift), middle - 0.25 * (left - right) * shift


def _check_waves(moved: Floats, answered: Floats) -> None:
    if moved.ndim != 2 or moved.shape != answered.shape or moved.shape[1] < 8:
        message = f"input and output waves have shapes {moved.shape} and {answered.shape}; give both as (cycles, 8 or more samples)"
        raise InvalidInputError(message)
    if np.ptp(moved) == 0.0:
        message = "the input does not move; a response needs one that does"
        raise InvalidInputError(message)
