"""Limit cycles of any delay system that is driven by constant inputs alone: harmonic balance with unknown frequency.

The samples of one period and the frequency are the unknowns; the phase is fixed by a condition. What a simulation shows at its end, or
a small oscillation about an equilibrium at the limit of stability, is a start good enough for Newton's method.

Source: Engelborghs, Luzyanina, in 't Hout and Roose (2000), SIAM Journal on Scientific Computing 22(5), 1593-1609, for the bordered
system and its phase condition, there with piecewise polynomials.
"""

from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.collocation import Collocation, collocation, refine
from revline.analysis.floquet import FloquetMultipliers, find_floquet_multipliers
from revline.analysis.forced_orbits import FIRST_HARMONICS
from revline.analysis.harmonic_balance import BalanceSettings, PeriodicOrbit
from revline.analysis.jacobians import evaluate
from revline.analysis.orbit_equations import LinearOrbits, Misses, OrbitEquations, Orbits, swing_scales
from revline.analysis.orbit_newton import ROUNDING
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.lti.batches import solve_each
from revline.system import DelaySystem, Floats
from revline.values import make_read_only

MOST_STEPS = 40
"""Newton steps after which a cycle counts as not found."""

SHORTEST_STEP = 2.0**-6
"""Smallest part of a Newton step that is tried."""

STEP_TOLERANCE = 1e-9
"""Largest last step of a cycle that is found; the error left is about its square."""

NO_SWING = 1e-9
"""A swing of all states below this part of their values is an equilibrium, not a cycle."""

