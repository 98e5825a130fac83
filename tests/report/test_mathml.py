"""Formulas in the page."""

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.report.inline import legible
from revline.report.mathematics import parse_formula
from revline.report.mathml import render_mathml


def mathml(source: str, *, block: bool = False) -> str:
    return render_mathml(parse_formula(source), block=block)


def inside(source: str) -> str:
    return mathml(source).removeprefix("<math><mrow>").removesuffix("</mrow></math>")


@pytest.mark.parametrize(
    ("source", "written"),
    [
        ("x", "<mi>x</mi>"),
        ("omega", "<mi>\u03c9</mi>"),
        ("5.48", "<mn>5.48</mn>"),
        ("a/b", "<mfrac><mi>a</mi><mi>b</mi></mfrac>"),
        ("x_1", "<msub><mi>x</mi><mn>1</mn></msub>"),
        ("x^2", "<msup><mi>x</mi><mn>2</mn></msup>"),
        ("x_1^2", "<msubsup><mi>x</mi><mn>1</mn><mn>2</mn></msubsup>"),
        ("sum_k^N", "<munderover><mo>\u2211</mo><mi>k</mi><mi>N</mi></munderover>"),
        ("max_k", "<munder><mi>max</mi><mi>k</mi></munder>"),
        ("sum^N", "<mover><mo>\u2211</mo><mi>N</mi></mover>"),
        ("sqrt(x)", "<msqrt><mrow><mi>x</mi></mrow></msqrt>"),
        ("dot(x)", '<mover accent="true"><mi>x</mi><mo stretchy="false">\u02d9</mo></mover>'),
        ("bar(x y)", '<mover accent="true"><mrow><mi>x</mi><mi>y</mi></mrow><mo stretchy="false">\u00af</mo></mover>'),
        ('"ai"', "<mtext>ai</mtext>"),
        ("a - b", "<mi>a</mi><mo>\u2212</mo><mi>b</mi>"),
        ("-b", '<mo form="prefix">\u2212</mo><mi>b</mi>'),
        ("= -b", '<mo>=</mo><mo form="prefix">\u2212</mo><mi>b</mi>'),
        ('"+"', "<mtext>+</mtext>"),
        ('"lim"_k', "<msub><mtext>lim</mtext><mi>k</mi></msub>"),
        ("x' - b", "<mi>x</mi><mo>\u2032</mo><mo>\u2212</mo><mi>b</mi>"),
    ],
)
def test_each_part_has_its_element(source: str, written: str) -> None:
    assert inside(source) == written


def test_brackets_stretch_about_what_is_tall_only() -> None:
    for tall in ("(a/b)", "(x (a/b))", "(sqrt(a/b))", "(sum_k k)", "(dot(a/b))"):
        assert inside(tall).startswith('<mrow><mo form="prefix" stretchy="true">(</mo>')
    for short in ("(t)", "(x_(a/b))", "(dot(x))", "(min x)"):
        assert inside(short).startswith('<mrow><mo form="prefix" stretchy="false">(</mo>')


def test_functions_are_applied_with_room_before_what_is_not_in_brackets() -> None:
    assert inside("cos x") == '<mi>cos</mi><mo>\u2061</mo><mspace width="0.167em"></mspace><mi>x</mi>'
    assert "mspace" not in inside("cos(x)")
    assert inside("cos") == "<mi>cos</mi>"
    assert "\u2061" in inside("cos^2 x")


def test_a_formula_on_a_line_of_its_own_says_so() -> None:
    assert mathml("x", block=True) == '<math display="block"><mrow><mi>x</mi></mrow></math>'


@given(st.text())
def test_words_in_a_formula_are_shown_as_they_are(text: str) -> None:
    words = text.replace('"', "")
    (element,) = ET.fromstring(mathml(f'"{words}"').replace("\x0c", " "))[0]  # noqa: S314 - written by this test
    assert (element.text or "").split() == legible(words).split()
