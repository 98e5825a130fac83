"""What every figure must keep to, and a short way to look into one."""

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import ArrayLike

from revline.report.figure_files import render_figure

LABEL = re.compile(r"\S.*[ \n]\(.+\)", re.DOTALL)


@dataclass
class Picture:
    """A figure that was checked."""

    figure: Figure

    @property
    def legend(self) -> list[str]:
        """Texts of the legend."""
        return [text.get_text() for legend in self.figure.legends for text in legend.get_texts()]

    @property
    def labels(self) -> list[tuple[str, str]]:
        """Labels of the axes."""
        return [(axes.get_xlabel(), axes.get_ylabel()) for axes in self.figure.axes]

    def notes(self, axes: int = 0) -> list[str]:
        """Texts in the axes of a number."""
        return [text.get_text() for text in self.figure.axes[axes].texts if text.get_text()]

    def holds(self, x: ArrayLike, y: ArrayLike, axes: int = 0) -> bool:
        """Whether a line in the axes of a number has exactly these points."""
        wanted = np.column_stack([np.asarray(x, dtype=float), np.asarray(y, dtype=float)])
        return any(np.array_equal(np.asarray(line.get_xydata()), wanted) for line in self.figure.axes[axes].lines)


def check_inside(figure: Figure) -> None:
    """Texts stand inside the picture and do not cover each other."""
    assert isinstance(figure.canvas, FigureCanvasAgg)
    texts = [text for axes in figure.axes for text in (axes.xaxis.label, axes.yaxis.label, *axes.texts) if text.get_text()]
    boxes = {text.get_text() + str(k): Text.get_window_extent(text) for k, text in enumerate(texts)}
    boxes |= {f"legend {k}": legend.get_window_extent() for k, legend in enumerate(figure.legends)}
    for name, box in boxes.items():
        assert min(box.x0, box.y0) >= -1.0, name
        assert box.x1 <= figure.bbox.x1 + 1.0, name
        assert box.y1 <= figure.bbox.y1 + 1.0, name
    covering = [names for names in itertools.combinations(boxes, 2) if boxes[names[0]].overlaps(boxes[names[1]])]
    assert covering == []


@pytest.fixture
def check_figure() -> Callable[[Figure], Picture]:
    """Check that a figure is labelled, fits, renders to files of substance, and leaves matplotlib's settings alone."""
    before = dict(mpl.rcParams)

    def check(figure: Figure) -> Picture:
        png, svg = render_figure(figure, "check")
        assert dict(mpl.rcParams) == before
        assert png.startswith(b"\x89PNG\r\n\x1a\n")
        assert len(png) > 8000
        assert ET.fromstring(svg).tag == "{http://www.w3.org/2000/svg}svg"  # noqa: S314 - our own file
        picture = Picture(figure)
        for label in itertools.chain.from_iterable(picture.labels):
            assert not label or LABEL.fullmatch(label), label
        assert picture.labels[-1][0]
        assert picture.labels[0][1]
        check_inside(figure)
        return picture

    return check
