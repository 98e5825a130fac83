"""The document as a value: its numbering, its anchors, and what it refuses."""

import math
from pathlib import Path

import pytest

from revline.errors import InvalidInputError
from revline.report.blocks import (
    Align,
    Callout,
    CalloutKind,
    CellMark,
    Check,
    CheckTable,
    CodeBlock,
    Column,
    DefinitionList,
    Equation,
    FigureBlock,
    FigureRow,
    ItemList,
    Paragraph,
    TableBlock,
    Tone,
    WarningList,
)
from revline.report.document import Card, Document, Section
from revline.report.inline import Link, Text, marked


def figure(id: str = "4.1", caption: Text = "The steady map") -> FigureBlock:  # noqa: A002 - as in FigureBlock
    return FigureBlock(id=id, caption=caption, shows="speed over throttle", png=Path("map.png"))


def document_with(*blocks: object) -> Document:
    return Document(title="A report", sections=(Section(title="Results", anchor="results", blocks=blocks),))  # type: ignore[arg-type] # any block


def table(**changes: object) -> TableBlock:
    given: dict[str, object] = {"caption": "Models", "columns": (Column(heading="Model"),), "rows": (("G1",),), **changes}
    return TableBlock(**given)  # type: ignore[arg-type] # a test gives wrong values on purpose


def test_sections_are_numbered_by_their_place() -> None:
    inner = Section(title="Inner", anchor="inner", sections=(Section(title="Innermost", anchor="innermost"),))
    whole = Document(
        title="A report", sections=(Section(title="First", anchor="first"), Section(title="Second", anchor="second", sections=(inner,)))
    )
    assert [(entry.number, entry.level, entry.section.anchor) for entry in whole.entries()] == [
        ("1", 1, "first"),
        ("2", 1, "second"),
        ("2.1", 2, "inner"),
        ("2.1.1", 3, "innermost"),
    ]


def test_sections_that_nest_too_deep_are_refused() -> None:
    section = Section(title="Deepest", anchor="level-4")
    for level in (3, 2, 1):
        section = Section(title="Deep", anchor=f"level-{level}", sections=(section,))
    with pytest.raises(InvalidInputError, match="section 'Deepest' lies 4 levels deep; 3 are the most"):
        Document(title="A report", sections=(section,))


def test_anchors_are_called_by_what_they_are() -> None:
    whole = document_with(
        figure(), table(id="4.2"), Equation(source="a = b", id="2.1"), FigureRow(figures=(figure("4.2a"), figure("4.2b")))
    )
    wanted = {
        "results": "Section 1",
        "figure-4.1": "Figure 4.1",
        "table-4.2": "Table 4.2",
        "equation-2.1": "Equation 2.1",
        "figure-4.2b": "Figure 4.2b",
    }
    assert wanted.items() <= whole.labels.items()
    assert [entry.id for entry in whole.figures] == ["4.1", "4.2a", "4.2b"]


@pytest.mark.parametrize(
    "blocks", [(figure(), figure()), (table(id="1"), table(id="1")), (Equation(source="a", id="1"), Equation(source="b", id="1"))]
)
def test_two_things_of_one_anchor_are_refused(blocks: tuple[object, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"the anchor \S+ is used 2 times"):
        document_with(*blocks)


def test_the_documents_own_anchors_are_taken() -> None:
    with pytest.raises(InvalidInputError, match="the anchor contents is used 2 times"):
        Document(title="A report", sections=(Section(title="Contents", anchor="contents"),))


DANGLING = Link("figure-4.9")


@pytest.mark.parametrize(
    "block",
    [
        Paragraph((DANGLING,)),
        ItemList(items=((DANGLING,),)),
        WarningList(items=((DANGLING,),)),
        DefinitionList(items=(("term", (DANGLING,)),)),
        CodeBlock(text="x", caption=(DANGLING,)),
        CheckTable(checks=(), caption=(DANGLING,)),
        figure("4.2", ("x", DANGLING)),
        FigureRow(figures=(figure("4.2"), figure("4.3", ("x", DANGLING)))),
        table(rows=(((DANGLING,),),)),
        table(notes=((DANGLING,),)),
        Callout(kind=CalloutKind.FINDING, title=("x", DANGLING)),
        Callout(kind=CalloutKind.FINDING, title="x", blocks=(Paragraph((DANGLING,)),)),
    ],
)
def test_a_link_to_nowhere_is_refused_wherever_it_stands(block: object) -> None:
    with pytest.raises(
        InvalidInputError, match=r"a link leads to figure-4\.9, which is nowhere in the document, did you mean figure-4\.\d\?"
    ):
        document_with(figure(), block)


def test_a_link_to_nowhere_in_the_head_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="a link leads to nowhere"):
        Document(title="A report", abstract=(marked("see [](#nowhere)"),))
    with pytest.raises(InvalidInputError, match="a link leads to nowhere"):
        Document(title="A report", cards=(Card(label="x", value="1", note=(Link("nowhere"),)),))


