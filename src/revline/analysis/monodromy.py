"""The operator that takes deviations from a periodic orbit of a delay system from one period to the next, on elements of any lengths.

What a deviation has become one period later depends on the state and on what the channels still carry. On polynomials collocated at
Radau points this is a matrix; its eigenvalues are the Floquet multipliers.

Source: Luzyanina and Engelborghs (2002), International Journal of Bifurcation and Chaos 12(12), 2977-2989.
"""

from dataclasses import dataclass

import numpy as np

from revline.analysis.jacobians import differentiate, evaluate
from revline.analysis.pieces import DEGREE, Pieces, basis, late_basis
from revline.errors import NotConvergedError
from revline.lti.response import Complexes
from revline.system import DelaySystem, Floats

MOST_COLUMNS = 5000
"""Values of the past, at most, in whose place an orbit's channels are held: the operator's matrix then takes 200 MB and minutes."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Linearised equations at the nodes, readings eliminated: what they would be with the lags held stands as s.

    dx/dt = rate_x x + rate_s s, z = emit_x x + emit_s s, s_i(t) = z_i(t - lag_i).
    """

    lags: Floats
    rate_x: Floats
    rate_s: Floats
    emit_x: Floats
    emit_s: Floats


def linearise_along(system: DelaySystem, points: tuple[Floats, Floats, Floats], drift: Floats) -> Blocks:
    """Linearise a system's equations along an orbit.

    Args:
        system: any system.
        points: states, inputs and channel readings at the nodes; nodes along the first axis.
        drift: rate of change of what each reading was when it entered its channel, shape (n_nodes, n_channels).
    """
    rate_x, _, rate_z = differentiate(system, system.rate, *points)
    emit_x, _, emit_z = differentiate(system, system.emit, *points)
    lags_x, _, lags_z = differentiate(system, system.lags, *points)
    lags = evaluate(system, system.lags, *points)
    share = np.linalg.inv(np.eye(lags.shape[1]) + drift[..., None] * lags_z)
    moved = share @ (drift[..., None] * lags_x)
    return Blocks(
        lags=lags,
        rate_x=rate_x - rate_z @ moved,
        rate_s=rate_z @ share,
        emit_x=emit_x - emit_z @ moved,
        emit_s=emit_z @ share,
    )


@dataclass(frozen=True, slots=True)
class Monodromy:
    """The operator of one orbit on one mesh.

    Nodes are numbered from the oldest one that a channel still reads: some before time 0, then those of the period.
    """

    pieces: Pieces
    period: float
    blocks: Blocks

    def multipliers(self) -> Complexes:
        """Eigenvalues of the operator, by falling magnitude."""
        values = np.linalg.eigvals(self._operator())
        return np.asarray(values[np.argsort(-np.abs(values))], dtype=complex)

    def _operator(self) -> Floats:
        """The matrix from (state at 0, channels' past) to the same a period later."""
        count, n_states, n_channels = *self.blocks.rate_x.shape[:2], self.blocks.lags.shape[1]
        ends, past = self._reach()
        old = past * DEGREE + 1
        if old * n_channels + n_states > MOST_COLUMNS:
            longest = float(np.max(self.blocks.lags))
            message = (
                f"the stability of an orbit of {self.period:.4g} s is not found: its channels hold {longest:.4g} s, which takes "
                f"{old * n_channels + n_states} values on its elements (limit {MOST_COLUMNS}); simulate it"
            )
            raise NotConvergedError(message, lag=longest, period=self.period)
        left, right = self._equations(ends, past)
        answer = np.linalg.solve(left, right)
        whole = np.concatenate((np.eye(right.shape[1])[n_states:], answer[count * n_states :]))  # channels at all nodes
        last = answer[(count - 1) * n_states : count * n_states]
        operator: Floats = np.concatenate((last, whole[-old * n_channels :] if n_channels else whole[:0]))
        return operator

    def _reach(self) -> tuple[Floats, int]:
        """Ends of all elements from the oldest that a channel reads, in parts of the period, and how many lie before time 0."""
        longest = float(np.max(self.blocks.lags, initial=0.0)) / self.period
        turns = int(np.ceil(longest))
        ends = np.concatenate((*(self.pieces.ends[:-1] + turn for turn in range(-turns, 1)), [1.0]))
        first = int(np.searchsorted(ends, -longest, side="right")) - 1 if turns else 0
        return ends[first:], turns * self.pieces.lengths.size - first

    def _equations(self, ends: Floats, past: int) -> tuple[Floats, Floats]:
        """Collocation equations: left of the unknowns (states, channels after time 0), right of (state at 0, channels before)."""
        blocks, (count, n_states), n_channels = self.blocks, self.blocks.rate_x.shape[:2], self.blocks.lags.shape[1]
        old, own = past * DEGREE + 1, np.arange(count)
        # The derivative of periodic functions, the column of the last node before time 0 apart: the state at time 0.
        slopes = self.pieces.derivative
        begin = np.zeros(count)
        begin[:DEGREE] = slopes[:DEGREE, -1] if self.pieces.lengths.size > 1 else 0.0
        slopes[:DEGREE, -1] -= begin[:DEGREE]
        states = np.zeros((count, n_states, count + 1, n_states))  # one column more: the state at time 0
        for k in range(n_states):
            states[:, k, 0, k], states[:, k, 1:, k] = begin, slopes
        states[own, :, own + 1, :] -= self.period * blocks.rate_x
        reading = self._readings(ends, past)
        by_channels = -self.period * np.einsum("jac,jcn->janc", blocks.rate_s, reading)
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

    def _readings(self, ends: Floats, past: int) -> Floats:
        """How each channel is read at each node from its values at all nodes; shape (nodes, channels, all nodes)."""
        elements = self.pieces.lengths.size
        where = self.pieces.inner_times[:, None] - self.blocks.lags / self.period
        element = np.clip(np.searchsorted(ends, where, side="right") - 1, 0, ends.size - 2)
        weights = basis((where - ends[element]) / np.diff(ends)[element])
        fresh = self.pieces.fresh[(element - past) % elements]
        weights = np.where(fresh[..., None], weights @ late_basis(), weights)
        reading = np.zeros((*where.shape, (ends.size - 1) * DEGREE + 1))
        np.put_along_axis(reading, element[..., None] * DEGREE + np.arange(DEGREE + 1), weights, axis=-1)
        return reading
