"""Frequency response of any delay system by simulation: one sinusoid after the other, each until its answer has settled.

Source of the procedure and of the peak reading: Lee (1995), chapter 4.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.cycle_readings import FourierReading, ReadingMethod, read_fourier, read_peaks
from revline.analysis.linearize import linearize
from revline.analysis.periodic import Excitation, Mesh, PeriodicAnswer, RunSettings, check_excitation, plan_mesh, run_until_periodic
from revline.analysis.phase_turns import SineReading, read_turns
from revline.analysis.threads import Failure, Progress, run_all, run_each
from revline.analysis.trim import Trim
from revline.errors import AnalysisError, LagError, NotConvergedError
from revline.lti.response import FrequencyResponse, check_frequencies, count_turns
from revline.system import DelaySystem, Floats, Variable
from revline.values import make_read_only

HARMONICS = 10
"""Highest harmonic that a result lists; the distortion counts all of them."""

MOST_HALVINGS = 6
"""How often a step is halved before its error counts as irreducible."""

NO_FUNDAMENTAL = 1e-9
"""A fundamental below this part of the largest harmonic is none."""

ORDER_GAIN = 3.0
"""By halving its step a run loses 3 parts in 4 of its error at an equation's kink, more where it is smooth: at most a third is left."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sinestream:
    """A simulated frequency response at one trim and one amplitude, read in two ways, with how well it is known.

    Attributes:
        system: its name.
        excitation: what was moved, how far, and what was watched.
        moved, watched: the input and the output.
        base, rest: their values at the trim.
        omega: frequencies in rad/s, shape (n_freq,), as all arrays without another shape.
        fourier: by Fourier correlation.
        peaks: by maxima and minima.
        phase_gap_deg: phase by the minima less phase by the maxima.
        harmonics: amplitudes of the output's harmonics 1 to 10, shape (n_freq, 10).
        distortion: root of the summed squares of the harmonics from the second on, over the fundamental.
        mean: of the output over whole periods.
        cycles: periods simulated.
        step: of the simulation, in s.
        step_error: estimated relative error of the fundamental by the step, from a second run of twice the step.
        remaining: estimated part of the amplitude by which the waveform would still change.
    """

    system: str
    excitation: Excitation
    moved: Variable
    watched: Variable
    base: float
    rest: float
    omega: Floats
    fourier: SineReading
    peaks: SineReading
    phase_gap_deg: Floats
    harmonics: Floats
    distortion: Floats
    mean: Floats
    cycles: Floats
    step: Floats
    step_error: Floats
    remaining: Floats

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def amplitude(self) -> Floats:
        """Amplitude of the output's fundamental."""
        return np.abs(self.fourier.values) * self.excitation.amplitude

    @property
    def phase_deg(self) -> Floats:
        """Phase of the fundamental with all turns, negative for lag."""
        return self.fourier.phase_deg

    @property
    def peak_amplitude(self) -> Floats:
        """Half of maximum minus minimum of the output."""
        return np.abs(self.peaks.values) * self.excitation.amplitude

    @property
    def mean_shift(self) -> Floats:
        """Mean of the output less its value at the trim."""
        return self.mean - self.rest

    @property
    def notes(self) -> tuple[str, ...]:
        """What about the phases is uncertain, in words; each note once."""
        return tuple(dict.fromkeys((*self.fourier.notes, *self.peaks.notes)))

    def reading(self, method: ReadingMethod) -> SineReading:
        """Give the responses read in one way."""
        return self.fourier if method is ReadingMethod.FOURIER else self.peaks

    def response(self, method: ReadingMethod = ReadingMethod.FOURIER) -> FrequencyResponse:
        """Give the responses read in one way as a frequency response, for plots and fits."""
        reading = self.reading(method)
        return FrequencyResponse(
            omega=self.omega,
            values=reading.values,
            input_name=self.moved.name,
            input_unit=self.moved.unit,
            output_name=self.watched.name,
            output_unit=self.watched.unit,
            method=f"sinestream, {method.value}",
            turns=count_turns(reading.values, reading.phase_deg),
        )


