"""Amplitude spectra: the input's frequency, its harmonics and the highest peak in one picture."""

import math
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError, out_of_range
from revline.report.notes import Note, mark_points, place_notes
from revline.report.parts import Level, check_columns, draw_curve, draw_levels
from revline.report.style import (
    BLUE,
    FREQUENCY,
    VERMILION,
    Look,
    Quantity,
    add_legend,
    drawn,
    finish_layout,
    label_axes,
    new_figure,
    use_log,
)
from revline.units import RadiansPerSecond

HARMONICS: Final = 6
"""How many multiples of the input's frequency are shown."""

DEPTH: Final = 1e-5
"""The lowest magnitude shown, as a part of the highest."""

FEW: Final = 150
"""Up to so many lines each is marked."""


@drawn
def plot_spectrum(
    frequencies: ArrayLike,
    magnitudes: ArrayLike,
    *,
    input_frequency: RadiansPerSecond,
    peak_frequency: RadiansPerSecond,
    peak: float,
    magnitude: Quantity,
) -> Figure:
    """Draw an amplitude spectrum over a linear frequency axis, as far as the input's sixth harmonic or the peak, magnitudes logarithmic.

    Args:
        frequencies: of the lines, in rad/s, rising.
        magnitudes: of the lines, none negative; what lies below the lower edge is drawn there, without a mark.
        input_frequency: of the sinusoid that was put in.
        peak_frequency: where the highest line is, that at zero frequency left out.
        peak: its magnitude.
        magnitude: what the magnitudes are.

    Raises:
        InvalidInputError: columns differ in length or hold what is not finite, frequencies do not rise, magnitudes are negative or all 0,
            no line lies in the part shown, or the input's frequency or the peak is not positive.
    """
    omega, lines = check_columns("spectrum", frequency=frequencies, magnitude=magnitudes)
    _check(omega, lines)
    for name, value in (("input frequency", input_frequency), ("peak frequency", peak_frequency), ("peak", peak)):
        if not (math.isfinite(value) and value > 0.0):
            unit = magnitude.unit if name == "peak" else "rad/s"
            raise out_of_range(name, value, unit, "the positive numbers", "give what the sinusoid and its spectrum have")
    end = max((HARMONICS + 0.5) * input_frequency, 1.1 * peak_frequency)
    shown = omega <= end
    if not np.any(lines[shown] > 0.0):
        message = f"no line of the spectrum up to {end:g} rad/s is above 0: there is nothing to see; check the signal"
        raise InvalidInputError(message, input_frequency=input_frequency)
    highest = float(lines[shown].max())
    lowest = max(float(lines[shown][lines[shown] > 0.0].min()), DEPTH * highest)
    floor = 10.0 ** math.floor(math.log10(lowest))
    figure = new_figure()
    axes = figure.subplots()
    use_log(axes, "y")
    axes.fill_between(omega[shown], floor, np.maximum(lines[shown], floor), color=BLUE, alpha=0.12, linewidth=0.0)
    draw_curve(axes, omega[shown], np.maximum(lines[shown], floor), Look(BLUE, "-", width=1.2))
    seen = shown & (lines > floor)
    if np.count_nonzero(shown) <= FEW:
        draw_curve(axes, omega[seen], lines[seen], Look(BLUE, "", "o"))
    multiples = [Level(k * input_frequency, "multiples" if k == 2 else "", dash=":") for k in range(2, HARMONICS + 1)]
    input_line = Level(input_frequency, f"input {input_frequency:g} rad/s", colour=VERMILION)
    draw_levels(axes, vertical=[input_line, *multiples])
    notes = [Note(peak_frequency, peak, f"peak {peak:.4g} {magnitude.unit} at {peak_frequency:.4g} rad/s")]
    mark_points(axes, notes)
    if omega[0] == 0.0 and seen[0]:
        draw_curve(axes, omega[:1], lines[:1], Look(BLUE, "", "o", filled=False), "mean").set(markersize=6.5)
    axes.set_xlim(-0.12 * input_frequency, end)
    axes.set_ylim(floor, 4.0 * max(highest, peak))
    label_axes(axes, FREQUENCY, magnitude)
    add_legend(figure)
    finish_layout(figure)
    place_notes(axes, notes)
    return figure


def _check(omega: np.ndarray, lines: np.ndarray) -> None:
    if np.any(np.diff(omega) <= 0.0) or omega[0] < 0.0:
        message = "the frequencies of the spectrum do not rise from 0 on; give its lines in order"
        raise InvalidInputError(message)
    if np.any(lines < 0.0):
        message = f"the spectrum has a magnitude of {lines.min():g}; magnitudes are not negative"
        raise InvalidInputError(message)
