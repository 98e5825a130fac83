"""The report's words on how far models are from the engine as feedback sees them."""

from collections.abc import Iterator

from revline.report.blocks import Align, Block, Column, Paragraph, TableBlock
from revline.report.inline import marked
from revline.report.numbers import format_number
from revline.studies.material import Material, figures
from revline.studies.model_distance import FIGURE, DistanceRow, distance_words
from revline.studies.results import title
from revline.studies.words import plant_name, typographic


def distance_blocks(material: Material) -> Iterator[Block]:
    """Paragraph, table and figure of the report."""
    found = material.results.distance
    if not found.rows:
        return
    yield Paragraph(
        marked(
            "How far is a model from the engine, as feedback sees it? The nu-gap says it in one number from 0 to 1, with the controller as "
            "weight and every delay exact. Below the margin of the loop on the model, the controller is sure to stabilise the engine's "
            f"exact linear model too; above it the model says nothing. {typographic(distance_words(found))}"
        )
    )
    columns = (
        Column(heading="Controller"),
        Column(heading="Model"),
        Column(heading="Beside"),
        Column(heading="nu-gap", unit="1", align=Align.RIGHT),
        Column(heading="Margin on the model", unit="1", align=Align.RIGHT),
        Column(heading="Sure"),
        Column(heading="Stable there"),
        Column(heading="Margin there", unit="1", align=Align.RIGHT),
    )
    notes = tuple(f"{title(m.controller)} on {title(m.model)} beside {plant_name(m.plant)}: {m.reason}" for m in found.missing)
    yield TableBlock(
        caption="Distance of models from the engine", columns=columns, rows=tuple(_cells(row) for row in found.rows), notes=notes
    )
    if found.drawn():
        yield from figures(material, FIGURE)


def _cells(row: DistanceRow) -> tuple[str, ...]:
    verdict = row.verdict
    return (
        title(row.controller),
        title(row.model),
        plant_name(row.plant),
        format_number(verdict.gap.value, 3),
        format_number(verdict.margin, 3),
        "yes" if verdict.guaranteed else "no",
        "yes" if verdict.stable else "no",
        format_number(verdict.other_margin, 3) if verdict.stable else "",
    )
