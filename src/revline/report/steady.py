"""Steady states over an input, and the straight line that stands for them."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import check_columns, draw_curve
from revline.report.style import BLUE, PALE, VERMILION, Look, Quantity, add_legend, drawn, finish_layout, label_axes, new_figure


class StraightLine(NamedTuple):
    """A straight line over a range."""

    slope: float
    intercept: float
    low: float
    high: float


@drawn
def plot_steady_map(
    values: ArrayLike,
    outputs: ArrayLike,
    stable: ArrayLike,
    x: Quantity,
    y: Quantity,
    *,
    point: Note | None = None,
    line: StraightLine | None = None,
) -> Figure:
    """Draw steady states as points joined by a line, unstable ones open.

    Args:
        values: of the swept input.
        outputs: at rest.
        stable: whether each steady state is stable.
        x: what the horizontal axis shows.
        y: what the vertical axis shows.
        point: a steady state to mark.
        line: a straight line to compare with; the picture is then limited to its range and a little more.

    Raises:
        InvalidInputError: columns are empty, differ in length or hold what is not finite, or no steady state is in the line's range.
    """
    sweep, rest, flags = check_columns("steady map", values=values, outputs=outputs, stable=stable)
    if line is not None:
        sweep, rest, flags = _near_line(line, sweep, rest, flags)
    firm = flags > 0.0
    figure = new_figure()
    axes = figure.subplots()
    if line is not None:
        ends = np.array([line.low, line.high])
        axes.axvspan(line.low, line.high, color=PALE, alpha=0.4, linewidth=0.0, zorder=0.5, label="range of the line")
        text = f"straight line, slope {line.slope:.4g} {y.unit} per {x.unit}"
        draw_curve(axes, ends, line.slope * ends + line.intercept, Look(VERMILION, "-", width=1.4), text)
    else:
        draw_curve(axes, sweep, rest, Look(BLUE, "-", width=0.9))
    for chosen, look, label in (
        (firm, Look(BLUE, "", "o"), "stable"),
        (~firm, Look(VERMILION, "", "o", filled=False), "unstable without control"),
    ):
        if np.any(chosen):
            draw_curve(axes, sweep[chosen], rest[chosen], look, label).set(markersize=4.5 if line is not None else 3.0)
    label_axes(axes, x, y)
    notes = [point] if point is not None else []
    mark_points(axes, notes)
    add_legend(figure)
    finish_layout(figure)
    place_notes(axes, notes)
    return figure


def _near_line(line: StraightLine, *columns: np.ndarray) -> tuple[np.ndarray, ...]:
    margin = 0.15 * (line.high - line.low)
    near = (columns[0] >= line.low - margin) & (columns[0] <= line.high + margin)
    if not np.any(near):
        message = f"no steady state lies near the line's range of {line.low:g} to {line.high:g}; give the map that it was fitted to"
        raise InvalidInputError(message)
    return tuple(column[near] for column in columns)
