"""The routes that the benchmark compares lead to the same response, and an error of one would be seen."""

from types import ModuleType

import numpy as np
import pytest

from revline.analysis.trim import find_trim
from revline.engine.lee1995 import lee1995
from tests.benchmarks.loading import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("response_by_harmonic_balance")


def test_all_routes_give_one_response_within_their_accuracy(script: ModuleType) -> None:
    """Converged, at 25 +- 5 deg: 60.0056 rad/s and -3.164 deg at 0.1 rad/s, 0.2535 and -295.286 at 100."""
    engine, omega = lee1995(), np.array([0.1, 100.0])
    trim = find_trim(engine, inputs={"throttle": 25.0})
    exact = np.array([60.0056, 0.2535]) / 5.0 * np.exp(1j * np.radians([-3.164, -295.286]))
    measured = script.measure(script.make_routes(engine, trim, omega), exact, 1)
    assert [entry.name for entry in measured] == ["harmonic balance", "settled sinusoids", "the thesis's procedure"]
    for entry in measured:
        assert entry.error < 3e-4  # the digits given
        assert entry.seconds > 0.0
    shifted = script.measure(script.make_routes(engine, trim, omega)[:1], 1.01 * exact, 1)  # negative control
    assert shifted[0].error == pytest.approx(0.01, abs=1e-3)
