"""Right-most characteristic roots of linear systems with delays, found without approximating the delays.

A delay channel is a pipe: what enters at one end leaves a lag later at the other. Its contents at Chebyshev points join the states of an
ordinary linear system, whose eigenvalues approach the characteristic roots faster than any power of the number of points. Each is then
refined by Newton on the exact characteristic matrix; what is no root of that is discarded.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.errors import AnalysisError, InvalidInputError, NotConvergedError
from revline.lti.batches import solve_each
from revline.lti.feedback import FeedbackBlock, feedback_blocks, stack_blocks
from revline.lti.response import Complexes, Floats
from revline.lti.state_space import DelayStateSpace
from revline.values import make_read_only

FIRST_DEGREE = 16
LARGEST_DEGREE = 256
LARGEST_MATRIX = 1600
NEWTON_STEPS = 30
MOST_CANDIDATES = 200
MORE_CANDIDATES = 2
"""So many more candidates than roots asked for are refined first; the others only where they could matter."""

STALLED = 4
"""As many degrees in a row with equally many settled roots: more points bring no more."""


RESIDUAL_LIMIT = 1e-12
"""Largest residual of the exact equation, relative to its own size, that a root may have."""

STEP_LIMIT = 1e-10
"""Last Newton step, relative to 1 + |s|, of a simple root; a multiple root stops near the square root of rounding."""

ROUNDED_STEP = 1e-12
"""A step below this, relative to 1 + |s|, that is not much shorter than the one before is rounding."""

MULTIPLE_STEP_LIMIT = 1e-4
LONGEST_MOVE = 1e-2
"""How far Newton may move a root of the matrix, relative to 1 + |s|; one that moves further was not resolved."""

LARGEST_GROWTH = 300.0
"""A candidate so far left that exp(-s lag) is near the end of the number range is none: no matrix of such a degree resolves it."""

SETTLED = 1e-6
"""Roots of two degrees that agree so well, relative to 1 + |s|, are settled."""

AXIS_WIDTH = 1e-9
"""A root this near the imaginary axis, relative to 1 + |s|, is neither stable nor unstable."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RightmostRoots:
    """The characteristic roots furthest to the right, right-most first, each as often as it is multiple.

    Attributes:
        roots: in rad/s, as many as were asked for, or fewer; see `characteristic_roots`.
        residuals: of the exact characteristic equation, relative to its own size.
        errors: how well each root is known, in rad/s: the last Newton step; without delays the smallest singular value of sI - A.
        unstable_count: how many roots lie right of the imaginary axis, listed or not, counted by the argument principle.
        degree: of the polynomials in the delay channels when the roots settled; 0 where no delay takes part.
    """

    roots: Complexes
    residuals: Floats
    errors: Floats
    unstable_count: int
    degree: int

    def __post_init__(self) -> None:
        if np.any(np.diff(self.roots.real) > 0.0):
            message = "roots are not listed from the right-most on; sort them by falling real part"
            raise InvalidInputError(message)
        listed = int(np.sum(self.roots.real > axis_widths(self.roots)))
        if listed > self.unstable_count or (listed < self.roots.size and listed != self.unstable_count):
            message = f"{listed} roots listed right of the imaginary axis, {self.unstable_count} counted; ask for more roots"
            raise InvalidInputError(message, listed=listed, counted=self.unstable_count)
        make_read_only(self)

    @property
    def spectral_abscissa(self) -> float:
        """Real part of the right-most root, in rad/s; minus infinity for a system without roots."""
        return float(np.max(self.roots.real, initial=-math.inf))

    @property
    def stable(self) -> bool:
        """Whether all roots lie left of the imaginary axis."""
        return bool(np.all(self.roots.real < -axis_widths(self.roots)))


def characteristic_roots(system: DelayStateSpace, *, count: int = 6) -> RightmostRoots:
    """Find the right-most characteristic roots of a linear system with delays.

    Channels and states that do not feed back on one another are found from the structure and treated apart, so that a channel fed
    by inputs alone adds no roots. The argument principle, which shares nothing with the collocation but the characteristic matrix,
    confirms that no root lies right of the right-most one, and counts the unstable ones.

    Args:
        system: linear system with delay channels.
        count: how many roots to list; a conjugate pair is not torn. Fewer are listed where there are fewer, or where the others lie so
            far to the left that they drown in rounding.

    Returns:
        The roots, with their residuals in the exact equation.

    Raises:
        InvalidInputError: `count` is not positive.
        AnalysisError: channels feed one another in a loop with a gain of 1 or more and no state between, so that the roots to the right
            may be without number, or with gains beyond the range of numbers.
        NotConvergedError: the roots did not settle, or cannot be counted.

    Source:
        Breda, Maset and Vermiglio (2005), SIAM Journal on Scientific Computing 27(2), 482-495, here in the form of transport equations
        with boundary conditions. Newton for nonlinear eigenvalue problems: Ruhe (1973), SIAM Journal on Numerical Analysis 10(4), 674-689.
    """
    if count < 1:
        message = f"{count} roots asked for; ask for at least 1"
        raise InvalidInputError(message, count=count)
    return join_roots([block_roots(block, count) for block in feedback_blocks(system)], count)


