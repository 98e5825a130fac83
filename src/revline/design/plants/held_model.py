"""A transfer function with delay from sample to sample of a held input, in closed form.

With the total delay m T + part, 0 <= part < T, an output held over a period reaches the plant in two pieces, one of each of two periods:

    x(k + 1) = F x(k) + G0 u(k - m) + G1 u(k - m - 1),   F = e^(A T),
    G0 = integral of e^(A t) B over T - part,   G1 = e^(A (T - part)) times the integral of e^(A t) B over part

Source: Astrom and Wittenmark (1997), Computer-Controlled Systems, section 2.3.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from revline.lti.transfer_function import TransferFunction

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Held = Callable[[Floats, float, float], Complexes]
"""From frequencies in rad/s of shape (n,), the period and a computation delay in s: the answer from sample to sample, shape (n,)."""

WHOLE = 1e-9
"""A delay this part of a period short of a whole number of periods is that number."""


def held_model(model: TransferFunction) -> Held:
    """Make the function that answers from sample to sample for a model.

    Args:
        model: strictly proper.
    """
    order = len(model.denominator) - 1
    scale = model.denominator[-1]
    below = np.array(model.denominator[:-1]) / scale
    rate = np.zeros((order, order))
    rate[:-1, 1:] = np.eye(order - 1)
    rate[-1] = -below
    out = np.zeros(order)
    out[: len(model.numerator)] = np.array(model.numerator) / scale

    def held(omega: Floats, period: float, computation: float) -> Complexes:
        periods = (model.delay + computation) / period
        whole = math.floor(periods + WHOLE)
        part = max(periods - whole, 0.0) * period
        late, early = _step(rate, period - part), _step(rate, part)
        turn = np.exp(1j * omega * period)
        matrices = turn[:, None, None] * np.eye(order) - (late[0] @ early[0])
        drive = late[1] * turn[:, None] ** -whole + (late[0] @ early[1]) * turn[:, None] ** (-whole - 1)
        return np.asarray((np.linalg.solve(matrices, drive[:, :, None])[:, :, 0]) @ out)

    return held


def _step(rate: Floats, time: float) -> tuple[Floats, Floats]:
    """Transition over a time, and what a held input of one adds to the state."""
    order = len(rate)
    whole = np.zeros((order + 1, order + 1))
    whole[:order, :order], whole[order - 1, order] = rate, 1.0
    grown = np.asarray(expm(whole * time))
    return grown[:order, :order], grown[:order, order]
