from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.errors import InvalidInputError
from revline.report.cycles import Plane, plot_branch, plot_orbit
from revline.report.style import Quantity

Check = Callable[[Figure], Any]
PHASES = 2.0 * np.pi * np.arange(64) / 64
SPEED, PRESSURE = Quantity("engine speed", "rad/s"), Quantity("manifold pressure", "kPa")
FACTOR, AMPLITUDE = Quantity("factor of all gains", "1"), Quantity("amplitude", "rad/s")


def test_an_orbit_is_closed_and_the_simulation_beside_it(check_figure: Check) -> None:
    x, y = 300.0 + 9.0 * np.cos(PHASES), 40.0 + 5.0 * np.sin(PHASES)
    picture = check_figure(plot_orbit(x, y, Plane(SPEED, PRESSURE), simulated=(x[::4], y[::4])))
    assert picture.holds([*x, x[0]], [*y, y[0]])
    assert picture.holds(x[::4], y[::4])
    assert picture.legend == ["orbit computed", "simulation"]
    assert picture.labels == [("engine speed (rad/s)", "manifold pressure (kPa)")]


def test_a_family_shows_stable_and_unstable_cycles_and_its_onset(check_figure: Check) -> None:
    """A hard onset: unstable cycles below it, stable ones from the fold on."""
    factors, sizes = np.array([0.98, 0.93, 0.9, 0.95, 1.1]), np.array([1.0, 2.0, 4.0, 6.0, 9.0])
    stable = np.array([0.0, 0.0, 1.0, 1.0, 1.0])
    picture = check_figure(plot_branch(factors, sizes, stable, Plane(FACTOR, AMPLITUDE), onset=1.0, simulated=([1.1], [9.0])))
    assert picture.holds([1.0, 0.98, 0.93], [0.0, 1.0, 2.0])
    assert picture.holds([0.93, 0.9, 0.95, 1.1], [2.0, 4.0, 6.0, 9.0])
    assert picture.legend == ["unstable cycles", "stable cycles", "simulated"]
    assert picture.notes() == ["onset at 1"]


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="orbit cannot be drawn"):
        plot_orbit([1.0], [1.0, 2.0], Plane(SPEED, PRESSURE))
    with pytest.raises(InvalidInputError, match="family of cycles cannot be drawn: it has no points"):
        plot_branch([], [], [], Plane(FACTOR, AMPLITUDE), onset=1.0)
