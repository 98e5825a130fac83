import numpy as np
import pytest

from revline.errors import InvalidInputError
from revline.report.parts import Curve, Level, check_columns, check_some, draw_curves, draw_levels
from revline.report.style import DATA, MODELS, new_figure


def test_a_curve_keeps_locked_copies() -> None:
    x = np.array([0.0, 1.0])
    curve = Curve(x=x, y=x)
    x[0] = 5.0
    assert curve.x.tolist() == [0.0, 1.0]
    assert not curve.y.flags.writeable


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([0.0, 1.0], [0.0], r"curve 'G1' cannot be drawn: x of shape \(2,\), y of shape \(1,\); give columns of equal length"),
        ([[0.0]], [[0.0]], r"x of shape \(1, 1\)"),
        ([], [], "curve 'G1' cannot be drawn: it has no points"),
        ([0.0, 1.0], [0.0, np.nan], r"y\[1\] = nan is not finite; leave such points out"),
        ([0.0, np.inf], [0.0, 1.0], r"x\[1\] = inf is not finite"),
    ],
)
def test_unusable_columns_are_refused(x: list[float], y: list[float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Curve(x=np.array(x), y=np.array(y), label="G1")


def test_a_curve_without_a_name_is_refused_too() -> None:
    with pytest.raises(InvalidInputError, match=r"^curve cannot be drawn"):
        Curve(x=np.array([0.0]), y=np.array([]))


def test_columns_come_back_in_order() -> None:
    first, second = check_columns("poles", real=[1, 2], imaginary=[3, 4])
    assert (first.tolist(), second.tolist()) == ([1.0, 2.0], [3.0, 4.0])


def test_a_picture_of_nothing_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="there are no curves to draw; give at least one"):
        check_some("curves", [])


def test_looks_that_are_not_given_are_taken_in_turn() -> None:
    axes, x = new_figure().subplots(), np.arange(3.0)
    draw_curves(axes, [Curve(x=x, y=x, look=DATA), Curve(x=x, y=x), Curve(x=x, y=x)])
    assert [line.get_color() for line in axes.lines] == [DATA.colour, MODELS[0].colour, MODELS[1].colour]
    assert [line.get_linestyle() for line in axes.lines] == ["None", "-", "--"]


def test_levels_go_across_the_picture() -> None:
    axes = new_figure().subplots()
    draw_levels(axes, horizontal=[Level(3.0, "target")], vertical=[Level(2.0)])
    target, edge = axes.lines
    assert np.asarray(target.get_ydata()).tolist() == [3.0, 3.0]
    assert np.asarray(edge.get_xdata()).tolist() == [2.0, 2.0]
    assert axes.get_legend_handles_labels()[1] == ["target"]
