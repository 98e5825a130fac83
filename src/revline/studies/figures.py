"""Which function draws which figure of the study, with which data. The numbering is that of Lee (1995)."""

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from revline.analysis.cycle_readings import ReadingMethod
from revline.analysis.linearize import linearize
from revline.analysis.operating_range import LineFit
from revline.analysis.trim import Trim
from revline.design.loops.outcome import Diverged
from revline.design.loops.step_measures import StepMeasures
from revline.design.stability.linear_loop import closed_loop_response
from revline.engine import air, torque
from revline.engine.lee1995 import EngineParameters, lee1995_parameters
from revline.errors import NotSettledError
from revline.lti.response import FrequencyResponse
from revline.report.bode import BodeTrace, ErrorTrace, plot_bode, plot_closed_loop_bode, plot_phase_line, plot_response_errors
from revline.report.curves import View, plot_curves, plot_curves_with_detail
from revline.report.loops import LoopTrace, plot_loop
from revline.report.notes import Note
from revline.report.numbers import MINUS
from revline.report.parts import Curve, Level
from revline.report.poles import PoleSet, plot_poles
from revline.report.responses import Command, TangentTrace, plot_divergence, plot_step_response, plot_tangents
from revline.report.spectrum import plot_spectrum
from revline.report.steady import StraightLine, plot_steady_map
from revline.report.style import DATA, MODELS, PLANT, PUBLISHED, Quantity
from revline.studies.captions import SPECTRUM_FIGURES
from revline.studies.config import StudyConfig
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.results import ErrorRecord, Floats, LoopRow, TimeRecord, title
from revline.studies.routes import FIGURE as ROUTE_FIGURE
from revline.studies.routes import ROUTE_AXES, route_curves
from revline.studies.stability_figures import design_figures, hunting_figures, region_figures
from revline.studies.steps import table_response
from revline.studies.study_results import StudyResults
from revline.system import DelaySystem

TIME = Quantity("time", "s")
THROTTLE = Quantity("throttle angle", "deg")
SPEED = Quantity("engine speed", "rad/s")
PRESSURE = Quantity("manifold pressure", "kPa")
ERROR = Quantity("speed error", "rad/s")

LOOP_WINDOWS = MappingProxyType({"c1": 4.0, "c2": 3.0, "c2d": 4.0, "c2d_reduced": 12.0})
"""How long each controller's answer is shown, in s."""

BODE_POINTS = 400


def figure_calls(config: StudyConfig, engine: DelaySystem, results: StudyResults) -> dict[str, FigureCall]:
    """All figures by their number."""
    return {
        **_relations(lee1995_parameters(engine), results.point.trim),
        **_steps(results),
        **_steady(results),
        **_spectra(config, results),
        **_bode(config, engine, results),
        ROUTE_FIGURE: to_draw(plot_curves, route_curves(results.routes), *ROUTE_AXES, view=View(log="xy")),
        **_linear_loops(results),
        **_engine_loops(results),
        **_errors(results),
        **region_figures(results),
        **hunting_figures(results),
        **design_figures(results),
    }


def _relations(p: EngineParameters, trim: Trim) -> dict[str, FigureCall]:
    ratio, angle = np.linspace(0.0, 1.0, 201), np.linspace(0.0, 90.0, 361)
    mixture, advance = np.linspace(10.0, 18.0, 161), np.linspace(-30.0, 30.0, 121)
    now_ratio = trim.state("manifold_pressure") / p.throttle.ambient_pressure

    def drawn(x: Floats, now: float, relation: Callable[[float], float], horizontal: Quantity, vertical: Quantity) -> FigureCall:
        """The relation, and where on it the operating point is."""
        curve = Curve(x=x, y=np.array([relation(float(value)) for value in x]), look=PLANT)
        return to_draw(plot_curves, [curve], horizontal, vertical, notes=[Note(now, relation(now), f"operating point, {now:.4g}")])

    return {
        "3.2": drawn(
            ratio,
            now_ratio,
            lambda v: air.pressure_influence(p.throttle, v * p.throttle.ambient_pressure),
            Quantity("manifold over ambient pressure", "1"),
            Quantity("pressure-ratio influence PRI", "1"),
        ),
        "3.3": drawn(
            angle,
            trim.input("throttle"),
            lambda v: air.throttle_characteristic(p.throttle, v),
            THROTTLE,
            Quantity("throttle characteristic TC", "1"),
        ),
        "3.4": drawn(
            mixture,
            trim.input("air_fuel_ratio"),
            lambda v: torque.mixture_influence(p.mixture, v),
            Quantity("air/fuel ratio", "1"),
            Quantity("air/fuel influence AFI", "1"),
        ),
        "3.5": drawn(
            advance,
            trim.input("spark"),
            lambda v: torque.spark_influence(p.spark, v),
            Quantity("spark advance relative to MBT", "deg"),
            Quantity("spark influence SI", "1"),
        ),
    }


