"""How long the live parts of a workbench's view take: one group for each of two warm processes, after a move of the point or a gain.

Each round moves to a value not seen before, by either group, so that nothing asked for is kept from the last.
"""

import itertools
import time
from collections.abc import Callable
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from revline.web.answers import answer_parts, warm_up
from revline.web.view.build import GROUPS

POINT_BUDGET, GAIN_BUDGET = 0.110, 0.045
"""Seconds of the processor for each group with its JSON after a move of the operating point, or of a gain."""


@pytest.fixture(scope="module", autouse=True)
def warm() -> None:
    warm_up()


def states(key: str, low: float, step: float) -> Callable[[], tuple[tuple[dict[str, Any]], dict[str, Any]]]:
    """What gives the next state, as a benchmark's set-up."""
    values = itertools.count()
    return lambda: (({key: low + step * next(values)},), {})


def parts_of(group: tuple[str, ...], state: dict[str, Any]) -> int:
    """Find a group's parts and count their bytes."""
    return sum(len(body) for body in answer_parts(state, group).values())


@pytest.mark.benchmark(timer=time.process_time)  # what else the machine does counts little so
@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group[0])
@pytest.mark.parametrize(
    ("key", "low", "step", "budget"),
    [("throttle_deg", 20.0, 0.137, POINT_BUDGET), ("kp", 0.6, 0.00137, GAIN_BUDGET)],
    ids=["point", "gain"],
)
def test_a_group_of_live_parts(
    benchmark: BenchmarkFixture, group: tuple[str, ...], key: str, low: float, step: float, budget: float
) -> None:
    size = benchmark.pedantic(
        lambda state: parts_of(group, state), setup=states(key, low + 0.31 * step * GROUPS.index(group), step), rounds=25
    )
    assert 3_000 < size < 400_000
    assert float(benchmark.stats.stats.min) < budget
