"""The report's sections on models, controllers, closed loops and errors, with ours beside the thesis's numbers."""

import tomllib
from types import MappingProxyType
from typing import Any

from revline.design.closed_loop import FORM
from revline.design.outcome import LimitCycle
from revline.report.blocks import Align, Callout, CalloutKind, Column, ItemList, Paragraph, TableBlock
from revline.report.document import Section
from revline.report.inline import Text
from revline.report.numbers import MINUS, format_deviation, format_number
from revline.studies.config import StudyConfig, read_table_4_1, reference_text
from revline.studies.material import Material, figures
from revline.studies.results import LoopRow, ModelsResult, title
from revline.studies.study_results import StudyResults

THESIS_NAMES = (
    ("g1", "first_order"),
    ("g2", "second_order"),
    ("g12", "second_order_zero"),
    ("g2d", "second_order_delay"),
    ("g3", "third_order"),
    ("g4", "fourth_order"),
)
RIGHT = Align.RIGHT

TABLE_NOTE = (
    "Ours is fitted to the response computed here, Table 4.1 to the thesis's own response; print is what the thesis prints, its digits "
    "truncated. Numerators in rad/s per deg of throttle."
)


def _column(heading: str, unit: str = "", group: str = "") -> Column:
    return Column(heading=heading, unit=unit, align=RIGHT, group=group)


def response_table(config: StudyConfig, results: StudyResults) -> TableBlock:
    """Ours beside Table 4.1, or ours alone."""
    stream, exact = results.response, results.point.exact
    compared = config.is_the_thesis and len(read_table_4_1()) == len(stream.omega)
    columns = [
        _column("Frequency", "rad/s"),
        _column("Amplitude", "rad/s", "by peaks"),
        _column("Phase", "deg", "by peaks"),
        _column("Amplitude", "rad/s", "fundamental"),
        _column("Phase", "deg", "fundamental"),
        _column("Distortion", "%", "fundamental"),
        _column("Amplitude", "rad/s", "exact, small signal"),
        _column("Phase", "deg", "exact, small signal"),
    ]
    if compared:
        columns += [
            _column("Amplitude", "rad/s", "Lee's Table 4.1"),
            _column("Phase", "deg", "Lee's Table 4.1"),
            _column("Peaks off by", "%", "Lee's Table 4.1"),
        ]
    rows = []
    for k, omega in enumerate(stream.omega):
        cells = [
            format_number(float(omega), 3),
            format_number(float(stream.peak_amplitude[k])),
            f"{stream.peaks.phase_deg[k]:.1f}",
            format_number(float(stream.amplitude[k])),
            f"{stream.phase_deg[k]:.1f}",
            f"{100 * stream.distortion[k]:.2f}",
            format_number(float(exact.magnitude[k]) * config.amplitude_deg),
            f"{exact.phase_deg[k]:.1f}",
        ]
        if compared:
            row = read_table_4_1()[k]
            size = row["speed_amplitude_rad_s"]
            cells += [format_number(size), f"{-row['phase_lag_deg']:.1f}", format_deviation(float(stream.peak_amplitude[k]), size)]
        rows.append(tuple(cells))
    return TableBlock(
        caption="Frequency response from throttle to speed",
        columns=tuple(columns),
        rows=tuple(rows),
        id="4.1",
        notes=("At 6 rad/s the thesis prints 19.38, a misprint for 18.38: only with that do its own fits come out.",) if compared else (),
    )


def models_section(material: Material) -> Section:
    """The six models, their errors and verdicts."""
    results = material.results
    verdicts = [
        f"{title(named.name)} is {verdict.text}" if verdict.text.startswith("rejected") else f"{title(named.name)}: {verdict.text}"
        for named, verdict in zip(results.models.fits, results.models.verdicts, strict=True)
    ]
    return Section(
        title="Linear models",
        anchor="models",
        blocks=(
            Paragraph(
                "Six transfer functions are fitted by output error: the sum over all frequencies of the squared distance between model and "
                "response, as complex numbers. G1, G2, G3 and G4 have one to four poles, G12 has a zero besides; G2d is G2 with the delay "
                "that the remaining phase shows."
            ),
            models_table(results),
            Callout(
                kind=CalloutKind.FINDING,
                title=f"The model to design on: {', '.join(map(title, results.models.chosen)) or 'none is accepted'}",
                blocks=(ItemList(items=tuple(verdicts)),),
            ),
            *figures(material, "4.11a", "4.11b", "4.12a", "4.12b", "4.13", "4.14a", "4.14b", "6.1"),
            poles_table(results),
        ),
    )


