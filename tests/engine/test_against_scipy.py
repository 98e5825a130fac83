"""The simulated engine against an integrator of another kind and another author: Dormand-Prince of order 8 in scipy.

The peer steps over no breakpoint: it stops where an input jumps and, found as an event, where a jump comes out of a channel.
Its engine is written here anew, from the relations of Lee (1995).
"""

import math
from bisect import bisect_right
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from revline.analysis.trim import find_trim
from revline.dde.simulate import Start, simulate
from revline.engine.lee1995 import lee1995
from revline.signals import step

NOMINAL = {"throttle": 25.0, "air_fuel_ratio": 15.0, "spark": 10.0, "load_torque": 0.0}
JUMP, UNTIL, DEGREE = 0.1234567, 0.5, math.pi / 180.0
GAS = 8.31434 / 28.84 * 310.0 / 0.0027
"""Pressure per mass of air in the manifold, kPa/kg."""


class Peer:
    """The engine from a trim, one input jumping once; `ask` gives the states at any time."""

    def __init__(self, states: np.ndarray, jumping: str, size: float) -> None:
        self.jumping, self.size = jumping, size
        self.starts: list[float] = [-math.inf]
        self.pieces: list[Callable[[float], np.ndarray]] = [lambda _: states]
        time, x = 0.0, states
        while time < UNTIL:
            sides = (time >= JUMP, *(time - angle / x[1] >= JUMP - 1e-12 for angle in (5.48, 1.30)))
            end = min(time + 0.002, UNTIL if sides[0] else JUMP)
            events = [self.arrival(angle) for angle, after in zip((5.48, 1.30), sides[1:], strict=True) if not after]
            done = solve_ivp(
                self.rate, (time, end), x, method="DOP853", rtol=1e-13, atol=1e-13, dense_output=True, events=events or None, args=(sides,)
            )
            self.starts.append(time)
            self.pieces.append(done.sol)
            time, x = float(done.t[-1]), done.y[:, -1]

    @staticmethod
    def arrival(angle: float) -> Callable[..., float]:
        def reached(time: float, x: np.ndarray, _: object) -> float:
            return time - angle / float(x[1]) - JUMP

        reached.terminal = True  # type: ignore[attr-defined]  # scipy's way to ask for it
        return reached

    def ask(self, time: float) -> np.ndarray:
        return self.pieces[max(bisect_right(self.starts, time) - 1, 0)](time)

    def given(self, name: str, *, after: bool) -> float:
        return NOMINAL[name] + (self.size if after and name == self.jumping else 0.0)

    def flow(self, pressure: float, speed: float) -> float:
        mass = pressure / GAS
        efficiency = (24.5 * speed - 3.1e4) * mass**2 + (222.0 - 0.167 * speed) * mass + 8.1e-4 * speed + 0.352
        return 0.112 * efficiency * speed * mass

    def rate(self, time: float, x: np.ndarray, sides: tuple[bool, bool, bool]) -> list[float]:
        pressure, speed = map(float, x)
        then = self.ask(time - 5.48 / speed)
        mixture = math.cos(7.3834 * (self.given("air_fuel_ratio", after=sides[1]) - 13.5) * DEGREE)
        charge = self.flow(*map(float, then)) * mixture / float(then[1])
        spark = math.cos(self.given("spark", after=sides[2]) * DEGREE) ** 2.875
        opening = 1.0 - math.cos((1.14459 * self.given("throttle", after=sides[0]) - 1.06) * DEGREE)
        inflow = 0.1843 * (1.0 - math.exp(9.0 * (pressure / 100.0 - 1.0))) * opening
        torque = 498636.0 * charge * spark - 15.1 - 0.1056 * speed - self.given("load_torque", after=sides[0])
        return [GAS * (inflow - self.flow(pressure, speed)), torque / 0.1454]


@pytest.mark.parametrize(
    ("jumping", "size"), [("throttle", 5.0), ("air_fuel_ratio", -2.0), ("spark", -25.0), ("load_torque", 8.0)], ids=str
)
def test_a_jump_of_each_input_agrees(jumping: str, size: float) -> None:
    """Two inputs act through the channels: their jump comes out of them later, at a time that depends on the speed."""
    engine = lee1995()
    trim = find_trim(engine)
    peer = Peer(np.asarray(trim.states), jumping, size)
    errors = []
    for parts in (160, 320):
        run = simulate(
            engine, Start(states=trim.states, inputs=trim.inputs), {jumping: step(size, start=JUMP)}, until=UNTIL, step=UNTIL / parts
        )
        assert np.ptp(run.states[:, 1]) > 1.0
        errors.append(max(float(np.max(np.abs(peer.ask(t) - x))) for t, x in zip(run.times.tolist(), run.states, strict=True)))
    assert errors[1] < 3e-7
    assert 3.7 < math.log2(errors[0] / errors[1]) < 4.5
