"""Periodic answers of any delay system to a sinusoid of any amplitude, by Fourier collocation: no transient is simulated.

The samples of the states over one period are the unknowns; channels are read by trigonometric interpolation at the delayed phase, so
that lags, also those that depend on the state, are exact. More samples are taken until the highest harmonics no longer matter.

Source: Engelborghs, Luzyanina, in 't Hout and Roose (2000), SIAM Journal on Scientific Computing 22(5), 1593-1609, for collocation of
periodic solutions of delay equations, there with piecewise polynomials.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.collocation import Collocation, collocation, refine
from revline.analysis.jacobians import evaluate, find_jacobians
from revline.analysis.linearize import build_model
from revline.analysis.orbit_equations import OrbitEquations, Orbits
from revline.analysis.orbit_newton import Drive, follow_amplitude, linear_orbits, solve_orbits
from revline.analysis.periodic import Excitation, check_excitation
from revline.analysis.phase_turns import SineReading, read_turns
from revline.analysis.trim import Trim
from revline.errors import AnalysisError, LagError, NotConvergedError, out_of_range
from revline.lti.response import Complexes, FrequencyResponse, check_frequencies, count_turns
from revline.lti.state_space import DelayStateSpace
from revline.system import DelaySystem, Floats, Variable, index_of
from revline.values import make_read_only

FIRST_HARMONICS = 8
"""Highest harmonic of the first try."""

LISTED_HARMONICS = FIRST_HARMONICS
"""Highest harmonic that a result lists; the distortion counts all of them."""

NO_ANSWER = 1e-12
"""A fundamental below this part of the largest value of the output is none."""


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
        last_step: size of Newton's last step, as a part of the states' swing.
        orbits: the whole orbits.
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
    orbits: tuple[PeriodicOrbit, ...]
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
    settings = settings or BalanceSettings()
    omega = check_frequencies(frequencies)
    if omega[0] == 0.0:
        raise out_of_range("frequency", 0.0, "rad/s", "values above 0", "ask for the steady map instead")
    moved, watched = check_excitation(system, trim, excitation)
    model = build_model(system, find_jacobians(system, trim.states, trim.inputs, trim.channels), trim.lags)
    drive = Drive(trim=trim, position=index_of(system.inputs, moved.name), amplitude=excitation.amplitude, omega=omega)
    case = _Case(system, excitation, drive, model, settings)
    found = _resolve(case)
    fundamental = read_turns(found.values, model.response(omega, moved.name, watched.name), model)
    rough = np.flatnonzero(found.error > settings.tolerance)
    return HarmonicBalance(
        system=system.name,
        excitation=excitation,
        moved=moved,
        watched=watched,
        rest=trim.output(watched.name),
        omega=omega,
        fundamental=fundamental,
        harmonics=found.listed,
        distortion=found.distortion,
        mean=found.mean,
        error=found.error,
        last_step=found.last_step,
        orbits=tuple(found.orbits),
        notes=(*fundamental.notes, *(_describe_error(found.orbits[k], float(found.error[k]), settings) for k in rough)),
    )


@dataclass(frozen=True, slots=True)
class _Case:
    """What all orbits of one question have in common."""

    system: DelaySystem
    excitation: Excitation
    drive: Drive
    model: DelayStateSpace
    settings: BalanceSettings

    @property
    def step_tolerance(self) -> float:
        """Largest last step of Newton's method: the error left is smaller still."""
        return min(1e-6, max(1e-11, 0.01 * self.settings.tolerance))


@dataclass(frozen=True, slots=True)
class _Answers:
    """Orbits on one mesh, their output's harmonics, and their errors; orbits along the first axis.

    Attributes:
        orbits: the samples.
        outputs: of all outputs, shape (n, N, n_outputs).
        value: fundamental of the watched output over the input.
        sizes: its mean, and amplitudes of its harmonics from the first on, shape (n, H + 1).
        tail: largest of the last two harmonics of states and output, by their fundamentals.
        last_step: size of Newton's last step.
    """

    orbits: Orbits
    outputs: Floats
    value: Complexes
    sizes: Floats
    tail: Floats
    last_step: Floats


