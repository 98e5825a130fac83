"""The report's section on hunting: limit cycles as orbits beside their simulation, and how hunting begins."""

from collections.abc import Iterator

from revline.report.blocks import Align, Block, Column, Paragraph, TableBlock
from revline.report.document import Section
from revline.report.inline import marked
from revline.report.numbers import format_number
from revline.studies.hunting_results import CycleRow, HuntingResult
from revline.studies.material import Material, figures
from revline.studies.own_figures import ONSET_FIGURE, ORBIT_FIGURE, RANGE_FIGURE, is_drawn, onset_words, range_words
from revline.studies.results import title
from revline.studies.words import typographic


def hunting_section(material: Material) -> Section:
    """How it hunts."""
    found = material.results.hunting
    text = (
        "A loop beyond the edge of its region does not grow for ever on the engine: it ends in a limit cycle. That is computed here as a "
        "periodic orbit with unknown period, not read from a record: its mesh meets the instants at which a limit acts, its Floquet "
        "multipliers say whether it attracts, and it must be what the simulation ends in."
        if found.cycles
        else "No controller ends in a limit cycle that was computed as an orbit here."
    )
    blocks = (Paragraph(text), *_cycles(material), *_onsets(material), *not_found(material.results.hunting))
    return Section(title="How it hunts", anchor="hunting", blocks=blocks)


def _cycles(material: Material) -> Iterator[Block]:
    found = material.results.hunting
    columns = (
        Column(heading="Controller"),
        Column(heading="low", unit="rad/s", align=Align.RIGHT, group="speed"),
        Column(heading="high", unit="rad/s", align=Align.RIGHT, group="speed"),
        Column(heading="low", unit="deg", align=Align.RIGHT, group="throttle"),
        Column(heading="high", unit="deg", align=Align.RIGHT, group="throttle"),
        Column(heading="Period", unit="s", align=Align.RIGHT),
        Column(heading="Largest multiplier", unit="1", align=Align.RIGHT),
        Column(heading="Attracts"),
        Column(heading="Off the simulation", unit="1", align=Align.RIGHT),
    )
    if found.cycles:
        notes = tuple(f"{title(row.controller)}: {row.reason}" for row in found.without_cycle)
        yield TableBlock(
            caption="Limit cycles on the engine", columns=columns, rows=tuple(_cells(row) for row in found.cycles), notes=notes
        )
    if is_drawn(ORBIT_FIGURE, material.results):
        yield from figures(material, ORBIT_FIGURE)


def _cells(row: CycleRow) -> tuple[str, ...]:
    return (
        title(row.controller),
        f"{row.low:.3f}",
        f"{row.high:.3f}",
        f"{row.control_low:.2f}",
        f"{row.control_high:.2f}",
        f"{row.period:.5f}",
        format_number(row.multiplier, 3),
        "yes" if row.stable else "no",
        format_number(row.gap, 1),
    )


def _onsets(material: Material) -> Iterator[Block]:
    for row in material.results.hunting.onsets:
        yield Paragraph(marked(f"How does it begin? {typographic(onset_words(row))} [](#figure-{ONSET_FIGURE}) follows the cycles."))
        yield from figures(material, ONSET_FIGURE)


def not_found(found: HuntingResult) -> Iterator[Block]:
    """Why a cycle stands in no table, and why nothing is said of an onset."""
    if not found.cycles:
        for row in found.without_cycle:
            yield Paragraph(typographic(f"The limit cycle of {title(row.controller)} was not found: {row.reason}"))
    for row in found.without_onset:
        yield Paragraph(typographic(f"How hunting begins with {title(row.controller)} was not found: {row.reason}"))


def range_blocks(material: Material) -> tuple[Block, ...]:
    """Up to which amplitude the exact linear model holds."""
    text = (
        "Up to which amplitude may a linear model stand for the engine? Harmonic balance finds the fundamental at any amplitude, and with "
        f"it the error of the exact linear model, [](#figure-{RANGE_FIGURE}). {typographic(range_words(material.results))}"
    )
    return (Paragraph(marked(text)), *figures(material, RANGE_FIGURE))
