import matplotlib.colors as mcolors
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet

from revline.errors import InvalidInputError
from revline.report.linear_range import ErrorMap, plot_linear_error, plot_linear_range
from revline.report.parts import Floats
from revline.report.style import PALE, Quantity

AMPLITUDE = Quantity("throttle amplitude", "deg")
OMEGA = np.geomspace(0.1, 100.0, 9)
STEPS = np.linspace(1.0, 25.0, 13)


def square_map() -> ErrorMap:
    """Errors that are 5 % at 10 deg, whatever the frequency, and grow with the square of the amplitude."""
    error = np.tile(0.05 * (STEPS[:, None] / 10.0) ** 2, (1, OMEGA.size))
    return ErrorMap(OMEGA, STEPS, error, np.ones(error.shape, dtype=bool))


def contour_lines(axes: Axes) -> list[Floats]:
    """Points of the lines of a map, from the lowest error to the highest."""
    lines = [c for c in axes.collections if isinstance(c, QuadContourSet)][-1]
    return [np.asarray(path.vertices) for path in lines.get_paths()]


def test_the_lines_lie_where_the_errors_are() -> None:
    figure = plot_linear_error(square_map(), AMPLITUDE)
    (axes,) = figure.axes
    assert axes.get_xlabel() == "frequency (rad/s)"
    assert axes.get_ylabel() == "throttle amplitude (deg)"
    heights = [float(np.mean(vertices[:, 1])) for vertices in contour_lines(axes)]
    assert heights == pytest.approx(10.0 * np.sqrt(np.array([1.0, 2.0, 5.0, 10.0]) / 5.0), rel=1e-6)
    assert {text.get_text() for text in axes.texts} == {"1 %", "2 %", "5 %", "10 %"}
    assert not figure.legends


def test_what_was_not_found_is_hatched_and_has_no_line() -> None:
    errors = square_map()
    found = errors.found.copy()
    found[3:, :4] = False
    figure = plot_linear_error(errors._replace(found=found), AMPLITUDE)
    assert figure.legends[0].get_texts()[0].get_text() == "no periodic answer found"
    axes = figure.axes[0]
    hatched = [c for c in axes.collections if c.get_hatch()]
    assert len(hatched) == 1
    assert np.asarray(hatched[0].get_facecolor())[0] == pytest.approx(mcolors.to_rgba(PALE))
    assert np.min(contour_lines(axes)[2][:, 0]) >= OMEGA[4] - 1e-9


def test_ranges_are_marked_by_why_they_end() -> None:
    figure = plot_linear_range(OMEGA[:3], [20.0, 10.0, 8.0], [False, True, True], within=0.05, amplitude=AMPLITUDE)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["error reaches 5 %", "ends for another reason"]
    assert figure.axes[0].get_ylabel() == "throttle amplitude (deg)"
    assert [np.asarray(line.get_xydata()).tolist() for line in figure.axes[0].lines[1:]] == [
        [[OMEGA[1], 10.0], [OMEGA[2], 8.0]],
        [[OMEGA[0], 20.0]],
    ]


def test_pictures_of_nothing_are_refused() -> None:
    errors = square_map()
    with pytest.raises(InvalidInputError, match="give 2 or more"):
        plot_linear_error(errors._replace(omega=OMEGA[:1], error=errors.error[:, :1], found=errors.found[:, :1]), AMPLITUDE)
    with pytest.raises(InvalidInputError, match="is not finite"):
        plot_linear_error(errors._replace(error=np.full_like(errors.error, np.nan)), AMPLITUDE)
    with pytest.raises(InvalidInputError, match="do not rise"):
        plot_linear_range([2.0, 1.0], [1.0, 1.0], [True, True], within=0.05, amplitude=AMPLITUDE)
