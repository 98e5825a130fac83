"""The document as typst source: calls of the functions in templates/report.typ.

Every text is a string literal, so that nothing in it is read as markup.
"""

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType

from revline.report.blocks import (
    Align,
    Block,
    Callout,
    CheckTable,
    CodeBlock,
    DefinitionList,
    Equation,
    FigureBlock,
    FigureRow,
    ItemList,
    Paragraph,
    TableBlock,
    WarningList,
)
from revline.report.document import Card, Document, Entry
from revline.report.images import Picture
from revline.report.inline import Code, Emphasis, Inline, Link, Math, Strong, Text, nodes_of, one_line
from revline.report.layout import checks_in_words, groups, paddings, shown_check
from revline.report.numbers import format_unit
from revline.report.typst_math import render_typst_math, typst_string

TEXT_WIDTH_CM = 16.8
TALLEST_FIGURE_CM = 7.0
"""Two such figures with captions of two lines fit on a page, and text beside them."""

_WIDEST_FIGURE_CM = 14.5
_ALIGNS = MappingProxyType({Align.LEFT: "left", Align.CENTRE: "center", Align.RIGHT: "right", Align.DECIMAL: "right"})
_SIZES = ((6, "9.5pt"), (8, "8.6pt"))
_SMALLEST = "7.6pt"
_SLASH = re.compile(r"(?<=[A-Za-z])/(?=[A-Za-z(])")


class TypstWriter:
    """Writes one document; holds what its links are called and the pictures that it shows.

    Args:
        labels: what each anchor is called.
        pictures: of each figure, by its anchor.
    """

    def __init__(self, labels: Mapping[str, str], pictures: Mapping[str, Picture]) -> None:
        self._labels = labels
        self._pictures = pictures

    def write(self, document: Document) -> str:
        """The whole source."""
        lines = ['#import "report.typ": *', "#show: report.with(", *(f"  {line}," for line in self._head(document)), ")", ""]
        for entry in document.entries():
            lines.append(self._heading(entry))
            lines += [self.block(block) for block in entry.section.blocks]
        lines.append('#metadata(none)#label("provenance")')
        if document.provenance:
            items = ", ".join(f"({_literal(name)}, {_literal(value)})" for name, value in document.provenance)
            lines.append(f"#provenance({items},)")
        return "\n".join(lines) + "\n"

    def _head(self, document: Document) -> Iterator[str]:
        yield f"title: {_literal(document.title)}"
        yield f"language: {_literal(document.language)}"
        yield f"abstract: {_array(self.text(paragraph) for paragraph in document.abstract)}"
        yield f"badges: {_array(_badges(document))}"
        if document.subtitle:
            yield f"subtitle: {self.text(document.subtitle)}"
        if document.partial:
            yield f"partial: {self.text(document.partial)}"
        if document.cards:
            shown = (self._card(card) for card in document.cards)
            yield f"cards: cards({', '.join(shown)},)"
        if document.warnings:
            yield f"warnings: {self._warnings(document.warnings)}"

    def _card(self, card: Card) -> str:
        note = self.text(card.note) if card.note else "none"
        return f"({self.text(card.label)}, {_literal(card.value)}, {_literal(format_unit(card.unit))}, {note})"

    def _heading(self, entry: Entry) -> str:
        return f"\n#heading(level: {entry.level}, {self.text(entry.section.title)}) #label({_literal(entry.section.anchor)})\n"

    def text(self, text: Text) -> str:
        """Inline nodes as a content block."""
        return f"[{''.join(self._node(node) for node in nodes_of(text))}]"

    def _node(self, node: Inline) -> str:
        match node:
            case str():
                return f"#{_literal(node)};"
            case Emphasis():
                return f"#emph({_literal(node.text)});"
            case Strong():
                return f"#strong({_literal(node.text)});"
            case Code():
                return f"#raw({_literal(node.text)});"
            case Link():
                return f"#link(label({_literal(node.anchor)}), {_literal(node.text or self._labels[node.anchor])});"
            case Math():
                return render_typst_math(node.formula, block=False)

    def block(self, block: Block) -> str:
        """One block as a line of source."""
        match block:
            case Paragraph():
                return f"#par({self.text(block.text)})"
            case FigureBlock():
                return self._figure(block)
            case FigureRow():
                return self._figure_row(block)
            case TableBlock():
                return self._table(block)
            case CheckTable():
                return self._checks(block)
            case _:
                return self._wordy_block(block)

    def _wordy_block(self, block: ItemList | DefinitionList | CodeBlock | Equation | WarningList | Callout) -> str:
        match block:
            case ItemList():
                return f"#{'enum' if block.numbered else 'list'}({', '.join(self.text(item) for item in block.items)})"
            case DefinitionList():
                return f"#terms-of({', '.join(f'({self.text(term)}, {self.text(meaning)})' for term, meaning in block.items)})"
            case CodeBlock():
                return f"#listing({typst_string(block.text.expandtabs(4))}, {self.text(block.caption) if block.caption else 'none'})"
            case Equation():
                number = f"({block.id})" if block.id else ""
                return f"#formula({_literal(block.anchor)}, {_literal(number)}, {render_typst_math(block.formula, block=True)})"
            case WarningList():
                return f"#{self._warnings(block.items)}"
            case Callout():
                inner = "\n".join(self.block(item) for item in block.blocks)
                return f"#callout({_literal(block.kind.value)}, {_literal(block.kind.value)}, {self.text(block.title)}, [\n{inner}\n])"

    def _warnings(self, items: tuple[Text, ...]) -> str:
        return f'callout("caution", "Warnings", none, list({", ".join(self.text(item) for item in items)}))'

    def _figure(self, figure: FigureBlock) -> str:
        picture = self._pictures[figure.anchor]
        width = min(picture.width_cm, _WIDEST_FIGURE_CM, TALLEST_FIGURE_CM * picture.aspect)
        path = _literal(picture_path(figure, picture))
        parts = (*self._figure_name(figure), path, f"{width:.3f}cm", _literal(figure.shows))
        return f"#single({', '.join(parts)})"

    def _figure_row(self, row: FigureRow) -> str:
        widths = _array(f"{self._pictures[figure.anchor].aspect:.4f}fr" for figure in row.figures)
        shown = (self._figure_beside(figure) for figure in row.figures)
        return f"#side-by-side({widths}, {', '.join(shown)})"

    def _figure_beside(self, figure: FigureBlock) -> str:
        path = _literal(picture_path(figure, self._pictures[figure.anchor]))
        return f"({', '.join((*self._figure_name(figure), path, _literal(figure.shows)))})"

    def _figure_name(self, figure: FigureBlock) -> tuple[str, str, str]:
        return _literal(figure.anchor), _literal(f"Figure {figure.id}"), self.text(figure.caption)

    def _table(self, table: TableBlock) -> str:
        pads = paddings(table)
        heads = (f"column-head({self.text(column.heading)}, {_literal(format_unit(column.unit))})" for column in table.columns)
        cells: list[str] = []
        for place, row in enumerate(table.rows):
            cells += ["rule"] if place else []
            cells += [self._cell(table, place, column, cell, pads[place][column]) for column, cell in enumerate(row)]
        return _sheet(
            anchor=table.anchor,
            name=f"Table {table.id}" if table.id else "",
            caption=self.text(table.caption),
            aligns=tuple(_ALIGNS[column.align] for column in table.columns),
            grouped=_array(f"({_literal(group.heading)}, {group.columns})" for group in groups(table.columns)),
            parts=(_array(heads), _array(cells), _array(self.text(note) for note in table.notes)),
        )

    def _cell(self, table: TableBlock, row: int, column: int, cell: Text, padding: str) -> str:
        hidden = f"#hide({_literal(padding)});" if padding else ""
        return f"cell({_literal(table.tone(row, column))}, [{self.text(cell)[1:-1]}{hidden}])"

    def _checks(self, table: CheckTable) -> str:
        heads = ("Check", "Measured", "Expected", "Tolerance", "Unit", "Tolerance used", "Verdict")
        cells: list[str] = []
        for place, check in enumerate(table.checks):
            shown = shown_check(check)
            words = (shown.name, shown.measured, shown.expected, f"± {shown.tolerance}", shown.unit)
            passed = "true" if shown.passed else "false"
            cells += ["rule"] if place else []
            cells += [*(f'cell("", {_literal(word)})' for word in words), f"share({shown.percent}, {passed})", f"verdict({passed})"]
        return _sheet(
            anchor="",
            name="",
            caption=self.text(table.caption),
            aligns=("left", "right", "right", "right", "left", "left", "left"),
            grouped="()",
            parts=(_array(f'column-head({_literal(head)}, "")' for head in heads), _array(cells), "()"),
            first="1fr",
        )


