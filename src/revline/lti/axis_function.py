"""Functions p(w) + q(w) exp(-j w tau) of a real frequency w, and what can be found out about them with certainty.

Everything about a linear loop with one delay is such a function, or the real part of one. On an interval of half width h about m,
f differs from f(m) + f'(m) (w - m) by at most B h^2/2, where B bounds the second derivative and comes from the coefficients'
magnitudes. So an interval can be shown to hold no root, or one, or is halved: no grid, and nothing is missed between its points.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from revline.errors import NotConvergedError
from revline.units import RadiansPerSecond, Seconds
from revline.values import make_read_only

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Flags = NDArray[np.bool_]

MOST_INTERVALS = 1_000_000
"""More undecided intervals at once would need a delay of about a million turns in the range."""

NARROWEST = 1e-13
"""An interval this narrow, relative to its place, is not halved again: rounding decides there."""

NARROWEST_OF_ALL = 1e-18
"""The same, relative to the whole range: at w = 0 there is no place to be relative to."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisFunction:
    """p(w) + q(w) exp(-j w tau).

    Attributes:
        plain: complex coefficients of p, ascending.
        turning: complex coefficients of q, ascending.
        delay: tau.
    """

    plain: Complexes
    turning: Complexes
    delay: Seconds

    def __post_init__(self) -> None:
        make_read_only(self)

    def __call__(self, w: ArrayLike) -> Complexes:
        """Evaluate at frequencies of any shape."""
        grid = np.asarray(w, dtype=float)
        return np.asarray(_values(self.plain, grid) + _values(self.turning, grid) * np.exp(-1j * grid * self.delay))

    def derivative(self) -> "AxisFunction":
        """Differentiate by w."""
        turning = poly.polyadd(poly.polyder(self.turning), -1j * self.delay * self.turning)
        return make_axis_function(poly.polyder(self.plain), turning, self.delay)

    def times(self, factor: ArrayLike) -> "AxisFunction":
        """Multiply by a polynomial of w, its coefficients ascending."""
        by = np.asarray(factor, dtype=complex)
        return make_axis_function(np.convolve(self.plain, by), np.convolve(self.turning, by), self.delay)

    def plus(self, other: "AxisFunction") -> "AxisFunction":
        """Add a function of the same delay."""
        return make_axis_function(poly.polyadd(self.plain, other.plain), poly.polyadd(self.turning, other.turning), self.delay)

    def bend_bound(self) -> Floats:
        """Bound the second derivative's magnitude on [0, w]: by a polynomial of w, its coefficients ascending."""
        turning = np.abs(self.turning)
        twice = poly.polyadd(poly.polyder(np.abs(self.plain), 2), poly.polyder(turning, 2))
        return np.asarray(poly.polyadd(twice, poly.polyadd(2.0 * self.delay * poly.polyder(turning), self.delay**2 * turning)))

    def noise(self, w: Floats) -> Floats:
        """Bound what rounding does to the value on [0, w]: a sum of so many terms, each off by a few units of its own."""
        size = _values(np.abs(self.plain), w) + _values(np.abs(self.turning), w)
        return np.asarray(2.0 * np.finfo(float).eps * max(self.plain.size, self.turning.size) * size)


def _values(coefficients: NDArray[Any], w: Floats) -> NDArray[Any]:
    """A polynomial by Horner's scheme, coefficients ascending, real or complex."""
    total = np.full(w.shape, coefficients[-1])
    for entry in coefficients[-2::-1].tolist():
        total = total * w + entry
    return total


def make_axis_function(plain: ArrayLike, turning: ArrayLike, delay: Seconds) -> AxisFunction:
    """Make the function plain(w) + turning(w) exp(-j w delay) of ascending coefficients, real or complex."""
    return AxisFunction(plain=np.array(plain, dtype=complex), turning=np.array(turning, dtype=complex), delay=delay)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pieces:
    """Intervals m - h .. m + h with the function, its slope and the bound on the rest of the straight line there."""

    middle: Floats
    half: Floats
    value: Complexes
    slope: Complexes
    bend: Floats

    @property
    def narrow(self) -> Flags:
        return self.half <= NARROWEST * (self.middle - self.half)


