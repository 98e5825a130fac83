"""Limit cycles and the onset of hunting as records for JSON, and in words."""

from collections.abc import Mapping

from revline.design.loops.closed_loop import LoopRun
from revline.design.loops.hunting import HuntingOrbit, UnrefinedCycle
from revline.design.loops.onset import HuntingOnset
from revline.io.loop_records import loop_record

SCHEMA = "revline.limit-cycle/1"
"""Form of the record."""


def run_record(run: LoopRun) -> Mapping[str, object]:
    """Give how a loop ended as a record; a limit cycle in it is the simulated one.

    Args:
        run: the closed loop.
    """
    record = dict(loop_record(run))
    found = record.pop("limit_cycle", None)
    return {"schema": SCHEMA, **record, "hunts": found is not None, **({} if found is None else {"simulated": found})}


def orbit_record(orbit: HuntingOrbit) -> Mapping[str, object]:
    """Give a loop's limit cycle as a record, with its evidence.

    Args:
        orbit: the cycle.
    """
    cycle = orbit.cycle
    return {
        "limit_cycle": {
            "low_rad_s": orbit.low,
            "high_rad_s": orbit.high,
            "amplitude_rad_s": orbit.amplitude,
            "mean_rad_s": orbit.mean,
            "period_s": orbit.period,
            "throttle_low_deg": orbit.control_low,
            "throttle_high_deg": orbit.control_high,
            "limits_touched": [name for name, touched in (("low", orbit.at_low), ("high", orbit.at_high)) if touched],
            "harmonics_rad_s": [float(size) for size in orbit.harmonics],
            "error": cycle.error,
            "residual": orbit.residual,
            "stable": cycle.stable,
            "stability_certain": cycle.certain,
            "multipliers": [[float(value.real), float(value.imag)] for value in cycle.multipliers],
            "leading_multiplier": cycle.largest,
            "multiplier_error": cycle.multiplier_error,
            "shift_multiplier_error": cycle.trivial_error,
            "switches": int(cycle.switches.size),
            "elements": int(cycle.pieces.lengths.size),
            "found_from": orbit.start,
        },
        "agreement": {"largest_difference": orbit.gap, "tolerance": orbit.tolerance},
    }


def unrefined_record(cycle: UnrefinedCycle) -> Mapping[str, object]:
    """Give a limit cycle that only the simulation shows as a record, with the spread of its cycles.

    Args:
        cycle: the cycle.
    """
    seen = cycle.simulated
    return {
        "simulated_only": {
            "low_rad_s": seen.low,
            "high_rad_s": seen.high,
            "amplitude_rad_s": seen.amplitude,
            "period_s": seen.period,
            "low_spread_rad_s": seen.low_spread,
            "high_spread_rad_s": seen.high_spread,
            "period_spread_s": seen.period_spread,
            "cycles": seen.cycles,
            "reason": cycle.reason,
        }
    }


def onset_record(onset: HuntingOnset) -> Mapping[str, object]:
    """Give the onset of hunting as a record.

    Args:
        onset: where and how hunting begins.
    """
    gains = onset.gains
    return {
        "onset": {
            "factor": onset.factor,
            "kp": gains.kp,
            "ki": gains.ki,
            "kd": gains.kd,
            "frequency_rad_s": onset.frequency,
            "kind": onset.kind,
            "lowest_factor_with_cycle": onset.lowest_factor,
            "lowest_factor_is_fold": onset.lowest_is_fold,
            "at_throttle_deg": onset.rest.inputs["throttle"],
            "at_speed_rad_s": onset.rest.measurement,
            "branch": [
                {
                    "factor": point.factor,
                    "amplitude_rad_s": point.amplitude,
                    "low_rad_s": point.low,
                    "high_rad_s": point.high,
                    "period_s": point.period,
                    "stable": point.stable,
                    "leading_multiplier": point.largest,
                    "multiplier_error": point.multiplier_error,
                    "touches_limit": point.touches_limit,
                }
                for point in onset.points
            ],
            "branch_not_judged": [
                {"factor": point.factor, "fundamental_rad_s": point.fundamental, "reason": point.reason} for point in onset.unjudged
            ],
        }
    }


def describe_orbit(orbit: HuntingOrbit) -> list[tuple[str, float | str, str]]:
    """Give a limit cycle as rows of name, value and unit, for people."""
    cycle = orbit.cycle
    seen = orbit.simulated
    touched = " and ".join(name for name, at in (("lower", orbit.at_low), ("upper", orbit.at_high)) if at)
    verdict = ("stable" if cycle.stable else "unstable") if cycle.certain else "too near the limit of stability to tell"
    return [
        ("speed", f"{orbit.low:.6g} to {orbit.high:.6g}", "rad/s"),
        ("simulated", f"{seen.low:.6g} to {seen.high:.6g} rad/s in {seen.period:.6g} s", ""),
        ("period", f"{orbit.period:.6g}", "s"),
        ("throttle", f"{orbit.control_low:.4g} to {orbit.control_high:.4g}", "deg"),
        ("limits touched", touched or "none", ""),
        ("cycle", verdict, ""),
        ("largest multiplier", f"{cycle.largest:.4g} +- {cycle.multiplier_error:.1g}", "per period"),
        ("estimated error", f"{cycle.error:.1g}", "of swing and period"),
        ("residual", f"{orbit.residual:.1g}", "of the largest rate"),
    ]


def describe_unrefined(cycle: UnrefinedCycle) -> list[tuple[str, float | str, str]]:
    """Give a limit cycle that only the simulation shows as rows of name, value and unit, for people."""
    seen = cycle.simulated
    return [
        ("speed, simulated", f"{seen.low:.5g} to {seen.high:.5g}", "rad/s"),
        ("amplitude, simulated", f"{seen.amplitude:.5g}", "rad/s"),
        ("period, simulated", f"{seen.period:.5g}", "s"),
        ("spread of lows, highs", f"{seen.low_spread:.1g}, {seen.high_spread:.1g}", "rad/s"),
        ("spread of periods", f"{seen.period_spread:.1g}", "s"),
        ("cycles judged", f"{seen.cycles}", ""),
    ]


def describe_onset(onset: HuntingOnset) -> list[tuple[str, float | str, str]]:
    """Give the onset of hunting as rows of name, value and unit, for people."""
    gains, unit = onset.gains, onset.gains.gain_units
    return [
        ("at", f"{onset.rest.measurement:.5g} rad/s, {onset.rest.inputs['throttle']:.4g} deg", ""),
        ("all gains times", f"{onset.factor:.5g}", ""),
        ("kp", gains.kp, unit["kp"]),
        ("ki", gains.ki, unit["ki"]),
        ("kd", gains.kd, unit["kd"]),
        ("oscillating at", onset.frequency, "rad/s"),
        ("kind", onset.kind, ""),
        ("lowest factor with a cycle", onset.lowest_factor, _lowest_note(onset)),
    ]


def _lowest_note(onset: HuntingOnset) -> str:
    """What the lowest factor is worth."""
    if onset.lowest_is_fold:
        return "where the family turns"
    return "" if onset.kind == "soft" else "at the end of what was followed: larger cycles may exist below"
