"""Formulas as typst source. Every sign is written so that typst takes it for that sign and nothing else."""

from types import MappingProxyType

from revline.report.inline import legible
from revline.report.mathematics import ACCENTS, Accented, Fenced, Fraction, Kind, Node, Root, Row, Scripts, Symbol

_COMBINING = MappingProxyType(
    {
        ACCENTS["dot"]: "\u0307",
        ACCENTS["ddot"]: "\u0308",
        ACCENTS["hat"]: "\u0302",
        ACCENTS["bar"]: "\u0304",
        ACCENTS["tilde"]: "\u0303",
    }
)


def typst_string(text: str) -> str:
    """Write a text as a typst string literal, which typst shows sign by sign.

    Args:
        text: any; what is no character becomes the replacement sign.
    """
    return '"' + "".join(_string_sign(sign) for sign in legible(text)) + '"'


def render_typst_math(formula: Row, *, block: bool) -> str:
    """Write a formula as a typst equation.

    Args:
        formula: its tree.
        block: whether it stands on a line of its own.
    """
    return f"$ {_row(formula)} $" if block else _inner(formula)


def _string_sign(sign: str) -> str:
    if sign in '"\\':
        return f"\\{sign}"
    return sign if sign.isprintable() else f"\\u{{{ord(sign):x}}}"


def _inner(node: Node) -> str:
    return f"${_node(node)}$"


def _row(row: Row) -> str:
    """Parts with spaces between, which typst shows only beside words; a bracket stands close to the word before it."""
    parts = []
    for place, item in enumerate(row.items):
        close = place == 0 or (isinstance(item, Fenced) and _is_word(row.items[place - 1]))
        parts += ["" if close else " ", _node(item)]
    return "".join(parts)


def _is_word(node: Node) -> bool:
    return isinstance(node, Symbol) and node.kind is Kind.TEXT


def _sign(text: str) -> str:
    return "".join(sign if sign.isascii() and sign.isalnum() else f"\\u{{{ord(sign):x}}}" for sign in text)


def _node(node: Node) -> str:
    match node:
        case Symbol():
            return _symbol(node)
        case Row():
            return _row(node)
        case Fraction():
            return f"#math.frac({_inner(node.above)}, {_inner(node.below)});"
        case Root():
            return f"#math.sqrt({_inner(node.body)});"
        case Accented():
            return f"#math.accent({_inner(node.body)}, {typst_string(_COMBINING[node.mark])});"
        case _:
            return _fenced(node) if isinstance(node, Fenced) else _scripts(node)


def _symbol(symbol: Symbol) -> str:
    if symbol.kind is Kind.TEXT:
        return typst_string(symbol.text)
    if symbol.kind is Kind.NUMBER:
        return symbol.text
    if symbol.kind is Kind.FUNCTION:
        limits = "true" if symbol.text in {"lim", "min", "max"} else "false"
        return f"#math.op({typst_string(symbol.text)}, limits: {limits});"
    return _sign(symbol.text)


def _fenced(node: Fenced) -> str:
    return f"#math.lr(${_sign(node.opening)} {_row(node.body)} {_sign(node.closing)}$);"


def _scripts(node: Scripts) -> str:
    below = "" if node.below is None else f", b: {_inner(node.below)}"
    above = "" if node.above is None else f", t: {_inner(node.above)}"
    return f"#math.attach({_inner(node.base)}{above}{below});"
