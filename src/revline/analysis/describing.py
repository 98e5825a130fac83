"""Describing functions: how the fundamental answer of a system to a sinusoid depends on amplitude and frequency.

Each cell is a periodic orbit, its delays exact, and states its own error; a cell without an orbit states the reason. A cell is started
from the orbit of the amplitude below, so that a row of amplitudes follows one branch of orbits from the small ones on.

Source: Gelb and Vander Velde (1968), Multiple-Input Describing Functions and Nonlinear System Design, chapter 2, for the idea; here it is
the whole nonlinear system with all harmonics whose fundamental is taken, not a single nonlinearity with a sinusoid assumed before it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.analysis.collocation import Collocation
from revline.analysis.forced_orbits import FIRST_HARMONICS, ForcedOrbits, find_orbits
from revline.analysis.harmonic_balance import BalanceSettings, excited_case
from revline.analysis.orbit_equations import Orbits
from revline.analysis.orbit_newton import Drive, linear_orbits
from revline.analysis.orbit_refusals import ForcedCase
from revline.analysis.periodic import Excitation
from revline.analysis.phase_turns import follow_phase
from revline.analysis.threads import Progress
from revline.analysis.trim import Trim
from revline.errors import InvalidInputError, out_of_range
from revline.lti.response import Complexes, check_frequencies
from revline.system import DelaySystem, Floats, Variable, index_of
from revline.units import DEGREE
from revline.values import make_read_only

LADDER = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Amplitudes where none are given, as parts of the largest that the input's limits allow."""

FINE_ENOUGH = BalanceSettings(tolerance=1e-7, most_harmonics=128)
"""How finely cells are resolved where nothing else is asked for; one that needs more harmonics states its larger error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingCell:
    """An amplitude and a frequency without an orbit.

    Attributes:
        amplitude: in the input's unit.
        omega: in rad/s.
        reason: why there is none, in words.
    """

    amplitude: float
    omega: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DescribingFunctions:
    """Answers over amplitudes (rows) and frequencies (columns); cells where `found` is false hold zeros.

    Attributes:
        system: its name.
        moved, watched: the input and the output.
        base, rest: their values at the trim.
        largest: amplitude that the input's limits allow.
        amplitudes: in the input's unit, rising, shape (n_amp,).
        omega: in rad/s, rising, shape (n_freq,).
        small: exact small-signal response, shape (n_freq,).
        small_phase_deg: its phase with all turns, negative for lag.
        gain: fundamental of the output over the input, complex, shape (n_amp, n_freq), as all that follow.
        distortion: root of the summed squares of the harmonics from the second on, over the fundamental.
        mean_shift: mean of the output less its value at the trim.
        error: estimated relative error of the gain by the harmonics left out.
        found: which cells have an orbit.
        missing: the others, with the reason.
    """

    system: str
    moved: Variable
    watched: Variable
    base: float
    rest: float
    largest: float
    amplitudes: Floats
    omega: Floats
    small: Complexes
    small_phase_deg: Floats
    gain: Complexes
    distortion: Floats
    mean_shift: Floats
    error: Floats
    found: NDArray[np.bool_]
    missing: tuple[MissingCell, ...]

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def linear_error(self) -> Floats:
        """How far the small-signal response is from the answer: |small - gain| / |gain|; 0 where there is no orbit."""
        return linear_error(self.small, np.where(self.found, self.gain, self.small))

    @property
    def phase_deg(self) -> Floats:
        """Phase of the gain with the turns next to those of the small-signal response; that response's where there is no orbit."""
        turned: Floats = self.small_phase_deg + np.angle(np.where(self.found, self.gain, self.small) / self.small) / DEGREE
        return turned


def linear_error(small: Complexes, gain: Complexes) -> Floats:
    """Relative complex error of a small-signal response, by the true one."""
    error: Floats = np.abs(small - gain) / np.abs(gain)
    return error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownOrbits:
    """Orbits that others are started from, by the coefficients of their lowest harmonics.

    Attributes:
        amplitude: of each, shape (n,).
        known: which of them there are.
        states: coefficients less the trim, shape (n, H + 1, n_states).
        readings: the same of the channels, shape (n, H + 1, n_channels).
    """

    amplitude: Floats
    known: NDArray[np.bool_]
    states: Complexes
    readings: Complexes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitFamily:
    """Orbits of one system about one trim, at any amplitude and some frequencies.

    Attributes:
        case: the question without sinusoids.
        omega: frequencies in rad/s, shape (n_freq,).
        small: small-signal response at each.
    """

    case: ForcedCase
    omega: Floats
    small: Complexes

    def find(self, rows: NDArray[np.int64], amplitude: Floats, below: KnownOrbits | None) -> tuple[ForcedOrbits, KnownOrbits]:
        """Find orbits at some of the frequencies, each at its amplitude, started from those at other amplitudes."""
        drive = replace(self.case.drive, amplitude=amplitude, omega=self.omega[rows])
        case = replace(self.case, drive=drive)
        found = find_orbits(case) if below is None else find_orbits(case, lambda mesh: _scaled(case, below, mesh))
        return found, _remember(case.drive, found)


