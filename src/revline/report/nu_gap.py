"""The chord between two plants over frequency, beside the margin of a controller: where a model speaks for a plant, and where not."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from revline.design.stability.nu_gap import Guarantee
from revline.errors import InvalidInputError
from revline.report.parts import Level, check_some, draw_curve, draw_levels
from revline.report.style import (
    BLUE,
    FREQUENCY,
    HEIGHT,
    VERMILION,
    WIDE,
    WIDTH,
    Look,
    Quantity,
    add_legend,
    drawn,
    finish_layout,
    label_axes,
    new_figure,
    use_log,
)

CHORD: Final = Quantity("chord", "1")
MOST: Final = 3
"""Most pairs in one figure: more would be too narrow."""


@drawn
def plot_nu_gap(judged: Sequence[tuple[str, Guarantee]], *, span: tuple[float, float] = (0.1, 1000.0)) -> Figure:
    """Draw, for some controllers each on its own axes, how far model and plant are apart, and how far the loop is from oscillating.

    Where the chord between both plants is above the loop's own, the model says nothing about the loop on the plant: shaded.

    Args:
        judged: one to three titles and verdicts.
        span: frequencies shown, in rad/s.

    Raises:
        InvalidInputError: there are none, or too many, or the span shows nothing.
    """
    check_some("verdicts", judged)
    if len(judged) > MOST:
        message = f"{len(judged)} verdicts do not fit in one figure; give up to {MOST}"
        raise InvalidInputError(message)
    if not 0.0 < span[0] < span[1]:
        message = f"frequencies from {span[0]:g} to {span[1]:g} rad/s show nothing; the first must be above 0 and the lower"
        raise InvalidInputError(message)
    figure = new_figure(height=HEIGHT, width=WIDTH if len(judged) == 1 else WIDE)
    grid = figure.subplots(1, len(judged), squeeze=False, sharey=True)[0]
    for axes, (title, found) in zip(grid, judged, strict=True):
        _fill(axes, found)
        axes.set_title(title, fontsize=9.0)
        axes.set_xlim(*span)
        axes.set_ylim(0.0, 1.03)
        axes.set_xlabel(FREQUENCY.label)
    label_axes(grid[0], FREQUENCY, CHORD)
    add_legend(figure, columns=3)
    finish_layout(figure)
    return figure


def _fill(axes: Axes, found: Guarantee) -> None:
    use_log(axes, "x")
    omega, psi, chords = found.gap.omega, found.gap.psi, found.chords
    draw_curve(axes, omega, chords, Look(BLUE, "-"), "loop to oscillation")
    draw_curve(axes, omega, psi, Look(VERMILION, "-"), "model to plant")
    draw_levels(
        axes, horizontal=[Level(found.margin, "margin b", colour=BLUE), Level(found.gap.value, "nu-gap", colour=VERMILION, dash=":")]
    )
    axes.fill_between(
        omega, psi, chords, where=list(np.greater(psi, chords)), color=VERMILION, alpha=0.18, linewidth=0.0, label="no guarantee"
    )
