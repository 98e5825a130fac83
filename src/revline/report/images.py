"""Pictures of a document, read from their files and checked before they are shown."""

import re
import struct
from dataclasses import dataclass
from pathlib import Path

from revline.errors import InvalidInputError
from revline.report.blocks import FigureBlock

HEAVIEST_SVG = 400_000
"""Bytes beyond which the PNG is shown instead: many thousand points are faster and smaller as pixels."""

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_HEAD = 33
_METRE = 1
_CENTIMETRES_PER_INCH = 2.54
_USUAL_PIXELS_PER_INCH = 200.0
_SVG_START = re.compile(rb"<svg[\s>]")
_SVG_SEARCHED = 4096


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A picture ready to be embedded.

    Attributes:
        content: the bytes of its file.
        kind: "png" or "svg".
        width_cm: its natural width.
        height_cm: its natural height.
    """

    content: bytes
    kind: str
    width_cm: float
    height_cm: float

    @property
    def media_type(self) -> str:
        """As data URIs name it."""
        return "image/svg+xml" if self.kind == "svg" else "image/png"

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.width_cm / self.height_cm


def load_picture(figure: FigureBlock) -> Picture:
    """Read a figure: the SVG where there is one that is not too heavy, else the PNG; its size is always the PNG's.

    Raises:
        InvalidInputError: a file is missing, cannot be read, or is not what its name says.
    """
    png = _read(figure, figure.png)
    width, height = _size_of_png(figure, png)
    if figure.svg is not None:
        svg = _read(figure, figure.svg)
        if not _SVG_START.search(svg[:_SVG_SEARCHED]):
            message = f"figure {figure.id}: {figure.svg} is no SVG; draw the figure anew"
            raise InvalidInputError(message, figure=figure.id, path=str(figure.svg))
        if len(svg) <= HEAVIEST_SVG:
            return Picture(content=svg, kind="svg", width_cm=width, height_cm=height)
    return Picture(content=png, kind="png", width_cm=width, height_cm=height)


def _read(figure: FigureBlock, path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        message = f"figure {figure.id}: {path} cannot be read: {error.strerror}; draw the figure before the report"
        raise InvalidInputError(message, figure=figure.id, path=str(path)) from error


def _size_of_png(figure: FigureBlock, content: bytes) -> tuple[float, float]:
    """Width and height in centimetres, from the pixels and, where the file says it, their density."""
    width, height = struct.unpack(">II", content[16:24]) if len(content) >= _PNG_HEAD else (0, 0)
    if not content.startswith(_PNG_SIGNATURE) or width == 0 or height == 0:
        message = f"figure {figure.id}: {figure.png} is no PNG; draw the figure anew"
        raise InvalidInputError(message, figure=figure.id, path=str(figure.png))
    scale = _CENTIMETRES_PER_INCH / _pixels_per_inch(content)
    return width * scale, height * scale


def _pixels_per_inch(content: bytes) -> float:
    """The density that the chunk pHYs states; it stands before the pixels."""
    position = len(_PNG_SIGNATURE)
    while position + 12 <= len(content):
        (length,) = struct.unpack(">I", content[position : position + 4])
        name = content[position + 4 : position + 8]
        if name == b"IDAT":
            break
        if name == b"pHYs" and length == struct.calcsize(">IIB") and position + 8 + length <= len(content):
            across, _, unit = struct.unpack(">IIB", content[position + 8 : position + 8 + length])
            if unit == _METRE and across > 0:
                return float(across) * _CENTIMETRES_PER_INCH / 100.0
        position += 12 + length
    return _USUAL_PIXELS_PER_INCH
