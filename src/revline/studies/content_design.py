"""The report's section on gains that hold: rules and the optimum, the operating map, acceptance, and two inputs."""

from collections.abc import Iterator
from types import MappingProxyType

from revline.report.blocks import Align, Block, Column, Paragraph, TableBlock
from revline.report.document import Section
from revline.report.inline import Text, marked
from revline.report.numbers import format_decimals, format_number
from revline.studies.material import Material, figures
from revline.studies.operating_map import MAP_FIGURE, SCHEDULE_FIGURE, map_words
from revline.studies.own_figures import is_drawn
from revline.studies.results import NotFound
from revline.studies.rivals import FIGURE as RIVALS_FIGURE
from revline.studies.rivals import RivalsResult, rivals_words
from revline.studies.trials import AT_POINT, FIXED, OVER_MAP, PERIOD, SCHEDULE, SPREAD, Trial, trial_words
from revline.studies.trials import FIGURE as TRIALS_FIGURE
from revline.studies.two_inputs import FIGURE as TWO_INPUTS_FIGURE
from revline.studies.two_inputs import LOAD_STEP, two_inputs_words
from revline.studies.words import typographic

NAMES = MappingProxyType({"c2d": "C2d", "optimum": "optimum", "fixed": "fixed gains", "schedule": "schedule"})
"""Controllers on trial as the tables name them."""


def design_section(material: Material) -> Section:
    """Gains that hold."""
    return Section(
        title="Gains that hold",
        anchor="design",
        blocks=(
            Paragraph(
                "Which gains should the engine be given? Every rule of the books is held against the best of its form, the ultimate gain "
                "is measured as well as computed, gains are found for a whole map of operating points, and what comes out is tried as an "
                "engine computer runs it."
            ),
        ),
        sections=(
            Section(title="Rules and the optimum", anchor="rules", blocks=tuple(_rivals(material))),
            Section(title="The ultimate gain, computed and measured", anchor="ultimate", blocks=tuple(_ultimate(material))),
            Section(title="Over the operating map", anchor="map", blocks=tuple(_map(material))),
            Section(title="Acceptance", anchor="acceptance", blocks=tuple(_trials(material))),
            Section(title="Spark and throttle", anchor="two-inputs", blocks=tuple(_two_inputs(material))),
        ),
    )


def _rivals(material: Material) -> Iterator[Block]:
    found = material.results.rivals
    yield Paragraph(
        marked(
            "For each controller the gains of least integrated error after a step of the load are sought with no more maximum sensitivity "
            "Ms and no more error after a step of the command than its own, every delay exact. "
            f"{typographic(rivals_words(found))}"
        )
    )
    if found.compared.competitors:
        yield _rivals_table(found)
    if is_drawn(RIVALS_FIGURE, material.results):
        yield from figures(material, RIVALS_FIGURE)


def _rivals_table(found: RivalsResult) -> TableBlock:
    columns = (
        Column(heading="Controller"),
        Column(heading="Ms", unit="1", align=Align.RIGHT),
        Column(heading="Error after a command", unit="s", align=Align.RIGHT),
        Column(heading="own", unit="rad per N m", align=Align.RIGHT, group="error after a load"),
        Column(heading="optimum's", unit="rad per N m", align=Align.RIGHT, group="error after a load"),
        Column(heading="Ratio", unit="1", align=Align.RIGHT),
        *(
            Column(heading=name, unit=unit, align=Align.RIGHT, group="optimum")
            for name, unit in (("kp", "deg/(rad/s)"), ("ki", "deg/rad"), ("kd", "deg s²/rad"))
        ),
    )
    rows = tuple(
        (
            one.name,
            format_number(float(one.cost.sensitivity.max()), 3),
            format_number(one.cost.setpoint, 3),
            format_number(one.cost.load, 3),
            format_number(one.optimum.cost, 3),
            format_decimals(one.ratio, 3),
            *(format_number(value, 3) for value in one.optimum.terms[:3]),
        )
        for one in found.compared.competitors
    )
    notes = tuple(
        typographic(f"{name}: {reason}") for name, reason in (*found.compared.left_out, *((r.rule, r.reason) for r in found.refused))
    )
    return TableBlock(
        caption="Controllers and rules beside the optimum of their form", columns=columns, rows=rows, id="rivals", notes=notes
    )


