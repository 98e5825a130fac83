"""Nonlinear closed loops in time: the output with its target, and below it what the controller does."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from revline.design.loops.outcome import Diverged, LimitCycle, Outcome, Settled, Stalled
from revline.errors import InvalidInputError
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import Level, check_columns, draw_curve, draw_levels
from revline.report.style import (
    BLACK,
    BLUE,
    GREEN,
    HEIGHT,
    PALE,
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
from revline.values import make_read_only

Floats = NDArray[np.float64]

PERIODS: Final = 4.0
"""How many periods of a limit cycle are shown enlarged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopTrace:
    """What a closed loop did after a step of its command at time 0.

    Attributes:
        times: shape (n,), in s.
        output: what is controlled, shape (n,).
        control: what the controller drives, after its limits, shape (n,).
        start: output before the step.
        target: output commanded.
        low, high: limits of the control; infinite where there are none.
        outcome: how the loop ended.
    """

    times: Floats
    output: Floats
    control: Floats
    start: float
    target: float
    low: float
    high: float
    outcome: Outcome

    def __post_init__(self) -> None:
        t, y, u = check_columns("closed loop", times=self.times, output=self.output, control=self.control)
        if t.size < 2 or not (math.isfinite(self.start) and math.isfinite(self.target)):
            message = f"a closed loop of {t.size} samples from {self.start:g} to {self.target:g} cannot be drawn; give a simulated record"
            raise InvalidInputError(message)
        if isinstance(self.outcome, LimitCycle) and t[-1] - t[0] < PERIODS * self.outcome.period:
            message = (
                f"{t[-1] - t[0]:g} s of a limit cycle of period {self.outcome.period:g} s are too few; give {PERIODS:g} periods or more"
            )
            raise InvalidInputError(message, period=self.outcome.period)
        for name, column in (("times", t), ("output", y), ("control", u)):
            object.__setattr__(self, name, column)
        make_read_only(self)


@drawn
def plot_loop(trace: LoopTrace, output: Quantity, control: Quantity, *, until: Seconds | None = None) -> Figure:
    """Draw output and control over time; a limit cycle is shown enlarged at the right, with its bounds and period.

    What diverges is shown until it has.

    Args:
        trace: the record.
        output: what the output is.
        control: what the control is.
        until: end of the part shown at the left; the whole record where it is not given.

    Raises:
        InvalidInputError: no sample lies before `until`.
    """
    end = float(trace.times[-1]) if until is None else until
    if isinstance(trace.outcome, Diverged):
        end = min(end, 1.05 * trace.outcome.time)
    if end <= trace.times[0]:
        message = f"no sample of the closed loop lies before {end:g} s; the first is at {trace.times[0]:g} s"
        raise InvalidInputError(message, until=end)
    cycle = trace.outcome if isinstance(trace.outcome, LimitCycle) else None
    figure = new_figure(height=TALL, width=WIDE) if cycle else new_figure(height=HEIGHT + 0.3)
    grid = figure.subplots(
        2, 2 if cycle else 1, squeeze=False, sharex="col", height_ratios=(1.2, 1.0), width_ratios=(1.7, 1.0) if cycle else (1.0,)
    )
    _draw_pair(grid[0, 0], grid[1, 0], trace, (float(trace.times[0]), end), (output, control))
    label_axes(grid[0, 0], None, output)
    label_axes(grid[1, 0], TIME, control)
    notes = _outcome_notes(trace, end)
    if cycle is not None:
        window = _last_periods(trace, cycle)
        _draw_pair(grid[0, 1], grid[1, 1], trace, window, (output, control))
        _draw_bounds(grid[0, 1], trace, cycle, window, output)
        grid[1, 1].set_xlabel(TIME.label)
        grid[1, 1].xaxis.set_major_locator(MaxNLocator(3))
        if window[0] < end:
            for axes in grid[:, 0]:
                axes.axvspan(window[0], min(window[1], end), color=PALE, alpha=0.6, linewidth=0.0, zorder=0.5, label="enlarged at right")
    mark_points(grid[0, 0], notes)
    grid[0, 0].margins(y=0.2)
    figure.align_ylabels()
    add_legend(figure)
    finish_layout(figure)
    place_notes(grid[0, 0], notes)
    return figure


