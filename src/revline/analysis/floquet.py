"""Stability of a periodic orbit of a delay system: Floquet multipliers of its monodromy operator, by collocation.

A small deviation from the orbit obeys the linearised equations, periodic in time. What it has become one period later depends on the
state and on what the channels still carry: the operator that takes these from one period to the next is discretised by polynomials on
equal elements, collocated at Radau points, and its eigenvalues are the multipliers. Delayed readings that depend on the state move
with it: d zd = dz(t - lag) - z'(t - lag) d lag.

Source: Luzyanina and Engelborghs (2002), International Journal of Bifurcation and Chaos 12(12), 2977-2989, for collocation of the
monodromy operator with state-dependent delays.
"""

import functools
from dataclasses import dataclass

import numpy as np
from scipy.special import roots_jacobi

from revline.analysis.collocation import collocation
from revline.analysis.harmonic_balance import PeriodicOrbit
from revline.analysis.jacobians import differentiate, evaluate
from revline.errors import NotConvergedError, out_of_range
from revline.lti.response import Complexes
from revline.system import DelaySystem, Floats
from revline.values import make_read_only

DEGREE = 5
"""Degree of the polynomials on each element."""

FIRST_ELEMENTS = 8
"""Elements per period of the first try."""

MOST_ELEMENTS = 256
"""Elements per period at most."""

