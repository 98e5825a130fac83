"""Gains (kp, ki) at which the peak of a loop's sensitivity has a given value, its delay exact.

|1 + L(jw)| >= 1/Ms keeps (kp, ki) out of an ellipse at each frequency: centre (-Re G, w Im G), half axes |q|/Ms in kp and w times that
in ki, with q = 1/P and G = q + j w kd. The gains allowed at all frequencies lie outside all ellipses, and are bounded by their envelope:
with kp + Re G = r cos t and ki/w - Im G = r sin t, r = |q|/Ms, it has a point wherever

    a' cos t - (b/w + b') sin t - (r/w) sin^2 t - r' = 0,    a = Re G, b = Im G, primes derivatives by w,

a quartic in exp(jt), solved at each frequency. Of these points those are kept at which no other frequency has a higher peak and whose
loop is stable.

Source: Astrom, Panagopoulos and Hagglund (1998), Automatica 34(5), 585-601.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.regions.gain_curve import AXIS, HIGHEST, LoopFamily
from revline.design.regions.gain_region import GainRegion, Window
from revline.errors import InvalidInputError, out_of_range
from revline.values import make_read_only

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

NODES = 4
"""Points of the circle from which a derivative of q is taken; its error is that of the sixth order in the radius."""

RADIUS = 1e-3
"""Radius of that circle as a fraction of the frequency."""

ON_CIRCLE = 1e-5
"""How far from 1 the magnitude of a root exp(jt) may be before Newton's method mends it."""

PEAK = 1e-6
"""How far the peak found at a point of the contour may exceed the value asked for, as a fraction."""

ZOOMS = 4
"""How often the neighbourhood of the highest sensitivity on the grid is divided."""

DIVISIONS = 9
"""Into how many parts."""

ROUNDS = 2
"""How often frequencies are added where a contour's points lie far apart."""

PARTS = 6
"""Into how many parts such an interval is divided."""

CLOSE = 0.01
"""Points further apart than this part of a contour's extent lie far apart."""

FAR = 0.05
"""Points of a contour further from each other than this part of its extent are not joined."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensitivityContour:
    """The (kp, ki), ki positive, at which the largest magnitude of 1/(1 + L) has one value and the loop is stable.

    Attributes:
        region: of stabilising gains, of which this bounds a part.
        peak: the value, Ms.
        omega: frequency of the peak, in rad/s, shape (n,), along the contour.
        kp, ki: gains, shape (n,).
        piece: number of the connected piece that a point belongs to, shape (n,); neighbours of one number are joined.
        deviation: largest relative difference from `peak` that a search over all frequencies finds at the points.
    """

    region: GainRegion
    peak: float
    omega: Floats
    kp: Floats
    ki: Floats
    piece: NDArray[np.int64]
    deviation: float

    def __post_init__(self) -> None:
        make_read_only(self)


def find_sensitivity_contour(region: GainRegion, peak: float) -> SensitivityContour:
    """Find the gains of a region at which the sensitivity peaks at a value.

    Args:
        region: stabilising gains of one plant and one kd.
        peak: Ms, above 1; 1.4 is cautious, 2 is bold.

    Returns:
        The contour within the region's window; without points where no gains have that peak.

    Raises:
        InvalidInputError: the peak is not above 1, or the region is not one of stability.
    """
    if not 1.0 < peak < math.inf:
        raise out_of_range("peak of the sensitivity", peak, "", "values above 1", "give one such as 1.4, 1.7 or 2")
    if region.family.contour != AXIS:
        message = "a contour of the sensitivity is asked for in a region of damping; give the region of stability"
        raise InvalidInputError(message)
    grid, found = region.omega, _points(region, peak, region.omega)
    for _ in range(ROUNDS):
        between = _between(grid, found, region.window)
        grid = np.sort(np.concatenate((grid, between)))
        found = _Points(*(np.concatenate(pair) for pair in zip(found, _points(region, peak, between), strict=True)))
    order, piece = _chain(found, region.window)
    deviation = float(np.max(np.abs(found.peak[order] / peak - 1.0), initial=0.0))
    return SensitivityContour(
        region=region, peak=peak, omega=found.omega[order], kp=found.kp[order], ki=found.ki[order], piece=piece, deviation=deviation
    )


class _Points(NamedTuple):
    """Points of a contour: frequency, gains, and the peak that a search finds there."""

    omega: Floats
    kp: Floats
    ki: Floats
    peak: Floats


def _points(region: GainRegion, peak: float, grid: Floats) -> _Points:
    """Points of the envelope at some frequencies that lie on the contour."""
    omega, kp, ki = _envelope(region.family, peak, grid)
    window = region.window
    kept = (kp > window.kp_low) & (kp < window.kp_high) & (ki > 0.0) & (ki < window.ki_high)
    omega, kp, ki = omega[kept], kp[kept], ki[kept]
    kept = region.stabilises(kp, ki)
    omega, kp, ki = omega[kept], kp[kept], ki[kept]
    found = find_peaks(region, kp, ki)
    kept = found <= peak * (1.0 + PEAK)
    return _Points(omega[kept], kp[kept], ki[kept], found[kept])


def _between(grid: Floats, found: _Points, window: Window) -> Floats:
    """Frequencies between those of the grid where the contour's points lie far apart, or where it begins or ends."""
    x, y = _scaled(found, window)
    place = np.searchsorted(grid, found.omega)
    limit = CLOSE * max(float(np.ptp(x)), float(np.ptp(y))) if x.size else 0.0
    coarse = np.zeros(grid.size - 1, dtype=bool)
    for k in range(grid.size - 1):
        low, high = np.flatnonzero(place == k), np.flatnonzero(place == k + 1)
        if low.size and high.size:
            gaps = np.hypot(x[low][:, None] - x[high], y[low][:, None] - y[high])
            coarse[k] = max(float(np.max(np.min(gaps, axis=1))), float(np.max(np.min(gaps, axis=0)))) > limit
        else:
            coarse[k] = bool(low.size or high.size)
    shares = np.arange(1, PARTS) / PARTS
    return np.asarray((grid[:-1][coarse][:, None] * (grid[1:] / grid[:-1])[coarse][:, None] ** shares).ravel())


