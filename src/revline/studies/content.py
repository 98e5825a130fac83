"""The study's report as a document: what was asked, what came out, and what it means, for an engineer who has not read the thesis."""

from collections.abc import Callable, Iterator

from revline import __version__
from revline.design.closed_loop import describe_outcome
from revline.engine.lee1995 import lee1995_parameters
from revline.report.blocks import (
    Align,
    Callout,
    CalloutKind,
    Check,
    CheckTable,
    Column,
    DefinitionList,
    Equation,
    ItemList,
    Paragraph,
    TableBlock,
)
from revline.report.document import Card, Document, Section
from revline.report.inline import Text, marked
from revline.report.numbers import format_number
from revline.studies import content_models
from revline.studies.material import Material, figures
from revline.studies.results import NoRange
from revline.units import RPM


def make_document(material: Material) -> Document:
    """Make the report's document of a study's material."""
    config = material.config
    whose = "The study of Lee (1995), recomputed" if config.is_the_thesis else "A study after Lee (1995)"
    sections: tuple[Callable[[Material], Section], ...] = (
        _engine,
        _simulation,
        _steady,
        _linearity,
        _response,
        content_models.models_section,
        content_models.controllers_section,
        content_models.loops_section,
        content_models.errors_section,
        _guidelines,
        _checks,
    )
    return Document(
        title="From throttle to speed: linear models of an engine and what they promise",
        subtitle=f"{whose}: {config.engine} at {config.throttle_deg:g} deg with {config.amplitude_deg:g} deg amplitude",
        abstract=_abstract(material),
        cards=_cards(material),
        sections=tuple(make(material) for make in sections),
        warnings=material.warnings,
        provenance=(
            ("made by", f"revline {__version__}"),
            ("made on", material.made_on),
            ("engine", config.engine),
            ("computed in", _duration(material)),
            ("operating point", f"throttle {config.throttle_deg:g} deg, load {config.load_n_m:g} N m"),
            ("source", "K. Lee, Automotive Engine Model Linearization, MSc thesis, University of Southern California, 1995"),
            ("results", "results.json and tables/ beside this report; each CSV names its units"),
        ),
    )


def _duration(material: Material) -> str:
    earlier = f", {material.kept} steps kept from an earlier run" if material.kept else ""
    return f"{material.seconds:.1f} s{earlier}"


def _abstract(material: Material) -> tuple[str, ...]:
    results = material.results
    c1, c2, c2d = (results.loops.row(name, "engine").run for name in ("c1", "c2", "c2d"))
    delay = 1e3 * results.models.fit("g2d").fit.model.delay
    problem = (
        "An engine answers its throttle late: air must fill the manifold, and the charge burns a fixed crank angle after it was drawn in. "
        "Controllers are designed on linear models. This report fits such models to the nonlinear engine, designs speed controllers on "
        "them, and runs these controllers on the engine itself."
    )
    lesson = (
        f"The models without delay allow any gain. The controllers designed on them hunt on the engine: C1 {describe_outcome(c1)}; "
        f"C2 {describe_outcome(c2)}. The model with a delay of {delay:.1f} ms foresees that; C2d, designed on it, {describe_outcome(c2d)}."
    )
    return problem, lesson


def _cards(material: Material) -> tuple[Card, ...]:
    results = material.results
    trim, failed = results.point.trim, sum(not check.passed for check in material.checks)
    speed = trim.output("engine_speed")
    fitted = 1e3 * results.models.fit("g2d").fit.model.delay
    verdict = results.linearity
    count = len(material.checks)
    return (
        Card(label="Speed at the operating point", value=f"{speed:.2f}", unit="rad/s", note=f"{speed / RPM:.0f} rpm"),
        Card(label="Static gain", value=f"{results.point.gain:.3f}", unit="rad/s per deg", note="throttle to speed, exact"),
        Card(label="Transport delay", value=f"{1e3 * trim.lag('charge'):.1f}", unit="ms", note="intake to torque, at this speed"),
        Card(label="Delay of the fitted model", value=f"{fitted:.1f}", unit="ms", note="G2d, from the phase line"),
        Card(label="Largest distortion", value=f"{100 * verdict.largest_distortion:.1f}", unit="%", note=f"at {verdict.where:g} rad/s"),
        Card(label="Checks", value=f"{count - failed} of {count}", note=f"{failed} fail" if failed else "hold"),
    )


def _engine(material: Material) -> Section:
    intake, spark = lee1995_parameters(material.config.load_engine()).delays

    def lag(angle: float) -> str:
        return f"(t - {angle:.2f}/(omega_e))"

    return Section(
        title="The engine",
        anchor="engine",
        blocks=(
            Paragraph(
                "Two states, manifold pressure and engine speed, and two delays. Air flows through the throttle into the "
                "manifold and on into "
                "the cylinders; what they draw becomes torque a crank angle later, so that the delay in time goes with one over the speed."
            ),
            Equation(source='dot(m)_"ai" = "MAX" cdot "PRI" cdot "TC"', id="2.1"),
            Equation(source='dot(P)_m = (R T_m)/(V_m) (dot(m)_"ai" - dot(m)_"ao")', id="2.8"),
            Equation(source=f'T_i (t) = C_T cdot [(dot(m)_"ao" "AFI")/(omega_e)]{lag(intake)} cdot "SI"{lag(spark)}', id="2.15"),
            Equation(source="J_e dot(omega)_e = T_i - T_f - T_L", id="2.17"),
            Paragraph("The four influences below are the engine's static nonlinearities."),
            *figures(material, "3.2", "3.3", "3.4", "3.5"),
        ),
    )


