"""What a step response is judged by: overshoot, rise and settling time, steady error."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from revline.design.loops.time_series import MIN_SAMPLES, Series, check_series, crossing_time, first_reach, refine_extreme
from revline.errors import InvalidInputError, NotSettledError
from revline.units import Seconds

TAIL = 0.1
"""Share of the record whose mean is taken for the value reached."""

HOLD = 0.5
"""A response counts as settled when it stays so for this share of its settling time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepMeasures:
    """How a settled response followed a step of its command; times count from the step.

    Attributes:
        overshoot: how far the peak passes the target, as a fraction of the command; 0 where it does not pass it.
        settling_time: from then on the response stays within the band about the target.
        rise_time: from 10 % to 90 % of the command.
        peak_time: when the response is furthest in the command's direction.
        peak: the value there.
        steady_error: target less the mean of the record's last tenth.
        band: half width of the settling band, as a fraction of the command.
    """

    overshoot: float
    settling_time: Seconds
    rise_time: Seconds
    peak_time: Seconds
    peak: float
    steady_error: float
    band: float


def measure_overshoot(times: ArrayLike, values: ArrayLike, *, start: Seconds, target: float, command: float) -> float:
    """Measure how far a response passes its target, settled or not.

    Args:
        times: sample times [s].
        values: the response.
        start: time of the step [s].
        target: value commanded after the step.
        command: size of the step, with its sign: the target less the value before.

    Returns:
        A fraction of the command, 0 where the response does not pass the target.

    Raises:
        InvalidInputError: the series or the step is unusable.
    """
    progress = _progress(times, values, start, target, command)
    return max(0.0, refine_extreme(progress, int(np.argmax(progress.values))).value - 1.0)


def measure_step(times: ArrayLike, values: ArrayLike, *, start: Seconds, target: float, command: float, band: float = 0.02) -> StepMeasures:
    """Measure a response to a step of the command.

    Extremes are read between samples by polynomials, level crossings by a straight line.

    Args:
        times: sample times [s].
        values: the response.
        start: time of the step [s].
        target: value commanded after the step.
        command: size of the step, with its sign: the target less the value before.
        band: half width of the settling band, as a fraction of the command.

    Raises:
        InvalidInputError: the series, the step or the band is unusable.
        NotSettledError: the response leaves the band at the end of the record, or so late that the record cannot show that it
            settled; the message says how long a record is needed.
    """
    if not 0.0 < band < 1.0:
        message = f"settling band = {band:g} of the command is outside 0 to 1; 0.02 is usual"
        raise InvalidInputError(message, band=band)
    progress = _progress(times, values, start, target, command)
    settling_time = _find_settling_time(progress, band)
    extreme = refine_extreme(progress, int(np.argmax(progress.values)))
    tail = progress.times >= (1.0 - TAIL) * progress.times[-1]
    return StepMeasures(
        overshoot=max(0.0, extreme.value - 1.0),
        settling_time=settling_time,
        rise_time=first_reach(progress, 0.9) - first_reach(progress, 0.1),
        peak_time=extreme.time,
        peak=target + (extreme.value - 1.0) * command,
        steady_error=float(1.0 - np.mean(progress.values[tail])) * command,
        band=band,
    )


def _progress(times: ArrayLike, values: ArrayLike, start: float, target: float, command: float) -> Series:
    """Scale a response to go from 0 at time 0 to 1 at the target."""
    if not np.isfinite([start, target, command]).all() or command == 0.0:
        message = f"a step of {command:g} to {target:g} at {start:g} s cannot be measured; give finite numbers and a command that is not 0"
        raise InvalidInputError(message, command=command)
    series = check_series(times, values)
    after = series.times >= start
    if np.count_nonzero(after) < MIN_SAMPLES:
        message = (
            f"the record ends at {series.times[-1]:g} s, with {np.count_nonzero(after)} samples after the step at {start:g} s; give more"
        )
        raise InvalidInputError(message, start=start)
    return Series(series.times[after] - start, 1.0 + (series.values[after] - target) / command)


def _find_settling_time(progress: Series, band: float) -> float:
    t, y = progress
    outside = np.flatnonzero(np.abs(y - 1.0) > band)
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    if last == t.size - 1:
        message = (
            f"not settled: {t[-1]:g} s after the step the response is {abs(y[-1] - 1.0):.3g} of the command off its target, "
            f"outside the band of {band:g}; simulate longer, or classify the outcome if it may oscillate for ever"
        )
        raise NotSettledError(message, final_error=float(y[-1] - 1.0), overshoot=float(max(0.0, y.max() - 1.0)))
    settled = crossing_time(progress, last, 1.0 + np.copysign(band, y[last] - 1.0))
    needed = (1.0 + HOLD) * settled
    if t[-1] < needed:
        message = (
            f"not shown to be settled: the response entered the band of {band:g} for the last time {settled:g} s after the step "
            f"and the record ends at {t[-1]:g} s; simulate at least {needed:g} s after the step"
        )
        raise NotSettledError(message, last_entry=settled, needed=needed)
    return settled
