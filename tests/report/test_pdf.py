"""The report on paper: set by typst, literal in every text, the same each time."""

import json
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import pytest
import typst
from hypothesis import example, given, settings
from hypothesis import strategies as st

from revline.errors import AnalysisError, InvalidInputError
from revline.report.blocks import FigureBlock
from revline.report.document import Document, Section
from revline.report.images import Picture, load_picture
from revline.report.inline import Code, Emphasis, Math, Strong, legible, one_line
from revline.report.mathematics import FUNCTIONS, GREEK, OPERATORS, parse_formula
from revline.report.pdf import render_pdf, write_pdf
from revline.report.typst_math import render_typst_math, typst_string
from revline.report.typst_source import TypstWriter

HOSTILE = "#$*_`@<>\\[]{}()=-+/~'\";:,.!?|^&% \n\t\0a1"
WRITER = TypstWriter({}, {})
JOINER = "\N{WORD JOINER}"


def ask(source: str) -> object:
    """What typst takes a piece of source for."""
    return json.loads(typst.query(source.encode(), "<probe>", field="value", one=True, ignore_system_fonts=True))


def words_of(content: object) -> str:
    """All words of typst's content, from left to right."""
    if isinstance(content, list):
        return "".join(words_of(item) for item in content)
    if not isinstance(content, dict):
        return ""
    if content.get("func") == "space":
        return " "
    if "text" in content:
        return str(content["text"])
    return "".join(words_of(content[part]) for part in ("children", "body", "base", "b") if part in content)


def pictures_of(document: Document) -> dict[str, Picture]:
    return {figure.anchor: load_picture(figure) for figure in document.figures}


@settings(max_examples=60, deadline=None)
@given(st.text(st.characters(), max_size=30) | st.text(st.sampled_from(HOSTILE), max_size=30))
def test_a_string_literal_is_the_text(text: str) -> None:
    assert ask(f"#metadata({typst_string(text)}) <probe>") == legible(text)


@settings(max_examples=60, deadline=None)
@given(st.text(st.characters(), max_size=30) | st.text(st.sampled_from(HOSTILE), max_size=30))
@example("rad/s")
def test_every_text_is_shown_literally(text: str) -> None:
    """But for the invisible joiner that keeps a line from being broken behind a slash, whose place has a test of its own."""
    content = WRITER.text((text, Emphasis(text), Strong(text), Code(text)))
    shown, wanted = words_of(ask(f"#metadata({content}) <probe>")), one_line(text) * 4
    assert shown.replace(JOINER, "") == wanted.replace(JOINER, "")


def test_the_test_above_would_see_markup() -> None:
    """Negative control: text written without care is read as markup."""
    assert words_of(ask("#metadata([a *b* #sym.pi]) <probe>")) != "a *b* #sym.pi"


FORMULAS = (
    *(sign for sign in OPERATORS if sign != "'"),
    *GREEK,
    *FUNCTIONS,
    *("x'", "a/b", "x_1^2", "sqrt(a/b)", "abs(x)", "dot(x)", "ddot(x)", "hat(x)", "bar(x)", "tilde(x)", "[a, b; c]", '"#x$ \\"', '"a"(b)'),
)


def test_typst_sets_all_that_the_language_of_formulas_holds() -> None:
    source = "\n\n".join(render_typst_math(parse_formula(formula), block=block) for formula in FORMULAS for block in (True, False))
    assert typst.compile(source.encode(), ignore_system_fonts=True).startswith(b"%PDF-")


@settings(max_examples=40, deadline=None)
@given(st.text(st.sampled_from(HOSTILE.replace('"', "")), max_size=20))
def test_words_in_a_formula_are_literal(text: str) -> None:
    formula = render_typst_math(parse_formula(f'"{text}"'), block=False)
    assert words_of(ask(f"#metadata({formula}) <probe>")) == legible(text)


def test_every_block_is_in_the_source(sample: Document, sample_texts: tuple[str, ...]) -> None:
    source = TypstWriter(sample.labels, pictures_of(sample)).write(sample)
    assert [text for text in sample_texts if typst_string(text) not in source.replace(r"\u{2060}", "")] == []


def test_a_unit_stays_on_one_line(sample: Document) -> None:
    """typst breaks lines after a slash; a word joiner behind it keeps rad/s whole, and other slashes as they are."""
    writer = TypstWriter(sample.labels, pictures_of(sample))
    assert writer.text("5 rad/s, tables/ and 1/2") == r'[#"5 rad/\u{2060}s, tables/ and 1/2";]'


def test_the_paper_shows_every_figure_and_heading(sample: Document, tmp_path: Path) -> None:
    """typst itself is asked for what it has set, not the source."""
    source = TypstWriter(sample.labels, pictures_of(sample)).write(sample)
    for figure in sample.figures:
        picture = load_picture(figure)
        (tmp_path / f"{figure.anchor}.{picture.kind}").write_bytes(picture.content)
    (tmp_path / "report.typ").write_text(files("revline.report").joinpath("templates", "report.typ").read_text())
    (tmp_path / "main.typ").write_text(source)
    found = {
        kind: json.loads(typst.query(tmp_path / "main.typ", kind, root=tmp_path, ignore_system_fonts=True))
        for kind in ("image", "heading", "table")
    }
    assert [image["alt"] for image in found["image"]] == [figure.shows for figure in sample.figures]
    assert [words_of(heading["body"]) for heading in found["heading"]] == [
        "Contents",
        "First section",
        "Inner section",
        "Second G1",
        "Provenance",
    ]
    assert len(found["table"]) == 2


def test_the_same_document_gives_the_same_paper(sample: Document) -> None:
    first = render_pdf(sample)
    assert first.startswith(b"%PDF-")
    assert first == render_pdf(sample)


def test_an_empty_document_can_be_set() -> None:
    assert render_pdf(Document(title="Nothing yet")).startswith(b"%PDF-")


def test_a_formula_in_a_heading_can_be_set() -> None:
    assert render_pdf(Document(title="x", sections=(Section(title=(Math("G_1"), " alone"), anchor="x"),))).startswith(b"%PDF-")


def test_the_paper_is_written_whole(sample: Document, tmp_path: Path) -> None:
    write_pdf(sample, tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes() == render_pdf(sample)


def test_without_typst_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch, sample: Document) -> None:
    monkeypatch.setitem(sys.modules, "typst", None)
    with pytest.raises(InvalidInputError, match=r"typst, which is not installed; pip install revline\[report\]"):
        render_pdf(sample)


def test_typst_is_imported_only_when_a_paper_is_set() -> None:
    code = "import sys, revline.report.pdf, revline.report.document; sys.exit('typst' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, env={"PYTHONPATH": "src"}).returncode == 0  # noqa: S603 - own code


def test_a_damaged_picture_is_reported(make_figure: Callable[..., FigureBlock]) -> None:
    figure = make_figure("4.1", svg=b"<svg ")
    with pytest.raises(AnalysisError, match="typst could not set the report: "):
        render_pdf(Document(title="x", sections=(Section(title="x", anchor="x", blocks=(figure,)),)))


def test_a_missing_figure_is_named(make_figure: Callable[..., FigureBlock]) -> None:
    figure = make_figure("4.9")
    figure.png.unlink()
    with pytest.raises(InvalidInputError, match=r"figure 4\.9: .*4\.9\.png cannot be read"):
        render_pdf(Document(title="x", sections=(Section(title="x", anchor="x", blocks=(figure,)),)))
