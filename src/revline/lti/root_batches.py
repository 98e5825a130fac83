"""Right-most characteristic roots of many linear delay systems at once."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from revline.errors import RevlineError
from revline.lti.feedback import FeedbackBlock, feedback_blocks, stack_blocks
from revline.lti.roots import (
    Listed,
    RightmostRoots,
    axis_widths,
    block_roots,
    first_degrees,
    join_roots,
    line_right_of,
    refine_roots,
    settled_roots,
)
from revline.lti.state_space import DelayStateSpace


def characteristic_roots_each(systems: Sequence[DelayStateSpace], *, count: int = 6) -> tuple[RightmostRoots | RevlineError, ...]:
    """Find the right-most roots of many systems as `characteristic_roots` does of one, with the same checks of each.

    What settles with the first two degrees, and is confirmed by the argument principle at the first look, is found together; any
    other system is then looked at alone.

    Args:
        systems: linear systems with delay channels, as a rule one model at many points.
        count: how many roots to list of each.

    Returns:
        For each system its roots, or the error that `characteristic_roots` raises for it.
    """
    parts = [tuple(feedback_blocks(system)) for system in systems]
    alike: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for k, blocks in enumerate(parts):
        for j, block in enumerate(blocks):
            if block.lags.size and block.states and not np.any(block.D):
                alike.setdefault((block.states, block.lags.size), []).append((k, j))
    found: dict[tuple[int, int], RightmostRoots] = {}
    for places in alike.values():
        settled = _settled_at_once(stack_blocks([parts[k][j] for k, j in places]), count)
        found.update((place, roots) for place, roots in zip(places, settled, strict=True) if isinstance(roots, RightmostRoots))
    return tuple(_joined(blocks, [found.get((k, j)) for j in range(len(blocks))], count) for k, blocks in enumerate(parts))


def _joined(blocks: Sequence[FeedbackBlock], known: Sequence[RightmostRoots | None], count: int) -> RightmostRoots | RevlineError:
    try:
        return join_roots([roots or block_roots(block, count) for block, roots in zip(blocks, known, strict=True)], count)
    except RevlineError as error:
        return error


def _settled_at_once(blocks: FeedbackBlock, count: int) -> list[RightmostRoots | tuple[()]]:
    """Roots of many blocks of one shape; nothing for a block that takes more than the first look."""
    degrees = first_degrees(blocks.radii(np.zeros(len(blocks.lags))), np.max(blocks.lags, axis=-1))
    finer = (1.5 * degrees).astype(int)
    before, now = _refined(blocks, degrees, count), _refined(blocks, finer, count)
    lines = np.array([line_right_of(entry.roots) if entry.roots.size else 0.0 for entry in now])
    right = blocks.count_right_of_each(lines)
    unstable = np.array([int(np.sum(entry.roots.real > axis_widths(entry.roots))) for entry in now])
    (some,) = np.nonzero(unstable)
    counted = np.zeros(len(now), dtype=int)
    if some.size:
        counted[some] = blocks.rows(some).count_right_of_each(np.zeros(some.size))
    found: list[RightmostRoots | tuple[()]] = []
    for k, entry in enumerate(now):
        sure = settled_roots(before[k], entry) == entry.roots.size == before[k].roots.size and right[k] == 0
        on_axis = np.any(np.abs(entry.roots.real) <= axis_widths(entry.roots))
        if sure and not on_axis and counted[k] == unstable[k] < entry.roots.size:
            found.append(_record(entry, int(unstable[k]), int(finer[k])))
        else:
            found.append(())
    return found


def _refined(blocks: FeedbackBlock, degrees: NDArray[np.int64], count: int) -> list[Listed]:
    """Refine the roots of each block with its own degree."""
    found: dict[int, Listed] = {}
    for degree in np.unique(degrees):
        (rows,) = np.nonzero(degrees == degree)
        found.update(zip(rows.tolist(), refine_roots(blocks.rows(rows), int(degree), count), strict=True))
    return [found[k] for k in range(len(degrees))]


def _record(entry: Listed, unstable: int, degree: int) -> RightmostRoots:
    return RightmostRoots(roots=entry.roots, residuals=entry.residuals, errors=entry.errors, unstable_count=unstable, degree=degree)
