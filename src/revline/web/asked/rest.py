"""Questions about engines at rest: trim, map and linear model."""

from collections.abc import Mapping
from typing import Final

from revline.analysis.linearize import linearize
from revline.analysis.operating_range import fit_line
from revline.analysis.trim import find_trim
from revline.errors import InvalidInputError
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
from revline.studies.throttle_map import Angles, Wording, find_throttle_map, find_widest
from revline.web.asked.plants import at_trim, engine_of
from revline.web.questions import LinearizeQuestion, MapQuestion, TrimQuestion

WORDING: Final = Wording("from_deg =", "to_deg =", "linear_within", control="from_deg")


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
    found = find_throttle_map(engine_of(asked), Angles(asked.from_deg, asked.to_deg, asked.points), asked.load_n_m, WORDING)
    record = dict(map_record(found, load=asked.load_n_m))
    if asked.line_deg is not None:
        record["line"] = line_record(fit_line(found, low=asked.line_deg[0], high=asked.line_deg[1]))
    if asked.linear_within is not None:
        record["operating_range"] = operating_range_record(find_widest(found, asked.linear_within, asked.around_deg, WORDING))
    return record


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
