"""The study's report as a document: what was asked, what came out, and what it means, for an engineer who has not read the thesis."""

from collections.abc import Callable, Iterator, Sequence

from revline import __version__
from revline.report.blocks import (
    Align,
    Callout,
    CalloutKind,
    Check,
    CheckTable,
    Column,
    DefinitionList,
    ItemList,
    Paragraph,
    TableBlock,
)
from revline.report.document import Card, Document, Section
from revline.report.inline import Text, marked
from revline.report.numbers import format_number
from revline.studies import content_loops, content_models
from revline.studies.config import StudyConfig
from revline.studies.content_design import design_section
from revline.studies.content_engine import engine_section
from revline.studies.content_hunting import hunting_section, range_blocks
from revline.studies.content_stability import stability_section
from revline.studies.material import Material, figures
from revline.studies.results import NoRange, RangeResult
from revline.studies.routes import FIGURE as ROUTE_FIGURE
from revline.studies.routes import route_words
from revline.studies.words import listed, outcome_text, typographic
from revline.units import RPM

TITLE = "From throttle to speed: linear models of an engine and what they promise"
SOURCE = (
    "K. Lee, Automotive Engine Model Linearization, MSc thesis, University of Southern California, 1995, doi 10.25549/usctheses-c16-662"
)


def make_document(material: Material) -> Document:
    """Make the report's document of a study's material."""
    config = material.config
    sections: tuple[Callable[[Material], Section], ...] = (
        engine_section,
        _simulation,
        _steady,
        _linearity,
        _response,
        content_models.models_section,
        content_models.controllers_section,
        content_loops.loops_section,
        stability_section,
        hunting_section,
        design_section,
        content_loops.errors_section,
        _guidelines,
        _checks,
    )
    return Document(
        title=TITLE,
        subtitle=_subtitle(config),
        abstract=_abstract(material),
        cards=_cards(material),
        sections=tuple(make(material) for make in sections),
        warnings=tuple(typographic(warning) for warning in material.warnings),
        provenance=tuple(_provenance(material)),
    )


def make_partial_document(config: StudyConfig, finished: Sequence[str]) -> Document:
    """Make the document of a study that is not finished: it says so, and what is kept."""
    done = f"Finished and kept: {', '.join(finished)}." if finished else "No step is finished."
    return Document(
        title=TITLE,
        subtitle=_subtitle(config),
        partial=f"This study is not finished. {done} Run the same command again and it goes on from there.",
        provenance=(("made by", f"revline {__version__}"), ("engine", config.engine_title), ("source", SOURCE)),
    )


def _subtitle(config: StudyConfig) -> str:
    whose = "The study of Lee (1995), recomputed" if config.asks_what_the_thesis_asked else "A study after Lee (1995)"
    load = f", load {config.load_n_m:g} N m" if config.load_n_m else ""
    return f"{whose}: {config.engine_title} at {config.throttle_deg:g} ± {config.amplitude_deg:g} deg of throttle{load}"


def _provenance(material: Material) -> Iterator[tuple[str, str]]:
    config, made, stream = material.config, material.made, material.results.response
    yield "results by", f"revline {made.version}, code {made.code[:12]}"
    if made.version != __version__:
        yield "report by", f"revline {__version__}"
    yield "with", ", ".join(f"{name} {version}" for name, version in made.software)
    yield "made on", made.on
    yield "questions", f"engine and questions of fingerprint {made.questions[:12]}"
    yield "numbers in", f"{made.seconds_of_numbers:.1f} s of wall time, less where finished steps were at hand"
    yield "engine", config.engine_title
    yield "operating point", f"throttle {config.throttle_deg:g} deg, load {config.load_n_m:g} N m"
    yield "sinusoids", f"simulated in steps of {1e3 * stream.step.min():.3g} to {1e3 * stream.step.max():.3g} ms"
    yield "source", SOURCE
    yield "results", "results.json and tables/ beside this report; each CSV names its units"


def _abstract(material: Material) -> tuple[Text, ...]:
    results = material.results
    c2d = results.loops.row("c2d", "engine").run
    delay = 1e3 * results.models.fit("g2d").fit.model.delay
    problem = (
        "An engine answers its throttle late: air must fill the manifold, and the charge burns a fixed crank angle after it was drawn in. "
        "Speed controllers are designed on linear models, which may or may not know that delay. This report fits such models to a "
        "nonlinear engine, designs controllers on them, and runs these controllers on the engine itself, where their promises are tested."
    )
    fooled = content_loops.fooled_controllers(results)
    if fooled:
        runs = [f"{name} {outcome_text(results.loops.row(name.lower(), 'engine').run)}" for name in fooled]
        verbs = ("settles on a model", "does") if len(fooled) == 1 else ("settle on models", "do")
        start = f"{listed(fooled)}, which {verbs[0]} without delay, {verbs[1]} not on the engine: {'; '.join(runs)}."
    else:
        start = "The controllers designed on models without delay settle on the engine too."
    foresees = all(results.loops.row(name, "g2d").run.is_stable == results.loops.row(name, "engine").run.is_stable for name in ("c1", "c2"))
    told = "tells beforehand which of them settle" if foresees else "does not tell beforehand which of them settle"
    end = f"G2d, the model with a delay of {delay:.1f} ms, {told}. C2d, designed on it, on the engine {outcome_text(c2d)}."
    return problem, f"{start} {end}"


