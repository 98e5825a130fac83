"""The gains (kp, ki) that put a root of a loop on a given line of the complex plane, its delay exact.

With q = 1/P and G = q + kd s, the loop has a root at s where G(s) + kp + ki/s = 0. Both gains are real, so that each s above the real axis
gives one pair of them: ki = Im G |s|^2/Im s and kp = -Re G - ki Re s/|s|^2. On the imaginary axis the pairs bound stability; on a line
left of it they bound a damping.

Source: Neimark's D-decomposition, as Gryazina and Polyak (2006), Automatica 42(1), 13-26, have it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.units import PerSecond, RadiansPerSecond

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Inverse = Callable[[Complexes], Complexes]

PHASE_STEP = 0.02
"""Largest change of the phase of q between neighbours on the curve, in rad."""

SIZE_STEP = 0.02
"""Largest change of the logarithm of its magnitude."""

PLANE_STEP = 0.02
"""Largest distance of neighbours in a window of gains, as a part of its size."""

MOST_POINTS = 50_000
"""Most points of the curve."""

HIGHEST = 1e9
"""No loop is followed beyond this frequency, in rad/s."""

LOWEST = 1e-9
"""Lowest frequency that a curve is begun at, in rad/s."""

AT_REST = 0.05
"""How far q may be from its value at rest where a curve begins, as a fraction."""

PER_DECADE = 100
"""Frequencies looked at in each decade for where the curve leaves the gains of interest; the plant's own are added to them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contour:
    """A line from the origin into the upper half plane: a ray of one damping ratio, from some natural frequency on straight upwards.

    Roots to its left are damped at least as `damping` says, or decay at least as fast as a root of that damping and of natural frequency
    `up_to`. With damping 0 it is the imaginary axis. A delay leaves infinitely many roots whose damping ratio goes to 0 while their decay
    grows, so that a ray without end bounds nothing for it.

    Attributes:
        damping: ratio, 0 and above, below 1.
        up_to: natural frequency at which the ray ends, in rad/s; infinite for a ray without end.
    """

    damping: float = 0.0
    up_to: RadiansPerSecond = math.inf

    def __post_init__(self) -> None:
        if not 0.0 <= self.damping < 1.0:
            raise out_of_range("damping", self.damping, "", "0 and above, below 1", "give a ratio such as 0.1")
        if not self.up_to > 0.0:
            raise out_of_range("natural frequency", self.up_to, "rad/s", "values above 0", "give the highest that must be damped")

    @property
    def decay(self) -> PerSecond:
        """Decay rate of the part that goes straight upwards, in 1/s."""
        return 0.0 if self.damping == 0.0 else self.damping * self.up_to

    @property
    def corner(self) -> RadiansPerSecond:
        """Imaginary part where the ray ends, in rad/s."""
        return self.up_to * math.sqrt(1.0 - self.damping**2)

    def points(self, omega: Floats) -> Complexes:
        """Points of the line at imaginary parts in rad/s."""
        if self.damping == 0.0:
            return np.asarray(1j * omega)
        slope = self.damping / math.sqrt(1.0 - self.damping**2)
        return np.asarray(-slope * np.minimum(omega, self.corner) + 1j * omega)

    def is_right(self, s: Complexes) -> NDArray[np.bool_]:
        """Whether points lie right of the line or of its mirror image; real points do where they are positive."""
        height = np.abs(s.imag)
        return np.asarray(s.real > self.points(height).real)


