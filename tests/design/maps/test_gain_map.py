"""Gains over a map: against the region's own numbers, a search over all frequencies, and closed forms."""

import numpy as np
import pytest

from revline.design.maps.best_gains import best_gains
from revline.design.maps.gain_columns import GainColumns, find_ellipses, intersect_columns, peak_columns, stable_columns
from revline.design.maps.gain_map import Design, GainGrid, GainMap, GainPoint, LostPoint, find_gain_map, solve_point
from revline.design.regions.gain_region import Window, find_gain_region
from revline.design.regions.loop_family import family_of_model
from revline.design.regions.sensitivity_contour import find_peaks
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, NoTrimError
from revline.lti.transfer_function import TransferFunction


def grid(throttle: list[float], load: list[float]) -> GainGrid:
    return GainGrid(first="throttle", first_values=np.array(throttle), second="load_torque", second_values=np.array(load))


@pytest.fixture(scope="module")
def engine_map() -> GainMap:
    return find_gain_map(lee1995(), grid([3.0, 10.0, 15.0, 45.0], [0.0, 40.0]))


def at(found: GainMap, throttle: float, load: float) -> GainPoint:
    return next(point for point in found.found if point.place == (throttle, load))


def test_the_proportional_limit_varies_sixtyfold(engine_map: GainMap) -> None:
    low, high = at(engine_map, 15.0, 40.0).proportional_limit, at(engine_map, 45.0, 0.0).proportional_limit
    assert low is not None
    assert high is not None
    assert (low, high) == pytest.approx((0.08621, 5.1248), rel=1e-3)


def test_columns_agree_with_a_search_over_all_frequencies(engine_map: GainMap) -> None:
    """Upper ends have the peak asked for, by a search that shares no formula with the ellipses; 1 % above it is exceeded."""
    for point in engine_map.found:
        if point.best is None:
            continue
        sets = point.allowed
        inner = sets.high > 0.3 * np.max(sets.high)
        kp, ki = sets.kp[sets.column[inner]], sets.high[inner]
        np.testing.assert_allclose(find_peaks(point.region, kp, ki), 2.0, rtol=2e-3)
        assert np.all(find_peaks(point.region, kp, 1.03 * ki) > 2.0)
        assert np.all(point.region.stabilises(kp, ki))
        assert point.best.peak == pytest.approx(2.0, rel=1e-3)


def test_the_size_of_the_columns_is_the_region_s(engine_map: GainMap) -> None:
    for point in engine_map.found:
        assert point.stable.area == pytest.approx(point.region.area.value, rel=2e-3)


def test_what_is_common_holds_at_each_point_and_no_more_does(engine_map: GainMap) -> None:
    found = find_gain_map(lee1995(), grid([15.0, 45.0], [0.0, 40.0]))
    assert found.allowed is not None
    kp, ki = found.allowed.highest
    peaks = [float(find_peaks(point.region, kp, ki)) for point in found.found]
    assert max(peaks) == pytest.approx(2.0, rel=2e-3)
    assert max(float(find_peaks(point.region, kp, 1.01 * ki)) for point in found.found) > 2.0
    assert found.weakest is not None
    assert found.weakest.place == (15.0, 40.0)
    assert engine_map.allowed is not None
    assert engine_map.allowed.empty


def test_points_without_a_trim_or_without_gains_stay_with_the_reason(engine_map: GainMap) -> None:
    assert [point.place for point in engine_map.lost] == [(3.0, 0.0), (3.0, 40.0)]
    assert all("no trim" in point.reason for point in engine_map.lost)
    poor = at(engine_map, 10.0, 40.0)
    assert poor.trim.unstable_count == 2
    assert poor.best is None
    assert "no kp and ki keep the peak" in poor.reason
    assert poor.region.kp_ends()[0][1] < 0.0  # only a negative kp stabilises here
    assert not np.isfinite(engine_map.limits[0, 0])


def test_a_throttle_that_is_open_already_is_lost_alone(engine_map: GainMap) -> None:
    point = solve_point(lee1995(), engine_map.grid, Design(), (85.0, 0.0))
    assert isinstance(point, LostPoint)
    assert "throttle does not move engine_speed for good here (gain 0 at rest)" in point.reason


def test_c2d_is_unstable_at_small_throttle_under_load() -> None:
    found = find_gain_map(lee1995(), grid([15.0, 25.0], [0.0, 40.0]), Design(kd=0.1))
    unstable = {point.place: int(point.region.unstable_roots(1.2, 2.0)) for point in found.found if point.region.reach[0] > 1.2}
    assert unstable[25.0, 0.0] == 0
    assert unstable[15.0, 40.0] > 0
    assert all("no kp and ki" in point.reason for point in found.found if point.place[0] == 15.0)


def test_a_first_order_lag_without_delay_has_no_end() -> None:
    """1/(s + 1) with PI is stable for kp > -1 and any ki > 0."""
    region = find_gain_region(family_of_model(TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=0.0)))
    found = stable_columns(region, np.array([-2.0, -1.0, -0.5, 1.0]))
    assert found.column.tolist() == [2, 3]
    assert found.high.tolist() == [region.window.ki_high] * 2