def _scaled(found: _Points, window: Window) -> tuple[Floats, Floats]:
    return found.kp / (window.kp_high - window.kp_low), found.ki / window.ki_high


def find_peaks(region: GainRegion, kp: ArrayLike, ki: ArrayLike) -> Floats:
    """Find the peak of the sensitivity for many gains, the delay exact; a number that means something for stable loops only.

    The highest value on the frequencies of the region's curve is improved by dividing the interval about it.

    Args:
        region: of the plant and kd.
        kp: proportional gains, of any common shape with `ki`.
        ki: integral gains.
    """
    p, i = (np.ravel(array) for array in np.broadcast_arrays(np.asarray(kp, dtype=float), np.asarray(ki, dtype=float)))
    if not p.size:
        return np.empty(np.broadcast_shapes(np.shape(kp), np.shape(ki)))
    grid = np.append(region.omega, HIGHEST)  # where |1/(1 + L)| tends to 1, which may be the peak
    values = _sensitivity(region.family, grid[:, None], region.family.inverse(AXIS.points(grid))[:, None], p, i)
    at = np.argmax(values, axis=0)
    best = values[at, np.arange(p.size)]
    low, high = grid[np.maximum(at - 1, 0)], grid[np.minimum(at + 1, grid.size - 1)]
    for _ in range(ZOOMS):
        between = low + (high - low) * np.linspace(0.0, 1.0, DIVISIONS)[:, None]
        q = region.family.inverse(AXIS.points(between.ravel())).reshape(between.shape)
        values = _sensitivity(region.family, between, q, p, i)
        at, columns = np.argmax(values, axis=0), np.arange(p.size)
        best = np.maximum(best, values[at, columns])
        low, high = between[np.maximum(at - 1, 0), columns], between[np.minimum(at + 1, DIVISIONS - 1), columns]
    return np.asarray(best.reshape(np.broadcast_shapes(np.shape(kp), np.shape(ki))))


def _sensitivity(family: LoopFamily, omega: Floats, q: Complexes, p: Floats, i: Floats) -> Floats:
    size = np.abs(q) / np.hypot(q.real + p, q.imag + family.kd * omega - i / omega)
    return np.asarray(size)