def make_family(
    system: DelaySystem, trim: Trim, names: tuple[str, str], frequencies: ArrayLike, settings: BalanceSettings | None = None
) -> OrbitFamily:
    """Prepare orbits from an input to an output, by their names, about a trim.

    Raises:
        InvalidInputError: a frequency or a name cannot be used, or the input stands at one of its limits.
        AnalysisError: the trim is unstable.
    """
    omega = check_frequencies(frequencies)
    if omega[0] == 0.0:
        raise out_of_range("frequency", 0.0, "rad/s", "values above 0", "ask for the steady map instead")
    excitation = Excitation(input_name=names[0], output_name=names[1], amplitude=largest_amplitude(system, trim, names[0]))
    case = excited_case(system, trim, excitation, settings or FINE_ENOUGH)
    return OrbitFamily(case=case, omega=omega, small=case.model.response(omega, *names).values)


def largest_amplitude(system: DelaySystem, trim: Trim, input_name: str) -> float:
    """Give the largest amplitude of a sinusoid on an input about a trim that stays within the input's limits.

    Raises:
        InvalidInputError: there is no such input, it stands at a limit, or it has no limits.
    """
    variable = system.inputs[index_of(system.inputs, input_name)]
    base = trim.input(input_name)
    largest = min(base - variable.low, variable.high - base)
    if not (0.0 < largest < np.inf):
        limits = f"{variable.low:g} to {variable.high:g} {variable.unit}"
        message = f"{input_name} = {base:g} {variable.unit} leaves no room for a sinusoid, or endless room, in its limits of {limits}"
        raise InvalidInputError(f"{message}; choose a trim inside limits", base=base)
    while base - largest < variable.low or base + largest > variable.high:
        largest = float(np.nextafter(largest, 0.0))
    return float(largest)


def find_describing_functions(
    system: DelaySystem,
    trim: Trim,
    names: tuple[str, str],
    frequencies: ArrayLike,
    amplitudes: ArrayLike | None = None,
    *,
    settings: BalanceSettings | None = None,
    progress: Progress | None = None,
) -> DescribingFunctions:
    """Find the describing functions of a system about a trim over a grid of amplitudes and frequencies.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        names: of the input that is moved and the output that is watched.
        frequencies: in rad/s, above 0, strictly rising.
        amplitudes: in the input's unit, above 0, strictly rising; without them 14, up to the largest that the input's limits allow.
        settings: tolerance and most harmonics of each orbit.
        progress: told which part of the amplitudes is done.

    Returns:
        Complex gains with their errors, distortion and mean shift; the cells without an orbit, with the reason.

    Raises:
        InvalidInputError: a frequency, an amplitude or a name cannot be used, or an amplitude leaves the input's limits.
        AnalysisError: the trim is unstable.
    """
    family = make_family(system, trim, names, frequencies, settings)
    return describe(family, amplitudes, progress)


def describe(family: OrbitFamily, amplitudes: ArrayLike | None = None, progress: Progress | None = None) -> DescribingFunctions:
    """Find the describing functions of a family of orbits; see `find_describing_functions`.

    Raises:
        InvalidInputError: an amplitude cannot be used, or leaves the input's limits.
    """
    case, omega = family.case, family.omega
    largest = case.excitation.amplitude
    ladder = check_amplitudes(amplitudes, case.system.inputs[case.drive.position], largest)
    shape = (ladder.size, omega.size)
    gain, found = np.zeros(shape, dtype=complex), np.zeros(shape, dtype=bool)
    distortion, mean_shift, error = np.zeros((3, *shape))
    rest = case.drive.trim.output(case.excitation.output_name)
    missing: list[MissingCell] = []
    rows, below = np.arange(omega.size), None
    for k, amplitude in enumerate(ladder):
        answers, known = family.find(rows, np.full(rows.size, amplitude), below)
        kept = rows[known.known]
        gain[k, kept], found[k, kept], error[k, kept] = answers.values[known.known], True, answers.error[known.known]
        distortion[k, kept], mean_shift[k, kept] = answers.distortion[known.known], answers.mean[known.known] - rest
        for position, refusal in sorted(answers.refusals.items()):
            cell = MissingCell(amplitude=float(amplitude), omega=float(omega[rows[position]]), reason=str(refusal))
            missing += [cell, *(_not_tried(cell, float(larger)) for larger in ladder[k + 1 :])]
        rows, below = kept, take_known(known, known.known)
        if progress is not None:
            progress((k + 1) / ladder.size)
        if not rows.size:
            break
    return DescribingFunctions(
        system=case.system.name,
        moved=case.system.inputs[case.drive.position],
        watched=case.system.outputs[index_of(case.system.outputs, case.excitation.output_name)],
        base=case.drive.trim.input(case.excitation.input_name),
        rest=rest,
        largest=largest,
        amplitudes=ladder,
        omega=omega,
        small=family.small,
        small_phase_deg=follow_phase(case.model, omega, case.excitation.input_name, case.excitation.output_name) / DEGREE,
        gain=gain,
        distortion=distortion,
        mean_shift=mean_shift,
        error=error,
        found=found,
        missing=tuple(sorted(missing, key=lambda cell: (cell.amplitude, cell.omega))),
    )


