"""Time responses of rational transfer functions, exact at any times, for poles that are equal, close or far apart."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from revline.errors import InvalidInputError
from revline.lti.polynomial import newton_form

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_TAYLOR_TERMS = 18
"""The rest of the exponential's series after so many terms is below rounding for a matrix of norm 1: 1/19! is 8e-18."""


_EVEN_FROM = 8
"""Evenly spaced times are made of two lists of the square root of their number from here on."""


def inverse_laplace(numerator: Sequence[float], poles: Complexes, times: Floats) -> Floats:
    """Transform numerator(s) / prod(s - p_i) back to time; see `inverse_laplace_each`."""
    return inverse_laplace_each((numerator,), poles, times)[0]


def inverse_laplace_each(numerators: Sequence[Sequence[float]], poles: Complexes, times: Floats) -> list[Floats]:
    """Transform some numerators over the same prod(s - p_i) back to time.

    The answer is a sum of divided differences of exp(t .) over the poles. Partial fractions would cancel where poles are close.

    Args:
        numerators: each by ascending powers, of a degree below the number of poles.
        poles: in 1/s, conjugates in pairs.
        times: in s, none negative.

    Returns:
        For each numerator the value at each time.

    Raises:
        InvalidInputError: the answer grew beyond the range of numbers.

    Source:
        Opitz (1964), ZAMM 44, T52-T54: divided differences of a function are the first row of that function of a bidiagonal matrix.
    """
    if poles.size == 0 or times.size == 0:
        return [np.zeros(times.shape) for _ in numerators]
    # Fast poles first: the slow ones then weigh on what the fast ones have already made small, and nothing cancels.
    ordered = poles[np.argsort(-np.abs(poles), kind="stable")]
    # Couplings of the size of the poles keep the bidiagonal matrix balanced; `undo` takes them out again.
    size = np.abs(ordered)
    coupling = np.maximum(size[1:], 1e-3 * (float(size.max()) or 1.0))
    undo = np.concatenate([np.ones(1), np.cumprod(1.0 / coupling)])
    with np.errstate(all="ignore"):
        row = _first_row(ordered, coupling, times.ravel())
        weights = [newton_form(numerator, ordered) * undo for numerator in numerators]
        # A sum, not @: for so few poles the threads that a matrix product wakes cost a hundred times the product.
        answers = [np.asarray(np.sum(weight[:, None] * row, axis=0).real.reshape(times.shape)) for weight in weights]
    if not all(np.all(np.isfinite(answer)) for answer in answers):
        message = f"the response exceeds the range of numbers within {float(np.max(times)):g} s; ask for earlier times"
        raise InvalidInputError(message)
    return answers


def _first_row(diagonal: Complexes, coupling: Floats, times: Floats) -> Complexes:
    """First row of exp(t A) for each time; for times evenly apart from two short lists, as exp((a + b) A) = exp(a A) exp(b A).

    The product adds divided differences of one sign, as squaring does.
    """
    count = math.isqrt(times.size)
    if count < _EVEN_FROM:
        return np.asarray(_bidiagonal_exponential(diagonal, coupling, times)[0])
    early, late = times[:count] - times[0], times[::count]
    sums = (late[:, None] + early).ravel()[: times.size]
    if np.any(early < 0.0) or np.any(np.abs(sums - times) > 4.0 * np.finfo(float).eps * times[-1]):
        return np.asarray(_bidiagonal_exponential(diagonal, coupling, times)[0])
    both = _bidiagonal_exponential(diagonal, coupling, np.concatenate([late, early]))
    rows, matrices = both[0, :, : late.size], both[:, :, late.size :]
    result = np.empty((diagonal.size, late.size, early.size), dtype=complex)
    for j in range(diagonal.size):
        result[j] = np.sum(rows[: j + 1, :, None] * matrices[: j + 1, j, None, :], axis=0)
    return result.reshape(diagonal.size, -1)[:, : times.size]


def _bidiagonal_exponential(diagonal: Complexes, coupling: Floats, times: Floats) -> Complexes:
    """exp(t A) for each time, by scaling and squaring with the diagonal kept exact; the times are the last axis.

    With an exact diagonal, squaring adds divided differences of one sign where the poles are real: no digit is lost, however many
    squarings a stiff matrix needs.

    Source:
        Al-Mohy and Higham (2009), SIAM J. Matrix Anal. Appl. 31, 970-989, fragment 2.1 (exact diagonal).
    """
    norm = float(np.max(times)) * float(np.max(np.abs(diagonal) + np.append(coupling, 0.0)))
    squarings = max(0, math.ceil(math.log2(norm))) if norm > 0.0 else 0
    step = times / 2.0**squarings
    size = diagonal.size
    result = np.zeros((size, size, times.size), dtype=complex)
    index = np.arange(size)
    result[index, index] = 1.0
    own, next_one = diagonal[:, None, None], coupling[:, None, None]
    for k in range(_TAYLOR_TERMS, 0, -1):
        grown = own * result
        grown[:-1] += next_one * result[1:]
        grown *= step / k
        grown[index, index] += 1.0
        result = grown
    for _ in range(squarings):
        step = 2.0 * step
        result = _square_triangular(result)
        result[index, index] = np.exp(step * diagonal[:, None])
    return result


def _square_triangular(matrix: Complexes) -> Complexes:
    """Square upper triangular matrices; the last axis counts them."""
    square = np.zeros_like(matrix)
    for k in range(matrix.shape[0]):
        square[: k + 1, k:] += matrix[: k + 1, k, None] * matrix[None, k, k:]
    return square
