"""The page: whole, self-contained, without injection, the same each time."""

import base64
import re
from collections import Counter
from collections.abc import Callable
from html import unescape
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.report.blocks import (
    Callout,
    CalloutKind,
    Check,
    CheckTable,
    CodeBlock,
    Column,
    DefinitionList,
    FigureBlock,
    Paragraph,
    TableBlock,
)
from revline.report.document import Card, Document, Section
from revline.report.html import render_html, write_html
from revline.report.inline import Code, Emphasis, Link, Math, Strong, legible, one_line

VOID = frozenset({"meta", "img", "br", "link", "input"})


class Page(HTMLParser):
    """Gathers what a page holds, and checks that its elements close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.attributes: list[tuple[str, str, str]] = []
        self.ids: list[str] = []
        self.headings: list[int] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def values(self, tag: str, name: str) -> list[str]:
        return [value for at, key, value in self.attributes if (at, key) == (tag, name)]


def hostile(text: str) -> Document:
    """A document with one text in every place that takes one."""
    shown = text or "x"
    inline = (text, Emphasis(text), Strong(text), Code(text), Link("one", text or "x"), Math('"' + text.replace('"', "") + '"'))
    worded = ("x", *inline)
    blocks = (
        Paragraph(inline),
        CodeBlock(text=text, caption=inline),
        DefinitionList(items=((inline, inline),)),
        Callout(kind=CalloutKind.CAUTION, title=worded, blocks=(Paragraph(inline),)),
        TableBlock(
            caption=worded, columns=(Column(heading=inline, unit="x" + text, group="x" + text),), rows=((inline,),), notes=(inline,)
        ),
        CheckTable(caption=inline, checks=(Check(name="x" + shown, measured=1.0, expected=1.0, tolerance=1.0, unit="x" + text),)),
    )
    return Document(
        title="x" + text,
        subtitle=worded,
        abstract=(inline,),
        cards=(Card(label=worded, value=text, unit="x" + text, note=worded),),
        sections=(Section(title=worded, anchor="one", blocks=blocks),),
        warnings=(inline,),
        partial=worded,
        provenance=((text, text),),
        language="en",
    )


def test_every_block_is_on_the_page(sample: Document, sample_texts: tuple[str, ...]) -> None:
    page = unescape(render_html(sample))
    assert [text for text in sample_texts if text not in page] == []


def test_the_page_is_well_formed_and_its_links_lead_somewhere(sample: Document) -> None:
    page = Page(render_html(sample))
    assert [name for name, count in Counter(page.ids).items() if count > 1] == []
    assert {link[1:] for link in page.values("a", "href")} <= set(page.ids)
    assert all(link.startswith("#") for link in page.values("a", "href"))
    assert set(sample.labels) <= set(page.ids)


def test_headings_go_down_one_level_at_a_time(sample: Document) -> None:
    headings = Page(render_html(sample)).headings
    assert headings[0] == 1
    assert headings.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(headings))


def test_nothing_is_loaded_from_elsewhere(sample: Document) -> None:
    text = render_html(sample)
    page = Page(text)
    assert all(source.startswith("data:image/") for source in page.values("img", "src"))
    assert not {"script", "link", "iframe", "object", "embed", "base"} & set(page.tags)
    assert not re.search(r"url\(|@import|//", re.sub(r'base64,[^"]*', "", text))
    assert page.values("meta", "content")[2].startswith("default-src 'none'")


def test_every_figure_is_an_image_with_its_own_bytes_size_and_description(sample: Document) -> None:
    page = Page(render_html(sample))
    sources = page.values("img", "src")
    assert page.values("img", "alt") == [figure.shows for figure in sample.figures]
    assert base64.b64decode(sources[0].partition("base64,")[2]) == sample.figures[0].png.read_bytes()
    svg = sample.figures[1].svg
    assert svg is not None
    assert base64.b64decode(sources[1].partition("base64,")[2]) == svg.read_bytes()
    # 40 pixels at 10,000 per metre are 4 mm, 15 pixels of a screen
    assert (page.values("img", "width")[0], page.values("img", "height")[0]) == ("15", "11")


def test_table_headers_have_a_scope(sample: Document) -> None:
    page = Page(render_html(sample))
    assert len(page.values("th", "scope")) == page.tags["th"]
    assert {"col", "row", "colgroup"} == set(page.values("th", "scope"))


def test_decimal_columns_are_padded_by_invisible_signs(sample: Document) -> None:
    text = render_html(sample)
    assert '<td class="decimal">7\u2008\u2007\u2007</td>' in text
    assert '<td class="decimal">12.25</td>' in text
    assert '<td class="right caution">0.02</td>' in text


def test_a_check_that_fails_says_so(sample: Document) -> None:
    text = render_html(sample)
    assert text.count(">holds<") == 1
    assert text.count(">fails<") == 1
    assert '<span class="badge bad">1 of 2 checks hold</span>' in text


def test_an_empty_document_is_a_page() -> None:
    page = Page(render_html(Document(title="Nothing yet")))
    assert page.tags["section"] == 0
    assert "warnings" in page.ids


PLAIN = Page(render_html(hostile("word"))).tags


@settings(max_examples=60, deadline=None)
@given(st.text(st.characters(), max_size=20) | st.text(st.sampled_from("<>&\"'`={}%#/!-\\ \n\0ascript"), max_size=20))
def test_no_text_becomes_markup(text: str) -> None:
    page = Page(render_html(hostile(text)))
    assert page.tags == PLAIN
    assert legible(text).replace("\r\n", "\n").replace("\r", "\n") in "".join(page.texts).replace("\r\n", "\n").replace("\r", "\n")
    assert one_line(text) in "".join(page.texts)


@pytest.mark.parametrize(
    "text", ["<script>alert(1)</script>", "</title>", "{{ 7 * 7 }}", "{% raw %}", "<!--", "]]>", "&amp;", '"><img src=x>']
)
def test_planted_markup_is_shown_as_it_is(text: str) -> None:
    rendered = render_html(hostile(text))
    assert Page(rendered).tags == PLAIN
    assert "49" not in re.sub(r"base64,[^\"]*|#[0-9a-f]{6}", "", rendered) or "{{" not in text


def test_the_same_document_gives_the_same_page(sample: Document) -> None:
    assert render_html(sample) == render_html(sample)


def test_a_page_is_written_whole(sample: Document, tmp_path: Path) -> None:
    write_html(sample, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == render_html(sample)


def test_a_missing_figure_is_named(make_figure: Callable[..., FigureBlock]) -> None:
    figure = make_figure("4.9")
    figure.png.unlink()
    document = Document(title="x", sections=(Section(title="x", anchor="x", blocks=(figure,)),))
    with pytest.raises(InvalidInputError, match=r"figure 4\.9: .*4\.9\.png cannot be read: No such file"):
        render_html(document)


def test_a_page_that_cannot_be_written_is_named(sample: Document, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"report '.*/missing/report\.html' cannot be written: No such file"):
        write_html(sample, tmp_path / "missing" / "report.html")
