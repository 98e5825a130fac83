"""Stabilising gains as records for JSON, as columns for CSV, and in words."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from revline.design.loops.outcome import LimitCycle
from revline.design.regions.gain_rays import Crossing
from revline.design.regions.gain_region import GainRegion
from revline.design.regions.gain_slices import GainSlice, LargestKd, Placed
from revline.design.regions.nonlinear_boundary import BoundaryPoint, NonlinearBoundary
from revline.design.regions.sensitivity_contour import SensitivityContour
from revline.io.csv_text import format_csv
from revline.io.headers import header


def slices_record(slices: Sequence[GainSlice], *, largest: LargestKd | None = None) -> Mapping[str, object]:
    """Give slices of stabilising gains as one record: the first slice's own fields, and all slices where there are several.

    Args:
        slices: at least one.
        largest: how far kd may rise, where it was sought.
    """
    record: dict[str, object] = {"schema": "revline.region/1", **slice_record(slices[0])}
    if len(slices) > 1:
        record["slices"] = [slice_record(entry) for entry in slices]
    if largest is not None:
        found: dict[str, object] = {"stabilised": largest.stabilised, "unit": f"{slices[0].region.family.gain_unit} s"}
        if math.isfinite(largest.lost):
            found |= {"lost": largest.lost, "reason": largest.reason}
        record["largest_kd"] = found
    return record


def slice_record(entry: GainSlice) -> Mapping[str, object]:
    """Give the gains of one kd as a record.

    Args:
        entry: the slice.
    """
    record = dict(region_record(entry.region))
    if entry.contours:
        record["ms_contours"] = [_contour_record(contour) for contour in entry.contours]
    for damped in entry.damped:
        contour = damped.family.contour
        found: dict[str, object] = {
            "damping": contour.damping,
            "area": {"value": damped.area.value, "error": damped.area.error},
            "boundary": _boundary(damped),
            "kp_intervals_without_integral": [list(ends) for ends in damped.kp_ends()],
        }
        if math.isfinite(contour.up_to):
            found |= {"up_to_rad_s": contour.up_to, "decay_1_s": contour.decay}
        record["damped"] = found
    if entry.placed:
        record["controllers"] = [_placed_record(placed, with_damping=bool(entry.damped)) for placed in entry.placed]
    return record


def region_record(region: GainRegion) -> Mapping[str, object]:
    """Give a region of stabilising gains as a record: its boundary point by point, and what it was found from.

    Args:
        region: the gains.
    """
    family, window, area = region.family, region.window, region.area
    return {
        "plant": family.name,
        "kd": family.kd,
        "kp_unit": family.gain_unit,
        "ki_unit": f"{family.gain_unit}/s",
        "law": "u = u_trim + kp e + ki integral(e) dt - kd dy/dt",
        "bounded": region.bounded,
        "window": {"kp_low": window.kp_low, "kp_high": window.kp_high, "ki_high": window.ki_high},
        "area_in_window": {"value": area.value, "error": area.error},
        "kp_intervals_without_integral": [list(ends) for ends in region.kp_ends()],
        "boundary": _boundary(region),
        "points_of_curve": int(region.omega.size),
        "counted_at_kp": family.base,
        "unstable_roots_there": family.unstable,
    }


def boundary_record(found: NonlinearBoundary) -> Mapping[str, object]:
    """Give the boundary by simulation as a record; what does not exist is left out.

    Args:
        found: the boundary.
    """
    record: dict[str, object] = {
        "plant": found.plant,
        "kd": found.case.kd,
        "command": found.case.command,
        "limits": [found.case.limits.low, found.case.limits.high],
        "throttle_at_start_deg": found.start,
        "throttle_at_target_deg": found.target,
        "linear_plant": found.linear.family.name,
        "points": [_point_record(point) for point in found.points],
        "largest_difference": found.largest_difference,
        "tolerance": found.search.tolerance,
        "longest_run_s": found.search.longest,
    }
    if found.lost:
        record["lost"] = [{"kp": ray.kp, "ki": ray.ki, "reason": ray.reason} for ray in found.lost]
    return record


def region_csv(slices: Sequence[GainSlice]) -> str:
    """Write all boundaries and contours as CSV: on the boundary of stability damping and 1/Ms are 0.

    Args:
        slices: at least one.
    """
    rows: list[tuple[float, float, float, float, float, float]] = []
    for entry in slices:
        kd = entry.region.family.kd
        for region in (entry.region, *entry.damped):
            at = np.flatnonzero(region.rim)
            zeta = region.family.contour.damping
            rows += [
                (kd, zeta, 0.0, float(w), float(p), float(i))
                for w, p, i in zip(region.omega[at], region.kp[at], region.ki[at], strict=True)
            ]
        for contour in entry.contours:
            rows += [
                (kd, 0.0, 1.0 / contour.peak, float(w), float(p), float(i))
                for w, p, i in zip(contour.omega, contour.kp, contour.ki, strict=True)
            ]
    unit = slices[0].region.family.gain_unit
    names = (header("kd", f"{unit} s"), "damping_1", "inverse_ms_1", "frequency_rad_s", header("kp", unit), header("ki", f"{unit}/s"))
    table = np.array(rows, dtype=float).reshape(-1, len(names))
    notes = {"plant": slices[0].region.family.name, "law": "u = u_trim + kp e + ki integral(e) dt - kd dy/dt"}
    return format_csv([(name, table[:, k]) for k, name in enumerate(names)], notes=notes)


def _boundary(region: GainRegion) -> list[Mapping[str, float]]:
    at = np.flatnonzero(region.rim)
    return [
        {"frequency_rad_s": float(w), "kp": float(p), "ki": float(i)}
        for w, p, i in zip(region.omega[at], region.kp[at], region.ki[at], strict=True)
    ]


def _contour_record(contour: SensitivityContour) -> Mapping[str, object]:
    return {
        "ms": contour.peak,
        "largest_deviation": contour.deviation,
        "points": [
            {"frequency_rad_s": float(w), "kp": float(p), "ki": float(i), "piece": int(k)}
            for w, p, i, k in zip(contour.omega, contour.kp, contour.ki, contour.piece, strict=True)
        ],
    }


def _placed_record(placed: Placed, *, with_damping: bool) -> Mapping[str, object]:
    gains, place = placed.mark, placed.place
    record: dict[str, object] = {
        "name": placed.mark.name,
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "inside": place.inside,
        "unstable_roots": place.unstable,
    }
    for key, crossing in (("rise", place.rise), ("fall", place.fall)):
        if crossing is not None:
            record[key] = _crossing_record(crossing)
    if place.inside:
        record["ms"] = placed.peak
    if with_damping:
        record["damped"] = placed.damped
    return record


def _crossing_record(crossing: Crossing) -> Mapping[str, object]:
    return {"factor": crossing.factor, "frequency_rad_s": crossing.frequency, "unstable_roots_change": crossing.change}


def _point_record(point: BoundaryPoint) -> Mapping[str, object]:
    record: dict[str, object] = {
        "kp": point.kp,
        "ki": point.ki,
        "linear_frequency_rad_s": point.frequency,
        "settled_factor": point.settled,
        "unsettled_factor": point.unsettled,
        "outcome": point.outcome.name,
        "runs": point.runs,
    }
    if isinstance(point.outcome, LimitCycle):
        record |= {"frequency_rad_s": 2.0 * math.pi / point.outcome.period, "low": point.outcome.low, "high": point.outcome.high}
    if point.undecided:
        record["undecided_factors"] = list(point.undecided)
    return record


def describe_slice(entry: GainSlice) -> list[tuple[str, float | str, str]]:
    """Give a slice as rows of name, value and unit, for people."""
    region = entry.region
    unit = region.family.gain_unit
    rows: list[tuple[str, float | str, str]] = [
        ("kp without integral", f"{low + 0.0:.5g} to {high + 0.0:.5g}", unit) for low, high in region.kp_ends()
    ] or [("kp without integral", "none stabilises", "")]
    if region.rim.any():
        top = int(region.ki[region.rim].argmax())
        kp, ki, omega = (float(array[region.rim][top]) for array in (region.kp, region.ki, region.omega))
        rows.append(("largest ki", ki, f"{unit}/s, at kp = {kp:.4g}, oscillating at {omega:.4g} rad/s"))
    if region.area.value > 0.0:
        rows.append(("within the window", "all of them" if region.bounded else "not all: they go on beyond it", ""))
    rows.append(("area in the window", region.area.value, f"({unit})2/s"))
    rows.append(("points of the boundary", f"{int(region.rim.sum())}", ""))
    beyond = "" if region.bounded else ", in the window"
    for contour in entry.contours:
        if not contour.omega.size:
            rows.append((f"Ms = {contour.peak:g}", "no gains are so gentle", ""))
            continue
        best = int(contour.ki.argmax())
        place = f"{unit}/s, at kp = {contour.kp[best]:.4g}"
        rows.append((f"largest ki with Ms = {contour.peak:g}{beyond}", float(contour.ki[best]), place))
    for damped in entry.damped:
        contour_of = damped.family.contour
        upto = f" up to {contour_of.up_to:.4g} rad/s" if math.isfinite(contour_of.up_to) else ""
        share = damped.area.value / region.area.value if region.area.value > 0.0 else 0.0
        rows.append((f"damping {contour_of.damping:g}{upto}", f"{100.0 * share:.1f} %", "of that area"))
    return rows


def describe_placed(entry: GainSlice, placed: Placed) -> tuple[str, str, str, str]:
    """Give a controller's place in a slice as cells: name, whether it is inside, how far its gains may go, and Ms."""
    place = placed.place
    words = []
    if place.rise is not None:
        words.append(f"up to {place.rise.factor:.4g} times, at {place.rise.frequency:.4g} rad/s")
    if place.fall is not None:
        words.append(f"down to {place.fall.factor:.4g} times, at {place.fall.frequency:.4g} rad/s")
    inside = "inside" if place.inside else f"outside, {place.unstable} unstable roots"
    if place.inside and entry.damped:
        inside += f", damped {'at least' if placed.damped else 'less than'} {entry.damped[0].family.contour.damping:g}"
    return placed.mark.name, inside, "; ".join(words) or "no crossing", f"{placed.peak:.4g}" if place.inside else ""
