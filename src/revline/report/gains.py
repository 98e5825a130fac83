"""Stabilising gains in the plane of kp and ki: region, boundary with its frequencies, contours, controllers, points by simulation."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from revline.design.regions.gain_region import GainRegion
from revline.design.regions.gain_slices import GainSlice
from revline.design.regions.nonlinear_boundary import NonlinearBoundary
from revline.design.regions.sensitivity_contour import SensitivityContour
from revline.errors import InvalidInputError
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import check_some, draw_curve
from revline.report.style import (
    BLACK,
    BLUE,
    HEIGHT,
    MODELS,
    PALE,
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
)

Floats = NDArray[np.float64]

CONTROLLER: Final = Look(VERMILION, "", "D")

MOST_PANELS: Final = 3
"""More slices than this do not stay legible side by side."""

SHADES: Final = 320
"""Points in each direction at which the filled area is counted; its edge is covered by the exact boundary."""

FREQUENCIES: Final = (0.12, 0.5, 0.85)
"""Where along the boundary its frequency is written, as parts of its length."""


@drawn
def plot_gain_slices(slices: Sequence[GainSlice], *, simulated: Sequence[NonlinearBoundary] = ()) -> Figure:
    """Draw stabilising gains, one panel for each kd.

    Args:
        slices: one to three.
        simulated: boundaries by simulation, each drawn in the panel of its kd, with the linear boundary at its target.

    Raises:
        InvalidInputError: there are none, or too many to stay legible.
    """
    check_some("slices of gains", slices)
    if len(slices) > MOST_PANELS:
        message = f"{len(slices)} slices of gains do not stay legible side by side; draw at most {MOST_PANELS} in one figure"
        raise InvalidInputError(message)
    count = len(slices)
    figure = new_figure(width=WIDTH if count == 1 else WIDE * (1.0 if count == 2 else 1.4), height=HEIGHT * 1.15)
    panels = np.atleast_1d(figure.subplots(1, count))
    unit = slices[0].region.family.gain_unit
    notes = []
    for axes, entry in zip(panels, slices, strict=True):
        beside = [found for found in simulated if found.case.kd == entry.region.family.kd]
        _draw_panel(axes, entry, beside)
        label_axes(axes, Quantity("kp", unit), Quantity("ki", f"{unit}/s"))
        if count > 1:
            axes.set_title(f"kd = {entry.region.family.kd:g}", fontsize=9.0)
        notes.append(_mark(axes, entry))
    for axes in panels[1:]:
        axes.set_ylabel("")
    add_legend(figure, columns=count + 1)
    finish_layout(figure)
    for axes, texts in zip(panels, notes, strict=True):
        place_notes(axes, texts)
    return figure


def _draw_panel(axes: Axes, entry: GainSlice, beside: Sequence[NonlinearBoundary]) -> None:
    region = entry.region
    view = _view(entry, beside)
    _fill(axes, region, view)
    _draw_boundary(axes, region, Look(BLACK, "-"), "stability boundary")
    for k, contour in enumerate(entry.contours):
        _draw_contour(axes, contour, MODELS[k % len(MODELS)]._replace(width=1.2))
    for damped in entry.damped:
        _draw_boundary(axes, damped, Look(BLACK, "--", width=1.1), f"damping {damped.family.contour.damping:g}")
    for found in beside:
        _draw_simulated(axes, found)
    axes.set_xlim(view[0], view[1])
    axes.set_ylim(0.0, view[2])


def _mark(axes: Axes, entry: GainSlice) -> list[Note]:
    """Mark frequencies on the boundary and controllers, and give their texts, still to be placed."""
    (low, high), (_, top) = axes.get_xlim(), axes.get_ylim()
    frequencies = [note for note in _frequency_notes(entry.region) if low <= note.x <= high and note.y <= top]
    mark_points(axes, frequencies)
    gains = [placed.mark for placed in entry.placed]
    if gains:
        draw_curve(axes, np.array([g.kp for g in gains]), np.array([g.ki for g in gains]), CONTROLLER, "controllers")
    return [*frequencies, *(Note(p.mark.kp, p.mark.ki, p.mark.name) for p in entry.placed)]


def _view(entry: GainSlice, beside: Sequence[NonlinearBoundary]) -> tuple[float, float, float]:
    """Part of the plane that is shown: a bounded region whole, of an unbounded one what holds the controllers, or the contours."""
    window = entry.region.window
    kp = [p.mark.kp for p in entry.placed]
    ki = [p.mark.ki for p in entry.placed]
    for found in beside:
        kp.append(float(np.max(found.linear.kp[found.linear.rim])))
        ki.append(float(np.max(found.linear.ki[found.linear.rim])))
    if entry.region.bounded:
        kp.append(window.kp_high / 1.15)
        ki.append(window.ki_high / 1.15)
    elif not entry.placed:
        for contour in entry.contours:
            kp += contour.kp.tolist()
            ki += contour.ki.tolist()
    right, top = 1.15 * max(kp, default=window.kp_high / 1.15), 1.15 * max(ki, default=window.ki_high / 1.15)
    right = min(right, entry.region.reach[0]) if right > 0.0 else window.kp_high
    top = min(top, entry.region.reach[1]) if top > 0.0 else window.ki_high
    return max(min([window.kp_low, *kp]), -0.2 * right), right, top


def _fill(axes: Axes, region: GainRegion, view: tuple[float, float, float]) -> None:
    low, high = max(view[0], -region.reach[0]), min(view[1], region.reach[0])
    kp, ki = np.linspace(low, high, SHADES), np.linspace(0.0, min(view[2], region.reach[1]), SHADES)
    ki[0] = 1e-9 * ki[-1]
    stable = region.stabilises(kp[None, :], ki[:, None])
    if not stable.any():
        return
    axes.contourf(kp, ki, stable.astype(float), levels=[0.5, 1.5], colors=[PALE], alpha=0.7, zorder=0.5)
    ends = "stable" if region.bounded else "stable, without end"
    axes.fill([], [], color=PALE, alpha=0.7, linewidth=0.0, label=ends)


def _draw_boundary(axes: Axes, region: GainRegion, look: Look, label: str) -> None:
    """Draw what bounds a region, each run of the curve as one line."""
    for run in _runs(region.rim):
        draw_curve(axes, region.kp[run], region.ki[run], look, label)
        label = ""


def _runs(flags: NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _draw_contour(axes: Axes, contour: SensitivityContour, look: Look) -> None:
    label = f"Ms = {contour.peak:g}"
    for k in np.unique(contour.piece):
        at = contour.piece == k
        draw_curve(axes, contour.kp[at], contour.ki[at], look, label)
        label = ""


def _draw_simulated(axes: Axes, found: NonlinearBoundary) -> None:
    _draw_boundary(axes, found.linear, Look(VERMILION, "--", width=1.2), f"linear at {found.target:.3g} deg")
    kp, ki = (np.array([getattr(point, name) for point in found.points]) for name in ("kp", "ki"))
    low, high = (np.array([getattr(point, name) for point in found.points]) for name in ("settled", "unsettled"))
    axes.plot([low * kp, high * kp], [low * ki, high * ki], color=BLUE, linewidth=1.0, zorder=3.0)
    draw_curve(axes, low * kp, low * ki, Look(BLUE, "", "o"), "settles, simulated")
    draw_curve(axes, high * kp, high * ki, Look(BLUE, "", "x"), "does not settle")


def _frequency_notes(region: GainRegion) -> list[Note]:
    at = np.flatnonzero(region.rim)
    if not at.size:
        return []
    window = region.window
    across, up = region.kp[at] / (window.kp_high - window.kp_low), region.ki[at] / window.ki_high
    length = np.hypot(np.diff(across, prepend=across[0]), np.diff(up, prepend=up[0])).cumsum()
    chosen = at[np.unique(np.searchsorted(length, np.array(FREQUENCIES) * length[-1]))]
    return [Note(float(region.kp[k]), float(region.ki[k]), f"{region.omega[k]:.3g} rad/s") for k in chosen]