def _simulation(material: Material) -> Section:
    return Section(
        title="Simulation",
        anchor="simulation",
        blocks=(
            Paragraph(
                "A fourth-order Runge-Kutta method with a history of what entered each delay, read by cubics that span no jump. The lag is "
                "taken from the present speed at each stage; every corner of the input is met by the mesh, and met again when it arrives "
                "through a delay, so that the order of four holds throughout."
            ),
            *figures(material, "3.7", "3.8", "3.9"),
        ),
    )


def _steady(material: Material) -> Section:
    result = material.results.range
    widest = result.widest
    allowed = f"If an error of {100 * widest.tolerance:g} % of the span is allowed, "
    if isinstance(widest, NoRange):
        allowed += "no range about the operating point is straight enough."
    else:
        allowed += f"the range may be {widest.line.low:.1f} to {widest.line.high:.1f} deg."
    return Section(
        title="Steady states and operating range",
        anchor="steady",
        blocks=(
            Paragraph(
                f"The steady map is nearly straight about the operating point: over {result.line.low:g} to {result.line.high:g} deg a line "
                f"of slope {result.line.slope:.3f} rad/s per deg errs by {result.line.max_error:.2f} rad/s at most. {allowed}"
            ),
            *figures(material, "4.1", "4.2a", "4.2b"),
        ),
    )


def _linearity(material: Material) -> Section:
    results = material.results
    rows = tuple(
        (
            f"{check.omega:g}",
            f"{check.spectrum.peak_omega:.5g}",
            format_number(check.spectrum.resolution, 2),
            format_number(check.spectrum.peak_amplitude, 4),
            f"{100 * check.distortion:.2f}",
            "yes" if check.follows else "no",
        )
        for check in results.spectra
    )
    columns = (
        Column(heading="Input", unit="rad/s", align=Align.RIGHT),
        Column(heading="Highest line", unit="rad/s", align=Align.RIGHT),
        Column(heading="Resolution", unit="rad/s", align=Align.RIGHT),
        Column(heading="Its amplitude", unit="rad/s", align=Align.RIGHT),
        Column(heading="Distortion", unit="%", align=Align.RIGHT),
        Column(heading="Follows"),
    )
    return Section(
        title="Is it linear enough?",
        anchor="linearity",
        blocks=(
            Paragraph(
                "A linear system answers a sinusoid with a sinusoid of the same frequency. The spectra are those of the speed less its "
                "initial value over eight periods after the transient, without window, zero-padded to the next power of two and scaled by "
                "the length of the record before padding. The line at zero frequency shows that the mean speed moves; it is no peak."
            ),
            Callout(kind=CalloutKind.FINDING, title=f"The speed {results.linearity.text}"),
            TableBlock(caption="Spectral check", columns=columns, rows=rows),
            *figures(material, "4.3a", "4.3b", "4.4", "4.5", "4.6", "4.7", "4.8", "4.9"),
        ),
    )


def _response(material: Material) -> Section:
    return Section(
        title="Frequency response",
        anchor="response",
        blocks=(
            Paragraph(
                "Each frequency is simulated until its answer repeats itself, and read twice: by Fourier correlation over "
                "whole periods, and "
                "by peaks as the thesis did (half of maximum minus minimum; phase from the times of matching peaks). The "
                "exact small-signal "
                "response, from derivatives of the equations with the delays kept, stands beside: the difference is the amplitude's effect."
            ),
            *figures(material, "4.10"),
            content_models.response_table(material.config, material.results),
        ),
    )


def _guidelines(material: Material) -> Section:
    return Section(
        title="Guidelines",
        anchor="guidelines",
        blocks=(Callout(kind=CalloutKind.GUIDELINE, title="What the numbers say", blocks=(ItemList(items=material.results.guidelines),)),),
    )


def _checks(material: Material) -> Section:
    table = tuple(Check(name=c.name, measured=c.measured, expected=c.expected, tolerance=c.tolerance, unit=c.unit) for c in material.checks)
    return Section(
        title="Checks, and how this was made",
        anchor="checks",
        blocks=(
            Paragraph(
                "Each line sets a number of this study beside one that was expected: from the thesis, from converged computations by other "
                "means, or from another part of the study."
            ),
            CheckTable(checks=table),
            DefinitionList(items=(*_methods(material),)),
        ),
    )


def _methods(material: Material) -> Iterator[tuple[Text, Text]]:
    residual = material.results.point.trim.residual
    yield (
        "Simulation",
        "Runge-Kutta of order 4 in steps of 1 ms; sinusoids in whole parts of their period, halved until the error is small.",
    )
    yield "Steady states", f"Newton with exact derivatives; residual {residual:.1e} of the search range per second."
    yield "Fits", "Sum of squared complex errors over all frequencies, unit weights (output error)."
    law = marked("$u = u_0 + k_p e + k_i integral e - k_d dot(omega)$; true step, no anti-windup, throttle limited on the engine only.")
    yield "Closed loops", law
