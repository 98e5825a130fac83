"""A study's results as the fields of results.json, which programs rely on."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np

from revline import __version__
from revline.analysis.cycle_readings import ReadingMethod
from revline.analysis.operating_range import OperatingRange
from revline.analysis.sinestream import Sinestream
from revline.analysis.spectrum import SpectralCheck
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import LoopRun
from revline.design.loops.outcome import Diverged, LimitCycle, Settled
from revline.errors import NotSettledError
from revline.io.linear_range_records import linear_range_record
from revline.lti.response import FrequencyResponse
from revline.studies.checks import Check
from revline.studies.config import StudyConfig
from revline.studies.delay_models import delay_fields
from revline.studies.hunting_record import hunting_record
from revline.studies.model_distance import distance_fields
from revline.studies.operating_map import map_fields
from revline.studies.parts import Parts
from revline.studies.results import ControllersResult, ErrorRecord, LoopRow, ModelsResult, PointResult, RangeResult
from revline.studies.rivals import rivals_fields
from revline.studies.routes import balance_rows, routes_fields
from revline.studies.stability_record import stability_record
from revline.studies.study_results import StudyResults
from revline.studies.trials import trials_fields
from revline.studies.two_inputs import two_inputs_fields

SCHEMA = "revline.study/1"
PARTIAL_NOTE = "this study is not finished; run the same command again and it goes on from its finished steps"
Record = dict[str, Any]


def study_record(config: StudyConfig, results: StudyResults, checks: Iterable[Check], warnings: Iterable[str], seconds: float) -> Record:
    """Collect all fields of results.json but the figures'."""
    found = {field.name: getattr(results, field.name) for field in fields(results)}
    return {
        **_head(config),
        "seconds": seconds,
        **_parts_record(config, found),
        "step_responses": [{"step_deg": size, "file": f"tables/step_{size:g}_deg.csv"} for size in results.steps.sizes],
        "linearity": {"verdict": results.linearity.text},
        "checks": [check.record() for check in checks],
        "warnings": list(warnings),
    }


def partial_record(config: StudyConfig, parts: Parts) -> Record:
    """Fields of results.json of a study that is not finished: that it is partial, what is missing and why, and all that is found."""
    record: Record = {**_head(config), "partial": True, "note": PARTIAL_NOTE, "finished_steps": list(parts.finished)}
    if not parts.is_whole:
        record["failed_steps"] = [{"step": step.name, "error": step.reason} for step in parts.failed]
        record["skipped_steps"] = [{"step": step.name, "wants": list(step.wants)} for step in parts.skipped]
    return record | _parts_record(config, parts.found)


def _head(config: StudyConfig) -> Record:
    return {"schema": SCHEMA, "engine": config.engine, "version": __version__}


def _parts_record(config: StudyConfig, found: Mapping[str, Any]) -> Record:
    """Fields of those results that are there."""
    return {key: value for name, write in PARTS.items() if name in found for key, value in write(config, found).items()}


def point_record(point: PointResult) -> Record:
    """Fields of the operating point."""
    trim = point.trim
    return {
        "throttle_deg": trim.input("throttle"),
        "load_n_m": trim.input("load_torque"),
        "speed_rad_s": trim.output("engine_speed"),
        "pressure_kpa": trim.state("manifold_pressure"),
        "gain_rad_s_per_deg": point.gain,
        "residual": trim.residual,
        "stable": trim.stable,
        "intake_lag_s": trim.lag("charge"),
        "spark_lag_s": trim.lag("spark_influence"),
    }


def map_record(result: RangeResult) -> list[Record]:
    """Rows of the steady map."""
    rows = zip(result.steady_map.values, result.steady_map.trims, strict=True)
    return [
        {
            "throttle_deg": float(angle),
            "speed_rad_s": trim.output("engine_speed"),
            "pressure_kpa": trim.state("manifold_pressure"),
            "stable": trim.stable,
        }
        for angle, trim in rows
    ]


