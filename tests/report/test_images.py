"""Pictures: which file is shown, how large it is, and what is refused."""

import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from revline.errors import InvalidInputError
from revline.report.blocks import FigureBlock
from revline.report.images import HEAVIEST_SVG, load_picture

SVG = b'<svg xmlns="http://www.w3.org/2000/svg"/>'
Make = Callable[..., FigureBlock]


def test_the_size_comes_from_the_pixels_and_their_density(make_figure: Make, make_png: Callable[..., bytes]) -> None:
    picture = load_picture(make_figure(content=make_png(200, 100, struct.pack(">IIB", 10000, 10000, 1))))
    assert (picture.width_cm, picture.height_cm) == pytest.approx((2.0, 1.0))
    assert picture.aspect == pytest.approx(2.0)


@pytest.mark.parametrize("density", [b"", struct.pack(">IIB", 1, 1, 0)])
def test_without_a_density_a_picture_has_200_pixels_per_inch(make_figure: Make, make_png: Callable[..., bytes], density: bytes) -> None:
    assert load_picture(make_figure(content=make_png(200, 100, density))).width_cm == pytest.approx(2.54)


def test_the_svg_is_shown_where_there_is_one(make_figure: Make) -> None:
    picture = load_picture(make_figure(svg=SVG))
    assert (picture.kind, picture.media_type, picture.content) == ("svg", "image/svg+xml", SVG)


def test_the_png_is_shown_where_the_svg_is_too_heavy(make_figure: Make) -> None:
    figure = make_figure(svg=SVG + b" " * HEAVIEST_SVG)
    picture = load_picture(figure)
    assert (picture.kind, picture.media_type, picture.content) == ("png", "image/png", figure.png.read_bytes())


@pytest.mark.parametrize("content", [b"GIF89a", b"\x89PNG\r\n\x1a\n", b"\x89PNG\r\n\x1a\n" + b"\0" * 40])
def test_what_is_no_png_is_refused(make_figure: Make, content: bytes) -> None:
    with pytest.raises(InvalidInputError, match=r"figure 4\.1: .*4\.1\.png is no PNG"):
        load_picture(make_figure(content=content))


def test_a_png_cut_short_before_its_pixels_keeps_the_usual_density(make_figure: Make, make_png: Callable[..., bytes]) -> None:
    assert load_picture(make_figure(content=make_png()[:45])).width_cm == pytest.approx(40 / 200 * 2.54)


def test_what_is_no_svg_is_refused(make_figure: Make) -> None:
    with pytest.raises(InvalidInputError, match=r"figure 4\.1: .*4\.1\.svg is no SVG"):
        load_picture(make_figure(svg=b"%PDF-1.7"))


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    figure = FigureBlock(id="5.1", caption="x", shows="x", png=tmp_path)
    with pytest.raises(InvalidInputError, match=r"figure 5\.1: .* cannot be read: Is a directory"):
        load_picture(figure)
