"""All characteristic roots in a region, their number proven: right of a line the argument principle counts what must be listed.

A linear system with delays has infinitely many roots, but finitely many right of any line, unless delays feed one another without a state.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.errors import InvalidInputError, NotConvergedError
from revline.lti.feedback import feedback_blocks
from revline.lti.response import Complexes, Floats
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace
from revline.values import make_read_only

MOST_ROOTS = 500
"""More roots than these in one region are not listed."""

EDGE = 1e-9
"""A root this near an edge, relative to 1 + |s|, is neither inside nor outside."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A rectangle of the complex plane, in rad/s; open to the right, upward and downward where no edge is given.

    Attributes:
        left, right: edges of the real part.
        bottom, top: edges of the imaginary part.

    Raises:
        InvalidInputError: an edge is no number, the left one is not finite, or the edges do not rise.
    """

    left: float
    right: float = math.inf
    bottom: float = -math.inf
    top: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.left) and self.left < self.right and self.bottom < self.top):
            edges = f"from {self.left:g} to {self.right:g} and from {self.bottom:g} to {self.top:g} rad/s"
            message = f"a region {edges} cannot be searched; give a finite left edge, and edges that rise"
            raise InvalidInputError(message, left=self.left)

    def holds(self, roots: Complexes) -> NDArray[np.bool_]:
        """Tell which roots lie inside.

        Raises:
            NotConvergedError: a root lies on an edge.
        """
        inside = np.ones(roots.size, dtype=bool)
        for part, low, high in ((roots.real, self.left, self.right), (roots.imag, self.bottom, self.top)):
            for edge in (low, high):
                near = np.abs(part - edge) <= EDGE * (1.0 + np.abs(roots))
                if np.any(near):
                    root = complex(roots[near][0])
                    message = f"the root {root:.6g} rad/s lies on the region's edge at {edge:g} rad/s; move that edge"
                    raise NotConvergedError(message, edge=edge)
            inside &= (low < part) & (part < high)
        return inside


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RootsInRegion:
    """All characteristic roots in a region, right-most first, each as often as it is multiple.

    Attributes:
        region: where they were sought.
        roots: in rad/s.
        errors: how well each is known, in rad/s.
        counted: roots right of the left edge, by the argument principle; as many were found.
        spectral_abscissa: real part of the right-most root of all that lie right of the edge; of none, the edge, which lies right of it.
    """

    region: Region
    roots: Complexes
    errors: Floats
    counted: int
    spectral_abscissa: float

    def __post_init__(self) -> None:
        make_read_only(self)


def find_roots_in(system: DelayStateSpace, region: Region) -> RootsInRegion:
    """Find all characteristic roots in a region.

    Args:
        system: linear system with delay channels.
        region: where to look.

    Returns:
        The roots; their number right of the left edge agrees with that of the argument principle.

    Raises:
        InvalidInputError: more roots than 500 lie right of the left edge.
        AnalysisError: channels feed one another in a loop with a gain of 1 or more on the left edge, so that roots may be without number.
        NotConvergedError: a root lies on an edge, the roots cannot be counted, or not as many are found as are counted.

    Source:
        As `characteristic_roots`; argument principle as in Nyquist (1932), Bell System Technical Journal 11(1), 126-147.
    """
    counted = sum(block.count_right_of(region.left) for block in feedback_blocks(system))
    if counted > MOST_ROOTS:
        message = f"{counted} roots lie right of {region.left:g} rad/s, more than the {MOST_ROOTS} that are listed; move that edge"
        raise InvalidInputError(message, counted=counted)
    if not counted:
        none = np.zeros(0, dtype=complex)
        return RootsInRegion(region=region, roots=none, errors=np.zeros(0), counted=0, spectral_abscissa=region.left)
    found = characteristic_roots(system, count=counted)
    right = found.roots.real > region.left
    if int(np.sum(right)) != counted:
        listed = int(np.sum(right))
        message = f"{listed} roots were found right of {region.left:g} rad/s where {counted} are counted; move the left edge right"
        raise NotConvergedError(message, found=listed, counted=counted)
    inside = region.holds(found.roots[right])
    return RootsInRegion(
        region=region,
        roots=found.roots[right][inside],
        errors=found.errors[right][inside],
        counted=counted,
        spectral_abscissa=found.spectral_abscissa,
    )
