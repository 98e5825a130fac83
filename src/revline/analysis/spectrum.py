"""Amplitude spectra, scaled as in Lee (1995), and the check that an output follows the frequency of a sinusoidal input.

The spectrum is that of the output less its initial value, zero-padded to the next power of two, single-sided, scaled by the length of the
record before padding, doubled except at zero and at the Nyquist frequency, without a window.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from revline.analysis.cycle_readings import read_fourier
from revline.analysis.periodic import Excitation, Mesh, RunSettings, check_excitation, continue_periodic, plan_mesh, run_until_periodic
from revline.analysis.threads import Progress, run_all
from revline.analysis.trim import Trim
from revline.errors import InvalidInputError, out_of_range
from revline.lti.response import check_frequencies
from revline.system import DelaySystem, Floats
from revline.values import make_read_only

STUDIED = (0.01, 0.05, 0.5, 5.0, 20.0, 50.0)
"""Frequencies of the check in rad/s. Source: Lee (1995), Figs 4.3-4.9."""

FEWEST = 8
"""Fewest samples of a record."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum:
    """Amplitude spectrum of a record less an initial value; no window.

    Attributes:
        omega: frequencies in rad/s, from 0 to the Nyquist frequency.
        amplitude: at each, in the record's unit.
        initial: value that was subtracted.
        samples: of the record, before padding.
        step: between samples, in s.
        peak_omega: frequency of the highest line, the line at zero and its leakage left out, in rad/s.
        peak_amplitude: its height without that leakage.
    """

    omega: Floats
    amplitude: Floats
    initial: float
    samples: int
    step: float
    peak_omega: float
    peak_amplitude: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def zero_line(self) -> float:
        """Height of the line at zero, the magnitude of the record's mean: an operating point that moves, no vibration."""
        return float(self.amplitude[0])

    @property
    def duration(self) -> float:
        """Length of the record in s."""
        return self.samples * self.step

    @property
    def resolution(self) -> float:
        """Smallest difference of frequencies that the record can tell, 2 pi over its duration before padding, in rad/s."""
        return 2.0 * math.pi / self.duration

    @property
    def bin_width(self) -> float:
        """Distance of neighbouring lines after padding, in rad/s; the resolution or less."""
        return float(self.omega[1] - self.omega[0])

    @property
    def padded(self) -> int:
        """Samples after padding."""
        return next_power_of_two(self.samples)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralCheck:
    """Whether an output under a sinusoid is highest at the sinusoid's frequency.

    Attributes:
        omega: frequency of the input in rad/s.
        spectrum: of the output less its value at the trim, after the transient.
        cycles: periods in the record.
        distortion: root of the summed squares of the harmonics from the second on, over the fundamental.
        remaining: estimated part of the amplitude by which the waveform would still change.
    """

    omega: float
    spectrum: Spectrum
    cycles: int
    distortion: float
    remaining: float

    @property
    def offset(self) -> float:
        """Distance of the peak from the input's frequency in rad/s."""
        return abs(self.spectrum.peak_omega - self.omega)

    @property
    def follows(self) -> bool:
        """Whether the peak lies at the input's frequency within the resolution."""
        return self.offset <= self.spectrum.resolution

    @property
    def samples_per_cycle(self) -> int:
        """Samples per period of the record."""
        return self.spectrum.samples // self.cycles

    def __str__(self) -> str:
        """Say what was found, and how."""
        s = self.spectrum
        verdict = "follows" if self.follows else "does not follow"
        record = f"{self.cycles} periods after the transient, {self.samples_per_cycle} samples each, padded from {s.samples} to {s.padded}"
        lines = f"peak {s.peak_amplitude:.4g} at {s.peak_omega:.6g} rad/s, line at zero {s.zero_line:.3g}"
        return (
            f"{verdict} {self.omega:g} rad/s: {lines}, resolution {s.resolution:.3g} rad/s, distortion {100.0 * self.distortion:.2g} %; "
            f"{record}, no window"
        )


