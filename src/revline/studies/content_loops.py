"""The report's sections on closed loops and on errors in time, with the thesis's outcomes beside ours."""

from types import MappingProxyType

import numpy as np

from revline.design.loops.outcome import LimitCycle
from revline.report.blocks import Align, Callout, CalloutKind, Column, Paragraph, TableBlock
from revline.report.document import Section
from revline.report.inline import Text, marked
from revline.studies.content_models import CONTROLLER_NAMES
from revline.studies.delay_models import delay_blocks
from revline.studies.material import Material, figures
from revline.studies.results import ErrorRecord, LoopRow, title
from revline.studies.study_results import StudyResults
from revline.studies.words import ending, outcome_name, plant_name

THESIS_OUTCOMES = MappingProxyType(
    {
        ("c1", "g1"): "overshoot below 8 %, bandwidth 50.77 rad/s read from a plot",
        ("c1", "g2d"): "diverges",
        ("c1", "engine"): "limit cycle",
        ("c2", "g2"): "overshoot below 10 %",
        ("c2", "g2d"): "diverges",
        ("c2", "engine"): "limit cycle",
        ("c2d", "g2d"): "overshoot below 10 %",
        ("c2d", "engine"): "settles without error",
        ("c2d_reduced", "g2"): "slow oscillation",
        ("c2d_reduced", "engine"): "slow oscillation",
    }
)
"""What Lee (1995) reports, chapter 5."""

EARLY = 2.0
"""The first part of a step's answer: so many delays of G2d from the step on."""


def loops_section(material: Material) -> Section:
    """How the controllers do on the engine."""
    results = material.results
    command = results.loops.command
    return Section(
        title="On the engine",
        anchor="loops",
        blocks=(
            Paragraph(
                f"Every loop starts at rest and is asked for a step of {command:g} rad/s, a true step at time 0. The integral starts at 0 "
                "and there is no anti-windup. On the engine the throttle is limited to what it can do; the linear models have no limits, "
                "and their delay is simulated, not approximated. No controller is tuned again for the engine."
            ),
            _loops_table(material),
            Callout(kind=CalloutKind.CAUTION if fooled_controllers(results) else CalloutKind.FINDING, title=_lesson(results)),
            Paragraph(
                marked(
                    "C1 and C2 on the engine: [](#figure-5.9) and [](#figure-5.10). The same controllers on G2d: [](#figure-5.12) and "
                    "[](#figure-5.13). C2d on the engine: [](#figure-5.11). What too little gain does is shown with a tenth of "
                    "C2d's proportional gain, its integral gain left as it is, on G2 and on the engine: [](#figure-5.14) and "
                    "[](#figure-5.15)."
                )
            ),
            *figures(material, "5.9", "5.10", ("5.12", "5.13"), "5.11", ("5.14", "5.15")),
        ),
    )


def _loops_table(material: Material) -> TableBlock:
    columns = [
        Column(heading="Controller"),
        Column(heading="Plant"),
        Column(heading="Outcome"),
        Column(heading="Overshoot", unit="%", align=Align.RIGHT),
        Column(heading="Bandwidth", unit="rad/s", align=Align.RIGHT),
        Column(heading="low", unit="rad/s", align=Align.RIGHT, group="limit cycle"),
        Column(heading="high", unit="rad/s", align=Align.RIGHT, group="limit cycle"),
        Column(heading="period", unit="s", align=Align.RIGHT, group="limit cycle"),
    ]
    rows: list[tuple[Text, ...]] = [_loop_cells(row) for row in material.results.loops.rows]
    if material.config.asks_what_the_thesis_asked:
        columns.append(Column(heading="Lee (1995)"))
        rows = [
            (*cells, THESIS_OUTCOMES.get((row.controller, row.plant), ""))
            for row, cells in zip(material.results.loops.rows, rows, strict=True)
        ]
    return TableBlock(caption="Closed loops", columns=tuple(columns), rows=tuple(rows))


def fooled_controllers(results: StudyResults) -> list[str]:
    """Names of the controllers that settle on the model without delay that they were designed on, but not on the engine."""
    return [
        title(controller)
        for controller, model in (("c1", "g1"), ("c2", "g2"))
        if results.loops.row(controller, model).run.is_stable and not results.loops.row(controller, "engine").run.is_stable
    ]


