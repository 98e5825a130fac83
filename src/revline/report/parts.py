"""What figures are made of: checked curves, and levels."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from revline.errors import InvalidInputError
from revline.report.style import GREY, MODELS, Look
from revline.values import make_read_only

Floats = NDArray[np.float64]

LEVEL_ORDER: Final = 2.0
"""Drawing order of levels, below that of curves: by it a note tells what it may cover."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A line or a set of points.

    Attributes:
        x: abscissae, shape (n,).
        y: ordinates, shape (n,).
        label: in the legend; none where empty.
        look: how it is drawn; the next of MODELS where it is not given.

    Raises:
        InvalidInputError: the columns are empty, differ in length, or hold what is not finite.
    """

    x: Floats
    y: Floats
    label: str = ""
    look: Look | None = None

    def __post_init__(self) -> None:
        x, y = check_columns(f"curve {self.label!r}" if self.label else "curve", x=self.x, y=self.y)
        object.__setattr__(self, "x", x)
        object.__setattr__(self, "y", y)
        make_read_only(self)


class Level(NamedTuple):
    """A value marked by a straight line across the picture; its text stands in the legend."""

    value: float
    text: str = ""
    colour: str = GREY
    dash: str = "--"


def check_columns(what: str, **columns: ArrayLike) -> tuple[Floats, ...]:
    """Copy columns of equal length into arrays, or refuse them.

    Args:
        what: what they make, for messages.
        columns: by name.

    Raises:
        InvalidInputError: they are empty, differ in length, or hold what is not finite.
    """
    arrays = {name: np.array(column, dtype=float) for name, column in columns.items()}
    shapes = {name: array.shape for name, array in arrays.items()}
    if any(array.ndim != 1 for array in arrays.values()) or len(set(shapes.values())) > 1:
        sizes = ", ".join(f"{name} of shape {shape}" for name, shape in shapes.items())
        message = f"{what} cannot be drawn: {sizes}; give columns of equal length"
        raise InvalidInputError(message)
    for name, array in arrays.items():
        if array.size == 0:
            message = f"{what} cannot be drawn: it has no points; give at least one"
            raise InvalidInputError(message)
        bad = np.flatnonzero(~np.isfinite(array))
        if bad.size:
            message = f"{what} cannot be drawn: {name}[{bad[0]}] = {array[bad[0]]} is not finite; leave such points out"
            raise InvalidInputError(message, index=int(bad[0]))
    return tuple(arrays.values())


def check_some(what: str, items: Sequence[object]) -> None:
    """Refuse a picture of nothing.

    Raises:
        InvalidInputError: there are no items.
    """
    if not items:
        message = f"there are no {what} to draw; give at least one"
        raise InvalidInputError(message)


def draw_curve(axes: Axes, x: Floats, y: Floats, look: Look, label: str = "") -> Line2D:
    """Draw a line or points in a look."""
    (line,) = axes.plot(
        x,
        y,
        color=look.colour,
        linestyle=look.dash or "none",
        linewidth=look.width,
        marker=look.marker or "none",
        markerfacecolor=look.colour if look.filled else "white",
        markeredgewidth=1.0,
        zorder=3.0 if look.marker else 2.5,
        label=label or "_nolegend_",
    )
    return line


def draw_curves(axes: Axes, curves: Iterable[Curve]) -> None:
    """Draw curves, those without a look in the colours of models, in turn."""
    free = itertools.cycle(MODELS)
    for curve in curves:
        draw_curve(axes, curve.x, curve.y, curve.look or next(free), curve.label)


def draw_levels(axes: Axes, *, horizontal: Iterable[Level] = (), vertical: Iterable[Level] = ()) -> None:
    """Draw straight lines across the picture."""
    for levels, draw in ((horizontal, axes.axhline), (vertical, axes.axvline)):
        for level in levels:
            draw(level.value, color=level.colour, linestyle=level.dash, linewidth=1.0, zorder=LEVEL_ORDER, label=level.text or "_nolegend_")
