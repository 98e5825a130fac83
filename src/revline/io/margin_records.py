"""Margins of a loop as a record for JSON, and in words."""

import math
from collections.abc import Mapping, Sequence

from revline.design.controllers.pid_controller import AnyPid, PidController
from revline.design.stability.margins import GainCrossover, Margins, PhaseCrossover
from revline.io.controller_surroundings import surroundings_record

MOST_CROSSOVERS = 12
"""A long delay makes hundreds of phase crossovers; a record lists this many of the lowest, and says how many there are."""


def margin_record(found: Margins, law: AnyPid) -> Mapping[str, object]:
    """Give margins as a record; what does not exist is left out.

    Args:
        found: the margins.
        law: gains alone, or the controller.
    """
    return {"loop": found.loop, "controller": controller_fields(law), **margin_fields(found)}


def controller_fields(law: AnyPid) -> dict[str, object]:
    """Give what a record of a loop says of the controller; beside its gains only what it has."""
    gains = law.gains if isinstance(law, PidController) else law
    fields = {"kp": gains.kp, "ki": gains.ki, "kd": gains.kd, "rule": gains.rule, "designed_on": gains.designed_on}
    return {**fields, **surroundings_record(law)} if isinstance(law, PidController) and law.extras else fields


def crossover_fields(gain: Sequence[GainCrossover], phase: Sequence[PhaseCrossover]) -> dict[str, object]:
    """Give crossovers as fields of a record, by rising frequency."""
    return {
        "gain_crossovers": [
            {"frequency_rad_s": c.frequency, "phase_margin_deg": c.phase_margin_deg, "delay_margin_s": c.delay_margin} for c in gain
        ],
        "phase_crossovers": [
            {"frequency_rad_s": c.frequency, "gain_margin": c.gain_margin, "gain_margin_db": c.gain_margin_db}
            for c in phase[:MOST_CROSSOVERS]
        ],
        "phase_crossovers_found": len(phase),
    }


def margin_fields(found: Margins) -> dict[str, object]:
    """Give the margins alone as fields of a record.

    Args:
        found: the margins.
    """
    record: dict[str, object] = {
        "stable": found.stable,
        **crossover_fields(found.gain_crossovers, found.phase_crossovers),
        "ms": found.sensitivity.value,
        "ms_frequency_rad_s": found.sensitivity.frequency,
        "mt": found.complementary.value,
        "mt_frequency_rad_s": found.complementary.frequency,
        "disk_margin": found.disk_margin,
        "searched_rad_s": list(found.searched),
        "frequencies_evaluated": found.points,
    }
    if math.isfinite(found.unstable_poles):
        record["unstable_poles"] = round(found.unstable_poles)
    if found.gain_rise is not None:
        record |= {"gain_margin": found.gain_rise.gain_margin, "gain_margin_db": found.gain_rise.gain_margin_db}
    if found.gain_fall is not None:
        record |= {"gain_reduction_margin": found.gain_fall.gain_margin, "gain_reduction_margin_db": found.gain_fall.gain_margin_db}
    if found.phase is not None:
        record["phase_margin_deg"] = found.phase.phase_margin_deg
    if found.delay is not None:
        record["delay_margin_s"] = found.delay.delay_margin
    return record


def describe_margins(found: Margins) -> list[tuple[str, float | str, str]]:
    """Give margins as rows of name, value and unit, for people."""
    rows: list[tuple[str, float | str, str]] = [("closed loop", "stable" if found.stable else "unstable", "")]
    if not found.stable:
        rows.append(("unstable poles", f"{found.unstable_poles:g}", ""))
    rise, fall, phase, delay = found.gain_rise, found.gain_fall, found.phase, found.delay
    up_to = f"none up to {found.searched[1]:.4g} rad/s"
    rows.append(("gain may rise by", up_to if rise is None else f"{rise.gain_margin:.4g} ({rise.gain_margin_db:.2f} dB)", ""))
    if fall is not None:
        rows.append(("gain may fall to", f"{fall.gain_margin:.4g} ({fall.gain_margin_db:.2f} dB)", ""))
    if phase is not None:
        rows.append(("phase margin", phase.phase_margin_deg, "deg"))
    if delay is not None:
        rows.append(("delay margin", 1e3 * delay.delay_margin, "ms"))
    alpha = found.disk_margin
    rows += [
        ("disk margin", alpha, "1"),
        ("peak sensitivity Ms", found.sensitivity.value, f"at {found.sensitivity.frequency:.4g} rad/s"),
        ("peak of the closed loop Mt", found.complementary.value, f"at {found.complementary.frequency:.4g} rad/s"),
    ]
    return rows
