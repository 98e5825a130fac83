"""Delayed negative feedback of one state, with a limit or smooth: one system for several tests, so that it is compiled once."""

from typing import NamedTuple

import numpy as np

from revline.equations import equation
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]


class Echo(NamedTuple):
    """Gain of the feedback, how its lag depends on the state, and whether it is limited to -1 to 1 (0) or bends smoothly (1)."""

    gain: float
    lag_slope: float = 0.0
    smooth: float = 0.0


@equation
def state_of(p: Echo, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def lags(p: Echo, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 + p.lag_slope * x[0],)


@equation
def rate(p: Echo, x: Vector, u: Vector, zd: Vector) -> Vector:
    limited = np.minimum(np.maximum(p.gain * zd[0], -1.0), 1.0)
    bent = p.gain * zd[0] / (1.0 + zd[0] * zd[0])
    return (u[0] - (1.0 - p.smooth) * limited - p.smooth * bent + 0.0 * x[0],)


def build_echo(parameters: Echo, name: str) -> DelaySystem:
    """Build the system x' = -f(x(t - lag)) + force."""
    return DelaySystem(
        name=name,
        parameters=parameters,
        states=(Variable(name="state0", unit="m", search_low=-5.0, search_high=5.0),),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(Variable(name="echo", unit="m"),),
        outputs=(Variable(name="seen", unit="m"),),
        emit=state_of,
        lags=lags,
        rate=rate,
        output=state_of,
    )
