"""How long a steady map of a new engine or load takes, and a single trim; a map is found at once and not angle by angle."""

import itertools
import time
from collections.abc import Callable

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from revline.analysis.steady_map import SteadyMap, find_steady_map
from revline.analysis.trim import Trim, find_trim
from revline.engine.lee1995 import lee1995

pytestmark = pytest.mark.benchmark(timer=time.process_time)

MAP_BUDGETS = {46: 0.15, 91: 0.25}
"""Seconds of the processor for a map of so many angles over the whole throttle."""

TRIM_BUDGET = 0.012
SINGLE_TRIMS = 0.30
"""Seconds of the processor for one trim; and the part that a map may take of those of as many single trims."""


def loads() -> Callable[[], tuple[tuple[float], dict[str, float]]]:
    """What gives the next load, as a benchmark's set-up."""
    values = itertools.count()
    return lambda: ((0.137 * next(values),), {})


def map_at(points: int, load: float) -> SteadyMap:
    """Find the map of the workbench (46 angles) or of the command line (91)."""
    return find_steady_map(
        lee1995(),
        sweep_input="throttle",
        values=np.linspace(0.0, 90.0, points),
        output="engine_speed",
        inputs={"load_torque": load},
        tolerance=1e-3,
    )


def trim_at(load: float) -> Trim:
    """Find one operating point."""
    return find_trim(lee1995(), inputs={"throttle": 25.0, "load_torque": load})


@pytest.mark.parametrize("points", MAP_BUDGETS)
def test_a_steady_map(benchmark: BenchmarkFixture, points: int) -> None:
    found = benchmark.pedantic(lambda load: map_at(points, load), setup=loads(), rounds=10)
    assert len(found.trims) > 0.9 * points
    assert float(benchmark.stats.stats.min) < MAP_BUDGETS[points]


def test_a_single_trim(benchmark: BenchmarkFixture) -> None:
    assert benchmark.pedantic(trim_at, setup=loads(), rounds=25).stable
    assert float(benchmark.stats.stats.min) < TRIM_BUDGET


def test_a_map_costs_less_than_its_trims_one_by_one(benchmark: BenchmarkFixture) -> None:
    def processor(ask: Callable[[], object]) -> float:
        began = time.process_time()
        ask()
        return time.process_time() - began

    angles = np.linspace(4.0, 90.0, 44)
    alone = min(processor(lambda: [find_trim(lee1995(), inputs={"throttle": angle}) for angle in angles]) for _ in range(2))
    together = benchmark.pedantic(lambda: min(processor(lambda: map_at(46, 0.0)) for _ in range(3)), rounds=1)
    assert together < SINGLE_TRIMS * alone
