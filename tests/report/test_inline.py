"""Text with light markup."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.report.inline import Code, Emphasis, Link, Math, Strong, legible, marked, nodes_of, one_line, plain


def test_marks_become_nodes() -> None:
    assert marked("The *lag* is **exact**: `tau` is $5.48/omega_e$, see [](#figure-4.1) and [there](#map).") == (
        "The ",
        Emphasis("lag"),
        " is ",
        Strong("exact"),
        ": ",
        Code("tau"),
        " is ",
        Math("5.48/omega_e"),
        ", see ",
        Link("figure-4.1"),
        " and ",
        Link("map", "there"),
        ".",
    )


@given(st.text())
def test_every_text_can_be_marked_literally(text: str) -> None:
    escaped = "".join(f"\\{sign}" if sign in "\\*`$[]" else sign for sign in text)
    assert marked(escaped) == ((text,) if text else ())


@pytest.mark.parametrize("source", ["2 * 3", "`code", "$x", "[words](nowhere)", "a ] b"])
def test_a_mark_that_does_not_close_is_refused(source: str) -> None:
    with pytest.raises(InvalidInputError, match=r"character \d+: .* is not closed; write \\"):
        marked(source)


def test_a_formula_that_cannot_be_read_is_refused_when_written() -> None:
    with pytest.raises(InvalidInputError, match="nonsense is no known name"):
        Math("nonsense")


def test_plain_text_keeps_the_words() -> None:
    assert plain(marked("a *b* `c` $d$ [e](#f)[](#g)")) == "a b c d eg"
    assert plain("*literal*") == "*literal*"
    assert nodes_of("*literal*") == ("*literal*",)


def test_a_formula_knows_its_tree() -> None:
    assert len(Math("a + b").formula.items) == 3


def test_what_is_no_character_is_replaced() -> None:
    assert legible("a\0b\ud800c\uffffd\te\nf") == "a\ufffdb\ufffdc\ufffdd\te\nf"
    assert legible("\U0001ffff!") == "\ufffd!"


def test_white_space_runs_are_one_space_and_no_break_spaces_stay() -> None:
    assert one_line("a \n\t b\u00a0\u202fc") == "a b\u00a0\u202fc"


@given(st.text(st.characters(exclude_categories=("Cc", "Cs", "Cn"))))
def test_what_is_a_character_stays(text: str) -> None:
    assert legible(text) == text
