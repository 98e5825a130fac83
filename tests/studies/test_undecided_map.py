"""What a record and a study's warnings say of a map with a place that is undecided."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

from revline.analysis.steady_map import Undecided, find_steady_map
from revline.engine.lee1995 import lee1995
from revline.io.point_records import map_record
from revline.studies.study_results import StudyResults
from revline.studies.writing import _map_warnings


def test_an_undecided_place_is_neither_an_end_nor_a_place_where_no_engine_runs() -> None:
    found = find_steady_map(lee1995(), sweep_input="throttle", values=[2.0, 3.0, 10.0], output="engine_speed", tolerance=0.01)
    assert "undecided_to_deg" not in str(map_record(found, load=0.0))
    (end,) = found.boundaries
    changed = replace(
        found,
        missing=(found.missing[0], Undecided(value=3.0, reason="a lag has no value")),
        boundaries=(replace(end, undecided="a lag has no value"),),
    )
    assert map_record(changed, load=0.0)["ends"] == [
        {"throttle_deg": end.value, "speed_rad_s": end.trim.output("engine_speed"), "undecided_to_deg": end.without.value}
    ]
    begins, *others = _map_warnings(cast("StudyResults", SimpleNamespace(range=SimpleNamespace(steady_map=changed))))
    assert "2 deg: " in begins
    assert "3 deg: " not in begins
    assert others[0] == "at throttle = 3 deg, undecided: a lag has no value"
