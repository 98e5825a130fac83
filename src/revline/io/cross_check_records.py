"""The cross-check of a frequency response as a record for JSON, and in words."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from revline.analysis.cross_check import CrossCheck
from revline.analysis.routes import ResponseDifference, RouteComparison
from revline.analysis.turn_check import TurnCheck


def cross_check_record(found: CrossCheck, effect: ResponseDifference | None = None) -> Mapping[str, object]:
    """Give a cross-check as a record: what is not there is left out.

    Args:
        found: the cross-check.
        effect: of the amplitude: the exact small-signal response and the one at the amplitude.
    """
    record: dict[str, object] = {
        "agreed": found.agreed,
        "checked": bool(found.comparisons),
        "comparisons": [_comparison_record(comparison) for comparison in found.comparisons],
        "unchecked": [
            {"routes": list(left.routes), "frequencies_rad_s": left.omega.tolist(), "reason": left.reason} for left in found.unchecked
        ],
    }
    if found.falls_by.size:
        record["difference_falls_with_power_of_amplitude"] = [float(found.falls_by.min()), float(found.falls_by.max())]
    if effect is not None:
        rows = zip(effect.omega.tolist(), effect.magnitude.tolist(), effect.phase_deg.tolist(), strict=True)
        record["effect_of_amplitude"] = {
            "routes": list(effect.routes),
            **_largest(effect),
            "rows": [{"frequency_rad_s": w, "magnitude_difference": m, "phase_difference_deg": p} for w, m, p in rows],
        }
    return record


def describe_cross_check(found: CrossCheck, effect: ResponseDifference | None = None) -> tuple[str, ...]:
    """Give a cross-check as lines for people.

    Args:
        found: the cross-check.
        effect: of the amplitude, as for `cross_check_record`.
    """
    lines = []
    for comparison in found.comparisons:
        difference, k = comparison.difference, comparison.worst
        verb = "agrees" if comparison.agreed else "DISAGREES"
        lines.append(
            f"cross-check: {difference.routes[0]} {verb} with {difference.routes[1]} at "
            f"{_count(int(np.sum(~comparison.disagreeing)), difference.omega.size)}: at most "
            f"{np.max(np.abs(difference.magnitude)):.2g} of the magnitude and {np.max(np.abs(difference.phase_deg)):.2g} deg apart; at "
            f"{difference.omega[k]:.4g} rad/s, where it is closest to it, {comparison.tolerance[k]:.2g} and "
            f"{comparison.tolerance_deg[k]:.2g} deg are allowed"
        )
    if effect is not None:
        k, j = int(np.argmax(np.abs(effect.magnitude))), int(np.argmax(np.abs(effect.phase_deg)))
        lines.append(
            f"effect of the amplitude: the exact small-signal response is up to {100.0 * effect.magnitude[k]:+.2g} % off this one, at "
            f"{effect.omega[k]:.4g} rad/s, and up to {effect.phase_deg[j]:+.2g} deg, at {effect.omega[j]:.4g} rad/s"
        )
    return tuple(lines)


def turn_record(found: TurnCheck) -> Mapping[str, object]:
    """Give a check of the phases' whole turns as a record.

    Args:
        found: the check.
    """
    return {"agreed": found.agreed, "orbits": found.orbits, "differ_at_rad_s": found.omega[found.turns != 0].tolist()}


def describe_turns(found: TurnCheck) -> str:
    """Give a check of the phases' whole turns as a line for people.

    Args:
        found: the check.
    """
    verb = "are" if found.agreed else "are NOT"
    agreeing = int(np.sum(found.turns == 0))
    return (
        f"cross-check: the whole turns of the phase {verb} those counted along {found.orbits} small orbits from low frequency on, at "
        f"{_count(agreeing, found.omega.size)}"
    )


def _count(agreeing: int, total: int) -> str:
    return f"all {total} frequencies looked at" if agreeing == total else f"{agreeing} of {total} frequencies"


def _comparison_record(comparison: RouteComparison) -> Mapping[str, object]:
    difference, k = comparison.difference, comparison.worst
    rows: list[Mapping[str, Any]] = [
        {
            "frequency_rad_s": float(difference.omega[i]),
            "magnitude_difference": float(difference.magnitude[i]),
            "phase_difference_deg": float(difference.phase_deg[i]),
            "tolerance": float(comparison.tolerance[i]),
            "tolerance_deg": float(comparison.tolerance_deg[i]),
            "input_amplitude": float(comparison.amplitude[i]),
        }
        for i in range(difference.omega.size)
    ]
    return {
        "routes": list(difference.routes),
        "agreed": comparison.agreed,
        **_largest(difference),
        "largest_part_of_tolerance": float(comparison.used[k]),
        "largest_part_of_tolerance_at_rad_s": float(difference.omega[k]),
        "largest_tolerance": float(comparison.tolerance.max()),
        "rows": rows,
    }


def _largest(difference: ResponseDifference) -> Mapping[str, float]:
    """The largest differences, with their signs, and where they are."""
    k, j = int(np.argmax(np.abs(difference.magnitude))), int(np.argmax(np.abs(difference.phase_deg)))
    return {
        "largest_magnitude_difference": float(difference.magnitude[k]),
        "largest_magnitude_difference_at_rad_s": float(difference.omega[k]),
        "largest_phase_difference_deg": float(difference.phase_deg[j]),
        "largest_phase_difference_at_rad_s": float(difference.omega[j]),
    }
