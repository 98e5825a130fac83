"""Boxes of operating points between ends of two axes, and how one grows to the largest that fits.

Where a box fits follows from its corners here, and larger boxes fit less: an edge is moved until the box no longer fits, and as one edge
can only be won by giving up another, edges are traded with ever smaller steps as long as the area grows. That is a pattern search,
whose end no such step improves: Torczon (1997), SIAM Journal on Optimization 7(1), 1-25. It is local; a bound of what is left is the
business of `gain_box_limit`.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

FIRST_STEP, LAST_STEP = 0.25, 1.0 / 256.0
"""Parts of a box's side by which an edge is moved: the first, and that below which the search ends."""

GROWTH = 1e-4
"""By this part of its area a box must grow in a trade of edges."""

RESOLUTION = 1e-4
"""Part of the whole's side to which an edge's place is found."""


Share = tuple[float, float]
"""Where a point of a box lies: 0 at the low end of an axis, 1 at its high end."""

CORNERS: tuple[Share, ...] = ((0.0, 1.0), (1.0, 0.0), (0.0, 0.0), (1.0, 1.0))
"""Shares of the corners, in the order of `Box.corners`."""


class Box(NamedTuple):
    """Operating points between ends of both axes."""

    first_low: float
    first_high: float
    second_low: float
    second_high: float

    @property
    def area(self) -> float:
        """In the product of the axes' units."""
        return (self.first_high - self.first_low) * (self.second_high - self.second_low)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The four, that with the lowest first and highest second value first."""
        return (
            (self.first_low, self.second_high),
            (self.first_high, self.second_low),
            (self.first_low, self.second_low),
            (self.first_high, self.second_high),
        )

    def grid(self, count: int) -> list[tuple[float, float]]:
        """Points evenly spread over the box, edges included."""
        firsts = np.linspace(self.first_low, self.first_high, count)
        return [(float(a), float(b)) for a in firsts for b in np.linspace(self.second_low, self.second_high, count)]

    def at(self, share: Share) -> tuple[float, float]:
        """The point at given shares of the sides; the ends themselves at 0 and 1."""
        a, b = share
        return (1.0 - a) * self.first_low + a * self.first_high, (1.0 - b) * self.second_low + b * self.second_high

    def share(self, place: tuple[float, float]) -> Share:
        """Where a point lies."""
        return (place[0] - self.first_low) / self.side(0), (place[1] - self.second_low) / self.side(2)

    def about_middle(self, part: float) -> "Box":
        """The box drawn in about its middle to a part of its sides."""
        middle = self.at((0.5, 0.5))
        return Box(*(middle[k // 2] + part * (self[k] - middle[k // 2]) for k in range(4)))

    def side(self, edge: int) -> float:
        """Length of the axis on which an edge lies; edges are counted as the fields are."""
        return self[edge | 1] - self[edge & 2]

    def with_edge(self, edge: int, value: float) -> "Box":
        """The box with one edge elsewhere."""
        return Box(*(value if k == edge else end for k, end in enumerate(self)))


Fits = Callable[[Box], bool]


def grow_box(start: Box, whole: Box, fits: Fits) -> Box:
    """Grow a box to the largest that fits, within another: to one that no trade of two of its edges makes larger.

    Args:
        start: fits.
        whole: holds it.
        fits: whether a box does; a box that holds another fits no better.

    Returns:
        A box that fits, at least as large as the first.
    """
    box = start
    for edge in range(4):
        box = _widened(box, edge, whole, fits)
    step = FIRST_STEP
    while step >= LAST_STEP:
        larger = _traded(box, step, whole, fits)
        box, step = (larger, step) if larger else (box, 0.5 * step)
    return box


def _traded(box: Box, step: float, whole: Box, fits: Fits) -> Box | None:
    """Move an edge or an axis by a part of its side, and another edge so far that the area grows; nothing where nothing fits so."""
    for moved, edges in _moved(box, step, whole):
        for other in edges:
            grown = _grown(box, moved, other, whole)
            if grown is not None and fits(grown):
                return _widened(grown, other, whole, fits)
    return None


def _moved(box: Box, step: float, whole: Box) -> Iterator[tuple[Box, tuple[int, ...]]]:
    """The box with one edge moved, or with both of an axis alike, within the whole; and the edges that may answer."""
    for edge in range(4):
        for way in (-step * box.side(edge), step * box.side(edge)):
            moved = box.with_edge(edge, min(max(box[edge] + way, whole[edge & 2]), whole[edge | 1]))
            if moved != box and moved.side(edge) > 0.0:
                yield moved, tuple(other for other in range(4) if other != edge)
            slid = moved.with_edge(edge ^ 1, box[edge ^ 1] + moved[edge] - box[edge])
            if (edge & 1) == (way > 0.0) and slid != box:
                yield slid, (2, 3) if edge < 2 else (0, 1)


def _grown(box: Box, moved: Box, other: int, whole: Box) -> Box | None:
    """Move another edge to where the area exceeds that of the box before; nothing where that lies outside the whole."""
    side = moved.side(other) * box.area * (1.0 + GROWTH) / moved.area
    value = moved[other ^ 1] + (side if other & 1 else -side)
    return moved.with_edge(other, value) if whole[other & 2] <= value <= whole[other | 1] else None


def _widened(box: Box, edge: int, whole: Box, fits: Fits) -> Box:
    """Move an edge outwards as far as the box fits."""
    inner, outer = box[edge], whole[edge]
    if inner == outer or fits(box.with_edge(edge, outer)):
        return box.with_edge(edge, outer)
    while abs(outer - inner) > RESOLUTION * whole.side(edge):
        middle = 0.5 * (inner + outer)
        inner, outer = (middle, outer) if fits(box.with_edge(edge, middle)) else (inner, middle)
    return box.with_edge(edge, inner)
