"""Parts of a linear delay system that feed back on themselves, and how many characteristic roots each has right of a line."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matrix_balance
from scipy.sparse.csgraph import connected_components

from revline.errors import AnalysisError, NotConvergedError
from revline.lti.response import Complexes, Floats
from revline.lti.state_space import DelayStateSpace

MOST_SAMPLES = 200_000
LARGEST_TURN = 0.7
"""Phase may turn by this much between neighbours, in rad; more is halved."""

HALVINGS = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FeedbackBlock:
    """States and channels that all feed back on one another, scaled to even entries.

    Attributes:
        A, B, C, D: rates from states and readings, and what enters the channels from both.
        lags: of its channels, in s.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    lags: Floats

    @property
    def states(self) -> int:
        """How many states take part."""
        return len(self.A)

    def characteristic(self, s: Complexes) -> tuple[Complexes, Complexes]:
        """Give characteristic matrices and their derivatives; rows of channels are divided by decays above 1, so that none overflows.

        Args:
            s: complex numbers, in rad/s, of shape (k,).

        Returns:
            Two arrays of k square matrices over states and channel readings.
        """
        n, m = self.states, self.lags.size
        scale = np.minimum(s.real, 0.0)[:, None] * self.lags
        entering = np.exp(scale - s[:, None] * self.lags)[..., None] * np.hstack((self.C, self.D))
        matrix, slope = np.zeros((2, s.size, n + m, n + m), dtype=complex)
        matrix[:, :n, :n] = s[:, None, None] * np.eye(n) - self.A
        matrix[:, :n, n:] = -self.B
        matrix[:, n:] = -entering
        matrix[:, n:, n:] += np.exp(scale)[..., None] * np.eye(m)
        slope[:, :n, :n] = np.eye(n)
        slope[:, n:] = self.lags[:, None] * entering
        return matrix, slope

    def sizes(self, s: Complexes) -> Floats:
        """Give the size of the terms that cancel in the characteristic matrix at a root, for relative residuals."""
        fixed = sum(float(np.linalg.norm(block)) for block in (self.A, self.B, self.C, self.D))
        return fixed + math.sqrt(self.states) * np.abs(s) + math.sqrt(self.lags.size)

    def radius(self, abscissa: float = 0.0) -> float:
        """Bound the magnitude of all roots right of a line: |s| <= rho(|A| + |B| (1 - |ED|)^-1 |EC|), E the decays on the line.

        Raises:
            AnalysisError: channels feed one another with a gain of 1 or more on the line, so that roots have no bound.
        """
        decay = np.exp(np.minimum(-abscissa * self.lags, 600.0))[:, None]
        loop = decay * np.abs(self.D)
        if loop.size and np.max(np.abs(np.linalg.eigvals(loop))) >= 1.0:
            message = (
                "delay channels feed one another in a loop with a gain of 1 or more and no state between; the roots to the right may be "
                "without number: put a lag or a gain below 1 into that loop"
            )
            raise AnalysisError(message)
        whole = np.abs(self.A) + np.abs(self.B) @ np.linalg.solve(np.eye(len(loop)) - loop, decay * np.abs(self.C))
        return float(np.max(np.abs(np.linalg.eigvals(whole)))) if self.states else 0.0

    def count_right_of(self, abscissa: float) -> int:
        """Count the roots right of a vertical line, by the turns of the characteristic function along it.

        Args:
            abscissa: where the line crosses the real axis, in rad/s; no root may lie on it.

        Returns:
            How many, each as often as it is multiple.

        Raises:
            AnalysisError: see `radius`.
            NotConvergedError: the phase along the line cannot be followed: a root lies on it, or lags are too long for the fastest state.

        Source:
            Argument principle, as in Nyquist (1932), Bell System Technical Journal 11(1), 126-147.
        """
        if not self.states:
            self.radius(abscissa)
            return 0
        top = 2.0 * self.radius(abscissa) + abs(abscissa) + 1e-300
        evenly = int(min(32.0 + top * float(np.sum(self.lags)), 2.0 * MOST_SAMPLES))
        heights = np.unique(np.concatenate((np.linspace(0.0, top, evenly), np.geomspace(1e-9 * top, top, 64))))
        phases = self._phases(abscissa, heights)
        for _ in range(HALVINGS):
            turns = _turns(phases)
            wide = np.flatnonzero(np.abs(turns) > LARGEST_TURN)
            if not wide.size:
                return round((self._arc(abscissa + 1j * top) - float(np.sum(turns))) / math.pi)
            if heights.size + wide.size > MOST_SAMPLES:
                break
            middle = 0.5 * (heights[wide] + heights[wide + 1])
            phases = np.insert(phases, wide + 1, self._phases(abscissa, middle))
            heights = np.insert(heights, wide + 1, middle)
        message = (
            f"the roots right of {abscissa:g} rad/s cannot be counted: one lies on that line, or the lags, up to "
            f"{np.max(self.lags, initial=0.0):g} s, are too long for states as fast as {top:g} rad/s"
        )
        raise NotConvergedError(message, abscissa=abscissa, radius=top)

    def _phases(self, abscissa: float, heights: Floats) -> Complexes:
        """Direction of det(sI - A - B (1 - ED)^-1 EC); the factor of the channels alone has no root right of the line."""
        matrix, _ = self.characteristic(np.array(abscissa + 1j * heights, dtype=complex))
        whole, loop = np.linalg.slogdet(matrix)[0], np.linalg.slogdet(matrix[:, self.states :, self.states :])[0]
        return whole * loop.conj()

    def _arc(self, end: complex) -> float:
        """Turn from the positive real axis to the line's end, so far out that each factor s - eigenvalue stays within 30 degrees of s."""
        matrix = self.characteristic(np.array([end]))[0][0]
        n = self.states
        inner = matrix[:n, :n] - matrix[:n, n:] @ np.linalg.solve(matrix[n:, n:], matrix[n:, :n])
        return n * float(np.angle(end)) + float(np.sum(np.angle(np.linalg.eigvals(inner / end))))


def _turns(phases: Complexes) -> Floats:
    turns: Floats = np.angle(phases[1:] * phases[:-1].conj())
    return np.where(np.abs(phases[1:]) * np.abs(phases[:-1]) > 0.5, turns, np.inf)


def feedback_blocks(system: DelayStateSpace) -> Iterator[FeedbackBlock]:
    """Split into parts that feed back on themselves; the characteristic equation is the product of theirs.

    Args:
        system: linear system with delay channels. What neither reads itself nor is read in a loop belongs to no part.

    Yields:
        Its parts.
    """
    n = len(system.states)
    whole = np.block([[system.A, system.Bz], [system.Cz, system.Dzz]])
    parts, labels = connected_components(whole != 0.0, directed=True, connection="strong")
    for part in range(parts):
        members = np.flatnonzero(labels == part)
        states, channels = members[members < n], members[members >= n]
        inner = whole[np.ix_(members, members)]
        if not states.size and not np.any(inner):
            continue
        with np.errstate(invalid="ignore"):  # scipy casts every scale to a position in a permutation that is not asked for
            even, _ = matrix_balance(inner, permute=False)
        k = states.size
        yield FeedbackBlock(A=even[:k, :k], B=even[:k, k:], C=even[k:, :k], D=even[k:, k:], lags=system.lags[channels - n])
