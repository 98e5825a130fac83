from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError
from revline.report.spectrum import plot_spectrum
from revline.report.style import Quantity

Check = Callable[[Figure], Any]
SPEED = Quantity("speed amplitude", "rad/s")
OMEGA = np.arange(0.0, 40.0, 0.25)
LINES = 22.0 * np.exp(-np.abs(OMEGA - 5.0)) + 1e-3


def plot(omega: ArrayLike = OMEGA, lines: ArrayLike = LINES, input_frequency: float = 5.0, peak_frequency: float = 5.0) -> Figure:
    return plot_spectrum(omega, lines, input_frequency=input_frequency, peak_frequency=peak_frequency, peak=22.001, magnitude=SPEED)


def verticals(figure: Figure) -> list[float]:
    return [float(np.asarray(line.get_xdata())[0]) for line in figure.axes[0].lines if np.array_equal(line.get_ydata(), [0, 1])]


def test_a_spectrum_shows_six_harmonics_and_the_peak(check_figure: Check) -> None:
    picture = check_figure(plot())
    shown = OMEGA <= 32.5
    assert picture.holds(OMEGA[shown], LINES[shown])
    assert picture.holds([5.0], [22.001])
    assert picture.notes() == ["peak 22 rad/s at 5 rad/s"]
    assert picture.legend == ["input 5 rad/s", "multiples", "mean"]
    assert verticals(picture.figure) == [5.0, 10.0, 15.0, 20.0, 25.0, 30.0]
    assert picture.labels == [("frequency (rad/s)", "speed amplitude (rad/s)")]
    assert picture.figure.axes[0].get_yscale() == "log"
    assert picture.figure.axes[0].get_xlim() == (-0.6, 32.5)


def test_a_peak_beyond_the_harmonics_is_shown_too(check_figure: Check) -> None:
    picture = check_figure(plot(peak_frequency=36.0))
    assert picture.figure.axes[0].get_xlim()[1] == pytest.approx(39.6)


def test_lines_of_nothing_stand_on_the_lower_edge(check_figure: Check) -> None:
    lines = np.where(OMEGA == 5.0, 22.0, 0.0)
    axes = check_figure(plot(lines=lines)).figure.axes[0]
    drawn = np.asarray(axes.lines[0].get_ydata())
    assert drawn.max() == 22.0
    assert drawn.min() == axes.get_ylim()[0]


def test_many_lines_are_drawn_without_dots(check_figure: Check) -> None:
    omega = np.linspace(0.0, 30.0, 3000)
    figures = (plot(), plot(omega, np.exp(-omega) + 1e-2))
    dotted = [sum(line.get_marker() == "o" and len(line.get_xdata()) > 1 for line in check_figure(f).figure.axes[0].lines) for f in figures]
    assert dotted == [1, 0]


def test_what_lies_below_the_lower_edge_has_no_mark(check_figure: Check) -> None:
    """A mark there would be read as a line of that magnitude."""
    lines = np.where(OMEGA == 5.0, 22.0, 0.0)
    axes = check_figure(plot(lines=lines)).figure.axes[0]
    marked = np.concatenate([np.asarray(line.get_ydata()) for line in axes.lines if line.get_marker() == "o"])
    assert set(marked) == {22.0, 22.001}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lines": LINES[1:]}, "spectrum cannot be drawn: frequency of shape"),
        ({"lines": np.where(OMEGA == 5.0, np.nan, 1.0)}, r"magnitude\[20\] = nan is not finite"),
        ({"omega": OMEGA[::-1]}, "the frequencies of the spectrum do not rise from 0 on"),
        ({"omega": OMEGA - 1.0}, "the frequencies of the spectrum do not rise from 0 on"),
        ({"lines": -LINES}, "the spectrum has a magnitude of -22.001; magnitudes are not negative"),
        ({"lines": 0.0 * LINES}, r"no line of the spectrum up to 32.5 rad/s is above 0"),
        ({"input_frequency": 0.0}, "input frequency = 0 rad/s is outside the positive numbers"),
        ({"peak_frequency": float("nan")}, "peak frequency = nan rad/s is outside"),
    ],
)
def test_what_cannot_be_drawn_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        plot(**changes)