def _draw_pair(upper: Axes, lower: Axes, trace: LoopTrace, window: tuple[float, float], shows: tuple[Quantity, Quantity]) -> None:
    output, control = shows
    shown = (trace.times >= window[0]) & (trace.times <= window[1])
    t = trace.times[shown]
    draw_levels(upper, horizontal=[Level(trace.target, f"target {trace.target:.5g} {output.unit}")])
    draw_curve(upper, t, trace.output[shown], Look(BLUE, "-", width=1.2))
    draw_curve(lower, t, trace.control[shown], Look(VERMILION, "-", width=1.2))
    reached = [limit for limit in (trace.low, trace.high) if math.isfinite(limit) and _is_near(trace.control[shown], limit)]
    draw_levels(lower, horizontal=[Level(limit, f"limit of the {control.name}", colour=BLACK, dash=":") for limit in reached])
    upper.set_xlim(*window)


def _is_near(control: Floats, limit: float) -> bool:
    """Whether a limit is reached or so near that it belongs in the picture."""
    return bool(control.min() - 0.25 * np.ptp(control) <= limit <= control.max() + 0.25 * np.ptp(control))


def _outcome_notes(trace: LoopTrace, end: float) -> list[Note]:
    outcome = trace.outcome
    if isinstance(outcome, Settled):
        direction = math.copysign(1.0, trace.target - trace.start)
        peak = int(np.argmax(direction * trace.output))
        share = (trace.output[peak] - trace.target) / (trace.target - trace.start)
        if share > 0.0 and trace.times[peak] <= end:
            return [Note(float(trace.times[peak]), float(trace.output[peak]), f"overshoot {100.0 * share:.1f} % of the command")]
        return []
    if isinstance(outcome, Diverged | Stalled):
        verb = "diverges" if isinstance(outcome, Diverged) else "stalls"
        last = int(np.argmin(np.abs(trace.times - min(outcome.time, end))))
        return [Note(float(trace.times[last]), float(trace.output[last]), f"{verb} at {outcome.time:.3g} s")]
    return []


def _last_periods(trace: LoopTrace, cycle: LimitCycle) -> tuple[float, float]:
    end = float(trace.times[-1])
    return end - PERIODS * cycle.period, end


def _draw_bounds(axes: Axes, trace: LoopTrace, cycle: LimitCycle, window: tuple[float, float], output: Quantity) -> None:
    swing = cycle.high - cycle.low
    axes.axhspan(cycle.low, cycle.high, color=PALE, alpha=0.4, linewidth=0.0, zorder=0.5)
    for value, drop, side in ((cycle.high, 2.0, "bottom"), (cycle.low, -2.0, "top")):
        axes.annotate(
            f"{value:.5g} {output.unit}",
            (1.0, value),
            xycoords=("axes fraction", "data"),
            xytext=(0.0, drop),
            textcoords="offset points",
            ha="right",
            va=side,
            fontsize=8.5,
        )
    second = (trace.times >= window[0] + cycle.period) & (trace.times < window[0] + 2.0 * cycle.period)
    peak = float(trace.times[second][int(np.argmax(trace.output[second]))])
    height = cycle.high + 0.3 * swing
    style = {"arrowstyle": "<->", "color": GREEN, "linewidth": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", (peak + cycle.period, height), xytext=(peak, height), arrowprops=style)
    middle = (peak + cycle.period / 2.0, height)
    text = f"period {cycle.period:.4g} s"
    axes.annotate(text, middle, xytext=(0.0, 3.0), textcoords="offset points", ha="center", va="bottom", fontsize=8.5)
    axes.set_ylim(cycle.low - 0.25 * swing, cycle.high + 0.6 * swing)
