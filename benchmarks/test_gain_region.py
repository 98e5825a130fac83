"""How long the stabilising gains of the engine's exact linear model take: at least 400 boundary points in at most 20 ms."""

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.regions.gain_curve import LoopFamily
from revline.design.regions.gain_region import GainRegion, find_gain_region
from revline.design.regions.loop_family import family_of_system
from revline.design.regions.sensitivity_contour import find_sensitivity_contour
from revline.engine.lee1995 import lee1995

REGION_BUDGET = 0.020
"""Seconds for a region of at least `POINTS` boundary points, window included."""

POINTS = 400

CONTOUR_BUDGET = 0.25
"""Seconds for a contour of the peak sensitivity."""


@pytest.fixture(scope="module")
def family() -> LoopFamily:
    engine = lee1995()
    return family_of_system(linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model, kd=0.1, name="engine")


def test_a_region_of_400_points(benchmark: BenchmarkFixture, family: LoopFamily) -> None:
    found: GainRegion = benchmark(find_gain_region, family)
    assert int(found.rim.sum()) >= POINTS
    assert float(benchmark.stats.stats.min) < REGION_BUDGET


def test_a_contour_of_the_peak_sensitivity(benchmark: BenchmarkFixture, family: LoopFamily) -> None:
    region = find_gain_region(family)
    found = benchmark(find_sensitivity_contour, region, 3.0)
    assert found.omega.size >= 100
    assert float(benchmark.stats.stats.min) < CONTOUR_BUDGET