TRIVIAL = 1e-3
"""How far the multiplier of a shift along the cycle, which is 1, may be off before the others are not trusted."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CycleGuess:
    """A rough cycle to start from.

    Attributes:
        period: in s.
        states: at equal distances over the period, the last sample one distance before its end, shape (N, n_states).

    Raises:
        InvalidInputError: the period is not above 0, or there are fewer than 8 samples, or some that are not finite.
    """

    period: float
    states: Floats

    def __post_init__(self) -> None:
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise out_of_range("period", self.period, "s", "values above 0", "give that of the oscillation that a simulation shows")
        if self.states.ndim != 2 or self.states.shape[0] < 8 or not np.all(np.isfinite(self.states)):
            message = f"a guess of shape {self.states.shape} is no cycle; give 8 finite samples of all states or more over one period"
            raise InvalidInputError(message)
        make_read_only(self)

    @staticmethod
    def from_run(times: Floats, states: Floats, period: float, samples: int = 65) -> "CycleGuess":
        """Take the last period of a simulation.

        Args:
            times: in s, shape (n,).
            states: shape (n, n_states).
            period: in s.
            samples: how many to take.

        Raises:
            InvalidInputError: the run is shorter than the period.
        """
        begin = float(times[-1]) - period
        if begin < float(times[0]):
            raise out_of_range("period", period, "s", f"up to {times[-1] - times[0]:g} s", "give a longer run")
        at = begin + period * np.arange(samples) / samples
        return CycleGuess(period=period, states=np.stack([np.interp(at, times, column) for column in states.T], axis=1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cycle:
    """A limit cycle, with how well it is known.

    Attributes:
        orbit: one period, the inputs constant.
        error: estimated relative error of the period and of the states' swing by the harmonics left out.
        last_step: size of Newton's last step, as a part of the states' swing.
    """

    orbit: PeriodicOrbit
    error: float
    last_step: float

    @property
    def period(self) -> float:
        """In s."""
        return float(2.0 * np.pi / self.orbit.omega)

    def as_guess(self, samples: int = 512) -> CycleGuess:
        """Give the cycle as a start for another computation."""
        mesh = collocation(self.orbit.harmonics)
        waves = mesh.waves(2.0 * np.pi * np.arange(samples) / samples)
        return CycleGuess(period=self.period, states=(waves @ mesh.coefficients(self.orbit.states)).real)

    def extremes(self, output: int) -> tuple[float, float]:
        """Lowest and highest value of an output over the cycle, between the samples too."""
        mesh = collocation(self.orbit.harmonics)
        dense = mesh.waves(2.0 * np.pi * np.arange(4096) / 4096) @ mesh.coefficients(self.orbit.outputs[:, [output]])
        return float(np.min(dense.real)), float(np.max(dense.real))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CycleStability:
    """Whether a limit cycle attracts what is near it.

    Attributes:
        multipliers: of deviations, that of a shift along the cycle left out.
        trivial_error: how far that one is from 1, as it should be: a check of the whole computation.
    """

    multipliers: FloquetMultipliers
    trivial_error: float

    @property
    def stable(self) -> bool:
        """Whether neighbouring motions come to it."""
        return self.multipliers.stable


def find_cycle(system: DelaySystem, inputs: Floats, guess: CycleGuess, *, settings: BalanceSettings | None = None) -> Cycle:
    """Find the limit cycle near a guess.

    Args:
        system: any system with delay channels, a closed loop for example.
        inputs: constant, shape (n_inputs,).
        guess: where to start.
        settings: tolerance and most harmonics.

    Returns:
        The cycle; its error is larger than the tolerance only where the most harmonics do not reach it.

    Raises:
        InvalidInputError: the guess does not fit the system.
        NotConvergedError: Newton's method fails from this guess, or comes to an equilibrium.
    """
    settings = settings or BalanceSettings()
    if guess.states.shape[1] != len(system.states):
        message = f"the guess has {guess.states.shape[1]} states where {system.name} has {len(system.states)}; give all of them"
        raise InvalidInputError(message)
    mesh = collocation(FIRST_HARMONICS)
    orbits = _begin(system, inputs, guess, mesh)
    before: Floats | None = None
    while True:
        orbits, last_step = _solve(OrbitEquations(system=system, mesh=mesh), orbits)
        measures = np.array([orbits.omega[0], *np.ptp(orbits.states[0], axis=0)])
        sizes = np.append(measures[:1], swing_scales(system, orbits.states[0]))
        tail = last_harmonics(mesh, orbits)
        change = np.inf if before is None else float(np.max(np.abs(measures - before) / sizes))
        error = tail if tail <= settings.tolerance or before is None else change
        if error <= settings.tolerance or 2 * mesh.harmonics > settings.most_harmonics:
            return Cycle(orbit=as_orbit(system, mesh, orbits), error=error, last_step=last_step)
        before, fine = measures, collocation(2 * mesh.harmonics)
        orbits = Orbits(
            omega=orbits.omega,
            inputs=np.tile(inputs, (1, fine.count, 1)),
            states=refine(orbits.states, mesh, fine),
            readings=refine(orbits.readings, mesh, fine),
        )
        mesh = fine


def judge_cycle(system: DelaySystem, cycle: Cycle, *, tolerance: float = 1e-6) -> CycleStability:
    """Find whether a limit cycle is stable, by the Floquet multipliers of its neighbourhood.

    Raises:
        NotConvergedError: the multipliers are not resolved, or that of a shift along the cycle is not 1.
    """
    found = find_floquet_multipliers(system, cycle.orbit, tolerance=tolerance, count=8)
    trivial = int(np.argmin(np.abs(found.values - 1.0)))
    off = float(np.abs(found.values[trivial] - 1.0))
    if off > TRIVIAL:
        message = (
            f"the stability of the cycle of {system.name} at {cycle.orbit.omega:g} rad/s is not resolved: a shift along it has multiplier "
            f"{found.values[trivial]:.6g} where 1 is due (limit {TRIVIAL:g}); allow more harmonics"
        )
        raise NotConvergedError(message, multiplier=off)
    return CycleStability(multipliers=replace(found, values=np.delete(found.values, trivial)), trivial_error=off)


def _begin(system: DelaySystem, inputs: Floats, guess: CycleGuess, mesh: Collocation) -> Orbits:
    count = guess.states.shape[0]
    at = mesh.phases / (2.0 * np.pi) * count
    around = np.concatenate((guess.states, guess.states[:1]))
    states = np.stack([np.interp(at, np.arange(count + 1), column) for column in around.T], axis=1)[None]
    orbits = Orbits(
        omega=np.array([2.0 * np.pi / guess.period]),
        inputs=np.tile(inputs, (1, mesh.count, 1)),
        states=states,
        readings=np.zeros((1, mesh.count, len(system.channels))),
    )
    return OrbitEquations(system=system, mesh=mesh).deliver(orbits)


@dataclass(frozen=True, slots=True)
class _Step:
    """A change of samples and frequency."""

    states: Floats
    readings: Floats
    turn: Floats

    def added_to(self, orbits: Orbits, part: float) -> Orbits:
        return replace(
            orbits,
            omega=orbits.omega + part * self.turn,
            states=orbits.states + part * self.states,
            readings=orbits.readings + part * self.readings,
        )

    def size(self, scales: Floats, omega: float) -> float:
        """Largest change of a state by its swing, or of the frequency by itself; infinite if it is no number."""
        size = max(float(np.max(np.abs(self.states[0]) / scales)), float(abs(self.turn[0])) / omega)
        return size if np.isfinite(size) else np.inf


@dataclass(frozen=True, slots=True)
class _Border:
    """The linearised equations with the frequency as an unknown and the phase as a condition."""

    matrix: Floats
    linear: LinearOrbits

    @staticmethod
    def form(equations: OrbitEquations, orbits: Orbits, condition: Floats) -> "_Border":
        linear = equations.linearise(orbits)
        size = linear.matrix.shape[-1]
        matrix = np.zeros((size + 1, size + 1))
        matrix[:size, :size] = linear.matrix[0]
        matrix[:size, size] = linear.by_omega[0].ravel()
        matrix[size, :size] = condition.ravel()
        return _Border(matrix, linear)

    def step(self, misses: Misses) -> _Step:
        right, excess = self.linear.right_side(misses)
        found = solve_each(self.matrix, np.append(-right.ravel(), 0.0))
        states, turn = found[:-1], found[-1:]
        given = self.linear.deliveries
        readings = (given.by_states[0] @ states).reshape(excess.shape) + given.by_omega * turn[0] - excess
        return _Step(states.reshape(right.shape), readings, turn)


def _solve(equations: OrbitEquations, orbits: Orbits) -> tuple[Orbits, float]:
    """Newton's method on the bordered system."""
    reference = (equations.mesh.derivative @ orbits.states)[0]
    orbits, misses = equations.settle(orbits)
    size = np.inf
    for _ in range(MOST_STEPS):
        scales = step_scales(equations, orbits)[0]
        if np.all(np.ptp(orbits.states[0], axis=0) <= NO_SWING * np.max(np.abs(orbits.states[0]), axis=0)):
            raise _at_rest(equations.system, orbits)
        border = _Border.form(equations, orbits, reference / scales**2)
        step = border.step(misses)
        size = step.size(scales, float(orbits.omega[0]))
        if size <= STEP_TOLERANCE:
            return equations.settle(step.added_to(orbits, 1.0))[0], size
        orbits, misses = _shorten(equations, border, orbits, step)
    raise _not_found(equations.system, orbits, size)