def test_intervals_are_intersected_column_by_column() -> None:
    kp = np.array([0.0, 1.0])
    one = GainColumns(kp=kp, column=np.array([0, 0, 1]), low=np.array([0.0, 4.0, 1.0]), high=np.array([2.0, 6.0, 3.0]))
    other = GainColumns(kp=kp, column=np.array([0, 1]), low=np.array([1.0, 4.0]), high=np.array([5.0, 5.0]))
    both = intersect_columns([one, other])
    assert both.column.tolist() == [0, 0]
    assert list(zip(both.low.tolist(), both.high.tolist(), strict=True)) == [(1.0, 2.0), (4.0, 5.0)]
    assert both.above(1.5).low.tolist() == [1.5, 4.0]
    assert both.holds(np.array([1.5, 3.0])).tolist() == [[True, False], [False, False]]
    assert both.area == pytest.approx(1.0)


def test_a_map_over_speed_holds_the_speed() -> None:
    axes = GainGrid(first="engine_speed", first_values=np.array([120.0, 240.0]), second="load_torque", second_values=np.array([10.0]))
    found = find_gain_map(lee1995(), axes)
    assert [point.trim.output("engine_speed") for point in found.found] == pytest.approx([120.0, 240.0])
    assert found.units == ("rad/s", "N m")
    assert found.words((120.0, 10.0)) == "engine_speed = 120 rad/s, load_torque = 10 N m"


def test_what_cannot_be_mapped_is_refused() -> None:
    engine = lee1995()
    with pytest.raises(InvalidInputError, match="axis throttle of the map does not rise strictly"):
        grid([20.0, 10.0], [0.0])
    with pytest.raises(InvalidInputError, match="give a list of finite numbers"):
        grid([], [0.0])
    with pytest.raises(InvalidInputError, match="both axes of the map are throttle"):
        GainGrid(first="throttle", first_values=np.array([1.0]), second="throttle", second_values=np.array([1.0]))
    with pytest.raises(InvalidInputError, match="throttle is to hold engine_speed"):
        find_gain_map(
            engine, GainGrid(first="engine_speed", first_values=np.array([99.0]), second="throttle", second_values=np.array([9.0]))
        )
    with pytest.raises(InvalidInputError, match="peak of the sensitivity = 1"):
        find_gain_map(engine, grid([20.0], [0.0]), Design(peak=1.0))
    with pytest.raises(NoTrimError, match="none of the 1 operating points has a result"):
        find_gain_map(engine, grid([2.0], [0.0]))
    with pytest.raises(InvalidInputError, match="do not rise, or an interval"):
        GainColumns(kp=np.array([1.0, 0.0]), column=np.empty(0, dtype=np.int64), low=np.empty(0), high=np.empty(0))
    empty = GainColumns(kp=np.array([0.0]), column=np.empty(0, dtype=np.int64), low=np.empty(0), high=np.empty(0))
    with pytest.raises(InvalidInputError, match="has no largest ki"):
        _ = empty.highest
    with pytest.raises(InvalidInputError, match="sets of gains to intersect"):
        intersect_columns([])


def test_a_peak_of_one_is_refused_for_columns(engine_map: GainMap) -> None:
    with pytest.raises(InvalidInputError, match="peak of the sensitivity = 1"):
        peak_columns(engine_map.found[0].region, np.array([0.0, 1.0]), 1.0)


@pytest.mark.parametrize("peak", [5.0, 20.0])
def test_a_large_peak_is_kept_as_well(engine_map: GainMap, peak: float) -> None:
    """Its ellipses are small: with the region's own frequencies they left cracks, and 20.4 for 20."""
    region = engine_map.found[0].region
    kp = np.linspace(region.window.kp_low, region.window.kp_high, 81)
    ellipses = find_ellipses(region, peak)
    best = best_gains(region, ellipses, peak_columns(region, kp, peak, ellipses), peak)
    assert best.peak == pytest.approx(peak, rel=3e-4)
    with pytest.raises(InvalidInputError, match="peak of the sensitivity = 21 is outside values above 1, up to 20"):
        peak_columns(region, kp, 21.0)


def test_best_gains_at_the_edge_of_a_window_are_found() -> None:
    """The largest ki of this plant with Ms = 2 has kp = 0.49: in a window that ends at 0.2 it is at its edge."""
    plant = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.6), delay=0.05, input_unit="deg", output_unit="rad/s")
    window = Window(kp_low=0.0, kp_high=0.2, ki_high=20.0)
    region = find_gain_region(family_of_model(plant), window)
    kp, ellipses = np.linspace(0.0, 0.2, 41), find_ellipses(region, 2.0)
    best = best_gains(region, ellipses, peak_columns(region, kp, 2.0, ellipses), 2.0)
    assert best.kp == pytest.approx(0.2)
    assert best.peak == pytest.approx(2.0, rel=1e-3)


def test_an_interruption_keeps_what_is_finished() -> None:
    def stop(_: float) -> None:
        raise KeyboardInterrupt

    found = find_gain_map(lee1995(), grid([20.0], [0.0, 10.0, 20.0]), workers=1, progress=stop)
    assert found.interrupted
    assert len(found.points) == 3
    assert 1 <= len(found.found) < 3
    assert isinstance(found.lost[0], LostPoint)
    assert "interruption" in found.lost[0].reason
