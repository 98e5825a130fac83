"""The equations that a periodic orbit of a delay system fulfils at its collocation points, for many orbits at once.

Unknown are the samples of the states and of the channels' readings over one period of phase:

    omega dx/dphase = rate(x, u, zd)        zd_i(phase) = z_i(phase - omega lag_i)        z = emit(x, u, zd)

The right side of the second is read from the samples of z by trigonometric interpolation, so the delays, state-dependent ones too,
are exact to the order of the highest harmonic.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from revline.analysis.collocation import Collocation
from revline.analysis.jacobians import differentiate_by, evaluate
from revline.analysis.linearize import search_scale
from revline.lti.batches import invert_each, solve_each
from revline.system import DelaySystem, Floats

Positions = NDArray[np.int64] | NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orbits:
    """Samples of orbits over one period each.

    Attributes:
        omega: frequencies in rad/s, shape (n,).
        inputs: shape (n, N, n_inputs).
        states: shape (n, N, n_states).
        readings: of the channels, shape (n, N, n_channels).
    """

    omega: Floats
    inputs: Floats
    states: Floats
    readings: Floats

    def take(self, which: Positions) -> "Orbits":
        """Give some of the orbits: `which` is a mask or a list of positions."""
        return Orbits(omega=self.omega[which], inputs=self.inputs[which], states=self.states[which], readings=self.readings[which])

    def with_part(self, which: Positions, part: "Orbits") -> "Orbits":
        """Give the same orbits, those at some positions replaced."""
        states, readings = self.states.copy(), self.readings.copy()
        states[which], readings[which] = part.states, part.readings
        return replace(self, states=states, readings=readings)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Misses:
    """By how much orbits miss their equations.

    Attributes:
        states: omega dx/dphase - rate, shape (n, N, n_states).
        readings: zd - z(phase - omega lag), shape (n, N, n_channels).
        lags: of the channels, in s, shape (n, N, n_channels).
    """

    states: Floats
    readings: Floats
    lags: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitEquations:
    """A system's equations on a collocation."""

    system: DelaySystem
    mesh: Collocation

    @property
    def direct(self) -> bool:
        """Whether readings follow from states and inputs alone: no channel and no lag reads a channel."""
        structure = self.system.structure
        return not any(name.startswith("zd") for sources in (*structure.emit, *structure.lags) for name in sources)

    def misses(self, orbits: Orbits) -> Misses:
        """Evaluate the equations."""
        return self._misses(orbits, *self._delayed(orbits))

    def settle(self, orbits: Orbits) -> tuple[Orbits, Misses]:
        """Set readings that follow from states and inputs alone to what the channels deliver, and evaluate the equations."""
        lags, delayed = self._delayed(orbits)
        if self.direct:
            orbits = replace(orbits, readings=delayed)
        return orbits, self._misses(orbits, lags, delayed)

    def deliver(self, orbits: Orbits) -> Orbits:
        """Set the readings to what the channels deliver, in as many passes as channels may follow one another."""
        for _ in range(1 if self.direct else len(self.system.channels)):
            orbits = replace(orbits, readings=self._delayed(orbits)[1])
        return orbits

    def _misses(self, orbits: Orbits, lags: Floats, delayed: Floats) -> Misses:
        rates = evaluate(self.system, self.system.rate, orbits.states, orbits.inputs, orbits.readings)
        moved = (self.mesh.derivative @ orbits.states) * orbits.omega[:, None, None]
        return Misses(states=moved - rates, readings=orbits.readings - delayed, lags=lags)

    def linearise(self, orbits: Orbits) -> "LinearOrbits":
        """Differentiate the equations about orbits, exactly; readings are eliminated."""
        n, count, n_states = orbits.states.shape
        n_channels = orbits.readings.shape[2]
        points = (orbits.states, orbits.inputs, orbits.readings)
        rate_x, rate_z = differentiate_by(self.system, self.system.rate, ("x", "zd"), *points)
        given = self._deliveries(orbits)
        matrix = np.zeros((n, count, n_states, count, n_states))
        turn = orbits.omega[:, None, None] * self.mesh.derivative
        for k in range(n_states):
            matrix[:, :, k, :, k] = turn
        own = np.arange(count)
        matrix[:, own, :, own] -= np.moveaxis(rate_x, 1, 0)
        through = rate_z @ given.by_states.reshape(n, count, n_channels, count * n_states)
        matrix -= through.reshape(n, count, n_states, count, n_states)
        by_omega = self.mesh.derivative @ orbits.states - np.einsum("niab,nib->nia", rate_z, given.by_omega)
        return LinearOrbits(
            matrix=matrix.reshape(n, count * n_states, count * n_states), by_omega=by_omega, rate_z=rate_z, deliveries=given
        )

    def _deliveries(self, orbits: Orbits) -> "Deliveries":
        """Differentiate what the channels deliver."""
        n, count, n_states = orbits.states.shape
        n_channels = orbits.readings.shape[2]
        points = (orbits.states, orbits.inputs, orbits.readings)
        emit_x, emit_z = differentiate_by(self.system, self.system.emit, ("x", "zd"), *points)
        lags_x, lags_z = differentiate_by(self.system, self.system.lags, ("x", "zd"), *points)
        lags = evaluate(self.system, self.system.lags, *points)
        entering = evaluate(self.system, self.system.emit, *points)
        waves = self.mesh.waves(self.mesh.phases[:, None] - orbits.omega[:, None, None] * lags)
        reading = self.mesh.weights(waves)  # how each sample is read from all of z, shape (n, N, n_channels, N)
        slope = self.mesh.read_each(waves, self.mesh.derivative @ entering)
        late = (slope * orbits.omega[:, None, None])[..., None]
        own = np.arange(count)
        by_states = np.einsum("niaj,njab->niajb", reading, emit_x)
        by_states[:, own, :, own] -= np.moveaxis(late * lags_x, 1, 0)
        by_states = by_states.reshape(n, count * n_channels, count * n_states)
        if self.direct:
            return Deliveries(by_states=by_states, by_omega=-lags * slope, own=np.empty((n, 0, 0)))
        looped = np.einsum("niaj,njab->niajb", reading, emit_z)
        looped[:, own, :, own] -= np.moveaxis(late * lags_z, 1, 0)
        size = count * n_channels
        equations = np.eye(size) - looped.reshape(n, size, size)
        by_omega = solve_each(equations, (-lags * slope).reshape(n, size)).reshape(lags.shape)
        return Deliveries(by_states=solve_each(equations, by_states), by_omega=by_omega, own=equations)

    def scales(self, orbits: Orbits) -> Floats:
        """How far each state swings, by which its changes are judged, shape (n, n_states)."""
        return swing_scales(self.system, orbits.states)

    def inside(self, orbits: Orbits) -> NDArray[np.bool_]:
        """Whether all states of an orbit keep within their ranges, shape (n,)."""
        low, high = (np.array([getattr(variable, end) for variable in self.system.states]) for end in ("low", "high"))
        within: NDArray[np.bool_] = np.all((orbits.states >= low) & (orbits.states <= high), axis=(1, 2))
        return within

    def _delayed(self, orbits: Orbits) -> tuple[Floats, Floats]:
        """Lags, and what the channels deliver."""
        points = (orbits.states, orbits.inputs, orbits.readings)
        lags = evaluate(self.system, self.system.lags, *points)
        entering = evaluate(self.system, self.system.emit, *points)
        waves = self.mesh.waves(self.mesh.phases[:, None] - orbits.omega[:, None, None] * lags)
        return lags, self.mesh.read_each(waves, entering)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deliveries:
    """How the readings change.

    Attributes:
        by_states: with the samples of the states, shape (n, N n_channels, N n_states).
        by_omega: with the frequency, the states held, shape (n, N, n_channels).
        own: the readings' own equations where channels read channels, shape (n, N n_channels, N n_channels); else of no size.
    """

    by_states: Floats
    by_omega: Floats
    own: Floats

    def mend(self, misses: Floats) -> Floats:
        """Find by how much readings are too large, given by how much they miss their equations."""
        if not self.own.size:
            return misses
        mended: Floats = solve_each(self.own, misses.reshape(misses.shape[0], -1)).reshape(misses.shape)
        return mended

    def take(self, which: Positions) -> "Deliveries":
        """Give those of some orbits."""
        return Deliveries(by_states=self.by_states[which], by_omega=self.by_omega[which], own=self.own[which])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearOrbits:
    """The equations of the states alone, linearised about orbits.

    Attributes:
        matrix: by the samples of the states, shape (n, N n_states, N n_states).
        by_omega: by the frequency, shape (n, N, n_states).
        rate_z: derivative of the rates by the readings, shape (n, N, n_states, n_channels).
        deliveries: how the readings follow.
    """

    matrix: Floats
    by_omega: Floats
    rate_z: Floats
    deliveries: Deliveries

    def right_side(self, misses: Misses) -> tuple[Floats, Floats]:
        """What the states' equations miss once the readings are mended, and by how much those are too large."""
        excess = self.deliveries.mend(misses.readings)
        return misses.states + np.einsum("niab,nib->nia", self.rate_z, excess), excess

    def solver(self) -> "NewtonSolver":
        """Invert the matrices."""
        return NewtonSolver(inverse=invert_each(self.matrix), linear=self)

    def take(self, which: Positions) -> "LinearOrbits":
        """Give those of some orbits."""
        return LinearOrbits(
            matrix=self.matrix[which], by_omega=self.by_omega[which], rate_z=self.rate_z[which], deliveries=self.deliveries.take(which)
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NewtonSolver:
    """Solves the linearised equations at given frequencies.

    Attributes:
        inverse: of the matrices of the states' equations.
        linear: the linearised equations.
    """

    inverse: Floats
    linear: LinearOrbits

    def take(self, which: Positions) -> "NewtonSolver":
        """Give the solver of some of the orbits."""
        return NewtonSolver(inverse=self.inverse[which], linear=self.linear.take(which))

    def step(self, misses: Misses) -> tuple[Floats, Floats]:
        """Find the changes of states and readings that mend the misses, to first order."""
        right, excess = self.linear.right_side(misses)
        n = right.shape[0]
        states = -(self.inverse @ right.reshape(n, -1, 1))
        readings = (self.linear.deliveries.by_states @ states).reshape(excess.shape) - excess
        return states.reshape(right.shape), readings


def swing_scales(system: DelaySystem, states: Floats) -> Floats:
    """How far each state swings, by which its changes are judged; of one that rests, a billionth of its search range.

    Args:
        system: gives the ranges.
        states: samples, shape (..., N, n_states).
    """
    floor = 1e-9 * np.array([search_scale(variable) for variable in system.states])
    scales: Floats = np.maximum(np.ptp(states, axis=-2), floor)
    return scales
