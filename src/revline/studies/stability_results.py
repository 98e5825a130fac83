"""Results of the study about stability with the delay exact: margins of each loop, and the gains that stabilise each plant."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.analysis.trim import Trim
from revline.design.regions.gain_region import Window
from revline.design.stability.margins import Margins
from revline.values import make_read_only

Floats = NDArray[np.float64]

AT_START = "engine-at-start"
"""The engine's exact linear model at the operating point, as a plant."""

AT_TARGET = "engine-at-target"
"""The engine's exact linear model at the steady state that the command leads to, as a plant."""


class MarginRow(NamedTuple):
    """Margins of one controller with one plant: a fitted model or the engine's exact linear model."""

    controller: str
    plant: str
    margins: Margins


class NoMargins(NamedTuple):
    """A loop whose margins could not be found, and why."""

    controller: str
    plant: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeakContour:
    """Gains at which the sensitivity peaks at a value, shape (n,); neighbours of one piece are joined."""

    peak: float
    kp: Floats
    ki: Floats
    piece: NDArray[np.int64]

    def __post_init__(self) -> None:
        make_read_only(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegionRow:
    """The gains kp and ki that stabilise one plant at one kd.

    Attributes:
        plant: a fitted model or the engine's exact linear model.
        kd: derivative gain, in deg s2/rad.
        window: gains that were looked at.
        bounded: whether all stabilising gains lie within it.
        intervals: of kp that stabilise without integral action.
        omega, kp, ki: the boundary by rising frequency, shape (n,); empty where no pair of roots reaches the axis within the window.
        run: to which unbroken run of the boundary each point belongs, shape (n,).
        contours: of the peak sensitivity, where they were asked for.
        inside: the controllers with this kd that stabilise the plant, by name.
        outside: those that do not.
    """

    plant: str
    kd: float
    window: Window
    bounded: bool
    intervals: tuple[tuple[float, float], ...]
    omega: Floats
    kp: Floats
    ki: Floats
    run: NDArray[np.int64]
    contours: tuple[PeakContour, ...]
    inside: tuple[str, ...]
    outside: tuple[str, ...]

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def is_empty(self) -> bool:
        """Whether no gains stabilise the plant, within the window."""
        return not self.omega.size and not self.intervals


class NoRegion(NamedTuple):
    """A plant whose stabilising gains could not be found at one kd, and why."""

    plant: str
    kd: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StabilityResult:
    """Margins and stabilising gains.

    Attributes:
        target: the steady state that the command leads to; nothing where the engine has none there.
        margins: of each controller with each plant.
        without_margins: loops that have none.
        regions: of each plant at the kd of each controller.
        without_region: plants that have none.
    """

    target: tuple[Trim, ...]
    margins: tuple[MarginRow, ...]
    without_margins: tuple[NoMargins, ...]
    regions: tuple[RegionRow, ...]
    without_region: tuple[NoRegion, ...]

    def margin(self, controller: str, plant: str) -> MarginRow | None:
        """The margins of a controller with a plant; nothing where there are none."""
        return next((row for row in self.margins if (row.controller, row.plant) == (controller, plant)), None)

    def of_kd(self, kd: float) -> tuple[RegionRow, ...]:
        """The regions of all plants at one kd."""
        return tuple(row for row in self.regions if row.kd == kd)
