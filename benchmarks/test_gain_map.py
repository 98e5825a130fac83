"""How long a map of gains takes: 20 by 10 operating points, each with its region and its gains, in at most 5 s on 2 cores."""

import numpy as np
from pytest_benchmark.fixture import BenchmarkFixture

from revline.design.maps.gain_map import GainGrid, find_gain_map
from revline.engine.lee1995 import lee1995

BUDGET = 5.0
"""Seconds."""


def test_a_map_of_20_by_10_points(benchmark: BenchmarkFixture) -> None:
    throttle, load = np.linspace(15.0, 45.0, 20), np.linspace(0.0, 40.0, 10)
    grid = GainGrid(first="throttle", first_values=throttle, second="load_torque", second_values=load)
    found = benchmark(find_gain_map, lee1995(), grid)
    assert len(found.found) == 200
    assert all(point.best for point in found.found)
    assert float(benchmark.stats.stats.min) < BUDGET
