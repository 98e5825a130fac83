"""Parts of a linear delay system that feed back on themselves, and how many characteristic roots each has right of a line."""

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
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
    """States and channels that all feed back on one another, scaled to even entries; or many such of one shape, along a first axis.

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
        return self.A.shape[-1]

    def rows(self, which: NDArray[np.intp]) -> "FeedbackBlock":
        """Choose some of many blocks, each as often as it is named."""
        return FeedbackBlock(A=self.A[which], B=self.B[which], C=self.C[which], D=self.D[which], lags=self.lags[which])

    def characteristic(self, s: Complexes) -> tuple[Complexes, Complexes]:
        """Give characteristic matrices and their derivatives; rows of channels are divided by decays above 1, so that none overflows.

        Args:
            s: complex numbers, in rad/s, of shape (k,); where there are many blocks, as many numbers.

        Returns:
            Two arrays of k square matrices over states and channel readings.
        """
        n, m = self.states, self.lags.shape[-1]
        scale = np.minimum(s.real, 0.0)[:, None] * self.lags
        entering = np.exp(scale - s[:, None] * self.lags)[..., None] * np.concatenate((self.C, self.D), axis=-1)
        matrix, slope = np.zeros((2, s.size, n + m, n + m), dtype=complex)
        matrix[:, :n, :n], matrix[:, :n, n:], matrix[:, n:] = -self.A, -self.B, -entering
        diagonal = np.arange(n + m)
        matrix[:, diagonal[:n], diagonal[:n]] += s[:, None]
        matrix[:, diagonal[n:], diagonal[n:]] += np.exp(scale)
        slope[:, diagonal[:n], diagonal[:n]] = 1.0
        slope[:, n:] = self.lags[..., None] * entering
        return matrix, slope

    def sizes(self, s: Complexes) -> Floats:
        """Give the size of the terms that cancel in the characteristic matrix at a root, for relative residuals."""
        fixed = sum(np.sqrt(np.sum(block * block, axis=(-2, -1))) for block in (self.A, self.B, self.C, self.D))
        return fixed + math.sqrt(self.states) * np.abs(s) + math.sqrt(self.lags.shape[-1])

    def radius(self, abscissa: float = 0.0) -> float:
        """Bound the magnitude of all roots right of a line as `radii` does."""
        return float(self.radii(np.array(abscissa)))

    def radii(self, abscissa: Floats) -> Floats:
        """Bound the magnitude of all roots right of a line: |s| <= rho(|A| + |B| (1 - |ED|)^-1 |EC|), E the decays on the line.

        Args:
            abscissa: where the line crosses the real axis, in rad/s; where there are many blocks, one for each.

        Raises:
            AnalysisError: channels feed one another with a gain of 1 or more on the line, so that roots have no bound, or the bound exceeds
                the range of numbers.
        """
        decay = np.exp(np.minimum(-abscissa[..., None] * self.lags, 600.0))[..., None]
        loop = decay * np.abs(self.D)
        if loop.size and np.any(self.D) and np.max(np.abs(np.linalg.eigvals(loop))) >= 1.0:
            message = (
                "delay channels feed one another in a loop with a gain of 1 or more and no state between; the roots to the right may be "
                "without number: put a lag or a gain below 1 into that loop"
            )
            raise AnalysisError(message)
        if not self.states:
            return np.zeros(self.A.shape[:-2])
        with np.errstate(over="ignore", invalid="ignore"):
            whole = np.abs(self.A) + np.abs(self.B) @ np.linalg.solve(np.eye(loop.shape[-1]) - loop, decay * np.abs(self.C))
        if not np.isfinite(whole).all():
            message = "states and delay channels feed one another with gains whose product exceeds the range of numbers; choose other units"
            raise AnalysisError(message)
        return np.asarray(np.max(np.abs(np.linalg.eigvals(whole)), axis=-1))

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
        (count,) = stack_blocks((self,)).count_right_of_each(np.array([abscissa]))
        if count < 0:
            top = _top(self.radius(abscissa), abscissa)
            message = (
                f"the roots right of {abscissa:g} rad/s cannot be counted: one lies on that line, or the lags, up to "
                f"{np.max(self.lags, initial=0.0):g} s, are too long for states as fast as {top:g} rad/s"
            )
            raise NotConvergedError(message, abscissa=abscissa, radius=top)
        return int(count)

    def count_right_of_each(self, abscissa: Floats) -> NDArray[np.int64]:
        """Count for many blocks that have states as `count_right_of` does for one.

        Args:
            abscissa: of the line of each block.

        Returns:
            One number for each block; -1 where the phase along the line cannot be followed.

        Raises:
            AnalysisError: see `radii`.
        """
        tops = _top(self.radii(abscissa), abscissa)
        evenly = np.minimum(32.0 + tops * np.sum(self.lags, axis=-1), 2.0 * MOST_SAMPLES).astype(int)
        counts, arcs = np.full(len(abscissa), -1), self._arcs(abscissa + 1j * tops)
        heights = [top * _heights(count) for top, count in zip(tops, evenly.tolist(), strict=True)]
        phases = self._phases(abscissa, np.arange(len(heights)), heights)
        pending = np.arange(len(heights))
        for _ in range(HALVINGS):
            wide = []
            for row in pending:
                turns = _turns(phases[row])
                wide.append(np.flatnonzero(np.abs(turns) > LARGEST_TURN))
                if not wide[-1].size:
                    counts[row] = round((arcs[row] - float(np.sum(turns))) / math.pi)
            again = [k for k, row in enumerate(pending) if 0 < wide[k].size <= MOST_SAMPLES - heights[row].size]
            if not again:
                break
            pending, wide = pending[again], [wide[k] for k in again]
            middles = [0.5 * (heights[row][at] + heights[row][at + 1]) for row, at in zip(pending, wide, strict=True)]
            for row, at, middle, phase in zip(pending, wide, middles, self._phases(abscissa, pending, middles), strict=True):
                heights[row], phases[row] = np.insert(heights[row], at + 1, middle), np.insert(phases[row], at + 1, phase)
        return counts

    def _phases(self, abscissa: Floats, which: NDArray[np.intp], heights: Sequence[Floats]) -> list[Complexes]:
        """Direction of det(sI - A - B (1 - ED)^-1 EC) on some blocks' lines; the factor of the channels has no root right of them."""
        owners = np.repeat(which, [entry.size for entry in heights])
        matrix, _ = self.rows(owners).characteristic(abscissa[owners] + 1j * np.concatenate(heights))
        whole, loop = np.linalg.slogdet(matrix)[0], np.linalg.slogdet(matrix[:, self.states :, self.states :])[0]
        return np.split(np.asarray(whole * loop.conj()), np.cumsum([entry.size for entry in heights])[:-1])

    def _arcs(self, ends: Complexes) -> Floats:
        """Turn from the positive real axis to each line's end, so far out that each factor s - eigenvalue stays within 30 degrees of s."""
        matrix, n = self.characteristic(ends)[0], self.states
        inner = matrix[:, :n, :n] - matrix[:, :n, n:] @ np.linalg.solve(matrix[:, n:, n:], matrix[:, n:, :n])
        return np.asarray(n * np.angle(ends) + np.sum(np.angle(np.linalg.eigvals(inner / ends[:, None, None])), axis=-1))


