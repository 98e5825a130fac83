"""What a report is made of, and its figures as blocks."""

from dataclasses import dataclass
from pathlib import Path

from revline.report.blocks import Block, FigureBlock, FigureRow
from revline.studies.captions import caption, figure_description
from revline.studies.checks import Check
from revline.studies.config import StudyConfig
from revline.studies.made import Made
from revline.studies.study_results import StudyResults
from revline.system import DelaySystem


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """What the report is made of: questions, engine, results, checks, warnings, the figures' folder, how the results were made."""

    config: StudyConfig
    engine: DelaySystem
    results: StudyResults
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    figures: Path
    made: Made


def figure_block(material: Material, figure: str) -> FigureBlock:
    """One figure with its caption."""
    path = material.figures / f"figure_{figure}.png"
    return FigureBlock(
        id=figure,
        caption=caption(figure, material.results),
        shows=figure_description(figure, material.results),
        png=path,
        svg=path.with_suffix(".svg"),
    )


def figures(material: Material, *rows: str | tuple[str, ...]) -> tuple[Block, ...]:
    """Figures alone, or side by side where their numbers stand together."""
    return tuple(
        figure_block(material, row) if isinstance(row, str) else FigureRow(figures=tuple(figure_block(material, figure) for figure in row))
        for row in rows
    )