def range_record(result: RangeResult) -> Record:
    """The line over the range studied, and the range that a tolerance would choose."""
    line, widest = result.line, result.widest
    record: Record = {
        "low_deg": line.low,
        "high_deg": line.high,
        "slope_rad_s_per_deg": line.slope,
        "intercept_rad_s": line.intercept,
        "max_error_rad_s": line.max_error,
        "max_error_at_deg": line.max_error_at,
        "lowest_throttle_deg": result.steady_map.lowest,
    }
    if isinstance(widest, OperatingRange):
        record["widest"] = {
            "tolerance_of_span": widest.tolerance,
            "low_deg": widest.line.low,
            "high_deg": widest.line.high,
            "max_error_rad_s": widest.line.max_error,
        }
    return record


def spectrum_record(check: SpectralCheck) -> Record:
    """Fields of one spectral check."""
    return {
        "frequency_rad_s": check.omega,
        "peak_rad_s": check.spectrum.peak_omega,
        "peak_amplitude_rad_s": check.spectrum.peak_amplitude,
        "zero_line_rad_s": check.spectrum.zero_line,
        "resolution_rad_s": check.spectrum.resolution,
        "bin_width_rad_s": check.spectrum.bin_width,
        "periods": check.cycles,
        "samples_per_period": check.samples_per_cycle,
        "window": "none",
        "distortion": check.distortion,
        "follows": check.follows,
    }


def response_records(config: StudyConfig, stream: Sinestream, exact: FrequencyResponse) -> list[Record]:
    """Rows of the frequency response, by every method."""
    rows: list[Record] = []
    for method in (ReadingMethod.PEAKS, ReadingMethod.FOURIER):
        response = stream.response(method)
        extra = stream.distortion if method is ReadingMethod.FOURIER else None
        rows += _response_rows(method.value, response, config.amplitude_deg, extra)
    return rows + _response_rows("exact", exact, config.amplitude_deg, None)


def _response_rows(method: str, response: FrequencyResponse, amplitude: float, distortion: Any) -> list[Record]:
    rows = [
        {"method": method, "frequency_rad_s": float(w), "amplitude_rad_s": float(m) * amplitude, "phase_deg": float(p)}
        for w, m, p in zip(response.omega, response.magnitude, response.phase_deg, strict=True)
    ]
    if distortion is not None:
        for row, value in zip(rows, distortion, strict=True):
            row["distortion"] = float(value)
    return rows


def models_record(models: ModelsResult) -> Record:
    """All models of one response."""
    return {
        named.name: {
            "numerator": [float(c) for c in named.fit.model.numerator],
            "denominator": [float(c) for c in named.fit.model.denominator],
            "delay_s": named.fit.model.delay,
            "poles": pairs(named.fit.model.poles),
            "zeros": pairs(named.fit.model.zeros),
            "max_magnitude_error_db": named.fit.max_magnitude_error_db,
            "max_phase_error_deg": named.fit.max_phase_error_deg,
            "verdict": verdict.text,
            "accepted": verdict.accepted,
        }
        for named, verdict in zip(models.fits, models.verdicts, strict=True)
    }


def pairs(values: Any) -> list[list[float]]:
    """Complex numbers as pairs of real and imaginary part."""
    return [[float(v.real), float(v.imag)] for v in np.asarray(values, dtype=complex)]


def gains_record(gains: PidGains) -> Record:
    """Fields of a controller."""
    return {
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "rule": gains.rule,
        "designed_on": gains.designed_on,
        "units": dict(gains.gain_units),
    }


def loop_record(row: LoopRow) -> Record:
    """Fields of a closed loop; what does not exist is absent."""
    run = row.run
    record: Record = {
        "controller": row.controller,
        "plant": row.plant,
        "stable": run.is_stable,
        "outcome": run.outcome.name,
        "command_rad_s": run.command,
        "simulated_s": float(run.times[-1]),
        "form": run.form,
        **outcome_fields(run),
    }
    if row.bandwidth > 0.0:
        record["bandwidth_rad_s"] = row.bandwidth
    if row.plant == "engine":
        record["saturated_share"] = run.saturated_share
        record["throttle_limits_deg"] = list(run.limits)
    return record


