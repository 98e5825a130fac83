"""Straight lines through steady states, and how wide they hold."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.analysis.operating_range import ErrorMeasure, LimitedBy, find_operating_range, fit_line
from revline.analysis.steady_map import SteadyMap, find_steady_map
from revline.analysis.trim import Trim, find_trim
from revline.errors import AnalysisError, InvalidInputError
from revline.system import DelaySystem, Variable


@pytest.fixture(scope="module")
def engine_map(engine: DelaySystem) -> SteadyMap:
    return find_steady_map(engine, sweep_input="throttle", values=np.arange(4.0, 62.0, 2.0), output="engine_speed")


@pytest.fixture
def shape(linear: DelaySystem) -> "MapMaker":
    return MapMaker(find_trim(linear))


class MapMaker:
    """Makes maps of a given curve; only values and outputs matter to a line."""

    def __init__(self, trim: Trim) -> None:
        self.trim = trim

    def __call__(self, values: np.ndarray, outputs: np.ndarray) -> SteadyMap:
        position = Variable(name="position", unit="m")
        trims = tuple(replace(self.trim, outputs=np.array([y])) for y in outputs)
        force = Variable(name="force", unit="N")
        return SteadyMap(system="curve", sweep=force, output=position, values=values, trims=trims, missing=(), boundaries=())


@pytest.mark.reference
def test_line_of_the_thesis(engine: DelaySystem, engine_map: SteadyMap) -> None:
    """Lee (1995), Fig. 4.2: 25 +- 15 deg. Recomputed, points 10 deg apart give a slope of 11.825, many 11.905."""
    line = fit_line(engine_map, low=10.0, high=40.0)
    assert line.slope == pytest.approx(11.9054, abs=2e-3)
    assert line.max_error == pytest.approx(2.233, abs=5e-3)
    assert line.max_error_at == 10.0
    angles = np.linspace(10.0, 40.0, 61)
    exact = np.array([find_trim(engine, inputs={"throttle": float(a)}).state("engine_speed") for a in angles])
    slope, intercept = np.polyfit(angles, exact, 1)
    assert line.slope == pytest.approx(slope, rel=1e-3)
    assert line.intercept == pytest.approx(intercept, rel=3e-3)
    assert line.predict(25.0) == pytest.approx(slope * 25.0 + intercept, rel=1e-4)


def test_errors_agree_with_exact_trims(engine: DelaySystem, engine_map: SteadyMap) -> None:
    """Between the map's values, 2 deg apart, the curve is within 0.02 rad/s of exact steady states."""
    line = fit_line(engine_map, low=10.0, high=40.0)
    for k in (7, 55, 123, 201, 290):
        exact = find_trim(engine, inputs={"throttle": float(line.values[k])}).state("engine_speed")
        assert line.errors[k] == pytest.approx(line.predict(float(line.values[k])) - exact, abs=0.02)


def test_range_of_the_thesis_follows_from_its_error(engine_map: SteadyMap) -> None:
    line = fit_line(engine_map, low=10.0, high=40.0)
    found = find_operating_range(engine_map, centre=25.0, tolerance=line.max_error, measure=ErrorMeasure.OUTPUT)
    assert found.half_width == pytest.approx(15.0, abs=1e-6)
    assert found.limited_by is LimitedBy.TOLERANCE
    by_fraction = find_operating_range(engine_map, centre=25.0, tolerance=line.max_error_fraction)
    assert by_fraction.half_width == pytest.approx(15.0, abs=1e-6)


def test_parabola_in_closed_form(shape: MapMaker) -> None:
    """Over centre +- h the best line through x^2 misses it by 2 h^2 / 3 at the ends, over many points."""
    values = np.linspace(0.0, 10.0, 201)
    found = find_operating_range(shape(values, values**2), centre=5.0, tolerance=2.0 / 3.0 * 4.0, measure=ErrorMeasure.OUTPUT)
    assert found.half_width == pytest.approx(2.0, rel=1e-2)
    assert found.line.slope == pytest.approx(10.0, rel=1e-4)
    assert abs(found.line.max_error_at - 5.0) == pytest.approx(2.0, rel=1e-2)
    assert found.line.span == pytest.approx(4.0 * 2.0 * 5.0, rel=1e-2)


