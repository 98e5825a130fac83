"""Runs of closed speed loops as records for JSON, and their samples as CSV."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.pid_controller import AnyPid
from revline.design.loops.closed_loop import LoopRun, describe_outcome
from revline.design.loops.linear_verdict import LinearVerdict
from revline.design.loops.load_response import LoadResponse, LoadStep, measure_load_response
from revline.design.loops.outcome import Diverged, LimitCycle, Settled, Stalled
from revline.design.stability.linear_loop import find_bandwidth
from revline.design.stability.loop_stability import StableLoop, judge_loop_stability
from revline.errors import AnalysisError, NotSettledError
from revline.io.csv_text import format_csv
from revline.lti.transfer_function import TransferFunction

Floats = NDArray[np.float64]

OFF_TARGET = 0.02
"""Share of the command beyond which a speed at rest counts as off its target: the usual settling band."""

LEAST_AFTER = 0.2
"""A record goes on after a step of the load for this share of the time before it at least, to tell of the answer."""

TERMS = ("proportional", "integral", "derivative")
"""Names of the controller's terms, in their order."""


def loop_record(run: LoopRun, load: LoadStep | None = None) -> Mapping[str, object]:
    """Give a closed loop around an engine or a model of one, after a step of its speed command, as a record.

    What does not exist is left out: an overshoot of what diverges or stalls, a settling time of what does not settle.

    Args:
        run: the closed loop.
        load: a step of the load in it: what is measured of the command's step is then that before it.
    """
    gains = run.gains
    record: dict[str, object] = {
        "plant": run.plant,
        "controller": {"kp": gains.kp, "ki": gains.ki, "kd": gains.kd, "rule": gains.rule, "designed_on": gains.designed_on},
        "command_rad_s": run.command,
        "start_rad_s": run.start,
        "target_rad_s": run.target,
        "until_s": float(run.times[-1]),
        "stable": run.is_stable,
        "outcome": run.outcome.name,
        "summary": describe_outcome(run),
        "throttle_low_deg": float(run.control.min()),
        "throttle_high_deg": float(run.control.max()),
        "form": run.form,
        "warnings": list(loop_warnings(run)),
    }
    if np.all(np.isfinite(run.limits)):
        record["throttle_limits_deg"] = list(run.limits)
        record["saturated_share"] = run.saturated_share
    if run.step > 0.0:
        record["time_step_s"] = run.step
    if len(run.terms):
        record |= term_fields(run.terms, run.windup)
    before = run if load is None else run.first_part(load.at)
    return {**record, **_outcome_entries(run, before), **_load_entries(run, load)}


def term_fields(terms: Floats, windup: Floats) -> Mapping[str, object]:
    """Give the range and the end of a controller's terms, and of what it wants beyond its limits, as fields of a record.

    Args:
        terms: proportional, integral and derivative term, shape (n, 3).
        windup: what is wanted beyond the limits, with its sign, shape (n,).
    """
    ranges = {
        name: {"low_deg": float(column.min()), "high_deg": float(column.max()), "end_deg": float(column[-1])}
        for name, column in zip(TERMS, terms.T, strict=True)
    }
    largest = float(windup[int(np.argmax(np.abs(windup)))])
    state = {"largest_deg": largest, "end_deg": float(windup[-1]), "share": float(np.mean(windup != 0.0))}
    return {"terms": ranges, "windup": state}


def verdict_fields(verdict: LinearVerdict) -> Mapping[str, object]:
    """Give what the linear loop about the operating point says as a field of a record; what does not exist is left out.

    The margins of an unstable loop are left out: they are no safety.

    Args:
        verdict: of the linear loop.
    """
    found: dict[str, object] = {"stable": verdict.stable}
    if math.isfinite(verdict.unstable_poles):
        found["unstable_poles"] = round(verdict.unstable_poles)
    margins = verdict.margins
    if margins is not None and verdict.stable:
        found |= {"ms": margins.sensitivity.value}
        found |= {"gain_margin": margins.gain_rise.gain_margin} if margins.gain_rise else {}
        found |= {"phase_margin_deg": margins.phase.phase_margin_deg} if margins.phase else {}
        found |= {"delay_margin_s": margins.delay.delay_margin} if margins.delay else {}
    if verdict.stable_range is not None:
        low, high = verdict.stable_range
        found |= {"stable_from_factor": low, **({"stable_to_factor": high} if math.isfinite(high) else {})}
    return {"linear_loop": found}


