from collections.abc import Callable
from typing import Any

import pytest
from matplotlib.figure import Figure

from revline.errors import InvalidInputError
from revline.report.poles import PoleSet, plot_poles

Check = Callable[[Figure], Any]


def test_poles_of_each_model_have_their_own_mark(check_figure: Check) -> None:
    sets = [
        PoleSet([-2.08, -13.96], "G2"),
        PoleSet([-2.04, -26.4, -34.0], "G3"),
        PoleSet([-2.05, -19.4, -42.3 + 56.6j, -42.3 - 56.6j], "G4"),
    ]
    picture = check_figure(plot_poles(sets))
    assert picture.holds([-2.08, -13.96], [0.0, 0.0])
    assert picture.holds([-2.05, -19.4, -42.3, -42.3], [0.0, 0.0, 56.6, -56.6])
    assert picture.legend == ["G2", "G3", "G4"]
    assert picture.labels == [("real part (1/s)", "imaginary part (1/s)")]
    markers = [line.get_marker() for line in picture.figure.axes[0].lines if line.get_linestyle() == "None"]
    assert len(set(markers)) == 3


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="there are no poles to draw"):
        plot_poles([])
    with pytest.raises(InvalidInputError, match="poles of G0 cannot be drawn: it has no points"):
        plot_poles([PoleSet([], "G0")])
    with pytest.raises(InvalidInputError, match=r"poles of G0 cannot be drawn: real\[0\] = nan"):
        plot_poles([PoleSet([float("nan")], "G0")])
    with pytest.raises(InvalidInputError, match=r"poles of G0 have shape \(1, 2\); give a list"):
        plot_poles([PoleSet([[1.0, 2.0]], "G0")])
