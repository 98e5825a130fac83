"""Margins of a sampled response as a record for JSON, and in words."""

import math
from collections.abc import Mapping

from revline.design.controllers.controller import PidGains
from revline.design.stability.sampled_margins import SampledMargins
from revline.io.margin_records import controller_fields, crossover_fields

_ROWS = (
    ("gain_margin", "gain may rise by", 1.0, ""),
    ("gain_reduction_margin", "gain may fall to", 1.0, ""),
    ("phase_margin_deg", "phase margin", 1.0, "deg"),
    ("delay_margin_s", "delay margin", 1e3, "ms"),
    ("disk_margin", "disk margin", 1.0, "at most"),
    ("ms", "peak sensitivity Ms", 1.0, "at least"),
    ("mt", "peak of the closed loop Mt", 1.0, "at least"),
)


def sampled_margin_record(found: SampledMargins, gains: PidGains) -> Mapping[str, object]:
    """Give margins of a sampled response as a record, with the names of exact margins; what is not known is left out.

    Args:
        found: the margins.
        gains: of the controller.
    """
    record: dict[str, object] = {
        "loop": found.loop,
        "controller": controller_fields(gains),
        "sampled": True,
        "band_rad_s": list(found.band),
        "samples": found.samples,
        **crossover_fields(found.gain_crossovers, found.phase_crossovers),
        **found.values,
        "ms_frequency_rad_s": found.sensitivity.frequency,
        "mt_frequency_rad_s": found.complementary.frequency,
        "errors": dict(found.errors),
        "assumed_unstable_poles": found.assumed_unstable_poles,
        "notes": list(found.notes),
    }
    for key in ("gain_margin", "gain_reduction_margin"):
        if key in found.values:
            record[f"{key}_db"] = 20.0 * math.log10(found.values[key])
    if found.unstable_poles:
        record["unstable_poles_if_assumed"] = found.unstable_poles[0]
    return record


def describe_sampled_margins(found: SampledMargins) -> list[tuple[str, float | str, str]]:
    """Give margins of a sampled response as rows of name, value with estimated error, and unit, for people."""
    rows: list[tuple[str, float | str, str]] = [("samples", f"{found.samples}, {found.band[0]:.4g} to {found.band[1]:.4g} rad/s", "")]
    rows.append(("unstable poles", f"{found.unstable_poles[0]} if the notes hold" if found.unstable_poles else "not counted", ""))
    for key, name, factor, unit in _ROWS:
        if key not in found.values:
            rows.append((name, "not known from this band", ""))
            continue
        error = f" +- {factor * found.errors[key]:.1g}" if key in found.errors else " (error not known)"
        rows.append((name, f"{factor * found.values[key]:.5g}{error}", unit))
    return rows