def _top(radius: Floats | float, abscissa: Floats | float) -> Any:
    """How far up a line can hold roots, in rad/s."""
    return 2.0 * radius + np.abs(abscissa) + 1e-300


def _heights(evenly: int) -> Floats:
    """Parts of the way up at which a line is looked at: evenly spaced, and dense near the real axis."""
    return np.unique(np.concatenate((np.linspace(0.0, 1.0, evenly), _near_the_axis())))


@functools.cache
def _near_the_axis() -> Floats:
    heights = np.geomspace(1e-9, 1.0, 64)
    heights.setflags(write=False)
    return heights


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
    for part in _strong_parts((whole != 0.0).tobytes(), len(whole)):
        members = np.array(part)
        states, channels = members[members < n], members[members >= n]
        inner = whole[np.ix_(members, members)]
        if not states.size and not np.any(inner):
            continue
        with np.errstate(invalid="ignore"):  # scipy casts every scale to a position in a permutation that is not asked for
            even, _ = matrix_balance(inner, permute=False)
        k = states.size
        yield FeedbackBlock(A=even[:k, :k], B=even[:k, k:], C=even[k:, :k], D=even[k:, k:], lags=system.lags[channels - n])


@functools.lru_cache(maxsize=64)
def _strong_parts(pattern: bytes, size: int) -> tuple[tuple[int, ...], ...]:
    """Find which states and channels reach one another, from what is not zero."""
    whole = np.frombuffer(pattern, dtype=bool).reshape(size, size)
    parts, labels = connected_components(whole, directed=True, connection="strong")
    return tuple(tuple(np.flatnonzero(labels == part).tolist()) for part in range(parts))


def stack_blocks(blocks: Sequence[FeedbackBlock]) -> FeedbackBlock:
    """Lay blocks of one shape along a first axis."""
    return FeedbackBlock(**{name: np.array([getattr(block, name) for block in blocks]) for name in ("A", "B", "C", "D", "lags")})
