import json
from typing import Any

import numpy as np
import pytest

from revline.errors import InvalidInputError
from revline.io.json_files import JsonRecord, parse_json
from revline.io.schedule_files import is_schedule, parse_schedule

AXES = [{"name": "engine_speed", "unit": "rad/s", "values": [100.0, 400.0]}, {"name": "load_torque", "unit": "N m", "values": [0.0, 40.0]}]
TABLE = [[0.2, 0.3], [0.5, 0.6]]
GOOD = {"axes": AXES, "kp": TABLE, "ki": TABLE, "kd": TABLE, "powers_of_first_axis": {"kp": 1, "ki": 2, "kd": 0}}


def record(**changes: Any) -> JsonRecord:
    return parse_json(json.dumps({"kp_unit": "deg/(rad/s)", "schedule": {**GOOD, **changes}}), "gain map m.json")


def test_a_schedule_is_read_as_it_was_written() -> None:
    found = parse_schedule(record())
    assert is_schedule(record())
    assert not is_schedule(parse_json('{"kp": 1}', "controller file c.json"))
    assert found.names == ("engine_speed", "load_torque")
    assert np.array_equal(found.kp, TABLE)
    assert tuple(found.scaling) == (1, 2, 0)
    assert found.gains_at(100.0, 0.0) == pytest.approx((0.2, 0.2, 0.2))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axes": 5}, '"axes" is no list of two axes; give the file that `revline gain-map --schedule` wrote'),
        ({"ki": [[1.0]]}, '"ki" is no table of 2 rows of 2 finite numbers'),
        ({"kd": [[1.0, "x"], [1.0, 2.0]]}, '"kd" is no table of 2 rows'),
        ({"powers_of_first_axis": {}}, '"kp" is missing'),
        ({"powers_of_first_axis": {"kp": 1.5, "ki": 2, "kd": 0}}, '"kp" is 1.5, and a whole power is wanted: 0, 1 or 2'),
        ({"axes": [AXES[0], {**AXES[1], "values": [3.0, 1.0]}]}, "give at least two finite values that rise strictly"),
    ],
)
def test_what_is_no_schedule_is_refused(changes: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        parse_schedule(record(**changes))
