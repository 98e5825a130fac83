"""The ultimate point of a plant: the proportional gain at which its loop oscillates for ever, and the period, by whatever way it was found.

Source: Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import OpenLoop
from revline.errors import AnalysisError, out_of_range
from revline.units import RadiansPerSecond, Seconds

Complexes = NDArray[np.complex128]
Transfer = Callable[[ArrayLike], Complexes]
LoopAt = Callable[[float], OpenLoop]

FACTORS = (1.0, 1e3)
"""Of the gain that a search begins from: crossings of a loop that has fallen below 1/1000 are not looked for."""

LOWEST = 1e-3
"""Lowest frequency looked at, in rad/s, or that at which a delay has turned the phase by `TURN` rad where that is lower."""

TURN = 0.1


class UltimateSource(Enum):
    """How an ultimate point was found."""

    EXACT = "exact"
    """Phase crossover of the exact linear model."""
    RELAY = "relay"
    """A relay experiment."""
    BISECTION = "bisection"
    """The gain at which the plant itself begins to hunt."""
    GIVEN = "given"
    """Stated by whoever asks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UltimatePoint:
    """The proportional gain at which a loop oscillates for ever, and the period.

    Attributes:
        gain: in the control's unit per the measurement's.
        period: in s.
        source: how it was found.

    Raises:
        InvalidInputError: gain or period is not positive.
    """

    gain: float
    period: Seconds
    source: UltimateSource

    def __post_init__(self) -> None:
        for name, value, unit in (("ultimate gain", self.gain, ""), ("ultimate period", self.period, "s")):
            if not (math.isfinite(value) and value > 0.0):
                raise out_of_range(name, value, unit, "the positive numbers", "turn the sign of the plant round, or measure it anew")

    @property
    def frequency(self) -> RadiansPerSecond:
        """Frequency of the oscillation."""
        return 2.0 * math.pi / self.period


def find_ultimate_point(loop_at: LoopAt, *, begin: float = 1.0) -> UltimatePoint:
    """Find the ultimate point of a plant from its exact linear model: the least gain at which a stable loop ceases to be so.

    Args:
        loop_at: gives the loop of the plant under a proportional gain, from `open_loop_of_system` or `open_loop_of_model`.
        begin: gain at which crossings are looked for first; where its loop has none that count, at larger ones.

    Raises:
        AnalysisError: no gain makes the loop oscillate: its phase never reaches -180 degrees, none stabilises an unstable plant, or all
            above a least one do.
    """
    name, crossings = loop_at(begin).name, list[tuple[float, float]]()
    for gain in (begin * factor for factor in FACTORS):
        loop = loop_at(gain)
        low = min(LOWEST, TURN / loop.delay) if loop.delay > 0.0 else LOWEST
        crossings = sorted((gain * c.gain_margin, c.frequency) for c in find_margins(loop, low=low).phase_crossovers)
        for k in range(len(crossings)):
            if _ends_stability(loop_at, [edge for edge, _ in crossings], k):
                return UltimatePoint(gain=crossings[k][0], period=2.0 * math.pi / crossings[k][1], source=UltimateSource.EXACT)
        if crossings and not loop_at(2.0 * crossings[-1][0]).stable:
            break
    if not crossings:
        message = f"the loop {name} has no ultimate gain: its phase never reaches -180 degrees; a plant with a delay has one"
        raise AnalysisError(message)
    message = (
        f"the loop {name} has no ultimate gain: there is none up to which it is stable; stabilise an unstable plant by other gains, "
        "or turn the sign of its input round"
    )
    raise AnalysisError(message)


def _ends_stability(loop_at: LoopAt, edges: Sequence[float], k: int) -> bool:
    """Whether the loop is stable just below one of the rising gains at which it has roots on the axis, and is not above."""
    below = math.sqrt(edges[k - 1] * edges[k]) if k else 0.5 * edges[0]
    above = math.sqrt(edges[k] * edges[k + 1]) if k + 1 < len(edges) else 2.0 * edges[k]
    return loop_at(below).stable and not loop_at(above).stable
