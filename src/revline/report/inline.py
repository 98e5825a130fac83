"""Text with light markup, as values: a plain `str` is shown literally; emphasis, code, formulas and links are nodes of their own.

text = ("The speed ", Math("omega_e"), " is read by ", Code("revline trim"), ".")
text = marked("The speed $omega_e$ is read by `revline trim`; see [](#figure-4.1).")    # the same, shorter
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from revline.errors import InvalidInputError
from revline.report.mathematics import Row, parse_formula


@dataclass(frozen=True, slots=True)
class Emphasis:
    """Words that are stressed."""

    text: str


@dataclass(frozen=True, slots=True)
class Strong:
    """Words that carry the sentence."""

    text: str


@dataclass(frozen=True, slots=True)
class Code:
    """A name from a program, a file or a command line."""

    text: str


@dataclass(frozen=True, slots=True)
class Math:
    """A formula in the line, in the language of `revline.report.mathematics`.

    Raises:
        InvalidInputError: the formula cannot be read.
    """

    source: str

    def __post_init__(self) -> None:
        parse_formula(self.source)

    @property
    def formula(self) -> Row:
        """The formula as a tree."""
        return parse_formula(self.source)


@dataclass(frozen=True, slots=True)
class Link:
    """A link to an anchor of the same document; without words it reads as its target is called: "Figure 4.1", "Section 2.3"."""

    anchor: str
    text: str = ""


Inline = str | Emphasis | Strong | Code | Math | Link
Text = str | tuple[Inline, ...]
"""What may stand wherever words are shown."""

_MARKS = re.compile(
    r"\\(?P<literal>[\\*`$\[\]])"
    r"|\*\*(?P<strong>[^*]+)\*\*"
    r"|\*(?P<emphasis>[^*]+)\*"
    r"|`(?P<code>[^`]+)`"
    r"|\$(?P<math>[^$]+)\$"
    r"|\[(?P<words>[^\[\]]*)\]\(#(?P<anchor>[^()\s]+)\)"
    r"|(?P<stray>[*`$\[\]])"
)
_NONCHARACTERS = "".join(chr((plane << 16) + 0xFFFE) + chr((plane << 16) + 0xFFFF) for plane in range(17))
_ILLEGIBLE = re.compile(f"[\x00-\x08\x0b\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef{_NONCHARACTERS}]")
_SPACES = re.compile("[ \t\n\f\r]+")
_NODES: Mapping[str, Callable[[str], Inline]] = MappingProxyType(
    {"strong": Strong, "emphasis": Emphasis, "code": Code, "math": Math, "literal": str}
)


def marked(source: str) -> tuple[Inline, ...]:
    r"""Read light markup: `*emphasis*`, `**strong**`, `` `code` ``, `$formula$`, `[words](#anchor)`, `[](#anchor)`.

    A backslash makes the sign after it literal. For text that comes from elsewhere, such as a file's name, give a plain `str` or
    a node instead: those are never read for marks.

    Args:
        source: the text.

    Returns:
        Its nodes.

    Raises:
        InvalidInputError: a mark does not close, or a formula cannot be read.
    """
    return tuple(_joined(_nodes(source)))


def _nodes(source: str) -> Iterator[Inline]:
    position = 0
    for found in _MARKS.finditer(source):
        if found.start() > position:
            yield source[position : found.start()]
        position = found.end()
        if found["stray"] is not None:
            message = (
                f"marked text {source!r}, character {found.start() + 1}: {found['stray']!r} is not closed; "
                f"write \\{found['stray']} for the sign itself"
            )
            raise InvalidInputError(message, text=source, character=float(found.start() + 1))
        if found["anchor"] is not None:
            yield Link(found["anchor"], found["words"])
        else:
            yield next(_NODES[name](found[name]) for name in _NODES if found[name] is not None)
    if position < len(source):
        yield source[position:]


def _joined(nodes: Iterator[Inline]) -> Iterator[Inline]:
    """Put neighbouring plain texts together, which backslashes had parted."""
    pending = ""
    for node in nodes:
        if isinstance(node, str):
            pending += node
            continue
        if pending:
            yield pending
            pending = ""
        yield node
    if pending:
        yield pending


def nodes_of(text: Text) -> tuple[Inline, ...]:
    """The nodes of a text, one where it is a plain `str`."""
    return (text,) if isinstance(text, str) else text


def plain(text: Text) -> str:
    """The words of a text without markup, for titles and messages; a formula gives its source, a bare link its anchor."""
    return "".join(_plain_node(node) for node in nodes_of(text))


def _plain_node(node: Inline) -> str:
    if isinstance(node, str):
        return node
    if isinstance(node, Math):
        return node.source
    if isinstance(node, Link):
        return node.text or node.anchor
    return node.text


def legible(text: str) -> str:
    """A text as every output can carry it: what is no character (controls, lone surrogates) becomes the replacement sign.

    Tabs and line ends stay; they are white space to a paragraph and themselves to a listing.
    """
    return _ILLEGIBLE.sub("\ufffd", text)


def one_line(text: str) -> str:
    """A legible text whose runs of white space are one space each, as a browser shows them; no-break spaces stay."""
    return _SPACES.sub(" ", legible(text))