@dataclass(frozen=True, slots=True)
class _Found:
    """Answers by frequency: the finest of each."""

    values: Complexes
    listed: Floats
    distortion: Floats
    mean: Floats
    error: Floats
    last_step: Floats
    orbits: list[PeriodicOrbit]


def _resolve(case: _Case) -> _Found:
    """Find all orbits, with more harmonics those that need them."""
    n, limit, most = case.drive.omega.size, case.settings.tolerance, case.settings.most_harmonics
    mesh = collocation(FIRST_HARMONICS)
    pending, start = np.arange(n), linear_orbits(case.drive, case.model, mesh)
    finest: dict[int, PeriodicOrbit] = {}
    found = _Found(
        values=np.full(n, np.inf, dtype=complex),
        listed=np.empty((n, LISTED_HARMONICS)),
        distortion=np.empty(n),
        mean=np.empty(n),
        error=np.full(n, np.inf),
        last_step=np.empty(n),
        orbits=[],
    )
    while True:
        orbits, last_step = _find(case, mesh, start)
        _check_ranges(case, mesh, orbits)
        answers = _read(case, mesh, orbits, last_step)
        with np.errstate(invalid="ignore"):
            change = np.abs(answers.value - found.values[pending]) / np.abs(answers.value)
        known_by_change = (answers.tail > limit) & np.isfinite(change)
        found.error[pending] = np.where(known_by_change, change, answers.tail)
        found.values[pending], found.last_step[pending] = answers.value, answers.last_step
        found.listed[pending], found.mean[pending] = answers.sizes[:, 1 : LISTED_HARMONICS + 1], answers.sizes[:, 0]
        found.distortion[pending] = np.linalg.norm(answers.sizes[:, 2:], axis=1) / answers.sizes[:, 1]
        finest |= {int(position): _orbit(answers, row, mesh) for row, position in enumerate(pending)}
        rough = (answers.tail > limit) & ~(known_by_change & (change <= 0.1 * limit))
        if not np.any(rough) or 2 * mesh.harmonics > most:
            break
        pending, mesh, start = pending[rough], *_refined(case, mesh, answers.orbits.take(rough))
    found.orbits.extend(finest[position] for position in range(n))
    return found


def _refined(case: _Case, mesh: Collocation, kept: Orbits) -> tuple[Collocation, Orbits]:
    """Double the harmonics of some orbits."""
    fine = collocation(2 * mesh.harmonics)
    inputs = replace(case.drive, omega=kept.omega).inputs(fine)
    states, readings = refine(kept.states, mesh, fine), refine(kept.readings, mesh, fine)
    return fine, Orbits(omega=kept.omega, inputs=inputs, states=states, readings=readings)


def _orbit(answers: _Answers, row: int, mesh: Collocation) -> PeriodicOrbit:
    orbits = answers.orbits
    return PeriodicOrbit(
        omega=float(orbits.omega[row]),
        phases=mesh.phases,
        inputs=orbits.inputs[row],
        states=orbits.states[row],
        readings=orbits.readings[row],
        outputs=answers.outputs[row],
    )


def _find(case: _Case, mesh: Collocation, start: Orbits) -> tuple[Orbits, Floats]:
    """Solve for orbits; where Newton's method fails from the start given, or leaves the states' ranges, by raising the amplitude."""
    equations = OrbitEquations(system=case.system, mesh=mesh)
    solved = solve_orbits(equations, start, tolerance=case.step_tolerance)
    orbits, last_steps = solved.orbits, solved.last_step.copy()
    for row in np.flatnonzero(~(solved.found & equations.inside(solved.orbits))):
        drive = replace(case.drive, omega=start.omega[[row]])
        followed, reached = follow_amplitude(equations, drive, tolerance=case.step_tolerance)
        if reached < 1.0:
            raise _not_found(case, float(drive.omega[0]), reached)
        orbits = orbits.with_part(np.array([row]), followed.orbits)
        last_steps[row] = followed.last_step[0]
    return orbits, last_steps


