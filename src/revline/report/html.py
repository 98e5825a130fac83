"""The document as one HTML file that loads nothing: style inside, figures as data, formulas as MathML, no script."""

import base64
from functools import partial
from pathlib import Path
from types import MappingProxyType

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from revline.report.blocks import Block, Equation, FigureBlock, TableBlock
from revline.report.document import Document
from revline.report.files import write_whole
from revline.report.images import Picture, load_picture
from revline.report.inline import Code, Emphasis, Inline, Link, Math, Strong, Text, legible, nodes_of, one_line
from revline.report.layout import checks_in_words, groups, paddings, shown_check
from revline.report.mathml import render_mathml
from revline.report.numbers import format_unit

_PIXELS_PER_CENTIMETRE = 96.0 / 2.54
_INVISIBLE = MappingProxyType(str.maketrans("0.", "\u2007\u2008"))
"""Spaces as wide as a digit and as a point."""


def render_html(document: Document) -> str:
    """Write the document as one self-contained page.

    Args:
        document: what it says; its figures' files must be there.

    Returns:
        The text of the HTML file, the same for the same document and files.

    Raises:
        InvalidInputError: a figure's file is missing or is no picture.
    """
    environment = Environment(
        loader=PackageLoader("revline.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    labels = dict(document.labels)
    environment.filters |= {
        "inline": partial(_inline, labels=labels),
        "block": lambda block: _block(environment, block),
        "legible": legible,
        "unit": format_unit,
        "formula": _formula,
    }
    environment.globals |= {
        "picture": _picture_attributes,
        "aspect": _aspect,
        "paddings": _paddings,
        "groups": groups,
        "shown_check": shown_check,
    }
    page = environment.get_template("report.html.jinja")
    return page.render(document=document, entries=tuple(document.entries()), checks_in_words=checks_in_words(document.checks))


def write_html(document: Document, path: str | Path) -> None:
    """Write the document as one self-contained HTML file.

    Args:
        document: what it says.
        path: of the file; one of that name is replaced.

    Raises:
        InvalidInputError: a figure's file is missing or is no picture, or the file cannot be written.
    """
    write_whole(path, render_html(document).encode(), "report")


def _block(environment: Environment, block: Block) -> Markup:
    """A block by the macro that bears the name of its class."""
    macros = environment.get_template("blocks.html.jinja").module
    return Markup(getattr(macros, type(block).__name__)(block))  # noqa: S704 - the macros escape what they are given


def _inline(text: Text, labels: dict[str, str]) -> Markup:
    return Markup("").join(_node(node, labels) for node in nodes_of(text))


def _node(node: Inline, labels: dict[str, str]) -> Markup:
    match node:
        case str():
            return escape(one_line(node))
        case Emphasis():
            return Markup("<em>{}</em>").format(one_line(node.text))
        case Strong():
            return Markup("<strong>{}</strong>").format(one_line(node.text))
        case Code():
            return Markup("<code>{}</code>").format(one_line(node.text))
        case Link():
            return Markup('<a href="#{}">{}</a>').format(node.anchor, one_line(node.text or labels[node.anchor]))
        case Math():
            return Markup(render_mathml(node.formula, block=False))  # noqa: S704 - escaped where it is made


def _formula(equation: Equation) -> Markup:
    return Markup(render_mathml(equation.formula, block=True))  # noqa: S704 - escaped where it is made


def _picture_attributes(figure: FigureBlock) -> Markup:
    """Source, size and description of an image element."""
    picture = load_picture(figure)
    return Markup('src="{}" width="{}" height="{}" alt="{}"').format(
        _data_uri(picture),
        round(picture.width_cm * _PIXELS_PER_CENTIMETRE),
        round(picture.height_cm * _PIXELS_PER_CENTIMETRE),
        one_line(figure.shows),
    )


def _data_uri(picture: Picture) -> str:
    return f"data:{picture.media_type};base64,{base64.b64encode(picture.content).decode()}"


def _aspect(figure: FigureBlock) -> str:
    return f"{load_picture(figure).aspect:.3f}"


def _paddings(table: TableBlock) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(cell.translate(_INVISIBLE) for cell in row) for row in paddings(table))
