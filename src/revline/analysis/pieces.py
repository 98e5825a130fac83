"""Periodic functions as polynomials on elements of a period, collocated at Radau points; elements end where the user says.

Nodes are the Radau points of all elements, right ends included; the left end of the first is the right end of the last.
Time is a fraction of the period.

Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.5, for the points; Berrut and Trefethen (2004),
SIAM Review 46(3), 501-517, for the interpolation.
"""

import functools
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_jacobi

from revline.system import Floats
from revline.values import make_read_only

DEGREE = 5
"""Degree of the polynomials on each element."""

SAME = 1e-8
"""Ends of elements nearer to each other than this part of the period are one."""

ASIDE = 3e-9
"""How far before an end a derivative is taken that may jump there, as a part of the period; in short elements a tenth of their length."""


@functools.cache
def radau() -> tuple[Floats, Floats, Floats]:
    """Points of an element from 0 to 1, its left end and the Radau points; differentiation there; barycentric weights."""
    inner = 0.5 * (1.0 + roots_jacobi(DEGREE - 1, 1.0, 0.0)[0])
    points = np.concatenate(([0.0], inner, [1.0]))
    gaps = points[:, None] - points[None, :] + np.eye(points.size)
    weights = 1.0 / np.prod(gaps, axis=1)
    slopes = weights[None, :] / weights[:, None] / gaps
    np.fill_diagonal(slopes, 0.0)
    np.fill_diagonal(slopes, -np.sum(slopes, axis=1))
    for array in (points, slopes, weights):
        array.setflags(write=False)
    return points, slopes, weights


def basis(at: Floats) -> Floats:
    """Value at places of an element, 0 to 1, of each polynomial that is 1 at one of its points and 0 at the others; along a new axis."""
    points, _, weights = radau()
    gaps = at[..., None] - points
    exact = np.abs(gaps) < 1e-14
    terms = weights / np.where(exact, 1.0, gaps)
    found: Floats = np.where(np.any(exact, axis=-1, keepdims=True), exact, terms / np.sum(terms, axis=-1, keepdims=True))
    return found


@functools.cache
def late_basis() -> Floats:
    """Takes values at the points but the left end to those at all points: the polynomial of one degree less, continued to the left end."""
    points = radau()[0]
    whole = np.linalg.inv(np.vander(points[1:], DEGREE))
    found = np.concatenate((np.zeros((DEGREE + 1, 1)), np.vander(points, DEGREE) @ whole), axis=1)
    found.setflags(write=False)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pieces:
    """Elements of one period.

    Attributes:
        ends: of the elements, from 0 to 1, rising, shape (n_elements + 1,).
        fresh: whether an element begins at a kink, shape (n_elements,).
    """

    ends: Floats
    fresh: NDArray[np.bool_]

    def __post_init__(self) -> None:
        make_read_only(self)

    @staticmethod
    def lay(elements: int, kinks: Floats) -> "Pieces":
        """Lay about so many elements, with an end at each kink.

        Args:
            elements: how many there would be without kinks.
            kinks: parts of the period, 0 to 1.
        """
        inner = np.sort(kinks[(kinks > SAME) & (kinks < 1.0 - SAME)])
        marks = np.concatenate(([0.0], inner[np.diff(inner, prepend=0.0) > SAME], [1.0]))
        runs = [np.linspace(a, b, max(1, round(float(np.ceil(elements * (b - a) - 1e-9)))), endpoint=False) for a, b in pairwise(marks)]
        ends = np.concatenate((*runs, [1.0]))
        at_ends = np.any(np.abs(kinks) <= SAME) or np.any(np.abs(kinks - 1.0) <= SAME)
        fresh = np.isin(ends[:-1], marks[1:-1])
        fresh[0] = bool(at_ends)
        return Pieces(ends=ends, fresh=fresh)

    @property
    def lengths(self) -> Floats:
        """Of the elements, as parts of the period."""
        return np.diff(self.ends)

    @property
    def times(self) -> Floats:
        """Of the nodes, as parts of the period, shape (n_nodes,)."""
        return np.asarray((self.ends[:-1, None] + self.lengths[:, None] * radau()[0][1:]).ravel())

    @property
    def inner_times(self) -> Floats:
        """Those of the nodes, the last of each element moved into it a little: there no derivative is taken from beyond a kink."""
        moved = self.times.reshape(-1, DEGREE).copy()
        moved[:, -1] -= np.minimum(ASIDE, 0.1 * self.lengths)
        return moved.ravel()

    @property
    def count(self) -> int:
        """How many nodes there are."""
        return DEGREE * self.lengths.size

    def places(self, times: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Find the elements in which times lie, and where within them; times are taken modulo the period."""
        wrapped = times - np.floor(times)
        element = np.clip(np.searchsorted(self.ends, wrapped, side="right") - 1, 0, self.lengths.size - 1)
        return element, (wrapped - self.ends[element]) / self.lengths[element]

    def read(self, values: Floats, times: Floats) -> Floats:
        """Read values at the nodes, shape (n_nodes, n), at times; of shape (m,) all columns, of shape (m, n) each column at its own."""
        element, at = self.places(times)
        weights = basis(at)
        positions = (element[..., None] * DEGREE + np.arange(DEGREE + 1) - 1) % self.count
        if times.ndim == 1:
            return np.asarray(np.einsum("mj,mjn->mn", weights, values[positions]))
        columns = np.arange(values.shape[1])[:, None]
        return np.asarray(np.sum(weights * values[positions, columns], axis=-1))

    def reading(self, times: Floats) -> Floats:
        """How values at any times follow from those at the nodes; the nodes along a new last axis."""
        element, at = self.places(times)
        return self._spread(element, basis(at))

    def slope_reading(self, times: Floats) -> Floats:
        """How derivatives by the part of the period follow from the values at the nodes; the nodes along a new last axis."""
        element, at = self.places(times)
        return self._spread(element, (basis(at) @ radau()[1]) / self.lengths[element][..., None])

    @property
    def derivative(self) -> Floats:
        """Takes values at the nodes to derivatives by the part of the period there, each taken in its own element."""
        element = np.repeat(np.arange(self.lengths.size), DEGREE)
        slopes = np.tile(radau()[1][1:], (self.lengths.size, 1)) / self.lengths[element][:, None]
        return self._spread(element, slopes)

    def _spread(self, element: NDArray[np.int64], values: Floats) -> Floats:
        """Put weights of an element's points where its nodes stand; that of the left end belongs to the last node before."""
        found = np.zeros((*element.shape, self.count))
        positions = (element[..., None] * DEGREE + np.arange(DEGREE + 1) - 1) % self.count
        if self.lengths.size == 1:
            values = np.concatenate((values[..., 1:-1], values[..., -1:] + values[..., :1]), axis=-1)
            positions = positions[..., 1:]
        np.put_along_axis(found, positions, values, axis=-1)
        return found
