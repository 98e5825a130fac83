"""Ultimate points by every way as records for JSON."""

from collections.abc import Mapping
from typing import Final

from revline.design.tuning.ultimate import UltimatePoint
from revline.design.tuning.ultimate_comparison import UltimateComparison

SCHEMA: Final = "revline.ultimate/1"


def ultimate_record(
    found: UltimateComparison, *, engine: str, place: tuple[float, float], provenance: Mapping[str, float | str]
) -> Mapping[str, object]:
    """Give the ultimate point by every way, with the reasons for their differences.

    Args:
        found: the comparison.
        engine: name of the engine.
        place: throttle angle in deg and load torque in N m.
        provenance: what writes it, from what.
    """
    relay = found.relay
    return {
        "schema": SCHEMA,
        "engine": engine,
        "throttle_deg": place[0],
        "load_nm": place[1],
        "unit": found.unit,
        "exact": _point(found.exact),
        "exact_sampled": {**_point(found.sampled), "sampling_period_s": found.sampling_period},
        "relay_predicted": {"gain": found.predicted.gain, "period_s": found.predicted.period, "amplitude_rad_s": found.predicted.amplitude},
        "relay": {
            **_point(relay.ultimate),
            "relay_amplitude_deg": relay.task.amplitude,
            "hysteresis_rad_s": relay.task.hysteresis,
            "amplitude_rad_s": relay.amplitude,
            "fundamental_rad_s": relay.fundamental,
            "gain_by_fundamental": relay.gain_by_fundamental,
            "mean_shift_rad_s": relay.mean_shift,
            "duty": relay.duty,
            "spread": relay.spread,
        },
        "bisection": {
            **_point(found.bisection),
            "rests_at": found.bisected.factor * found.bisected_gain,
            "hunts_at": found.bisected.hunts * found.bisected_gain,
            "runs": found.bisected.runs,
        },
        "reasons": list(found.reasons),
        "provenance": provenance,
    }


def _point(point: UltimatePoint) -> Mapping[str, object]:
    return {"gain": point.gain, "period_s": point.period, "frequency_rad_s": point.frequency}
