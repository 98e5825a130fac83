"""Fixed gains over a box of operating points, the limit of such boxes, and schedules, as records for JSON and in words."""

import math
from collections.abc import Mapping

import numpy as np

from revline.design.maps.gain_box import BoxGains
from revline.design.maps.gain_box_limit import BoxLimit, Ruled
from revline.design.maps.gain_map import GainMap
from revline.design.maps.operating_box import Box
from revline.design.maps.schedule_design import ScheduleResult
from revline.io.headers import header
from revline.io.schedule_files import table_record

Rows = list[tuple[str, float | str, str]]


def _keys(found: GainMap) -> tuple[str, str]:
    return header(found.grid.first, found.units[0]), header(found.grid.second, found.units[1])


def _box(found: GainMap, box: Box) -> Mapping[str, list[float]]:
    first, second = _keys(found)
    return {first: [box.first_low, box.first_high], second: [box.second_low, box.second_high]}


def _place(found: GainMap, place: tuple[float, float]) -> Mapping[str, float]:
    return dict(zip(_keys(found), place, strict=True))


def box_record(found: GainMap, gains: BoxGains, limit: BoxLimit | None = None) -> Mapping[str, object]:
    """Give fixed gains, the box of operating points that they hold, and what no larger box can do, as a record.

    Args:
        found: the map.
        gains: in the largest box found.
        limit: proofs for larger boxes, where they were sought.
    """
    record: dict[str, object] = {
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "box": _box(found, gains.box),
        "share_of_map": gains.share,
        "floor": {"share_of_best_ki": gains.floor.share, "ki": gains.floor.ki},
        "worst_ms": gains.worst,
        "worst_at": _place(found, gains.worst_at),
        "smallest_ki_over_floor": gains.tightest,
        "points_tried": gains.tried,
    }
    if limit is not None:
        record["limit"] = {
            "share_of_map": limit.share,
            "largest_box_not_ruled_out": _box(found, limit.largest),
            "kd_low": limit.kd[0],
            "kd_high": limit.kd[1],
            "complete": limit.complete,
            "parts": limit.parts,
            "proofs": [_ruled_record(found, ruled) for ruled in limit.ruled],
        }
    return record


def _ruled_record(found: GainMap, ruled: Ruled) -> Mapping[str, object]:
    gains, proof = ruled.proof.box, ruled.proof
    return {
        "box": _box(found, ruled.box),
        "points": [_place(found, place) for place in ruled.places],
        "smallest_ki": ruled.floor_ki,
        "gains": {
            "kp": [gains.kp_low, gains.kp_high],
            "ki": [gains.ki_low, gains.ki_high],
            "kd": [gains.kd_low, gains.kd_high],
        },
        "cells": proof.cells,
        "cells_above_ms": proof.by_peak,
        "cells_unstable": proof.unstable,
    }


def box_rows(found: GainMap, gains: BoxGains, limit: BoxLimit | None = None) -> Rows:
    """Give the same as rows of name, value and unit, for people."""
    unit, box = found.gain_unit, gains.box
    names = (found.grid.first, found.grid.second)
    rows: Rows = [
        (names[0], f"{box.first_low:.4g} to {box.first_high:.4g}", found.units[0]),
        (names[1], f"{box.second_low:.4g} to {box.second_high:.4g}", found.units[1]),
        ("share of the map", f"{100.0 * gains.share:.3g} %", ""),
        ("kp", gains.kp, unit),
        ("ki", gains.ki, f"{unit}/s"),
        ("kd", gains.kd, f"{unit} s"),
        ("highest Ms", gains.worst, f"at {found.words(gains.worst_at)}, of {gains.tried} points tried"),
        ("ki over the floor", gains.tightest, "at least"),
    ]
    if limit is not None:
        kd = f"kd = {limit.kd[0]:g}" if limit.kd[0] == limit.kd[1] else f"any kd from {limit.kd[0]:g} to {limit.kd[1]:g}"
        words = f"of the map; {len(limit.ruled)} proofs, {kd}" + ("" if limit.complete else "; it could not be brought nearer")
        rows.append(("no box has more than", f"{100.0 * limit.share:.3g} %", words))
    return rows


def schedule_record(found: GainMap, result: ScheduleResult) -> Mapping[str, object]:
    """Give a schedule and its evidence as a record.

    Args:
        found: the map that it was designed on.
        result: the schedule.
    """
    record: dict[str, object] = {
        **table_record(result.schedule),
        "criterion": "largest ki at the peak ms_at_nodes",
        "ms_at_nodes": result.node_peak,
        "ms": result.peak,
        "worst_ms": result.worst,
        "worst_at": _place(found, result.worst_at),
        "search_error": result.search_error,
        "points_tried": len(result.tried),
        "points_lost": [dict(_place(found, point.place)) | {"reason": point.reason} for point in result.lost],
    }
    if math.isfinite(result.slowest):
        record["slow_enough"] = {"rate_of_first_axis_per_s": result.slowest, "at": _place(found, result.slowest_at)}
    return record


def schedule_rows(found: GainMap, result: ScheduleResult) -> Rows:
    """Give the same as rows of name, value and unit, for people."""
    schedule = result.schedule
    rows: Rows = [
        ("nodes", f"{schedule.first.size} x {schedule.second.size}", f"over {schedule.names[0]} and {schedule.names[1]}"),
        ("kp", f"{np.min(schedule.kp):.4g} to {np.max(schedule.kp):.4g}", schedule.gain_unit),
        ("ki", f"{np.min(schedule.ki):.4g} to {np.max(schedule.ki):.4g}", f"{schedule.gain_unit}/s"),
        ("Ms at the nodes", result.node_peak, ""),
        ("highest Ms", result.worst, f"at {found.words(result.worst_at)}, of {len(result.tried)} points tried"),
        ("error of that search", result.search_error, ""),
    ]
    if math.isfinite(result.slowest):
        unit = f"{schedule.units[0]} per s" if "/" in schedule.units[0] else f"{schedule.units[0]}/s"
        rows.append(("moves slowly below", result.slowest, f"{unit}, at {found.words(result.slowest_at)}"))
    return rows
