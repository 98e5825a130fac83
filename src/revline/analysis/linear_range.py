"""The range of amplitudes in which the linear model holds, frequency by frequency: the numeric answer to how far it may be trusted.

The linear model is the exact small-signal response, its delays kept; what it is compared with is the describing function of the nonlinear
system. The amplitude at which the error reaches its limit is a root, found between amplitudes of the grid by computing orbits there, each
started from the linear answer and, where that fails, followed from nothing.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.analysis.describing import DescribingFunctions, OrbitFamily, describe, linear_error, make_family
from revline.analysis.threads import Progress
from revline.analysis.trim import Trim
from revline.errors import out_of_range
from revline.system import DelaySystem, Floats

Mask = NDArray[np.bool_]
Positions = NDArray[np.int64] | Mask

ROOT_TOLERANCE = 1e-6
"""How near to its limit the error is at an amplitude that was found, as a part of the limit; or the width of the last interval."""

EDGE_TOLERANCE = 0.01
"""How narrowly the amplitude is found above which there is no orbit, as a part of it."""

MOST_TRIES = 60
"""Amplitudes tried per frequency; bisection alone needs fewer."""

GRID_PART = 0.5
"""What the grid counts for in the progress told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeLimits:
    """When the linear model counts as holding.

    Attributes:
        error: largest relative complex error of the response.
        distortion: largest distortion of the answer; without end where it does not matter.

    Raises:
        InvalidInputError: a limit is not positive.
    """

    error: float = 0.05
    distortion: float = math.inf

    def __post_init__(self) -> None:
        if not 1e-5 <= self.error < 1.0:
            raise out_of_range("limit of the linear model's error", self.error, "", "1e-5 to 1", "give a part such as 0.05")
        if not self.distortion >= 1e-5:
            raise out_of_range("limit of the distortion", self.distortion, "", "1e-5 and above", "give a part such as 0.05")

    def excess(self, error: Floats, distortion: Floats) -> Floats:
        """How far errors are above their limits, as a part of these; -1 at no error, 0 where the nearer limit is reached."""
        found: Floats = np.maximum(error / self.error, distortion / self.distortion) - 1.0
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldsUpTo:
    """The linear model holds up to an amplitude, at which a limit is reached.

    Attributes:
        omega: in rad/s.
        amplitude: in the input's unit.
        error: relative error of the linear model there.
        distortion: of the answer there.
        reached: which limit: "error" or "distortion".
        gain_error: estimated relative error of the nonlinear answer itself.
    """

    omega: float
    amplitude: float
    error: float
    distortion: float
    reached: str
    gain_error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldsThroughout:
    """The linear model holds up to the largest amplitude looked at.

    Attributes:
        omega: in rad/s.
        amplitude: the largest, in the input's unit.
        error: largest relative error of the linear model up to there, on the grid.
        distortion: the same of the distortion.
        to_input_limits: whether a larger amplitude would leave the input's limits; else it was not asked for.
    """

    omega: float
    amplitude: float
    error: float
    distortion: float
    to_input_limits: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldsUntilNoOrbit:
    """The linear model holds up to an amplitude above which no periodic answer was found.

    Attributes:
        omega: in rad/s.
        amplitude: the largest with an orbit that was found, in the input's unit; 0 where there is none.
        refused_at: the smallest that was tried without success.
        error: relative error of the linear model at the former.
        distortion: of the answer there.
        reason: why there is no orbit, in words.
    """

    omega: float
    amplitude: float
    refused_at: float
    error: float
    distortion: float
    reason: str


LinearRange = HoldsUpTo | HoldsThroughout | HoldsUntilNoOrbit


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearRanges:
    """How far the linear model may be trusted, frequency by frequency.

    Attributes:
        limits: when it counts as holding.
        grid: describing functions that the ranges were found from.
        ranges: one for each frequency of the grid.
        orbits: how many were computed beyond those of the grid.
    """

    limits: RangeLimits
    grid: DescribingFunctions
    ranges: tuple[LinearRange, ...]
    orbits: int

    @property
    def narrowest(self) -> LinearRange:
        """The range with the smallest amplitude."""
        return min(self.ranges, key=lambda entry: entry.amplitude)