def _lesson(results: StudyResults) -> str:
    rows = [(title(name), plant, results.loops.row(name, plant).run) for name, plant in (("c1", "g1"), ("c2", "g2"), ("c2d", "g2d"))]
    parts = [
        f"{name} {ending(run)} on {plant_name(plant)} and {ending(results.loops.row(name.lower(), 'engine').run)} on the engine"
        for name, plant, run in rows
    ]
    return "; ".join(parts)


def _loop_cells(row: LoopRow) -> tuple[Text, ...]:
    outcome = row.run.outcome
    cycle = (f"{outcome.low:.2f}", f"{outcome.high:.2f}", f"{outcome.period:.4f}") if isinstance(outcome, LimitCycle) else ("", "", "")
    overshoot = f"{100 * row.run.overshoot:.1f}" if row.run.is_stable else ""
    bandwidth = f"{row.bandwidth:.2f}" if row.bandwidth > 0.0 else ""
    plant = "engine" if row.plant == "engine" else title(row.plant)
    return (CONTROLLER_NAMES.get(row.controller, title(row.controller)), plant, outcome_name(row.run), overshoot, bandwidth, *cycle)


def errors_section(material: Material) -> Section:
    """Errors of the models in time."""
    errors = material.results.errors
    rows: list[tuple[Text, ...]] = []
    for record in errors.records:
        what = "step" if record.kind == "step" else f"sinusoid, {record.frequency:g} rad/s"
        rows += [
            (what, title(name), f"{record.largest(name):.2f}", f"{record.rms(name):.2f}", f"{record.swing(name):.2f}")
            for name in record.models
        ]
    columns = (
        Column(heading="Throttle"),
        Column(heading="Model"),
        Column(heading="Largest", unit="rad/s", align=Align.RIGHT),
        Column(heading="Root mean square", unit="rad/s", align=Align.RIGHT),
        Column(heading="Half of the range", unit="rad/s", align=Align.RIGHT),
    )
    amplitude = material.results.response.excitation.amplitude
    return Section(
        title="Errors in time",
        anchor="errors",
        blocks=(
            Paragraph(
                marked(
                    f"How well do the models follow the engine in time? After a throttle step of {amplitude:g} deg, [](#figure-6.2) and "
                    "[](#figure-6.3), and under sinusoids of that amplitude, [](#figure-6.4) and [](#figure-6.5), their speeds are set "
                    f"beside the engine's. {_best_models(material.results)}"
                )
            ),
            TableBlock(
                caption="Errors of the speed",
                columns=columns,
                rows=tuple(rows),
                notes=("Sinusoids are judged once settled; half of the range leaves out that the engine's mean speed has moved.",),
            ),
            *figures(material, "6.2", "6.3", ("6.4", "6.5")),
            *delay_blocks(material.results.delay_models, errors),
        ),
    )


def _best_models(results: StudyResults) -> str:
    """Which model errs least, early and late after the step and at each frequency."""
    errors, step = results.errors, results.errors.records[0]
    early = EARLY * results.models.fit("g2d").fit.model.delay
    first, then = _least(step, step.start, step.start + early), _least(step, step.start + early, float(step.times[-1]))
    sentences = [f"In the first {early:.2g} s after the step {first} errs least, after that {then}."]
    for record in errors.records[1:]:
        best = min(record.models, key=record.swing)
        sentences.append(f"At {record.frequency:g} rad/s it is {title(best)}, by {record.swing(best):.2f} rad/s.")
    if errors.equal_frequency > 0.0:
        sentences.append(f"G2 and G2d err alike at {errors.equal_frequency:.1f} rad/s.")
    return " ".join(sentences)


def _least(record: ErrorRecord, low: float, high: float) -> str:
    """The model whose largest error within a span of time is the least, with that error."""
    inside = (record.times >= low) & (record.times <= high)
    sizes = np.abs(record.errors[:, inside]).max(axis=1)
    best = int(np.argmin(sizes))
    return f"{title(record.models[best])} (by {sizes[best]:.2f} rad/s at most)"
