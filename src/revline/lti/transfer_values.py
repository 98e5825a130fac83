"""Values of a linear delay system's transfer functions at many numbers, by elimination in place of a matrix for each number."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from revline.lti.response import Complexes, Floats
from revline.lti.state_space import DelayStateSpace

MOST_STATES = 4
"""With more states a matrix for each number is solved as fast."""

LARGEST_FACTOR = 16.0
"""Elimination without exchange of rows may multiply a row by no more than this; else each number's matrix is solved with exchange."""

Column = list[Any]


class Sum(NamedTuple):
    """A number, and what is added for each channel: a weight times its decay exp(-s lag)."""

    constant: float
    late: tuple[tuple[int, float], ...]

    def at(self, decays: Sequence[Complexes]) -> Any:
        """Evaluate, to a plain number where no channel takes part."""
        total: Any = self.constant
        for channel, weight in self.late:
            total = total + weight * decays[channel]
        return total


@dataclass(frozen=True, slots=True, eq=False)
class TransferValues:
    """What a system's outputs answer to its one input: as `system.transfer`, in less time.

    Without a channel that feeds a channel at once, what is read is known by the states and the input, and a small dense system in the
    states is left. States and channels that the input does not move, or that no output feels, are left out.

    Attributes:
        system: with one input.
        lags: of the channels that take part, in s.
        rates, driven: of the states that take part, from these states and from the input; empty where elimination does not serve.
        outputs, direct: the outputs from the same.
    """

    system: DelayStateSpace
    lags: tuple[float, ...]
    rates: tuple[tuple[Sum, ...], ...]
    driven: tuple[Sum, ...]
    outputs: tuple[tuple[Sum, ...], ...]
    direct: tuple[Sum, ...]

    def __call__(self, s: ArrayLike) -> Complexes:
        """Evaluate, delays exact.

        Args:
            s: complex numbers of any shape, in rad/s.

        Returns:
            Array of one axis over the outputs, then those of `s`.

        Raises:
            AnalysisError: the system has a pole at one of the numbers.
        """
        points = np.asarray(s, dtype=complex)
        found = self._eliminated(points) if self.rates else None
        return np.asarray(np.moveaxis(self.system.transfer(points)[..., 0], -1, 0)) if found is None else found

    def _eliminated(self, points: Complexes) -> Complexes | None:
        """Values by elimination; none where that would lose digits."""
        values = np.empty((len(self.outputs), *points.shape), dtype=complex)
        with np.errstate(all="ignore"):
            decays = [np.exp(-lag * points) for lag in self.lags]
            rows: list[Column] = [[-entry.at(decays) for entry in row] for row in self.rates]
            for k, row in enumerate(rows):
                row[k] = row[k] + points
            states = _solve(rows, [entry.at(decays) for entry in self.driven])
            if states is None:
                return None
            for k, (gains, direct) in enumerate(zip(self.outputs, self.direct, strict=True)):
                values[k] = sum((gain.at(decays) * x for gain, x in zip(gains, states, strict=True) if gain != NONE), direct.at(decays))
        return values if np.all(np.isfinite(values)) else None


NONE = Sum(0.0, ())


def transfer_values(system: DelayStateSpace) -> TransferValues:
    """Prepare the evaluation of a system with one input.

    Args:
        system: whose first input counts.
    """
    n = len(system.states)
    whole = np.block([[system.A, system.Bz], [system.Cz, system.Dzz]]) != 0.0
    moved = np.concatenate((system.Bu[:, 0], system.Dzu[:, 0])) != 0.0
    felt = np.any(np.concatenate((system.Cy, system.Dyz), axis=1) != 0.0, axis=0)
    for _ in range(len(whole)):
        moved, felt = moved | (whole @ moved), felt | (felt @ whole)
    kept = np.flatnonzero(moved & felt)
    x, z = kept[kept < n], kept[kept >= n] - n
    if len(x) > MOST_STATES or np.any(system.Dzz[np.ix_(z, z)]):
        return TransferValues(system, (), (), (), (), ())
    rows = range(len(system.outputs))
    lags, entering = tuple(system.lags[z].tolist()), system.Dzu[z, 0]
    return TransferValues(
        system,
        lags,
        tuple(tuple(_sum(system.A[i, j], system.Bz[i, z], system.Cz[z, j]) for j in x) for i in x),
        tuple(_sum(system.Bu[i, 0], system.Bz[i, z], entering) for i in x),
        tuple(tuple(_sum(system.Cy[i, j], system.Dyz[i, z], system.Cz[z, j]) for j in x) for i in rows),
        tuple(_sum(system.Dyu[i, 0], system.Dyz[i, z], entering) for i in rows),
    )


def _sum(constant: float, leaving: Floats, entering: Floats) -> Sum:
    weights = enumerate((leaving * entering).tolist())
    return Sum(float(constant), tuple((k, weight) for k, weight in weights if weight != 0.0))


def _is_zero(entry: Any) -> bool:
    return isinstance(entry, float) and entry == 0.0


def _solve(rows: list[Column], right: Column) -> Column | None:
    """Solve a small dense system whose entries are numbers or arrays; none where a row would be multiplied by much."""
    size = len(rows)
    for k in range(size):
        for i in range(k + 1, size):
            if _is_zero(rows[i][k]):
                continue
            factor = rows[i][k] / rows[k][k]
            if not np.all(np.abs(factor) <= LARGEST_FACTOR):
                return None
            for j in range(k + 1, size):
                if not _is_zero(rows[k][j]):
                    rows[i][j] = rows[i][j] - factor * rows[k][j]
            right[i] = right[i] - factor * right[k]
    found: Column = [0.0] * size
    for k in reversed(range(size)):
        rest = right[k]
        for j in range(k + 1, size):
            if not _is_zero(rows[k][j]):
                rest = rest - rows[k][j] * found[j]
        found[k] = rest / rows[k][k]
    return found