def find_linear_ranges(
    system: DelaySystem,
    trim: Trim,
    names: tuple[str, str],
    frequencies: ArrayLike,
    amplitudes: ArrayLike | None = None,
    *,
    limits: RangeLimits | None = None,
    progress: Progress | None = None,
) -> LinearRanges:
    """Find up to which amplitude the exact small-signal model answers as the nonlinear system does, within stated errors.

    A crossing that lies, with another, between two amplitudes of the grid is not seen.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        names: of the input that is moved and the output that is watched.
        frequencies: in rad/s, above 0, strictly rising.
        amplitudes: of the grid, in the input's unit; without them 14, up to the largest that the input's limits allow.
        limits: of error and distortion.
        progress: told which part is done.

    Returns:
        A range for each frequency, with the grid.

    Raises:
        InvalidInputError: a frequency, an amplitude or a name cannot be used, or an amplitude leaves the input's limits.
        AnalysisError: the trim is unstable.
    """
    limits = limits or RangeLimits()
    family = make_family(system, trim, names, frequencies)
    grid = describe(family, amplitudes, None if progress is None else lambda part: progress(GRID_PART * part))
    search = _begin(family, grid, limits)
    orbits, whole = 0, max(1, int(np.count_nonzero(search.open)))
    for tried in range(MOST_TRIES):
        rows = np.flatnonzero(search.open)
        if not rows.size:
            break
        search.narrow(rows, np.full(rows.size, tried % 3 == 2) | search.refused[rows])
        orbits += rows.size
        if progress is not None:
            progress(1.0 - (1.0 - GRID_PART) * np.count_nonzero(search.open) / whole)
    ranges = tuple(search.outcome(row, grid) for row in range(grid.omega.size))
    return LinearRanges(limits=limits, grid=grid, ranges=ranges, orbits=orbits)


@dataclass(frozen=True, slots=True)
class _Ends:
    """One end of each interval of amplitudes; what is in the arrays changes as the intervals shrink.

    Attributes:
        amplitude: in the input's unit, shape (n_freq,), as all.
        excess: of the errors over their limits there.
        error: of the linear model.
        distortion: of the answer.
        gain_error: of the answer itself.
    """

    amplitude: Floats
    excess: Floats
    error: Floats
    distortion: Floats
    gain_error: Floats

    @staticmethod
    def at_rest(count: int) -> "_Ends":
        """A vanishing amplitude, where nothing is in error."""
        amplitude, error, distortion, gain_error = np.zeros((4, count))
        return _Ends(amplitude, np.full(count, -1.0), error, distortion, gain_error)

    def put(self, rows: Positions, values: "_Ends") -> None:
        """Move the ends at some frequencies."""
        for name in ("amplitude", "excess", "error", "distortion", "gain_error"):
            getattr(self, name)[rows] = getattr(values, name)

    def take(self, which: Positions) -> "_Ends":
        return _Ends(self.amplitude[which], self.excess[which], self.error[which], self.distortion[which], self.gain_error[which])


