"""Results of the study about hunting: the limit cycles as orbits, and how hunting begins."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.loops.onset import RayPoint
from revline.values import make_read_only

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CycleRow:
    """The limit cycle that a controller ends in on the engine, computed as an orbit, beside its simulation.

    Attributes:
        controller: its name.
        low, high: of the speed, in rad/s.
        control_low, control_high: of the throttle, in deg.
        period: in s.
        error: estimated, of extremes and period, as a part of swing and period.
        stable: whether the orbit attracts what is near it.
        multiplier: magnitude of its largest Floquet multiplier, that of a shift in time left out.
        multiplier_error: estimated error of that.
        at_low, at_high: whether the throttle's limits are touched.
        gap: largest disagreement with the simulation, as a part of swing or period.
        tolerance: largest one that is accepted.
        speed, control: over one period at equal distances, shape (n,).
        simulated_speed, simulated_control: of the last period simulated, shape (m,).
    """

    controller: str
    low: float
    high: float
    control_low: float
    control_high: float
    period: float
    error: float
    stable: bool
    multiplier: float
    multiplier_error: float
    at_low: bool
    at_high: bool
    gap: float
    tolerance: float
    speed: Floats
    control: Floats
    simulated_speed: Floats
    simulated_control: Floats

    def __post_init__(self) -> None:
        make_read_only(self)


class NoCycle(NamedTuple):
    """A controller that hunts on the engine, whose limit cycle or onset could not be computed, and why."""

    controller: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OnsetRow:
    """How hunting begins as all gains of a controller rise together.

    Attributes:
        controller: its name.
        factor: of its gains at which hunting begins, exactly.
        frequency: of the oscillation there, in rad/s.
        kind: "soft" or "hard".
        lowest_factor: the lowest at which a cycle was found.
        throttle, speed: of the steady state where the command leads, in deg and rad/s.
        points: cycles beyond the onset, by rising amplitude.
    """

    controller: str
    factor: float
    frequency: float
    kind: str
    lowest_factor: float
    throttle: float
    speed: float
    points: tuple[RayPoint, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HuntingResult:
    """All limit cycles and onsets.

    Attributes:
        cycles: of the controllers that hunt.
        without_cycle: those that hunt and whose orbit was not found.
        onsets: of C1, where it hunts and the onset was found.
        without_onset: C1, where it hunts and the onset was not found.
    """

    cycles: tuple[CycleRow, ...]
    without_cycle: tuple[NoCycle, ...]
    onsets: tuple[OnsetRow, ...]
    without_onset: tuple[NoCycle, ...]

    def cycle(self, controller: str) -> CycleRow | None:
        """The limit cycle of a controller; nothing where there is none."""
        return next((row for row in self.cycles if row.controller == controller), None)
