"""Mid-ranging: a fast input of little room and a slow one that takes over, designed with every delay exact.

Steps, each from the exact linear model about the trim:

1. Slow input alone: the PID gains of the least IAE after a step of the load at which Ms is the bound; the competitor (`one_input`).
2. Fast loop, the slow input held: the PI gains of the largest integral gain at which Ms is 1 + share (bound - 1).
3. Slow loop around the closed fast one: among PI gains of the fast demand, with parts of the derivative of step 1, those of the largest
   integral gain at which four loops keep the bound and the crossovers stay apart: broken at the fast input, at the slow one, at both
   together (the measurement), and what is left while the fast input stands at its limit.

With a tracking time of kp/ki the fast controller at its limit asks for limit + kp e, so that the slow controller is left with a PID
controller of the error: the fourth loop. Gains are followed from zero along rays of one integral time, which end where a loop comes near
to instability; `confirm_design` proves what was chosen by margins and roots. The largest integral gain of the slow loop is the least
integral of what the fast input is away from its set-point, after a step of the load.

Source: mid-ranging: Allison and Isaksson (1998), Journal of Process Control 8(5-6), 469-474; largest integral gain under Ms: Astrom,
Panagopoulos and Hagglund (1998), Automatica 34(5), 585-601.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from revline.analysis.linearize import Linearization, linearize
from revline.analysis.trim import Trim
from revline.design.two_inputs.one_input import (
    SPEED_BY_SPARK_AND_THROTTLE,
    OneInputGains,
    TwoInputSignals,
    largest_integral,
    tune_one_input,
)
from revline.design.two_inputs.torque_reserve import TorqueReserve, find_torque_reserve
from revline.design.two_inputs.two_input_loops import LoopGains, TwoInputPlant, peaks_of_rays
from revline.errors import AnalysisError, InvalidInputError, out_of_range
from revline.system import DelaySystem, Floats

RAYS, LEVELS, ZOOMS = 21, 30, 3
"""Integral times, gains along each, and how often the neighbourhood of the best is divided."""

SHARES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Derivative gains of the slow law per integral gain, as parts of the competitor's."""

SPREAD = 20.0
"""Integral times are tried from the competitor's over this to it times this."""

WEAKEST = 1e-3
"""The first gain of a ray, relative to the competitor's."""

BEYOND = 3
"""Zooming looks this many steps of the coarser grid beyond its best: other integral times may reach further."""

ALMOST_UNSTABLE = 4.0
"""A ray of gains from zero ends where a peak of the sensitivity passes this: beyond lie gains that only an unstable loop reaches.
Neighbours on a ray are so close that none is skipped: between peaks below it on both sides |L| changes by less than the way through -1."""

