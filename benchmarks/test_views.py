"""How long the live parts of a workbench's view take: each of two warm processes' share, after a move of the point or a gain.

Each round moves to a value not seen before, by either share, so that nothing asked for is kept from the last. After a move of the point
the second share is handed the models that the first one fits, as the server does it; to fit them is no part of its time.
"""

import itertools
import time
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from revline.web.answers import answer_parts, answer_promises, warm_up
from revline.web.view.build import GROUPS
from revline.web.views import MODELS, PROMISES

POINT_BUDGET, GAIN_BUDGET = 0.090, 0.045
"""Seconds of the processor for each share with its JSON after a move of the operating point, or of a gain."""

FITTING, OTHERS = GROUPS
SHARES: dict[str, tuple[str, float, float, Sequence[str], bool, float]] = {
    "point-response": ("throttle_deg", 20.0, 0.137, [name for name in FITTING if name != PROMISES], False, POINT_BUDGET),
    "point-point": ("throttle_deg", 20.0418, 0.137, OTHERS, True, POINT_BUDGET),
    "gain-response": ("kp", 0.6, 0.00137, FITTING, False, GAIN_BUDGET),
    "gain-point": ("kp", 0.6004, 0.00137, OTHERS, False, GAIN_BUDGET),
}


@pytest.fixture(scope="module", autouse=True)
def warm() -> None:
    warm_up()


def states(key: str, low: float, step: float, *, fitted: bool) -> Callable[[], tuple[tuple[dict[str, Any], bytes], dict[str, Any]]]:
    """What gives the next state, and where they are handed on the models of one near by, as a benchmark's set-up."""
    values = itertools.count()

    def following() -> tuple[tuple[dict[str, Any], bytes], dict[str, Any]]:
        value = low + step * next(values)
        models = answer_parts({key: value + 0.003 * step}, [MODELS])[MODELS] if fitted else b""
        return ({key: value}, models), {}

    return following


def parts_of(names: Sequence[str], state: dict[str, Any], models: bytes) -> int:
    """Find a share's parts and count their bytes."""
    found = {**answer_parts(state, names), **(answer_promises(state, models) if models else {})}
    return sum(len(body) for body in found.values())


@pytest.mark.benchmark(timer=time.process_time)  # what else the machine does counts little so
@pytest.mark.parametrize("share", SHARES)
def test_a_share_of_live_parts(benchmark: BenchmarkFixture, share: str) -> None:
    key, low, step, names, fitted, budget = SHARES[share]
    size = benchmark.pedantic(lambda state, models: parts_of(names, state, models), setup=states(key, low, step, fitted=fitted), rounds=25)
    assert 3_000 < size < 400_000
    assert float(benchmark.stats.stats.min) < budget
