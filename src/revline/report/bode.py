"""Frequency responses: Bode plots, errors of models, closed loops, and the phase line that gives a delay."""

import itertools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError, out_of_range
from revline.lti.response import FrequencyResponse
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import Curve, Level, check_columns, check_some, draw_curve, draw_curves, draw_levels
from revline.report.style import (
    BLACK,
    DATA,
    FREQUENCY,
    MODELS,
    PHASE,
    VERMILION,
    Look,
    Quantity,
    add_legend,
    drawn,
    finish_layout,
    label_axes,
    new_figure,
    use_degrees,
    use_log,
)
from revline.units import DEGREE, RadiansPerSecond, Seconds

HALF_POWER: Final = 1.0 / math.sqrt(2.0)


class BodeTrace(NamedTuple):
    """A frequency response in a Bode plot, with its name in the legend; the next of MODELS where it has no look."""

    response: FrequencyResponse
    label: str
    look: Look | None = None


class ErrorTrace(NamedTuple):
    """What a model's response is wrong by: decibels and degrees at frequencies in rad/s."""

    omega: ArrayLike
    magnitude_db: ArrayLike
    phase_deg: ArrayLike
    label: str
    look: Look | None = None


@drawn
def plot_bode(traces: Sequence[BodeTrace]) -> Figure:
    """Draw magnitude in decibels and phase in degrees over a logarithmic frequency axis.

    Args:
        traces: at least one, all of the same units.

    Raises:
        InvalidInputError: there are none, units differ, a frequency is 0, or a magnitude is 0.
    """
    figure, _, _ = _draw_bode(traces)
    add_legend(figure)
    finish_layout(figure)
    return figure


@drawn
def plot_closed_loop_bode(traces: Sequence[BodeTrace], *, bandwidth: RadiansPerSecond, level: float = HALF_POWER) -> Figure:
    """Draw a closed loop from command to output, and where its magnitude falls below a level.

    Args:
        traces: at least one, all of the same units; the bandwidth is that of the first.
        bandwidth: frequency to mark.
        level: magnitude there, not decibels.

    Raises:
        InvalidInputError: as for `plot_bode`, or bandwidth or level are not positive.
    """
    for name, value, unit in (("bandwidth", bandwidth, "rad/s"), ("level", level, "as a magnitude")):
        if not (math.isfinite(value) and value > 0.0):
            raise out_of_range(name, value, unit, "the positive numbers", "give what the closed loop's measures say")
    level_db = 20.0 * math.log10(level)
    figure, magnitude, phase = _draw_bode(traces)
    draw_levels(magnitude, horizontal=[Level(level_db, f"{_signed(level_db)} dB")])
    for axes, text in ((magnitude, "bandwidth"), (phase, "")):
        draw_levels(axes, vertical=[Level(bandwidth, text, colour=VERMILION, dash=":")])
    notes = [Note(bandwidth, level_db, f"{bandwidth:.2f} rad/s")]
    mark_points(magnitude, notes)
    add_legend(figure)
    finish_layout(figure)
    place_notes(magnitude, notes)
    return figure


@drawn
def plot_response_errors(traces: Sequence[ErrorTrace]) -> Figure:
    """Draw errors of models in decibels and in degrees; the largest of each kind is marked where there is one model only.

    Args:
        traces: at least one.

    Raises:
        InvalidInputError: there are none, columns differ in length, hold what is not finite, or a frequency is not positive.
    """
    check_some("errors", traces)
    figure = new_figure()
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    use_log(phase, "x")
    notes: list[tuple[Axes, Note]] = []
    for k, trace in enumerate(traces):
        what = f"errors of {trace.label}"
        omega, decibels, degrees = check_columns(what, frequency=trace.omega, magnitude=trace.magnitude_db, phase=trace.phase_deg)
        _refuse_zero_frequency(omega, what)
        look = trace.look or MODELS[k % len(MODELS)]._replace(marker="o" if len(traces) == 1 else "")
        for axes, values, unit in ((magnitude, decibels, "dB"), (phase, degrees, "deg")):
            draw_curve(axes, omega, values, look, trace.label)
            worst = int(np.argmax(np.abs(values)))
            notes.append((axes, Note(omega[worst], values[worst], f"{_signed(values[worst])} {unit} at {omega[worst]:g} rad/s")))
    for axes in (magnitude, phase):
        draw_levels(axes, horizontal=[Level(0.0, colour=BLACK, dash="-")])
    label_axes(magnitude, None, Quantity("magnitude error", "dB"))
    label_axes(phase, FREQUENCY, Quantity("phase error", "deg"))
    use_degrees(phase, _height(phase))
    figure.align_ylabels()
    add_legend(figure)
    finish_layout(figure)
    if len(traces) == 1:
        for axes, note in notes:
            mark_points(axes, [note])
            place_notes(axes, [note])
    return figure


