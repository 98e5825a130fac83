"""Loops under sampled controllers as records for JSON, and what the controller did at its samples as CSV."""

from collections.abc import Mapping
from dataclasses import replace

from revline.design.loops.controller_samples import DisturbedRun, Samples
from revline.design.loops.loop_run import LoopRun
from revline.design.loops.outcome import LimitCycle
from revline.design.loops.sampled_step import SampledStep
from revline.io.controller_surroundings import surroundings_record
from revline.io.csv_text import format_csv
from revline.io.loop_records import TERMS, format_loop, term_fields

GAINS = (("kp", "deg_s_per_rad"), ("ki", "deg_per_rad"), ("kd", "deg_s2_per_rad"))
"""Names and units of gains that a schedule gives at each sample."""


def sampled_fields(step: SampledStep) -> Mapping[str, object]:
    """Give what a record of a loop holds more where the controller samples.

    Args:
        step: the loop.
    """
    run, samples = step.run, step.samples
    fields: dict[str, object] = {
        "sampling": surroundings_record(step.controller)["sampling"],
        "sampling_period_s": step.period,
        "equivalent_delay_s": step.equivalent_delay,
        "scheduled": samples.gains.size > 0,
        "samples": samples.times.size,
        "overruns": samples.overruns,
        "saturated_share": samples.saturated_share(run.limits),
        **term_fields(samples.terms, samples.windup),
    }
    if isinstance(run.outcome, LimitCycle):
        found = run.outcome
        fields["limit_cycle_spread"] = {
            "low_rad_s": found.low_spread,
            "high_rad_s": found.high_spread,
            "period_s": found.period_spread,
            "cycles": found.cycles,
        }
    return {**fields, **_disturbed(step.disturbed)}


def format_sampled_loop(step: SampledStep) -> str:
    """Format a loop under a sampled controller as CSV, its terms being those of the last sample; with noise and jitter where there are any.

    Args:
        step: the loop.
    """
    found = step.disturbed
    if found is None:
        return format_loop(step.run)
    return format_loop(_as_disturbed(step.run, found), {"quiet_speed_rad_s": found.trace.output - found.deviation})


def format_samples(step: SampledStep) -> str:
    """Format what a controller did at its samples as CSV, with noise and jitter where there are any.

    Args:
        step: the loop.
    """
    samples: Samples = step.samples if step.disturbed is None else step.disturbed.samples
    columns = [
        ("time_s", samples.times),
        ("speed_measured_rad_s", samples.measurement),
        ("speed_command_rad_s", samples.command),
        ("throttle_deg", samples.control),
        ("throttle_wanted_deg", samples.wanted),
        *((f"{name}_deg", samples.terms[:, k]) for k, name in enumerate(TERMS)),
        ("windup_deg", samples.windup),
    ]
    if samples.gains.size:
        columns += [(f"{name}_{unit}", samples.gains[:, k]) for k, (name, unit) in enumerate(GAINS)]
    gains = step.run.gains
    notes: dict[str, str | float] = {
        "plant": step.run.plant,
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "form": step.run.form,
        "sampling_period_s": step.period,
        "overruns": float(samples.overruns),
    }
    return format_csv(columns, notes=notes)


def _as_disturbed(run: LoopRun, found: DisturbedRun) -> LoopRun:
    """The record with noise and jitter, under the judgement without."""
    trace = found.trace
    return replace(run, times=trace.times, output=trace.output, control=trace.control, terms=trace.terms)


def _disturbed(found: DisturbedRun | None) -> Mapping[str, object]:
    if found is None:
        return {}
    asked = found.disturbance
    return {
        "disturbed": {
            "noise_rad_s": asked.noise,
            "jitter": asked.jitter,
            "seed": asked.seed,
            "deviation_rms_rad_s": found.rms,
            "deviation_largest_rad_s": found.largest,
            "throttle_travel_deg": found.travel,
            "quiet_throttle_travel_deg": found.quiet_travel,
        }
    }