MOST_UNKNOWNS = 6000
"""Size of the largest linear system that is solved."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloquetMultipliers:
    """How small deviations from a periodic orbit change from one period to the next.

    Attributes:
        values: the largest multipliers, by falling magnitude; with magnitudes below 1 all deviations die out.
        error: estimated error of the first, absolute.
        elements: per period, of the finest mesh.
    """

    values: Complexes
    error: float
    elements: int

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def largest(self) -> float:
        """Magnitude of the largest multiplier: factor by which deviations shrink or grow per period in the long run."""
        return float(np.abs(self.values[0]))

    @property
    def stable(self) -> bool:
        """Whether small deviations from the orbit die out."""
        return self.largest < 1.0

    @property
    def certain(self) -> bool:
        """Whether the largest multiplier is further from 1 than its estimated error."""
        return abs(self.largest - 1.0) > self.error


def find_floquet_multipliers(system: DelaySystem, orbit: PeriodicOrbit, *, tolerance: float = 1e-6, count: int = 6) -> FloquetMultipliers:
    """Find the largest Floquet multipliers of a periodic orbit.

    The elements are doubled until the largest multiplier changes by less than the tolerance.

    Args:
        system: any system with delay channels.
        orbit: from `balance_harmonics`, for example.
        tolerance: largest estimated error of the largest multiplier, relative to 1 or to its magnitude if that is larger.
        count: how many to give at most.

    Raises:
        InvalidInputError: the tolerance or the count is out of range.
        NotConvergedError: more elements than can be used would be needed; the message has the last values.
    """
    if not 1e-12 <= tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "", "1e-12 to 1", "give a value such as 1e-6")
    if count < 1:
        raise out_of_range("count", count, "multipliers", "1 and above", "ask for at least one")
    before, change, elements = np.inf, np.inf, FIRST_ELEMENTS
    while elements <= MOST_ELEMENTS:
        problem = _Problem(system, orbit, elements)
        if problem.unknowns > MOST_UNKNOWNS:
            break
        values = problem.multipliers()
        largest = float(np.abs(values[0]))
        change = abs(largest - before)
        if change <= tolerance * max(1.0, largest):
            return FloquetMultipliers(values=values[:count], error=change, elements=elements)
        before, elements = largest, 2 * elements
    message = (
        f"the stability of the orbit of {system.name} at {orbit.omega:g} rad/s is not resolved with {elements // 2} elements per period: "
        f"the largest multiplier, {before:.6g}, still changes by {change:.2g} (limit {tolerance:g}); give a larger tolerance"
    )
    raise NotConvergedError(message, frequency=orbit.omega, multiplier=before, change=change)


@functools.cache
def _radau() -> tuple[Floats, Floats, Floats]:
    """Points of an element from 0 to 1, its left end and the Radau points; differentiation there; barycentric weights."""
    inner = 0.5 * (1.0 + roots_jacobi(DEGREE - 1, 1.0, 0.0)[0])
    points = np.concatenate(([0.0], inner, [1.0]))
    gaps = points[:, None] - points[None, :] + np.eye(points.size)
    weights = 1.0 / np.prod(gaps, axis=1)
    slopes = weights[None, :] / weights[:, None] / gaps
    np.fill_diagonal(slopes, 0.0)
    np.fill_diagonal(slopes, -np.sum(slopes, axis=1))
    for array in (points, slopes, weights):
        array.setflags(write=False)
    return points, slopes, weights


@dataclass(frozen=True, slots=True)
class _Problem:
    """The monodromy operator of one orbit on one mesh.

    Nodes are numbered from the oldest one that a channel still reads: `past` elements before time 0, then those of the period.
    """

    system: DelaySystem
    orbit: PeriodicOrbit
    elements: int

    @property
    def length(self) -> float:
        """Of an element, in s."""
        return 2.0 * np.pi / self.orbit.omega / self.elements

    @property
    def times(self) -> Floats:
        """Of the nodes after time 0, in s."""
        points = _radau()[0][1:]
        starts = np.arange(self.elements)[:, None]
        return np.asarray(((starts + points) * self.length).ravel())

    @property
    def unknowns(self) -> int:
        """Size of the linear system."""
        return self.elements * DEGREE * (len(self.system.states) + len(self.system.channels))

    def multipliers(self) -> Complexes:
        """Eigenvalues of the operator, by falling magnitude."""
        values = np.linalg.eigvals(self._operator())
        return np.asarray(values[np.argsort(-np.abs(values))], dtype=complex)

    def _operator(self) -> Floats:
        """The matrix from (state at 0, channels' past) to the same a period later."""
        blocks = _linearise(self.system, self.orbit, self.times)
        n_states, n_channels, count = len(self.system.states), len(self.system.channels), self.times.size
        past = int(np.ceil(np.max(blocks.lags, initial=0.0) / self.length)) if n_channels else 0
        old = past * DEGREE + 1
        left, right = self._equations(blocks, past)
        answer = np.linalg.solve(left, right)
        whole = np.concatenate((np.eye(right.shape[1])[n_states:], answer[count * n_states :]))  # channels at all nodes
        last = answer[(count - 1) * n_states : count * n_states]
        operator: Floats = np.concatenate((last, whole[-old * n_channels :] if n_channels else whole[:0]))
        return operator

    def _equations(self, blocks: "_Blocks", past: int) -> tuple[Floats, Floats]:
        """Collocation equations: left of the unknowns (states, channels after time 0), right of (state at 0, channels before)."""
        n_states, n_channels, count = len(self.system.states), len(self.system.channels), self.times.size
        old = past * DEGREE + 1
        slopes = _radau()[1][1:] / self.length
        states = np.zeros((count, n_states, count + 1, n_states))  # one column more: the state at time 0
        for element in range(self.elements):
            rows, columns = slice(element * DEGREE, (element + 1) * DEGREE), slice(element * DEGREE, (element + 1) * DEGREE + 1)
            for k in range(n_states):
                states[rows, k, columns, k] = slopes
        own = np.arange(count)
        states[own, :, own + 1, :] -= blocks.rate_x
        reading = self._readings(blocks.lags, past)
        by_channels = -np.einsum("jac,jcn->janc", blocks.rate_s, reading)
        channels = np.zeros((count, n_channels, count + 1, n_states))
        channels[own, :, own + 1, :] -= blocks.emit_x
        kept = -np.einsum("jac,jcn->janc", blocks.emit_s, reading)
        kept[own, :, old + own, :] += np.eye(n_channels)
        upper = (states[:, :, 1:].reshape(count * n_states, -1), by_channels[:, :, old:].reshape(count * n_states, -1))
        lower = (channels[:, :, 1:].reshape(count * n_channels, -1), kept[:, :, old:].reshape(count * n_channels, -1))
        left = np.block([[upper[0], upper[1]], [lower[0], lower[1]]])
        right = -np.block(
            [
                [states[:, :, 0].reshape(count * n_states, -1), by_channels[:, :, :old].reshape(count * n_states, -1)],
                [channels[:, :, 0].reshape(count * n_channels, -1), kept[:, :, :old].reshape(count * n_channels, -1)],
            ]
        )
        return left, right

    def _readings(self, lags: Floats, past: int) -> Floats:
        """How each channel is read at each node from its values at all nodes; shape (nodes, channels, all nodes)."""
        points, _, weights = _radau()
        count, n_channels = lags.shape
        where = (self.times[:, None] - lags) / self.length + past  # in elements from the oldest node on
        element = np.clip(np.floor(where).astype(int), 0, past + self.elements - 1)
        gaps = (where - element)[..., None] - points
        exact = np.abs(gaps) < 1e-14
        terms = weights / np.where(exact, 1.0, gaps)
        basis = np.where(np.any(exact, axis=-1, keepdims=True), exact, terms / np.sum(terms, axis=-1, keepdims=True))
        reading = np.zeros((count, n_channels, (past + self.elements) * DEGREE + 1))
        positions = element[..., None] * DEGREE + np.arange(DEGREE + 1)
        np.put_along_axis(reading, positions, basis, axis=-1)
        return reading


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Linearised equations at the nodes, readings eliminated: what they would be with the lags held stands as s.

    dx/dt = rate_x x + rate_s s, z = emit_x x + emit_s s, s_i(t) = z_i(t - lag_i).
    """

    lags: Floats
    rate_x: Floats
    rate_s: Floats
    emit_x: Floats
    emit_s: Floats


def _linearise(system: DelaySystem, orbit: PeriodicOrbit, times: Floats) -> _Blocks:
    mesh = collocation(orbit.harmonics)
    phases = orbit.omega * times
    waves = mesh.waves(phases)
    points = tuple((waves @ mesh.coefficients(samples)).real for samples in (orbit.states, orbit.inputs, orbit.readings))
    rate_x, _, rate_z = differentiate(system, system.rate, *points)
    emit_x, _, emit_z = differentiate(system, system.emit, *points)
    lags_x, _, lags_z = differentiate(system, system.lags, *points)
    lags = evaluate(system, system.lags, *points)
    entering = mesh.coefficients(evaluate(system, system.emit, orbit.states, orbit.inputs, orbit.readings))
    late = mesh.waves(phases[:, None] - orbit.omega * lags) * (1j * orbit.omega * np.arange(mesh.harmonics + 1))
    drift = np.einsum("jam,ma->ja", late, entering).real[..., None]  # z' at the delayed time
    share = np.linalg.inv(np.eye(lags.shape[1]) + drift * lags_z)
    moved = share @ (drift * lags_x)
    return _Blocks(
        lags=lags,
        rate_x=rate_x - rate_z @ moved,
        rate_s=rate_z @ share,
        emit_x=emit_x - emit_z @ moved,
        emit_s=emit_z @ share,
    )