def check_amplitudes(amplitudes: ArrayLike | None, moved: Variable, largest: float) -> Floats:
    """Copy amplitudes into an array, or refuse them.

    Args:
        amplitudes: in the input's unit; without them parts of the largest.
        moved: the input.
        largest: that its limits allow.

    Raises:
        InvalidInputError: there are none, they do not rise from above 0 on, or the last is too large.
    """
    if amplitudes is None:
        return largest * np.array(LADDER)
    ladder = np.array(amplitudes, dtype=float)
    if ladder.ndim != 1 or not ladder.size or not np.all(np.isfinite(ladder)) or ladder[0] <= 0.0 or np.any(np.diff(ladder) <= 0.0):
        message = f"the amplitudes {ladder.tolist()} {moved.unit} do not rise from above 0 on; give each once, the smallest first"
        raise InvalidInputError(message)
    if ladder[-1] > largest:
        limit = f"0 to {largest:g} {moved.unit}, without 0, which is as far as {moved.name} can move about this point"
        raise out_of_range("amplitude", float(ladder[-1]), moved.unit, limit, "leave it out")
    return ladder


def take_known(known: KnownOrbits, which: NDArray[np.bool_] | NDArray[np.int64]) -> KnownOrbits:
    """Give some of the orbits."""
    return KnownOrbits(
        amplitude=known.amplitude[which], known=known.known[which], states=known.states[which], readings=known.readings[which]
    )


def _not_tried(cell: MissingCell, amplitude: float) -> MissingCell:
    reason = f"not tried, for there is none at amplitude {cell.amplitude:g}: {cell.reason}"
    return replace(cell, amplitude=amplitude, reason=reason)


def _remember(drive: Drive, found: ForcedOrbits) -> KnownOrbits:
    count, trim = drive.omega.size, drive.trim
    known = np.zeros(count, dtype=bool)
    states = np.zeros((count, FIRST_HARMONICS + 1, trim.states.size), dtype=complex)
    readings = np.zeros((count, FIRST_HARMONICS + 1, trim.channels.size), dtype=complex)
    for batch in found.batches:
        known[batch.rows] = True
        for target, samples, rest in ((states, batch.states, trim.states), (readings, batch.readings, trim.channels)):
            spectrum = np.fft.rfft(samples - rest, axis=1)[:, : FIRST_HARMONICS + 1] * (2.0 / batch.phases.size)
            spectrum[:, 0] *= 0.5
            target[batch.rows] = spectrum
    return KnownOrbits(amplitude=drive.amplitude, known=known, states=states, readings=readings)


def _scaled(case: ForcedCase, below: KnownOrbits, mesh: Collocation) -> Orbits:
    """Scale orbits to other amplitudes; those that are not known are the linear model's."""
    drive = case.drive
    linear = linear_orbits(drive, case.model, mesh)
    part = (drive.amplitude / below.amplitude)[:, None, None]
    harmonics = min(mesh.harmonics, FIRST_HARMONICS) + 1
    waves = mesh.waves(mesh.phases)[:, :harmonics]
    states = drive.trim.states + part * (waves @ below.states[:, :harmonics]).real
    readings = drive.trim.channels + part * (waves @ below.readings[:, :harmonics]).real
    return linear.with_part(
        below.known,
        Orbits(
            omega=drive.omega[below.known],
            inputs=linear.inputs[below.known],
            states=states[below.known],
            readings=readings[below.known],
        ),
    )
