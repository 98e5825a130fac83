"""What a step of the load does to a closed loop that has followed its command."""

import math
from dataclasses import dataclass

import numpy as np

from revline.design.loops.loop_run import LoopRun
from revline.errors import InvalidInputError, out_of_range
from revline.units import Seconds

BAND = 0.02
"""Half width of the settling band, as a part of the command or of the droop, whichever is larger."""

ROOM = 0.9
"""A loop that is outside its band beyond this part of the time after the step has not settled within it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadStep:
    """A step of the load.

    Attributes:
        size: in the load's unit.
        at: when, in s from the command's step.

    Raises:
        InvalidInputError: the size is 0 or no finite number, or the time is not positive.
    """

    size: float
    at: Seconds

    def __post_init__(self) -> None:
        if not math.isfinite(self.size) or self.size == 0.0:
            message = f"step of the load = {self.size:g} moves nothing; give a finite size other than 0"
            raise InvalidInputError(message, size=self.size)
        if not (math.isfinite(self.at) and self.at > 0.0):
            raise out_of_range("time of the load's step", self.at, "s", "values above 0", "give a time after the command's step")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadResponse:
    """What a loop did after a step of its load, in the measurement's unit.

    Attributes:
        droop: largest distance from the target.
        settling_time: from the step to where it stays within the band, in s; infinite where the record does not show it.
        band: half width of the band.
        iae: integral of the absolute error, in the unit times s.
        error: target less the measurement at the end.
    """

    droop: float
    settling_time: Seconds
    band: float
    iae: float
    error: float


def measure_load_response(run: LoopRun, load: LoadStep) -> LoadResponse | None:
    """Measure what a loop did after a step of its load; nothing where it ended before.

    Args:
        run: with the load's step in it.
        load: the step.
    """
    after = run.times >= load.at
    if np.count_nonzero(after) < 2:
        return None
    times, error = run.times[after] - load.at, run.target - run.output[after]
    droop = float(np.max(np.abs(error)))
    band = BAND * max(abs(run.command), droop)
    outside = np.flatnonzero(np.abs(error) > band)
    settled = float(times[outside[-1]]) if outside.size else 0.0
    return LoadResponse(
        droop=droop,
        settling_time=settled if settled <= ROOM * times[-1] else math.inf,
        band=band,
        iae=float(np.trapezoid(np.abs(error), times)),
        error=float(error[-1]),
    )
