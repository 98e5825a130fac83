"""How a closed loop ends: settled, in a limit cycle, diverged or stalled. One type each, each with its own numbers."""

from dataclasses import dataclass
from typing import ClassVar

from revline.units import Seconds


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Settled:
    """The output came to rest.

    Attributes:
        value: mean of the last part of the record.
        steady_error: target less that value.
        residual: largest distance from that value in the last part.
    """

    name: ClassVar[str] = "settled"

    value: float
    steady_error: float
    residual: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitCycle:
    """The output oscillates for ever, and neither grows nor decays.

    Attributes:
        low: lowest value of a cycle, mean over the cycles judged.
        high: highest value of a cycle, mean over the cycles judged.
        period: mean over the cycles judged.
        low_spread: largest less smallest low value among these.
        high_spread: largest less smallest high value among these.
        period_spread: longest less shortest period among these.
        cycles: how many were judged.
        swings: how many times the output passes its middle upwards within one period; 1 but for subharmonic cycles.
        drift: trend of high - low, as a fraction of it per cycle; it is within the accuracy of reading the samples or dies out.
    """

    name: ClassVar[str] = "limit-cycle"

    low: float
    high: float
    period: Seconds
    low_spread: float
    high_spread: float
    period_spread: Seconds
    cycles: int
    swings: int
    drift: float

    @property
    def amplitude(self) -> float:
        """Half of the distance from low to high."""
        return (self.high - self.low) / 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diverged:
    """The output left all bounds.

    Attributes:
        time: when it first passed the bound.
        value: the sample there.
        bound: distance from the target that counts as diverged.
    """

    name: ClassVar[str] = "diverged"

    time: Seconds
    value: float
    bound: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stalled:
    """A state left the range in which the model means anything; the simulation says so, a record alone cannot.

    Attributes:
        time: when it did.
        state: name of the state, for example "engine_speed".
        value: its value then.
        unit: the state's.
    """

    name: ClassVar[str] = "stalled"

    time: Seconds
    state: str
    value: float
    unit: str = ""

    def __str__(self) -> str:
        """Say when and at what."""
        return f"stalls after {self.time:.3g} s, at {self.state.replace('_', ' ')} {self.value:.4g} {self.unit}".rstrip()


Outcome = Settled | LimitCycle | Diverged | Stalled
