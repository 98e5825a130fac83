"""Limit cycles and the onset of hunting as fields of results.json."""

from typing import Any

from revline.studies.hunting_results import CycleRow, HuntingResult, OnsetRow

Record = dict[str, Any]


def hunting_record(found: HuntingResult) -> Record:
    """Limit cycles as orbits beside their simulation, and how hunting begins; what does not exist is absent."""
    return {
        "limit_cycles": [_cycle(row) for row in found.cycles],
        "hunting_onsets": [_onset(row) for row in found.onsets],
        "not_computed": [{"controller": row.controller, "reason": row.reason} for row in (*found.without_cycle, *found.without_onset)],
    }


def _cycle(row: CycleRow) -> Record:
    return {
        "controller": row.controller,
        "plant": "engine",
        "low_rad_s": row.low,
        "high_rad_s": row.high,
        "period_s": row.period,
        "throttle_low_deg": row.control_low,
        "throttle_high_deg": row.control_high,
        "limits_touched": [name for name, touched in (("low", row.at_low), ("high", row.at_high)) if touched],
        "error": row.error,
        "stable": row.stable,
        "leading_multiplier": row.multiplier,
        "multiplier_error": row.multiplier_error,
        "difference_from_simulation": row.gap,
        "tolerance": row.tolerance,
    }


def _onset(row: OnsetRow) -> Record:
    return {
        "controller": row.controller,
        "factor": row.factor,
        "frequency_rad_s": row.frequency,
        "kind": row.kind,
        "lowest_factor_with_cycle": row.lowest_factor,
        "at_throttle_deg": row.throttle,
        "at_speed_rad_s": row.speed,
        "branch": [
            {"factor": p.factor, "amplitude_rad_s": p.amplitude, "period_s": p.period, "stable": p.stable, "touches_limit": p.touches_limit}
            for p in row.points
        ],
    }
