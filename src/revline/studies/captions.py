"""What each figure of the study shows, in a sentence made from the numbers. The numbering is that of Lee (1995)."""

import csv
import io
from collections.abc import Callable, Mapping
from types import MappingProxyType

from revline.design.closed_loop import LoopRun, describe_outcome
from revline.studies.config import reference_text
from revline.studies.results import title
from revline.studies.study_results import StudyResults

Caption = Callable[[StudyResults], str]

SPECTRUM_FIGURES = ("4.5", "4.6", "4.4", "4.7", "4.8", "4.9")
"""Figures of the spectra, by rising frequency."""


def figure_rows() -> tuple[dict[str, str], ...]:
    """Rows of the thesis's list of figures: id, title, axes and content."""
    return tuple(csv.DictReader(io.StringIO(reference_text("figures.csv"))))


def caption(figure: str, results: StudyResults) -> str:
    """Caption of a figure: its title and what to see in it."""
    name = next(row["title"] for row in figure_rows() if row["id"] == figure)
    if figure in SPECTRUM_FIGURES:
        name = f"Spectrum at {results.spectra[SPECTRUM_FIGURES.index(figure)].omega:g} rad/s"
    return f"{name}. {CAPTIONS[figure](results)}"


def _fixed(text: str) -> Caption:
    return lambda _: text


def _spectrum(figure: str) -> Caption:
    def write(results: StudyResults) -> str:
        check = results.spectra[SPECTRUM_FIGURES.index(figure)]
        spectrum = check.spectrum
        verb = "lies at the input's frequency" if check.follows else "does not lie at the input's frequency"
        return (
            f"The highest line, {spectrum.peak_amplitude:.4g} rad/s at {spectrum.peak_omega:.4g} rad/s, {verb} within the resolution of "
            f"{spectrum.resolution:.2g} rad/s; all harmonics together are {100 * check.distortion:.2g} % of it."
        )

    return write


def _model_errors(name: str) -> Caption:
    def write(results: StudyResults) -> str:
        fit = results.models.fit(name).fit
        return f"At most {fit.max_magnitude_error_db:.2f} dB and {fit.max_phase_error_deg:.1f} deg; positive where the model lies above."

    return write


def _model_bode(name: str) -> Caption:
    def write(results: StudyResults) -> str:
        verdict = results.models.verdicts[[named.name for named in results.models.fits].index(name)]
        return f"Points: the engine; line: {title(name)}. {verdict.text[:1].upper()}{verdict.text[1:]}."

    return write


def _loop(controller: str, plant: str, lead: str = "") -> Caption:
    def write(results: StudyResults) -> str:
        run: LoopRun = results.loops.row(controller, plant).run
        where = "the engine" if plant == "engine" else title(plant)
        text = f"With {lead or title(controller)} {where} {describe_outcome(run)}."
        if plant == "engine":
            text += f" The throttle is at a limit for {100 * run.saturated_share:.0f} % of the time."
        return text

    return write


def _closed_bode(controller: str, plant: str) -> Caption:
    def write(results: StudyResults) -> str:
        row = results.loops.row(controller, plant)
        return f"From the speed command to the speed; the bandwidth, where the magnitude falls to 1/sqrt(2), is {row.bandwidth:.2f} rad/s."

    return write


def _steady(results: StudyResults) -> str:
    unstable = [
        float(v) for v, trim in zip(results.range.steady_map.values, results.range.steady_map.trims, strict=True) if not trim.stable
    ]
    text = f"The engine runs from {results.range.steady_map.lowest:.2f} deg on."
    if unstable:
        text += f" Up to {max(unstable):g} deg it is unstable by itself: the delay in the fall of torque with speed makes it hunt."
    return text


def _line(results: StudyResults) -> str:
    line = results.range.line
    return f"{line.slope:.3f} rad/s per deg through {line.low:g} to {line.high:g} deg."


def _line_error(results: StudyResults) -> str:
    line = results.range.line
    return f"At most {line.max_error:.2f} rad/s, at {line.max_error_at:g} deg, {100 * line.max_error_fraction:.2f} % of the line's span."