@dataclass(frozen=True, slots=True)
class _Search:
    """Intervals of amplitude, one for each frequency, with the limit kept at the lower end and not at the upper.

    Attributes:
        family: the orbits.
        limits: of error and distortion.
        low, high: the ends.
        weight: what the excess at the lower and the upper end counts for, shape (2, n_freq).
        refused: where there is no orbit at the upper end.
        open: which intervals are to be narrowed.
        crossed: where the lower end has become the amplitude at which a limit is reached.
        reasons: why there is no orbit at the upper end.
    """

    family: OrbitFamily
    limits: RangeLimits
    low: _Ends
    high: _Ends
    weight: Floats
    refused: Mask
    open: Mask
    crossed: Mask
    reasons: dict[int, str]

    def narrow(self, rows: NDArray[np.int64], halve: Mask) -> None:
        """Compute orbits inside some intervals, in the middle or where the errors, quadratic in the amplitude, should reach a limit."""
        low, high = self.low.take(rows), self.high.take(rows)
        below, above = low.excess * self.weight[0, rows], high.excess * self.weight[1, rows]
        square = low.amplitude**2 + (high.amplitude**2 - low.amplitude**2) * below / np.where(halve, 1.0, below - above)
        amplitude = np.where(halve, 0.5 * (low.amplitude + high.amplitude), np.sqrt(np.maximum(square, 0.0)))
        answers, known = self.family.find(rows, amplitude, None)
        ok = known.known
        here, gains = rows[ok], answers.values[ok]
        error, distortion = linear_error(self.family.small[here], gains), answers.distortion[ok]
        tried = _Ends(amplitude[ok], self.limits.excess(error, distortion), error, distortion, answers.error[ok])
        hit = np.abs(tried.excess) <= ROOT_TOLERANCE
        up = (tried.excess <= 0.0) | hit
        self.low.put(here[up], tried.take(up))
        self.high.put(here[~up], tried.take(~up))
        # The end that stays counts for half (the Illinois rule), so that both ends move.
        self.weight[:, here] = np.where(
            up, [np.ones_like(error), 0.5 * self.weight[1, here]], [0.5 * self.weight[0, here], np.ones_like(error)]
        )
        self.refused[here[~up]] = False
        for position, refusal in answers.refusals.items():
            row = int(rows[position])
            self.high.amplitude[row], self.refused[row], self.reasons[row] = amplitude[position], True, str(refusal)
        self.crossed[here[hit]] = True
        self._close(rows)

    def _close(self, rows: NDArray[np.int64]) -> None:
        """End the search where the interval is narrow enough."""
        width = self.high.amplitude[rows] - self.low.amplitude[rows]
        narrow = width <= np.where(self.refused[rows], EDGE_TOLERANCE, ROOT_TOLERANCE) * self.high.amplitude[rows]
        self.crossed[rows[narrow & ~self.refused[rows]]] = True
        self.open[rows[narrow | self.crossed[rows]]] = False

    def outcome(self, row: int, grid: DescribingFunctions) -> LinearRange:
        """Say how far the linear model holds at a frequency."""
        omega, amplitude = float(grid.omega[row]), float(self.low.amplitude[row])
        error, distortion = float(self.low.error[row]), float(self.low.distortion[row])
        given_up = self.open[row] and not self.refused[row]  # the limit is reached, somewhere above the lower end
        if self.crossed[row] or given_up:
            by_error = error / self.limits.error >= distortion / self.limits.distortion
            return HoldsUpTo(
                omega=omega,
                amplitude=amplitude,
                error=error,
                distortion=distortion,
                reached="error" if by_error else "distortion",
                gain_error=float(self.low.gain_error[row]),
            )
        if row in self.reasons:
            return HoldsUntilNoOrbit(
                omega=omega,
                amplitude=amplitude,
                refused_at=float(self.high.amplitude[row]),
                error=error,
                distortion=distortion,
                reason=self.reasons[row],
            )
        return HoldsThroughout(
            omega=omega,
            amplitude=amplitude,
            error=float(np.max(grid.linear_error[:, row])),
            distortion=float(np.max(grid.distortion[:, row])),
            to_input_limits=bool(amplitude == grid.largest),
        )


def _begin(family: OrbitFamily, grid: DescribingFunctions, limits: RangeLimits) -> _Search:
    """Enclose the first amplitude of the grid that does not keep the limits, frequency by frequency."""
    count = grid.omega.size
    refused, is_open = np.zeros((2, count), dtype=bool)
    search = _Search(
        family=family,
        limits=limits,
        low=_Ends.at_rest(count),
        high=_Ends.at_rest(count),
        weight=np.ones((2, count)),
        refused=refused,
        open=is_open,
        crossed=np.zeros(count, dtype=bool),
        reasons={},
    )
    excess = limits.excess(grid.linear_error, grid.distortion)
    beyond = ~grid.found | (excess > 0.0)
    first = np.where(np.any(beyond, axis=0), np.argmax(beyond, axis=0), grid.amplitudes.size)
    why = {(cell.amplitude, cell.omega): cell.reason for cell in grid.missing}
    for row, k in enumerate(first):
        for ends, at in ((search.low, k - 1), (search.high, k)):
            if 0 <= at < grid.amplitudes.size:
                cell = (grid.linear_error[at, row], grid.distortion[at, row], grid.error[at, row])
                ends.put(np.array([row]), _Ends(*(np.array([v]) for v in (grid.amplitudes[at], excess[at, row], *cell))))
        if k < grid.amplitudes.size:
            search.open[row], search.refused[row] = True, not grid.found[k, row]
            if search.refused[row]:
                search.reasons[row] = why[float(grid.amplitudes[k]), float(grid.omega[row])]
    return search