AXIS = Contour()
"""The imaginary axis."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopFamily:
    """A plant under all PI controllers with one derivative gain.

    Attributes:
        name: of the plant.
        inverse: q = 1/P at complex s in rad/s, of shape (n,).
        at_rest: q(0), real; 0 for a plant that integrates.
        kd: derivative gain.
        base: a kp at which the roots were counted, ki being 0.
        unstable: how many lie right of the contour there.
        gain_unit: of kp.
        contour: the line that roots are counted right of.
        landmarks: frequencies at which the plant's own roots and zeros may turn q within little, in rad/s.
    """

    name: str
    inverse: Inverse
    at_rest: float
    kd: float
    base: float
    unstable: int
    gain_unit: str = ""
    contour: Contour = AXIS
    landmarks: tuple[float, ...] = ()


class GainCurve(NamedTuple):
    """Gains at which a root lies on the contour: imaginary part (n,) in rad/s, strictly rising, kp (n,) and ki (n,)."""

    omega: Floats
    kp: Floats
    ki: Floats


def gains_at(family: LoopFamily, omega: Floats) -> tuple[Floats, Floats]:
    """Find the gains that put a root on the contour at imaginary parts in rad/s.

    Args:
        family: plant, kd and contour.
        omega: shape (n,), above 0.

    Returns:
        kp and ki, shape (n,).
    """
    s = family.contour.points(omega)
    return _gains(family, s, family.inverse(s))


def _gains(family: LoopFamily, s: Complexes, q: Complexes) -> tuple[Floats, Floats]:
    held = q + family.kd * s
    over = held.imag / s.imag
    return np.asarray(-held.real - over * s.real), np.asarray(over * np.abs(s) ** 2)


def trace_curve(family: LoopFamily, *, kp_reach: float, ki_reach: float, low: float) -> GainCurve:
    """Trace the curve from a low frequency to where it has left the gains of interest for good.

    Args:
        family: plant, kd and contour.
        kp_reach: largest magnitude of kp of interest.
        ki_reach: largest ki of interest.
        low: lowest imaginary part, in rad/s, lowered until q is there what it is at rest; below it the curve is taken to run straight to
            (-q(0), 0).

    Raises:
        InvalidInputError: the plant does not fall at high frequency faster than the derivative rises.
        NotConvergedError: the curve turns too fast to be followed.
    """
    low = _bottom(family, low)
    high = _top(family, kp_reach, ki_reach, low)
    omega, q = _grid(family, low, high)
    omega, q, on_axis = _with_axis_points(family, omega, q)
    kp, ki = _gains(family, family.contour.points(omega), q)
    ki[on_axis] = 0.0
    return GainCurve(omega, kp, ki)


def refine_curve(family: LoopFamily, curve: GainCurve, *, kp: tuple[float, float], ki: float) -> GainCurve:
    """Add points where neighbours lie far apart in a window of gains, by `PLANE_STEP` of its size.

    Args:
        family: plant, kd and contour.
        curve: of the family.
        kp: lowest and highest kp of the window.
        ki: its highest ki; the lowest is 0.
    """
    omega, width = curve.omega, kp[1] - kp[0]
    inside = (curve.kp >= kp[0] - 0.1 * width) & (curve.kp <= kp[1] + 0.1 * width) & (curve.ki >= -0.1 * ki) & (curve.ki <= 1.1 * ki)
    steps = np.hypot(np.diff(curve.kp) / width, np.diff(curve.ki) / ki)
    parts = np.where(inside[:-1] | inside[1:], np.clip(np.ceil(steps / PLANE_STEP), 1.0, 50.0), 1.0).astype(int)
    if not np.any(parts > 1):
        return curve
    between = _divided(omega, parts)
    places = np.searchsorted(omega, between)
    new_kp, new_ki = gains_at(family, between)
    return GainCurve(np.insert(omega, places, between), np.insert(curve.kp, places, new_kp), np.insert(curve.ki, places, new_ki))


def _divided(grid: Floats, parts: NDArray[np.int64]) -> Floats:
    """Points that divide each interval of a grid geometrically into a number of parts."""
    starts = np.repeat(grid[:-1], parts - 1)
    ratios = np.repeat(grid[1:] / grid[:-1], parts - 1)
    share = np.concatenate([np.arange(1, n) / n for n in parts[parts > 1]])
    return np.asarray(starts * ratios**share)


def _with_landmarks(family: LoopFamily, grid: Floats) -> Floats:
    marks = [mark for mark in (*family.landmarks, family.contour.corner) if grid[0] < mark < grid[-1]]
    return np.unique(np.concatenate((grid, marks)))


def _bottom(family: LoopFamily, low: float) -> float:
    """Lower a frequency until q is near its value at rest there, or proportional to s for a plant that integrates."""
    while low > LOWEST:
        here, below = (complex(value) for value in family.inverse(family.contour.points(np.array([low, 0.1 * low]))))
        wanted = family.at_rest or 10.0 * below
        if abs(here - wanted) < AT_REST * abs(wanted):
            break
        low *= 0.1
    return low


def _top(family: LoopFamily, kp: float, ki: float, low: float) -> float:
    """A frequency beyond which no root can lie on the contour for any gains of interest: |q + kd s| > |kp| + ki/|s| there."""
    grid = _with_landmarks(family, np.geomspace(low, HIGHEST, round(PER_DECADE * math.log10(HIGHEST / low))))
    s = family.contour.points(grid)
    with np.errstate(over="ignore", invalid="ignore"):
        free = np.abs(family.inverse(s) + s * family.kd) > 1.05 * (kp + ki / np.abs(s))
    held = np.flatnonzero(~free)
    if held.size and held[-1] == grid.size - 1:
        message = (
            f"{family.name} with kd = {family.kd:g} answers at any frequency: the loop is improper, or its derivative as strong as the "
            "plant is fast; lower kd, or filter it"
        )
        raise InvalidInputError(message, kd=family.kd)
    return float(grid[held[-1] + 1]) if held.size else float(grid[1])


def _grid(family: LoopFamily, low: float, high: float) -> tuple[Floats, Complexes]:
    grid = _with_landmarks(family, np.geomspace(low, high, 200))
    values = family.inverse(family.contour.points(grid))
    while True:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = values[1:] / values[:-1]
            turned, grown = np.abs(np.angle(ratio)), np.abs(np.log(np.abs(ratio)))
            pieces = np.ceil(np.maximum(turned / PHASE_STEP, grown / SIZE_STEP))
        coarse = ~(pieces <= 1.0)
        if not np.any(coarse):
            return grid, values
        if grid.size > MOST_POINTS:
            where = float(grid[1:][coarse][0])
            message = (
                f"1/P of {family.name} turns too fast near {where:g} rad/s to be followed with {MOST_POINTS} points; look at smaller gains"
            )
            raise NotConvergedError(message, frequency=where)
        parts = np.where(np.isfinite(pieces), np.clip(pieces, 1.0, 8.0), 8.0).astype(int)
        between = _divided(grid, parts)
        added = family.inverse(family.contour.points(between))
        places = np.searchsorted(grid, between)
        grid, values = np.insert(grid, places, between), np.insert(values, places, added)


def _with_axis_points(family: LoopFamily, omega: Floats, q: Complexes) -> tuple[Floats, Complexes, NDArray[np.intp]]:
    """Add the frequencies at which the curve crosses ki = 0, found exactly, and tell where they stand."""

    def height(w: float) -> float:
        s = family.contour.points(np.array([w]))
        return float((family.inverse(s) + family.kd * s).imag[0])

    slope = (q + family.kd * family.contour.points(omega)).imag
    at = np.flatnonzero((slope[1:] > 0.0) != (slope[:-1] > 0.0))
    roots = np.array([find_root(height, float(omega[k]), float(omega[k + 1])) for k in at])
    new = ~np.isin(roots, omega)
    if np.any(new):
        places = at[new] + 1
        omega = np.insert(omega, places, roots[new])
        q = np.insert(q, places, family.inverse(family.contour.points(roots[new])))
    return omega, q, np.searchsorted(omega, roots)


def find_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Find where a function changes its sign, or the end at which it is smaller where rounding has taken the change away.

    Args:
        function: of a frequency.
        low: lower end.
        high: upper end.
    """
    at_low, at_high = function(low), function(high)
    if (at_low > 0.0) == (at_high > 0.0):
        return low if abs(at_low) < abs(at_high) else high
    return float(brentq(function, low, high, xtol=1e-300, rtol=1e-14))
