"""What a report is made of, and its figures as blocks."""

from dataclasses import dataclass
from pathlib import Path

from revline.report.blocks import Block, FigureBlock, FigureRow
from revline.studies.captions import caption, figure_rows
from revline.studies.checks import Check
from revline.studies.config import StudyConfig
from revline.studies.study_results import StudyResults


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """What the report is made of: questions, results, checks, warnings, figures' folder, and how the numbers were made.

    Those were finished at `made_on` by a run of so many seconds, which took `kept` steps from earlier runs.
    """

    config: StudyConfig
    results: StudyResults
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    figures: Path
    seconds: float
    kept: int
    made_on: str


def figure_block(material: Material, figure: str) -> FigureBlock:
    """One figure with its caption."""
    content = next(row["content"] or row["title"] for row in figure_rows() if row["id"] == figure)
    path = material.figures / f"figure_{figure}.png"
    return FigureBlock(id=figure, caption=caption(figure, material.results), shows=content, png=path, svg=path.with_suffix(".svg"))


def figures(material: Material, *ids: str) -> tuple[Block, ...]:
    """Figures in pairs."""
    blocks = [figure_block(material, figure) for figure in ids]
    pairs = [blocks[k : k + 2] for k in range(0, len(blocks), 2)]
    return tuple(FigureRow(figures=tuple(pair)) if len(pair) == 2 else pair[0] for pair in pairs)