def _ultimate(material: Material) -> Iterator[Block]:
    found = material.results.rivals
    for entry in found.ultimate:
        yield Paragraph("The proportional gain at which the loop oscillates for ever is found in five ways, and they do not agree. Why:")
        yield TableBlock(
            caption="Ultimate gain and period",
            columns=(
                Column(heading="Way"),
                Column(heading="Gain", unit=entry.unit, align=Align.RIGHT),
                Column(heading="Period", unit="s", align=Align.RIGHT),
            ),
            rows=tuple((name, f"{gain:.4f}", f"{period:.5f}") for name, gain, period in entry.ways),
            notes=tuple(typographic(f"{reason[0].upper()}{reason[1:]}.") for reason in entry.reasons),
        )
    yield from _absent(found.missing)


def _map(material: Material) -> Iterator[Block]:
    found = material.results.operating_map
    yield Paragraph(
        marked(
            typographic(
                f"The delay is an angle over the speed, and the engine's gain falls with the load: what suits one point does not suit "
                f"another. {map_words(found)}"
            )
        )
    )
    for figure in (MAP_FIGURE, SCHEDULE_FIGURE):
        if is_drawn(figure, material.results):
            yield from figures(material, figure)
    yield from _absent(found.missing)


def _trials(material: Material) -> Iterator[Block]:
    found = material.results.trials
    yield Paragraph(
        typographic(
            f"Sampled every {1e3 * PERIOD:g} ms, within the throttle's limits, with anti-windup, a controller goes through steps of "
            "command and load up and down, without and with noise and late samples, and on engines whose inertia, delays, manifold or "
            f"torque are {100 * SPREAD:g} % off. Then all gains are raised until the engine hunts: the reserve is measured. "
            + " ".join(trial_words(trial) for trial in found.trials)
        )
    )
    if found.trials:
        yield _trials_table(found.trials)
    if is_drawn(TRIALS_FIGURE, material.results):
        yield from figures(material, TRIALS_FIGURE)
    yield from _absent(found.missing)


def _trials_table(trials: tuple[Trial, ...]) -> TableBlock:
    columns = (
        Column(heading="Controller"),
        Column(heading="Throttle", unit="deg", align=Align.RIGHT),
        Column(heading="Load", unit="N m", align=Align.RIGHT),
        Column(heading="Ms, sampled", unit="1", align=Align.RIGHT),
        Column(heading="Reserve", unit="dB", align=Align.RIGHT),
        Column(heading="Largest overshoot", unit="%", align=Align.RIGHT),
        Column(heading="Longest settling", unit="s", align=Align.RIGHT),
        Column(heading="Largest droop", unit="rad/s", align=Align.RIGHT),
    )
    rows: list[tuple[Text, ...]] = []
    for trial in trials:
        for place in trial.summary.places:
            settling = f"{place.settling.max():.2f}" if place.kinds and place.settling.max() < float("inf") else "never"
            measured = (f"{100.0 * place.overshoot.max():.1f}", settling, f"{place.droop.max():.2f}") if place.kinds else ("", "", "")
            rows.append(
                (
                    NAMES[trial.name],
                    *(f"{value:g}" for _, value in place.place),
                    f"{place.ms[0]:.2f}" if place.ms else "unstable",
                    f"{place.reserve_db[0]:.1f}" if place.reserve_db else "",
                    *measured,
                )
            )
    notes = tuple(_asked(trial) for trial in trials)
    return TableBlock(caption="Worst of all runs at each operating point", columns=columns, rows=tuple(rows), id="trials", notes=notes)


def _asked(trial: Trial) -> str:
    overshoot, settling, _, reserve = trial.summary.limits
    battery = OVER_MAP if trial.name in {FIXED, SCHEDULE} else AT_POINT
    size = f"steps of {battery.command:g} rad/s and {battery.load:g} N m"
    failed = trial.summary.runs - trial.summary.kept
    return (
        f"{NAMES[trial.name]}: set-point weight {trial.setpoint_weight:.2f}, {size}; asked for: overshoot at most {100.0 * overshoot:g} "
        f"%, settled within {settling:g} s, a reserve of {reserve:g} dB. {failed} of {trial.summary.runs} runs fail."
    )


def _two_inputs(material: Material) -> Iterator[Block]:
    found = material.results.two_inputs
    yield Paragraph(
        typographic(
            f"The throttle acts late, the spark almost at once, but only as long as torque is held in reserve. With the spark at "
            f"{found.spark:g} deg from best torque it takes the first part of a load of {LOAD_STEP:g} N m, and the throttle brings it "
            "back to that value: mid-ranging, both loops designed with their delays exact and the same maximum sensitivity as the "
            f"throttle alone. {two_inputs_words(found)}"
        )
    )
    if is_drawn(TWO_INPUTS_FIGURE, material.results):
        yield from figures(material, TWO_INPUTS_FIGURE)


def _absent(missing: tuple[NotFound, ...]) -> Iterator[Block]:
    for one in missing:
        yield Paragraph(typographic(f"Not found: {one.what}. {one.reason}"))
