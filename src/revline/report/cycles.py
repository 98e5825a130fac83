"""Figures of limit cycles: an orbit in the plane of two quantities beside its simulation, and a family of cycles over its gains."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import check_columns, draw_curve
from revline.report.style import BLACK, BLUE, VERMILION, Look, Quantity, add_legend, drawn, finish_layout, label_axes, new_figure


class Plane(NamedTuple):
    """What the axes of an orbit's picture show."""

    x: Quantity
    y: Quantity


@drawn
def plot_orbit(x: ArrayLike, y: ArrayLike, plane: Plane, *, simulated: tuple[ArrayLike, ArrayLike] | None = None) -> Figure:
    """Draw a cycle in the plane of two quantities, closed, with samples of a simulation as points.

    Args:
        x: over one period, at equal distances.
        y: in the same way.
        plane: what the axes show.
        simulated: samples of both from a simulation.

    Raises:
        InvalidInputError: columns are empty, differ in length or hold what is not finite.
    """
    across, up = check_columns("orbit", x=x, y=y)
    figure = new_figure()
    axes = figure.subplots()
    draw_curve(axes, np.append(across, across[:1]), np.append(up, up[:1]), Look(BLUE, "-"), "orbit computed")
    if simulated is not None:
        seen_x, seen_y = check_columns("simulated orbit", x=simulated[0], y=simulated[1])
        draw_curve(axes, seen_x, seen_y, Look(VERMILION, "", "o", filled=False), "simulation").set(markersize=3.5)
    label_axes(axes, plane.x, plane.y)
    add_legend(figure)
    finish_layout(figure)
    return figure


@drawn
def plot_branch(
    factors: ArrayLike,
    amplitudes: ArrayLike,
    stable: ArrayLike,
    plane: Plane,
    *,
    onset: float,
    simulated: tuple[ArrayLike, ArrayLike] | None = None,
) -> Figure:
    """Draw a family of cycles: amplitude over the factor of all gains, stable ones full, unstable ones dashed, the onset marked.

    Args:
        factors: of all gains, along the family.
        amplitudes: of the cycles.
        stable: whether each cycle is stable.
        plane: what the axes show.
        onset: factor at which hunting begins.
        simulated: factors, and amplitudes that simulations end in.

    Raises:
        InvalidInputError: columns are empty, differ in length or hold what is not finite.
    """
    gains, sizes, flags = check_columns("family of cycles", factors=factors, amplitudes=amplitudes, stable=stable)
    gains, sizes, firm = np.append(onset, gains), np.append(0.0, sizes), np.append(flags[0], flags) > 0.0
    figure = new_figure()
    axes = figure.subplots()
    edges = np.flatnonzero(firm[1:] != firm[:-1])
    shown = set[bool]()
    for begin, end in zip((0, *edges), (*edges, firm.size - 1), strict=True):
        kind = bool(firm[end])
        look = Look(BLUE, "-", "o") if kind else Look(VERMILION, "--", "o", filled=False)
        label = "" if kind in shown else ("stable cycles" if kind else "unstable cycles")
        draw_curve(axes, gains[begin : end + 1], sizes[begin : end + 1], look, label).set(markersize=2.5)
        shown.add(kind)
    if simulated is not None:
        seen_x, seen_y = check_columns("simulated cycles", factors=simulated[0], amplitudes=simulated[1])
        draw_curve(axes, seen_x, seen_y, Look(BLACK, "", "s", filled=False), "simulated").set(markersize=6.0)
    label_axes(axes, plane.x, plane.y)
    notes = [Note(onset, 0.0, f"onset at {onset:.4g}")]
    mark_points(axes, notes)
    add_legend(figure)
    finish_layout(figure)
    place_notes(axes, notes)
    return figure
