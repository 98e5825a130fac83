"""Answers of linear systems to inputs that are straight between even samples, from their step response.

An input that moves by d from sample k to k + 1 adds d times the mean of the step response over the time since then; the sum over all
moves is a convolution. The mean is taken by the trapezoidal rule, its error of the second order in the distance of samples.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import fftconvolve

Floats = NDArray[np.float64]


def answer_to_samples(step_response: ArrayLike, values: ArrayLike) -> Floats:
    """Answer of a linear system, at rest before, to an input.

    Args:
        step_response: its answer to a unit step at the times 0, h, 2 h, ..., shape (m,); where it is shorter than the input, its last
            value is held: it must have settled.
        values: of the input at these times as differences from rest, shape (n,); before the first it has the first's value.

    Returns:
        The answer as a difference from the rest that belongs to the first value, shape (n,).
    """
    u, s = np.asarray(values, dtype=float), np.asarray(step_response, dtype=float)
    if s.size < u.size:
        s = np.concatenate((s, np.full(u.size - s.size, s[-1])))
    answer = np.zeros(u.size)
    answer[1:] = fftconvolve(np.diff(u), 0.5 * (s[1 : u.size] + s[: u.size - 1]))[: u.size - 1]
    return answer
