"""Where a ray of gains leaves the stabilising ones: how far a controller's gains may rise or fall together, and the gain limit of a plant.

On the ray (kp, ki) = f (kp1, ki1) a root lies at jw where the curve of gains crosses the ray, ki(w) kp1 = kp(w) ki1; these places are
found as roots, so that the factors f are exact to rounding. Between them the number of unstable roots is constant.

Source: Neimark's D-decomposition on a line; Gryazina and Polyak (2006), Automatica 42(1), 13-26. For dead time Astrom and Hagglund (2006),
Advanced PID Control, section 4.2.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.design.regions.gain_curve import AXIS, GainCurve, LoopFamily, find_root, gains_at, trace_curve
from revline.design.regions.gain_region import LOW, GainRegion, count_roots, turn_at_rest
from revline.errors import InvalidInputError, NotConvergedError, out_of_range

Floats = NDArray[np.float64]

FIRST_REACH = 4.0
"""Loop gain at rest up to which a gain limit is looked for at first; it is raised by `GROWTH` until one is found."""

GROWTH = 8.0

GROWTHS = 16
"""How often it is raised at most."""


@dataclass(frozen=True, slots=True)
class GainLimit:
    """Largest proportional gain, the loop oscillating at `frequency` in rad/s there."""

    kp: float
    frequency: float


@dataclass(frozen=True, slots=True)
class NoGainLimit:
    """No loop of the family oscillates up to a frequency in rad/s, however large the gain: by this model any is safe."""

    searched_to: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """A place where a ray crosses the boundary.

    Attributes:
        factor: of the gains that the ray goes through.
        frequency: of the oscillation there, in rad/s; 0 where a real root passes the origin.
        change: of the number of unstable roots as the factor rises through it.
    """

    factor: float
    frequency: float
    change: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RayPlace:
    """Where gains lie on their ray.

    Attributes:
        unstable: roots right of the contour with these gains.
        crossings: all of the ray with the curve, at factors above 0, by rising factor.
    """

    unstable: int
    crossings: tuple[Crossing, ...]

    @property
    def inside(self) -> bool:
        """Whether the gains lie in the region."""
        return self.unstable == 0

    @property
    def rise(self) -> Crossing | None:
        """The first crossing at a larger factor; none where there is none up to the end of the curve that was looked at."""
        return next((c for c in self.crossings if c.factor > 1.0), None)

    @property
    def fall(self) -> Crossing | None:
        """The first crossing at a smaller factor; none where the gains may fall to nothing."""
        return next((c for c in reversed(self.crossings) if c.factor <= 1.0), None)


def place_gains(region: GainRegion, kp: float, ki: float) -> RayPlace:
    """Find where gains lie on the ray from the origin through them, kd being that of the region.

    Args:
        region: its curve tells all crossings up to the frequencies at which the curve leaves its window.
        kp: proportional gain.
        ki: integral gain, 0 or above.

    Raises:
        InvalidInputError: both gains are 0, or ki is negative.
    """
    if ki < 0.0 or (kp == 0.0 and ki == 0.0) or not (math.isfinite(kp) and math.isfinite(ki)):
        raise out_of_range(
            "ki", ki, region.family.gain_unit + "/s", "0 and above, with a kp or ki that is not 0", "give a controller's gains"
        )
    found = _crossings(region.family, region.curve, kp, ki)
    first = min((c.factor for c in found), default=1.0)
    share = 0.5 * min(first, 1.0)
    count = int(region.unstable_roots(share * kp, share * ki)) + sum(c.change for c in found if c.factor <= 1.0)
    return RayPlace(unstable=count, crossings=found)


def find_gain_limit(family: LoopFamily, *, integral_ratio: float = 0.0, high: float = 1e4) -> GainLimit | NoGainLimit:
    """Find the proportional gain at which a loop under a PI controller, ki in a fixed ratio to kp, loses stability.

    The stabilising gains that begin lowest are taken; of a plant that is stable by itself these begin at 0.

    Args:
        family: plant and kd.
        integral_ratio: ki over kp, in 1/s; 0 for proportional control.
        high: highest frequency looked at, in rad/s.

    Raises:
        InvalidInputError: the frequency is not above 0, the ratio is negative, the plant's gain at rest is, or no gains of this ratio
            stabilise the loop.
        NotConvergedError: the plant turns too fast to be followed.
    """
    if not 0.0 < high < math.inf:
        raise out_of_range("highest frequency", high, "rad/s", "values above 0 rad/s", "give one well above the loop's bandwidth")
    if not (math.isfinite(integral_ratio) and integral_ratio >= 0.0):
        raise out_of_range("ratio of ki to kp", integral_ratio, "1/s", "0 and above", "give the ratio of the controller")
    if family.contour != AXIS or family.at_rest < 0.0:
        message = (
            f"a gain limit of {family.name} is that of a plant with positive gain at rest (here 1/{family.at_rest:g}), counted right of "
            "the imaginary axis; turn the plant's sign, and give no damping"
        )
        raise InvalidInputError(message)
    reach = FIRST_REACH * (family.at_rest or 0.1 * float(np.abs(family.inverse(np.array([1j])))[0]))
    for growth in range(GROWTHS):
        try:
            curve = trace_curve(family, kp_reach=reach, ki_reach=reach * integral_ratio, low=LOW)
        except NotConvergedError as error:
            if growth == 0:
                raise
            raise _never_stable(family, integral_ratio, reach / GROWTH) from error
        found, stable = _limit_on_curve(family, curve, integral_ratio, reach)
        if found is not None and found.frequency <= high:
            return found
        if stable and (found is not None or curve.omega[-1] > high):
            return NoGainLimit(searched_to=high)
        reach *= GROWTH
    raise _never_stable(family, integral_ratio, reach / GROWTH)


def _never_stable(family: LoopFamily, ratio: float, reach: float) -> InvalidInputError:
    message = (
        f"no proportional gain up to {reach:g} stabilises {family.name} with ki/kp = {ratio:g} 1/s and kd = {family.kd:g}: so much "
        "integral action is unstable at any gain, or the plant is; lower the ratio"
    )
    return InvalidInputError(message, ratio=ratio)


def _limit_on_curve(family: LoopFamily, curve: GainCurve, ratio: float, reach: float) -> tuple[GainLimit | None, bool]:
    """The end of the lowest stable gains, if it lies within reach, and whether gains there are stable."""
    crossings = [c for c in _crossings(family, curve, 1.0, ratio) if c.factor <= reach]
    start = 0.5 * min((c.factor for c in crossings), default=reach)
    count = int(count_roots(family, curve, np.array([start]), np.array([start * ratio]))[0])
    for crossing in crossings:
        if count == 0:
            return GainLimit(kp=crossing.factor, frequency=crossing.frequency), True
        count += crossing.change
    return None, count == 0


def _crossings(family: LoopFamily, curve: GainCurve, kp: float, ki: float) -> tuple[Crossing, ...]:
    """All crossings of a ray with the curve and, without integral action, with the real root at the origin; by rising factor above 0."""
    size = math.hypot(kp, ki)
    kp1, ki1 = kp / size, ki / size

    def aside(w: float) -> float:
        p, i = gains_at(family, np.array([w]))
        return float((i[0] * kp1 - p[0] * ki1) / w)

    values = (curve.ki * kp1 - curve.kp * ki1) / curve.omega
    found = []
    for k in np.flatnonzero((values[1:] > 0.0) != (values[:-1] > 0.0)):
        w = find_root(aside, float(curve.omega[k]), float(curve.omega[k + 1]))
        p, i = (float(array[0]) for array in gains_at(family, np.array([w])))
        factor = (p * kp1 + i * ki1) / size
        if factor > 0.0:
            found.append(Crossing(factor=factor, frequency=w, change=-2 if values[k + 1] > values[k] else 2))
    if ki == 0.0 and -family.at_rest / kp > 0.0:
        turn = turn_at_rest(family)
        found.append(Crossing(factor=-family.at_rest / kp, frequency=0.0, change=turn if kp > 0.0 else -turn))
    return tuple(sorted(found, key=lambda c: c.factor))
