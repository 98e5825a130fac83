"""The verdict on linearity, and the spectra that it rests on, as records for JSON and as CSV."""

from collections.abc import Mapping

from revline.analysis.linearity import LinearityVerdict


def linearity_record(verdict: LinearityVerdict) -> Mapping[str, object]:
    """Give the verdict on linearity as a record.

    Args:
        verdict: of `judge_linearity`.
    """
    return {
        "verdict": verdict.text,
        "follows": verdict.follows,
        "distortion_limit": verdict.distortion_limit,
        "largest_distortion": verdict.largest_distortion,
        "largest_at_rad_s": verdict.where,
        "ranges_rad_s": [list(ends) for ends in verdict.ranges],
    }