def thesis_models() -> dict[str, Any]:
    """Tables 4.2 and 6.1 of Lee (1995), by our names."""
    content = tomllib.loads(reference_text("linear_models.toml"))
    return {ours: content[theirs] for ours, theirs in THESIS_NAMES}


def models_table(results: StudyResults) -> TableBlock:
    """Coefficients: fitted to our response, fitted to Lee's table, and as Lee prints them."""
    sources: list[tuple[str, ModelsResult]] = [("ours", results.models), *(("Table 4.1", m) for m in results.table_models)]
    printed = thesis_models() if results.table_models else {}
    columns = (
        Column(heading="Model"),
        Column(heading="Fitted to"),
        *(_column(text, group="numerator") for text in ("1", "s")),
        *(_column(text, group="denominator") for text in ("s", "s²", "s³", "s⁴")),
        _column("Delay", "ms"),
    )
    rows: list[tuple[Text, ...]] = []
    for name, _ in THESIS_NAMES:
        for source, models in sources:
            model = models.fit(name).fit.model
            rows.append((title(name), source, *_coefficients(model.numerator, model.denominator, model.delay)))
        if name in printed:
            rows.append((title(name), "print, 1995", *_printed(printed[name])))
    return TableBlock(
        caption="Coefficients in ascending powers of s, denominators 1 at s = 0",
        columns=columns,
        rows=tuple(rows),
        id="4.2",
        notes=(TABLE_NOTE,) if printed else (),
    )


def _coefficients(numerator: Any, denominator: Any, delay: float) -> tuple[str, ...]:
    above = [format_number(float(c), 5) for c in numerator]
    below = [format_number(float(c), 5) for c in denominator[1:]]
    return (*above, *[""] * (2 - len(above)), *below, *[""] * (4 - len(below)), f"{1e3 * delay:.2f}" if delay else "")


def _printed(entry: Any) -> tuple[str, ...]:
    """Coefficients with the digits that the thesis prints."""
    above, below = [f"{c:g}" for c in entry["numerator"]], [f"{c:g}" for c in entry["denominator"][1:]]
    delay = f"{1e3 * entry['delay_s']:g}" if "delay_s" in entry else ""
    return (*above, *[""] * (2 - len(above)), *below, *[""] * (4 - len(below)), delay)


def poles_table(results: StudyResults) -> TableBlock:
    """Poles beside Table 6.1."""
    printed = thesis_models() if results.table_models else {}
    rows: list[tuple[Text, ...]] = []
    for name in ("g1", "g2", "g3", "g4"):
        ours = ", ".join(_show_pole(pole) for pole in results.models.fit(name).fit.model.poles)
        table = ", ".join(_show_pole(pole) for models in results.table_models for pole in models.fit(name).fit.model.poles)
        theirs = ", ".join(_show_pole(complex(pole)) for pole in printed.get(name, {}).get("poles", []))
        rows.append((title(name), ours, *((table, theirs) if printed else ())))
    columns = [Column(heading="Model"), Column(heading="Poles, own response", unit="1/s")]
    if printed:
        columns += [Column(heading="Poles, fitted to Table 4.1", unit="1/s"), Column(heading="Poles as printed in 1995", unit="1/s")]
    return TableBlock(caption="Poles", columns=tuple(columns), rows=tuple(rows), id="6.1")


def _show_pole(pole: complex) -> str:
    if abs(pole.imag) < 1e-9 * abs(pole):
        return format_number(pole.real)
    sign = "+" if pole.imag > 0.0 else MINUS
    return f"{format_number(pole.real)} {sign} {format_number(abs(pole.imag))}j"