class _Local(NamedTuple):
    """Centre and half axis of the ellipses over frequency, with their slopes."""

    omega: Floats
    a: Floats
    b: Floats
    r: Floats
    a_slope: Floats
    b_slope: Floats
    r_slope: Floats

    def residual(self, t: Floats) -> tuple[Floats, Floats]:
        """The envelope's equation and its slope by t."""
        lean = self.b / self.omega + self.b_slope
        across = self.r / self.omega
        value = self.a_slope * np.cos(t) - lean * np.sin(t) - across * np.sin(t) ** 2 - self.r_slope
        return value, -self.a_slope * np.sin(t) - lean * np.cos(t) - across * np.sin(2.0 * t)


def _envelope(family: LoopFamily, peak: float, omega: Floats) -> tuple[Floats, Floats, Floats]:
    """All points of the envelope at some frequencies."""
    local = _ellipses(family, peak, omega)
    rows, t = _angles(local)
    chosen = _Local(*(column[rows] for column in local))
    kp = chosen.r * np.cos(t) - chosen.a
    ki = chosen.omega * (chosen.b + chosen.r * np.sin(t))
    return chosen.omega, kp, ki


def _ellipses(family: LoopFamily, peak: float, omega: Floats) -> _Local:
    turns = np.exp(2j * np.pi * np.arange(NODES) / NODES)
    radius = RADIUS * omega
    around = np.asarray(1j * omega[:, None] + radius[:, None] * turns, dtype=np.complex128)
    q = family.inverse(around.ravel()).reshape(around.shape)
    middle = family.inverse(AXIS.points(omega))
    slope = 1j * (q @ turns.conj()) / (NODES * radius)
    size = np.abs(middle)
    grow = (middle.conj() * slope).real / size
    b = middle.imag + family.kd * omega
    return _Local(omega, middle.real, b, size / peak, slope.real, slope.imag + family.kd, grow / peak)


def _angles(local: _Local) -> tuple[NDArray[np.intp], Floats]:
    """Angles at which the envelope's equation holds, as rows of `local` and values."""
    lean, across = local.b / local.omega + local.b_slope, local.r / local.omega
    scale = np.maximum.reduce([np.abs(local.a_slope), np.abs(lean), across, np.abs(local.r_slope)])
    first = (0.5 * local.a_slope + 0.5j * lean) / (0.25 * across)
    middle = (-0.5 * across - local.r_slope) / (0.25 * across)
    companion = np.zeros((local.omega.size, 4, 4), dtype=complex)
    companion[:, 1, 0] = companion[:, 2, 1] = companion[:, 3, 2] = 1.0
    companion[:, 0, 3] = -1.0
    companion[:, 1, 3], companion[:, 2, 3], companion[:, 3, 3] = -first.conj(), -middle, -first
    z = np.linalg.eigvals(companion)
    rows, columns = np.nonzero(np.abs(np.abs(z) - 1.0) < ON_CIRCLE)
    t = np.angle(z[rows, columns])
    chosen = _Local(*(column[rows] for column in local))
    for _ in range(4):
        value, slope = chosen.residual(t)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = t - np.clip(np.nan_to_num(value / slope), -0.1, 0.1)
    good = np.abs(chosen.residual(t)[0]) < 1e-9 * scale[rows]
    return rows[good], t[good]


def _chain(found: _Points, window: Window) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Order points along the contour, each followed by its nearest neighbour not yet passed; a far one begins a new piece."""
    count = found.kp.size
    order, piece = np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.int64)
    if not count:
        return order, piece
    x, y = _scaled(found, window)
    left = np.ones(count, dtype=bool)
    here = int(np.argmin(x))
    limit = FAR * max(float(np.ptp(x)), float(np.ptp(y)))
    for k in range(count):
        order[k], left[here] = here, False
        if k + 1 == count:
            break
        rest = np.flatnonzero(left)
        gaps = np.hypot(x[rest] - x[here], y[rest] - y[here])
        nearest = int(np.argmin(gaps))
        piece[k + 1] = piece[k] + (gaps[nearest] > limit)
        here = int(rest[nearest])
    return order, piece
