"""Many small linear systems at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def solve_each(matrices: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solve many small linear systems; a singular one by least squares, one with entries that are not finite gives NaN.

    Args:
        matrices: square, over the last two axes.
        right: right-hand sides, over the last axis, or over the last two for several at once.

    Returns:
        Solutions in the shape of `right`.
    """
    columns = right if right.ndim == matrices.ndim else right[..., None]
    size = matrices.shape[-1]
    finite = np.all(np.isfinite(matrices), axis=(-2, -1))
    usable = np.where(finite[..., None, None], matrices, np.eye(size))
    try:
        solutions = np.linalg.solve(usable, columns)
    except np.linalg.LinAlgError:
        solutions = np.linalg.pinv(usable) @ columns
    solutions = np.where(finite[..., None, None], solutions, np.nan)
    return solutions if right.ndim == matrices.ndim else solutions[..., 0]


def invert_each(matrices: NDArray[Any]) -> NDArray[Any]:
    """Invert many small matrices; of singular ones the pseudo-inverse is given, of one with entries that are not finite NaN."""
    finite = np.all(np.isfinite(matrices), axis=(-2, -1))
    usable = np.where(finite[..., None, None], matrices, np.eye(matrices.shape[-1]))
    try:
        inverses = np.linalg.inv(usable)
    except np.linalg.LinAlgError:
        inverses = np.linalg.pinv(usable)
    return np.where(finite[..., None, None], inverses, np.nan)