def controllers_section(material: Material) -> Section:
    """Gains and how they were found."""
    results = material.results
    rows: tuple[tuple[Text, ...], ...] = tuple(
        (
            CONTROLLER_NAMES.get(name, title(name)),
            format_number(g.kp),
            format_number(g.ki),
            format_number(g.kd),
            g.rule,
            title(g.designed_on),
        )
        for name, g in results.controllers.gains.items()
    )
    columns = (
        Column(heading="Controller"),
        _column("kp", "deg/(rad/s)"),
        _column("ki", "deg/rad"),
        _column("kd", "deg s2/rad"),
        Column(heading="Rule"),
        Column(heading="Designed on"),
    )
    tuned = tuple(f"{title(name)}: {tuning.text}." for name, tuning in results.controllers.tunings.items())
    return Section(
        title="Controllers, as designed on the models",
        anchor="controllers",
        blocks=(
            Paragraph(
                "C1 places the poles of the loop around G1. C2 and C2d start from Ziegler and Nichols' step-response rule. "
                "The thesis's form of "
                "that rule forgets the plant's gain, so that its gains are twelve times too hot and had to be tamed by hand; "
                "the rule as it was "
                "published divides by the gain. Both are shown."
            ),
            TableBlock(caption="Gains", columns=columns, rows=rows),
            Callout(kind=CalloutKind.FINDING, title="Fine tuning", blocks=(ItemList(items=tuned),)),
            *figures(material, "5.3", "5.1", "5.2", "5.4", "5.6", "5.5", "5.7"),
        ),
    )


CONTROLLER_NAMES = MappingProxyType(
    {
        "c1": "C1",
        "c2_zn": "C2, first (without gain)",
        "c2_zn_with_gain": "C2, first (with gain)",
        "c2": "C2, tuned",
        "c2d_zn": "C2d, first (without gain)",
        "c2d_zn_with_gain": "C2d, first (with gain)",
        "c2d": "C2d, tuned",
        "c2d_reduced": "C2d, a tenth of kp",
    }
)


def loops_section(material: Material) -> Section:
    """How the controllers do on the engine."""
    results = material.results
    columns = (
        Column(heading="Controller"),
        Column(heading="Plant"),
        Column(heading="Outcome"),
        _column("Overshoot", "%"),
        _column("Bandwidth", "rad/s"),
        _column("low", "rad/s", "limit cycle"),
        _column("high", "rad/s", "limit cycle"),
        _column("period", "s", "limit cycle"),
    )
    return Section(
        title="On the engine",
        anchor="loops",
        blocks=(
            Paragraph(
                f"Every loop is asked for a step of {results.loops.command:g} rad/s. Form: {FORM}. On the engine the throttle "
                "is limited; the "
                "linear models have no limits, and their delay is simulated, not approximated."
            ),
            TableBlock(caption="Closed loops", columns=columns, rows=tuple(_loop_cells(row) for row in results.loops.rows)),
            Callout(kind=CalloutKind.CAUTION, title=_lesson(results)),
            *figures(material, "5.9", "5.10", "5.11", "5.12", "5.13", "5.14", "5.15"),
        ),
    )


def _lesson(results: StudyResults) -> str:
    fooled = [
        c
        for c, m in (("c1", "g1"), ("c2", "g2"))
        if results.loops.row(c, m).run.is_stable and not results.loops.row(c, "engine").run.is_stable
    ]
    if not fooled:
        return "Every controller does on the engine what its model promised"
    return f"{' and '.join(title(c) for c in fooled)} settle on the model they were designed on and hunt on the engine"


def _loop_cells(row: LoopRow) -> tuple[Text, ...]:
    outcome = row.run.outcome
    cycle = (f"{outcome.low:.2f}", f"{outcome.high:.2f}", f"{outcome.period:.4f}") if isinstance(outcome, LimitCycle) else ("", "", "")
    overshoot = f"{100 * row.run.overshoot:.1f}" if row.run.is_stable else ""
    bandwidth = f"{row.bandwidth:.2f}" if row.bandwidth > 0.0 else ""
    plant = "engine" if row.plant == "engine" else title(row.plant)
    return (CONTROLLER_NAMES.get(row.controller, title(row.controller)), plant, outcome.name, overshoot, bandwidth, *cycle)


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
        _column("Largest", "rad/s"),
        _column("Root mean square", "rad/s"),
        _column("Alternating part", "rad/s"),
    )
    equal = f" They err alike at {errors.equal_frequency:.1f} rad/s." if errors.equal_frequency > 0.0 else ""
    return Section(
        title="Errors in time",
        anchor="errors",
        blocks=(
            Paragraph(
                "The delay pays where things are fast: right after a step and at high frequency G2d is the better model, later and at low "
                f"frequency G2.{equal}"
            ),
            TableBlock(caption="Errors of the speed", columns=columns, rows=tuple(rows), notes=("Sinusoids are judged once settled.",)),
            *figures(material, "6.2", "6.3", "6.4", "6.5"),
        ),
    )
