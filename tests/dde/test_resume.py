"""A run stopped at any points of its grid and continued is, bit for bit, the run that did not stop."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline import signals
from revline.dde.kernel import Method
from revline.dde.simulate import Options, Start, Trajectory, resume, simulate
from revline.dde.tableau import HEUN
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.signals import Signal
from revline.system import DelaySystem
from tests.dde.probe import Probe, probe, start

STEP = 0.01
STEPS = 600
RECORDED = signals.recorded(np.linspace(0.05, 5.0, 40), np.sin(np.arange(40.0) ** 2))
SIGNALS = {
    "pulses": signals.pulse_cycle(1.0, 0.7),
    "sum": signals.pulse_cycle(0.5, 0.31) + signals.sine(0.3, 7.0) + signals.ramp(2.0, start=1.234, limit=0.7),
    "recording": RECORDED,
    "trapezoids and recording": signals.trapezoid_cycle(1.0, 0.2) + RECORDED,
    "nothing": Signal(),
}
LOOP = Probe(decay=1.0, feedback=-0.9, feed=1.0, direct=0.3, lag=0.5, lag_state=0.1, lag_clock=0.2, second_lag=0.4, second_lag_read=0.05)


def run_in_parts(
    system: DelaySystem, begin: Start, given: dict[str, Signal], stops: list[int], step: float, options: Options
) -> list[Trajectory]:
    parts = [simulate(system, begin, given, until=begin.time + stops[0] * step, step=step, options=options)]
    for stop in stops[1:]:
        parts.append(resume(system, given, parts[-1].checkpoint, until=begin.time + stop * step, options=options))
    return parts


def assert_same(whole: Trajectory, parts: list[Trajectory]) -> None:
    for name in ("times", "states", "inputs", "outputs"):
        together = np.concatenate([getattr(part, name) for part in parts])
        assert together.tobytes() == getattr(whole, name).tobytes(), name
    first, second = whole.checkpoint.run.state[0], parts[-1].checkpoint.run.state[0]
    for name in ("time", "x", "z", "zd", "u", "read_time"):
        assert np.asarray(first[name]).tobytes() == np.asarray(second[name]).tobytes(), name


@given(
    name=st.sampled_from(sorted(SIGNALS)),
    stops=st.lists(st.integers(1, STEPS - 1), min_size=1, max_size=4, unique=True).map(sorted),
    every=st.integers(1, 12),
    chunk=st.integers(1, 250),
    begin=st.sampled_from([0.0, -3.7, 1e4]),
)
@settings(deadline=None, max_examples=60)
def test_a_run_in_parts_is_the_whole_run(name: str, stops: list[int], every: int, chunk: int, begin: float) -> None:
    system, given_signals, origin = probe(LOOP), {"u": SIGNALS[name]}, start(1.0, time=begin)
    whole = simulate(system, origin, given_signals, until=begin + STEPS * STEP, step=STEP, options=Options(every=every))
    parts = run_in_parts(system, origin, given_signals, [*stops, STEPS], STEP, Options(every=every, chunk=chunk))
    assert_same(whole, parts)


@given(stops=st.lists(st.integers(1, 2999), min_size=1, max_size=3, unique=True).map(sorted), chunk=st.integers(1, 2000))
@settings(deadline=None, max_examples=20)
def test_an_engine_run_in_parts_is_the_whole_run(stops: list[int], chunk: int) -> None:
    engine = lee1995()
    begin = Start(states=np.array([35.8072, 240.799]), inputs=engine.input_vector())
    given_signals = {"throttle": signals.pulse_cycle(5.0, 0.5) + signals.sine(1.0, 10.0), "load_torque": signals.step(3.0, start=0.4441)}
    whole = simulate(engine, begin, given_signals, until=3.0, step=1e-3)
    assert_same(whole, run_in_parts(engine, begin, given_signals, [*stops, 3000], 1e-3, Options(chunk=chunk)))


def test_a_checkpoint_stays_what_it_was() -> None:
    system, given_signals = probe(LOOP), {"u": SIGNALS["pulses"]}
    first = simulate(system, start(1.0), given_signals, until=1.0, step=STEP)
    once, again = (resume(system, given_signals, first.checkpoint, until=3.0) for _ in range(2))
    assert once.states.tobytes() == again.states.tobytes()
    assert first.checkpoint.time == 1.0
    assert once.times[0] == pytest.approx(1.0 + STEP)


def test_storing_and_method_are_those_of_the_run() -> None:
    system = probe(LOOP)
    options = Options(every=5, method=Method(tableau=HEUN))
    first = simulate(system, start(1.0), {}, until=1.0, step=STEP, options=options)
    assert (first.checkpoint.every, first.checkpoint.step) == (5, STEP)
    second = resume(system, {}, first.checkpoint, until=2.0)
    whole = simulate(system, start(1.0), {}, until=2.0, step=STEP, options=options)
    assert_same(whole, [first, second])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"system": probe(LOOP._replace(decay=1.1))},
            "^this run was made with another system or other parameters than probe has now; start",
        ),
        (
            {"signals": {"u": signals.step(2.0)}},
            "^this run was made with other input signals; continue it with the same, or start a new run$",
        ),
        ({"signals": {}}, "^this run was made with other input signals"),
        ({"options": Options(method=Method(tableau=HEUN))}, "^this run was made with another method; continue it with the same, or start"),
        ({"options": Options(every=3)}, r"^this run stores each 1\. step; continue it with every = 1, not 3$"),
        ({"until": 1.0}, "^stop time = 1 s is outside values after the start at 1 s; give a later stop time$"),
        ({"until": 0.5}, "^stop time = 0.5 s is outside values after the start at 1 s"),
        ({"until": 1.0 + 1e-13}, "^stop time = 1 s is outside values a step after the start at 1 s"),
        ({"until": float("nan")}, "^stop time = nan s is outside values after the start at 1 s"),
    ],
)
def test_a_wrong_continuation_is_refused(change: dict[str, Any], message: str) -> None:
    system, given_signals = probe(LOOP), {"u": signals.step(1.0)}
    first = simulate(system, start(1.0), given_signals, until=1.0, step=STEP)
    arguments: dict[str, Any] = {"system": system, "signals": given_signals, "checkpoint": first.checkpoint, "until": 2.0, **change}
    with pytest.raises(InvalidInputError, match=message):
        resume(**arguments)
