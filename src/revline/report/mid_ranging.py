"""Steps of the load under two inputs beside one: the speed, what the spark does at once, and what the throttle takes over."""

from collections.abc import Sequence
from typing import Final

from matplotlib.figure import Figure

from revline.design.two_inputs.load_steps import LoadStepRun, StalledRun
from revline.errors import InvalidInputError
from revline.report.parts import Level, draw_curve, draw_levels
from revline.report.style import (
    BLUE,
    TALL,
    TIME,
    VERMILION,
    Look,
    Quantity,
    add_legend,
    drawn,
    finish_layout,
    label_axes,
    new_figure,
)

SHOWN: Final = 2.0
"""The figure shows this many times the longest time that the runs need, so that the answer fills it."""


@drawn
def plot_load_steps(compared: Sequence[LoadStepRun | StalledRun]) -> Figure:
    """Draw runs after the same step of the load: speed, spark and throttle below each other, limits dashed.

    Args:
        compared: one run or two; what stalled is not drawn.

    Raises:
        InvalidInputError: both stalled, so that there is nothing to draw.
    """
    looks = (Look(BLUE, "-"), Look(VERMILION, "--"))
    runs = [(run, look) for run, look in zip(compared, looks, strict=False) if isinstance(run, LoadStepRun)]
    if not runs:
        message = "all loops stalled, so that there is nothing to draw; give a smaller step of the load"
        raise InvalidInputError(message)
    figure = new_figure(height=TALL)
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    for run, look in runs:
        draw_curve(top, run.times, run.measurement, look, run.name)
        draw_curve(middle, run.times, run.fast, look, run.name)
        draw_curve(bottom, run.times, run.slow, look, run.name)
    first = runs[0][0]
    draw_levels(middle, horizontal=[Level(limit, "limit") for limit in (first.fast_range.low, first.fast_range.high)])
    label_axes(top, None, Quantity("speed", "rad/s"))
    label_axes(middle, None, Quantity("spark", "deg"))
    label_axes(bottom, TIME, Quantity("throttle", "deg"))
    needed = [time for run, _ in runs for time in (run.settling_time, run.return_time) if time is not None]
    until = first.task.until
    bottom.set_xlim(0.0, min(until, max(1.0, SHOWN * max(needed, default=until))))
    add_legend(figure, columns=2)
    finish_layout(figure)
    return figure
