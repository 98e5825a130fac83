"""Gains over a map of operating points: the proportional limit, and the gains of several points over one another."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from revline.design.maps.gain_columns import GainColumns, peak_columns, stable_columns
from revline.design.maps.gain_map import GainMap, GainPoint
from revline.design.maps.schedule_design import ScheduleResult
from revline.errors import InvalidInputError
from revline.report.parts import draw_curve
from revline.report.style import (
    BLACK,
    GREY,
    HEIGHT,
    MODELS,
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
)

Floats = NDArray[np.float64]

SHADES: Final = ("#FFFFFF", "#E3F0F9", "#C2DFF1", "#94C6E6", "#5CA6D3", "#2E7FB3", "#0B5A8C")
"""From the smallest gains to the largest."""

OUTLINE: Final = 241
"""Columns of an outline."""

FLAT: Final = 0.1
"""Magnitude of kp below which the axis of the overlay is linear, as it shows both signs."""


@drawn
def plot_gain_map(found: GainMap) -> Figure:
    """Draw the largest kp over the map where it is one, and the gains of its corners over one another, with what all points allow.

    Args:
        found: at least one point with gains.

    Raises:
        InvalidInputError: no point has gains.
    """
    if not any(point.best for point in found.found):
        message = "no point of the map has gains that could be drawn; allow a higher peak of the sensitivity, or another kd"
        raise InvalidInputError(message)
    wide = min(found.grid.shape) > 1 and not found.lost
    figure = new_figure(width=WIDE * (1.5 if wide else 1.0), height=HEIGHT * 1.15)
    panels = figure.subplots(1, 2 if wide else 1, squeeze=False)[0]
    if wide:
        _draw_limits(figure, panels[0], found)
    _draw_overlay(panels[-1], found)
    add_legend(figure, columns=3)
    finish_layout(figure)
    return figure


@drawn
def plot_schedule(result: ScheduleResult) -> Figure:
    """Draw a schedule's kp and ki over its two signals, and the peak of the sensitivity wherever it was tried.

    Args:
        result: the schedule with its evidence.
    """
    schedule = result.schedule
    figure = new_figure(width=WIDE * 1.8, height=HEIGHT)
    panels = figure.subplots(1, 3)
    x, y = (Quantity(_plain(name), unit) for name, unit in zip(schedule.names, schedule.units, strict=True))
    for axes, name, table, unit in (
        (panels[0], "kp", schedule.kp, schedule.gain_unit),
        (panels[1], "ki", schedule.ki, f"{schedule.gain_unit}/s"),
    ):
        draw_heat(figure, axes, schedule.first, schedule.second, table)
        axes.set_title(f"{name} ({unit})", fontsize=9.0)
        label_axes(axes, x, y)
    places = np.array([entry.place for entry in result.tried])
    shown = panels[2].scatter(places[:, 0], places[:, 1], c=[entry.peak for entry in result.tried], s=12.0, cmap="Blues", edgecolors="none")
    figure.colorbar(shown, ax=panels[2])
    panels[2].plot([result.worst_at[0]], [result.worst_at[1]], "x", color=VERMILION, label=f"highest, {result.worst:.4g}")
    panels[2].set_title("Ms between the nodes", fontsize=9.0)
    label_axes(panels[2], x, y)
    add_legend(figure)
    finish_layout(figure)
    return figure


def _draw_limits(figure: Figure, axes: Axes, found: GainMap) -> None:
    grid, unit = found.grid, found.gain_unit
    draw_heat(figure, axes, grid.first_values, grid.second_values, found.limits)
    label_axes(axes, Quantity(_plain(grid.first), found.units[0]), Quantity(_plain(grid.second), found.units[1]))
    axes.set_title(f"largest kp ({unit}), kd = {found.kd:g}", fontsize=9.0)


def draw_heat(figure: Figure, axes: Axes, x: Floats, y: Floats, values: Floats) -> None:
    """Draw values over two axes as shades between lines of equal value, evenly spaced in their logarithm where all are positive.

    A bar beside the axes tells the values: labels on the lines would be cut off where these leave the map.

    Args:
        figure: that holds the axes.
        axes: to draw in.
        x: rising, shape (n,).
        y: rising, shape (m,).
        values: shape (n, m); those that are not finite are hatched.
    """
    shown = np.ma.masked_invalid(values.T)
    low, high = float(shown.min()), float(shown.max())
    apart = low > 0.0 and high > 3.0 * low
    levels = np.geomspace(low, high, len(SHADES) + 1) if apart else np.linspace(low, max(high, low + 1e-12), len(SHADES) + 1)
    axes.set_facecolor(PALE)
    filled = axes.contourf(x, y, shown, levels=levels, colors=SHADES, zorder=0.5, extend="neither")
    axes.contour(x, y, shown, levels=levels[1:-1], colors=BLACK, linewidths=0.8, zorder=2.5)
    figure.colorbar(filled, ax=axes, format="%.3g")


def _draw_overlay(axes: Axes, found: GainMap) -> None:
    chosen = _outermost(found)
    bottom = 0.02 * min(point.best.ki for point in found.found if point.best)
    for point, look in zip(chosen, MODELS, strict=False):
        label = ", ".join(f"{value:g} {unit}" for value, unit in zip(point.place, found.units, strict=True))
        kp = _columns(point)
        allowed = peak_columns(point.region, kp, found.peak, point.ellipses)
        _outline(axes, stable_columns(point.region, kp), look._replace(dash=":", width=1.0), label if allowed.empty else "", bottom)
        _outline(axes, allowed, look, label, bottom)
    if found.allowed is not None and not found.allowed.empty:
        common = found.allowed
        axes.fill_between(common.kp[common.column], np.maximum(common.low, bottom), np.maximum(common.high, bottom), color=GREY, alpha=0.5)
        axes.fill([], [], color=GREY, alpha=0.5, linewidth=0.0, label="at every point")
    axes.set_xscale("symlog", linthresh=FLAT)
    axes.set_yscale("log")
    axes.set_ylim(bottom=bottom)
    label_axes(axes, Quantity("kp", found.gain_unit), Quantity("ki", f"{found.gain_unit}/s"))
    axes.set_title(f"Ms at most {found.peak:g} (lines), stable (dots)", fontsize=9.0)


def _outermost(found: GainMap) -> list[GainPoint]:
    """Of the first and the last value of the second axis that have steady states, the first and the last point that has one."""
    count = found.grid.shape[0]
    rows = [[p for p in found.points[k : k + count] if isinstance(p, GainPoint)] for k in range(0, len(found.points), count)]
    kept = [row for row in rows if row]
    ends = [kept[0][0], kept[0][-1], kept[-1][0], kept[-1][-1]]
    return [point for k, point in enumerate(ends) if point not in ends[:k]]


def _columns(point: GainPoint) -> Floats:
    """Columns of kp for an outline, as close as the axis shows them: evenly up to `FLAT`, then by its logarithm."""
    window = point.region.window
    ends = np.arcsinh(np.array([window.kp_low, window.kp_high]) / (0.5 * FLAT))
    return np.asarray(0.5 * FLAT * np.sinh(np.linspace(ends[0], ends[1], OUTLINE)))


def _outline(axes: Axes, gains: GainColumns, look: Look, label: str, bottom: float) -> None:
    """Draw the upper edge of a set of gains."""
    if gains.empty:
        return
    kp = gains.kp[gains.column]
    ends = np.concatenate((kp[:1], kp, kp[-1:]))
    draw_curve(axes, ends, np.concatenate(([bottom], np.maximum(gains.high, bottom), [bottom])), look, label)


def _plain(name: str) -> str:
    return name.replace("_", " ")
