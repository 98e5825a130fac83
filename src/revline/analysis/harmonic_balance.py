"""Periodic answers of any delay system to a sinusoid of any amplitude, by Fourier collocation: no transient is simulated.

The samples of the states over one period are the unknowns; channels are read by trigonometric interpolation at the delayed phase, so
that lags, also those that depend on the state, are exact. More samples are taken until the highest harmonics no longer matter.

Source: Engelborghs, Luzyanina, in 't Hout and Roose (2000), SIAM Journal on Scientific Computing 22(5), 1593-1609, for collocation of
periodic solutions of delay equations, there with piecewise polynomials.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.forced_orbits import FIRST_HARMONICS, OrbitBatch, find_orbits
from revline.analysis.jacobians import find_jacobians
from revline.analysis.linearize import build_model
from revline.analysis.orbit_newton import Drive
from revline.analysis.orbit_refusals import ForcedCase, Refusals
from revline.analysis.periodic import Excitation, check_excitation
from revline.analysis.phase_turns import SineReading, read_turns
from revline.analysis.trim import Trim
from revline.errors import out_of_range
from revline.lti.response import FrequencyResponse, check_frequencies, count_turns
from revline.system import DelaySystem, Floats, Variable, index_of
from revline.values import make_read_only


@dataclass(frozen=True, slots=True, kw_only=True)
class BalanceSettings:
    """How finely orbits are resolved.

    Attributes:
        tolerance: largest estimated relative error of the fundamental by the harmonics left out.
        most_harmonics: highest harmonic at most; where that is not enough the error is larger, and stated.

    Raises:
        InvalidInputError: a value is out of range.
    """

    tolerance: float = 1e-7
    most_harmonics: int = 128

    def __post_init__(self) -> None:
        if not 1e-12 <= self.tolerance < 1.0:
            raise out_of_range("tolerance", self.tolerance, "(a part of the amplitude)", "1e-12 to 1", "give a value such as 1e-7")
        if not FIRST_HARMONICS <= self.most_harmonics <= 512:
            raise out_of_range("most_harmonics", self.most_harmonics, "", f"{FIRST_HARMONICS} to 512", "give a number such as 128")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodicOrbit:
    """One period of a system under a sinusoid; the input is base + amplitude sin(phase).

    Attributes:
        omega: frequency in rad/s.
        phases: of the samples, in rad, shape (N,).
        inputs: shape (N, n_inputs).
        states: shape (N, n_states).
        readings: of the channels, shape (N, n_channels).
        outputs: shape (N, n_outputs).
    """

    omega: float
    phases: Floats
    inputs: Floats
    states: Floats
    readings: Floats
    outputs: Floats

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def harmonics(self) -> int:
        """Number of the highest harmonic."""
        return (self.phases.size - 1) // 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicBalance:
    """Periodic answers at one trim and one amplitude, over frequencies, with how well they are known.

    Attributes:
        system: its name.
        excitation: what was moved, how far, and what was watched.
        moved, watched: the input and the output.
        rest: the output at the trim.
        omega: frequencies in rad/s, shape (n_freq,), as all arrays without another shape.
        fundamental: output over input at the fundamental.
        harmonics: amplitudes of the output's harmonics 1 to 8, shape (n_freq, 8).
        distortion: root of the summed squares of the harmonics from the second on, over the fundamental.
        mean: of the output over a period.
        error: estimated relative error of the fundamental by the harmonics left out.
        last_step: size of Newton's last step, or what cheaper steps leave by the rate at which they shrink, as a part of the states' swing.
        batches: the whole orbits, by their number of harmonics.
        notes: what is less certain than asked for, in words.
    """

    system: str
    excitation: Excitation
    moved: Variable
    watched: Variable
    rest: float
    omega: Floats
    fundamental: SineReading
    harmonics: Floats
    distortion: Floats
    mean: Floats
    error: Floats
    last_step: Floats
    batches: tuple[OrbitBatch, ...]
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def amplitude(self) -> Floats:
        """Amplitude of the output's fundamental."""
        return np.abs(self.fundamental.values) * self.excitation.amplitude

    @property
    def phase_deg(self) -> Floats:
        """Phase of the fundamental with all turns, negative for lag."""
        return self.fundamental.phase_deg

    @property
    def mean_shift(self) -> Floats:
        """Mean of the output less its value at the trim."""
        return self.mean - self.rest

    @property
    def orbits(self) -> tuple[PeriodicOrbit, ...]:
        """The whole orbits, one for each frequency."""
        by_row = {int(row): _orbit(batch, k) for batch in self.batches for k, row in enumerate(batch.rows)}
        return tuple(by_row[row] for row in range(self.omega.size))

    def response(self) -> FrequencyResponse:
        """Give the fundamental as a frequency response, for plots and fits."""
        return FrequencyResponse(
            omega=self.omega,
            values=self.fundamental.values,
            input_name=self.moved.name,
            input_unit=self.moved.unit,
            output_name=self.watched.name,
            output_unit=self.watched.unit,
            method="harmonic balance",
            turns=count_turns(self.fundamental.values, self.fundamental.phase_deg),
        )