def loop_warnings(run: LoopRun) -> tuple[str, ...]:
    """Say what a reader of a settled loop should know: that it rests off its target, or that its settling time is not shown."""
    outcome = run.outcome
    if not isinstance(outcome, Settled):
        return ()
    if abs(outcome.steady_error) > OFF_TARGET * abs(run.command):
        at_limit = " with the throttle at a limit" if run.control[-1] in run.limits else ""
        return (f"the speed rests {abs(outcome.steady_error):.4g} rad/s off its target{at_limit}",)
    if not _settling(run):
        return ("the record is too short to show a settling time; give a later stop time",)
    return ()


def late_load(run: LoopRun, load: LoadStep) -> tuple[str, ...]:
    """Say that a record holds too little after the load's step to tell how the loop answers it; nothing where it holds enough.

    Args:
        run: with the load's step in it.
        load: the step.
    """
    left = float(run.times[-1]) - load.at
    if left >= LEAST_AFTER * load.at:
        return ()
    shown = f"only {left:.3g} s of the record follow" if left > 0.0 else "the record ends before"
    return (f"{shown} the load's step at {load.at:g} s: the outcome says nothing of the answer to it; give a later stop time",)


def bandwidth_fields(model: TransferFunction, law: AnyPid) -> Mapping[str, float]:
    """Give the bandwidth of a closed loop around a linear model where it is stable and has one.

    Args:
        model: around which it was closed.
        law: gains alone, or a continuous controller.
    """
    if not isinstance(judge_loop_stability(model, law), StableLoop):
        return {}
    try:
        return {"bandwidth_rad_s": find_bandwidth(model, law)}
    except AnalysisError:  # its magnitude is below half power from zero frequency on
        return {}


def format_loop(run: LoopRun, further: Mapping[str, Floats] | None = None) -> str:
    """Format the samples of a closed speed loop as CSV: time, speed, throttle, the controller's terms and what it wants beyond its limits.

    Args:
        run: the closed loop.
        further: columns of the same length, by name.
    """
    columns = [("time_s", run.times), ("speed_rad_s", run.output), ("throttle_deg", run.control)]
    if run.terms.shape[0]:
        columns += [(f"{name}_deg", run.terms[:, k]) for k, name in enumerate(TERMS)]
        columns.append(("windup_deg", run.windup))
    gains = run.gains
    notes: dict[str, str | float] = {
        "plant": run.plant,
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "outcome": describe_outcome(run),
        "form": run.form,
    }
    return format_csv([*columns, *(further or {}).items()], notes=notes)


def _outcome_entries(run: LoopRun, before: LoopRun) -> Mapping[str, object]:
    outcome = run.outcome
    if isinstance(outcome, Settled):
        return {"overshoot": before.overshoot, "steady_error_rad_s": outcome.steady_error, **_settling(before)}
    if isinstance(outcome, LimitCycle):
        cycle = {"low_rad_s": outcome.low, "high_rad_s": outcome.high, "period_s": outcome.period}
        return {"overshoot": before.overshoot, "limit_cycle": cycle}
    return {"ended_at_s": outcome.time, **_last_value(outcome)}


def _last_value(outcome: Diverged | Stalled) -> Mapping[str, object]:
    return {"speed_bound_rad_s": outcome.bound} if isinstance(outcome, Diverged) else {"state": outcome.state, "value": outcome.value}


def _settling(run: LoopRun) -> Mapping[str, float]:
    try:
        measures = run.measures()
    except NotSettledError:
        return {}
    return {"settling_time_s": measures.settling_time, "settling_band": measures.band, "rise_time_s": measures.rise_time}


def _load_entries(run: LoopRun, load: LoadStep | None) -> Mapping[str, object]:
    if load is None:
        return {}
    found = measure_load_response(run, load)
    return {"load_step": {"size_nm": load.size, "at_s": load.at, **({} if found is None else _response_fields(found))}}


def _response_fields(found: LoadResponse) -> dict[str, float]:
    fields = {"droop_rad_s": found.droop, "band_rad_s": found.band, "iae_rad": found.iae, "end_error_rad_s": found.error}
    return fields | ({"settling_time_s": found.settling_time} if math.isfinite(found.settling_time) else {})
