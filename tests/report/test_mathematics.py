"""Formulas: what the language holds, and what it refuses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.report.mathematics import FUNCTIONS, GREEK, Accented, Fenced, Fraction, Kind, Root, Row, Scripts, Symbol, parse_formula


def only(source: str) -> object:
    (item,) = parse_formula(source).items
    return item


def identifier(text: str) -> Symbol:
    return Symbol(Kind.IDENTIFIER, text)


def test_greek_letters_are_those_of_their_names() -> None:
    assert (GREEK["alpha"], GREEK["omega"], GREEK["sigma"], GREEK["Omega"], GREEK["Sigma"]) == (
        "\u03b1",
        "\u03c9",
        "\u03c3",
        "\u03a9",
        "\u03a3",
    )


def test_scripts_take_the_inside_of_parentheses() -> None:
    assert only("x_(i j)^2") == Scripts(identifier("x"), Row((identifier("i"), identifier("j"))), Symbol(Kind.NUMBER, "2"))


def test_scripts_may_come_in_either_order() -> None:
    assert only("x^2_i") == only("x_i^2")


def test_a_fraction_takes_scripted_symbols_and_drops_the_parentheses_around_its_parts() -> None:
    fraction = only("(a + b)/w_e")
    assert isinstance(fraction, Fraction)
    assert isinstance(fraction.above, Row)
    assert fraction.below == Scripts(identifier("w"), identifier("e"), None)


def test_parentheses_that_are_not_grouping_stay() -> None:
    assert only("(a)") == Fenced("(", Row((identifier("a"),)), ")")


def test_accents_roots_and_magnitudes_hold_their_argument() -> None:
    body = Row((identifier("x"),))
    assert only("dot(x)") == Accented("\u02d9", body)
    assert only("sqrt(x)") == Root(body)
    assert only("abs(x)") == Fenced("|", body, "|")


def test_words_in_quotes_stand_upright() -> None:
    assert only('"air out"') == Symbol(Kind.TEXT, "air out")


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_functions_are_functions(name: str) -> None:
    assert only(name) == Symbol(Kind.FUNCTION, name)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("", "character 1: it is empty"),
        ("x + speed", "character 5: speed is no known name"),
        ("omeg", "did you mean omega"),
        ("a # b", "character 3: '#' means nothing in a formula"),
        ("2 (a + b", r"character 3: a bracket opened here is not closed by '\)'"),
        ("a + b)", r"character 6: '\)' closes nothing"),
        ("[a)", r"'\)' closes nothing"),
        ("x_", "character 3: it ends where a symbol should follow"),
        ("x_1_2", "a second subscript"),
        ("x^1^2", "a second superscript"),
        ("/ b", "'/' stands where a symbol should"),
        ("dot x", r"dot takes its argument in parentheses, dot\(x\)"),
        ("sqrt()", r"sqrt has no argument"),
    ],
)
def test_what_cannot_be_read_is_refused_at_its_place(source: str, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        parse_formula(source)


@given(st.text(max_size=30))
def test_any_text_is_read_or_refused(source: str) -> None:
    try:
        row = parse_formula(source)
    except InvalidInputError as error:
        assert repr(source) in str(error)  # noqa: PT017 - any other exception fails the test, which is its point
    else:
        assert row.items
