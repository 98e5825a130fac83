from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.errors import InvalidInputError
from revline.report.curves import View
from revline.report.gain_overlay import Outline, plot_gain_overlay
from revline.report.notes import Note
from revline.report.style import BLACK, MODELS, Look, Quantity

Check = Callable[[Figure], Any]
KP, KI = Quantity("kp", "deg/(rad/s)"), Quantity("ki", "deg/(rad/s)/s")
ANGLES = np.linspace(np.pi, 0.0, 40)


def outline(label: str, size: float = 1.0, *, shaded: bool = False, look: Look = MODELS[0]) -> Outline:
    return Outline(
        label=label,
        kp=size * (1.0 + np.cos(ANGLES)),
        ki=size * np.sin(ANGLES),
        run=np.repeat([0, 1], 20),
        look=look,
        shaded=shaded,
    )


def test_outlines_are_drawn_run_by_run_with_one_label_each_and_the_controllers_named(check_figure: Check) -> None:
    one = outline("G2d", shaded=True)
    picture = check_figure(plot_gain_overlay([one, outline("engine", 2.0)], [Note(1.0, 0.4, "C1")], KP, KI, view=View(y=(0.0, 2.5))))
    assert picture.holds(one.kp[:20], one.ki[:20])
    assert picture.holds(one.kp[20:], one.ki[20:])
    assert picture.legend == ["G2d", "engine"]
    assert picture.notes() == ["C1"]
    assert len(picture.figure.axes[0].patches) == 2  # the shade of each run


@pytest.mark.parametrize("count", range(2, 13))
def test_legends_of_any_number_of_labels_stay_inside_the_picture(check_figure: Check, count: int) -> None:
    """Eight labels of unlike lengths once fell off both sides: columns were not counted as matplotlib fills them."""
    labels = ("G1", "G2", "G2d", "engine, start", "engine, target", "Ms = 1.4", "Ms = 2", "Ms = 3", "a longer name", "b", "c", "d")[:count]
    look = Look(BLACK, "-")
    picture = check_figure(plot_gain_overlay([outline(name, 1.0 + k, look=look) for k, name in enumerate(labels)], [], KP, KI, view=View()))
    assert picture.legend == list(labels)


def test_a_picture_of_nothing_and_columns_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="no outlines or controllers to draw"):
        plot_gain_overlay([], [], KP, KI, view=View())
    with pytest.raises(InvalidInputError, match="outline 'G2' cannot be drawn"):
        Outline(label="G2", kp=np.zeros(3), ki=np.zeros(2), run=np.zeros(3, dtype=np.int64), look=MODELS[0])
