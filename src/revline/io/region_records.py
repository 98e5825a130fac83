"""Stabilising gains as a record for JSON."""

from collections.abc import Mapping

import numpy as np

from revline.design.gain_region import GainRegion


def region_record(region: GainRegion) -> Mapping[str, object]:
    """Give a region of stabilising gains as a record: its boundary point by point, and what it was found from.

    Args:
        region: the gains.
    """
    family, window = region.family, region.window
    at = np.flatnonzero(region.rim)
    return {
        "schema": "revline.region/1",
        "plant": family.name,
        "kd": family.kd,
        "kp_unit": family.gain_unit,
        "ki_unit": f"{family.gain_unit}/s",
        "law": "u = u_trim + kp e + ki integral(e) dt - kd dy/dt",
        "bounded": region.bounded,
        "window": {"kp_low": window.kp_low, "kp_high": window.kp_high, "ki_high": window.ki_high},
        "kp_intervals_without_integral": [list(ends) for ends in region.kp_ends()],
        "boundary": [
            {"frequency_rad_s": float(w), "kp": float(p), "ki": float(i)}
            for w, p, i in zip(region.omega[at], region.kp[at], region.ki[at], strict=True)
        ],
        "points_of_curve": int(region.omega.size),
        "counted_at_kp": family.base,
        "unstable_roots_there": family.unstable,
    }
