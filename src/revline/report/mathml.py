"""Formulas as MathML, which browsers set by themselves."""

from html import escape

from revline.report.inline import legible
from revline.report.mathematics import Accented, Fenced, Fraction, Kind, Node, Root, Row, Scripts, Symbol

_TAGS = ((Kind.IDENTIFIER, "mi"), (Kind.NUMBER, "mn"), (Kind.OPERATOR, "mo"), (Kind.FUNCTION, "mi"), (Kind.TEXT, "mtext"))
_TALL = frozenset({"\u2211", "\u222b"})
_LIMITS = frozenset({"\u2211", "lim", "min", "max"})
_SIGNED = frozenset({"\u2212", "+", "\u00b1"})
_AFTER_OPERAND = frozenset({"!", "\u2032", "\u00b0", "\u221e"})
_APPLY = "<mo>\u2061</mo>"
_THIN = '<mspace width="0.167em"></mspace>'


def render_mathml(formula: Row, *, block: bool) -> str:
    """Write a formula as a `math` element.

    Args:
        formula: its tree.
        block: whether it stands on a line of its own, with full-size fractions and limits.
    """
    display = ' display="block"' if block else ""
    return f"<math{display}>{_row(formula)}</math>"


def _row(row: Row) -> str:
    previous: Node | None = None
    parts = []
    for place, item in enumerate(row.items):
        if _is_sign(item, _SIGNED) and _starts_operand(previous):
            parts.append(_node(item).replace("<mo>", '<mo form="prefix">'))
        else:
            parts.append(_node(item))
        if _is_function(item) and place + 1 < len(row.items):
            parts.append(_APPLY if isinstance(row.items[place + 1], Fenced) else _APPLY + _THIN)
        previous = item
    return f"<mrow>{''.join(parts)}</mrow>"


def _is_sign(node: Node | None, signs: frozenset[str]) -> bool:
    """Whether a node is one of some operators or functions; words in quotes never are."""
    return isinstance(node, Symbol) and node.kind in {Kind.OPERATOR, Kind.FUNCTION} and node.text in signs


def _starts_operand(previous: Node | None) -> bool:
    """Whether a sign that follows belongs to a number, as in "= -x", and does not stand between two."""
    return previous is None or (isinstance(previous, Symbol) and previous.kind is Kind.OPERATOR and previous.text not in _AFTER_OPERAND)


def _is_function(node: Node) -> bool:
    base = node.base if isinstance(node, Scripts) else node
    return isinstance(base, Symbol) and base.kind is Kind.FUNCTION


def _node(node: Node) -> str:
    match node:
        case Symbol():
            tag = dict(_TAGS)[node.kind]
            return f"<{tag}>{escape(legible(node.text))}</{tag}>"
        case Row():
            return _row(node)
        case Fraction():
            return f"<mfrac>{_node(node.above)}{_node(node.below)}</mfrac>"
        case Root():
            return f"<msqrt>{_row(node.body)}</msqrt>"
        case Accented():
            body = _node(node.body.items[0]) if len(node.body.items) == 1 else _row(node.body)
            return f'<mover accent="true">{body}<mo stretchy="false">{node.mark}</mo></mover>'
        case _:
            return _fenced(node) if isinstance(node, Fenced) else _scripts(node)


def _fenced(node: Fenced) -> str:
    """Brackets; they stretch about tall bodies only, as some browsers give stretched ones room that short ones should not have."""
    stretchy = "true" if _is_tall(node.body) else "false"
    opening = f'<mo form="prefix" stretchy="{stretchy}">{node.opening}</mo>'
    return f'<mrow>{opening}{_row(node.body)}<mo form="postfix" stretchy="{stretchy}">{node.closing}</mo></mrow>'


def _is_tall(node: Node | None) -> bool:
    match node:
        case Fraction():
            return True
        case Row():
            return any(_is_tall(item) for item in node.items)
        case Scripts():
            return _is_tall(node.base)
        case Fenced() | Root() | Accented():
            return _is_tall(node.body)
        case _:
            return _is_sign(node, _TALL)


def _scripts(node: Scripts) -> str:
    limits = _is_sign(node.base, _LIMITS)
    base = _node(node.base)
    parts: tuple[Node, ...]
    if node.below is None and node.above is not None:
        tag, parts = "mover" if limits else "msup", (node.above,)
    elif node.above is None and node.below is not None:
        tag, parts = "munder" if limits else "msub", (node.below,)
    else:
        tag, parts = "munderover" if limits else "msubsup", tuple(part for part in (node.below, node.above) if part is not None)
    return f"<{tag}>{base}{''.join(_node(part) for part in parts)}</{tag}>"