def picture_path(figure: FigureBlock, picture: Picture) -> str:
    """Name under which typst finds a figure's picture."""
    return f"{figure.anchor}.{picture.kind}"


def _literal(text: str) -> str:
    """A text as a string; units such as rad/s stay on one line."""
    return typst_string(_SLASH.sub("/\u2060", one_line(text)))


def _array(items: Iterator[str] | list[str]) -> str:
    """A typst array; a comma follows each item, as one of a single item needs it."""
    return f"({''.join(f'{item}, ' for item in items)})"


def _badges(document: Document) -> Iterator[str]:
    words = checks_in_words(document.checks)
    if words:
        yield f"({_literal('good' if all(check.passed for check in document.checks) else 'bad')}, {_literal(words)})"
    count = len(document.warnings)
    if count:
        warnings = f"{count} warning{'' if count == 1 else 's'}"
        yield f'("caution", {_literal(warnings)})'


def _sheet(
    *, anchor: str, name: str, caption: str, aligns: tuple[str, ...], grouped: str, parts: tuple[str, str, str], first: str = "auto"
) -> str:
    """A table; `first` is the width of its first column, "1fr" for all the room that the others leave."""
    size = next((size for most, size in _SIZES if len(aligns) <= most), _SMALLEST)
    columns = _array([first, *["auto"] * (len(aligns) - 1)])
    return (
        f"#sheet({_literal(anchor)}, {_literal(name)}, {caption}, {size}, {columns}, {_array(list(aligns))}, {grouped}, {', '.join(parts)})"
    )
