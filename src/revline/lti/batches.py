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
    finite = np.isfinite(matrices).all(axis=(-2, -1))
    whole = bool(finite.all())
    usable = matrices if whole else np.where(finite[..., None, None], matrices, np.eye(matrices.shape[-1]))
    try:
        solutions = np.linalg.solve(usable, columns)
    except np.linalg.LinAlgError:
        solutions = _solve_some_singular(usable, columns)
    if not whole:
        solutions = np.where(finite[..., None, None], solutions, np.nan)
    return solutions if right.ndim == matrices.ndim else solutions[..., 0]


def _solve_some_singular(matrices: NDArray[Any], columns: NDArray[Any]) -> NDArray[Any]:
    """Solve by least squares what is singular to the last bit, and the others as they are."""
    shape = np.broadcast_shapes(matrices.shape[:-2], columns.shape[:-2])
    matrices = np.broadcast_to(matrices, (*shape, *matrices.shape[-2:]))
    columns = np.broadcast_to(columns, (*shape, *columns.shape[-2:]))
    singular = np.linalg.slogdet(matrices)[0] == 0.0
    solutions = np.empty(columns.shape, dtype=np.result_type(matrices, columns))
    solutions[singular] = np.linalg.pinv(matrices[singular]) @ columns[singular]
    solutions[~singular] = np.linalg.solve(matrices[~singular], columns[~singular])
    return solutions


def invert_each(matrices: NDArray[Any]) -> NDArray[Any]:
    """Invert many small matrices; of singular ones the pseudo-inverse is given, of one with entries that are not finite NaN."""
    finite = np.all(np.isfinite(matrices), axis=(-2, -1))
    usable = np.where(finite[..., None, None], matrices, np.eye(matrices.shape[-1]))
    try:
        inverses = np.linalg.inv(usable)
    except np.linalg.LinAlgError:
        inverses = np.linalg.pinv(usable)
    return np.where(finite[..., None, None], inverses, np.nan)