def outcome_fields(run: LoopRun) -> Record:
    """What the outcome of a loop says in numbers."""
    outcome = run.outcome
    if isinstance(outcome, LimitCycle):
        return {
            "overshoot": run.overshoot,
            "limit_cycle": {"low_rad_s": outcome.low, "high_rad_s": outcome.high, "period_s": outcome.period, "swings": outcome.swings},
        }
    if isinstance(outcome, Diverged):
        return {"diverged_at_s": outcome.time}
    if not isinstance(outcome, Settled):
        return {"stalled_at_s": outcome.time}
    fields: Record = {"overshoot": run.overshoot, "steady_error_rad_s": outcome.steady_error}
    try:
        fields["settling_time_s"] = run.measures().settling_time
    except NotSettledError:
        return fields
    return fields


def error_records(records: Iterable[ErrorRecord]) -> list[Record]:
    """Time-domain errors of the models."""
    rows: list[Record] = []
    for record in records:
        for model in record.models:
            row: Record = {"input": record.kind, "model": model}
            if record.kind == "sine":
                row["frequency_rad_s"] = record.frequency
            row |= {
                "max_abs_error_rad_s": record.largest(model),
                "rms_error_rad_s": record.rms(model),
                "alternating_error_rad_s": record.swing(model),
                "judged_from_s": record.judged_from,
            }
            rows.append(row)
    return rows


def controller_records(controllers: ControllersResult) -> Record:
    """Controllers, and what the tuned ones minimise."""
    return {
        "controllers": {name: gains_record(gains) for name, gains in controllers.gains.items()},
        "fine_tuning": {name: tuning.text for name, tuning in controllers.tunings.items()},
    }


PARTS: Mapping[str, Callable[[StudyConfig, Mapping[str, Any]], Record]] = MappingProxyType(
    {
        "point": lambda _, found: {"operating_point": point_record(found["point"])},
        "range": lambda _, found: {"steady_map": map_record(found["range"]), "operating_range": range_record(found["range"])},
        "spectra": lambda _, found: {"spectra": [spectrum_record(check) for check in found["spectra"]]},
        "response": lambda config, found: {
            "frequency_response": response_records(config, found["response"], found["point"].exact),
        },
        "routes": lambda config, found: {
            "frequency_response": [
                *response_records(config, found["response"], found["point"].exact),
                *balance_rows(found["routes"]),
            ],
            "cross_check": routes_fields(found["routes"]),
        },
        "models": lambda _, found: {"models": models_record(found["models"])},
        "table_models": lambda _, found: {"models_from_table": models_record(found["table_models"][0])} if found["table_models"] else {},
        "controllers": lambda _, found: controller_records(found["controllers"]),
        "loops": lambda _, found: {"closed_loops": [loop_record(row) for row in found["loops"].rows]},
        "distance": lambda _, found: {"model_distances": distance_fields(found["distance"])},
        "hunting": lambda _, found: {"hunting": hunting_record(found["hunting"])},
        "linear_range": lambda _, found: {"linear_range": dict(linear_range_record(found["linear_range"]))},
        "stability": lambda _, found: stability_record(found["stability"]),
        "errors": lambda _, found: {"model_errors": error_records(found["errors"].records)},
        "delay_models": lambda _, found: {
            "model_errors": error_records((*found["errors"].records, *found["delay_models"].records)),
            "delay_models": delay_fields(found["delay_models"]),
        },
        "rivals": lambda config, found: rivals_fields(found["rivals"], engine=config.engine, place=(config.throttle_deg, config.load_n_m)),
        "operating_map": lambda _, found: map_fields(found["operating_map"]),
        "trials": lambda _, found: trials_fields(found["trials"]),
        "two_inputs": lambda _, found: two_inputs_fields(found["two_inputs"]),
        "guidelines": lambda _, found: {"guidelines": list(found["guidelines"])},
    }
)
"""Fields of results.json that each part of a study gives, by the field of `StudyResults`."""
