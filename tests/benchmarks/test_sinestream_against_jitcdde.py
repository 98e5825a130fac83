"""What the comparison with JiTCDDE rests on, without JiTCDDE: its equations, our half, and that wrong results are not timed."""

import math
import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from revline.engine.lee1995 import LEE_1995
from tests.benchmarks.loading import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("sinestream_against_jitcdde")


@pytest.fixture(scope="module")
def ours(script: ModuleType) -> Any:
    return script.make_revline()


@pytest.mark.parametrize("seed", range(5))
def test_the_equations_written_for_the_peer_are_revlines(script: ModuleType, ours: Any, seed: int) -> None:
    """Both lists of rates at random present and delayed states; the throttle away from its limits."""
    random = np.random.default_rng(seed)
    now, before = ((float(random.uniform(20.0, 80.0)), float(random.uniform(100.0, 500.0))) for _ in range(2))
    throttle = float(random.uniform(10.0, 60.0))
    inputs, engine = (throttle, script.AIR_FUEL_RATIO, script.SPARK, 0.0), ours.engine
    arriving = engine.emit(engine.parameters, before, inputs, (0.0, 0.0))
    found = script.engine_rates(LEE_1995, now, before, throttle, np)
    assert found == pytest.approx([float(rate) for rate in engine.rate(engine.parameters, now, inputs, arriving)], rel=1e-12)


@pytest.mark.reference
def test_the_reference_is_the_converged_simulation(script: ModuleType, ours: Any) -> None:
    """Source: Lee (1995), table 4.1 recomputed by converged simulation: 54.0116 rad/s at 1 rad/s and 4.4082 at 20 rad/s."""
    amplitudes = np.abs(ours.balance((1.0, 20.0))) * script.AMPLITUDE
    assert amplitudes == pytest.approx([54.0116, 4.4082], abs=5e-5)


def test_our_sinestream_meets_the_reference(script: ModuleType, ours: Any) -> None:
    found = ours.sine(20.0, 1e-7)
    error = script.relative(complex(found.fourier.values[0]), complex(ours.balance((20.0,))[0]))
    assert error <= 1e-7


def test_the_step_is_read_at_the_times_named(script: ModuleType, ours: Any) -> None:
    """A finer mesh gives the same speeds at the same times; read a sample off they would differ by more."""
    coarse, fine = ours.step(2.5e-3), ours.step(5e-4)
    assert coarse.shape == script.STEP_TIMES.shape
    assert np.max(np.abs(coarse - fine)) <= 1e-6
    assert np.max(np.abs(coarse[1:] - fine[:-1])) > 0.1


def test_the_fastest_of_those_accurate_enough_counts(script: ModuleType) -> None:
    def contestant(setting: str, error: float, work: int) -> Any:
        return script.Contestant(setting=setting, error=error, run=lambda: sum(range(work)))

    chosen = script.fastest([contestant("rough", 1e-3, 1), contestant("fast", 1e-7, 10), contestant("slow", 1e-9, 10**6)], 1e-6, "test")
    assert chosen.setting == "fast"


def test_a_contestant_that_is_never_accurate_is_named(script: ModuleType) -> None:
    poor = script.Contestant(setting="rough", error=1e-3, run=lambda: None)
    with pytest.raises(RuntimeError, match=r"the peer does not reach the accuracy 1e-06: its least error is 0\.001"):
        script.fastest([poor], 1e-6, "the peer")


def test_a_wrong_reference_is_not_timed(script: ModuleType, ours: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reference off by one part in a million is noticed before the peer is asked."""
    monkeypatch.setattr(script, "FREQUENCIES", (20.0,))
    wanted = ours.balance((20.0,)) * (1.0 + 1e-6)

    class Peer:
        def sine(self, *_: object, **__: object) -> complex:
            return complex(wanted[0])

    with pytest.raises(RuntimeError, match="revline's sinestream differs from harmonic balance at 20 rad/s by 1e-06, over 1e-09"):
        script.check_reference(ours, Peer(), wanted)


def test_a_wrong_peer_is_not_timed(script: ModuleType, ours: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "FREQUENCIES", (20.0,))

    class Peer:
        def sine(self, *_: object, **__: object) -> complex:
            return 1.0 + 0.0j

    with pytest.raises(RuntimeError, match="JiTCDDE differs from harmonic balance at 20 rad/s by "):
        script.check_reference(ours, Peer(), ours.balance((20.0,)))


def test_the_ratio_is_that_of_the_least_times(script: ModuleType) -> None:
    assert math.isclose(script.ratio_of([3.0, 2.0, 9.0], [1.0, 5.0, 4.0]), 2.0)


def test_a_missing_peer_is_named(script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "symengine", None)
    monkeypatch.setattr(sys, "argv", ["benchmark"])
    assert script.main() == 2
    assert "make .venv/.bench installs the peers" in capsys.readouterr().err
