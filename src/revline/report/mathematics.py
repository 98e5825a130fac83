"""Formulas written once and shown as MathML in the page and by typst on paper: a small language and the tree it is read into.

Grammar, close to typst's: letters and numbers as they are; `x_1`, `x_(i j)`, `x^2`; `a/b` or `(a + b)/(c + d)` is a fraction whose
outer parentheses fall away (`slash` for a slash in the line); Greek letters by name, `omega`, `Delta`; functions `sin`, `exp`, ...;
`dot(x)`, `ddot(x)`, `hat(x)`, `bar(x)`, `tilde(x)`, `sqrt(x)`, `abs(x)`; words upright in quotes, `m_"ai"`;
`+ - = < > <= >= != ~ -> , ; : ! '` and the words of `OPERATORS`. What is in no list is refused, never guessed.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

from revline.errors import InvalidInputError, suggestion

_GREEK_NAMES = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi omicron pi rho final sigma tau upsilon phi chi psi omega"
)
_FIRST_GREEK = 0x3B1
_TO_CAPITAL = -0x20


def _greek_letters() -> Iterator[tuple[str, str]]:
    for place, name in enumerate(_GREEK_NAMES.split()):
        if name != "final":
            yield name, chr(_FIRST_GREEK + place)
            yield name.capitalize(), chr(_FIRST_GREEK + place + _TO_CAPITAL)


GREEK: Mapping[str, str] = MappingProxyType(dict(_greek_letters()))
"""Greek letters by name."""

FUNCTIONS = frozenset({"sin", "cos", "tan", "arctan", "exp", "log", "ln", "min", "max", "arg", "Re", "Im", "lim", "det"})
"""Names set upright, as functions are."""

_SAME_SIGNS = "+=<>,;:!"
_OTHER_SIGNS = MappingProxyType(
    {"-": "\u2212", "<=": "\u2264", ">=": "\u2265", "!=": "\u2260", "->": "\u2192", "~": "\u223c", "'": "\u2032"}
)
_WORDS = MappingProxyType(
    {
        "times": "\u00d7", "cdot": "\u22c5", "approx": "\u2248", "pm": "\u00b1", "degree": "\u00b0", "dots": "\u2026", "in": "\u2208",
        "slash": "/", "prop": "\u221d", "implies": "\u21d2", "partial": "\u2202", "sum": "\u2211", "integral": "\u222b",
        "infinity": "\u221e",
    }
)  # fmt: skip
OPERATORS: Mapping[str, str] = MappingProxyType({sign: sign for sign in _SAME_SIGNS} | dict(_OTHER_SIGNS) | dict(_WORDS))
"""Signs and words that stand for an operator."""

ACCENTS: Mapping[str, str] = MappingProxyType({"dot": "\u02d9", "ddot": "\u00a8", "hat": "\u005e", "bar": "\u00af", "tilde": "\u02dc"})
"""What may stand over a symbol."""

CLOSING: Mapping[str, str] = MappingProxyType({"(": ")", "[": "]", "{": "}"})
"""Brackets and what closes them."""

_TOKEN = re.compile(
    r'\s*(?:"(?P<text>[^"]*)"|(?P<number>\d+(?:\.\d+)?)|(?P<name>[A-Za-z]+)|(?P<sign><=|>=|!=|->|[-+=<>~,;:!\'_^/()\[\]{}]))'
)


class Kind(Enum):
    """What a symbol is, which decides its slant and its spacing."""

    IDENTIFIER = "identifier"
    NUMBER = "number"
    OPERATOR = "operator"
    FUNCTION = "function"
    TEXT = "text"


@dataclass(frozen=True, slots=True)
class Symbol:
    """One sign, as it is shown."""

    kind: Kind
    text: str


@dataclass(frozen=True, slots=True)
class Scripts:
    """A base with a subscript, a superscript, or both."""

    base: "Node"
    below: "Node | None"
    above: "Node | None"


@dataclass(frozen=True, slots=True)
class Fraction:
    """One expression over another."""

    above: "Node"
    below: "Node"


@dataclass(frozen=True, slots=True)
class Root:
    """A square root."""

    body: "Row"


@dataclass(frozen=True, slots=True)
class Accented:
    """A symbol under a dot, a hat, a bar or a tilde."""

    mark: str
    body: "Row"


@dataclass(frozen=True, slots=True)
class Fenced:
    """An expression in brackets that grow with it."""

    opening: str
    body: "Row"
    closing: str


@dataclass(frozen=True, slots=True)
class Row:
    """Expressions side by side."""

    items: "tuple[Node, ...]"


Node = Symbol | Scripts | Fraction | Root | Accented | Fenced | Row


class _Token(NamedTuple):
    kind: str
    text: str
    position: int


@cache
def parse_formula(source: str) -> Row:
    """Read a formula.

    Args:
        source: in the language of this module, for example `J dot(omega) = T_i - T_f`.

    Returns:
        Its tree.

    Raises:
        InvalidInputError: a sign or name is unknown, a bracket does not close, or a script or fraction lacks a part.
    """
    reader = _Reader(source)
    row = reader.read_row(until="")
    if not row.items:
        raise reader.error("it is empty", len(source))
    return row


class _Reader:
    """Reads tokens from left to right."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._tokens = tuple(self._split())
        self._next = 0

    def error(self, what: str, position: int) -> InvalidInputError:
        return InvalidInputError(
            f"formula {self._source!r}, character {position + 1}: {what}", formula=self._source, character=float(position + 1)
        )

    def read_row(self, until: str, opened: int = 0) -> Row:
        """Read up to a closing bracket, which is taken too, or to the end where `until` is empty."""
        items: list[Node] = []
        while (token := self._peek()) is not None:
            if token.kind == "sign" and token.text in CLOSING.values():
                if token.text != until:
                    raise self.error(f"{token.text!r} closes nothing", token.position)
                self._next += 1
                return Row(tuple(items))
            items.append(self._read_quotient())
        if until:
            raise self.error(f"a bracket opened here is not closed by {until!r}", opened)
        return Row(tuple(items))

    def _split(self) -> Iterator[_Token]:
        position = 0
        end = len(self._source.rstrip())
        while position < end:
            found = _TOKEN.match(self._source, position)
            if found is None or found.lastgroup is None:
                rest = self._source[position:].lstrip()
                what = f"{rest[0]!r} means nothing in a formula; write words in quotes and signs by name: {', '.join(OPERATORS)}"
                raise self.error(what, len(self._source) - len(rest))
            yield _Token(found.lastgroup, found[found.lastgroup], found.start(found.lastgroup))
            position = found.end()

    def _peek(self) -> _Token | None:
        return self._tokens[self._next] if self._next < len(self._tokens) else None

    def _position(self) -> int:
        token = self._peek()
        return len(self._source) if token is None else token.position

    def _take_sign(self, sign: str) -> bool:
        token = self._peek()
        if token is None or token.kind != "sign" or token.text != sign:
            return False
        self._next += 1
        return True

    def _read_quotient(self) -> Node:
        node = self._read_scripted()
        while self._take_sign("/"):
            node = Fraction(_bare(node), _bare(self._read_scripted()))
        return node

    def _read_scripted(self) -> Node:
        base = self._read_atom()
        below: Node | None = None
        above: Node | None = None
        while True:
            position = self._position()
            if self._take_sign("_"):
                if below is not None:
                    raise self.error("a second subscript; put both into one, x_(i j)", position)
                below = _bare(self._read_atom())
            elif self._take_sign("^"):
                if above is not None:
                    raise self.error("a second superscript; put both into one, x^(a b)", position)
                above = _bare(self._read_atom())
            else:
                return base if below is None and above is None else Scripts(base, below, above)

    def _read_atom(self) -> Node:
        token = self._peek()
        if token is None:
            raise self.error("it ends where a symbol should follow", len(self._source))
        self._next += 1
        if token.kind == "text":
            return Symbol(Kind.TEXT, token.text)
        if token.kind == "number":
            return Symbol(Kind.NUMBER, token.text)
        return self._read_name(token) if token.kind == "name" else self._read_sign(token)

    def _read_sign(self, token: _Token) -> Node:
        if token.text in CLOSING:
            closing = CLOSING[token.text]
            return Fenced(token.text, self.read_row(until=closing, opened=token.position), closing)
        if token.text in OPERATORS:
            return Symbol(Kind.OPERATOR, OPERATORS[token.text])
        raise self.error(f"{token.text!r} stands where a symbol should", token.position)

    def _read_name(self, token: _Token) -> Node:
        name = token.text
        if name in GREEK:
            return Symbol(Kind.IDENTIFIER, GREEK[name])
        if name in OPERATORS:
            return Symbol(Kind.OPERATOR, OPERATORS[name])
        if name in FUNCTIONS:
            return Symbol(Kind.FUNCTION, name)
        if name in ACCENTS or name in {"sqrt", "abs"}:
            return self._read_call(token)
        if len(name) == 1:
            return Symbol(Kind.IDENTIFIER, name)
        hint = suggestion(name, (*GREEK, *OPERATORS, *FUNCTIONS, *ACCENTS, "sqrt", "abs"))
        raise self.error(
            f'{name} is no known name{hint}; write words in quotes, "{name}", and products with spaces between the letters', token.position
        )

    def _read_call(self, token: _Token) -> Node:
        if not self._take_sign("("):
            raise self.error(f"{token.text} takes its argument in parentheses, {token.text}(x)", token.position)
        body = self.read_row(until=")", opened=token.position)
        if not body.items:
            raise self.error(f"{token.text} has no argument; write {token.text}(x)", token.position)
        if token.text == "sqrt":
            return Root(body)
        return Fenced("|", body, "|") if token.text == "abs" else Accented(ACCENTS[token.text], body)


def _bare(node: Node) -> Node:
    """The inside of parentheses that only group."""
    return node.body if isinstance(node, Fenced) and node.opening == "(" else node
