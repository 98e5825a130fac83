"""Roots and peaks on a grid, against functions whose roots and peaks are known."""

import numpy as np
import pytest

from revline.design.stability.axis_grid import PHASE_STEP, SIZE_STEP, Function, Sought, find_features, follow
from revline.errors import NotConvergedError

GRID = np.geomspace(0.1, 10.0, 41)


def test_roots_and_peaks_of_several_functions_are_found_together() -> None:
    """One root pair lies between two neighbours of the grid, where the sign shows it at neither."""
    top = GRID[20] * 1.02
    functions: list[Function] = [
        lambda w: np.log(w / 2.0),
        lambda w: 1e-5 - np.log(w / top) ** 2,
        lambda w: np.exp(-(np.log(w / 3.0) ** 2)),
    ]
    found = find_features([Sought(lambda w: w, functions[:2], functions[2:], GRID, [function(GRID) for function in functions])])[0]
    assert found.roots[0] == pytest.approx([2.0], rel=1e-12)
    assert found.roots[1] == pytest.approx([top * np.exp(-(1e-5**0.5)), top * np.exp(1e-5**0.5)], rel=1e-9)
    assert found.peaks[0] == pytest.approx((1.0, 3.0), rel=1e-7)


def test_a_flat_function_is_as_high_as_the_grid_says() -> None:
    flat = (np.zeros_like, lambda w: np.full(w.shape, 2.5))
    found = find_features([Sought(lambda w: w, (), flat, GRID, [0.0 * GRID, 0.0 * GRID + 2.5])])[0]
    assert [value for value, _ in found.peaks] == [0.0, 2.5]
    assert find_features([Sought(lambda w: w, (np.log1p,), (), GRID, [np.log1p(GRID)])])[0].roots[0].size == 0


def test_a_peak_without_a_value_is_told() -> None:
    inside = GRID[20] * np.array([0.95, 1.05])

    def torn(w: np.ndarray) -> np.ndarray:
        return np.where((w > inside[0]) & (w < inside[1]) & (w != GRID[20]), np.nan, -(np.log(w / GRID[20]) ** 2))

    with pytest.raises(NotConvergedError, match="a loop has no finite value near 1 rad/s"):
        find_features([Sought(lambda w: w, (), (torn,), GRID, [torn(GRID)])])


def test_a_delay_that_turns_whole_circles_between_points_is_followed() -> None:
    """A delay of 10 s turns once in 2 pi/10 rad/s: at each point of such a grid its value is 1."""
    found = follow(lambda w: np.exp(-10j * w)[None], 0.2 * np.pi * np.arange(1.0, 9.0), delay=10.0, name="a delay")
    assert np.max(10.0 * np.diff(found.grid)) <= PHASE_STEP


@pytest.mark.parametrize("power", [2.0, -2.0])
def test_a_size_that_changes_without_turning_is_followed(power: float) -> None:
    found = follow(lambda w: (w[None] ** power).astype(complex), np.array([1.0, 1e3]), delay=0.0, name="a power")
    steps = np.diff(np.log(np.abs(found.values[0])))
    assert np.max(np.abs(steps)) <= SIZE_STEP
    assert np.sum(steps) == pytest.approx(power * np.log(1e3))
