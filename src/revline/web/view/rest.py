"""Operating point and steady map of a view."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import numpy as np

from revline.analysis.operating_range import find_operating_range
from revline.analysis.steady_map import SteadyMap, find_steady_map
from revline.errors import AnalysisError
from revline.io.point_records import line_record, trim_record, trim_warnings
from revline.web.plants import find_engine, find_point, place_of
from revline.web.state import State
from revline.web.view.drawing import drawn

ANGLES: Final = 46
"""So many throttle angles has the map of a view: every 2 deg."""

TOLERANCE: Final = 0.01
"""Largest error of the straight line, as a fraction of its span. Source: the study's choice."""


def view_point(state: State) -> Mapping[str, Any]:
    """Give the operating point as `revline trim --json` does."""
    point = find_point(place_of(state))
    remarks = [*trim_warnings(point.trim), *(str(kink) for kink in point.linear.kinks)]
    return {**trim_record(point.trim, point.linear.model), "warnings": remarks}


def view_validity(state: State) -> Mapping[str, Any]:
    """Say what limits the linear model here: kinks, limits of the equations near by, a drift, other steady states."""
    linear = find_point(place_of(state)).linear
    return {"warnings": list(linear.warnings(linear.find_limits()))}


def view_map(state: State) -> Mapping[str, Any]:
    """Give the steady speeds over the throttle, where they end, and the widest straight line through them about the operating point."""
    found = _map(state.engine, state.changed, state.load_n_m)
    angle = find_point(place_of(state)).trim.input("throttle")
    record: dict[str, Any] = {
        "throttle_deg": drawn(found.values),
        "speed_rad_s": drawn([trim.output("engine_speed") for trim in found.trims]),
        "stable": [trim.stable for trim in found.trims],
        "ends_deg": [boundary.value for boundary in found.boundaries],
    }
    try:
        record["line"] = line_record(find_operating_range(found, centre=angle, tolerance=TOLERANCE).line)
    except AnalysisError as error:
        record["no_line"] = str(error)
    return record


@lru_cache(maxsize=16)
def _map(engine: str, changed: tuple[tuple[str, float], ...], load: float) -> SteadyMap:
    return find_steady_map(
        find_engine(engine, changed),
        sweep_input="throttle",
        values=np.linspace(0.0, 90.0, ANGLES),
        output="engine_speed",
        inputs={"load_torque": load},
        tolerance=1e-3,
    )
