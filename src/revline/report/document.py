"""A document as one value: head, numbered sections of blocks, provenance. The page and the paper are made of the same value."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from revline.errors import InvalidInputError, suggestion
from revline.report.blocks import (
    Block,
    Callout,
    Check,
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
    check_name,
    check_words,
)
from revline.report.inline import Link, Text, nodes_of, plain

DEEPEST = 3
"""Levels of sections: 1, 1.1, 1.1.1."""

RESERVED = frozenset({"top", "contents", "warnings", "provenance"})
"""Anchors that the document itself has."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Card:
    """A key number at the head of the document.

    Attributes:
        label: what it is.
        value: the number as shown.
        unit: its symbol; none where empty.
        note: a few words below, such as the value it compares with.
    """

    label: Text
    value: str
    unit: str = ""
    note: Text = ""

    def __post_init__(self) -> None:
        check_words("the label of a card", self.label)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Section:
    """A part with a heading; numbers come from its place in the document.

    Attributes:
        title: its heading.
        anchor: what links name it by.
        blocks: its own content.
        sections: parts of it, after its own content.
    """

    title: Text
    anchor: str
    blocks: tuple[Block, ...] = ()
    sections: "tuple[Section, ...]" = ()

    def __post_init__(self) -> None:
        check_name("section", self.anchor)
        check_words(f"the title of section {self.anchor}", self.title)


class Entry(NamedTuple):
    """A section at its place: "2.1" at level 2."""

    number: str
    level: int
    section: Section


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Document:
    """Everything a report says.

    Attributes:
        title: of the whole.
        subtitle: below the title.
        abstract: paragraphs that sum up.
        cards: key numbers.
        sections: the content.
        warnings: what the reader must know first.
        partial: what is missing, where the results are incomplete; empty where they are whole.
        provenance: names and values of what it was made from: version, engine, fingerprint, date.
        language: of its words, as HTML names it.

    Raises:
        InvalidInputError: two things share an anchor, a link leads nowhere, sections nest too deep, or the title is empty.
    """

    title: str
    subtitle: Text = ""
    abstract: tuple[Text, ...] = ()
    cards: tuple[Card, ...] = ()
    sections: tuple[Section, ...] = ()
    warnings: tuple[Text, ...] = ()
    partial: Text = ""
    provenance: tuple[tuple[str, str], ...] = ()
    language: str = "en"

    def __post_init__(self) -> None:
        check_words("the title of the document", self.title)
        anchors = [anchor for anchor, _ in self._anchors()]
        for anchor, count in Counter(anchors).items():
            if count > 1 or anchor in RESERVED:
                uses = count + (anchor in RESERVED)
                message = f"the anchor {anchor} is used {uses} times; give each section, figure, table and equation its own"
                raise InvalidInputError(message, anchor=anchor)
        known = {*anchors, *RESERVED}
        for link in self._links():
            if link.anchor not in known:
                message = f"a link leads to {link.anchor}, which is nowhere in the document{suggestion(link.anchor, known)}"
                raise InvalidInputError(message, anchor=link.anchor)

    def entries(self) -> Iterator[Entry]:
        """All sections in reading order, numbered.

        Raises:
            InvalidInputError: they nest deeper than `DEEPEST`.
        """
        yield from _number(self.sections, "", 1)

    def blocks(self) -> Iterator[Block]:
        """All blocks in reading order, those inside callouts too."""
        for entry in self.entries():
            yield from _within(entry.section.blocks)

    @property
    def figures(self) -> tuple[FigureBlock, ...]:
        """All figures in reading order, those in rows too."""
        return tuple(figure for block in self.blocks() for figure in _figures_of(block))

    @property
    def checks(self) -> tuple[Check, ...]:
        """All checks in reading order."""
        return tuple(check for block in self.blocks() if isinstance(block, CheckTable) for check in block.checks)

    @property
    def labels(self) -> Mapping[str, str]:
        """What each anchor is called in a sentence: "Figure 4.1", "Section 2.3"."""
        names = {"top": "the beginning", "contents": "the contents", "warnings": "the warnings", "provenance": "the provenance"}
        return MappingProxyType({**names, **dict(self._anchors())})

    def _anchors(self) -> Iterator[tuple[str, str]]:
        for entry in self.entries():
            yield entry.section.anchor, f"Section {entry.number}"
        for figure in self.figures:
            yield figure.anchor, f"Figure {figure.id}"
        for block in self.blocks():
            if isinstance(block, TableBlock) and block.id:
                yield block.anchor, f"Table {block.id}"
            elif isinstance(block, Equation) and block.id:
                yield block.anchor, f"Equation {block.id}"

    def _links(self) -> Iterator[Link]:
        head: tuple[Text, ...] = (self.subtitle, *self.abstract, *self.warnings, self.partial)
        cards = tuple(text for card in self.cards for text in (card.label, card.note))
        titles = tuple(entry.section.title for entry in self.entries())
        for text in (*head, *cards, *titles, *(text for block in self.blocks() for text in _texts_of(block))):
            yield from (node for node in nodes_of(text) if isinstance(node, Link))


def _number(sections: tuple[Section, ...], prefix: str, level: int) -> Iterator[Entry]:
    for place, section in enumerate(sections, start=1):
        if level > DEEPEST:
            message = f"section {plain(section.title)!r} lies {level} levels deep; {DEEPEST} are the most, move it up"
            raise InvalidInputError(message, level=float(level))
        number = f"{prefix}{place}"
        yield Entry(number, level, section)
        yield from _number(section.sections, f"{number}.", level + 1)


def _within(blocks: tuple[Block, ...]) -> Iterator[Block]:
    for block in blocks:
        yield block
        if isinstance(block, Callout):
            yield from block.blocks


def _figures_of(block: Block) -> tuple[FigureBlock, ...]:
    if isinstance(block, FigureRow):
        return block.figures
    return (block,) if isinstance(block, FigureBlock) else ()


def _texts_of(block: Block) -> tuple[Text, ...]:
    """All texts of a block in which a link may stand; those inside a callout's blocks are theirs."""
    match block:
        case Paragraph():
            texts: tuple[Text, ...] = (block.text,)
        case ItemList() | WarningList():
            texts = block.items
        case DefinitionList():
            texts = tuple(text for item in block.items for text in item)
        case CodeBlock() | CheckTable():
            texts = (block.caption,)
        case FigureBlock() | FigureRow():
            texts = tuple(figure.caption for figure in _figures_of(block))
        case TableBlock():
            cells = tuple(cell for row in block.rows for cell in row)
            texts = (block.caption, *(column.heading for column in block.columns), *cells, *block.notes)
        case Callout():
            texts = (block.title,)
        case _:
            texts = ()
    return texts
