"""Controllers beside the optimum of their form: robustness against load error, and the load responses."""

from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from revline.design.optimum.competitors import Comparison, Competitor
from revline.errors import InvalidInputError
from revline.report.style import BLUE, VERMILION, WIDE, Quantity, add_legend, drawn, finish_layout, label_axes, new_figure, use_log

PEAK: Final = Quantity("maximum sensitivity Ms", "1")
TIME: Final = Quantity("time after the load's step", "s")

SHOWN: Final = 2.0
"""So many seconds of a response are shown at most."""


@drawn
def plot_comparison(found: Comparison, *, unit: str = "rad per N m", response_unit: str = "rad/s per N m") -> Figure:
    """Draw maximum sensitivity against load error of each controller, with an arrow to its optimum, and the responses of the worst ratio.

    Args:
        found: at least one controller and its optimum.
        unit: of the load error.
        response_unit: of the response to a unit step of the load.

    Raises:
        InvalidInputError: there is no controller to show.
    """
    if not found.competitors:
        message = "there is no controller beside an optimum to draw; compare one at least"
        raise InvalidInputError(message)
    figure = new_figure(height=4.0, width=WIDE)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_plane(left, found, Quantity("integrated load error", unit))
    _draw_responses(right, min(found.competitors, key=lambda one: one.ratio), Quantity("speed after a unit load", response_unit))
    add_legend(figure, columns=4)
    finish_layout(figure)
    return figure


def _draw_plane(axes: Axes, found: Comparison, error: Quantity) -> None:
    use_log(axes, "y")
    for number, one in enumerate(found.competitors, start=1):
        peak, best = float(one.cost.sensitivity.max()), float(one.optimum.costs[0].sensitivity.max())
        axes.annotate(
            "",
            xy=(best, one.optimum.cost),
            xytext=(peak, one.cost.load),
            arrowprops={"arrowstyle": "->", "color": "0.6", "linewidth": 0.8, "shrinkA": 2.0, "shrinkB": 2.0},
        )
        axes.annotate(f"{number}", (peak, one.cost.load), xytext=(4, 3), textcoords="offset points", fontsize=7.0)
    names = "\n".join(f"{number}  {one.name}" for number, one in enumerate(found.competitors, start=1))
    axes.text(0.98, 0.98, names, transform=axes.transAxes, ha="right", va="top", fontsize=6.5)
    axes.plot(
        [float(one.cost.sensitivity.max()) for one in found.competitors],
        [one.cost.load for one in found.competitors],
        "o",
        color=VERMILION,
        markersize=4.0,
        label="controllers",
    )
    axes.plot(
        [float(one.optimum.costs[0].sensitivity.max()) for one in found.competitors],
        [one.optimum.cost for one in found.competitors],
        "s",
        color=BLUE,
        markersize=4.0,
        label="their optima",
    )
    label_axes(axes, PEAK, error)
    axes.margins(x=0.3, y=0.1)


def _draw_responses(axes: Axes, one: Competitor, response: Quantity) -> None:
    for curve, label, colour in ((one.response, one.name, VERMILION), (one.best_response, f"optimum of {one.name}", BLUE)):
        axes.plot(curve.times, curve.values, color=colour, label=label)
    axes.set_xlim(0.0, min(SHOWN, float(one.response.times[-1])))
    label_axes(axes, TIME, response)
