"""Newton's method on whole periodic orbits, many at once, from the linear answer on.

The Jacobian is exact; it is kept as long as each step is much smaller than the one before. A step is shortened until the one that
would follow it is smaller.

Source: Deuflhard (2011), Newton Methods for Nonlinear Problems, section 3.3 (the natural monotonicity test).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from revline.analysis.collocation import Collocation
from revline.analysis.orbit_equations import NewtonSolver, OrbitEquations, Orbits
from revline.analysis.trim import Trim
from revline.lti.batches import solve_each
from revline.lti.state_space import DelayStateSpace
from revline.system import Floats

MOST_STEPS = 60
"""Newton steps after which an orbit counts as not found."""

SHORTEST_STEP = 2.0**-8
"""Smallest part of a Newton step that is tried."""

QUICK = 0.2
"""While each step is below this part of the one before, the Jacobian is kept."""

ROUNDING = 1e-14
"""What rounding leaves of a step, as a part of a state's largest value."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """What drives orbits: the input at a position carries sinusoids about a trim.

    Attributes:
        trim: where.
        position: of the input.
        amplitude: of each sinusoid, in the input's unit, shape (n,).
        omega: frequencies in rad/s, shape (n,).
    """

    trim: Trim
    position: int
    amplitude: Floats
    omega: Floats

    def take(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> "Drive":
        """Give some of the sinusoids."""
        return replace(self, amplitude=self.amplitude[which], omega=self.omega[which])

    def inputs(self, mesh: Collocation, part: float | Floats = 1.0) -> Floats:
        """Samples of all inputs over a period, with a part of each amplitude; shape (n, N, n_inputs)."""
        values = np.tile(self.trim.inputs, (self.omega.size, mesh.count, 1))
        values[:, :, self.position] += (part * self.amplitude)[:, None] * np.sin(mesh.phases)
        return values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solved:
    """Orbits after Newton's method.

    Attributes:
        orbits: their samples; those that were not found are as they were left.
        found: which of them fulfil their equations, shape (n,).
        last_step: size of the last step, as a part of the states' swing, shape (n,).
        steps: how many were made, shape (n,).
    """

    orbits: Orbits
    found: NDArray[np.bool_]
    last_step: Floats
    steps: NDArray[np.int64]


def linear_orbits(drive: Drive, model: DelayStateSpace, mesh: Collocation) -> Orbits:
    """Give the linear model's answer as samples."""
    states, readings = linear_answers(model, drive.position, drive.omega)
    # The real part of -j a exp(j phase) is a sin(phase).
    wave = -1j * drive.amplitude[:, None, None] * np.exp(1j * mesh.phases)[None, :, None]
    return Orbits(
        omega=drive.omega,
        inputs=drive.inputs(mesh),
        states=drive.trim.states + (states[:, None, :] * wave).real,
        readings=drive.trim.channels + (readings[:, None, :] * wave).real,
    )


