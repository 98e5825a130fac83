"""Verdicts of the acceptance battery as records for JSON."""

import math
from collections.abc import Mapping
from typing import Final

from revline.design.controllers.scheduled_pid import AnyController, ScheduledController, law_of
from revline.design.trials.acceptance import Acceptance, AcceptanceRun
from revline.design.trials.gain_reserve import LARGEST, GainReserve
from revline.design.trials.linear_place import LinearLoop
from revline.io.controller_files import controller_record
from revline.io.schedule_files import scheduled_record
from revline.sampled import CrankSynchronous

SCHEMA: Final = "revline.acceptance/1"

PLACES: Final = (("throttle", "throttle_deg"), ("load_torque", "load_nm"))
"""Inputs of a trim and their keys."""


def acceptance_record(found: Acceptance, *, engine: str, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give a verdict with all that it rests on as a record; what is not there, or not finite, is left out.

    Args:
        found: the verdict.
        engine: name of the engine.
        provenance: what writes it, from what.
    """
    battery, wish = found.battery, found.battery.requirements
    requirements = {
        "overshoot": wish.overshoot,
        "settling_time_s": wish.settling_time,
        "settling_band": wish.band,
        "steady_error": wish.steady_error,
        "droop_rad_s": wish.droop,
        "gain_reserve_db": wish.gain_reserve_db,
    }
    return {
        "schema": SCHEMA,
        "engine": engine,
        "passed": found.passed,
        **(_finite({"gain_reserve_db": found.gain_reserve_db}) if found.reserves else {}),
        "reasons": list(found.reasons),
        "controller": _controller_record(found.controller, provenance),
        "scheduled": isinstance(found.controller, ScheduledController),
        "battery": {
            "command_rad_s": battery.command,
            "load_step_nm": battery.load,
            "until_s": battery.until,
            "time_step_s": battery.step,
            "noise_rad_s": battery.disturbance.noise,
            "jitter": battery.disturbance.jitter,
            "jitter_unit": "rad" if isinstance(law_of(found.controller).sampling, CrankSynchronous) else "s",
            "seed": battery.disturbance.seed,
            "requirements": _finite(requirements),
        },
        "runs": [_run_record(run) for run in found.runs],
        "gain_reserves": [_reserve_record(reserve) for reserve in found.reserves],
        "linear_loops": [_linear_record(linear) for linear in found.linear],
    }


def _controller_record(controller: AnyController, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """What was judged: with its schedule in place of gains where it has one."""
    if isinstance(controller, ScheduledController):
        return scheduled_record(controller, provenance=provenance)
    return controller_record(law_of(controller), provenance=provenance)


def _run_record(run: AcceptanceRun) -> dict[str, object]:
    case = run.case
    record: dict[str, object] = {key: float(case.place[name]) for name, key in PLACES if name in case.place}
    record |= {"kind": case.kind.value, "plant": case.plant, "command_rad_s": case.command, "load_step_nm": case.load, "seed": case.seed}
    record |= {"passed": run.passed, "reasons": list(run.reasons)}
    found = run.measures
    if found is None:
        return {**record, "ended": run.ended}
    measured = {
        "overshoot": found.overshoot,
        "command_settling_time_s": found.command_settling_time,
        "load_settling_time_s": found.load_settling_time,
        "command_error_rad_s": found.command_error,
        "load_error_rad_s": found.load_error,
        "command_iae_rad": found.command_iae,
        "load_iae_rad": found.load_iae,
        "droop_rad_s": found.droop,
        "throttle_travel_deg": found.travel,
        "saturated_share": found.saturated_share,
        "integral_low_deg": found.integral_low,
        "integral_high_deg": found.integral_high,
    }
    return {**record, **_finite(measured), "overruns": found.overruns}


def _reserve_record(reserve: GainReserve) -> Mapping[str, object]:
    record: dict[str, object] = {key: float(reserve.place[name]) for name, key in PLACES if name in reserve.place}
    numbers = {"factor": reserve.factor, "hunts_at_factor": reserve.hunts, "gain_reserve_db": reserve.decibels, "period_s": reserve.period}
    record |= _finite(numbers)
    if math.isinf(reserve.hunts):
        record["note"] = f"no hunting up to {LARGEST:g} times the gains"
    elif reserve.factor == 0.0:
        record["note"] = f"it comes to rest at none of its gains' multiples down to {reserve.hunts:g}"
    record["ending"] = reserve.ending.name.lower()
    return {**record, "runs": reserve.runs}


def _linear_record(linear: LinearLoop) -> Mapping[str, object]:
    found, margins = linear.margins, linear.margins.margins
    record: dict[str, object] = {key: float(linear.place[name]) for name, key in PLACES if name in linear.place}
    record |= {"stable": margins.stable, "unstable_roots": round(margins.unstable_poles), "ms": margins.sensitivity.value}
    record |= {"mt": margins.complementary.value, "sampling_period_s": found.period, "equivalent_delay_s": found.equivalent_delay}
    rise, fall = margins.gain_rise, margins.gain_fall
    record |= {"gain_margin": rise.gain_margin} if rise else {}
    record |= {"gain_reduction_margin": fall.gain_margin} if fall else {}
    record |= {"phase_margin_deg": margins.phase.phase_margin_deg} if margins.phase else {}
    record |= {"warning": linear.warning} if linear.warning else {}
    return {**record, "delay_s": linear.delay, "left_out": found.left_out}


def _finite(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in numbers.items() if math.isfinite(value)}
