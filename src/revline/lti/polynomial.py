"""Real polynomials in ascending powers: values, roots, and the Newton form that time responses are built on."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.errors import InvalidInputError

Complexes = NDArray[np.complex128]
Coefficients = tuple[float, ...]

_POLISH_STEPS = 8

_CLUSTERED = 0.03
"""Roots nearer to another, relative to their size, stay as they are: polished each by itself, they would be roots of another polynomial."""


def trim_coefficients(coefficients: Iterable[float], what: str) -> Coefficients:
    """Check coefficients and drop the zeros at the highest powers.

    Args:
        coefficients: ascending powers.
        what: name of the polynomial, for messages.

    Returns:
        At least one coefficient; the last is not zero, unless the polynomial is zero.

    Raises:
        InvalidInputError: there is none, or one is not finite.
    """
    values = tuple(float(c) for c in coefficients)
    if not values or not all(math.isfinite(c) for c in values):
        message = f"{what} coefficients {values} are not usable; give at least one, all finite, in ascending powers of s"
        raise InvalidInputError(message)
    length = max((k + 1 for k, c in enumerate(values) if c != 0.0), default=1)
    return values[:length]


def polynomial_values(coefficients: ArrayLike, s: ArrayLike) -> Complexes:
    """Evaluate a polynomial by Horner's scheme.

    Args:
        coefficients: ascending powers.
        s: complex numbers of any shape.
    """
    points, c = np.asarray(s, dtype=complex), np.asarray(coefficients, dtype=float).tolist()
    total = np.full(points.shape, complex(c[-1]))
    for entry in c[-2::-1]:
        total = total * points + entry
    return total


def polynomial_roots(coefficients: ArrayLike) -> Complexes:
    """Find all roots: eigenvalues of the scaled companion matrix, polished by Newton's method where no other is near.

    Each root meets the polynomial to a few units of rounding, relative to the sum of the magnitudes of its terms there; a multiple root
    comes as a cluster, whose members may be off by far more but whose product of factors is the polynomial's.

    Args:
        coefficients: ascending powers, the last not zero.

    Returns:
        The roots by rising magnitude, conjugate pairs together (negative imaginary part first).

    Source:
        Edelman and Murakami (1995), Mathematics of Computation 64, 763-776 (companion matrix, backward stability).
    """
    c = np.asarray(coefficients, dtype=float)
    zeros = int(np.flatnonzero(c)[0])
    c = c[zeros:]
    degree = c.size - 1
    if degree == 0:
        return np.zeros(zeros, dtype=complex)
    # The unit of s is the geometric mean of the roots: coefficients of far apart sizes become comparable.
    unit_log = (math.log(abs(c[0])) - math.log(abs(c[-1]))) / degree
    exponent = np.log(np.abs(np.where(c == 0.0, 1.0, c))) + np.arange(degree + 1) * unit_log
    with np.errstate(over="ignore"):
        unit = np.exp(unit_log)
        monic = np.where(c == 0.0, 0.0, np.sign(c) * np.sign(c[-1]) * np.exp(exponent - exponent[-1]))
    if not np.all(np.isfinite([unit, *monic])):
        message = f"polynomial coefficients {c.tolist()} are too far apart to find roots of; use another unit of time"
        raise InvalidInputError(message)
    companion = np.diag(np.ones(degree - 1), -1)
    companion[:, -1] = -monic[:-1]
    raw = np.asarray(np.linalg.eigvals(companion), dtype=complex)
    gaps = np.min(np.abs(raw[:, None] - raw) + np.where(np.eye(degree) > 0.0, np.inf, 0.0), axis=1, initial=np.inf)
    alone = gaps > _CLUSTERED * np.abs(raw)
    plain = monic.tolist()
    upper = np.array([_polish(plain, complex(z)) if free else complex(z) for z, free in zip(raw, alone, strict=True) if z.imag >= 0.0])
    found = unit * np.concatenate([upper, np.conj(upper[upper.imag > 0.0])])
    return np.concatenate([np.zeros(zeros, dtype=complex), found[np.lexsort((found.imag, np.abs(found)))]])


def _polish(coefficients: list[float], root: complex) -> complex:
    """Take Newton steps for as long as they bring the polynomial closer to zero."""
    try:
        value, slope = _value_and_slope(coefficients, root)
        for _ in range(_POLISH_STEPS):
            better = root - value / slope
            better_value, slope = _value_and_slope(coefficients, better)
            if not abs(better_value) < abs(value):
                break
            root, value = better, better_value
    except (ZeroDivisionError, OverflowError):  # as good as it gets
        return root
    return root


def _value_and_slope(coefficients: list[float], s: complex) -> tuple[complex, complex]:
    """A polynomial and its derivative at one number, by Horner's scheme."""
    value, slope = complex(coefficients[-1]), 0.0j
    for entry in coefficients[-2::-1]:
        slope = slope * s + value
        value = value * s + entry
    return value, slope


def newton_form(numerator: ArrayLike, poles: Complexes) -> Complexes:
    """Write numerator / prod(s - p_i) as sum of c_k / prod(s - p_1) .. (s - p_k), by repeated division.

    Args:
        numerator: ascending powers, of a degree below the number of poles.
        poles: the poles, in any order.

    Returns:
        c_1 .. c_n.
    """
    quotient = np.array(numerator, dtype=complex)
    result = np.zeros(poles.size, dtype=complex)
    for k in range(poles.size - 1, -1, -1):
        carry = 0.0 + 0.0j
        below = np.zeros(max(quotient.size - 1, 0), dtype=complex)
        for power in range(quotient.size - 1, -1, -1):
            carry = quotient[power] + poles[k] * carry
            if power > 0:
                below[power - 1] = carry
        result[k] = carry
        quotient = below
    return result
