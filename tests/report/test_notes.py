import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from revline.errors import InvalidInputError
from revline.report.notes import Note, mark_points, place_notes
from revline.report.style import finish_layout, new_figure, styled


def axes_with(*curves: tuple[list[float], list[float]]) -> Axes:
    with styled():
        figure = new_figure()
        axes = figure.subplots()
        for x, y in curves:
            axes.plot(x, y)
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        finish_layout(figure)
    return axes


def text_boxes(axes: Axes) -> list[Bbox]:
    """Pixels of the notes' texts, without their leaders."""
    with styled():
        axes.figure.canvas.draw()
    return [Text.get_window_extent(text) for text in axes.texts]


@pytest.mark.parametrize("x", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("y", [0.0, 0.5, 1.0])
def test_a_note_stays_inside_and_off_the_curve(x: float, y: float) -> None:
    axes = axes_with(([0.0, 1.0], [y, y]))
    place_notes(axes, [Note(x, y, "largest error")])
    (box,), frame = text_boxes(axes), axes.get_window_extent()
    assert frame.x0 <= box.x0
    assert frame.y0 <= box.y0
    assert box.x1 <= frame.x1
    assert box.y1 <= frame.y1
    height = axes.transData.transform((x, y))[1]
    assert not box.y0 <= height <= box.y1


def test_notes_do_not_cover_each_other() -> None:
    axes = axes_with(([0.0, 1.0], [0.0, 1.0]))
    place_notes(axes, [Note(0.5, 0.5, f"note number {k}") for k in range(4)])
    boxes = text_boxes(axes)
    assert len(boxes) == 4
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])


def test_a_note_far_from_its_point_has_a_leader() -> None:
    wall = np.linspace(0.0, 1.0, 60)
    crowded = axes_with(*(([0.35, 0.65], [h, h]) for h in wall if 0.3 < h < 0.7))
    place_notes(crowded, [Note(0.5, 0.5, "crowded")])
    free = axes_with(([0.0, 1.0], [0.0, 0.0]))
    place_notes(free, [Note(0.5, 0.5, "free")])
    assert crowded.texts[0].arrow_patch is not None  # type: ignore[attr-defined]  # an annotation has it
    assert free.texts[0].arrow_patch is None  # type: ignore[attr-defined]  # an annotation has it


def test_marked_points_are_drawn_where_they_are() -> None:
    axes = axes_with()
    mark_points(axes, [Note(0.25, 0.75, "here")])
    assert np.asarray(axes.lines[0].get_xydata()).tolist() == [[0.25, 0.75]]


def test_a_point_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"note 'peak' belongs to the point \(1, nan\), which is not finite"):
        mark_points(axes_with(), [Note(1.0, float("nan"), "peak")])


def test_notes_need_a_canvas_of_pixels() -> None:
    with pytest.raises(TypeError, match=r"begin their figure with new_figure\(\)"):
        place_notes(Figure().subplots(), [Note(0.0, 0.0, "x")])