def _shorten(equations: OrbitEquations, border: _Border, orbits: Orbits, step: _Step) -> tuple[Orbits, Misses]:
    """Make so much of a step that the one that would follow is smaller."""
    scales, omega = step_scales(equations, orbits)[0], float(orbits.omega[0])
    size, part = step.size(scales, omega), 1.0
    while part >= SHORTEST_STEP:
        tried, misses = equations.settle(step.added_to(orbits, part))
        if tried.omega[0] > 0.0 and border.step(misses).size(scales, omega) <= (1.0 - 0.25 * part) * size:
            return tried, misses
        part *= 0.5
    raise _not_found(equations.system, orbits, size)


def step_scales(equations: OrbitEquations, orbits: Orbits) -> Floats:
    """How far each state swings, or so much of its value that a step of the tolerance is not lost in rounding, shape (n, n_states)."""
    least = ROUNDING / STEP_TOLERANCE * np.max(np.abs(orbits.states), axis=1)
    scales: Floats = np.maximum(equations.scales(orbits), least)
    return scales


def last_harmonics(mesh: Collocation, orbits: Orbits) -> float:
    """Largest of the last two harmonics of a state, by its largest; a state that rests has none."""
    sizes = np.abs(mesh.coefficients(orbits.states[0]))[1:]
    largest = np.max(sizes, axis=0)
    moving = largest > NO_SWING * np.max(largest)
    return float(np.max(sizes[-2:, moving] / largest[moving], initial=0.0))


def as_orbit(system: DelaySystem, mesh: Collocation, orbits: Orbits) -> PeriodicOrbit:
    """Give the first of some orbits with its outputs."""
    outputs = evaluate(system, system.output, orbits.states, orbits.inputs, orbits.readings)[0]
    return PeriodicOrbit(
        omega=float(orbits.omega[0]),
        phases=mesh.phases,
        inputs=orbits.inputs[0],
        states=orbits.states[0],
        readings=orbits.readings[0],
        outputs=outputs,
    )


def _at_rest(system: DelaySystem, orbits: Orbits) -> NotConvergedError:
    values = ", ".join(f"{v.name} = {x:g} {v.unit}" for v, x in zip(system.states, orbits.states[0, 0], strict=True))
    message = f"no limit cycle of {system.name} near the guess: it leads to the equilibrium at {values}; start from a larger oscillation"
    return NotConvergedError(message)


def _not_found(system: DelaySystem, orbits: Orbits, size: float) -> NotConvergedError:
    omega = float(orbits.omega[0])
    message = (
        f"no limit cycle of {system.name} found near {omega:g} rad/s: Newton's method does not get on, its step is still {size:.2g} of the "
        f"swing (limit {STEP_TOLERANCE:g}); start from a longer simulation"
    )
    return NotConvergedError(message, frequency=omega, step=size)
