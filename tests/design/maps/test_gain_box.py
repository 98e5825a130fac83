"""Boxes of operating points for one set of gains, and the limit of such boxes, on a small map of the engine."""

import json
from typing import Any

import numpy as np
import pytest

from revline.design.maps import gain_box
from revline.design.maps.box_gains import CommonGains, Floor, try_gains
from revline.design.maps.gain_box import BoxGains, find_largest_box
from revline.design.maps.gain_box_limit import BoxLimit, limit_boxes
from revline.design.maps.gain_map import Design, GainGrid, GainMap, GainPoint, find_gain_map, solve_point
from revline.design.maps.operating_box import CORNERS, Box
from revline.design.regions.sensitivity_contour import find_peaks
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, NotConvergedError
from revline.io.common_gain_records import box_record, box_rows
from revline.io.json_files import format_json


def grid(throttle: list[float], load: list[float]) -> GainGrid:
    return GainGrid(first="throttle", first_values=np.array(throttle), second="load_torque", second_values=np.array(load))


@pytest.fixture(scope="module")
def engine_map() -> GainMap:
    return find_gain_map(lee1995(), grid([15.0, 30.0, 45.0], [0.0, 20.0, 40.0]))


@pytest.fixture(scope="module")
def found(engine_map: GainMap) -> BoxGains:
    return find_largest_box(lee1995(), engine_map, Floor(share=0.1))


@pytest.fixture(scope="module")
def limit(engine_map: GainMap, found: BoxGains) -> BoxLimit:
    return limit_boxes(lee1995(), found, engine_map, within=0.5)


def test_fixed_gains_hold_in_their_box(found: BoxGains) -> None:
    """At points that the search did not see, by a search of the peak that shares no formula with the columns."""
    assert 0.4 < found.share < 0.7
    assert found.worst <= 2.0
    assert found.tightest >= 1.0
    rng = np.random.default_rng(1)
    places = rng.uniform((found.box.first_low, found.box.second_low), (found.box.first_high, found.box.second_high), (6, 2))
    for place in places:
        point = solve_point(lee1995(), grid([20.0], [0.0]), Design(), (float(place[0]), float(place[1])))
        assert isinstance(point, GainPoint)
        assert point.best is not None
        assert float(find_peaks(point.region, found.kp, found.ki)) <= found.worst * 1.001
        assert point.region.stabilises(found.kp, found.ki)
        assert found.ki >= 0.1 * point.best.ki


