"""What a sampled controller did at its samples, and what noise and jitter do to its loop."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from revline.design.loops.loop_run import Limits
from revline.design.loops.loop_simulation import LoopTrace
from revline.design.loops.sampled_loop import Disturbance
from revline.units import Seconds
from revline.values import make_read_only

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """What a sampled controller did at its samples, up to where the record ends; all in the controller's units.

    Attributes:
        times: of the samples, shape (k,), in s.
        measurement: with noise, before quantisation, shape (k,).
        command: shape (k,).
        control: the output, shape (k,).
        wanted: the output before all limits, shape (k,).
        terms: proportional, integral (after anti-windup) and derivative term, shape (k, 3).
        windup: how far the output wanted is beyond what its limits, that of its rate among them, allow, with its sign, shape (k,).
        gains: kp, ki and kd that a schedule gave, shape (k, 3); without rows where the gains are fixed.
        overruns: outputs that were not ready before the next sample.
    """

    times: Floats
    measurement: Floats
    command: Floats
    control: Floats
    wanted: Floats
    terms: Floats
    windup: Floats
    gains: Floats
    overruns: int

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def travel(self) -> float:
        """Sum of the output's movements, in its unit."""
        return float(np.sum(np.abs(np.diff(self.control))))

    def until(self, end: Seconds) -> "Samples":
        """Leave out what came after a time."""
        k = int(np.searchsorted(self.times, end + 1e-9, side="right"))
        names = ("times", "measurement", "command", "control", "wanted", "terms", "windup", "gains")
        return replace(self, **{name: getattr(self, name)[:k] for name in names})

    def saturated_share(self, limits: Limits) -> float:
        """Part of the samples at which the output is at a limit."""
        return float(np.mean((self.control <= limits.low) | (self.control >= limits.high)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DisturbedRun:
    """The same loop with noise and jitter, and what they do to it.

    Attributes:
        disturbance: what was asked for.
        trace: of the run.
        samples: of the run.
        deviation: of the output from that without noise and jitter, shape (n,).
        travel: sum of the output's movements at the samples, in its unit.
        quiet_travel: the same without noise and jitter.
    """

    disturbance: Disturbance
    trace: LoopTrace
    samples: Samples
    deviation: Floats
    travel: float
    quiet_travel: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def rms(self) -> float:
        """Root mean square of the output's deviation, in the measurement's unit."""
        return float(np.sqrt(np.mean(self.deviation**2)))

    @property
    def largest(self) -> float:
        """Largest deviation of the output."""
        return float(np.max(np.abs(self.deviation)))
