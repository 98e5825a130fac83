from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.errors import InvalidInputError
from revline.report.notes import Note
from revline.report.steady import StraightLine, plot_steady_map
from revline.report.style import Quantity

Check = Callable[[Figure], Any]
THROTTLE, SPEED = Quantity("throttle angle", "deg"), Quantity("engine speed", "rad/s")
ANGLES = np.arange(3.0, 91.0)
SPEEDS = 12.0 * ANGLES - 58.0
STABLE = ANGLES > 5.5


def test_unstable_steady_states_are_told_apart(check_figure: Check) -> None:
    picture = check_figure(plot_steady_map(ANGLES, SPEEDS, STABLE, THROTTLE, SPEED, point=Note(25.0, 242.0, "operating point")))
    assert picture.holds(ANGLES, SPEEDS)
    assert picture.holds(ANGLES[STABLE], SPEEDS[STABLE])
    assert picture.holds(ANGLES[~STABLE], SPEEDS[~STABLE])
    assert picture.legend == ["stable", "unstable without control"]
    assert picture.notes() == ["operating point"]
    assert picture.labels == [("throttle angle (deg)", "engine speed (rad/s)")]


def test_a_line_is_drawn_over_its_range_and_the_map_near_it(check_figure: Check) -> None:
    picture = check_figure(plot_steady_map(ANGLES, SPEEDS, STABLE, THROTTLE, SPEED, line=StraightLine(11.9, -55.0, 10.0, 40.0)))
    near = (ANGLES >= 5.5) & (ANGLES <= 44.5)
    assert picture.holds(ANGLES[near], SPEEDS[near])
    assert picture.holds([10.0, 40.0], [64.0, 421.0])
    assert picture.legend == ["range of the line", "straight line, slope 11.9 rad/s per deg", "stable"]


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"steady map cannot be drawn: values of shape \(88,\), outputs of shape \(1,\)"):
        plot_steady_map(ANGLES, [1.0], STABLE, THROTTLE, SPEED)
    with pytest.raises(InvalidInputError, match="no steady state lies near the line's range of 100 to 110"):
        plot_steady_map(ANGLES, SPEEDS, STABLE, THROTTLE, SPEED, line=StraightLine(1.0, 0.0, 100.0, 110.0))