def test_gains_that_fail_inside_are_refused(engine_map: GainMap, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail_inside(*asked: Any) -> tuple[float, float]:
        return (1.5 if asked[3] in Box(15.0, 45.0, 0.0, 40.0).corners else 2.3), 1.2

    monkeypatch.setattr(gain_box, "try_gains", fail_inside)
    with pytest.raises(NotConvergedError, match=r"do not hold its inside: kp = .* have a peak of 2.3 at throttle = .*; take a finer map"):
        find_largest_box(lee1995(), engine_map, Floor(share=0.01))


def test_a_point_inside_that_fails_is_served_next(engine_map: GainMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first gains fail at a planted point; the box then grows anew with that point among those that must have gains in common."""
    true, planted = try_gains, (33.0, 24.0)
    asked_at = list[tuple[float, float]]()
    served = list[tuple[tuple[float, float], ...]]()

    def fail_once(*asked: Any) -> tuple[float, float]:
        asked_at.append(asked[3])
        peak, slack = true(*asked)
        return (2.5 if asked[3] == planted and asked_at.count(planted) == 1 else peak), slack

    class Spied(CommonGains):
        def gentlest(self, box: Box, shares: tuple[tuple[float, float], ...]) -> tuple[float, float]:
            served.append(shares)
            return super().gentlest(box, shares)

    monkeypatch.setattr(gain_box, "try_gains", fail_once)
    monkeypatch.setattr(gain_box, "CommonGains", Spied)
    assert find_largest_box(lee1995(), engine_map, Floor(share=0.01)).share == pytest.approx(1.0)
    assert served == [CORNERS, (*CORNERS, pytest.approx((0.6, 0.6)))]


def test_the_box_does_not_depend_on_the_grid(found: BoxGains) -> None:
    """Its edges lie between the lines, wherever these are."""
    other = find_gain_map(lee1995(), grid([15.0, 45.0], [0.0, 40.0]))  # no gains hold its one cell
    assert find_largest_box(lee1995(), other, Floor(share=0.1)).share == pytest.approx(found.share, rel=1e-3)


def test_a_map_of_small_numbers_keeps_its_lines() -> None:
    """Lines were rounded to 1e-9, so that those of a small axis became one."""
    tiny = find_gain_map(lee1995(), grid([25.0, 30.0, 35.0], [0.0, 1e-10, 2e-10]))
    assert find_largest_box(lee1995(), tiny, Floor(share=0.25)).box.second_high == 2e-10


def test_no_box_much_larger_is_left(found: BoxGains, limit: BoxLimit, engine_map: GainMap) -> None:
    assert limit.complete
    assert found.share <= limit.share <= 1.5 * found.share
    for ruled in limit.ruled:
        assert found.floor.share * max(_best(place, engine_map) for place in ruled.places) == pytest.approx(ruled.floor_ki)
        inside = found.box.first_low <= ruled.box.first_low and found.box.first_high >= ruled.box.first_high
        assert not (inside and found.box.second_low <= ruled.box.second_low and found.box.second_high >= ruled.box.second_high)


def test_the_record_tells_the_box_and_the_proofs(found: BoxGains, limit: BoxLimit, engine_map: GainMap) -> None:
    record = json.loads(format_json(box_record(engine_map, found, limit)))
    assert record["box"]["throttle_deg"] == [found.box.first_low, found.box.first_high]
    assert record["floor"] == {"share_of_best_ki": 0.1, "ki": 0.0}
    proof = record["limit"]["proofs"][0]
    assert proof["smallest_ki"] == proof["gains"]["ki"][0]
    assert proof["cells_above_ms"] + proof["cells_unstable"] <= proof["cells"]
    assert proof["points"][0].keys() == {"throttle_deg", "load_torque_n_m"}
    assert any("no box has more than" in row[0] for row in box_rows(engine_map, found, limit))


def _best(place: tuple[float, float], engine_map: GainMap) -> float:
    point = solve_point(lee1995(), engine_map.grid, Design(), place)
    assert isinstance(point, GainPoint)
    assert point.best is not None
    return point.best.ki


def test_a_small_floor_is_held_everywhere_and_a_large_one_nowhere(engine_map: GainMap) -> None:
    """With a floor of 0.01 of the best ki, below 0.129/10.95 of the weakest to the strongest point, the whole map has gains."""
    whole = find_largest_box(lee1995(), engine_map, Floor(share=0.01))
    assert whole.share == pytest.approx(1.0)
    assert whole.worst < 2.0
    with pytest.raises(NotConvergedError, match="no gains hold even a cell"):
        find_largest_box(lee1995(), engine_map, Floor(share=1.0))


def test_gains_that_do_not_stabilise_have_no_peak(engine_map: GainMap) -> None:
    points = {point.place: point for point in engine_map.points}
    peak, slack = try_gains(points.__getitem__, points.__getitem__, Floor(share=0.5), (15.0, 40.0), (1.2, 2.0))
    assert peak == np.inf
    assert slack == pytest.approx(2.0 / (0.5 * 0.12917), rel=1e-3)
    lost = {(2.0, 0.0): solve_point(lee1995(), engine_map.grid, Design(), (2.0, 0.0))}
    assert try_gains(lost.__getitem__, lost.__getitem__, Floor(), (2.0, 0.0), (1.0, 1.0)) == (np.inf, 0.0)


def test_a_box_has_its_weak_and_strong_corners_first() -> None:
    box = Box(1.0, 3.0, 10.0, 20.0)
    assert box.area == 20.0
    assert box.corners[:2] == ((1.0, 20.0), (3.0, 10.0))
    assert len(box.grid(3)) == 9


def test_what_cannot_be_asked_is_refused(engine_map: GainMap, found: BoxGains) -> None:
    with pytest.raises(InvalidInputError, match="share of the best ki = 2"):
        Floor(share=2.0)
    with pytest.raises(InvalidInputError, match="smallest ki = -1"):
        Floor(ki=-1.0)
    with pytest.raises(InvalidInputError, match="no performance is asked for"):
        Floor(share=0.0)
    with pytest.raises(InvalidInputError, match="allowed excess of the limit = 0"):
        limit_boxes(lee1995(), found, engine_map, within=0.0)
    row = find_gain_map(lee1995(), grid([20.0, 30.0], [0.0]))
    with pytest.raises(InvalidInputError, match="a box is sought in a map"):
        find_largest_box(lee1995(), row, Floor())
    poor = find_gain_map(lee1995(), grid([9.0, 10.0], [39.0, 40.0]))
    with pytest.raises(NotConvergedError, match="no point of the map has gains"):
        find_largest_box(lee1995(), poor, Floor())
