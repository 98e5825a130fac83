"""Right-most characteristic roots of many linear delay systems at once."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from revline.errors import RevlineError
from revline.lti.feedback import FeedbackBlock, feedback_blocks, stack_blocks
from revline.lti.response import Floats
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

LARGEST = 1e50
"""A system with larger entries is looked at alone."""

MOST_TURNS = 2000.0
"""A system whose phase may turn by more along a line, in rad, is counted alone: that takes long, and is not to be done twice."""

Looked = Mapping[int, Listed]
"""Roots refined, by degrees."""


def characteristic_roots_each(systems: Sequence[DelayStateSpace], *, count: int = 6) -> tuple[RightmostRoots | RevlineError, ...]:
    """Find the right-most roots of many systems as `characteristic_roots` does of one, with the same checks of each.

    What settles with the first two degrees, and is confirmed by the argument principle at the first look, is found together; with any
    other system one goes on alone from there.

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
            if block.lags.size and block.states and not np.any(block.D) and _is_usual(block):
                alike.setdefault((block.states, block.lags.size), []).append((k, j))
    found: dict[tuple[int, int], RightmostRoots | Looked] = {}
    for places in alike.values():
        settled = _settled_at_once(stack_blocks([parts[k][j] for k, j in places]), count)
        found.update(zip(places, settled, strict=True))
    return tuple(_joined(blocks, [found.get((k, j), {}) for j in range(len(blocks))], count) for k, blocks in enumerate(parts))


def _joined(blocks: Sequence[FeedbackBlock], known: Sequence[RightmostRoots | Looked], count: int) -> RightmostRoots | RevlineError:
    try:
        alone = (
            entry if isinstance(entry, RightmostRoots) else block_roots(block, count, entry)
            for block, entry in zip(blocks, known, strict=True)
        )
        return join_roots(list(alone), count)
    except RevlineError as error:
        return error


def _settled_at_once(blocks: FeedbackBlock, count: int) -> list[RightmostRoots | Looked]:
    """Roots of many blocks of one shape; for a block that takes more than the first look, what was found by degrees."""
    radii = blocks.radii(np.zeros(len(blocks.lags)))
    degrees = first_degrees(radii, np.max(blocks.lags, axis=-1))
    finer = (1.5 * degrees).astype(int)
    before, now = _refined(blocks, degrees, count), _refined(blocks, finer, count)
    looked: list[RightmostRoots | Looked] = [
        {int(degree): first, int(more): second} for degree, first, more, second in zip(degrees, before, finer, now, strict=True)
    ]
    slow = radii * np.sum(blocks.lags, axis=-1) < MOST_TURNS
    rows = np.array([k for k, entry in enumerate(now) if slow[k] and _is_settled(before[k], entry)], dtype=int)
    right = _counted(blocks, rows, np.array([line_right_of(now[k].roots) for k in rows]))
    rows = rows[right == 0]
    unstable = np.array([int(np.sum(now[k].roots.real > axis_widths(now[k].roots))) for k in rows], dtype=int)
    counted = np.zeros(rows.size, dtype=int)
    counted[unstable > 0] = _counted(blocks, rows[unstable > 0], np.zeros(np.count_nonzero(unstable)))
    for k, listed in zip(rows[counted == unstable].tolist(), unstable[counted == unstable].tolist(), strict=True):
        looked[k] = _record(now[k], listed, int(finer[k]))
    return looked


def _is_settled(before: Listed, now: Listed) -> bool:
    """Whether two degrees have the same roots, none of them on the imaginary axis."""
    if not (now.roots.size and settled_roots(before, now) == now.roots.size == before.roots.size):
        return False
    return not np.any(np.abs(now.roots.real) <= axis_widths(now.roots))


def _counted(blocks: FeedbackBlock, rows: NDArray[np.int64], lines: Floats) -> NDArray[np.int64]:
    """Roots of some blocks right of a line of each."""
    return blocks.rows(rows).count_right_of_each(lines) if rows.size else np.zeros(0, dtype=int)


def _is_usual(block: FeedbackBlock) -> bool:
    """Whether no product of its entries and of the decays on a line can leave the range of numbers, which would spoil all others."""
    return all(float(np.max(np.abs(part), initial=0.0)) < LARGEST for part in (block.A, block.B, block.C))


def _refined(blocks: FeedbackBlock, degrees: NDArray[np.int64], count: int) -> list[Listed]:
    """Refine the roots of each block with its own degree."""
    found: dict[int, Listed] = {}
    for degree in np.unique(degrees):
        (rows,) = np.nonzero(degrees == degree)
        found.update(zip(rows.tolist(), refine_roots(blocks.rows(rows), int(degree), count), strict=True))
    return [found[k] for k in range(len(degrees))]


def _record(entry: Listed, unstable: int, degree: int) -> RightmostRoots:
    return RightmostRoots(roots=entry.roots, residuals=entry.residuals, errors=entry.errors, unstable_count=unstable, degree=degree)