@drawn
def plot_phase_line(omega: ArrayLike, difference_deg: ArrayLike, *, slope: Seconds, intercept_deg: float) -> Figure:
    """Draw the phase difference between data and a model over a linear frequency axis, and the straight line that gives the delay.

    Args:
        omega: frequencies in rad/s.
        difference_deg: phase of the data less that of the model, in degrees; drawn in radians.
        slope: of the line, in rad per rad/s, that is s; minus the delay.
        intercept_deg: of the line, at zero frequency, in degrees.

    Raises:
        InvalidInputError: columns differ in length or hold what is not finite, or the line is not finite.
    """
    frequencies, degrees = check_columns("phase difference", frequency=omega, phase=difference_deg)
    if not (math.isfinite(slope) and math.isfinite(intercept_deg)):
        message = f"a phase line of slope {slope:g} s and intercept {intercept_deg:g} deg cannot be drawn; give finite numbers"
        raise InvalidInputError(message)
    ends = np.array([0.0, float(frequencies.max())])
    figure = new_figure()
    axes = figure.subplots()
    line = intercept_deg * DEGREE + slope * ends
    draw_curves(
        axes,
        [
            Curve(x=ends, y=line, label=f"straight line, slope {_signed(slope, 4)} s: delay {_signed(-1e3 * slope, 4)} ms", look=MODELS[0]),
            Curve(x=frequencies, y=degrees * DEGREE, label="data less model", look=DATA),
        ],
    )
    label_axes(axes, FREQUENCY, Quantity("phase difference", "rad"))
    add_legend(figure)
    finish_layout(figure)
    return figure


def _draw_bode(traces: Sequence[BodeTrace]) -> tuple[Figure, Axes, Axes]:
    check_some("frequency responses", traces)
    first = traces[0].response
    figure = new_figure()
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    use_log(phase, "x")
    free = itertools.cycle(MODELS)
    for trace in traces:
        response, look = trace.response, trace.look or next(free)
        units = (response.output_unit, response.input_unit)
        if units != (first.output_unit, first.input_unit):
            message = (
                f"responses {traces[0].label!r} in {first.output_unit} per {first.input_unit} and {trace.label!r} in {units[0]} per "
                f"{units[1]} cannot share an axis; give responses of one unit"
            )
            raise InvalidInputError(message)
        _refuse_zero_frequency(response.omega, f"response {trace.label!r}")
        draw_curve(magnitude, response.omega, response.magnitude_db, look, trace.label)
        draw_curve(phase, response.omega, response.phase_deg, look, trace.label)
    unit = "dB" if first.output_unit == first.input_unit else f"dB re 1 {first.output_unit} per {first.input_unit}"
    label_axes(magnitude, None, Quantity("magnitude", unit))
    label_axes(phase, FREQUENCY, PHASE)
    use_degrees(phase, _height(phase))
    figure.align_ylabels()
    return figure, magnitude, phase


def _refuse_zero_frequency(omega: ArrayLike, what: str) -> None:
    if np.any(np.asarray(omega) <= 0.0):
        message = f"{what} has a frequency of 0 rad/s or below, which a logarithmic axis cannot show; leave it out"
        raise InvalidInputError(message)


def _height(axes: Axes) -> float:
    low, high = axes.get_ylim()
    return high - low


def _signed(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}g}".replace("-", "\N{MINUS SIGN}")
