"""What every figure must keep to, pictures made without a plotting library, and a document that holds every kind of block."""

import itertools
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import ArrayLike

from revline.report.blocks import (
    Align,
    Callout,
    CalloutKind,
    CellMark,
    Check,
    CheckTable,
    CodeBlock,
    Column,
    DefinitionList,
    Equation,
    FigureBlock,
    FigureRow,
    ItemList,
    Paragraph,
    TableBlock,
    Tone,
    WarningList,
)
from revline.report.document import Card, Document, Section
from revline.report.figure_files import render_figure
from revline.report.inline import marked

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


SVG = b'<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg" width="4cm" height="3cm"><rect width="3cm" height="2cm"/></svg>'


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(width: int = 40, height: int = 30, density: bytes = struct.pack(">IIB", 10000, 10000, 1)) -> bytes:
    pixels = zlib.compress((b"\0" + b"\x7f" * width) * height)
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + (chunk(b"pHYs", density) if density else b"") + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


@pytest.fixture
def make_png() -> Callable[..., bytes]:
    return png


@pytest.fixture
def make_figure(tmp_path: Path) -> Callable[..., FigureBlock]:
    def make(name: str = "4.1", *, svg: bytes = b"", content: bytes = b"", caption: str = "") -> FigureBlock:
        path = tmp_path / f"{name}.png"
        path.write_bytes(content or png())
        curves = tmp_path / f"{name}.svg" if svg else None
        if curves is not None:
            curves.write_bytes(svg)
        return FigureBlock(id=name, caption=caption or f"caption {name}", shows=f"description {name}", png=path, svg=curves)

    return make


@pytest.fixture
def sample(make_figure: Callable[..., FigureBlock]) -> Document:
    blocks = (
        Paragraph(marked("words *stressed* **strong** `code_name` $omega_e$ [](#table-4.2) [shown](#figure-4.1)")),
        ItemList(items=("bullet one", "bullet two")),
        ItemList(items=("step one",), numbered=True),
        DefinitionList(items=(("the term", "the meaning"),)),
        CodeBlock(text="revline study\n  --out here", caption="listing caption"),
        Equation(source='J dot(omega) = T_"ind" - sqrt(x)/2', id="2.17"),
        make_figure("4.1"),
        FigureRow(figures=(make_figure("4.2a", svg=SVG), make_figure("4.2b"))),
        TableBlock(
            id="4.2",
            caption="table caption",
            columns=(
                Column(heading="Model"),
                Column(heading="Gain", unit="rad/s per deg", align=Align.DECIMAL, group="Group"),
                Column(heading="Delay", unit="s2", align=Align.RIGHT, group="Group"),
            ),
            rows=(("G1", "12.25", "none"), ("G2", "7", "0.02")),
            notes=("table note",),
            marks=(CellMark(1, 2, Tone.CAUTION),),
        ),
        CheckTable(
            caption="checks caption",
            checks=(
                Check(name="the speed", measured=240.8, expected=240.799, tolerance=0.01, unit="rad/s"),
                Check(name="the gain", measured=12.5, expected=12.0, tolerance=0.1),
            ),
        ),
        WarningList(items=("warning inside",)),
        Callout(kind=CalloutKind.GUIDELINE, title="guideline title", blocks=(Paragraph("guideline text"),)),
    )
    return Document(
        title="The title",
        subtitle="the subtitle",
        abstract=("abstract text",),
        cards=(Card(label="card label", value="240.8", unit="rad/s", note="card note"), Card(label="bare card", value="7")),
        sections=(
            Section(title="First section", anchor="first", blocks=blocks, sections=(Section(title="Inner section", anchor="inner"),)),
            Section(title=marked("Second $G_1$"), anchor="second"),
        ),
        warnings=("warning at the head",),
        partial="two figures are missing",
        provenance=(("engine", "lee1995"), ("fingerprint", "3f7c0e5f")),
    )


@pytest.fixture
def sample_texts() -> tuple[str, ...]:
    """Every text of the sample that both outputs must show."""
    inline = ("stressed", "strong", "code_name", "Table 4.2", "shown", "bullet one", "bullet two", "step one", "the term", "the meaning")
    figures = ("caption 4.1", "description 4.1", "caption 4.2a", "description 4.2a", "caption 4.2b", "Figure 4.2b")
    table = ("table caption", "Group", "Gain", "rad/s\u00a0per\u00a0deg", "s²", "G1", "12.25", "none", "0.02", "table note")
    checks = ("checks caption", "the speed", "240.800", "240.799", "± 0.010", "the gain", "12.50", "± 0.10")
    callouts = ("warning inside", "guideline title", "guideline text", "listing caption", "(2.17)")
    head = (
        "The title",
        "the subtitle",
        "abstract text",
        "card label",
        "card note",
        "warning at the head",
        "two figures are missing",
        "1 warning",
    )
    rest = ("1 of 2 checks hold", "First section", "Inner section", "engine", "lee1995", "3f7c0e5f", "ind")
    return (*inline, *figures, *table, *checks, *callouts, *head, *rest)
