from collections.abc import Callable

import numpy as np
import pytest

from revline.analysis.kinks import CLOSE, enclose
from revline.system import Floats

ROOT = 0.3


@pytest.mark.parametrize(
    ("curve", "most"),
    [
        (lambda t: np.sin(3.0 * t) - np.sin(3.0 * ROOT), 8),
        (lambda t: np.maximum(t - ROOT, 0.0), 25),  # a limit holds before it
        (lambda t: np.where(t < ROOT, -np.inf, 1.0), 60),
        (lambda t: np.where(t < ROOT, -1.0, 5.0), 60),
        (lambda t: (t - ROOT) ** 3, 80),
        (lambda t: np.where(t < ROOT, t - ROOT, 100.0 * (t - ROOT)), 80),
    ],
    ids=["smooth", "held", "infinite", "jump", "cube", "bend"],
)
def test_a_change_is_enclosed_to_rounding_and_in_few_steps_where_curves_allow(curve: Callable[[Floats], Floats], most: int) -> None:
    steps: list[Floats] = []

    def told(times: Floats) -> Floats:
        steps.append(times)
        return np.asarray(curve(times))

    ends = np.array([0.2983, 0.2999, 0.29]), np.array([0.3012, 0.31, 0.3005])
    found = enclose(told, ends, (np.asarray(curve(ends[0])), np.asarray(curve(ends[1]))))
    assert np.max(np.abs(found - ROOT)) <= 2.0 * CLOSE
    assert len(steps) <= most
