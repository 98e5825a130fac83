"""Texts at points, that find a free place by themselves."""

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from revline.errors import InvalidInputError
from revline.report.parts import LEVEL_ORDER
from revline.report.style import BLACK, DPI, GREY

Floats = NDArray[np.float64]

SPACING: Final = 4.0
"""Pixels between the points by which a curve is seen when a note looks for a free place."""

DIRECTIONS: Final = ((1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))
GAPS: Final = (5.0, 12.0, 24.0, 40.0, 60.0, 85.0)
"""Points between a note and what it belongs to."""

LEADER: Final = 10.0
"""From this gap on a thin line leads from the note to its point."""

PADDING: Final = 3.0
"""Pixels kept free about a note."""


class Note(NamedTuple):
    """A text that belongs to a point."""

    x: float
    y: float
    text: str


class _Obstacles(NamedTuple):
    """Pixels that a note should not cover, and how much each weighs."""

    points: Floats
    weights: Floats


class _Place(NamedTuple):
    """Where a note's middle may stand, in points from what it belongs to."""

    offset: tuple[float, float]
    gap: float
    cost: float


def mark_points(axes: Axes, notes: Iterable[Note]) -> None:
    """Put a dot at each point that has a note.

    Raises:
        InvalidInputError: a point is not finite.
    """
    for note in notes:
        if not (math.isfinite(note.x) and math.isfinite(note.y)):
            message = f"note {note.text!r} belongs to the point ({note.x:g}, {note.y:g}), which is not finite; leave it out"
            raise InvalidInputError(message)
        axes.plot(note.x, note.y, marker="o", markersize=5.5, color=BLACK, markeredgecolor="white", zorder=4.0, label="_nolegend_")


def place_notes(axes: Axes, notes: Iterable[Note]) -> None:
    """Write each note where it covers neither curves nor other notes and stays inside the axes, as near to its point as possible.

    Call it when the layout of the figure is final.
    """
    figure = axes.get_figure(root=True)
    if figure is None or not isinstance(figure.canvas, FigureCanvasAgg):
        message = "notes are measured in pixels; begin their figure with new_figure()"
        raise TypeError(message)
    renderer = figure.canvas.get_renderer()  # type: ignore[no-untyped-call]  # the stubs leave it out
    obstacles = _obstacles(axes)
    blocks: list[Bbox] = []
    for note in notes:
        text = _write(axes, note, _Place((0.0, 0.0), 0.0, 0.0))
        extent = text.get_window_extent(renderer)
        text.remove()
        half = np.array([extent.width, extent.height]) / 2.0
        best = min(_places(axes, note, half, obstacles, blocks), key=lambda place: place.cost)
        placed = _write(axes, note, best)
        placed.update_positions(renderer)
        blocks.append(Text.get_window_extent(placed, renderer))  # of the text alone, without its leader


def _obstacles(axes: Axes) -> _Obstacles:
    """Points along all curves, SPACING apart; a level may rather be covered than a curve."""
    frame = axes.get_window_extent()
    rows, weights = [np.empty((0, 2))], [np.empty(0)]
    for line in axes.lines:
        points = line.get_transform().transform(np.atleast_2d(line.get_xydata()))
        points = np.clip(points, (frame.x0 - 9.0, frame.y0 - 9.0), (frame.x1 + 9.0, frame.y1 + 9.0))
        if line.get_linestyle() != "None" and len(points) > 1:
            path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
            samples = np.arange(0.0, path[-1] + SPACING, SPACING)
            points = np.column_stack([np.interp(samples, path, column) for column in points.T])
        rows.append(points)
        weights.append(np.full(len(points), 2.0 if line.get_zorder() == LEVEL_ORDER else 10.0))
    return _Obstacles(np.concatenate(rows), np.concatenate(weights))


def _places(axes: Axes, note: Note, half: Floats, obstacles: _Obstacles, blocks: Sequence[Bbox]) -> list[_Place]:
    frame, pixels = axes.get_window_extent(), DPI / 72.0
    anchor = axes.transData.transform((note.x, note.y))
    places = []
    for gap, direction in itertools.product(GAPS, DIRECTIONS):
        offset = np.array(direction) * (half + gap * pixels * (0.75 if all(direction) else 1.0))
        low, high = anchor + offset - half - PADDING, anchor + offset + half + PADDING
        outside = np.maximum(0.0, (frame.x0, frame.y0) - low).sum() + np.maximum(0.0, high - (frame.x1, frame.y1)).sum()
        covered = obstacles.weights[np.all((obstacles.points >= low) & (obstacles.points <= high), axis=1)].sum()
        overlaps = sum(block.x0 < high[0] and block.x1 > low[0] and block.y0 < high[1] and block.y1 > low[1] for block in blocks)
        x, y = (offset / pixels).tolist()
        places.append(_Place((x, y), gap, 20.0 * outside + covered + 500.0 * overlaps + gap))
    return places


def _write(axes: Axes, note: Note, place: _Place) -> Annotation:
    leader = {"arrowstyle": "-", "color": GREY, "linewidth": 0.7, "shrinkA": 0.0, "shrinkB": 3.0}
    return axes.annotate(
        note.text,
        (note.x, note.y),
        xytext=place.offset,
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8.5,
        color=BLACK,
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.0},
        arrowprops=leader if place.gap >= LEADER else None,
        zorder=5.0,
    )
