"""Series of numbers for drawing: thinned so that no extreme is lost, finite, and no longer than a plot can show."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

MOST: Final = 800
"""So many points of a series at most are drawn."""

DIGITS: Final = 7
"""Significant digits of what is only drawn."""


def thin(times: ArrayLike, *series: ArrayLike, most: int = MOST) -> tuple[Floats, ...]:
    """Thin series over one axis: of each stretch the points at which any of them is lowest and highest are kept.

    Args:
        times: the axis, rising, shape (n,).
        series: over it, each of shape (n,).
        most: points that are kept at most.

    Returns:
        The axis and the series at the points kept.
    """
    axis = np.asarray(times, dtype=float)
    columns = [np.asarray(one, dtype=float) for one in series]
    if axis.size <= most:
        return axis, *columns
    stretches = max(1, (most - 2) // (2 * max(1, len(columns))))
    edges = np.linspace(0, axis.size, stretches + 1).astype(int)
    starts, widths = edges[:-1], np.diff(edges)
    # Stretches of one length side by side, the shorter ones filled up with their own last value.
    at = starts[:, None] + np.minimum(np.arange(int(widths.max())), widths[:, None] - 1)
    kept = [np.array([0, axis.size - 1])]
    for column in columns:
        kept += [starts + np.argmin(column[at], axis=1), starts + np.argmax(column[at], axis=1)]
    chosen = np.unique(np.concatenate(kept))
    return axis[chosen], *(column[chosen] for column in columns)


def drawn(values: ArrayLike) -> list[float]:
    """Give numbers as a list for drawing, rounded to seven digits."""
    array = np.asarray(values, dtype=float)
    if not array.size:
        return []
    with np.errstate(divide="ignore"):
        size = np.where(array == 0.0, 0.0, np.floor(np.log10(np.abs(array))))
    scale = 10.0 ** (DIGITS - 1 - size)
    rounded: list[float] = np.where(np.isfinite(scale), np.round(array * scale) / scale, array).tolist()
    return rounded