def _steps(results: StudyResults) -> dict[str, FigureCall]:
    steps = results.steps

    def curves(records: tuple[TimeRecord, ...], pick: Callable[[TimeRecord], Floats]) -> list[Curve]:
        return [
            Curve(x=r.times, y=pick(r), label=f"step of {size:g} deg".replace("-", MINUS), look=MODELS[k])
            for k, (size, r) in enumerate(zip(steps.sizes, records, strict=True))
        ]

    return {
        "3.7": to_draw(plot_curves, curves(steps.held, lambda r: r.throttle), TIME, THROTTLE, view=View(x=(0.0, 2.0))),
        "3.8": to_draw(plot_curves, curves(steps.held, lambda r: r.pressure), TIME, PRESSURE, view=View(x=(0.4, 1.2))),
        "3.9": to_draw(plot_curves, curves(steps.free, lambda r: r.speed), TIME, SPEED),
    }


def _steady(results: StudyResults) -> dict[str, FigureCall]:
    steady, line, trim = results.range.steady_map, results.range.line, results.point.trim
    outputs = np.array([t.output("engine_speed") for t in steady.trims])
    stable = np.array([float(t.stable) for t in steady.trims])
    note = Note(trim.input("throttle"), trim.output("engine_speed"), "operating point")
    straight = StraightLine(line.slope, line.intercept, line.low, line.high)
    chosen = (np.array(line.values) >= line.low) & (np.array(line.values) <= line.high)
    return {
        "4.1": to_draw(plot_steady_map, steady.values, outputs, stable, THROTTLE, SPEED, point=note),
        "4.2a": to_draw(plot_steady_map, steady.values, outputs, stable, THROTTLE, SPEED, point=note, line=straight),
        "4.2b": to_draw(
            plot_curves,
            [Curve(x=np.array(line.values)[chosen], y=np.array(line.errors)[chosen], look=MODELS[0])],
            THROTTLE,
            Quantity("straight line less speed", "rad/s"),
            levels=[Level(0.0)],
            notes=[_worst(line)],
        ),
    }


def _worst(line: LineFit) -> Note:
    k = int(np.argmin(np.abs(np.array(line.values) - line.max_error_at)))
    error = float(line.errors[k])
    return Note(line.max_error_at, error, f"{error:.2f} rad/s at {line.max_error_at:g} deg".replace("-", MINUS))


def _spectra(config: StudyConfig, results: StudyResults) -> dict[str, FigureCall]:
    calls = {}
    for number, check in zip(SPECTRUM_FIGURES, results.spectra, strict=True):
        spectrum = check.spectrum
        shown = spectrum.omega <= 8.0 * check.omega
        calls[number] = to_draw(
            plot_spectrum,
            spectrum.omega[shown],
            spectrum.amplitude[shown],
            input_frequency=check.omega,
            peak_frequency=spectrum.peak_omega,
            peak=spectrum.peak_amplitude,
            magnitude=Quantity("amplitude of the speed", "rad/s"),
        )
    times = results.sine.times
    calls["4.3a"] = to_draw(
        plot_curves,
        [Curve(x=times, y=results.sine.throttle, look=PLANT)],
        TIME,
        THROTTLE,
        levels=[Level(config.throttle_deg, "operating point")],
    )
    calls["4.3b"] = to_draw(
        plot_curves,
        [Curve(x=times, y=results.sine.speed, look=PLANT)],
        TIME,
        Quantity("speed less its initial value", "rad/s"),
        levels=[Level(0.0)],
    )
    return calls


def _model_response(results: StudyResults, name: str) -> FrequencyResponse:
    omega = results.response.omega
    return results.models.fit(name).fit.model.response(np.geomspace(omega[0], omega[-1], BODE_POINTS))


def _exact_response(engine: DelaySystem, results: StudyResults) -> FrequencyResponse:
    """The exact small-signal response on a grid fine enough for a smooth line."""
    omega = results.response.omega
    model = linearize(engine, results.point.trim).model
    return model.response(np.geomspace(omega[0], omega[-1], BODE_POINTS), "throttle", "engine_speed")


def _bode(config: StudyConfig, engine: DelaySystem, results: StudyResults) -> dict[str, FigureCall]:
    data = BodeTrace(results.response.response(ReadingMethod.FOURIER), "engine, fundamental", DATA)
    beside = [BodeTrace(table_response(), "Table 4.1 of Lee (1995)", PUBLISHED)] if config.is_the_thesis else []
    exact = BodeTrace(_exact_response(engine, results), "engine, exact small-signal", MODELS[0])
    calls = {"4.10": to_draw(plot_bode, [data, *beside, exact])}
    for number, name in (("4.11", "g1"), ("4.12", "g2"), ("4.14", "g2d")):
        fit = results.models.fit(name).fit
        calls[f"{number}a"] = to_draw(plot_bode, [data, BodeTrace(_model_response(results, name), title(name), MODELS[1])])
        trace = ErrorTrace(fit.data.omega, fit.magnitude_error_db, fit.phase_error_deg, title(name))
        calls[f"{number}b"] = to_draw(plot_response_errors, [trace])
    line = results.models.fit("g2d").fit.phase_line
    calls["4.13"] = to_draw(plot_phase_line, line.omega, line.difference_deg, slope=line.slope, intercept_deg=line.intercept_deg)
    calls["6.1"] = to_draw(plot_poles, [PoleSet(results.models.fit(name).fit.model.poles, title(name)) for name in ("g2", "g3", "g4")])
    return calls