def _delay(results: StudyResults) -> str:
    line = results.models.fit("g2d").fit.phase_line
    return f"Minus the slope of the straight line is the delay of G2d: {1e3 * line.delay:.2f} ms."


def _tangents(results: StudyResults) -> str:
    parts = [f"{title(name)}: L = {t.dead_time:.4f} s, T = {t.rise_time:.3f} s" for name, t in results.controllers.tangents.items()]
    return "The tangent at the inflection meets zero after L and rises to the final value within T. " + "; ".join(parts) + "."


def _steps(results: StudyResults) -> str:
    first, last = results.steps.free[-1].speed[0], results.steps.free[-1].speed[-1]
    size = results.steps.sizes[-1]
    return f"After a step of {size:g} deg the speed goes from {first:.1f} to {last:.1f} rad/s; it first waits for the delay."


def _sine_errors(position: int) -> Caption:
    def write(results: StudyResults) -> str:
        record = results.errors.records[position]
        parts = [f"{title(name)} {record.swing(name):.2f}" for name in record.models]
        shares = ", ".join(parts)
        return f"Half of the error's range, once settled, in rad/s: {shares}. The engine's mean speed rises; no linear model's does."

    return write


def _step_errors(results: StudyResults) -> str:
    record = results.errors.records[0]
    return "Largest errors in rad/s: " + ", ".join(f"{title(name)} {record.largest(name):.2f}" for name in record.models) + "."


CAPTIONS: Mapping[str, Caption] = MappingProxyType(
    {
        "3.2": _fixed("Air flow is choked at low pressure and none at ambient pressure."),
        "3.3": _fixed("The throttle's opening over its angle; it opens no further beyond about 80 deg."),
        "3.4": _fixed("Torque is highest at a ratio of 13.5."),
        "3.5": _fixed("Torque is highest at the spark advance of best torque (MBT)."),
        "3.7": _fixed("The inputs of the two experiments that follow."),
        "3.8": lambda r: f"The manifold fills at once; the speed is held at {r.steps.held_speed:g} rad/s.",
        "3.9": _steps,
        "4.1": _steady,
        "4.2a": _line,
        "4.2b": _line_error,
        "4.3a": _fixed("The input of the spectral check."),
        "4.3b": _fixed("The answer to it, once settled: a sinusoid of the same frequency to the eye."),
        "4.4": _spectrum("4.4"),
        "4.5": _spectrum("4.5"),
        "4.6": _spectrum("4.6"),
        "4.7": _spectrum("4.7"),
        "4.8": _spectrum("4.8"),
        "4.9": _spectrum("4.9"),
        "4.10": _fixed("Magnitude in rad/s per deg of throttle. The phase passes -180 deg: a delay is at work."),
        "4.11a": _model_bode("g1"),
        "4.11b": _model_errors("g1"),
        "4.12a": _model_bode("g2"),
        "4.12b": _model_errors("g2"),
        "4.13": _delay,
        "4.14a": _model_bode("g2d"),
        "4.14b": _model_errors("g2d"),
        "5.1": _loop("c1", "g1"),
        "5.2": _closed_bode("c1", "g1"),
        "5.3": _tangents,
        "5.4": _loop("c2", "g2"),
        "5.5": _loop("c2d", "g2d"),
        "5.6": _closed_bode("c2", "g2"),
        "5.7": _closed_bode("c2d", "g2d"),
        "5.9": _loop("c1", "engine"),
        "5.10": _loop("c2", "engine"),
        "5.11": _loop("c2d", "engine"),
        "5.12": _loop("c1", "g2d"),
        "5.13": _loop("c2", "g2d"),
        "5.14": _loop("c2d_reduced", "g2", "a tenth of C2d's proportional gain"),
        "5.15": _loop("c2d_reduced", "engine", "a tenth of C2d's proportional gain"),
        "6.1": _fixed("The fast poles of G3 and G4 do no more than a delay would."),
        "6.2": _step_errors,
        "6.3": _fixed("The answer that the models are compared with."),
        "6.4": _sine_errors(1),
        "6.5": _sine_errors(2),
    }
)
"""By figure."""
