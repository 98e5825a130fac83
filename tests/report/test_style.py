import threading
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from revline.report.style import MODELS, Quantity, add_legend, drawn, finish_layout, new_figure, power_text, styled, use_degrees, use_log


def test_a_label_names_quantity_and_unit() -> None:
    assert Quantity("engine speed", "rad/s").label == "engine speed (rad/s)"
    assert Quantity("pressure ratio", "1").label == "pressure ratio (\N{EN DASH})"


def test_settings_change_only_while_drawing() -> None:
    before = dict(mpl.rcParams)
    with styled():
        assert mpl.rcParams["axes.grid"] is True
    assert dict(mpl.rcParams) == before


def test_settings_return_after_an_error() -> None:
    before = dict(mpl.rcParams)

    @drawn
    def fail() -> Figure:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert dict(mpl.rcParams) == before


def test_the_users_settings_do_not_show() -> None:
    with mpl.rc_context({"lines.linewidth": 9.0, "axes.facecolor": "red"}), styled():
        assert mpl.rcParams["axes.facecolor"] == "white"
        assert mpl.rcParams["lines.linewidth"] == 1.5


def test_threads_take_turns_with_the_settings() -> None:
    before, inside, most = dict(mpl.rcParams), [0], [0]

    def draw() -> None:
        for _ in range(20):
            with styled():
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                inside[0] -= 1

    threads = [threading.Thread(target=draw) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]
    assert dict(mpl.rcParams) == before


def test_curves_that_are_compared_differ_in_colour_and_dash() -> None:
    assert len({look.colour for look in MODELS}) == len(MODELS)
    assert len({look.dash for look in MODELS[:4]}) == 4


@drawn
def small_figure(prepare: Callable[[Any], None], x: tuple[float, float], y: tuple[float, float]) -> Figure:
    figure = new_figure()
    axes = figure.subplots()
    prepare(axes)
    axes.plot(x, y)
    axes.set_xlim(*x)
    finish_layout(figure)
    return figure


def shown(labels: list[Any]) -> list[str]:
    return [label.get_text() for label in labels if label.get_text()]


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [
        (0.01, 100.0, ["0.01", "0.1", "1", "10", "100"]),
        (1e-7, 1e7, ["$10^{-7}$", "$10^{-5}$", "0.001", "0.1", "10", "1000", "$10^{5}$", "$10^{7}$"]),
        (3.0, 60.0, ["5", "10", "20", "50"]),
        (2.0, 6.0, ["2", "3", "4", "5", "6"]),
    ],
)
def test_logarithmic_axes_have_plain_numbers_however_little_they_span(low: float, high: float, wanted: list[str]) -> None:
    figure = small_figure(lambda axes: use_log(axes, "x"), (low, high), (0.0, 1.0))
    with styled():
        figure.canvas.draw()
    texts = shown(figure.axes[0].get_xticklabels()) + shown(figure.axes[0].get_xticklabels(minor=True))
    assert set(wanted) <= set(texts)
    assert len(texts) >= 2


def test_powers_of_ten() -> None:
    assert [power_text(10.0**k) for k in (-5, -4, 0, 4, 5)] == ["$10^{-5}$", "0.0001", "1", "10000", "$10^{5}$"]
    assert power_text(0.0) == ""


@pytest.mark.parametrize(("span", "step"), [(300.0, 90.0), (40.0, 10.0), (1500.0, 360.0), (4e5, None), (1.0, None)])
def test_phases_have_ticks_at_parts_of_a_turn(span: float, step: float | None) -> None:
    figure = small_figure(lambda axes: use_degrees(axes, span), (0.0, 1.0), (0.0, span))
    ticks = figure.axes[0].get_yticks()
    assert 2 < len(ticks) < 12
    if step is not None:
        assert ticks[1] - ticks[0] == pytest.approx(step)


def test_a_legend_names_each_label_once_and_fits() -> None:
    with styled():
        figure = new_figure()
        for axes in figure.subplots(2, 1):
            for label in ("one", "two", "a much longer label than the others have, which takes its space", "four"):
                axes.plot([0, 1], [0, 1], label=label)
        add_legend(figure)
        finish_layout(figure)
        figure.canvas.draw()
    box = figure.legends[0].get_window_extent()
    assert len(figure.legends[0].get_texts()) == 4
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.x1


def test_a_figure_without_labels_has_no_legend() -> None:
    figure = new_figure()
    figure.subplots().plot([0, 1], [0, 1])
    add_legend(figure)
    assert figure.legends == []


def test_a_layout_is_made_once() -> None:
    figure = new_figure()
    figure.subplots().plot([0, 1], [0, 1])
    finish_layout(figure)
    placed = figure.axes[0].get_position().bounds
    finish_layout(figure)
    assert figure.axes[0].get_position().bounds == placed
    bare = Figure()
    finish_layout(bare)
    assert bare.get_layout_engine() is None


def test_a_label_too_long_for_its_axes_is_broken_before_the_unit() -> None:
    with styled():
        figure = new_figure()
        upper, lower = figure.subplots(2, 1)
        upper.set_ylabel(Quantity("speed for each degree of throttle", "rad/s per deg").label)
        lower.set_ylabel("speed (rad/s)")
        finish_layout(figure)
    assert upper.get_ylabel() == "speed for each degree of throttle\n(rad/s per deg)"
    assert lower.get_ylabel() == "speed (rad/s)"
