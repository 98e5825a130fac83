"""Curves over a common axis: relations, time responses, errors."""

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from revline.errors import InvalidInputError
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import Curve, Level, check_some, draw_curves, draw_levels
from revline.report.style import PALE, TALL, WIDE, Quantity, add_legend, drawn, finish_layout, label_axes, new_figure, use_log

Limits = tuple[float, float]


class View(NamedTuple):
    """Which part of the plane is shown, and how.

    Attributes:
        x, y: limits; as the curves need where they are not given.
        log: axes that are logarithmic: "", "x", "y" or "xy".
    """

    x: Limits | None = None
    y: Limits | None = None
    log: str = ""


WHOLE = View()


@drawn
def plot_curves(
    curves: Sequence[Curve],
    x: Quantity,
    y: Quantity,
    *,
    notes: Sequence[Note] = (),
    levels: Sequence[Level] = (),
    verticals: Sequence[Level] = (),
    view: View = WHOLE,
) -> Figure:
    """Draw curves over a common axis.

    Args:
        curves: at least one.
        x: what the horizontal axis shows.
        y: what the vertical axis shows.
        notes: texts at points, which are marked.
        levels: values marked by horizontal lines.
        verticals: values marked by vertical lines.
        view: the part shown.

    Raises:
        InvalidInputError: there are no curves, or limits are empty.
    """
    check_some("curves", curves)
    figure = new_figure()
    axes = figure.subplots()
    _fill(axes, curves, view, levels=levels, verticals=verticals)
    label_axes(axes, x, y)
    mark_points(axes, notes)
    add_legend(figure)
    finish_layout(figure)
    place_notes(axes, notes)
    return figure


@drawn
def plot_curves_with_detail(
    curves: Sequence[Curve], x: Quantity, y: Quantity, *, detail: View, levels: Sequence[Level] = (), view: View = WHOLE
) -> Figure:
    """Draw curves twice: the whole above, and a part of it below, whose place the upper picture shows.

    Args:
        curves: at least one.
        x: what the horizontal axis shows.
        y: what the vertical axis shows.
        detail: the part shown below; it has limits in x.
        levels: values marked by horizontal lines.
        view: the part shown above.

    Raises:
        InvalidInputError: there are no curves, or limits are empty or missing.
    """
    check_some("curves", curves)
    if detail.x is None:
        message = "a detail has no limits in x; give them, they say which part it shows"
        raise InvalidInputError(message)
    figure = new_figure(height=TALL, width=WIDE)
    upper, lower = figure.subplots(2, 1)
    _fill(upper, curves, view, levels=levels, verticals=())
    _fill(lower, curves, _with_heights(curves, detail), levels=levels, verticals=())
    upper.axvspan(*detail.x, color=PALE, alpha=0.6, linewidth=0.0, zorder=0.5, label="shown enlarged below")
    label_axes(upper, None, y)
    label_axes(lower, x, y)
    figure.align_ylabels()
    add_legend(figure)
    finish_layout(figure)
    return figure


def _fill(axes: Axes, curves: Sequence[Curve], view: View, *, levels: Sequence[Level], verticals: Sequence[Level]) -> None:
    for which in view.log:
        use_log(axes, which)
    draw_curves(axes, curves)
    draw_levels(axes, horizontal=levels, vertical=verticals)
    for name, limits, apply in (("x", view.x, axes.set_xlim), ("y", view.y, axes.set_ylim)):
        if limits is not None:
            if not limits[0] < limits[1]:
                message = f"{name} limits {limits[0]:g} to {limits[1]:g} show nothing; the first must be the lower"
                raise InvalidInputError(message)
            apply(*limits)


def _with_heights(curves: Sequence[Curve], view: View) -> View:
    """Limits in y that hold what the curves do within the limits in x."""
    if view.y is not None or view.x is None:
        return view
    seen = [value for c in curves for value in c.y[(c.x >= view.x[0]) & (c.x <= view.x[1])]]
    if not seen:
        message = f"no curve has a point within {view.x[0]:g} to {view.x[1]:g}; widen the limits of the detail"
        raise InvalidInputError(message)
    margin = 0.06 * (max(seen) - min(seen)) or 1.0
    return view._replace(y=(min(seen) - margin, max(seen) + margin))