@dataclass(frozen=True, slots=True)
class MissingAnswer:
    """A frequency without an answer.

    Attributes:
        omega: in rad/s.
        reason: why, in words.
    """

    omega: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PartialSinestream:
    """What is finished of a frequency response, and what is not.

    Attributes:
        finished: the response at the frequencies that were finished.
        missing: the others.
    """

    finished: Sinestream
    missing: tuple[MissingAnswer, ...]

    def __str__(self) -> str:
        """Say what is missing, and why."""
        count = self.finished.omega.size
        missing = "; ".join(f"{entry.omega:g} rad/s ({entry.reason})" for entry in self.missing)
        return f"{count} of {count + len(self.missing)} frequencies are finished; missing: {missing}"


def find_sinestream(
    system: DelaySystem,
    trim: Trim,
    excitation: Excitation,
    frequencies: ArrayLike,
    *,
    settings: RunSettings | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> Sinestream:
    """Simulate a system under sinusoids about a trim, each until its answer has settled, and read the response.

    Steps are whole parts of the period, so that correlation over whole periods is exact. Each frequency is simulated twice, the second
    time with half the step; the difference tells the error by the step, and the step is halved until that is small enough.

    Args:
        system: any system with delay channels.
        trim: a stable steady state, where the simulation starts.
        excitation: what is moved, how far, and what is watched.
        frequencies: in rad/s, above 0, strictly rising.
        settings: longest step, tolerances and longest run.
        workers: threads; the result does not depend on their number.
        progress: told which part of the frequencies is done.

    Returns:
        Amplitudes and phases by Fourier correlation and by peaks, distortion, mean, and the estimated errors.

    Raises:
        InvalidInputError: a frequency, a name or the number of workers cannot be used, or the sinusoid leaves the input's range.
        AnalysisError: the trim is unstable, or the output does not answer.
        NotSettledError: an answer does not repeat itself within the longest time.
        NotConvergedError: halving the step does not bring the error by the step below its tolerance.
        StalledError, LagError, DivergedError: a run ended; the message names the frequency.

    Source:
        Lee (1995), chapter 4, for sinusoids and peaks; the settling test and the step check are this package's own.
    """
    case = _Case(system, trim, excitation, settings or RunSettings())
    return _assemble(case, run_all(case.run_checked, case.meshes(frequencies), _cost, workers=workers, progress=progress))


def attempt_sinestream(
    system: DelaySystem,
    trim: Trim,
    excitation: Excitation,
    frequencies: ArrayLike,
    *,
    settings: RunSettings | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> Sinestream | PartialSinestream:
    """Find a frequency response as `find_sinestream` does, and keep what is finished where a frequency fails or the run is interrupted.

    Args:
        system: any system with delay channels.
        trim: a stable steady state, where the simulation starts.
        excitation: what is moved, how far, and what is watched.
        frequencies: in rad/s, above 0, strictly rising.
        settings: longest step, tolerances and longest run.
        workers: threads; the result does not depend on their number.
        progress: told which part of the frequencies is done.

    Returns:
        The whole response, or the finished part with the reason why each other frequency is missing.

    Raises:
        InvalidInputError, AnalysisError, KeyboardInterrupt: as for `find_sinestream`; of the frequencies' own errors the first, where
            none is finished.
    """
    case = _Case(system, trim, excitation, settings or RunSettings())
    meshes = case.meshes(frequencies)
    outcomes = run_each(case.run_checked, meshes, _cost, workers=workers, progress=progress)
    failures = [(mesh.omega, outcome.error) for mesh, outcome in zip(meshes, outcomes, strict=True) if isinstance(outcome, Failure)]
    runs = [outcome for outcome in outcomes if not isinstance(outcome, Failure)]
    if not runs:
        raise failures[0][1]
    stream = _assemble(case, runs)
    if not failures:
        return stream
    return PartialSinestream(finished=stream, missing=tuple(MissingAnswer(omega, str(error) or "interrupted") for omega, error in failures))


def _assemble(case: "_Case", runs: "list[_Run]") -> Sinestream:
    """Read the response from the settled answers, one for each frequency."""
    system, trim, excitation = case.system, case.trim, case.excitation
    moved, watched = check_excitation(system, trim, excitation)
    omega = np.array([run.answer.mesh.omega for run in runs])
    readings = [run.reading for run in runs]
    peaks = [read_peaks(run.answer.moved, run.answer.answered) for run in runs]
    model = linearize(system, trim).model
    guide = model.response(omega, moved.name, watched.name)
    by_fourier = read_turns(np.array([reading.value for reading in readings]), guide, model)
    by_peaks = read_turns(np.array([reading.value for reading in peaks]), guide, model)
    return Sinestream(
        system=system.name,
        excitation=excitation,
        moved=moved,
        watched=watched,
        base=trim.input(moved.name),
        rest=trim.output(watched.name),
        omega=omega,
        fourier=by_fourier,
        peaks=by_peaks,
        phase_gap_deg=np.array([reading.gap_deg for reading in peaks]),
        harmonics=np.array([[reading.amplitude, *reading.harmonics[: HARMONICS - 1]] for reading in readings]),
        distortion=np.array([reading.distortion for reading in readings]),
        mean=np.array([reading.mean for reading in readings]),
        cycles=np.array([run.answer.cycles for run in runs]),
        step=np.array([run.answer.mesh.step for run in runs]),
        step_error=np.array([run.step_error for run in runs]),
        remaining=np.array([run.answer.remaining for run in runs]),
    )


@dataclass(frozen=True, slots=True)
class _Case:
    """What all runs of a sinestream have in common."""

    system: DelaySystem
    trim: Trim
    excitation: Excitation
    settings: RunSettings

    def meshes(self, frequencies: ArrayLike) -> list[Mesh]:
        omega = check_frequencies(frequencies)
        check_excitation(self.system, self.trim, self.excitation)
        return [plan_mesh(float(w), self.trim, self.settings) for w in omega]

    def run(self, mesh: Mesh, progress: Progress) -> PeriodicAnswer:
        tolerance = self.settings.tolerance
        return run_until_periodic(self.system, self.trim, self.excitation, mesh, tolerance=tolerance, progress=progress)

    def run_checked(self, mesh: Mesh, progress: Progress) -> "_Run":
        """Halve the step until it no longer matters."""
        coarse = _first_coarse(self, mesh, progress)
        error = np.inf
        for _ in range(MOST_HALVINGS):
            answer = self.run(coarse.answer.mesh.finer(), progress)
            reading = self.read(answer)
            error = abs(reading.value - coarse.reading.value) / abs(reading.value) / ORDER_GAIN
            if error < self.settings.step_tolerance:
                return _Run(answer, reading, error)
            coarse = _Run(answer, reading, error)
        message = (
            f"the step still matters at {mesh.omega:g} rad/s: halving it to {coarse.answer.mesh.step:g} s leaves a relative error of "
            f"{error:.2g} (limit {self.settings.step_tolerance:g}); give a shorter max_step or a larger step_tolerance"
        )
        raise NotConvergedError(message, frequency=mesh.omega, error=error, step=coarse.answer.mesh.step)

    def read(self, answer: PeriodicAnswer) -> FourierReading:
        reading = read_fourier(answer.moved, answer.answered)
        if reading.amplitude <= NO_FUNDAMENTAL * float(np.max(reading.harmonics)):
            message = (
                f"output {self.excitation.output_name} of {self.system.name} answers {self.excitation.input_name} at "
                f"{answer.mesh.omega:g} rad/s with harmonics alone: it has no linear response there; choose another trim or output"
            )
            raise AnalysisError(message, frequency=answer.mesh.omega)
        return reading


@dataclass(frozen=True, slots=True)
class _Run:
    """A settled answer, its fundamental, and the error of that by the step."""

    answer: PeriodicAnswer
    reading: FourierReading
    step_error: float


def _cost(mesh: Mesh) -> int:
    return mesh.first


def _first_coarse(case: _Case, mesh: Mesh, progress: Progress) -> _Run:
    """Run with twice the step planned, or with less where a lag shrinks below that."""
    tried = mesh.coarser()
    for _ in range(MOST_HALVINGS - 1):
        try:
            return _coarse_run(case, tried, progress)
        except LagError:
            tried = tried.finer()
    return _coarse_run(case, tried, progress)


def _coarse_run(case: _Case, mesh: Mesh, progress: Progress) -> _Run:
    answer = case.run(mesh, progress)
    return _Run(answer, case.read(answer), np.inf)