def find_spectrum(times: Floats, values: Floats, *, initial: float | None = None) -> Spectrum:
    """Find the amplitude spectrum of an evenly sampled record.

    For the peak the record's mean is taken out first: padding spreads the line at zero over its neighbours, where it may be higher than
    any other line.

    Args:
        times: shape (n,), evenly spaced, in s.
        values: shape (n,).
        initial: value to subtract; the first of the record where none is given.

    Returns:
        The spectrum and its peak.

    Raises:
        InvalidInputError: the shapes differ, the record is short or unevenly sampled, or a number is not finite.

    Source:
        Lee (1995), chapter 4.
    """
    step = _check_record(times, values)
    first = float(values[0]) if initial is None else float(initial)
    if not math.isfinite(first):
        raise out_of_range("initial value", first, "", "finite numbers", "give the output's value at rest")
    amplitude = _scaled(values - first)
    omega = np.arange(amplitude.size, dtype=float) * (2.0 * math.pi / (step * next_power_of_two(values.size)))
    without_mean = _scaled(values - np.mean(values))
    peak = 1 + int(np.argmax(without_mean[1:]))
    return Spectrum(
        omega=omega,
        amplitude=amplitude,
        initial=first,
        samples=values.size,
        step=step,
        peak_omega=float(omega[peak]),
        peak_amplitude=float(without_mean[peak]),
    )


def check_spectra(
    system: DelaySystem,
    trim: Trim,
    excitation: Excitation,
    frequencies: Sequence[float] = STUDIED,
    *,
    settings: RunSettings | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> tuple[SpectralCheck, ...]:
    """Simulate sinusoids until the answer has settled, then some periods more, and see at which frequency the output is highest.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        excitation: what is moved, how far, and what is watched.
        frequencies: in rad/s, strictly rising.
        settings: longest step, tolerance, longest run and periods in each record.
        workers: threads; the result does not depend on their number.
        progress: told which part of the frequencies is done.

    Returns:
        One check for each frequency.

    Raises:
        InvalidInputError: a frequency, a name or a number cannot be used, or the sinusoid leaves the input's range.
        AnalysisError: the trim is unstable, or the output does not answer.
        NotSettledError: an answer does not repeat itself within the longest time.
        StalledError, LagError, DivergedError: a run ended; the message names the frequency.

    Source:
        Lee (1995), chapter 4, Figs 4.3-4.9.
    """
    settings = settings or RunSettings()
    check_excitation(system, trim, excitation)
    meshes = [plan_mesh(float(w), trim, settings) for w in check_frequencies(frequencies)]

    def check(mesh: Mesh, going: Progress) -> SpectralCheck:
        answer = run_until_periodic(system, trim, excitation, mesh, tolerance=settings.tolerance, progress=going)
        record = continue_periodic(system, excitation, answer, cycles=settings.cycles, progress=going)
        values = record.output(excitation.output_name)
        return SpectralCheck(
            omega=mesh.omega,
            spectrum=find_spectrum(record.times, values, initial=trim.output(excitation.output_name)),
            cycles=settings.cycles,
            distortion=read_fourier(answer.moved, answer.answered).distortion,
            remaining=answer.remaining,
        )

    return tuple(run_all(check, meshes, lambda mesh: mesh.first + settings.cycles * mesh.count, workers=workers, progress=progress))


def next_power_of_two(count: int) -> int:
    """Smallest power of two that is not below a number of samples."""
    return 1 << (count - 1).bit_length()


def _scaled(values: Floats) -> Floats:
    """Single-sided amplitudes of a record, zero-padded, scaled by its length before padding."""
    padded = next_power_of_two(values.size)
    amplitude = np.abs(np.fft.rfft(values, padded)) / values.size
    amplitude[1:-1] *= 2.0
    return np.asarray(amplitude, dtype=float)


def _check_record(times: Floats, values: Floats) -> float:
    """Refuse a record that has no spectrum; give its step."""
    if times.ndim != 1 or times.shape != values.shape or times.size < FEWEST:
        message = f"a spectrum needs {FEWEST} or more times and as many values, not shapes {times.shape} and {values.shape}"
        raise InvalidInputError(message)
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        message = "the record holds numbers that are not finite; remove them before taking a spectrum"
        raise InvalidInputError(message)
    step = float(times[-1] - times[0]) / (times.size - 1)
    uneven = float(np.max(np.abs(np.diff(times) - step)))
    if not (step > 0.0 and uneven <= 1e-6 * step):
        message = f"the record is sampled unevenly: steps differ from {step:g} s by up to {uneven:g} s; sample it evenly first"
        raise InvalidInputError(message, step=step, uneven=uneven)
    return step
