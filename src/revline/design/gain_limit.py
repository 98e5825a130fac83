"""How far a loop's gain may be raised before it loses stability: the first crossing of the negative real axis.

Source: Nyquist (1932); for dead time Astrom and Hagglund (2006), Advanced PID Control, section 4.2.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from revline.errors import InvalidInputError, out_of_range

Transfer = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]

POINTS = 4000
CANDIDATES = 8
"""Crossings that are looked at closely: those with the largest loop gain. A long delay makes hundreds."""


@dataclass(frozen=True, slots=True)
class GainLimit:
    """Largest proportional gain, the loop oscillating at `frequency` in rad/s there."""

    kp: float
    frequency: float


@dataclass(frozen=True, slots=True)
class NoGainLimit:
    """The loop's phase does not reach -180 degrees up to a frequency in rad/s: by this model any gain is safe."""

    searched_to: float


def find_gain_limit(transfer: Transfer, *, integral_ratio: float = 0.0, low: float = 0.1, high: float = 1000.0) -> GainLimit | NoGainLimit:
    """Find the proportional gain at which a loop of stable plant and PI controller loses stability.

    With rising gain, the first crossing of the negative real axis is the one at the least gain. Resonances narrower than a thousandth of
    their frequency may pass unseen between the frequencies looked at.

    Args:
        transfer: of the plant on complex s, stable or integrating once, its delay exact.
        integral_ratio: ki over kp, in 1/s; 0 for proportional control.
        low: lowest frequency looked at, in rad/s.
        high: highest frequency looked at, in rad/s.

    Raises:
        InvalidInputError: the frequencies make no range, the ratio is negative, or the loop's phase is beyond -180 degrees from the lowest
            frequency on: the plant's gain is negative, small gains do not stabilise it, or the range begins above the first crossing.
    """
    if not 0.0 < low < high < math.inf:
        raise out_of_range("highest frequency", high, "rad/s", f"values above {low:g} rad/s", "give a range of frequencies above 0")
    if not (math.isfinite(integral_ratio) and integral_ratio >= 0.0):
        raise out_of_range("ratio of ki to kp", integral_ratio, "1/s", "0 and above", "give the ratio of the controller")

    def loop(omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        s: NDArray[np.complex128] = np.asarray(1j * omega, dtype=np.complex128)
        values: NDArray[np.complex128] = (1.0 + integral_ratio / s) * transfer(s)
        return values

    def imaginary(log_omega: float) -> float:
        return float(loop(np.array([math.exp(log_omega)]))[0].imag)

    grid = np.geomspace(low, high, POINTS)
    values = loop(grid)
    if values[0].real < 0.0 and values[0].imag >= 0.0:
        message = (
            f"at {low:g} rad/s the loop's phase is already beyond -180 deg: the plant's gain is negative, or so much integral action is "
            "unstable at any gain, or the first crossing lies below; turn the sign, lower the ratio or search from a lower frequency"
        )
        raise InvalidInputError(message, frequency=low)
    turns = np.flatnonzero((np.sign(values.imag[1:]) != np.sign(values.imag[:-1])) & (values.real[1:] < 0.0) & (values.real[:-1] < 0.0))
    limits = []
    sizes = np.maximum(np.abs(values[turns]), np.abs(values[turns + 1]))
    for k in turns[np.argsort(-sizes)[:CANDIDATES]]:
        root = math.exp(float(brentq(imaginary, math.log(grid[k]), math.log(grid[k + 1]), xtol=1e-14)))
        limits.append(GainLimit(kp=1.0 / float(abs(loop(np.array([root]))[0])), frequency=root))
    return min(limits, key=lambda limit: limit.kp) if limits else NoGainLimit(searched_to=high)
