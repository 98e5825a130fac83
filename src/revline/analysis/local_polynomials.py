"""A frequency response from whole records, by polynomials over neighbouring frequencies: leakage is estimated with it and taken out.

With U and Y the discrete Fourier transforms of whole records, Y(k) = G(k) U(k) + T(k) + noise holds exactly: T is what happens before
and after the record, and is as smooth over the frequency as G, while U is rough. Around each frequency both are polynomials whose
coefficients follow by least squares, and what is left tells the noise. A window, as in averages of spectra, mixes neighbours instead.

Source: Pintelon, Schoukens, Vandersteen and Barbe (2010), Mechanical Systems and Signal Processing 24(3), 573-595.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.lti.response import Complexes

ORDER = 2
"""Of the polynomials; those that tell the error of these have two more."""

SMALLEST_SINGULAR = 1e-5
"""Combinations of coefficients that the input excites less than this part of the best are left at none: an input of few sinusoids."""

CHANCE = 3.0
"""So many times its mean may the square of a difference be by chance alone, of noise of two equal parts: 1 in 20."""


class LocalFit(NamedTuple):
    """What a neighbourhood of frequencies tells.

    Attributes:
        value: of the response.
        variance: of it, as a complex number: both parts together.
        bias: bound of its error by the polynomials' order, its size without what noise explains.
        explained: mean power of the output that the input explains, transients aside.
        noise: mean power that nothing explains.
        power: of the input, as far as it is told apart from a transient.
        own: the input's power at the frequency itself as a part of the neighbourhood's mean, what may be a transient aside or not.
        sparse: whether the input has too few frequencies in the neighbourhood to tell a slope of the response.
    """

    value: complex
    variance: float
    bias: float
    explained: float
    noise: float
    power: float
    own: float
    sparse: bool


def fit_locally(moved: Complexes, watched: Complexes, at: int, half_width: int) -> LocalFit:
    """Find the response at one frequency from its neighbours.

    Args:
        moved: Fourier transform of the whole input, from frequency 0 on.
        watched: of the whole output.
        at: position of the frequency.
        half_width: neighbours on each side, at least 8; there are fewer at the ends.

    Returns:
        The response and what is known of its errors.
    """
    rows = np.arange(max(1, at - half_width), min(moved.size, at + half_width + 1))
    places = (rows - at) / half_width
    low, high = (_solve(moved[rows], watched[rows], places, order) for order in (ORDER, ORDER + 2))
    by_chance = CHANCE * high.noise * max(0.0, high.gain - low.gain)
    apart = abs(high.value - low.value) ** 2
    return LocalFit(
        value=low.value,
        variance=low.noise * low.gain,
        bias=float(np.sqrt(max(0.0, apart - by_chance))),
        explained=low.explained,
        noise=low.noise,
        power=1.0 / (low.gain * rows.size) if low.gain else 0.0,
        own=low.own,
        sparse=low.sparse,
    )


class _Solved(NamedTuple):
    """What one order of the polynomials gives."""

    value: complex
    gain: float
    explained: float
    noise: float
    own: float
    sparse: bool


def _solve(u: Complexes, y: Complexes, places: NDArray[np.float64], order: int) -> _Solved:
    """Least squares with polynomials of one order; `gain` is the variance of the value for noise of power 1."""
    powers = places[:, None] ** np.arange(order + 1)
    smooth = np.linalg.qr(powers)[0]
    columns = powers * u[:, None]
    columns = columns - smooth @ (smooth.T @ columns)
    left = y - smooth @ (smooth.T @ y)
    inner, sizes, outer = np.linalg.svd(columns, full_matrices=False)
    told = sizes > SMALLEST_SINGULAR * sizes[0]
    weights = outer[told].conj()[:, 0] / sizes[told] if sizes[0] > 0.0 else np.zeros(0)
    seen = inner[:, told].conj().T @ left
    rest = left - inner[:, told] @ seen
    centre = int(np.argmin(np.abs(places)))
    shares = [float(power[centre] / max(np.mean(power), 1e-300)) for power in (np.abs(u) ** 2, np.abs(columns[:, 0]) ** 2)]
    free = max(1, places.size - order - 1 - int(np.sum(told)))
    return _Solved(
        value=complex(weights @ seen) if weights.size else 0j,
        gain=float(np.sum(np.abs(weights) ** 2)),
        explained=float(np.sum(np.abs(seen) ** 2)) / places.size,
        noise=float(np.sum(np.abs(rest) ** 2)) / free,
        own=min(shares),
        sparse=bool(np.sum(told) <= order),
    )
