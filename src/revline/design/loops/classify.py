"""Telling from a record how a closed loop ends, with the evidence: at rest, in a limit cycle, or out of bounds."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.loops.outcome import Diverged, LimitCycle, Settled
from revline.design.loops.time_series import Series, check_series, refine_extreme, upward_crossings
from revline.errors import InvalidInputError, NotSettledError

Floats = NDArray[np.float64]

MOST_CYCLES = 60
MOST_SWINGS = 4
HYSTERESIS = 0.05
SIGNIFICANCE = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Criteria:
    """When a record counts as settled, cycling or diverged.

    Attributes:
        rest: settled when the last part of the record stays within this fraction of the command of its mean.
        repeat: cycles are equal when lows and highs agree within this fraction of their distance, and periods within this fraction.
        bound: diverged beyond this multiple of the command from the target.
        tail: the last part: this share of the record.
        min_cycles: fewer cycles decide nothing.

    Raises:
        InvalidInputError: a criterion is outside its range.
    """

    rest: float = 1e-3
    repeat: float = 1e-3
    bound: float = 10.0
    tail: float = 1.0 / 3.0
    min_cycles: int = 5

    def __post_init__(self) -> None:
        limits = (
            ("rest", self.rest, 0.0, 0.5),
            ("repeat", self.repeat, 0.0, 0.1),
            ("bound", self.bound, 1.0, math.inf),
            ("tail", self.tail, 0.0, 1.0),
            ("min_cycles", self.min_cycles, 2, MOST_CYCLES + 1),
        )
        for name, value, low, high in limits:
            if not low < value < high:
                message = f"criterion {name} = {value:g} is not between {low:g} and {high:g}; the default is {getattr(Criteria(), name):g}"
                raise InvalidInputError(message, criterion=name)


class _Cycles(NamedTuple):
    """Lows, highs and periods of successive cycles, the error of reading an extreme, and the last crossing's time."""

    low: Floats
    high: Floats
    period: Floats
    error: float
    end: float

    @property
    def swing(self) -> Floats:
        return self.high - self.low


def classify_outcome(
    times: ArrayLike, values: ArrayLike, *, target: float, command: float, criteria: Criteria | None = None
) -> Settled | LimitCycle | Diverged:
    """Classify how a recorded output ends.

    It has diverged when it ever is further from the target than a multiple of the command, and settled when the last part of the record
    is at rest. Otherwise its last cycles are compared: from level crossing to level crossing, extremes and crossings read between the
    samples. Equal cycles make a limit cycle only when no trend remains in them beyond the accuracy of reading, or a trend that
    dies out: a slow decay, extrapolated, ends at rest and is therefore no limit cycle.

    Args:
        times: sample times [s].
        values: the output.
        target: value commanded.
        command: size of the command's step; the yardstick of all criteria.
        criteria: when it counts as what; the default suits simulated records without noise.

    Raises:
        InvalidInputError: the series or the command is unusable.
        NotSettledError: the record does not decide; the message says why and how long a record is needed.
    """
    limits = criteria or Criteria()
    if not (math.isfinite(target) and math.isfinite(command)) or command == 0.0:
        message = f"an outcome cannot be judged against target {target:g} and command {command:g}; give finite numbers, the command not 0"
        raise InvalidInputError(message, command=command)
    series = check_series(times, values)
    yardstick = abs(command)
    beyond = np.abs(series.values - target) > limits.bound * yardstick
    if beyond.any():
        k = int(np.argmax(beyond))
        return Diverged(time=float(series.times[k]), value=float(series.values[k]), bound=limits.bound * yardstick)
    tail = _tail(series, limits)
    value = float(np.mean(tail.values))
    residual = float(np.max(np.abs(tail.values - value)))
    if residual <= limits.rest * yardstick:
        return Settled(value=value, steady_error=target - value, residual=residual)
    return _judge_cycles(series, limits, limits.rest * yardstick)


def _tail(series: Series, limits: Criteria) -> Series:
    times = series.times
    k = int(np.searchsorted(times, times[-1] - limits.tail * (times[-1] - times[0])))
    k = min(k, times.size - 2)
    return Series(times[k:], series.values[k:])


def _judge_cycles(series: Series, limits: Criteria, rest: float) -> LimitCycle:
    cycles = _find_cycles(series, limits)
    for swings in range(1, MOST_SWINGS + 1):
        grouped = _group(cycles, swings)
        if grouped.period.size < limits.min_cycles:
            break
        if _spread(grouped) <= limits.repeat:
            if _remaining_change(grouped) <= limits.repeat:
                return _limit_cycle(grouped, swings)
            break
    raise _undecided(cycles, series, limits, rest)


def _find_cycles(series: Series, limits: Criteria) -> _Cycles:
    """Cut the record into cycles and keep those of its last part, at least the fewest that decide."""
    t, v = series
    tail = _tail(series, limits)
    level = float(tail.values.max() + tail.values.min()) / 2.0
    crossings = upward_crossings(series, level, HYSTERESIS * float(np.ptp(tail.values)))
    found = crossings.size - 1
    if found < limits.min_cycles:
        duration = t[-1] - t[0]
        needed = 3.0 * duration if found < 1 else (limits.min_cycles + 1.0) * float(np.max(np.diff(crossings))) / limits.tail
        message = (
            f"the record of {duration:g} s is neither at rest at its end nor holds {limits.min_cycles} cycles (it has {max(found, 0)}), "
            f"so it decides nothing; simulate about {max(needed, 1.5 * duration):.3g} s"
        )
        raise NotSettledError(message, duration=duration, cycles=max(found, 0), needed=max(needed, 1.5 * duration))
    in_tail = int(np.count_nonzero(crossings >= tail.times[0])) - 1
    edges = crossings[-(min(max(in_tail, limits.min_cycles), MOST_CYCLES) + 1) :]
    rows = np.searchsorted(t, edges)
    lows, highs, error = [], [], 0.0
    for first, last in pairwise(rows):
        low = refine_extreme(series, int(first + np.argmin(v[first:last])))
        high = refine_extreme(series, int(first + np.argmax(v[first:last])))
        lows.append(low.value)
        highs.append(high.value)
        error = max(error, low.error, high.error)
    return _Cycles(np.array(lows), np.array(highs), np.diff(edges), error, float(edges[-1]))


