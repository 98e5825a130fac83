"""Families of limit cycles that begin at an equilibrium: how one input, a parameter, must change for the cycles to grow.

The amplitude of an output's fundamental is prescribed, and the parameter and the frequency are found with the samples of the period: no
fold of the parameter stops the family. It begins with the oscillation of the linearised system at the limit of stability.

Source: Seydel (2010), Practical Bifurcation and Stability Analysis, chapters 4 and 7, for branches with a prescribed size; Kuznetsov
(2004), Elements of Applied Bifurcation Theory, chapter 3, for soft (supercritical) and hard (subcritical) onset.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.collocation import Collocation, collocation, refine
from revline.analysis.forced_orbits import FIRST_HARMONICS
from revline.analysis.jacobians import differentiate, evaluate, find_jacobians, settle_channels
from revline.analysis.limit_cycles import Cycle, as_orbit, last_harmonics, step_scales
from revline.analysis.orbit_equations import LinearOrbits, Misses, OrbitEquations, Orbits
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.system import DelaySystem, Floats
from revline.values import make_read_only

MOST_STEPS = 20
"""Newton steps after which a cycle counts as not found."""

LARGEST_STEP = 10.0
"""A step this many times the swing, the frequency or the parameter leads nowhere."""

STEP_TOLERANCE = 1e-9
"""Largest last step of a cycle that is found, as a part of the swing, the frequency and the parameter."""

MOST_HARMONICS = 64
"""Highest harmonic at most; a cycle that would need more has a larger error, and states it."""

TAIL = 1e-7
"""Size of the last harmonics, as a part of the fundamental, from which on more are taken."""

SHORTEST_RISE = 2.0**-5
"""Smallest part of a step of the amplitude that is tried."""

DIFFERENCE = 1e-6
"""Relative change of the parameter by which its effect is found; the equations are nearly straight in it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Onset:
    """An equilibrium with a pair of roots on the imaginary axis.

    Attributes:
        states: at rest, shape (n_states,).
        inputs: shape (n_inputs,), the parameter among them.
        frequency: of the oscillation, in rad/s.
    """

    states: Floats
    inputs: Floats
    frequency: float

    def __post_init__(self) -> None:
        make_read_only(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BranchPoint:
    """One cycle of a family.

    Attributes:
        parameter: value of the input.
        amplitude: of the fundamental of the output that was prescribed.
        cycle: the cycle, with the estimated error of its resolution.
    """

    parameter: float
    amplitude: float
    cycle: Cycle


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchAxes:
    """Positions of the parameter among the inputs, and among the outputs of what has the prescribed amplitude."""

    parameter: int
    watched: int


def follow_cycles(
    system: DelaySystem,
    onset: Onset,
    axes: BranchAxes,
    amplitudes: Floats,
    *,
    enough: Callable[[Sequence[BranchPoint]], bool] | None = None,
) -> tuple[BranchPoint, ...]:
    """Follow the family of cycles that begins at an equilibrium.

    Args:
        system: any system with delay channels.
        onset: where the family begins.
        axes: what is free, and what is prescribed.
        amplitudes: of the fundamental of the output, rising from above 0.
        enough: tells from the cycles found so far that no larger ones are wanted; without it all are.

    Returns:
        A cycle for each amplitude; fewer where those found are enough or the family cannot be followed further, but at least one.

    Raises:
        InvalidInputError: the amplitudes do not rise from above 0, or the equilibrium does not oscillate in that output.
        NotConvergedError: not even the first cycle is found.
    """
    if not (amplitudes.size and amplitudes[0] > 0.0 and np.all(np.diff(amplitudes) > 0.0) and np.all(np.isfinite(amplitudes))):
        message = f"amplitudes {np.array2string(amplitudes, precision=4)} do not rise from above 0; give rising ones"
        raise InvalidInputError(message)
    if not (np.isfinite(onset.frequency) and onset.frequency > 0.0):
        raise out_of_range("frequency at the onset", onset.frequency, "rad/s", "values above 0", "give that of the roots on the axis")
    family = _Family(system, axes)
    last = _begin(family, onset, float(amplitudes[0]))
    before, found = last, list[BranchPoint]()
    for k, wanted in enumerate(amplitudes):
        reached = _reach(family, before, last, float(wanted)) if k else family.solve(last, float(wanted))
        if reached is None:
            break
        before, last = (last, reached) if k else (_rest(onset, reached), reached)
        found.append(family.point(reached))
        if enough is not None and enough(found):
            break
    if not found:
        message = (
            f"no cycle of {system.name} with an amplitude of {amplitudes[0]:g} {system.outputs[axes.watched].unit} is found at its onset, "
            f"{onset.frequency:g} rad/s; begin with a smaller one"
        )
        raise NotConvergedError(message, frequency=onset.frequency)
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Member:
    """A cycle on a mesh, its amplitude, and the size of the last step that found it."""

    mesh: Collocation
    orbits: Orbits
    amplitude: float
    last_step: float = np.inf

    def on(self, mesh: Collocation) -> "_Member":
        """Read the cycle at other phases."""
        if mesh.count == self.mesh.count:
            return self
        orbits = Orbits(
            omega=self.orbits.omega,
            inputs=np.tile(self.orbits.inputs[:, :1], (1, mesh.count, 1)),
            states=refine(self.orbits.states, self.mesh, mesh),
            readings=refine(self.orbits.readings, self.mesh, mesh),
        )
        return _Member(mesh, orbits, self.amplitude)


@dataclass(frozen=True, slots=True)
class _Family:
    """A system, what is free and what is prescribed."""

    system: DelaySystem
    axes: BranchAxes

    def with_parameter(self, orbits: Orbits, value: float) -> Orbits:
        inputs = orbits.inputs.copy()
        inputs[..., self.axes.parameter] = value
        return replace(orbits, inputs=inputs)

    def parameter(self, orbits: Orbits) -> float:
        return float(orbits.inputs[0, 0, self.axes.parameter])

    def fundamental(self, member: _Member) -> complex:
        """Coefficient of exp(j phase) of the output."""
        watched = self._output(member.orbits)
        return complex(member.mesh.coefficients(watched[:, None])[1, 0])

    def _output(self, orbits: Orbits) -> Floats:
        found: Floats = evaluate(self.system, self.system.output, orbits.states, orbits.inputs, orbits.readings)[0, :, self.axes.watched]
        return found

    def solve(self, member: _Member, amplitude: float) -> _Member | None:
        """Find the cycle with an amplitude, with as many harmonics as it needs; None where Newton's method fails."""
        while True:
            solved = self._newton(member, amplitude)
            if solved is None or last_harmonics(solved.mesh, solved.orbits) <= TAIL or 2 * member.mesh.harmonics > MOST_HARMONICS:
                return solved
            member = solved.on(collocation(2 * member.mesh.harmonics))

    def _newton(self, member: _Member, amplitude: float) -> _Member | None:
        equations = OrbitEquations(system=self.system, mesh=member.mesh)
        orbits, misses = equations.settle(member.orbits)
        for _ in range(MOST_STEPS):
            try:
                step, readings = self._step(equations, orbits, misses, amplitude)
            except np.linalg.LinAlgError:  # as where the control stays at its limits: no change of the gains changes the cycle
                return None
            states, turn, change = step[:-2].reshape(orbits.states.shape), step[-2], step[-1]
            omega, value = float(orbits.omega[0]), self.parameter(orbits)
            size = max(float(np.max(np.abs(states) / step_scales(equations, orbits))), abs(turn) / omega, abs(change) / abs(value))
            if not (size <= LARGEST_STEP and omega + turn > 0.0):
                return None
            moved = replace(orbits, omega=orbits.omega + turn, states=orbits.states + states, readings=orbits.readings + readings)
            orbits, misses = equations.settle(self.with_parameter(moved, value + change))
            if size <= STEP_TOLERANCE:
                return _Member(member.mesh, orbits, amplitude, size)
        return None

    def _step(self, equations: OrbitEquations, orbits: Orbits, misses: Misses, amplitude: float) -> tuple[Floats, Floats]:
        """Changes of states, frequency and parameter by Newton's method, and of the readings."""
        linear = equations.linearise(orbits)
        right, excess = linear.right_side(misses)
        by_parameter, excess_by_parameter = self._by_parameter(equations, linear, orbits)
        size = linear.matrix.shape[-1]
        matrix = np.zeros((size + 2, size + 2))
        matrix[:size, :size], matrix[:size, size] = linear.matrix[0], linear.by_omega[0].ravel()
        matrix[:size, size + 1] = by_parameter.ravel()
        weights = equations.mesh.analysis[:, 1]
        by_states, by_readings = self._output_slopes(orbits)
        through = np.einsum("nc,ncs->ns", by_readings, linear.deliveries.by_states[0].reshape(*by_readings.shape, -1))
        spread = np.zeros((weights.size, size))
        for k in range(by_states.shape[1]):
            spread[np.arange(weights.size), np.arange(weights.size) * by_states.shape[1] + k] = by_states[:, k]
        rows = weights @ (spread + through)
        extra = weights @ np.einsum("nc,nc->n", by_readings, linear.deliveries.by_omega[0])
        matrix[size], matrix[size + 1] = np.append(rows.real, [extra.real, 0.0]), np.append(rows.imag, [extra.imag, 0.0])
        now = complex(weights @ self._output(orbits))
        step = np.linalg.solve(matrix, -np.concatenate((right.ravel(), [now.real - amplitude, now.imag])))
        given = linear.deliveries
        readings = (given.by_states[0] @ step[:size]).reshape(excess.shape) + given.by_omega * step[size] - excess
        return step, readings - excess_by_parameter * step[size + 1]

    def _output_slopes(self, orbits: Orbits) -> tuple[Floats, Floats]:
        by_x, _, by_z = differentiate(self.system, self.system.output, orbits.states, orbits.inputs, orbits.readings)
        return by_x[0, :, self.axes.watched], by_z[0, :, self.axes.watched]

    def _by_parameter(self, equations: OrbitEquations, linear: LinearOrbits, orbits: Orbits) -> tuple[Floats, Floats]:
        """How the states' equations, and the readings' excess, change with the parameter."""
        value = self.parameter(orbits)
        ends = [linear.right_side(equations.misses(self.with_parameter(orbits, value * (1.0 + s * DIFFERENCE)))) for s in (1.0, -1.0)]
        width = 2.0 * DIFFERENCE * value
        return (ends[0][0] - ends[1][0]) / width, (ends[0][1] - ends[1][1]) / width

    def point(self, member: _Member) -> BranchPoint:
        orbits = member.orbits
        orbit = as_orbit(self.system, member.mesh, orbits)
        cycle = Cycle(orbit=orbit, error=last_harmonics(member.mesh, orbits), last_step=member.last_step)
        return BranchPoint(parameter=self.parameter(orbits), amplitude=member.amplitude, cycle=cycle)


def _begin(family: _Family, onset: Onset, amplitude: float) -> _Member:
    """The oscillation of the linearised system, with an amplitude."""
    system, mesh = family.system, collocation(FIRST_HARMONICS)
    readings = settle_channels(system, onset.states, onset.inputs)
    found = find_jacobians(system, onset.states, onset.inputs, readings)
    lags = evaluate(system, system.lags, onset.states, onset.inputs, readings)
    n, m = onset.states.size, readings.size
    late = np.exp(-1j * onset.frequency * lags)[:, None]
    matrix = np.block([[1j * onset.frequency * np.eye(n) - found.A, -found.Bz], [-late * found.Cz, np.eye(m) - late * found.Dzz]])
    shape = np.linalg.svd(matrix)[2][-1].conj()
    seen = complex(found.Cy[family.axes.watched] @ shape[:n] + found.Dyz[family.axes.watched] @ shape[n:])
    if abs(seen) <= 1e-9 * float(np.linalg.norm(shape)) * float(np.linalg.norm(found.Cy[family.axes.watched])):
        output = system.outputs[family.axes.watched].name
        raise InvalidInputError(
            f"the oscillation of {system.name} at its onset does not show in {output}; watch another output", output=output
        )
    wave = amplitude / seen * np.exp(1j * mesh.phases)[:, None]
    orbits = Orbits(
        omega=np.array([onset.frequency]),
        inputs=np.tile(onset.inputs, (1, mesh.count, 1)),
        states=(onset.states + (wave * shape[:n]).real)[None],
        readings=(readings + (wave * shape[n:]).real)[None],
    )
    return _Member(mesh, orbits, amplitude)


def _rest(onset: Onset, first: _Member) -> _Member:
    """The equilibrium as a cycle of no amplitude, to foretell the second cycle from."""
    orbits = first.orbits
    mean = np.tile(np.mean(orbits.readings, axis=1, keepdims=True), (1, orbits.readings.shape[1], 1))
    rest = replace(
        orbits,
        omega=np.array([onset.frequency]),
        inputs=np.tile(onset.inputs, (1, first.mesh.count, 1)),
        states=np.tile(onset.states, (1, first.mesh.count, 1)),
        readings=mean,
    )
    return _Member(first.mesh, rest, 0.0)


def _reach(family: _Family, before: _Member, last: _Member, wanted: float) -> _Member | None:
    """Go on from two cycles to an amplitude, in smaller steps where Newton's method fails; None where the smallest fail too."""
    rise = wanted - last.amplitude
    while last.amplitude < wanted * (1.0 - 1e-12):
        target = min(wanted, last.amplitude + rise)
        reached = family.solve(_foretell(family, before, last, target), target)
        if reached is None:
            rise *= 0.5
            if rise < SHORTEST_RISE * (wanted - before.amplitude):
                return None
            continue
        before, last = last, reached
    return last


def _foretell(family: _Family, before: _Member, last: _Member, amplitude: float) -> _Member:
    """Continue straight on through two cycles."""
    earlier, ahead = before.on(last.mesh).orbits, (amplitude - last.amplitude) / (last.amplitude - before.amplitude)
    orbits = last.orbits
    value = family.parameter(orbits) + ahead * (family.parameter(orbits) - family.parameter(earlier))
    moved = replace(
        orbits,
        omega=orbits.omega + ahead * (orbits.omega - earlier.omega),
        states=orbits.states + ahead * (orbits.states - earlier.states),
        readings=orbits.readings + ahead * (orbits.readings - earlier.readings),
    )
    return _Member(last.mesh, family.with_parameter(moved, value), amplitude)