def argument_change(function: AxisFunction, high: RadiansPerSecond) -> float:
    """Follow the argument of a function from w = 0 to high.

    Args:
        function: without a root in that range.
        high: end of the range.

    Returns:
        The change, in rad, all turns counted.

    Raises:
        NotConvergedError: the function has a root in the range, or so near that rounding cannot tell.
    """
    total = 0.0

    def collect(pieces: _Pieces) -> Flags:
        nonlocal total
        size = np.abs(pieces.value)
        decided = size > np.abs(pieces.slope) * pieces.half + 0.5 * pieces.bend * pieces.half**2
        stuck = ~decided & (pieces.narrow | (pieces.half <= NARROWEST_OF_ALL * high))
        if np.any(stuck):
            place = float((pieces.middle - pieces.half)[stuck][0])
            message = (
                f"a root lies on the imaginary axis at {place:.6g} rad/s, or nearer than rounding can tell: how many lie to its right "
                "is not defined; change a parameter a little"
            )
            raise NotConvergedError(message, frequency=place)
        middle, half, value = pieces.middle[decided], pieces.half[decided], pieces.value[decided]
        before, after = np.angle(value / function(middle - half)), np.angle(function(middle + half) / value)
        total += float(np.sum(before) + np.sum(after))
        return decided

    _divide(function, high, collect)
    return total


def sign_changes(function: AxisFunction, high: RadiansPerSecond) -> Floats:
    """Find every w in 0 < w < high at which the real part of a function changes its sign.

    Args:
        function: any.
        high: end of the range.

    Returns:
        The places, rising, each to rounding; of roots that rounding cannot tell apart one where they are odd, none where they are even.

    Raises:
        NotConvergedError: more intervals stay undecided than a computation can hold.
    """
    found: list[float] = []

    def real(w: float) -> float:
        return float(function(w).real)

    def collect(pieces: _Pieces) -> Flags:
        value, slope = pieces.value.real, np.abs(pieces.slope.real)
        # Where the value may be rounding, its sign is not that of its neighbours' ends: a change between them would be lost.
        noise = function.noise(pieces.middle + pieces.half)
        free = np.abs(value) > slope * pieces.half + 0.5 * pieces.bend * pieces.half**2 + noise
        narrow = pieces.narrow | (pieces.half <= NARROWEST_OF_ALL * high)
        single = ~free & ((slope > pieces.bend * pieces.half) | narrow)
        low, top = pieces.middle[single] - pieces.half[single], pieces.middle[single] + pieces.half[single]
        changes = (function(low).real >= 0.0) != (function(top).real >= 0.0)
        found.extend(_bisect(real, a, b) for a, b in zip(low[changes], top[changes], strict=True))
        return free | single

    _divide(function, high, collect)
    return _without_noise(function, sorted(w for w in found if w > 0.0))


def _without_noise(function: AxisFunction, places: list[float]) -> Floats:
    """Leave out pairs of changes between which the function is no larger than rounding: the sign comes back, if it ever went."""
    kept: list[float] = []
    for w in places:
        middle = 0.5 * (kept[-1] + w) if kept else 0.0
        if kept and abs(complex(function(middle)).real) <= float(function.noise(np.array(w))):
            kept.pop()
        else:
            kept.append(w)
    return np.array(kept)


def _bisect(real: Callable[[float], float], low: float, high: float) -> float:
    if real(low) == 0.0:
        return low
    return float(high if real(high) == 0.0 else brentq(real, low, high, xtol=1e-300, rtol=1e-15))


def _divide(function: AxisFunction, high: float, collect: Callable[[_Pieces], Flags]) -> None:
    """Halve intervals of [0, high] until all are decided; `collect` takes what it needs and says which are."""
    slope, bend = function.derivative(), function.bend_bound()
    middle, half = np.array([high / 2.0]), np.array([high / 2.0])
    while middle.size:
        if middle.size > MOST_INTERVALS:
            message = (
                f"{middle.size} intervals up to {high:g} rad/s are still undecided (limit {MOST_INTERVALS}); "
                "the delay is too long for the frequencies that matter, or the loop gain at high frequency too near 1"
            )
            raise NotConvergedError(message, intervals=middle.size)
        pieces = _Pieces(middle=middle, half=half, value=function(middle), slope=slope(middle), bend=_values(bend, middle + half))
        rest = ~collect(pieces)
        quarter = half[rest] / 2.0
        middle = np.concatenate([middle[rest] - quarter, middle[rest] + quarter])
        half = np.concatenate([quarter, quarter])
