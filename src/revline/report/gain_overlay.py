"""The gains that stabilise several plants, drawn over one another in the plane of kp and ki, with controllers in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from revline.report.curves import View
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import check_columns, check_some, draw_curve
from revline.report.style import PALE, WIDE, Look, Quantity, add_legend, drawn, finish_layout, label_axes, new_figure
from revline.values import make_read_only

Floats = NDArray[np.float64]

SHADE: Final = 0.55


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outline:
    """A line in the plane of gains: the boundary of what stabilises one plant, or a contour.

    Attributes:
        label: in the legend.
        kp, ki: its points, shape (n,).
        run: to which unbroken run of the line each point belongs, shape (n,).
        look: how it is drawn.
        shaded: whether what lies between each run and ki = 0 is shaded.

    Raises:
        InvalidInputError: columns are empty, differ in length or hold what is not finite.
    """

    label: str
    kp: Floats
    ki: Floats
    run: NDArray[np.int64]
    look: Look
    shaded: bool = False

    def __post_init__(self) -> None:
        check_columns(f"outline {self.label!r}", kp=self.kp, ki=self.ki, run=self.run)
        make_read_only(self)


@drawn
def plot_gain_overlay(outlines: Sequence[Outline], controllers: Sequence[Note], kp: Quantity, ki: Quantity, *, view: View) -> Figure:
    """Draw outlines of stabilising gains over one another.

    Args:
        outlines: of plants, and contours.
        controllers: gains kp and ki of controllers, with their names; there is at least one of these or of those.
        kp: what the horizontal axis shows.
        ki: what the vertical axis shows.
        view: the part shown.

    Raises:
        InvalidInputError: there are neither, or a controller's gain is not finite.
    """
    check_some("outlines or controllers", (*outlines, *controllers))
    figure = new_figure(width=WIDE)
    axes = figure.subplots()
    for outline in outlines:
        label = outline.label
        for run in np.unique(outline.run):
            at = outline.run == run
            draw_curve(axes, outline.kp[at], outline.ki[at], outline.look, label)
            if outline.shaded:
                axes.fill(outline.kp[at], outline.ki[at], color=PALE, alpha=SHADE, linewidth=0.0, zorder=0.5)
            label = ""
    axes.axvline(0.0, color=PALE, linewidth=0.8, zorder=0.8)
    mark_points(axes, controllers)
    if view.x is not None:
        axes.set_xlim(*view.x)
    if view.y is not None:
        axes.set_ylim(*view.y)
    label_axes(axes, kp, ki)
    add_legend(figure)
    finish_layout(figure)
    place_notes(axes, controllers)
    return figure
