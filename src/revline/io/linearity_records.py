"""The verdict on linearity, and the spectra that it rests on, as records for JSON and as CSV."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.linearity import LinearityVerdict
from revline.analysis.spectrum import SpectralCheck
from revline.io.csv_text import format_csv

SCALING = "single-sided, by the record's length before zero-padding, doubled except at 0 and Nyquist, no window, speed less that at rest"
"""How amplitudes of spectra are scaled. Source: Lee (1995), chapter 4."""


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


def spectra_rows(checks: Sequence[SpectralCheck]) -> list[dict[str, float | bool]]:
    """Give what the spectra of speeds under sinusoids show, row by row.

    Args:
        checks: of an engine's speed.
    """
    return [
        {
            "frequency_rad_s": check.omega,
            "peak_rad_s": check.spectrum.peak_omega,
            "peak_amplitude_rad_s": check.spectrum.peak_amplitude,
            "zero_line_rad_s": check.spectrum.zero_line,
            "resolution_rad_s": check.spectrum.resolution,
            "distortion": check.distortion,
            "follows": check.follows,
            "periods": check.cycles,
            "samples_per_period": check.samples_per_cycle,
            "padded_samples": check.spectrum.padded,
        }
        for check in checks
    ]


def format_spectra(checks: Sequence[SpectralCheck], *, notes: Mapping[str, str | float]) -> str:
    """Format spectra as CSV, one below the other: a row for each line of each, with the frequency of its sinusoid in front.

    Args:
        checks: of an engine's speed.
        notes: what the comment lines say, by key.
    """
    columns: list[tuple[str, ArrayLike]] = [
        ("input_frequency_rad_s", np.concatenate([np.full(check.spectrum.omega.size, check.omega) for check in checks])),
        ("frequency_rad_s", np.concatenate([check.spectrum.omega for check in checks])),
        ("amplitude_rad_s", np.concatenate([check.spectrum.amplitude for check in checks])),
    ]
    return format_csv(columns, notes={**notes, "scaling": SCALING})
