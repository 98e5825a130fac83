"""Step responses of linear loops: settling ones with their measures, diverging ones, and the tangent that tuning rules read."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from revline.design.loops.step_measures import StepMeasures
from revline.errors import InvalidInputError, out_of_range
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import Level, check_columns, check_some, draw_curve, draw_levels
from revline.report.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    MODELS,
    TALL,
    TIME,
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
from revline.units import Seconds

Floats = NDArray[np.float64]

SPAN: Final = 6.0
"""A diverging response is shown as far as this many commands from its target."""


class Command(NamedTuple):
    """A step of a command: the output before it, and the output commanded."""

    start: float
    target: float

    @property
    def size(self) -> float:
        """Target less start."""
        return self.target - self.start


@dataclass(frozen=True, slots=True, kw_only=True)
class TangentTrace:
    """A step response with its tangent.

    Attributes:
        times: from the step on, in s.
        values: the response.
        dead_time: L, where the tangent crosses zero, in s.
        rise_time: T, from there to the final value, in s.
        final_value: what the response settles at.
        label: name of the model.

    Raises:
        InvalidInputError: the tangent has no slope or is not finite.
    """

    times: ArrayLike
    values: ArrayLike
    dead_time: Seconds
    rise_time: Seconds
    final_value: float
    label: str

    def __post_init__(self) -> None:
        for what, value, unit, possible, limit in (
            ("dead time", self.dead_time, "s", self.dead_time >= 0.0, "the numbers from 0 on"),
            ("rise time", self.rise_time, "s", self.rise_time > 0.0, "the positive numbers"),
            ("final value", self.final_value, "in output units", self.final_value != 0.0, "the finite numbers other than 0"),
        ):
            if not (math.isfinite(value) and possible):
                raise out_of_range(what, value, unit, limit, "measure the tangent again")


@drawn
def plot_step_response(
    times: ArrayLike,
    output: ArrayLike,
    command: Command,
    quantity: Quantity,
    *,
    measures: StepMeasures | None = None,
    until: Seconds | None = None,
) -> Figure:
    """Draw how an output follows a step of its command at time 0, with target, settling band and overshoot.

    Args:
        times: in s.
        output: what follows.
        command: the step.
        quantity: what the output is.
        measures: of the response; nothing is marked without.
        until: end of the part shown, in s.

    Raises:
        InvalidInputError: columns differ in length or hold what is not finite, the command is no step, or nothing is shown.
    """
    t, y = _shown("step response", times, output, until)
    _check_command(command)
    figure = new_figure()
    axes = figure.subplots()
    draw_curve(axes, t, y, MODELS[0])
    draw_levels(axes, horizontal=[Level(command.target, f"target {command.target:.5g} {_unit(quantity)}".strip())])
    notes = []
    if measures is not None:
        notes = _mark_measures(axes, command, measures, t)
    axes.margins(y=0.1)
    label_axes(axes, TIME, quantity)
    mark_points(axes, notes)
    add_legend(figure)
    finish_layout(figure)
    place_notes(axes, notes)
    return figure


@drawn
def plot_divergence(times: ArrayLike, output: ArrayLike, command: Command, quantity: Quantity) -> Figure:
    """Draw a response that leaves all bounds, as far as six commands from its target, and say when it gets there.

    Args:
        times: in s.
        output: what diverges.
        command: the step.
        quantity: what the output is.

    Raises:
        InvalidInputError: columns differ in length or hold what is not finite, the command is no step, or the response stays in bounds.
    """
    t, y = check_columns("diverging response", times=times, output=output)
    _check_command(command)
    bound = SPAN * abs(command.size)
    outside = np.flatnonzero(np.abs(y - command.target) > bound)
    if outside.size == 0:
        message = f"the response stays within {bound:g} of its target for {t[-1]:g} s; draw it with plot_step_response, or simulate longer"
        raise InvalidInputError(message, bound=bound)
    left = int(outside[0])
    if left == 0:
        message = f"the response is more than {bound:g} from its target at its first sample; give it from the step of the command on"
        raise InvalidInputError(message, bound=bound)
    figure = new_figure()
    axes = figure.subplots()
    draw_curve(axes, t[: left + 1], y[: left + 1], MODELS[0])
    axes.set_xlim(-0.02 * t[left], 1.04 * t[left])
    axes.set_ylim(command.target - bound, command.target + bound)
    draw_levels(
        axes,
        horizontal=[Level(command.target, f"target {command.target:.5g} {_unit(quantity)}".strip())],
        vertical=[Level(float(t[left]), f"leaves the picture (target ± {SPAN:g} commands) at {t[left]:.3g} s", VERMILION, ":")],
    )
    label_axes(axes, TIME, quantity)
    add_legend(figure)
    finish_layout(figure)
    return figure


@drawn
def plot_tangents(traces: Sequence[TangentTrace], quantity: Quantity) -> Figure:
    """Draw step responses with the tangent at their steepest point: whole above, the dead time enlarged below.

    Args:
        traces: one or two.
        quantity: what the responses are.

    Raises:
        InvalidInputError: there are none or more than two, or columns are unusable.
    """
    check_some("step responses", traces)
    if len(traces) > 2:
        message = f"{len(traces)} step responses do not fit side by side; give one or two"
        raise InvalidInputError(message, traces=len(traces))
    figure = new_figure(height=TALL, width=WIDE)
    rows = figure.subplots(2, len(traces), squeeze=False, sharey="row")
    for column, trace in enumerate(traces):
        t, y = check_columns(f"step response of {trace.label}", times=trace.times, values=trace.values)
        upper, lower = rows[0, column], rows[1, column]
        _draw_tangent(upper, trace, t, y, MODELS[column])
        _draw_tangent(lower, trace, t, y, MODELS[column])
        _frame_whole(upper, trace)
        _frame_detail(lower, trace, longest=max(trace.dead_time for trace in traces))
        label_axes(lower, TIME, quantity)
        label_axes(upper, None, quantity)
        for axes in (upper, lower) if column else ():
            axes.set_ylabel("")
    figure.align_ylabels()
    add_legend(figure)
    finish_layout(figure)
    return figure


def _shown(what: str, times: ArrayLike, output: ArrayLike, until: Seconds | None) -> tuple[Floats, Floats]:
    t, y = check_columns(what, times=times, output=output)
    kept = t <= (until if until is not None else math.inf)
    if not np.any(kept):
        message = f"{what}: no sample lies before {until:g} s; the first is at {t[0]:g} s"
        raise InvalidInputError(message)
    return t[kept], y[kept]


def _check_command(command: Command) -> None:
    if not (math.isfinite(command.size) and command.size != 0.0):
        message = f"a command from {command.start:g} to {command.target:g} is no step; give two different finite values"
        raise InvalidInputError(message)


def _mark_measures(axes: Axes, command: Command, measures: StepMeasures, t: Floats) -> list[Note]:
    half = measures.band * abs(command.size)
    text = f"settling band ±{100.0 * measures.band:g} % of the command, entered at {measures.settling_time:.3g} s"
    axes.axhspan(command.target - half, command.target + half, color=GREEN, alpha=0.15, linewidth=0.0, zorder=0.5, label=text)
    if measures.settling_time <= t[-1]:
        draw_levels(axes, vertical=[Level(measures.settling_time, colour=GREEN, dash=":")])
    if measures.overshoot > 0.0 and measures.peak_time <= t[-1]:
        return [Note(measures.peak_time, measures.peak, f"overshoot {100.0 * measures.overshoot:.1f} % at {measures.peak_time:.3g} s")]
    return []


def _draw_tangent(axes: Axes, trace: TangentTrace, t: Floats, y: Floats, look: Look) -> None:
    ends = np.array([trace.dead_time, trace.dead_time + trace.rise_time])
    draw_curve(axes, t, y, look, trace.label)
    draw_curve(axes, ends, np.array([0.0, trace.final_value]), Look(BLACK, "-", width=1.0), "tangent at the steepest point")
    draw_levels(axes, horizontal=[Level(trace.final_value, "final value")])


def _frame_whole(axes: Axes, trace: TangentTrace) -> None:
    end = trace.dead_time + trace.rise_time
    axes.set_xlim(0.0, 3.0 * end)
    axes.set_ylim(*sorted((-0.06 * trace.final_value, 1.22 * trace.final_value)))
    for time in (trace.dead_time, end):
        axes.plot([time, time], [0.0, 1.08 * trace.final_value], color=GREY, linewidth=0.7, linestyle=":", label="_nolegend_")
    _measure(axes, trace.dead_time, end, 1.06 * trace.final_value, f"T = {trace.rise_time:.4g} s")


def _frame_detail(axes: Axes, trace: TangentTrace, *, longest: Seconds) -> None:
    span = max(longest, 0.03 * trace.rise_time)
    axes.set_xlim(0.0, 3.0 * span)
    top = trace.final_value * 2.4 * span / trace.rise_time
    axes.set_ylim(*sorted((-0.08 * top, top)))
    axes.plot([trace.dead_time] * 2, [0.0, 0.66 * top], color=GREY, linewidth=0.7, linestyle=":", label="_nolegend_")
    _measure(axes, 0.0, trace.dead_time, 0.63 * top, f"L = {trace.dead_time:.4g} s", beside=True)


def _measure(axes: Axes, start: float, end: float, height: float, text: str, *, beside: bool = False) -> None:
    """Draw a dimension line with its text above it, or beside it where it is too short."""
    style = {"arrowstyle": "<->", "color": BLUE, "linewidth": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", (end, height), xytext=(start, height), arrowprops=style)
    place, shift, sides = (end, (5.0, 0.0), ("left", "center")) if beside else ((start + end) / 2.0, (0.0, 3.0), ("center", "bottom"))
    axes.annotate(text, (place, height), xytext=shift, textcoords="offset points", ha=sides[0], va=sides[1], fontsize=8.5)


def _unit(quantity: Quantity) -> str:
    return "" if quantity.unit == "1" else quantity.unit