def balance_harmonics(
    system: DelaySystem, trim: Trim, excitation: Excitation, frequencies: ArrayLike, *, settings: BalanceSettings | None = None
) -> HarmonicBalance:
    """Find the periodic answers of a system to a sinusoid about a trim, at many frequencies at once.

    Newton's method starts from the linear answer with the delays exact; where it fails, the amplitude is raised step by step. The
    number of harmonics is doubled until the last of them, and the change by doubling, are below the tolerance.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        excitation: what is moved, how far, and what is watched.
        frequencies: in rad/s, above 0, strictly rising.
        settings: tolerance and most harmonics.

    Returns:
        Fundamental, harmonics, distortion, mean and orbits, with the estimated error of each fundamental.

    Raises:
        InvalidInputError: a frequency or a name cannot be used, or the sinusoid leaves the input's range.
        AnalysisError: the trim is unstable, the output does not answer, or a state leaves its range.
        LagError: on an orbit a lag is not positive, or delayed time runs backwards.
        NotConvergedError: no orbit was found at a frequency; the message says up to which amplitude there is one.
    """
    omega = check_frequencies(frequencies)
    if omega[0] == 0.0:
        raise out_of_range("frequency", 0.0, "rad/s", "values above 0", "ask for the steady map instead")
    empty = excited_case(system, trim, excitation, settings or BalanceSettings())
    found, refusals = balance_each(empty, trim, omega)
    if found is None or refusals:
        raise refusals[min(refusals)]
    return found


def balance_each(empty: ForcedCase, trim: Trim, omega: Floats) -> tuple[HarmonicBalance | None, Refusals]:
    """Find the periodic answers at some frequencies, and keep those of the others where one is refused.

    Args:
        empty: the question, without sinusoids.
        trim: about which they are.
        omega: frequencies in rad/s, above 0, strictly rising.

    Returns:
        The answers that there are, if any, and why there is none at the other frequencies, by their positions.
    """
    drive = replace(empty.drive, amplitude=np.full(omega.size, empty.excitation.amplitude), omega=omega)
    case = replace(empty, drive=drive)
    found = find_orbits(case)
    kept = np.array([row for row in range(omega.size) if row not in found.refusals], dtype=np.int64)
    if not kept.size:
        return None, found.refusals
    omega, error, highest = omega[kept], found.error[kept], found.highest[kept]
    names = (case.excitation.input_name, case.excitation.output_name)
    fundamental = read_turns(found.values[kept], case.model.response(omega, *names), case.model)
    rough = np.flatnonzero(error > case.tolerance)
    described = (_describe_error(float(omega[k]), int(highest[k]), float(error[k]), case.tolerance) for k in rough)
    balance = HarmonicBalance(
        system=case.system.name,
        excitation=case.excitation,
        moved=case.system.inputs[drive.position],
        watched=case.system.outputs[index_of(case.system.outputs, names[1])],
        rest=trim.output(names[1]),
        omega=omega,
        fundamental=fundamental,
        harmonics=found.listed[kept],
        distortion=found.distortion[kept],
        mean=found.mean[kept],
        error=error,
        last_step=found.last_step[kept],
        batches=tuple(replace(batch, rows=np.searchsorted(kept, batch.rows)) for batch in found.batches),
        notes=(*fundamental.notes, *described),
    )
    return balance, found.refusals


def excited_case(system: DelaySystem, trim: Trim, excitation: Excitation, settings: BalanceSettings) -> ForcedCase:
    """Prepare the question for orbits about a trim; its drive has no sinusoid yet.

    Raises:
        InvalidInputError: there is no such signal, or the sinusoid leaves the input's range.
        AnalysisError: the trim is unstable.
    """
    moved, _ = check_excitation(system, trim, excitation)
    none = np.empty(0)
    return ForcedCase(
        system=system,
        excitation=excitation,
        drive=Drive(trim=trim, position=index_of(system.inputs, moved.name), amplitude=none, omega=none),
        model=build_model(system, find_jacobians(system, trim.states, trim.inputs, trim.channels), trim.lags),
        tolerance=settings.tolerance,
        most_harmonics=settings.most_harmonics,
    )


def _orbit(batch: OrbitBatch, k: int) -> PeriodicOrbit:
    return PeriodicOrbit(
        omega=float(batch.omega[k]),
        phases=batch.phases,
        inputs=batch.inputs[k],
        states=batch.states[k],
        readings=batch.readings[k],
        outputs=batch.outputs[k],
    )


def _describe_error(omega: float, harmonics: int, error: float, tolerance: float) -> str:
    return (
        f"at {omega:g} rad/s the harmonics decay slowly, as where an orbit crosses a limit: with {harmonics} of them the "
        f"fundamental is known to {error:.1g} of itself (wanted {tolerance:g})"
    )
