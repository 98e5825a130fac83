"""Runs of closed speed loops as records for JSON, and their samples as CSV."""

from collections.abc import Mapping

import numpy as np

from revline.design.closed_loop import LoopRun, describe_outcome
from revline.design.linear_loop import find_bandwidth
from revline.design.loop_stability import StableLoop, judge_loop_stability
from revline.design.outcome import Diverged, LimitCycle, Settled, Stalled
from revline.errors import AnalysisError, NotSettledError
from revline.io.csv_text import format_csv
from revline.lti.transfer_function import TransferFunction

OFF_TARGET = 0.02
"""Share of the command beyond which a speed at rest counts as off its target: the usual settling band."""


def loop_record(run: LoopRun) -> Mapping[str, object]:
    """Give a closed loop around an engine or a model of one, after a step of its speed command, as a record.

    What does not exist is left out: an overshoot of what diverges or stalls, a settling time of what does not settle.

    Args:
        run: the closed loop.
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
    return {**record, **_outcome_entries(run)}


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


def linear_loop_record(run: LoopRun, model: TransferFunction) -> Mapping[str, object]:
    """Give a closed loop around a linear model as a record, with the bandwidth of the closed loop where it is stable and has one.

    Args:
        run: the closed loop.
        model: around which it was closed.
    """
    record = loop_record(run)
    if not isinstance(judge_loop_stability(model, run.gains), StableLoop):
        return record
    try:
        return {**record, "bandwidth_rad_s": find_bandwidth(model, run.gains)}
    except AnalysisError:  # its magnitude is below half power from zero frequency on
        return record


def format_loop(run: LoopRun) -> str:
    """Format the samples of a closed speed loop as CSV: time, speed, throttle, and the controller's terms where they were recorded.

    Args:
        run: the closed loop.
    """
    columns = [("time_s", run.times), ("speed_rad_s", run.output), ("throttle_deg", run.control)]
    if run.terms.shape[0]:
        columns += [(f"{name}_deg", run.terms[:, k]) for k, name in enumerate(("proportional", "integral", "derivative"))]
    gains = run.gains
    notes: dict[str, str | float] = {
        "plant": run.plant,
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "outcome": describe_outcome(run),
        "form": run.form,
    }
    return format_csv(columns, notes=notes)


def _outcome_entries(run: LoopRun) -> Mapping[str, object]:
    outcome = run.outcome
    if isinstance(outcome, Settled):
        return {"overshoot": run.overshoot, "steady_error_rad_s": outcome.steady_error, **_settling(run)}
    if isinstance(outcome, LimitCycle):
        cycle = {"low_rad_s": outcome.low, "high_rad_s": outcome.high, "period_s": outcome.period}
        return {"overshoot": run.overshoot, "limit_cycle": cycle}
    return {"ended_at_s": outcome.time, **_last_value(outcome)}


def _last_value(outcome: Diverged | Stalled) -> Mapping[str, object]:
    return {"speed_bound_rad_s": outcome.bound} if isinstance(outcome, Diverged) else {"state": outcome.state, "value": outcome.value}


def _settling(run: LoopRun) -> Mapping[str, float]:
    try:
        measures = run.measures()
    except NotSettledError:
        return {}
    return {"settling_time_s": measures.settling_time, "settling_band": measures.band, "rise_time_s": measures.rise_time}
