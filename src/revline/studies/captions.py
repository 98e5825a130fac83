"""What each figure of the study shows, in a sentence made from the numbers. The numbering is that of Lee (1995)."""

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import numpy as np

from revline.design.loops.closed_loop import LoopRun
from revline.report.numbers import MINUS
from revline.studies.config import reference_text
from revline.studies.own_figures import OWN_CAPTIONS, OWN_ROWS, is_drawn
from revline.studies.results import TimeRecord, title
from revline.studies.routes import FIGURE as ROUTE_FIGURE
from revline.studies.routes import ROUTE_ROW, route_caption
from revline.studies.study_results import StudyResults
from revline.studies.words import limit_text, listed, outcome_text, plant_name, relative_outcome, typographic

Caption = Callable[[StudyResults], str]

SPECTRUM_FIGURES = ("4.5", "4.6", "4.4", "4.7", "4.8", "4.9")
"""Figures of the spectra, by rising frequency."""


def figure_rows() -> tuple[dict[str, str], ...]:
    """Rows of the thesis's list of figures, then of the study's own: id, title and axes."""
    return (*csv.DictReader(io.StringIO(reference_text("figures.csv"))), *(dict(row) for row in (ROUTE_ROW, *OWN_ROWS)))


def figure_ids(results: StudyResults) -> tuple[str, ...]:
    """Numbers of all figures that a study has: not every controller hunts."""
    return tuple(row["id"] for row in figure_rows() if is_drawn(row["id"], results))


def caption(figure: str, results: StudyResults) -> str:
    """Caption of a figure: its title and what to see in it."""
    return typographic(f"{figure_title(figure, results)}. {CAPTIONS[figure](results)}")


def figure_title(figure: str, results: StudyResults) -> str:
    """Title of a figure as in the thesis, with this study's numbers in it."""
    if figure in SPECTRUM_FIGURES:
        return f"Spectrum at {results.spectra[SPECTRUM_FIGURES.index(figure)].omega:g} rad/s"
    if figure == "6.1":
        return "Poles of G2, G3 and G4"
    if figure == "6.2":
        return f"Speed errors of {_model_names(results)} after a {results.response.excitation.amplitude:g} deg step"
    return next(row["title"] for row in figure_rows() if row["id"] == figure)


def figure_description(figure: str, results: StudyResults) -> str:
    """What is drawn, for those who cannot see it: the title and the axes; the caption says what is to be seen."""
    row = next(row for row in figure_rows() if row["id"] == figure)
    return f"{figure_title(figure, results)}: {row['y']} over {row['x']}"


def _model_names(results: StudyResults) -> str:
    return listed([title(name) for name in results.errors.records[0].models])


def _fixed(text: str) -> Caption:
    return lambda _: text


def _spectrum(figure: str) -> Caption:
    def write(results: StudyResults) -> str:
        check = results.spectra[SPECTRUM_FIGURES.index(figure)]
        spectrum = check.spectrum
        where = "at" if check.follows else "not at"
        return (
            f"But for the mean, the highest line is {where} the input's frequency within the resolution of "
            f"{spectrum.resolution:.2g} rad/s; all harmonics together are {100 * check.distortion:.2g} % of the fundamental."
        )

    return write


def _model_errors(name: str) -> Caption:
    def write(results: StudyResults) -> str:
        fit = results.models.fit(name).fit
        return (
            f"Model less engine: at most {fit.max_magnitude_error_db:.2f} dB and {fit.max_phase_error_deg:.1f} deg, without sign; "
            "positive where the model lies above."
        )

    return write


def _model_bode(name: str) -> Caption:
    def write(results: StudyResults) -> str:
        verdict = results.models.verdicts[[named.name for named in results.models.fits].index(name)]
        usable = verdict.numbers["usable_to_rad_s"]
        inside = f"It is inside both error limits up to {usable:g} rad/s." if usable > 0.0 else "It is nowhere inside both error limits."
        return f"Points: the engine; line: {title(name)}, {'accepted' if verdict.accepted else 'rejected'}. {inside}"

    return write


def _loop(controller: str, plant: str, lead: str = "") -> Caption:
    def write(results: StudyResults) -> str:
        run: LoopRun = results.loops.row(controller, plant).run
        outcome = f"{outcome_text(run)}. {limit_text(run)}" if plant == "engine" else f"{relative_outcome(run)}."
        return f"With {lead or title(controller)}, {plant_name(plant)} {outcome}"

    return write


def _closed_bode(controller: str, plant: str) -> Caption:
    def write(results: StudyResults) -> str:
        row = results.loops.row(controller, plant)
        if row.bandwidth <= 0.0:
            return "From the speed command to the speed; the loop is unstable and has no bandwidth."
        return f"From the speed command to the speed; the bandwidth, where the magnitude falls to 1/√2, is {row.bandwidth:.2f} rad/s."

    return write


def _steady(results: StudyResults) -> str:
    unstable = [
        float(v) for v, trim in zip(results.range.steady_map.values, results.range.steady_map.trims, strict=True) if not trim.stable
    ]
    text = f"The engine runs from {results.range.steady_map.lowest:.2f} deg on."
    if unstable:
        text += f" Up to {max(unstable):g} deg its rest is unstable without control: as speed rises torque falls, but a delay later."
    return text


def _line(results: StudyResults) -> str:
    line = results.range.line
    return f"Points: the engine at rest; line: {line.slope:.3f} rad/s per deg, fitted over {line.low:g} to {line.high:g} deg."