SAFE = 0.998
"""Part of the bound on Ms that candidates keep on their grid, so that the chosen one keeps it between its frequencies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MidRangingBounds:
    """What the design keeps.

    Attributes:
        ms: largest peak of the sensitivity of each loop.
        fast_share: part of ms - 1 that the fast loop takes while the slow input is held.
        separation: the slow loop's crossover is at most that of the fast loop over this.

    Raises:
        InvalidInputError: a bound is out of its range.
    """

    ms: float = 2.0
    fast_share: float = 0.5
    separation: float = 3.0

    def __post_init__(self) -> None:
        if not 1.0 < self.ms <= 3.0:
            raise out_of_range("Ms", self.ms, "", "above 1 up to 3", "give one such as 1.4, 1.7 or 2")
        if not 0.0 < self.fast_share < 1.0:
            raise out_of_range("the fast loop's share", self.fast_share, "", "above 0 and below 1", "give one such as 0.5")
        if not 1.0 <= self.separation <= 100.0:
            raise out_of_range("separation of the crossovers", self.separation, "", "1 to 100", "give one such as 3")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MidRangingDesign:
    """Gains of both controllers and what they were made from.

    Attributes:
        linear: exact linear model about the trim.
        reserve: what the fast input can do there.
        signals: names of the signals.
        bounds: that were asked for.
        gains: of the law; the fast input's sign is in them.
        alone: gains of the slow input alone, of the same Ms.
        resolution: by which part the slow loop's largest integral gain may still be larger on its ray.
        limiting: what a larger integral gain of the slow loop would break.
    """

    linear: Linearization
    reserve: TorqueReserve
    signals: TwoInputSignals
    bounds: MidRangingBounds
    gains: LoopGains
    alone: OneInputGains
    resolution: float
    limiting: str


def design_mid_ranging(
    system: DelaySystem,
    trim: Trim,
    *,
    bounds: MidRangingBounds = MidRangingBounds(),
    signals: TwoInputSignals = SPEED_BY_SPARK_AND_THROTTLE,
) -> MidRangingDesign:
    """Design both loops of a mid-ranging controller, and the slow input alone for comparison.

    Args:
        system: with a fast and a slow input.
        trim: stable; its fast input is the set-point.
        bounds: on the peaks of the sensitivities and the distance of the crossovers.
        signals: names of the signals.

    Raises:
        InvalidInputError: there are no such signals, the fast input has no authority at its set-point, or the trim is unstable, so that
            nothing holds it while the fast input stands at its limit.
        AnalysisError: no gains keep the bounds.
        NotConvergedError: a boundary of gains could not be followed.
    """
    reserve = find_torque_reserve(system, trim, name=signals.fast, quantity=signals.quantity)
    if not trim.stable:
        message = (
            f"the trim is unstable ({trim.unstable_count} roots right of the axis): while {signals.fast} stands at its limit, gains from "
            f"zero on cannot hold it; choose a trim at a higher {signals.slow} or less load"
        )
        raise InvalidInputError(message, unstable=trim.unstable_count)
    linear = linearize(system, trim)
    model = linear.model
    alone = tune_one_input(model, signals.slow, signals, ms=bounds.ms)
    kp, ki = largest_integral(model, (signals.fast, signals), 1.0 + bounds.fast_share * (bounds.ms - 1.0), sign=reserve.sign)
    plant = TwoInputPlant.of(model, signals.fast, signals.slow, signals.measurement, sign=reserve.sign)
    gains, resolution, limiting = _slow_loop(plant, (kp, ki), alone, bounds)
    return MidRangingDesign(
        linear=linear,
        reserve=reserve,
        signals=signals,
        bounds=bounds,
        gains=gains,
        alone=alone,
        resolution=resolution,
        limiting=limiting,
    )


def _slow_loop(
    plant: TwoInputPlant, fast: tuple[float, float], alone: OneInputGains, bounds: MidRangingBounds
) -> tuple[LoopGains, float, str]:
    """Slow gains of the largest integral gain within the bounds: a grid of rays for each share of the derivative, the best zoomed into."""
    kp, ki = fast
    base, widest = alone.ki / kp, alone.kp / alone.ki
    coarse = np.geomspace(WEAKEST, 10.0, LEVELS) * base
    times, ratio = _spread(widest, SPREAD, RAYS)
    shares = [share * alone.kd / alone.ki for share in (SHARES if alone.kd > 0.0 else (0.0,))]
    found = max((_best(plant, fast, (times, coarse, share), bounds) for share in shares), key=lambda entry: entry.level)
    step = float(coarse[1] / coarse[0])
    for _ in range(ZOOMS):
        if not found.level > 0.0:
            message = f"no gains of the slow loop keep Ms = {bounds.ms:g} and crossovers {bounds.separation:g} apart; allow more of either"
            raise AnalysisError(message, ms=bounds.ms, separation=bounds.separation)
        times, ratio = _spread(found.time, ratio, RAYS)
        finer = found.level * np.geomspace(1.0, step**BEYOND, LEVELS)
        levels = np.concatenate((np.geomspace(WEAKEST * base, found.level, LEVELS)[:-1], finer))
        step = float(finer[1] / finer[0])
        found = _best(plant, fast, (times, levels, found.derivative), bounds)
    gains = LoopGains(kp=kp, ki=ki, slow_kp=found.time * found.level, slow_ki=found.level, slow_kd=found.derivative * kp * found.level)
    return gains, step - 1.0, found.limiting


class _Found(NamedTuple):
    """The largest integral gain on a grid of rays, its integral time and derivative, and what the next larger one breaks."""

    level: float
    time: float
    derivative: float
    limiting: str


def _best(plant: TwoInputPlant, fast: tuple[float, float], rays: tuple[Floats, Floats, float], bounds: MidRangingBounds) -> _Found:
    times, levels, derivative = rays
    peaks = peaks_of_rays(plant, fast, rays)
    broken = peaks.broken(SAFE * bounds.ms, bounds.separation)
    reachable = np.logical_and.accumulate(np.all(peaks.peaks < ALMOST_UNSTABLE, axis=0), axis=1)
    top = np.max(np.where(reachable & ~np.any(broken, axis=0), levels, 0.0), axis=1)
    at = int(np.argmax(top))
    following = int(np.searchsorted(levels, top[at])) + 1
    if following >= levels.size:
        return _Found(float(top[at]), float(times[at]), derivative, "the largest gain tried")
    beyond = broken[:, at, following]
    limiting = ", ".join(name for name, bad in zip(peaks.names, beyond, strict=True) if bad)
    return _Found(float(top[at]), float(times[at]), derivative, limiting)


def _spread(middle: float, ratio: float, count: int) -> tuple[Floats, float]:
    """Values about a middle one to both sides by a ratio, and the ratio of neighbours."""
    values = middle * np.geomspace(1.0 / ratio, ratio, count)
    return values, float(values[1] / values[0])