@given(st.floats(-5.0, 5.0), st.floats(0.1, 5.0), st.floats(0.5, 9.5))
@settings(max_examples=25, deadline=None)
def test_straight_map_is_limited_by_its_ends(intercept: float, slope: float, centre: float) -> None:
    from revline.engine.lee1995 import lee1995  # noqa: PLC0415 - a fixture cannot serve a property test

    values = np.linspace(0.0, 10.0, 11)
    make = MapMaker(_any_trim(lee1995()))
    found = find_operating_range(make(values, slope * values + intercept), centre=centre, tolerance=1e-6)
    assert found.limited_by is LimitedBy.MAP
    assert found.half_width == pytest.approx(min(centre, 10.0 - centre))
    assert found.line.slope == pytest.approx(slope)
    assert found.line.intercept == pytest.approx(intercept, abs=1e-9)


def _any_trim(system: DelaySystem) -> Trim:
    trim = find_trim(system, inputs={"throttle": 25.0}, starts=1)
    return replace(trim, output_variables=(Variable(name="position", unit="m"),), outputs=np.zeros(1))


@given(st.floats(0.005, 0.05), st.floats(1.1, 3.0))
@settings(max_examples=10, deadline=None)
def test_more_tolerance_never_narrows(tolerance: float, factor: float) -> None:
    from revline.engine.lee1995 import lee1995  # noqa: PLC0415 - a fixture cannot serve a property test

    values = np.linspace(0.0, 10.0, 161)
    curve = MapMaker(_any_trim(lee1995()))(values, np.exp(0.3 * values))
    first = find_operating_range(curve, centre=4.0, tolerance=tolerance)
    second = find_operating_range(curve, centre=4.0, tolerance=factor * tolerance)
    assert second.half_width >= first.half_width
    assert first.line.max_error_fraction <= tolerance


def test_kink_at_the_centre_has_no_range(shape: MapMaker) -> None:
    values = np.linspace(0.0, 10.0, 101)
    bent = shape(values, np.where(values < 5.0, values, 3.0 * values - 10.0))
    with pytest.raises(
        AnalysisError, match=r"no range around force = 5 N that holds 3 values of the map is linear within 0.001 of the span; allow more"
    ):
        find_operating_range(bent, centre=5.0, tolerance=1e-3)


def test_flat_map_has_no_fraction(shape: MapMaker) -> None:
    values = np.linspace(0.0, 10.0, 11)
    with pytest.raises(AnalysisError, match="no range around force = 5 N"):
        find_operating_range(shape(values, np.ones(11)), centre=5.0, tolerance=0.1)


def test_gap_ends_the_range(engine: DelaySystem) -> None:
    found = find_steady_map(engine, sweep_input="throttle", values=[2.0, 3.0, 5.0, 6.0, 7.0, 8.0], output="engine_speed")
    assert find_operating_range(found, centre=6.0, tolerance=0.5).line.low == 5.0
    gapped = replace(found, missing=(replace(found.missing[0], value=6.5),))
    assert find_operating_range(gapped, centre=5.5, tolerance=0.5).line.high == 6.0
    with pytest.raises(InvalidInputError, match=r"there is no steady state at throttle = 6.5 deg inside the range"):
        fit_line(gapped, low=5.0, high=8.0)


@pytest.mark.parametrize(("low", "high"), [(10.0, 10.0), (2.0, 20.0), (20.0, 80.0)])
def test_range_beyond_the_map_is_refused(engine_map: SteadyMap, low: float, high: float) -> None:
    with pytest.raises(InvalidInputError, match=r"is empty or reaches beyond the map, 4 to 60 deg"):
        fit_line(engine_map, low=low, high=high)


def test_centre_outside_the_map_is_refused(engine_map: SteadyMap) -> None:
    with pytest.raises(InvalidInputError, match=r"centre = 70 deg is outside the map's 4 to 60 deg"):
        find_operating_range(engine_map, centre=70.0, tolerance=0.01)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("nan"), float("inf")])
def test_tolerance_must_be_positive(engine_map: SteadyMap, tolerance: float) -> None:
    with pytest.raises(InvalidInputError, match=r"tolerance = .* rad/s is outside 0 to infinity"):
        find_operating_range(engine_map, centre=25.0, tolerance=tolerance, measure=ErrorMeasure.OUTPUT)


def test_results_check_themselves(engine_map: SteadyMap) -> None:
    found = find_operating_range(engine_map, centre=25.0, tolerance=0.01)
    with pytest.raises(InvalidInputError, match=r"the line's error .* exceeds the tolerance 1e-06"):
        replace(found, tolerance=1e-6)
    with pytest.raises(InvalidInputError, match=r"2 values with 301 errors"):
        replace(found.line, values=np.array([1.0, 2.0]))