def _linear_loops(results: StudyResults) -> dict[str, FigureCall]:
    calls = {}
    for number, controller, plant in (
        ("5.1", "c1", "g1"), ("5.4", "c2", "g2"), ("5.5", "c2d", "g2d"),
        ("5.12", "c1", "g2d"), ("5.13", "c2", "g2d"), ("5.14", "c2d_reduced", "g2"),
    ):  # fmt: skip
        calls[number] = _linear_step(results.loops.row(controller, plant))
    for number, controller, plant in (("5.2", "c1", "g1"), ("5.6", "c2", "g2"), ("5.7", "c2d", "g2d")):
        row = results.loops.row(controller, plant)
        response = closed_loop_response(results.models.fit(plant).fit.model, row.run.gains, np.geomspace(0.1, 300.0, BODE_POINTS))
        calls[number] = to_draw(
            plot_closed_loop_bode, [BodeTrace(response, f"{title(plant)} with {title(controller)}")], bandwidth=row.bandwidth
        )
    traces = []
    for name in ("g2", "g2d"):
        model, tangent = results.models.fit(name).fit.model, results.controllers.tangents[name]
        times = np.linspace(0.0, 4.0, 801)
        traces.append(
            TangentTrace(
                times=times,
                values=model.step_response(times),
                dead_time=tangent.dead_time,
                rise_time=tangent.rise_time,
                final_value=tangent.final_value,
                label=title(name),
            )
        )
    calls["5.3"] = to_draw(plot_tangents, traces, Quantity("speed", "rad/s"))
    return calls


def _linear_step(row: LoopRow) -> FigureCall:
    """A linear loop's answer to a unit step of the command."""
    run = row.run
    output = (run.output - run.start) / run.command
    quantity = Quantity("speed change over command", "1")
    if isinstance(run.outcome, Diverged):
        return to_draw(plot_divergence, run.times, output, Command(0.0, 1.0), quantity)
    until = min({"c1": 1.0, "c2": 0.6, "c2d": 2.5, "c2d_reduced": 12.0}.get(row.controller, 4.0), float(run.times[-1]))
    try:
        measures = run.measures()
    except NotSettledError:
        return to_draw(plot_step_response, run.times, output, Command(0.0, 1.0), quantity, until=until)
    scaled = _scaled(measures, run.start, run.command)
    return to_draw(plot_step_response, run.times, output, Command(0.0, 1.0), quantity, measures=scaled, until=until)


def _scaled(measures: StepMeasures, start: float, command: float) -> StepMeasures:
    return replace(measures, peak=(measures.peak - start) / command, steady_error=measures.steady_error / command)


def _engine_loops(results: StudyResults) -> dict[str, FigureCall]:
    calls = {}
    for number, controller in (("5.9", "c1"), ("5.10", "c2"), ("5.11", "c2d"), ("5.15", "c2d_reduced")):
        run = results.loops.row(controller, "engine").run
        trace = LoopTrace(
            times=run.times,
            output=run.output,
            control=run.control,
            start=run.start,
            target=run.target,
            low=run.limits.low,
            high=run.limits.high,
            outcome=run.outcome,
        )
        until = min(LOOP_WINDOWS[controller], float(run.times[-1]))
        calls[number] = to_draw(plot_loop, trace, SPEED, THROTTLE, until=until)
    return calls


def _errors(results: StudyResults) -> dict[str, FigureCall]:
    def error_curves(record: ErrorRecord) -> list[Curve]:
        return [
            Curve(x=record.times, y=e, label=title(n), look=MODELS[k])
            for k, (n, e) in enumerate(zip(record.models, record.errors, strict=True))
        ]

    step, *sines = results.errors.records
    calls = {
        "6.2": to_draw(
            plot_curves_with_detail,
            error_curves(step),
            TIME,
            ERROR,
            levels=[Level(0.0)],
            view=View(x=(0.4, 2.5)),
            detail=View(x=(step.start - 0.01, step.start + 0.15)),
        ),
        "6.3": to_draw(
            plot_curves, [Curve(x=step.times, y=step.speed, look=PLANT)], TIME, Quantity("speed less its initial value", "rad/s")
        ),
    }
    for number, record in zip(("6.4", "6.5"), sines, strict=False):
        cycles = 8.0 * 2.0 * np.pi / record.frequency
        calls[number] = to_draw(plot_curves, error_curves(record), TIME, ERROR, levels=[Level(0.0)], view=View(x=(0.0, max(2.0, cycles))))
    return calls