def _line_error(results: StudyResults) -> str:
    line = results.range.line
    share = f"{100 * line.max_error_fraction:.2f} % of the line's span"
    return f"Straight line less speed at rest: at most {line.max_error:.2f} rad/s without sign, at {line.max_error_at:g} deg, {share}."


def _delay(results: StudyResults) -> str:
    line = results.models.fit("g2d").fit.phase_line
    return f"Minus the slope of the straight line is the delay of G2d: {1e3 * line.delay:.2f} ms."


def _tangents(results: StudyResults) -> str:
    parts = [f"{title(name)}: L = {t.dead_time:.4f} s, T = {t.rise_time:.3f} s" for name, t in results.controllers.tangents.items()]
    return (
        "Answers to a throttle step of 1 deg. The tangent at the inflection meets zero after L and rises to the final value within T. "
        + "; ".join(parts)
        + "."
    )


def _steps(results: StudyResults) -> str:
    first, last = results.steps.free[-1].speed[0], results.steps.free[-1].speed[-1]
    size, lag = results.steps.sizes[-1], 1e3 * results.point.trim.lag("charge")
    return (
        f"After a step of {size:g} deg the speed goes from {first:.1f} to {last:.1f} rad/s in the time shown. Nothing moves before "
        f"the first changed charge burns, {lag:.1f} ms after the step."
    )


def _sine_errors(position: int) -> Caption:
    def write(results: StudyResults) -> str:
        record = results.errors.records[position]
        parts = [f"{title(name)} {record.swing(name):.2f}" for name in record.models]
        shares = ", ".join(parts)
        return f"Model less engine. Half of the range, once settled, in rad/s: {shares}. The engine's mean speed moves, no model's does."

    return write


def _step_errors(results: StudyResults) -> str:
    record = results.errors.records[0]
    return (
        "Model less engine; largest errors in rad/s: "
        + ", ".join(f"{title(name)} {record.largest(name):.2f}" for name in record.models)
        + "."
    )


def _held(results: StudyResults) -> str:
    ends = listed([f"{record.pressure[-1]:.1f} kPa after {size:g} deg" for size, record in _held_steps(results)])
    return f"With the speed held at {results.steps.held_speed:.4g} rad/s the manifold answers without waiting for any delay: to {ends}."


def _held_steps(results: StudyResults) -> Iterator[tuple[float, TimeRecord]]:
    return zip(results.steps.sizes, results.steps.held, strict=True)


def _sizes(results: StudyResults) -> str:
    base = results.point.trim.input("throttle")
    sizes = listed([f"{size:g}" for size in results.steps.sizes])
    return f"Inputs of the two experiments that follow: {sizes} deg from {base:g} deg, at {results.steps.start:g} s."


def _sine_answer(results: StudyResults) -> str:
    half = 0.5 * float(np.ptp(results.sine.speed))
    return f"The answer to it, once settled; half of its range is {half:.4g} rad/s."


def _sine_input(results: StudyResults) -> str:
    excitation = results.response.excitation
    return f"{excitation.amplitude:g} deg about {results.point.trim.input('throttle'):g} deg: an input of the spectral check."


def _whole_bode(results: StudyResults) -> str:
    text = "Magnitude in decibels of 1 rad/s per deg of throttle."
    last = float(results.response.phase_deg[-1])
    if last < -180.0:
        text += f" Two lags, of manifold and inertia, stay above {MINUS}180 deg; the phase goes on to {last:.0f} deg, by the delay."
    return text


def _poles(results: StudyResults) -> str:
    verdicts = dict(zip([named.name for named in results.models.fits], results.models.verdicts, strict=True))
    ratios = [f"{verdicts[name].numbers['fastest_pole_ratio']:.1f} in {title(name)}" for name in ("g2", "g3", "g4")]
    return f"The fastest pole over the slowest is {listed(ratios)}. Poles far to the left add little but phase lag, which is a delay's."


CAPTIONS: Mapping[str, Caption] = MappingProxyType(
    {
        "3.2": _fixed("Factor of the air flow: 1, as if choked, at low manifold pressure, and 0 at ambient pressure."),
        "3.3": _fixed("Factor of the air flow over the throttle angle; once it is 1 the throttle opens no further."),
        "3.4": _fixed("Factor of the torque: 1 at the ratio of best torque, less where the mixture is richer or leaner."),
        "3.5": _fixed("Factor of the torque: 1 at the spark advance of best torque (MBT), less on either side."),
        "3.7": _sizes,
        "3.8": _held,
        "3.9": _steps,
        "4.1": _steady,
        "4.2a": _line,
        "4.2b": _line_error,
        "4.3a": _sine_input,
        "4.3b": _sine_answer,
        "4.4": _spectrum("4.4"),
        "4.5": _spectrum("4.5"),
        "4.6": _spectrum("4.6"),
        "4.7": _spectrum("4.7"),
        "4.8": _spectrum("4.8"),
        "4.9": _spectrum("4.9"),
        "4.10": _whole_bode,
        "4.11a": _model_bode("g1"),
        "4.11b": _model_errors("g1"),
        "4.12a": _model_bode("g2"),
        "4.12b": _model_errors("g2"),
        "4.13": _delay,
        "4.14a": _model_bode("g2d"),
        "4.14b": _model_errors("g2d"),
        ROUTE_FIGURE: lambda results: route_caption(results.routes),
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
        "6.1": _poles,
        "6.2": _step_errors,
        "6.3": _fixed("The answer that the models are compared with, as a deviation from the operating point."),
        "6.4": _sine_errors(1),
        "6.5": _sine_errors(2),
        **OWN_CAPTIONS,
    }
)
"""By figure."""