def join_roots(found: Sequence[RightmostRoots], count: int) -> RightmostRoots:
    """List the right-most roots of several parts together."""
    roots = np.concatenate([np.zeros(0, dtype=complex), *(entry.roots for entry in found)])
    order = _from_the_right(roots)[: _kept(roots, count)]
    return RightmostRoots(
        roots=roots[order],
        residuals=np.concatenate([np.zeros(0), *(entry.residuals for entry in found)])[order],
        errors=np.concatenate([np.zeros(0), *(entry.errors for entry in found)])[order],
        unstable_count=sum(entry.unstable_count for entry in found),
        degree=max((entry.degree for entry in found), default=0),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Listed:
    """Roots refined at one degree, right-most first."""

    roots: Complexes
    residuals: Floats
    errors: Floats


def block_roots(block: FeedbackBlock, count: int, known: Mapping[int, Listed] = MappingProxyType({})) -> RightmostRoots:
    """Raise the degree until the right-most roots settle and agree with the argument principle; `known` holds those of some degrees."""
    if not block.lags.size:
        return _eigenvalues(block, count)
    degree = int(first_degrees(block.radius(), np.max(block.lags)))
    before = known[degree] if degree in known else _refined(block, degree, count)
    last, history = False, [0]
    while not last:
        degree = int(1.5 * degree)
        last = degree >= LARGEST_DEGREE or 1.5 * degree * block.lags.size >= LARGEST_MATRIX
        now = known[degree] if degree in known else _refined(block, degree, count)
        history.append(settled_roots(before, now))
        settled = history[-1]
        # Roots far to the left may drown in rounding: when more points bring no more of them, fewer than asked for will do.
        enough = settled == now.roots.size == before.roots.size or (settled and (last or history[-STALLED:] == [settled] * STALLED))
        if enough and _is_rightmost(block, now.roots):
            kept = Listed(roots=now.roots[:settled], residuals=now.residuals[:settled], errors=now.errors[:settled])
            listed, counted, complete = _count_unstable(block, kept.roots)
            if listed == counted or (listed < counted and not complete):
                return RightmostRoots(roots=kept.roots, residuals=kept.residuals, errors=kept.errors, unstable_count=counted, degree=degree)
        before = now
    message = (
        f"the right-most roots did not settle with {degree} points in each delay channel; the longest lag, "
        f"{np.max(block.lags):.3g} s, is too long for states as fast as {block.radius():.3g} rad/s: leave out what is so fast"
    )
    raise NotConvergedError(message, degree=degree)


def first_degrees(radii: ArrayLike, longest: ArrayLike) -> NDArray[np.int64]:
    """Degrees that a first look at blocks is taken with, from the bound of their roots and their longest lags."""
    wanted = 0.5 * np.asarray(radii) * np.asarray(longest) + FIRST_DEGREE
    return np.minimum(wanted, 4.0 * FIRST_DEGREE).astype(int)


def _eigenvalues(block: FeedbackBlock, count: int) -> RightmostRoots:
    """Roots of a part without delays."""
    roots = np.linalg.eigvals(block.A).astype(complex)
    roots = roots[_from_the_right(roots)]
    smallest: Floats = np.linalg.svd(block.characteristic(roots)[0], compute_uv=False)[:, -1].astype(float)
    keep = _kept(roots, count)
    return RightmostRoots(
        roots=roots[:keep],
        residuals=smallest[:keep] / max(float(np.linalg.norm(block.A)), 1e-300),
        errors=smallest[:keep],
        unstable_count=int(np.sum(roots.real > axis_widths(roots))),
        degree=0,
    )


def settled_roots(before: Listed, now: Listed) -> int:
    """How many of the right-most roots were there before, as well as both are known; a pair is not torn."""
    gaps = np.min(np.abs(now.roots[:, None] - before.roots[None, :]), axis=1, initial=np.inf)
    same = gaps <= np.maximum(SETTLED * (1.0 + np.abs(now.roots)), 10.0 * now.errors)
    first = int(np.argmin(same)) if not np.all(same) else same.size
    while np.sum(np.sign(now.roots[:first].imag)) != 0.0:
        first -= 1
    return first


def _is_rightmost(block: FeedbackBlock, roots: Complexes) -> bool:
    """Whether no root lies right of those listed; where that cannot be followed left of the axis, whether none does right of it."""
    if not roots.size:
        return block.count_right_of(0.0) == 0
    line = line_right_of(roots)
    try:
        return block.count_right_of(line) == 0
    except AnalysisError:
        if line >= 0.0:
            raise
        return block.count_right_of(0.0) == 0


def line_right_of(roots: Complexes) -> float:
    """Where a line close right of all roots crosses the real axis, in rad/s."""
    rightmost = float(np.max(roots.real))
    return rightmost + 1e-2 * abs(rightmost) + float(np.max(axis_widths(roots)))


def _count_unstable(block: FeedbackBlock, roots: Complexes) -> tuple[int, int, bool]:
    """Unstable roots listed, those counted, and whether the list reaches past them; nothing lies right of the list."""
    unstable = roots.real > axis_widths(roots)
    listed, complete = int(np.sum(unstable)), not np.all(unstable)
    if not listed:
        return 0, 0, complete
    on_axis = np.any(~unstable & (roots.real >= -axis_widths(roots)))
    line = 0.5 * float(np.min(roots.real[unstable])) if on_axis else 0.0
    return listed, block.count_right_of(line), complete


def _collocation_roots(blocks: FeedbackBlock, degree: int) -> Complexes:
    """Eigenvalues with the contents of each channel held at Chebyshev points, of which the first is what enters; one row a block."""
    n, m = blocks.states, blocks.lags.shape[-1]
    slopes = differentiation_matrix(degree)
    matrix = np.zeros((len(blocks.lags), n + m * degree, n + m * degree))
    ends = n + degree * np.arange(1, m + 1) - 1
    matrix[:, :n, :n] = blocks.A
    matrix[:, :n, ends] = blocks.B
    for k in range(m):
        rows = slice(n + k * degree, n + (k + 1) * degree)
        scaled = (2.0 / blocks.lags[:, k])[:, None, None] * slopes[1:]
        matrix[:, rows, rows] = scaled[..., 1:]
        matrix[:, rows, :n] += scaled[..., :1] * blocks.C[:, None, k]
        matrix[:, rows, ends] += scaled[..., :1] * blocks.D[:, None, k]
    return np.linalg.eigvals(matrix).astype(complex)


@functools.cache
def differentiation_matrix(degree: int) -> Floats:
    """Build the matrix that differentiates a polynomial given at the Chebyshev points cos(k pi / degree), from 1 down to -1.

    Args:
        degree: of the polynomial.

    Returns:
        Read-only square matrix of degree + 1 rows.

    Source:
        Trefethen (2000), Spectral Methods in MATLAB, chapter 6.
    """
    k = np.arange(degree + 1)
    points = np.cos(np.pi * k / degree)
    weights = np.where((k == 0) | (k == degree), 2.0, 1.0) * (-1.0) ** k
    gaps = points[:, None] - points[None, :] + np.eye(degree + 1)
    matrix: Floats = np.outer(weights, 1.0 / weights) / gaps
    matrix -= np.diag(np.sum(matrix, axis=1))
    matrix.setflags(write=False)
    return matrix


def _refined(block: FeedbackBlock, degree: int, count: int) -> Listed:
    (found,) = refine_roots(stack_blocks((block,)), degree, count)
    return found


def refine_roots(blocks: FeedbackBlock, degree: int, count: int) -> list[Listed]:
    """Find candidates with one degree, refine them by Newton, keep those that are roots, and of these the right-most.

    Args:
        blocks: many of one shape, along the first axis.
        degree: of the polynomials in their channels.
        count: how many roots to keep of each.

    Returns:
        Roots of each block.
    """
    starts = [_candidates(*item, count) for item in zip(_collocation_roots(blocks, degree), blocks.lags, strict=True)]
    first = count + MORE_CANDIDATES
    found = _refine(blocks, [entry[:first] for entry in starts], count)
    again = [k for k, entry in enumerate(starts) if not _suffice(found[k], entry[first:], count)]
    if again:
        for k, whole in zip(again, _refine(blocks.rows(np.array(again)), [starts[k] for k in again], count), strict=True):
            found[k] = whole
    return found


def _suffice(found: Listed, others: Complexes, count: int) -> bool:
    """Whether none of the candidates further left can become one of the roots asked for, as far as Newton may move it."""
    if not others.size:
        return True
    reach = float(np.max(others.real + 2.0 * LONGEST_MOVE * (1.0 + np.abs(others))))
    return found.roots.size >= count and reach < float(np.min(found.roots.real))


def _refine(blocks: FeedbackBlock, starts: list[Complexes], count: int) -> list[Listed]:
    ends = np.cumsum([entry.size for entry in starts])
    flat = np.concatenate(starts)
    owners = np.repeat(np.arange(len(starts)), [entry.size for entry in starts])
    roots, residuals, steps = _newton(blocks.rows(owners), flat)
    size = 1.0 + np.abs(roots)
    precise = (steps <= STEP_LIMIT * size) | ((residuals <= 1e-2 * RESIDUAL_LIMIT) & (steps <= MULTIPLE_STEP_LIMIT * size))
    good = (residuals <= RESIDUAL_LIMIT) & precise & (np.abs(roots - flat) <= LONGEST_MOVE * size)
    found = []
    for first, last in zip((0, *ends[:-1]), ends, strict=True):
        kept = first + np.flatnonzero(good[first:last])
        paired = kept[flat[kept].imag > 0.0]
        both = np.concatenate((roots[kept], roots[paired].conj()))
        order = _from_the_right(both)[: _kept(both, count)]
        entries = np.concatenate((kept, paired))[order]
        found.append(Listed(roots=both[order], residuals=residuals[entries], errors=steps[entries]))
    return found


def _candidates(values: Complexes, lags: Floats, count: int) -> Complexes:
    """The right-most eigenvalues of one block, of each pair the upper."""
    values = values[-values.real * np.max(lags, initial=0.0) < LARGEST_GROWTH]
    values = values[_from_the_right(values)][: max(MOST_CANDIDATES, 3 * count)]
    return np.asarray(values[values.imag >= 0.0])


def _newton(blocks: FeedbackBlock, starts: Complexes) -> tuple[Complexes, Floats, Floats]:
    """Newton on the characteristic matrix times its null vector, held to length 1; gives roots, residuals and last steps."""
    s = starts.copy()
    matrix, slope = blocks.characteristic(s)
    size = matrix.shape[-1]
    vector = np.linalg.svd(matrix)[2][:, -1].conj()
    steps, missed, grown = np.full(s.size, np.inf), np.full(s.size, np.inf), np.zeros(s.size)
    active, here = np.arange(s.size), blocks
    for _ in range(NEWTON_STEPS):
        bordered = np.zeros((active.size, size + 1, size + 1), dtype=complex)
        bordered[:, :size, :size], bordered[:, :size, size] = matrix, np.squeeze(slope @ vector[active, :, None], -1)
        bordered[:, size, :size] = vector[active].conj()
        miss = np.zeros((active.size, size + 1), dtype=complex)
        miss[:, :size] = -np.squeeze(matrix @ vector[active, :, None], -1)
        change = solve_each(bordered, miss)
        # A start that runs far away is spurious; it stays where it is, and its residual tells.
        near = np.abs(s[active] + change[:, size] - starts[active]) <= 3.0 * LONGEST_MOVE * (1.0 + np.abs(starts[active]))
        change[~near] = 0.0
        moved = vector[active] + change[:, :size]
        vector[active] = moved / np.linalg.norm(moved, axis=-1, keepdims=True)
        s[active] += change[:, size]
        before, steps[active] = steps[active], np.where(near, np.abs(change[:, size]), np.inf)
        sizes = 1.0 + np.abs(s[active])
        # At a multiple root steps fall to rounding and rise again by chance: the largest of those tells how well it is known.
        risen = (steps[active] > before) & (before <= MULTIPLE_STEP_LIMIT * sizes)
        grown[active] = np.where(risen, np.maximum(grown[active], steps[active]), grown[active])
        going = near & ~_at_rest(steps[active], before, sizes)
        matrix, slope = here.characteristic(s[active])
        missed[active] = np.linalg.norm(np.squeeze(matrix @ vector[active, :, None], -1), axis=-1)
        if not np.any(going):
            break
        (rows,) = np.nonzero(going)
        active, matrix, slope, here = active[rows], matrix[rows], slope[rows], here.rows(rows)
    return s, missed / blocks.sizes(s), np.maximum(steps, grown)


def _at_rest(steps: Floats, before: Floats, sizes: Floats) -> NDArray[np.bool_]:
    """Whether steps are as short as rounding makes them, or no longer become shorter."""
    return (steps <= 1e-15 * sizes) | ((steps <= ROUNDED_STEP * sizes) & (steps > 0.25 * before))


def _from_the_right(roots: Complexes) -> NDArray[np.intp]:
    """Order by real part, falling; conjugates stand side by side, the positive frequency first."""
    return np.lexsort((-roots.imag, np.abs(roots.imag), -roots.real))


def _kept(roots: Complexes, count: int) -> int:
    """How many to keep: those asked for, and no half of a pair."""
    ordered = roots[_from_the_right(roots)]
    keep = min(count, ordered.size)
    while keep < ordered.size and np.sum(np.sign(ordered[:keep].imag)) != 0.0:
        keep += 1
    return keep


def axis_widths(roots: Complexes) -> Floats:
    """How near to the imaginary axis each root would count as lying on it, in rad/s."""
    return AXIS_WIDTH * (1.0 + np.abs(roots))
