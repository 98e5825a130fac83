"""The report's section on stability with the delay exact: margins of the loops, and the gains that stabilise each plant."""

from collections.abc import Iterator

from revline.design.stability.margins import Margins
from revline.report.blocks import Align, Callout, CalloutKind, Column, Paragraph, TableBlock
from revline.report.document import Section
from revline.report.inline import Text, marked
from revline.report.numbers import format_decimals, format_number
from revline.studies.content_distance import distance_blocks
from revline.studies.material import Material, figures
from revline.studies.results import title
from revline.studies.stability_results import AT_START, AT_TARGET, NoRegion, RegionRow, StabilityResult
from revline.studies.study_results import StudyResults
from revline.studies.words import listed, plant_name, typographic

NO_LIMIT = "no limit"


def stability_section(material: Material) -> Section:
    """What the delay allows."""
    found = material.results.stability
    return Section(
        title="What the delay allows",
        anchor="stability",
        blocks=(
            Paragraph(
                marked(
                    "Whether a loop comes to rest needs no simulation to be foreseen, as long as no limit holds the throttle. The engine "
                    f"is linearised with its delays exact, where the loops start{_target_words(found)}, and each loop is judged on that "
                    "and on the fitted models: [](#table-margins). Nothing is approximated; a delay stays a factor exp(-sτ)."
                )
            ),
            _margins_table(found),
            Paragraph(
                marked(
                    "Which gains stabilise at all is a region of the plane of kp and ki for each kd; on its edge a pair of roots lies on "
                    "the imaginary axis. [](#figure-7.1) to [](#figure-7.3) show the regions of the fitted models and of the engine at the "
                    "kd of each controller, and the controllers in them."
                )
            ),
            *figures(material, "7.1", "7.2", "7.3"),
            *(Paragraph(typographic(_no_region_words(row))) for row in found.without_region),
            Callout(kind=CalloutKind.FINDING, title=typographic(" ".join(regions_in_words(material.results)))),
            *distance_blocks(material),
        ),
    )


def _target_words(found: StabilityResult) -> str:
    for trim in found.target:
        return f" and where the command leads them, {trim.output('engine_speed'):.1f} rad/s at {trim.input('throttle'):.2f} deg"
    return " (where the command leads, no steady state of the engine was found)"


def _no_region_words(row: NoRegion) -> str:
    return f"The gains that stabilise {plant_name(row.plant)} with kd = {row.kd:.3g} deg s²/rad were not found: {row.reason}"


def _margins_table(found: StabilityResult) -> TableBlock:
    columns = (
        Column(heading="Controller"),
        Column(heading="Plant"),
        Column(heading="Stable"),
        Column(heading="Gain may rise", unit="dB", align=Align.RIGHT),
        Column(heading="Phase margin", unit="deg", align=Align.RIGHT),
        Column(heading="Delay margin", unit="ms", align=Align.RIGHT),
        Column(heading="Ms", unit="1", align=Align.RIGHT),
        Column(heading="Disk margin", unit="1", align=Align.RIGHT),
    )
    rows = tuple((title(row.controller), _cell_name(row.plant), *_cells(row.margins)) for row in found.margins)
    notes = tuple(f"{title(row.controller)} with {plant_name(row.plant)}: {row.reason}" for row in found.without_margins)
    return TableBlock(caption="Margins, the delays exact", columns=columns, rows=rows, id="margins", notes=notes)


def _cell_name(plant: str) -> str:
    return {AT_START: "engine, at the start", AT_TARGET: "engine, at the target"}.get(plant, title(plant))


def _cells(margins: Margins) -> tuple[Text, ...]:
    if not margins.stable:
        return ("no", "", "", "", "", "")
    rise, phase, delay = margins.gain_rise, margins.phase, margins.delay
    return (
        "yes",
        NO_LIMIT if rise is None else format_decimals(rise.gain_margin_db, 1),
        "" if phase is None else format_decimals(phase.phase_margin_deg, 1),
        "" if delay is None else format_decimals(1e3 * delay.delay_margin, 1),
        format_number(margins.sensitivity.value, 3),
        format_number(margins.disk_margin, 2),
    )


def regions_in_words(results: StudyResults) -> Iterator[str]:
    """Say of each controller which plants it stabilises, and which no controller with its kd does."""
    for name in ("c1", "c2", "c2d"):
        rows = results.stability.of_kd(results.controllers.gains[name].kd)
        if rows:
            yield _controller_words(name, rows)


def _controller_words(name: str, rows: tuple[RegionRow, ...]) -> str:
    good = [plant_name(row.plant) for row in rows if name in row.inside]
    bad = [plant_name(row.plant) for row in rows if name in row.outside]
    none = [plant_name(row.plant) for row in rows if row.is_empty]
    if not bad:
        return f"{title(name)} lies inside the region of every plant."
    if not good:
        return f"{title(name)} lies inside the region of none."
    text = f"{title(name)} lies inside the region of {listed(good)}, but outside that of {listed(bad)}"
    return f"{text}; no kp and ki at all stabilise {listed(none)} with its kd." if none else f"{text}."
