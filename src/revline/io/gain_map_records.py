"""Gains over a map of operating points as a record for JSON, and in words."""

from collections.abc import Mapping, Sequence

from revline.design.maps.gain_columns import GainColumns
from revline.design.maps.gain_map import GainMap, GainPoint, LostPoint, MapPoint
from revline.io.headers import header

SPEED = "engine_speed"


def gain_map_record(found: GainMap) -> Mapping[str, object]:
    """Give a map of gains as a record; what does not exist is left out.

    Args:
        found: the map.
    """
    grid, units = found.grid, found.units
    axes = ((grid.first, units[0], grid.first_values), (grid.second, units[1], grid.second_values))
    record: dict[str, object] = {
        "schema": "revline.gain-map/1",
        "engine": found.system,
        "axes": [{"name": name, "unit": unit, "values": values.tolist()} for name, unit, values in axes],
        "kd": found.kd,
        "kp_unit": found.gain_unit,
        "ki_unit": f"{found.gain_unit}/s",
        "kd_unit": f"{found.gain_unit} s",
        "law": "u = u_trim + kp e + ki integral(e) dt - kd dy/dt",
        "ms": found.peak,
        "partial": found.interrupted,
        "points": [_point_record(found, point) for point in found.points],
    }
    for key, common in (("common_stabilising", found.stable), ("common_ms", found.allowed)):
        if common is not None:
            record[key] = _common_record(common)
    if found.weakest is not None:
        record["weakest_point"] = _place(found, found.weakest)
    return record


def _place(found: GainMap, point: MapPoint) -> dict[str, object]:
    names = (found.grid.first, found.grid.second)
    return {header(name, unit): value for name, unit, value in zip(names, found.units, point.place, strict=True)}


def _point_record(found: GainMap, point: MapPoint) -> Mapping[str, object]:
    record = _place(found, point)
    if isinstance(point, LostPoint):
        return record | {"found": False, "reason": point.reason}
    region, trim = point.region, point.trim
    record |= {
        "found": True,
        "trim": {header(v.name, v.unit): trim.input(v.name) for v in trim.input_variables}
        | {header(v.name, v.unit): trim.output(v.name) for v in trim.output_variables if v.name == SPEED},
        "open_loop_unstable_roots": trim.unstable_count,
        "lags_s": trim.lags.tolist(),
        "kp_intervals_without_integral": [list(ends) for ends in region.kp_ends()],
        "bounded": region.bounded,
        "stabilising": intervals(point.stable),
        "ms_bounded": intervals(point.allowed),
    }
    if point.proportional_limit is not None:
        record["kp_limit"] = point.proportional_limit
    if not point.stable.empty:
        kp, ki = point.stable.highest
        record["largest_ki"] = {"kp": kp, "ki": ki}
    if point.best is not None:
        record["best"] = {"kp": point.best.kp, "ki": point.best.ki, "ms": point.best.peak}
    return record | ({"reason": point.reason} if point.reason else {})


def _common_record(common: GainColumns) -> Mapping[str, object]:
    record: dict[str, object] = {"empty": common.empty, "area": common.area, "intervals": intervals(common)}
    if not common.empty:
        kp, ki = common.highest
        record["largest_ki"] = {"kp": kp, "ki": ki}
    return record


def intervals(columns: GainColumns) -> list[list[float]]:
    """Give a set of gains as rows of kp, lowest ki and highest ki.

    Args:
        columns: the set.
    """
    ends = zip(columns.column, columns.low, columns.high, strict=True)
    return [[float(columns.kp[k]), float(low), float(high)] for k, low, high in ends]


def map_rows(found: GainMap) -> list[tuple[float | str, ...]]:
    """Give each point as cells: its place, the speed, open-loop roots, largest kp, and the best gains or why there are none."""
    return [_row(point) for point in found.points]


def _row(point: MapPoint) -> tuple[float | str, ...]:
    if isinstance(point, LostPoint):
        return (*point.place, "", "", "", "", "", point.reason)
    limit = point.proportional_limit
    shown: tuple[float | str, ...] = (point.best.kp, point.best.ki, f"Ms {point.best.peak:.4g}") if point.best else ("", "", point.reason)
    return (*point.place, _speed(point), str(point.trim.unstable_count), "none" if limit is None else limit, *shown)


def _speed(point: GainPoint) -> float | str:
    names = [variable.name for variable in point.trim.output_variables]
    return point.trim.output(SPEED) if SPEED in names else ""


def common_rows(found: GainMap) -> Sequence[tuple[str, float | str, str]]:
    """Give what all points have in common as rows of name, value and unit, for people."""
    rows: list[tuple[str, float | str, str]] = []
    unit = found.gain_unit
    for text, common in (("stabilises", found.stable), (f"keeps Ms {found.peak:g}", found.allowed)):
        if common is None or common.empty:
            rows.append((f"what {text} at all of them", "nothing", ""))
            continue
        kp, ki = common.highest
        rows.append((f"what {text} at all of them: ki up to", ki, f"{unit}/s, at kp = {kp:.4g}"))
        rows.append(("  its size", common.area, f"({unit})2/s"))
    weakest = found.weakest
    if weakest is not None:
        rows.append(("weakest point", found.words(weakest.place), ""))
    return rows