def _check_ranges(case: _Case, mesh: Collocation, orbits: Orbits) -> None:
    """Refuse orbits on which the model means nothing, or a channel delivers backwards in time."""
    system = case.system
    for k, variable in enumerate(system.states):
        _refuse_beyond(case, orbits, variable, orbits.states[..., k])
    lags = evaluate(system, system.lags, orbits.states, orbits.inputs, orbits.readings)
    advance = 1.0 - (mesh.derivative @ lags) * orbits.omega[:, None, None]
    for k, variable in enumerate(system.channels):
        for what, values, unit in (("its lag", lags[..., k], "s"), ("the rate of its delayed time", advance[..., k], "s/s")):
            wrong = np.flatnonzero(~np.all(values > 0.0, axis=1))
            if wrong.size:
                omega, least = float(orbits.omega[wrong[0]]), float(np.min(values[wrong[0]]))
                message = (
                    f"channel {variable.name} of {system.name} delivers nothing on the orbit at {omega:g} rad/s: {what} falls to "
                    f"{least:g} {unit} (limit 0); choose a smaller amplitude than {case.excitation.amplitude:g}"
                )
                raise LagError(message, frequency=omega, least=least)


def _refuse_beyond(case: _Case, orbits: Orbits, variable: Variable, values: Floats) -> None:
    outside = np.flatnonzero(~np.all((values >= variable.low) & (values <= variable.high), axis=1))
    if outside.size:
        omega, low, high = float(orbits.omega[outside[0]]), float(np.min(values[outside[0]])), float(np.max(values[outside[0]]))
        message = (
            f"{variable.name} of {case.system.name} goes from {low:g} to {high:g} {variable.unit} on the orbit at {omega:g} rad/s, outside "
            f"its range of {variable.low:g} to {variable.high:g} {variable.unit}; choose a smaller amplitude than "
            f"{case.excitation.amplitude:g}"
        )
        raise AnalysisError(message, frequency=omega, low=low, high=high)


def _read(case: _Case, mesh: Collocation, orbits: Orbits, last_step: Floats) -> _Answers:
    """Read the watched output of orbits, and judge their resolution."""
    system = case.system
    outputs = evaluate(system, system.output, orbits.states, orbits.inputs, orbits.readings)
    watched = outputs[..., [index_of(system.outputs, case.excitation.output_name)]]
    harmonics = mesh.coefficients(np.concatenate((watched, orbits.states), axis=2))
    sizes = np.abs(harmonics)
    silent = sizes[:, 1] <= NO_ANSWER * np.max(sizes, axis=1)
    if np.any(silent[:, 0]):
        omega = float(orbits.omega[silent[:, 0]][0])
        message = (
            f"output {case.excitation.output_name} of {system.name} has no fundamental under input {case.excitation.input_name} at "
            f"{omega:g} rad/s: it does not answer, or with other harmonics alone; choose another output, trim or amplitude"
        )
        raise AnalysisError(message, frequency=omega)
    last = np.max(sizes[:, -2:], axis=1)
    tail = np.max(np.where(silent, 0.0, last / np.where(silent, 1.0, sizes[:, 1])), axis=1)
    sizes[:, 0] = harmonics[:, 0].real
    value = 1j * harmonics[:, 1, 0] / case.excitation.amplitude
    return _Answers(orbits=orbits, outputs=outputs, value=value, sizes=sizes[..., 0], tail=tail, last_step=last_step)


def _not_found(case: _Case, omega: float, reached: float) -> NotConvergedError:
    excitation = case.excitation
    unit = case.system.inputs[case.drive.position].unit
    message = (
        f"no periodic answer of {case.system.name} found at {omega:g} rad/s with {excitation.amplitude:g} {unit} amplitude of "
        f"{excitation.input_name}: there is one up to {reached * excitation.amplitude:.4g} {unit}; choose a smaller amplitude, or "
        "simulate it"
    )
    return NotConvergedError(message, frequency=omega, amplitude=reached * excitation.amplitude)


def _describe_error(orbit: PeriodicOrbit, error: float, settings: BalanceSettings) -> str:
    return (
        f"at {orbit.omega:g} rad/s the harmonics decay slowly, as where an orbit crosses a limit: with {orbit.harmonics} of them the "
        f"fundamental is known to {error:.1g} of itself (wanted {settings.tolerance:g})"
    )
