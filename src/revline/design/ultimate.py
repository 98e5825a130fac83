"""The ultimate point of a plant: the proportional gain at which its loop oscillates for ever, and the period, by whatever way it was found.

Source: Ziegler and Nichols (1942), Transactions of the ASME 64, 759-768.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.margins import find_margins
from revline.design.open_loop import OpenLoop
from revline.errors import AnalysisError, InvalidInputError, out_of_range
from revline.units import RadiansPerSecond, Seconds

Complexes = NDArray[np.complex128]
Transfer = Callable[[ArrayLike], Complexes]


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


def find_ultimate_point(loop: OpenLoop) -> UltimatePoint:
    """Find the ultimate point of a plant from its exact linear model: the least gain at which a stable loop ceases to be so.

    Args:
        loop: of the plant under a proportional gain of 1, from `open_loop_of_system` or `open_loop_of_model`.

    Raises:
        InvalidInputError: the loop is unstable at a gain of 1 and has no smaller gain that is its limit.
        AnalysisError: no gain makes it oscillate: its phase never reaches -180 degrees.
    """
    crossings = find_margins(loop).phase_crossovers
    if not crossings:
        message = f"the loop {loop.name} has no ultimate gain: its phase never reaches -180 degrees; a plant with a delay has one"
        raise AnalysisError(message)
    limits = [c for c in crossings if c.gain_margin > 1.0] if loop.stable else list(crossings)
    if not limits:
        message = f"the loop {loop.name} is stable at a gain of 1 and at all above it; its least gain is no ultimate gain"
        raise InvalidInputError(message)
    first = min(limits, key=lambda c: c.gain_margin)
    return UltimatePoint(gain=first.gain_margin, period=2.0 * math.pi / first.frequency, source=UltimateSource.EXACT)
