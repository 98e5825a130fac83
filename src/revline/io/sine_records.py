"""What the answers to sinusoids hold beyond amplitude and phase, frequency by frequency, for JSON."""

from collections.abc import Mapping, Sequence

from revline.analysis.cross_check import simulation_error
from revline.analysis.harmonic_balance import HarmonicBalance
from revline.analysis.sinestream import Sinestream


def sine_fields(answers: HarmonicBalance | Sinestream) -> Sequence[Mapping[str, object]]:
    """Give harmonics, mean shift and estimated error of an engine's speed at each frequency.

    Args:
        answers: by harmonic balance or by simulation; of that the error is the fundamental's, whichever way amplitudes are read.
    """
    errors = answers.error + answers.last_step if isinstance(answers, HarmonicBalance) else simulation_error(answers)
    return [
        {"harmonics_rad_s": harmonics.tolist(), "mean_shift_rad_s": float(shift), "estimated_error": float(error)}
        for harmonics, shift, error in zip(answers.harmonics, answers.mean_shift, errors, strict=True)
    ]
