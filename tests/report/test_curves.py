from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.errors import InvalidInputError
from revline.report.curves import View, plot_curves, plot_curves_with_detail
from revline.report.figure_files import render_figure
from revline.report.notes import Note
from revline.report.parts import Curve, Level
from revline.report.style import DATA, TIME, Quantity

Check = Callable[[Figure], Any]
SPEED = Quantity("engine speed", "rad/s")
T = np.linspace(0.0, 4.0, 401)
RISE = 240.8 + 60.0 * (1.0 - np.exp(-2.0 * T))


def test_curves_are_drawn_as_given_with_names_and_units(check_figure: Check) -> None:
    picture = check_figure(
        plot_curves(
            [Curve(x=T, y=RISE, label="5 deg"), Curve(x=T[::50], y=RISE[::50], label="points", look=DATA)],
            TIME,
            SPEED,
            notes=[Note(2.0, float(RISE[200]), "half way")],
            levels=[Level(300.8, "final value")],
            verticals=[Level(1.0, "one second")],
        )
    )
    assert picture.holds(T, RISE)
    assert picture.holds(T[::50], RISE[::50])
    assert picture.legend == ["5 deg", "points", "final value", "one second"]
    assert picture.labels == [("time (s)", "engine speed (rad/s)")]
    assert picture.notes() == ["half way"]


def test_one_curve_needs_no_legend(check_figure: Check) -> None:
    assert check_figure(plot_curves([Curve(x=T, y=RISE)], TIME, SPEED)).legend == []


def test_a_view_limits_and_bends_axes(check_figure: Check) -> None:
    view = View(x=(1.0, 3.0), y=(100.0, 1000.0), log="y")
    axes = check_figure(plot_curves([Curve(x=T, y=RISE)], TIME, SPEED, view=view)).figure.axes[0]
    assert (axes.get_xlim(), axes.get_ylim(), axes.get_yscale(), axes.get_xscale()) == ((1.0, 3.0), (100.0, 1000.0), "log", "linear")


def test_a_detail_shows_what_happens_within_it(check_figure: Check) -> None:
    curves = [Curve(x=T, y=RISE, label="G1"), Curve(x=T, y=2.0 * RISE, label="G2")]
    picture = check_figure(plot_curves_with_detail(curves, TIME, SPEED, detail=View(x=(0.0, 0.1)), levels=[Level(250.0)]))
    assert picture.holds(T, RISE, axes=0)
    assert picture.holds(T, RISE, axes=1)
    whole, detail = picture.figure.axes
    assert detail.get_xlim() == (0.0, 0.1)
    low, high = detail.get_ylim()
    assert low < RISE[0]
    assert 2.0 * RISE[10] < high < whole.get_ylim()[1]
    assert picture.legend == ["G1", "G2", "shown enlarged below"]


def test_a_detail_keeps_heights_that_are_given(check_figure: Check) -> None:
    figure = plot_curves_with_detail([Curve(x=T, y=RISE)], TIME, SPEED, detail=View(x=(0.0, 0.1), y=(200.0, 300.0)))
    assert check_figure(figure).figure.axes[1].get_ylim() == (200.0, 300.0)


def test_a_detail_of_a_constant_has_a_height(check_figure: Check) -> None:
    figure = plot_curves_with_detail([Curve(x=T, y=np.ones_like(T))], TIME, SPEED, detail=View(x=(0.0, 0.1)))
    assert check_figure(figure).figure.axes[1].get_ylim() == (0.0, 2.0)


def test_what_cannot_be_drawn_is_refused() -> None:
    curve = Curve(x=T, y=RISE)
    with pytest.raises(InvalidInputError, match="there are no curves to draw"):
        plot_curves([], TIME, SPEED)
    with pytest.raises(InvalidInputError, match="there are no curves to draw"):
        plot_curves_with_detail([], TIME, SPEED, detail=View(x=(0.0, 1.0)))
    with pytest.raises(InvalidInputError, match="x limits 3 to 1 show nothing; the first must be the lower"):
        plot_curves([curve], TIME, SPEED, view=View(x=(3.0, 1.0)))
    with pytest.raises(InvalidInputError, match="y limits nan to 1 show nothing"):
        plot_curves([curve], TIME, SPEED, view=View(y=(float("nan"), 1.0)))
    with pytest.raises(InvalidInputError, match="a detail has no limits in x"):
        plot_curves_with_detail([curve], TIME, SPEED, detail=View())
    with pytest.raises(InvalidInputError, match="no curve has a point within 5 to 6; widen the limits of the detail"):
        plot_curves_with_detail([curve], TIME, SPEED, detail=View(x=(5.0, 6.0)))


def test_the_same_data_give_the_same_bytes() -> None:
    def draw(values: np.ndarray) -> tuple[bytes, bytes]:
        figure = plot_curves([Curve(x=T, y=values, label="speed")], TIME, SPEED, notes=[Note(1.0, 290.0, "note")])
        return render_figure(figure, "same")

    assert draw(RISE) == draw(RISE.copy())
    assert draw(RISE)[0] != draw(RISE + 1.0)[0]
    assert draw(RISE)[1] != draw(RISE + 1.0)[1]
