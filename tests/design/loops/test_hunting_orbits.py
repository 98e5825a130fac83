"""The engine's hunting under the thesis's first controller, computed as an orbit and compared with its simulation."""

import numpy as np
import pytest

from revline import signals
from revline.analysis.limit_cycles import CycleGuess, find_cycle, judge_cycle
from revline.analysis.trim import find_trim
from revline.dde.simulate import Start, simulate
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits, close_loop
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, operating_point
from revline.engine.lee1995 import lee1995
from revline.system import index_of

C1 = PidGains(kp=2.153, ki=16.85, kd=0.0, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="test")


@pytest.mark.reference
def test_c1_hunts_in_the_cycle_that_its_simulation_ends_in() -> None:
    """Converged simulation of Lee's C1 on his engine: 291.15 to 310.07 rad/s, period 0.2088 s, throttle 7 to 49 deg."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    loop = close_loop(engine, operating_point(trim), C1, wires=SPEED_BY_THROTTLE, limits=Limits(0.0, 79.46))
    speed, throttle = index_of(loop.outputs, "engine_speed"), index_of(loop.outputs, "control")
    held = loop.input_vector({loop.inputs[-1].name: trim.output("engine_speed")})
    start = Start(states=np.append(trim.states, 0.0), inputs=held)
    run = simulate(loop, start, {loop.inputs[-1].name: signals.step(60.0)}, until=30.0, step=1e-3)
    stepped = held.copy()
    stepped[-1] += 60.0
    cycle = find_cycle(loop, stepped, CycleGuess.from_run(run.times, run.states, 0.209))
    low, high = cycle.extremes(speed)
    assert (low, high) == pytest.approx((291.15, 310.07), abs=5e-3)
    assert cycle.period == pytest.approx(0.2088, abs=5e-5)
    assert cycle.extremes(throttle) == pytest.approx((7.0, 49.0), abs=0.5)
    last = run.outputs[-2000:, speed]
    assert (np.min(last), np.max(last)) == pytest.approx((low, high), abs=2e-3)
    judged = judge_cycle(loop, cycle, tolerance=1e-4)
    assert judged.stable
    assert judged.multipliers.largest == pytest.approx(0.62, abs=5e-3)
    assert judged.trivial_error < 1e-4