def _cards(material: Material) -> tuple[Card, ...]:
    results = material.results
    trim, failed = results.point.trim, sum(not check.passed for check in material.checks)
    speed = trim.output("engine_speed")
    fitted = 1e3 * results.models.fit("g2d").fit.model.delay
    verdict = results.linearity
    count = len(material.checks)
    return (
        Card(label="Speed at the operating point", value=f"{speed:.2f}", unit="rad/s", note=f"{speed / RPM:.0f} rpm"),
        Card(label="Static gain", value=f"{results.point.gain:.3f}", unit="rad/s per deg", note="throttle to speed, at rest"),
        Card(label="Transport delay", value=f"{1e3 * trim.lag('charge'):.1f}", unit="ms", note="intake to torque, at this speed"),
        Card(label="Delay of the fitted model", value=f"{fitted:.1f}", unit="ms", note="G2d, from the phase line"),
        Card(label="Largest distortion", value=f"{100 * verdict.largest_distortion:.1f}", unit="%", note=f"at {verdict.where:g} rad/s"),
        Card(label="Checks", value=f"{count - failed} of {count}", note=f"{failed} fail" if failed else "hold"),
    )


def _simulation(material: Material) -> Section:
    return Section(
        title="Simulation",
        anchor="simulation",
        blocks=(
            Paragraph(
                "The equations are integrated by a fourth-order Runge-Kutta method that keeps the history of what entered each delay and "
                "reads it by cubics that span no jump. The lag is taken from the present speed at each stage; every corner of the input "
                "is met by the mesh, and met again when it arrives through a delay, so that the order of four holds throughout."
            ),
            Paragraph(
                marked(
                    "Two experiments show the two kinds of lateness. The throttle steps of [](#figure-3.7) move the pressure in "
                    "the manifold within a fraction of a second, [](#figure-3.8); the speed starts only when the changed charge burns, and "
                    "then follows as the inertia lets it, [](#figure-3.9)."
                )
            ),
            *figures(material, ("3.7", "3.8"), "3.9"),
        ),
    )


def _steady(material: Material) -> Section:
    result = material.results.range
    widest = result.widest
    if isinstance(widest, NoRange):
        allowed = "no range about the operating point would be straight enough."
    else:
        allowed = f"the range about the operating point could be {widest.line.low:.1f} to {widest.line.high:.1f} deg."
    return Section(
        title="Steady states and operating range",
        anchor="steady",
        blocks=(
            Paragraph(
                marked(
                    "A linear model can stand for the engine only where speed follows throttle in a straight line. [](#figure-4.1) shows "
                    "all states of rest: at each throttle angle the speed at which torque, friction and load are in balance. "
                    f"{_straightness(result)} "
                    f"Were an error of {100 * widest.tolerance:g} % of the span allowed, {allowed}"
                )
            ),
            *_steady_table(material),
            *figures(material, "4.1", ("4.2a", "4.2b")),
        ),
    )


def _straightness(result: RangeResult) -> str:
    line = result.line
    verdict = "nearly straight" if line.max_error_fraction <= result.widest.tolerance else "not straight"
    return (
        f"Over the range studied, {line.low:g} to {line.high:g} deg, the map is {verdict}: a line of slope {line.slope:.3f} rad/s per deg "
        f"errs by {line.max_error:.2f} rad/s at most, {100 * line.max_error_fraction:.2g} % of its span, [](#figure-4.2b)."
    )


def _steady_table(material: Material) -> Iterator[TableBlock]:
    """States of rest at every fifth degree or so, few enough to read."""
    steady = material.results.range.steady_map
    chosen = [
        (angle, trim)
        for angle, trim in zip(steady.values, steady.trims, strict=True)
        if angle % 10.0 == 0.0 or angle == material.config.throttle_deg
    ]
    rows = tuple(
        (
            f"{angle:g}",
            f"{trim.output('engine_speed'):.3f}",
            f"{trim.output('engine_speed') / RPM:.0f}",
            f"{trim.state('manifold_pressure'):.3f}",
            f"{1e3 * trim.lag('charge'):.1f}",
            "yes" if trim.stable else "no",
        )
        for angle, trim in chosen
    )
    columns = (
        Column(heading="Throttle", unit="deg", align=Align.RIGHT),
        Column(heading="Speed", unit="rad/s", align=Align.RIGHT),
        Column(heading="Speed", unit="rpm", align=Align.RIGHT),
        Column(heading="Pressure", unit="kPa", align=Align.RIGHT),
        Column(heading="Delay, intake to torque", unit="ms", align=Align.RIGHT),
        Column(heading="Stable without control"),
    )
    if rows:
        yield TableBlock(caption="States of rest", columns=columns, rows=rows)


