"""Figures of gain maps: every point that has gains of any kind is named, and values are told beside the map."""

import numpy as np

from revline.design.maps.gain_map import GainGrid, find_gain_map
from revline.engine.lee1995 import lee1995
from revline.report.gain_maps import draw_heat, plot_gain_map
from revline.report.style import new_figure


def test_the_outermost_points_with_gains_are_drawn_and_named_where_others_are_lost() -> None:
    """3 deg has no steady state; at 10 deg and 40 N m nothing keeps the peak, and what stabilises is named all the same."""
    axes = GainGrid(first="throttle", first_values=np.array([3.0, 10.0, 25.0]), second="load_torque", second_values=np.array([40.0]))
    figure = plot_gain_map(find_gain_map(lee1995(), axes))
    labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert labels == ["10 deg, 40 N m", "25 deg, 40 N m"]


def test_a_bar_tells_the_values_and_no_label_can_leave_the_map() -> None:
    figure = new_figure()
    axes = figure.subplots()
    draw_heat(figure, axes, np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.array([[1.0, 2.0], [8.0, 16.0]]))
    assert not axes.texts
    bar = figure.axes[1]
    assert [label.get_text() for label in (bar.get_yticklabels()[0], bar.get_yticklabels()[-1])] == ["1", "16"]