def linear_answers(model: DelayStateSpace, position: int, omega: Floats) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Find how states and channel readings answer an input: shapes (n, n_states) and (n, n_channels)."""
    n, n_states, n_channels = omega.size, model.A.shape[0], model.lags.size
    lagging = np.exp(-1j * omega[:, None] * model.lags)
    matrix = np.zeros((n, n_states + n_channels, n_states + n_channels), dtype=complex)
    matrix[:, :n_states, :n_states] = 1j * omega[:, None, None] * np.eye(n_states) - model.A
    matrix[:, :n_states, n_states:] = -model.Bz
    matrix[:, n_states:, :n_states] = -lagging[:, :, None] * model.Cz
    matrix[:, n_states:, n_states:] = np.eye(n_channels) - lagging[:, :, None] * model.Dzz
    right = np.empty((n, n_states + n_channels, 1), dtype=complex)
    right[:, :n_states, 0] = model.Bu[:, position]
    right[:, n_states:, 0] = lagging * model.Dzu[:, position]
    both = solve_each(matrix, right)[..., 0]
    return both[:, :n_states], both[:, n_states:]


def solve_orbits(equations: OrbitEquations, start: Orbits, *, tolerance: float) -> Solved:
    """Improve orbits until each fulfils its equations, or its steps lead nowhere.

    Args:
        equations: of the system, on the mesh of the orbits.
        start: approximate orbits.
        tolerance: largest last step of an orbit that is found, as a part of a state's swing.
    """
    n = start.omega.size
    orbits, found, last_step, steps = start, np.zeros(n, dtype=bool), np.full(n, np.inf), np.zeros(n, dtype=int)
    active = np.arange(n)
    solver: NewtonSolver | None = None
    change = Change.none(start)
    while active.size:
        part = orbits.take(active)
        if solver is None:
            solver = equations.linearise(part).solver()
            change = Change(*solver.step(equations.misses(part)))
        trial = _try_steps(equations, solver, part, change, tolerance)
        steps[active] += 1
        last_step[active], found[active] = trial.size, trial.done
        orbits = orbits.with_part(active[trial.usable], trial.orbits.take(trial.usable))
        stay = trial.usable & ~trial.done & (steps[active] < MOST_STEPS)
        active, change = active[stay], trial.following.take(stay)
        keep = bool(np.all(trial.ratio[stay] <= QUICK))
        solver = solver.take(stay) if keep else None
    return Solved(orbits=orbits, found=found, last_step=last_step, steps=steps)


def smallest_step(orbits: Orbits, scales: Floats, tolerance: float) -> Floats:
    """Step below which an orbit counts as found: the tolerance, or what rounding leaves; as a part of the states' scales, shape (n,)."""
    found: Floats = np.max(np.maximum(tolerance, ROUNDING * np.max(np.abs(orbits.states), axis=1) / scales), axis=1)
    return found


@dataclass(frozen=True, slots=True)
class Change:
    """A change of the samples of orbits: of states and of readings."""

    states: Floats
    readings: Floats

    @staticmethod
    def none(orbits: Orbits) -> "Change":
        """Change nothing."""
        return Change(np.zeros_like(orbits.states), np.zeros_like(orbits.readings))

    def size(self, scales: Floats) -> Floats:
        """Largest change of a state, as a part of its scale; of each orbit."""
        largest: Floats = np.max(np.abs(self.states) / scales[:, None, :], axis=(1, 2), initial=0.0)
        return largest

    def added_to(self, orbits: Orbits, part: Floats) -> Orbits:
        """Add a part of the change to each orbit."""
        share = part[:, None, None]
        return replace(orbits, states=orbits.states + share * self.states, readings=orbits.readings + share * self.readings)

    def take(self, which: NDArray[np.bool_]) -> "Change":
        """Give the changes of some orbits."""
        return Change(self.states[which], self.readings[which])


@dataclass(frozen=True, slots=True)
class _Trial:
    """Orbits after one step.

    Attributes:
        orbits: with the step that would follow added where they are done.
        following: that step.
        size: its size, as a part of the states' swing.
        ratio: of that to the size of the step made.
        usable: which orbits got on.
        done: which of them need no more.
    """

    orbits: Orbits
    following: Change
    size: Floats
    ratio: Floats
    usable: NDArray[np.bool_]
    done: NDArray[np.bool_]


def _try_steps(equations: OrbitEquations, solver: NewtonSolver, orbits: Orbits, change: Change, tolerance: float) -> _Trial:
    """Make a step of each orbit, shortened until the one that would follow is smaller."""
    scales = equations.scales(orbits)
    smallest = smallest_step(orbits, scales, tolerance)
    before = change.size(scales)
    part = np.ones(before.size)
    while True:
        tried, misses = equations.settle(change.added_to(orbits, part))
        following = Change(*solver.step(misses))
        size = following.size(scales)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(before > 0.0, size / before, np.where(size > 0.0, np.inf, 0.0))
        done = size <= smallest
        usable = done | (np.isfinite(ratio) & (ratio <= 1.0 - 0.25 * part))
        again = ~usable & (part > SHORTEST_STEP)
        if not np.any(again):
            break
        part = np.where(again, 0.5 * part, part)
    tried = following.added_to(tried, np.where(done, 1.0, 0.0))
    return _Trial(tried, following, size, np.where(part < 1.0, 1.0, ratio), usable, done)
