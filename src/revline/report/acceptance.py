"""What the acceptance battery measured at each operating point, beside what is asked for."""

import math
from collections.abc import Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from revline.design.trials.acceptance import Kind
from revline.design.trials.acceptance_summary import AcceptanceSummary, Floats, PlaceSummary
from revline.errors import InvalidInputError
from revline.report.parts import Level, draw_levels
from revline.report.style import BLACK, BLUE, GREEN, HEIGHT, PURPLE, VERMILION, WIDE, Quantity, add_legend, drawn, finish_layout, new_figure

LOOKS: Final = MappingProxyType({Kind.CLEAN: ("o", BLUE, -0.15), Kind.NOISY: ("^", VERMILION, 0.0), Kind.SPREAD: ("s", GREEN, 0.15)})
"""Marker, colour and place beside the tick of each kind of run."""

LABELS: Final = MappingProxyType({Kind.CLEAN: "as it is", Kind.NOISY: "with noise", Kind.SPREAD: "other engines, with noise"})

MOST_PLACES: Final = 24
"""More operating points than this are drawn by the worst of them only."""


@drawn
def plot_acceptance(found: AcceptanceSummary) -> Figure:
    """Draw overshoot, settling time, droop and gain reserve at each operating point, each run a point, what is asked for dashed.

    Args:
        found: at least one place that was run. Of more than 24 places those that were not, or have the least reserve, are shown.

    Raises:
        InvalidInputError: no place was run, so that there is nothing to draw.
    """
    if not any(place.kinds or place.reserve_db for place in found.places):
        message = "no place was run, so that there is nothing to draw; have unstable loops run, or mend the gains"
        raise InvalidInputError(message)
    shown = _worst(found.places)
    figure = new_figure(width=WIDE, height=1.5 * HEIGHT)
    panels = figure.subplots(2, 2, sharex=True)
    names = (Quantity("overshoot of the command", "1"), Quantity("settling time", "s"), Quantity("droop", "rad/s"))
    limits = found.limits
    for axes, quantity, name, limit in zip(panels.ravel(), names, ("overshoot", "settling", "droop"), limits, strict=False):
        _draw_measure(axes, quantity, [(place.kinds, getattr(place, name)) for place in shown], limit)
    _draw_reserve(panels[1, 1], shown, limits[3])
    for axes in panels[1]:
        axes.set_xticks(range(len(shown)), [_label(place) for place in shown], rotation=90, fontsize=7.0)
        axes.set_xlim(-0.6, len(shown) - 0.4)
    add_legend(figure, columns=4)
    finish_layout(figure)
    return figure


def _worst(places: Sequence[PlaceSummary]) -> Sequence[PlaceSummary]:
    if len(places) <= MOST_PLACES:
        return places
    least = sorted(range(len(places)), key=lambda k: places[k].reserve_db or (-math.inf,))[:MOST_PLACES]
    return [places[k] for k in sorted(least)]


def _draw_measure(axes: Axes, quantity: Quantity, values: Sequence[tuple[tuple[Kind, ...], Floats]], limit: float) -> None:
    for kind, (marker, colour, aside) in LOOKS.items():
        x = np.array([k + aside for k, (kinds, _) in enumerate(values) for own in kinds if own is kind])
        y = np.array([value for kinds, measured in values for own, value in zip(kinds, measured, strict=True) if own is kind])
        there = np.isfinite(y)
        axes.plot(x[there], y[there], marker, color=colour, markersize=3.5, markerfacecolor="none", label=LABELS[kind])
        if not there.all():
            top = axes.get_xaxis_transform()
            axes.plot(x[~there], np.full((~there).sum(), 0.98), "x", color=colour, transform=top, label="not by the end", clip_on=False)
    if math.isfinite(limit):
        draw_levels(axes, horizontal=[Level(limit, "asked for")])
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel(quantity.label)


def _draw_reserve(axes: Axes, places: Sequence[PlaceSummary], limit: float) -> None:
    x = [k for k, place in enumerate(places) if place.reserve_db]
    axes.plot(x, [places[k].reserve_db[0] for k in x], "D", color=BLACK, markersize=4.0, label="gain reserve")
    unstable = [k for k, place in enumerate(places) if place.unstable]
    if unstable:
        axes.plot(unstable, [0.0] * len(unstable), "P", color=PURPLE, markersize=5.0, label="linear loop unstable")
    draw_levels(axes, horizontal=[Level(limit, "asked for")])
    axes.set_ylim(bottom=min(0.0, *axes.get_ylim()))
    axes.set_ylabel(Quantity("gain reserve", "dB").label)


def _label(place: PlaceSummary) -> str:
    units = {"throttle": "deg", "load_torque": "N m"}
    return ", ".join(f"{value:g} {units.get(name, name)}" for name, value in place.place)