def _group(cycles: _Cycles, swings: int) -> _Cycles:
    """Take several successive cycles as one, so that subharmonic cycles are found too; the newest cycles are kept."""
    count = cycles.period.size // swings
    low, high, period = (row[row.size - count * swings :].reshape(count, swings) for row in cycles[:3])
    return cycles._replace(low=low.min(axis=1), high=high.max(axis=1), period=period.sum(axis=1))


def _spread(cycles: _Cycles) -> float:
    """Largest disagreement among the cycles: of extremes as a fraction of their distance, of periods as a fraction."""
    swing = float(np.mean(cycles.swing))
    return float(max(np.ptp(cycles.low) / swing, np.ptp(cycles.high) / swing, np.ptp(cycles.period) / np.mean(cycles.period)))


def _remaining_change(cycles: _Cycles) -> float:
    """Extrapolate how much lows and highs will still change, as a fraction of their distance; 0 where no trend is to be seen."""
    swing = float(np.mean(cycles.swing))
    return max(_extrapolate(row, cycles.error) for row in (cycles.low, cycles.high)) / swing


def _extrapolate(row: Floats, error: float) -> float:
    """Extrapolate a sequence's remaining change to infinity, as a geometric series through the means of its thirds."""
    index = np.arange(row.size) - (row.size - 1) / 2.0
    slope = float(index @ row / (index @ index))
    scatter = row - np.mean(row) - slope * index
    uncertain = math.sqrt(float(scatter @ scatter) / max(row.size - 2, 1) / float(index @ index))
    noise = max(2.0 * error, 1e-12 * float(np.max(np.abs(row))))
    if abs(slope) * (row.size - 1) <= noise or abs(slope) <= SIGNIFICANCE * uncertain:
        return 0.0
    size = row.size // 3
    first, middle, last = (float(np.mean(row[a : a + size])) for a in (row.size - 3 * size, row.size - 2 * size, row.size - size))
    earlier, later = middle - first, last - middle
    if abs(later) <= noise:
        return 0.0
    ratio = later / earlier if earlier != 0.0 else math.inf
    return abs(later) * ratio / (1.0 - ratio) if 0.0 <= ratio < 1.0 else math.inf


def _limit_cycle(cycles: _Cycles, swings: int) -> LimitCycle:
    return LimitCycle(
        low=float(np.mean(cycles.low)),
        high=float(np.mean(cycles.high)),
        period=float(np.mean(cycles.period)),
        low_spread=float(np.ptp(cycles.low)),
        high_spread=float(np.ptp(cycles.high)),
        period_spread=float(np.ptp(cycles.period)),
        cycles=cycles.period.size,
        swings=swings,
        drift=_growth(cycles),
    )


def _growth(cycles: _Cycles) -> float:
    """Growth of the swing per cycle, as a fraction: the slope of its logarithm."""
    return float(np.polyfit(np.arange(cycles.swing.size), np.log(cycles.swing), 1)[0])


def _undecided(cycles: _Cycles, series: Series, limits: Criteria, rest: float) -> NotSettledError:
    """Say what keeps the record from deciding: the oscillation decays, grows, or does not repeat."""
    growth, period, swing = _growth(cycles), float(np.mean(cycles.period)), float(cycles.swing[-1])
    duration = float(series.times[-1] - series.times[0])
    numbers = {"growth_per_cycle": growth, "period": period, "swing": swing}
    change = np.diff(cycles.swing)
    if not (np.all(change < 0.0) or np.all(change > 0.0)):
        message = (
            f"the output oscillates ({swing:.6g} from low to high, about {period:.4g} s) but its last {cycles.period.size} cycles do not "
            f"repeat within the criterion; simulate longer than {duration:g} s, with output samples no coarser than {period / 50.0:.2g} s"
        )
        return NotSettledError(message, **numbers)
    remaining = _extrapolate(cycles.swing, cycles.error)
    if remaining < 0.5 * swing:
        limit = swing + math.copysign(remaining, growth)
        message = (
            f"the oscillation of {period:.4g} s is {swing:.6g} from low to high and tends to {limit:.4g}: "
            f"a limit cycle that is not reached yet; simulate longer than {duration:g} s"
        )
        return NotSettledError(message, limit=limit, **numbers)
    if growth > 0.0:
        message = (
            f"the oscillation of {period:.4g} s still grows by {growth:.3g} of itself per cycle and is {swing:.6g} from low to high: "
            f"whether it ends in a limit cycle or diverges is not decided; simulate longer than {duration:g} s"
        )
        return NotSettledError(message, **numbers)
    at_rest = cycles.end - float(series.times[0]) + math.log(max(swing / (2.0 * rest), 1.0)) / -growth * period
    needed = 1.02 * at_rest / (1.0 - limits.tail)
    message = (
        f"the oscillation of {period:.4g} s decays by {-growth:.3g} of itself per cycle and is still {swing:.6g} from low to high: "
        f"no limit cycle, but not at rest; at this rate it comes to rest about {at_rest:.4g} s after the record's start; "
        f"simulate about {needed:.4g} s"
    )
    return NotSettledError(message, needed=needed, **numbers)
