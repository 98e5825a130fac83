"""Questions about engines at rest: trim, map and linear model."""

from collections.abc import Mapping

import numpy as np

from revline.analysis.linearize import linearize
from revline.analysis.operating_range import ErrorMeasure, OperatingRange, find_operating_range, fit_line
from revline.analysis.steady_map import SteadyMap, find_steady_map
from revline.analysis.trim import find_trim
from revline.errors import InvalidInputError
from revline.io.number_lists import parse_numbers
from revline.io.point_records import (
    line_record,
    linearization_record,
    map_record,
    operating_range_record,
    region_roots_record,
    roots_record,
    trim_record,
    trim_warnings,
)
from revline.lti.root_regions import Region, find_roots_in
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace
from revline.web.asked.plants import at_trim, engine_of
from revline.web.questions import LinearizeQuestion, MapQuestion, TrimQuestion


def find_trim_record(asked: TrimQuestion) -> Mapping[str, object]:
    """Answer as `revline trim --json`."""
    engine = engine_of(asked)
    if asked.throttle_deg is not None and asked.speed_rad_s is None:
        point = find_trim(engine, inputs={"throttle": asked.throttle_deg, "load_torque": asked.load_n_m})
    elif asked.speed_rad_s is not None and asked.throttle_deg is None:
        point = find_trim(engine, inputs={"load_torque": asked.load_n_m}, outputs={"engine_speed": asked.speed_rad_s}, free=("throttle",))
    else:
        message = "give either throttle_deg or speed_rad_s: one is known, the other is found"
        raise InvalidInputError(message, control="throttle_deg")
    linear = linearize(engine, point)
    return {**trim_record(point, linear.model), "warnings": [*trim_warnings(point), *(str(kink) for kink in linear.kinks)]}


def find_map_record(asked: MapQuestion) -> Mapping[str, object]:
    """Answer as `revline map --json`."""
    low, high = asked.from_deg, asked.to_deg
    if not low < high:
        message = f"from_deg = {low:g} is not below to_deg = {high:g}: the angles must rise; give the lower one first"
        raise InvalidInputError(message, control="from_deg", low=low, high=high)
    found = find_steady_map(
        engine_of(asked),
        sweep_input="throttle",
        values=np.linspace(low, high, asked.points),
        output="engine_speed",
        inputs={"load_torque": asked.load_n_m},
    )
    record = dict(map_record(found, load=asked.load_n_m))
    if asked.line_deg is not None:
        record["line"] = line_record(fit_line(found, low=asked.line_deg[0], high=asked.line_deg[1]))
    if asked.linear_within is not None:
        record["operating_range"] = operating_range_record(_widest(found, asked.linear_within, asked.around_deg))
    return record


def _widest(found: SteadyMap, text: str, centre: float) -> OperatingRange:
    percent = text.strip().endswith("%")
    tolerances = parse_numbers(text.strip().removesuffix("%"), "linear_within")
    if len(tolerances) != 1:
        message = f"linear_within {text!r} names more than one tolerance; give one, for example 1% or 3"
        raise InvalidInputError(message, control="linear_within")
    tolerance = float(tolerances[0])
    if percent:
        return find_operating_range(found, centre=centre, tolerance=tolerance / 100.0, measure=ErrorMeasure.FRACTION)
    return find_operating_range(found, centre=centre, tolerance=tolerance, measure=ErrorMeasure.OUTPUT)


def find_linear_record(asked: LinearizeQuestion) -> Mapping[str, object]:
    """Answer as `revline linearize --json`."""
    place = at_trim(asked, asked.throttle_deg)
    found = linearize(place.engine, place.trim)
    return {**linearization_record(found, place.trim), **_roots(found.model, asked)}


def _roots(model: DelayStateSpace, asked: LinearizeQuestion) -> Mapping[str, object]:
    """Roots by number or right of a line; nothing where none are asked for."""
    if asked.roots is not None and asked.roots_right_of_rad_s is not None:
        message = "give either roots or roots_right_of_rad_s: roots are listed by number or right of a line"
        raise InvalidInputError(message, control="roots")
    if asked.roots is not None:
        return roots_record(characteristic_roots(model, count=asked.roots))
    right_of = asked.roots_right_of_rad_s
    return {} if right_of is None else region_roots_record(find_roots_in(model, Region(left=right_of)))
