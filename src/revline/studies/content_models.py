"""The report's sections on models and controllers, with ours beside the thesis's numbers."""

import tomllib
from collections.abc import Iterable
from types import MappingProxyType
from typing import Any

from revline.design.controllers.controller import PidGains
from revline.design.tuning.fine_tuning import FineTuning
from revline.report.blocks import Align, Callout, CalloutKind, Column, Equation, ItemList, Paragraph, TableBlock
from revline.report.document import Section
from revline.report.inline import Text, marked
from revline.report.numbers import format_decimals, format_deviation, format_number
from revline.studies.config import StudyConfig, read_table_4_1, reference_text
from revline.studies.material import Material, figures
from revline.studies.results import ModelsResult, title
from revline.studies.study_results import StudyResults
from revline.studies.words import listed, typographic

THESIS_NAMES = (
    ("g1", "first_order"),
    ("g2", "second_order"),
    ("g12", "second_order_zero"),
    ("g2d", "second_order_delay"),
    ("g3", "third_order"),
    ("g4", "fourth_order"),
)
THESIS_CONTROLLERS = (
    ("c1", "c1"),
    ("c2_zn", "c2_ziegler_nichols"),
    ("c2", "c2_tuned"),
    ("c2d_zn", "c2d_ziegler_nichols"),
    ("c2d", "c2d_tuned"),
    ("c2d_reduced", "c2d_reduced"),
)
RIGHT = Align.RIGHT
NONE = "\N{EN DASH}"

TABLE_NOTE = (
    "Ours is fitted to the response computed here, Table 4.1 to the thesis's own response; print is what the thesis prints, its digits "
    "truncated. Numerators in rad/s per deg of throttle."
)


def _column(heading: str, unit: str = "", group: str = "") -> Column:
    return Column(heading=heading, unit=unit, align=RIGHT, group=group)


def response_table(config: StudyConfig, results: StudyResults) -> TableBlock:
    """Ours beside Table 4.1, or ours alone."""
    stream, exact = results.response, results.point.exact
    compared = config.has_the_frequencies_of_table_4_1
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
            _column("Peaks off", "%", "Lee's Table 4.1"),
            _column("Peaks off", "deg", "Lee's Table 4.1"),
        ]
    rows = []
    for k, omega in enumerate(stream.omega):
        cells = [
            f"{omega:g}",
            format_number(float(stream.peak_amplitude[k])),
            format_decimals(float(stream.peaks.phase_deg[k]), 1),
            format_number(float(stream.amplitude[k])),
            format_decimals(float(stream.phase_deg[k]), 1),
            f"{100 * stream.distortion[k]:.2f}",
            format_number(float(exact.magnitude[k]) * config.amplitude_deg),
            format_decimals(float(exact.phase_deg[k]), 1),
        ]
        if compared:
            row = read_table_4_1()[k]
            size, phase = row["speed_amplitude_rad_s"], -row["phase_lag_deg"]
            off = float(stream.peaks.phase_deg[k]) - phase
            cells += [format_number(size), format_decimals(phase, 1), format_deviation(float(stream.peak_amplitude[k]), size)]
            cells += [f"{'+' if off > 0.0 else ''}{format_decimals(off, 2)}"]
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
                marked(
                    "Six transfer functions $G(s)$ from throttle to speed are fitted by output error: the sum over all frequencies of the "
                    "squared distance between model and response, as complex numbers, is made as small as it can be. G1, G2, G3 and G4 "
                    "have one to four poles; G12 has two and a zero besides. [](#table-4.2) lists them."
                )
            ),
            Equation(source="G(s) = (b_0 + b_1 s)/(1 + a_1 s + a_2 s^2 + a_3 s^3 + a_4 s^4) exp(-tau s)"),
            Paragraph(
                marked(
                    "G2d is G2 times a pure delay $tau$. It is read from the phase that G2 leaves over: a delay turns the phase in "
                    "proportion to frequency, so that minus the slope of a straight line through the difference is the delay, "
                    "[](#figure-4.13)."
                )
            ),
            models_table(results),
            Callout(kind=CalloutKind.FINDING, title=_choice(results), blocks=(ItemList(items=tuple(map(typographic, verdicts))),)),
            Paragraph(
                marked(
                    "What each model misses is seen in the Bode plots and their errors: G1 in [](#figure-4.11a) and [](#figure-4.11b), G2 "
                    "in [](#figure-4.12a) and [](#figure-4.12b), G2d in [](#figure-4.14a) and [](#figure-4.14b). Where the poles lie, "
                    "[](#figure-6.1) and [](#table-6.1), shows what more poles are good for."
                )
            ),
            *figures(material, ("4.11a", "4.11b"), ("4.12a", "4.12b"), ("4.13", "6.1"), ("4.14a", "4.14b")),
            poles_table(results),
        ),
    )


