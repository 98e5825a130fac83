"""Stability of the study's loops as fields of results.json."""

from typing import Any

from revline.io.margin_records import margin_fields
from revline.studies.stability_results import RegionRow, StabilityResult

Record = dict[str, Any]


def stability_record(found: StabilityResult) -> Record:
    """Margins of every loop and the gains that stabilise each plant; what does not exist is absent."""
    record: Record = {
        "margins": [{"controller": row.controller, "plant": row.plant, **margin_fields(row.margins)} for row in found.margins],
        "loops_without_margins": [
            {"controller": row.controller, "plant": row.plant, "reason": row.reason} for row in found.without_margins
        ],
        "gain_regions": [region_fields(row) for row in found.regions],
        "plants_without_region": [{"plant": row.plant, "kd": row.kd, "reason": row.reason} for row in found.without_region],
    }
    for trim in found.target:
        record["target_point"] = {"throttle_deg": trim.input("throttle"), "speed_rad_s": trim.output("engine_speed"), "stable": trim.stable}
    return record


def region_fields(row: RegionRow) -> Record:
    """Fields of one region."""
    return {
        "plant": row.plant,
        "kd": row.kd,
        "window": {"kp_low": row.window.kp_low, "kp_high": row.window.kp_high, "ki_high": row.window.ki_high},
        "bounded": row.bounded,
        "kp_intervals_without_integral": [list(ends) for ends in row.intervals],
        "boundary": [
            {"frequency_rad_s": float(w), "kp": float(p), "ki": float(i)} for w, p, i in zip(row.omega, row.kp, row.ki, strict=True)
        ],
        "stabilised_by": list(row.inside),
        "not_stabilised_by": list(row.outside),
    }
