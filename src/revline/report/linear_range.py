"""Where a linear model may be trusted: its error over frequency and amplitude, and the amplitude up to which it holds."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from revline.errors import InvalidInputError
from revline.report.parts import Floats, check_columns, draw_curve
from revline.report.style import (
    BLUE,
    FREQUENCY,
    GREY,
    PALE,
    VERMILION,
    WIDE,
    Look,
    Quantity,
    add_legend,
    drawn,
    finish_layout,
    label_axes,
    new_figure,
    use_log,
)

LEVELS: Final = (0.01, 0.02, 0.05, 0.10)
"""Errors whose lines are drawn."""

SHADES: Final = ("#FFFFFF", "#E3F0F9", "#C2DFF1", "#94C6E6", "#5CA6D3")
"""From the smallest errors to the largest."""


class ErrorMap(NamedTuple):
    """Errors of a linear model over amplitudes (rows) and frequencies (columns).

    Attributes:
        omega: frequencies in rad/s, rising, shape (n_freq,).
        amplitudes: rising, shape (n_amp,).
        error: parts of the true response, shape (n_amp, n_freq).
        found: where there is a periodic answer, and so an error.
    """

    omega: Floats
    amplitudes: Floats
    error: Floats
    found: NDArray[np.bool_]


@drawn
def plot_linear_error(errors: ErrorMap, amplitude: Quantity) -> Figure:
    """Draw the error of a linear model over frequency and amplitude, with its lines of 1, 2, 5 and 10 %.

    Args:
        errors: at least two frequencies and amplitudes.
        amplitude: what the vertical axis shows.

    Raises:
        InvalidInputError: there are fewer, the shapes do not fit, or an error is not finite.
    """
    _check_map(errors)
    figure = new_figure(width=WIDE)
    axes = figure.subplots()
    use_log(axes, "x")
    # Errors grow with about the square of the amplitude: their roots are nearly straight between the points of the grid.
    root = np.ma.masked_array(np.sqrt(errors.error), mask=~errors.found)
    levels = np.sqrt(LEVELS)
    axes.contourf(errors.omega, errors.amplitudes, root, levels=[-1.0, *levels, 1e3], colors=SHADES, zorder=0.5)
    lines = axes.contour(errors.omega, errors.amplitudes, root, levels=levels, colors=BLUE, linewidths=1.2, zorder=2.5)
    axes.clabel(lines, fmt={level: f"{100.0 * part:g} %" for level, part in zip(levels, LEVELS, strict=True)}, fontsize=8.0)
    _shade_missing(axes, errors)
    axes.set_xlim(errors.omega[0], errors.omega[-1])
    axes.set_ylim(0.0, errors.amplitudes[-1])
    label_axes(axes, FREQUENCY, amplitude)
    add_legend(figure)
    finish_layout(figure)
    return figure


@drawn
def plot_linear_range(omega: ArrayLike, amplitudes: ArrayLike, reached: Sequence[bool], *, within: float, amplitude: Quantity) -> Figure:
    """Draw up to which amplitude a linear model holds, over frequency.

    Args:
        omega: frequencies in rad/s, rising.
        amplitudes: the largest at which it holds.
        reached: whether a limit of the error is reached there; else the range ends for another reason.
        within: the error, as a part.
        amplitude: what the vertical axis shows.

    Raises:
        InvalidInputError: columns differ in length or hold what is not finite, or frequencies do not rise.
    """
    frequencies, tops, flags = check_columns("range", frequency=omega, amplitude=amplitudes, reached=reached)
    if np.any(np.diff(frequencies) <= 0.0) or frequencies[0] <= 0.0:
        message = "the frequencies of the range do not rise from above 0 on; give them in order"
        raise InvalidInputError(message)
    figure = new_figure()
    axes = figure.subplots()
    use_log(axes, "x")
    axes.fill_between(frequencies, 0.0, tops, color=BLUE, alpha=0.12, linewidth=0.0)
    draw_curve(axes, frequencies, tops, Look(BLUE, "-", width=1.2))
    ended = flags > 0.0
    if np.any(ended):
        draw_curve(axes, frequencies[ended], tops[ended], Look(BLUE, "", "o"), f"error reaches {100.0 * within:g} %")
    if not np.all(ended):
        draw_curve(axes, frequencies[~ended], tops[~ended], Look(VERMILION, "", "s", filled=False), "ends for another reason")
    axes.set_ylim(0.0, 1.08 * float(np.max(tops)) or 1.0)
    label_axes(axes, FREQUENCY, amplitude)
    add_legend(figure)
    finish_layout(figure)
    return figure


def _shade_missing(axes: Axes, errors: ErrorMap) -> None:
    """Hatch what lies above the last amplitude with a periodic answer."""
    missing = ~np.all(errors.found, axis=0)
    if not np.any(missing):
        return
    count = np.where(missing, np.argmin(errors.found, axis=0), errors.amplitudes.size)
    edge = np.where(count > 0, errors.amplitudes[count - 1], 0.0)
    axes.fill_between(
        errors.omega,
        edge,
        errors.amplitudes[-1],
        where=missing | np.roll(missing, 1) | np.roll(missing, -1),
        facecolor=PALE,
        edgecolor=GREY,
        hatch="////",
        linewidth=0.0,
        zorder=1.5,
        label="no periodic answer found",
    )


def _check_map(errors: ErrorMap) -> None:
    shape = (errors.amplitudes.size, errors.omega.size)
    if min(shape) < 2 or errors.error.shape != shape or errors.found.shape != shape:
        message = (
            f"an error map of {shape[0]} amplitudes and {shape[1]} frequencies with errors of shape {errors.error.shape}; give 2 or more"
        )
        raise InvalidInputError(message)
    if not np.all(np.isfinite(errors.error)):
        message = "an error of the map is not finite; mark such cells as not found, and give them 0"
        raise InvalidInputError(message)
