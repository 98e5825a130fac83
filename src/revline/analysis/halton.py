"""Points spread evenly over a cube."""

import numpy as np

from revline.system import Floats

PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53)


def halton(count: int, dimensions: int) -> Floats:
    """Spread points evenly over the unit cube.

    Args:
        count: how many.
        dimensions: of the cube; beyond 16 the sequences repeat, shifted.

    Returns:
        Array of shape (count, dimensions), values above 0 and below 1.

    Source:
        Halton (1960), Numerische Mathematik 2, 84-90.
    """
    points = np.empty((count, dimensions))
    for axis in range(dimensions):
        base = PRIMES[axis % len(PRIMES)]
        digits, fraction = np.arange(1, count + 1) + 7 * (axis // len(PRIMES)), 1.0
        values = np.zeros(count)
        while np.any(digits > 0):
            fraction /= base
            values += fraction * (digits % base)
            digits //= base
        points[:, axis] = values
    return points
