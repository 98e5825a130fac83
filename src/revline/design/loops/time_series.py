"""Reading a sampled signal between its samples: extremes and level crossings by local polynomials."""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike, NDArray

from revline.errors import InvalidInputError

Floats = NDArray[np.float64]

MIN_SAMPLES = 8
MOST_REACH = 3


class Series(NamedTuple):
    """A checked time series: finite values at strictly rising times [s]."""

    times: Floats
    values: Floats


class Extreme(NamedTuple):
    """A local extreme between samples, and how far two interpolations of it differ."""

    time: float
    value: float
    error: float


def check_series(times: ArrayLike, values: ArrayLike) -> Series:
    """Make a series of two columns.

    Raises:
        InvalidInputError: the columns differ in length, are too short, hold what is not finite, or time does not rise strictly.
    """
    t, v = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    if t.ndim != 1 or t.shape != v.shape:
        message = f"times of shape {t.shape} and values of shape {v.shape} are no series; give two columns of equal length"
        raise InvalidInputError(message)
    if t.size < MIN_SAMPLES:
        message = f"a series of {t.size} samples is too short to be measured; give at least {MIN_SAMPLES}"
        raise InvalidInputError(message, samples=t.size)
    finite = np.isfinite(t) & np.isfinite(v)
    if not finite.all():
        k = int(np.argmin(finite))
        message = f"sample {k} (time {t[k]} s, value {v[k]}) is not finite; a series holds finite numbers only"
        raise InvalidInputError(message, sample=k)
    if np.any(np.diff(t) <= 0.0):
        k = int(np.argmax(np.diff(t) <= 0.0))
        message = f"time does not rise after sample {k}: {t[k]:g} s, then {t[k + 1]:g} s; sort the samples and leave repeated times out"
        raise InvalidInputError(message, sample=k)
    return Series(t, v)


def refine_extreme(series: Series, k: int) -> Extreme:
    """Refine the extreme at sample k, which is no lower (or no higher) than its neighbours.

    By the polynomial through three, five or seven samples about it, as many as there are; the error stated is the difference to the
    polynomial through two fewer. At an end of the series the sample itself is the extreme.
    """
    t, v = series
    best, error = (float(t[k]), float(v[k])), 0.0
    for reach in range(1, 1 + min(MOST_REACH, k, t.size - 1 - k)):
        finer = _vertex(series, k, reach)
        best, error = finer, abs(finer[1] - best[1])
    return Extreme(best[0], best[1], error)


def _vertex(series: Series, k: int, reach: int) -> tuple[float, float]:
    """Find where the polynomial through the samples k-reach..k+reach is steady, between the neighbours of k."""
    t, v = series
    scale = (t[k + 1] - t[k - 1]) / 2.0
    near = slice(k - reach, k + reach + 1)
    curve = _through((t[near] - t[k]) / scale, v[near] - v[k])
    slopes = curve[1:] * np.arange(1.0, curve.size)
    roots = np.asarray(poly.polyroots(slopes) if slopes.size else [], dtype=np.complex128).tolist()
    inside = [r.real for r in roots if abs(r.imag) < 1e-9 and (t[k - 1] - t[k]) <= r.real * scale <= (t[k + 1] - t[k])]
    if not inside:
        return float(t[k]), float(v[k])
    place = min(inside, key=abs)
    return float(t[k] + place * scale), float(v[k] + poly.polyval(place, curve))


def _through(places: Floats, values: Floats) -> Floats:
    """Coefficients, ascending, of the polynomial through some points, without the highest where they are zero."""
    found = np.linalg.solve(np.vander(places, increasing=True), values)
    kept = np.flatnonzero(found)
    return np.asarray(found[: kept[-1] + 1 if kept.size else 1])


def first_reach(series: Series, level: float) -> float:
    """Find the time at which the values first reach a level from below; the first time where they start above it.

    Raises:
        InvalidInputError: they never do.
    """
    t, v = series
    above = v >= level
    if not above.any():
        message = f"the values never reach {level:g}; their largest is {v.max():g}"
        raise InvalidInputError(message, level=level)
    k = int(np.argmax(above))
    return float(t[0]) if k == 0 else crossing_time(series, k - 1, level)


def crossing_time(series: Series, k: int, level: float) -> float:
    """Find where the values pass a level between the samples k and k + 1, by a straight line."""
    t, v = series
    return float(t[k] + (t[k + 1] - t[k]) * (level - v[k]) / (v[k + 1] - v[k]))


def upward_crossings(series: Series, level: float, hysteresis: float) -> Floats:
    """Find all times at which the values pass a level upwards, from below level - hysteresis to above level + hysteresis.

    Sub-sample by a cubic through the four nearest samples where it has one crossing there, else by a straight line.
    """
    v = series.values
    side = np.where(v > level + hysteresis, 1, np.where(v < level - hysteresis, -1, 0))
    marked = np.flatnonzero(side)
    rising = np.flatnonzero((side[marked[:-1]] < 0) & (side[marked[1:]] > 0))
    found = []
    for low, high in zip(marked[rising], marked[rising + 1], strict=True):
        between = v[low : high + 1]
        k = int(low + np.flatnonzero((between[:-1] < level) & (between[1:] >= level))[-1])
        found.append(_cubic_crossing(series, k, level))
    return np.array(found)


def _cubic_crossing(series: Series, k: int, level: float) -> float:
    t, v = series
    if k < 1 or k > t.size - 3:
        return crossing_time(series, k, level)
    scale = t[k + 1] - t[k]
    near = slice(k - 1, k + 3)
    roots = np.asarray(poly.polyroots(_through((t[near] - t[k]) / scale, v[near] - level)), dtype=np.complex128).tolist()
    inside = [r.real for r in roots if abs(r.imag) < 1e-9 and 0.0 <= r.real <= 1.0]
    return float(t[k] + inside[0] * scale) if len(inside) == 1 else crossing_time(series, k, level)