def _linearity(material: Material) -> Section:
    results = material.results
    rows = tuple(
        (
            f"{check.omega:g}",
            f"{check.spectrum.peak_omega:.5g}",
            format_number(check.spectrum.resolution, 2),
            format_number(check.spectrum.peak_amplitude, 4),
            format_number(check.spectrum.zero_line, 2),
            f"{100 * check.distortion:.2f}",
            "yes" if check.follows else "no",
        )
        for check in results.spectra
    )
    columns = (
        Column(heading="Input", unit="rad/s", align=Align.RIGHT),
        Column(heading="Highest line but for zero", unit="rad/s", align=Align.RIGHT),
        Column(heading="Resolution", unit="rad/s", align=Align.RIGHT),
        Column(heading="Its amplitude", unit="rad/s", align=Align.RIGHT),
        Column(heading="Line at zero", unit="rad/s", align=Align.RIGHT),
        Column(heading="Distortion", unit="%", align=Align.RIGHT),
        Column(heading="Follows"),
    )
    return Section(
        title="Is it linear enough?",
        anchor="linearity",
        blocks=(
            Paragraph(
                "A linear system answers a sinusoid with a sinusoid of the same frequency and no other. So sinusoids are put on the "
                "throttle, and the speed's spectrum shows what else comes out: harmonics at multiples of the input's frequency, whose "
                "root of summed squares over the fundamental is the distortion, and a line at zero, by which the mean speed has moved; "
                "that one is no peak."
            ),
            Paragraph(_spectra_words(material)),
            Callout(kind=CalloutKind.FINDING, title=typographic(f"The speed {results.linearity.text}")),
            TableBlock(caption="Spectral check", columns=columns, rows=rows),
            *figures(material, ("4.3a", "4.3b"), ("4.4", "4.5"), ("4.6", "4.7"), ("4.8", "4.9")),
        ),
    )


def _spectra_words(material: Material) -> str:
    periods = sorted({check.cycles for check in material.results.spectra})
    samples = min(check.samples_per_cycle for check in material.results.spectra)
    return (
        f"The spectra are those of the speed less its initial value over {listed([f'{count:g}' for count in periods])} periods after the "
        f"transient, with at least {samples:g} samples per period, without window, zero-padded to the next power of two and scaled by the "
        "length of the record before padding, doubled except at zero."
    )


def _response(material: Material) -> Section:
    return Section(
        title="Frequency response",
        anchor="response",
        blocks=(
            Paragraph(
                marked(
                    f"How much of a throttle sinusoid of {material.config.amplitude_deg:g} deg arrives at the speed, and how late, tells "
                    "all that a linear model must know. Each frequency is simulated until its answer repeats itself, and read twice: by "
                    "Fourier correlation over whole periods, which gives the fundamental, and by peaks as Lee (1995) did it (half of "
                    "maximum minus minimum; phase from the times of matching peaks). Beside them stands the exact small-signal response, "
                    "from derivatives of the equations with the delays kept: the difference is the effect of the amplitude. "
                    "[](#figure-4.10) draws what [](#table-4.1) lists."
                )
            ),
            *figures(material, "4.10"),
            content_models.response_table(material.config, material.results),
            Paragraph(marked(typographic(route_words(material.results.routes)))),
            *figures(material, ROUTE_FIGURE),
            *range_blocks(material),
        ),
    )


def _guidelines(material: Material) -> Section:
    return Section(
        title="Guidelines",
        anchor="guidelines",
        blocks=(
            Paragraph("What a designer of speed controllers for this engine may take along; each point holds the numbers it rests on."),
            Callout(
                kind=CalloutKind.GUIDELINE,
                title="What the numbers say",
                blocks=(ItemList(items=tuple(typographic(text) for text in material.results.guidelines)),),
            ),
        ),
    )


def _checks(material: Material) -> Section:
    table = tuple(Check(name=c.name, measured=c.measured, expected=c.expected, tolerance=c.tolerance, unit=c.unit) for c in material.checks)
    return Section(
        title="Checks",
        anchor="checks",
        blocks=(
            Paragraph(
                "Each line sets a number of this study beside one that was expected: from the thesis, from converged computations by other "
                "means, or from another part of the study."
            ),
            CheckTable(checks=table),
        ),
        sections=(Section(title="How the numbers were made", anchor="making", blocks=(DefinitionList(items=(*_methods(material),)),)),),
    )


def _methods(material: Material) -> Iterator[tuple[Text, Text]]:
    residual, stream = material.results.point.trim.residual, material.results.response
    simulation = (
        "Runge-Kutta of order 4 in steps of 1 ms; sinusoids in whole parts of their period, halved until the error is small: "
        f"{format_number(float(stream.step_error.max()), 2)} of the amplitude at most. A sinusoid is read when its waveform "
        f"would change by no more than {format_number(float(stream.remaining.max()), 2)} of the amplitude."
    )
    yield "Simulation", simulation
    yield "Steady states", f"Newton with exact derivatives; residual {format_number(residual, 2)} of the search range per second."
    yield "Fits", "Sum of squared complex errors over all frequencies, unit weights (output error)."
    yield "Closed loops", "Derivative on the speed only, integral from 0, true step, no anti-windup, throttle limited on the engine only."
