"""A fit of a transfer function in scaled units: its errors and their derivatives.

Everything is scaled: s by the middle of the frequency range, the data by its largest magnitude. Parameters stand in the order
b_0 .. b_m, a_1 .. a_n, and the delay where it is free; a_0 is 1.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from revline.lti.response import Complexes, Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """A fit in scaled units: s in units of `frequency`, the response in units of `gain`; weighted data have length 1.

    `powers` holds the powers of s from 0 on as rows, as many as any of the polynomials has coefficients; `weighted` and `wanted` are
    these and the values times the weights.
    """

    s: Complexes
    powers: Complexes
    weighted: Complexes
    values: Complexes
    wanted: Complexes
    weights: Floats
    zeros: int
    poles: int
    free_delay: int
    frequency: float
    gain: float
    weight: float

    @property
    def cost_unit(self) -> float:
        """What one scaled unit of the sum of squares is."""
        return (self.gain * self.weight) ** 2

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.zeros + 1 + self.poles + self.free_delay

    @property
    def units(self) -> Floats:
        """What one scaled unit of each parameter is."""
        top = self.gain * self.frequency ** -np.arange(self.zeros + 1.0)
        bottom = self.frequency ** -np.arange(1.0, self.poles + 1.0)
        return np.concatenate([top, bottom, np.full(self.free_delay, 1.0 / self.frequency)])

    def split(self, x: Floats) -> tuple[Floats, Floats, float]:
        """Take a parameter vector apart: numerator, denominator with its leading 1, delay."""
        cut = self.zeros + 1
        return x[:cut], np.concatenate([np.ones(1), x[cut : cut + self.poles]]), float(x[-1]) if self.free_delay else 0.0

    def polynomial(self, coefficients: Floats) -> Complexes:
        """A polynomial in s, by ascending coefficients, at each frequency."""
        return np.asarray(coefficients @ self.powers[: coefficients.size])

    def model(self, x: Floats) -> Complexes:
        """The model's response."""
        cut = self.zeros + 1
        return np.asarray((x[:cut] @ self.powers[:cut]) * self._factors(x)[0])

    def _factors(self, x: Floats) -> tuple[Complexes, Complexes]:
        """exp(-s delay) / denominator, and 1 / denominator."""
        cut = self.zeros + 1
        inverse = 1.0 / (1.0 + x[cut : cut + self.poles] @ self.powers[1 : self.poles + 1])
        return (np.exp(-self.s * x[-1]) * inverse if self.free_delay else inverse), inverse

    def residuals(self, x: Floats) -> Floats:
        """Weighted errors, real and imaginary part by turns."""
        cut = self.zeros + 1
        errors = (x[:cut] @ self.weighted[:cut]) * self._factors(x)[0] - self.wanted
        return np.asarray(errors.view(float))

    def jacobian(self, x: Floats) -> Floats:
        """Derivatives of the residuals, exact."""
        return self.both(x)[1]

    def both(self, x: Floats) -> tuple[Floats, Floats]:
        """Residuals and their derivatives."""
        cut = self.zeros + 1
        factor, inverse = self._factors(x)
        response = (x[:cut] @ self.weighted[:cut]) * factor
        rows = np.empty((self.size, self.s.size), dtype=complex)
        np.multiply(factor, self.weighted[:cut], out=rows[:cut])
        np.multiply(-response * inverse, self.powers[1 : self.poles + 1], out=rows[cut : cut + self.poles])
        if self.free_delay:
            rows[-1] = -self.s * response
        return np.asarray((response - self.wanted).view(float)), np.asarray(rows.view(float).T)


def make_problem(omega: Floats, values: Complexes, weights: Floats, zeros: int, poles: int, free_delay: int) -> Problem:
    """Scale a fit.

    Args:
        omega: frequencies in rad/s.
        values: response at each, not all zero.
        weights: weight of each error, before it is squared.
        zeros: degree of the numerator.
        poles: degree of the denominator.
        free_delay: 1 where the delay is a parameter, else 0.
    """
    used = omega[omega > 0.0]
    frequency = math.sqrt(float(used[0]) * float(used[-1])) if used.size else 1.0
    gain = float(np.abs(values).max())
    # The largest weight first, so that the squares of extreme ones do not overflow.
    weight = float(weights.max())
    weight *= float(np.linalg.norm(weights / weight * np.abs(values / gain)))
    s = np.asarray(1j * omega / frequency, dtype=complex)
    powers, scaled, relative = np.asarray(s ** np.arange(max(zeros, poles) + 1)[:, None], dtype=complex), values / gain, weights / weight
    return Problem(
        s=s,
        powers=powers,
        weighted=relative * powers,
        values=scaled,
        wanted=np.asarray(relative * scaled, dtype=complex),
        weights=relative,
        zeros=zeros,
        poles=poles,
        free_delay=free_delay,
        frequency=frequency,
        gain=gain,
        weight=weight,
    )


def stack_parts(rows: NDArray[Any]) -> Floats:
    """Real and imaginary parts of complex equations by turns, from one row for each unknown."""
    return np.asarray(np.ascontiguousarray(rows).view(float).T)
