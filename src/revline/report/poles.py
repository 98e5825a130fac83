"""Poles in the complex plane."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError
from revline.report.parts import Level, check_columns, check_some, draw_curve, draw_levels
from revline.report.style import BLACK, BLUE, GREEN, VERMILION, Look, Quantity, add_legend, drawn, finish_layout, label_axes, new_figure

MARKERS: Final = (
    Look(BLUE, "", "o", filled=False),
    Look(VERMILION, "", "x"),
    Look(GREEN, "", "^", filled=False),
    Look(BLACK, "", "s", filled=False),
)


class PoleSet(NamedTuple):
    """Poles of one model, in 1/s."""

    poles: ArrayLike
    label: str
    look: Look | None = None


@drawn
def plot_poles(sets: Sequence[PoleSet]) -> Figure:
    """Draw the poles of some models with the imaginary axis.

    Args:
        sets: at least one.

    Raises:
        InvalidInputError: there are none, or poles are missing or not finite.
    """
    check_some("poles", sets)
    figure = new_figure()
    axes = figure.subplots()
    draw_levels(axes, horizontal=[Level(0.0, colour=BLACK, dash="-")], vertical=[Level(0.0, colour=BLACK, dash="-")])
    for k, entry in enumerate(sets):
        poles = np.atleast_1d(np.asarray(entry.poles, dtype=complex))
        if poles.ndim != 1:
            message = f"poles of {entry.label} have shape {poles.shape}; give a list"
            raise InvalidInputError(message)
        real, imaginary = check_columns(f"poles of {entry.label}", real=poles.real, imaginary=poles.imag)
        line = draw_curve(axes, real, imaginary, entry.look or MARKERS[k % len(MARKERS)], entry.label)
        line.set(markersize=7.0, markeredgewidth=1.4, markerfacecolor="none")
    axes.margins(0.08)
    label_axes(axes, Quantity("real part", "1/s"), Quantity("imaginary part", "1/s"))
    add_legend(figure)
    finish_layout(figure)
    return figure
