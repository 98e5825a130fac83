"""The nu-gap, and what a controller is guaranteed by it, as records for JSON, as columns for CSV, and in words."""

import math
from collections.abc import Mapping

from revline.design.stability.nu_gap import Guarantee, NuGap
from revline.io.csv_text import format_csv
from revline.io.headers import header

SCHEMA = "revline.nu-gap/1"

Rows = list[tuple[str, float | str, str]]


def gap_record(gap: NuGap) -> dict[str, object]:
    """Give a nu-gap as a record.

    Args:
        gap: between two plants.
    """
    return {
        "schema": SCHEMA,
        "first": gap.first,
        "second": gap.second,
        "weight": gap.weight,
        "gap": gap.value,
        "gap_bound": gap.bound,
        "largest_chord": gap.longest,
        "frequency_rad_s": gap.frequency,
        "winding": gap.winding,
        "searched_rad_s": [float(gap.omega[0]), float(gap.omega[-1])],
        "frequencies_evaluated": gap.omega.size,
    }


def guarantee_record(found: Guarantee, controller: str) -> dict[str, object]:
    """Give what a controller is guaranteed as a record; a margin that an unstable loop has not is left out.

    Args:
        found: the verdict.
        controller: its name.
    """
    gains = found.gains
    record = gap_record(found.gap) | {
        "controller": {"name": controller, "kp": gains.kp, "ki": gains.ki, "kd": gains.kd, "rule": gains.rule},
        "first_stable": found.unstable_poles[0] == 0,
        "second_stable": found.stable,
        "guaranteed": found.guaranteed,
        "guaranteed_by_frequency": found.guaranteed_pointwise,
        "summary": summarise(found, controller),
    }
    for name, count in zip(("first", "second"), found.unstable_poles, strict=True):
        if math.isfinite(count):
            record[f"{name}_unstable_poles"] = round(count)
    if found.unstable_poles[0] == 0:
        record |= {"margin": found.margin, "margin_bound": found.assured, "margin_frequency_rad_s": found.margin_frequency}
    if found.guaranteed:
        record["margin_floor"] = found.floor
    if found.guaranteed_pointwise:
        record |= {"margin_floor_by_frequency": found.pointwise_floor, "closest_frequency_rad_s": found.reserve_frequency}
    if found.stable:
        record["second_margin"] = found.other_margin
    return record


def describe_gap(gap: NuGap) -> Rows:
    """Give a nu-gap as rows of name, value and unit, for people."""
    at = f"at {gap.frequency:.4g} rad/s"
    rows: Rows = [("nu-gap", f"{gap.value:.4g}", "" if gap.winding else at)]
    if gap.winding:
        rows += [("longest chord", f"{gap.longest:.4g}", at), ("winding number", f"{gap.winding:+d}", "0 where the curves turn alike")]
    return [*rows, ("weight", gap.weight, "")]


def describe_guarantee(found: Guarantee) -> Rows:
    """Give what a controller is guaranteed as rows of name, value and unit, for people."""
    rows = describe_gap(found.gap)
    where = f"at {found.margin_frequency:.4g} rad/s" if found.margin_frequency < found.gap.omega[-1] else "at high frequency"
    rows.append((f"margin on {found.gap.first}", f"{found.margin:.4g}", where if found.unstable_poles[0] == 0 else "the loop is unstable"))
    rows.append(("guaranteed", "yes" if found.guaranteed else "no", ""))
    if found.guaranteed:
        rows.append((f"margin on {found.gap.second}, at least", f"{found.floor:.4g}", ""))
    if found.guaranteed_pointwise:
        rows.append(("the same, frequency by frequency", f"{found.pointwise_floor:.4g}", f"least at {found.reserve_frequency:.4g} rad/s"))
    rows.append((f"margin on {found.gap.second}, true", f"{found.other_margin:.4g}", "" if found.stable else "the loop is unstable"))
    return rows


def summarise(found: Guarantee, controller: str) -> str:
    """Say in a sentence what the gap guarantees, and what is so.

    Args:
        found: the verdict.
        controller: its name.
    """
    gap, first, second = found.gap, found.gap.first, found.gap.second
    count = (
        f"{found.unstable_poles[1]:g} poles right of the axis"
        if math.isfinite(found.unstable_poles[1])
        else "infinitely many poles right of the axis"
    )
    truth = f"by its own count the loop there is {'stable' if found.stable else f'unstable, with {count}'}"
    nothing = f"{first} says nothing about this loop on {second}; {truth}"
    if found.unstable_poles[0] != 0:
        return f"{controller} does not stabilise {first} itself: {nothing}"
    if found.guaranteed:
        reason = f"the nu-gap {gap.value:.3g} is below {controller}'s margin {found.margin:.3g} on {first}"
        return f"{reason}: it is sure to stabilise {second}, with a margin of at least {found.floor:.3g}; it has {found.other_margin:.3g}"
    if found.guaranteed_pointwise:
        reason = f"the nu-gap {gap.value:.3g} is not below {controller}'s margin {found.margin:.3g} on {first}"
        floor = f"with a margin of at least {found.pointwise_floor:.3g}"
        return f"{reason}, but at each frequency the chord is below the loop's own: it is sure to stabilise {second}, {floor}"
    if gap.winding:
        return f"the nu-gap is 1, as the curves of {first} and {second} do not turn alike: {nothing}"
    if gap.value < found.margin:
        reason = f"the nu-gap {gap.value:.3g} is so near to {controller}'s margin {found.margin:.3g} on {first}"
        return f"{reason} that what lies beyond {gap.omega[-1]:.3g} rad/s decides: {nothing}"
    return f"the nu-gap {gap.value:.3g} exceeds {controller}'s margin {found.margin:.3g} on {first}: {nothing}"


def format_gap(found: Guarantee | NuGap) -> str:
    """Give the chord over frequency, and the chord to oscillation where there is a controller, as CSV."""
    gap = found if isinstance(found, NuGap) else found.gap
    columns = [(header("frequency", "rad/s"), gap.omega), (header("chord", "1"), gap.psi)]
    notes: Mapping[str, str | float] = {"first": gap.first, "second": gap.second, "weight": gap.weight, "nu-gap": gap.value}
    if isinstance(found, Guarantee):
        columns.append((header("chord_to_oscillation", "1"), found.chords))
        notes = {**notes, "margin": found.margin}
    return format_csv(columns, notes=notes)