def _choice(results: StudyResults) -> str:
    chosen = results.models.chosen
    return (
        f"The model to design on: {title(chosen)}"
        if chosen
        else "No model passes every test; controllers are designed on them all the same"
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
    above, below = [_given(c) for c in entry["numerator"]], [_given(c) for c in entry["denominator"][1:]]
    delay = f"{1e3 * entry['delay_s']:g}" if "delay_s" in entry else ""
    return (*above, *[""] * (2 - len(above)), *below, *[""] * (4 - len(below)), delay)


def _given(value: float) -> str:
    """A number with the digits that it is given with."""
    return typographic(f"{value:g}")


def poles_table(results: StudyResults) -> TableBlock:
    """Poles beside Table 6.1."""
    printed = thesis_models() if results.table_models else {}
    rows: list[tuple[Text, ...]] = []
    for name in ("g1", "g2", "g3", "g4"):
        ours = _show_poles(results.models.fit(name).fit.model.poles)
        table = "".join(_show_poles(models.fit(name).fit.model.poles) for models in results.table_models)
        theirs = _show_poles(map(complex, printed.get(name, {}).get("poles", [])))
        rows.append((title(name), ours, *((table, theirs) if printed else ())))
    columns = [Column(heading="Model"), Column(heading="Poles, own response", unit="1/s")]
    if printed:
        columns += [Column(heading="Poles, fitted to Table 4.1", unit="1/s"), Column(heading="Poles as printed in 1995", unit="1/s")]
    return TableBlock(caption="Poles", columns=tuple(columns), rows=tuple(rows), id="6.1")


def _show_poles(poles: Iterable[complex]) -> str:
    """Poles in a row, a conjugate pair as one; none where there are none."""
    return ", ".join(_show_pole(pole) for pole in poles if _is_real(pole) or pole.imag > 0.0) or "not given"


def _is_real(pole: complex) -> bool:
    return abs(pole.imag) < 1e-9 * abs(pole)


def _show_pole(pole: complex) -> str:
    return format_number(pole.real) if _is_real(pole) else f"{format_number(pole.real)} ± {format_number(pole.imag)}j"


def controllers_section(material: Material) -> Section:
    """Gains and how they were found."""
    results = material.results
    gains = results.controllers.gains
    excess = gains["c2_zn"].kp / gains["c2_zn_with_gain"].kp
    tuned = tuple(_tuning(name, tuning) for name, tuning in results.controllers.tunings.items())
    return Section(
        title="Controllers, as designed on the models",
        anchor="controllers",
        blocks=(
            Paragraph(
                marked(
                    "The controllers move the throttle $u$ from its angle $u_0$ at the operating point by the speed's error $e$, its "
                    "integral, and the speed's rate:"
                )
            ),
            Equation(source="u = u_0 + k_p e + k_i integral e - k_d dot(omega)_e"),
            Paragraph(
                marked(
                    "C1, without the last term, places the poles of the loop around G1 at a natural frequency of "
                    f"{material.config.natural_frequency_rad_s:g} rad/s with a damping ratio of {material.config.damping_ratio:g}. C2 and "
                    "C2d start from Ziegler and Nichols' step-response rule, which reads a dead time $L$ and a rise time $T$ from the "
                    "tangent at the steepest point of the step response of G2 and G2d, [](#figure-5.3). The rule as it was published has "
                    "$k_p = 1.2 T slash (K L)$ with the plant's static gain $K$. Lee (1995) leaves out $K$ and had to tame the "
                    f"gains by hand: here that makes them {excess:.1f} times too high. Both forms are shown. Fine tuning then keeps the "
                    f"overshoot within {100 * material.config.overshoot_limit:g} %."
                )
            ),
            gains_table(material),
            tangents_table(material),
            Callout(kind=CalloutKind.FINDING, title="Fine tuning", blocks=(ItemList(items=tuned),)),
            Paragraph(
                marked(
                    "On the models that they were designed on, the loops answer a step of the command as in [](#figure-5.1), "
                    "[](#figure-5.4) and [](#figure-5.5). Their frequency responses from command to speed tell how fast they are, "
                    "[](#figure-5.2), [](#figure-5.6) and [](#figure-5.7)."
                )
            ),
            *figures(material, "5.3", ("5.1", "5.2"), ("5.4", "5.6"), ("5.5", "5.7")),
        ),
    )


def _tuning(name: str, tuning: FineTuning) -> str:
    """What fine tuning did; a start that was better than the result broke the limit on overshoot."""
    if not tuning.start_is_stable:
        start = "The loop is unstable with the gains that it started from"
    elif tuning.start_value < tuning.value:
        start = f"The gains that it started from gave {format_number(tuning.start_value)}, but overshot by more than the limit"
    else:
        start = f"The gains that it started from gave {format_number(tuning.start_value)}"
    return (
        f"{title(name)}: minimised was {tuning.objective}, over {listed(list(tuning.free))}, with an overshoot of at most "
        f"{100 * tuning.overshoot_limit:g} %. The least is {format_number(tuning.value)}, at an overshoot of "
        f"{100 * tuning.overshoot:.2f} %. {start}."
    )


def gains_table(material: Material) -> TableBlock:
    """Gains, beside the thesis's where the study is its."""
    gains, printed = material.results.controllers.gains, thesis_controllers() if material.config.asks_what_the_thesis_asked else {}
    columns = [Column(heading="Controller"), Column(heading="Designed on"), Column(heading="Rule")]
    units = ("deg/(rad/s)", "deg/rad", "deg s2/rad")
    columns += [_column(heading, unit, "ours") for heading, unit in zip(("kp", "ki", "kd"), units, strict=True)]
    columns += [_column(heading, unit, "Lee (1995)") for heading, unit in zip(("kp", "ki", "kd"), units, strict=True) if printed]
    rows = []
    for name, label in CONTROLLER_NAMES.items():
        row = [label, title(gains[name].designed_on), _rule(gains[name])]
        row += [format_number(value) if value else "0" for value in (gains[name].kp, gains[name].ki, gains[name].kd)]
        rows.append((*row, *(_printed_gains(printed.get(name)) if printed else ())))
    notes = ("A dash stands where Lee (1995) has no such controller; three of its integral gains are illegible in the scan.",)
    return TableBlock(caption="Gains", columns=tuple(columns), rows=tuple(rows), notes=notes if printed else ())


def _rule(gains: PidGains) -> str:
    """The rule's name in words."""
    words = gains.rule.replace("-", " ").replace("ziegler nichols", "Ziegler-Nichols")
    return words.replace("without gain", "without K")


def _printed_gains(entry: dict[str, Any] | None) -> tuple[str, ...]:
    if entry is None:
        return (NONE,) * 3
    return tuple(_given(entry[key]) if key in entry else ("illegible" if key == "ki" else "0") for key in ("kp", "ki", "kd"))


def thesis_controllers() -> dict[str, Any]:
    """Controllers of Lee (1995), chapter 5, by our names."""
    content = tomllib.loads(reference_text("controllers.toml"))
    return {ours: content[theirs] for ours, theirs in THESIS_CONTROLLERS}


def tangents_table(material: Material) -> TableBlock:
    """Dead time and rise time, beside those that the thesis read from its plots."""
    printed = thesis_controllers() if material.config.asks_what_the_thesis_asked else {}
    columns = [Column(heading="Model"), _column("L", "s", "ours"), _column("T", "s", "ours")]
    columns += [_column(name, "s", "Lee (1995)") for name in ("L", "T") if printed]
    rows = []
    for name, tangent in material.results.controllers.tangents.items():
        row = [title(name), format_number(tangent.dead_time), format_number(tangent.rise_time)]
        entry = printed.get({"g2": "c2_zn", "g2d": "c2d_zn"}[name], {})
        rows.append((*row, *(_given(entry[key]) for key in ("L_s", "T_s") if entry)))
    notes = ("Lee (1995) read them from a plot.",)
    return TableBlock(caption="Tangents to the step responses", columns=tuple(columns), rows=tuple(rows), notes=notes if printed else ())


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