def test_links_that_lead_somewhere_are_taken() -> None:
    whole = document_with(figure(), Paragraph(marked("[](#figure-4.1), [](#results), [](#warnings)")))
    assert len(tuple(whole.blocks())) == 2


def test_checks_are_gathered_and_judged() -> None:
    good = Check(name="speed", measured=240.8, expected=240.0, tolerance=0.8 + 1e-9, unit="rad/s")
    bad = Check(name="gain", measured=12.1, expected=12.0, tolerance=0.05)
    whole = document_with(CheckTable(checks=(good,)), CheckTable(checks=(bad,)))
    assert [(check.name, check.passed) for check in whole.checks] == [("speed", True), ("gain", False)]


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_check_without_a_number_is_refused(value: float) -> None:
    with pytest.raises(InvalidInputError, match=r"check 'speed': measured = (nan|inf) is no finite number"):
        Check(name="speed", measured=value, expected=1.0, tolerance=1.0)


def test_a_negative_tolerance_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="check 'speed': tolerance = -1 is negative"):
        Check(name="speed", measured=1.0, expected=1.0, tolerance=-1.0)


def test_what_has_no_words_is_refused() -> None:
    for what, make in (
        ("the title of the document", lambda: Document(title=" ")),
        ("the title of section a", lambda: Section(title="", anchor="a")),
        (r"the caption of figure 4\.1", lambda: figure(caption=())),
        (r"the description of figure 4\.1", lambda: FigureBlock(id="4.1", caption="x", shows="", png=Path("x.png"))),
        ("the caption of table", lambda: table(caption="")),
        ("the title of a guideline", lambda: Callout(kind=CalloutKind.GUIDELINE, title="")),
        ("the name of a check", lambda: Check(name="", measured=1.0, expected=1.0, tolerance=0.0)),
        ("the label of a card", lambda: Card(label="", value="1")),
    ):
        with pytest.raises(InvalidInputError, match=f"{what}.* is empty"):
            make()


@pytest.mark.parametrize("name", ["", "a b", "-a", "a/b", "a#b", 'a"b'])
def test_a_name_that_cannot_be_linked_to_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match="cannot be linked to"):
        figure(name)
    with pytest.raises(InvalidInputError, match="cannot be linked to"):
        Section(title="x", anchor=name)


def test_tables_must_be_whole() -> None:
    with pytest.raises(InvalidInputError, match="table 'Models' has no column"):
        table(columns=())
    with pytest.raises(InvalidInputError, match="table 'Models', row 1: 2 cells for 1 columns"):
        table(rows=(("G1",), ("G2", "x")))
    with pytest.raises(InvalidInputError, match="the mark at row 1, column 0 lies outside its 1 rows and 1 columns"):
        table(marks=(CellMark(1, 0, Tone.BAD),))
    assert Column(heading="x").align is Align.LEFT


@pytest.mark.parametrize("count", [1, 4])
def test_a_row_holds_two_or_three_figures(count: int) -> None:
    with pytest.raises(InvalidInputError, match=f"{count} figures cannot stand side by side; give 2 or 3"):
        FigureRow(figures=tuple(figure(f"4.{k}") for k in range(count)))


def test_an_equation_that_cannot_be_read_is_refused_when_written() -> None:
    with pytest.raises(InvalidInputError, match="nonsense is no known name"):
        Equation(source="nonsense = 1")
    assert Equation(source="a = b").anchor == ""
    assert len(Equation(source="a = b").formula.items) == 3
