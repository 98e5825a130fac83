"""Small systems with known steady states, made as a user would make them."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from revline.engine.lee1995 import lee1995
from revline.equations import equation
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]


class Plain(NamedTuple):
    gain: float = 1.0
    lag: float = 1.0


def variable(name: str, low: float = -10.0, high: float = 10.0, unit: str = "m", nominal: float = 0.0) -> Variable:
    return Variable(name=name, unit=unit, search_low=low, search_high=high, nominal=nominal)


INPUT = Variable(name="force", unit="N", low=-5.0, high=5.0)


@equation
def position_out(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def first_state(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def fixed_lag(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.lag,)


def scalar_system(name: str, rate: object, state: Variable | None = None, parameters: Plain | None = None) -> DelaySystem:
    """One state, whose value is read back through one channel."""
    return DelaySystem(
        name=name,
        parameters=parameters or Plain(),
        states=(state or variable("position"),),
        inputs=(INPUT,),
        channels=(variable("echo"),),
        outputs=(variable("position"),),
        emit=first_state,
        lags=fixed_lag,
        rate=rate,  # type: ignore[arg-type]  # a plain function; its exact signature does not matter here
        output=position_out,
    )


@equation
def linear_rate(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:
    return (-0.5 * x[0] - p.gain * zd[0] + u[0],)


@equation
def endless_rate(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 + x[0] * x[0] + 0.0 * zd[0],)


@equation
def idle_rate(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[0] + 0.0 * zd[0],)


@equation
def kinked_rate(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (np.minimum(u[0], 1.0) - np.maximum(zd[0], 2.0 * zd[0]) + 0.25 * x[0] * x[0] - 0.25 * zd[0] * zd[0],)


@equation
def cubic_rate(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0] - zd[0] * zd[0] * zd[0] + u[0],)


@pytest.fixture(scope="session")
def engine() -> DelaySystem:
    return lee1995()


@pytest.fixture
def linear() -> DelaySystem:
    """x' = -x/2 - x(t - 1) + u: at rest x = u / 1.5."""
    return scalar_system("linear", linear_rate)


@pytest.fixture
def endless() -> DelaySystem:
    """x' = 1 + x^2: nowhere at rest, nearest so at 0."""
    return scalar_system("endless", endless_rate)


@pytest.fixture
def idle() -> DelaySystem:
    """x' = u: at rest anywhere without input."""
    return scalar_system("idle", idle_rate)


@pytest.fixture
def kinked() -> DelaySystem:
    """A limit on the force at 1, and a kink where the position passes 0."""
    return scalar_system("kinked", kinked_rate)


@pytest.fixture
def cubic() -> DelaySystem:
    """x' = x - x(t - 1)^3 + u: with u = 0 at rest at -1, 0 and 1."""
    return scalar_system("cubic", cubic_rate, state=variable("position", -3.0, 3.0))


@equation
def pendulum_rate(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:
    angle, speed = x
    return speed, -np.sin(angle) - speed + u[0] - p.gain * (zd[0] - angle)


@pytest.fixture
def pendulum() -> DelaySystem:
    """A damped pendulum: hangs at 0, stands at pi."""
    return DelaySystem(
        name="pendulum",
        parameters=Plain(gain=0.1, lag=0.5),
        states=(variable("angle", -1.0, 4.0, "rad"), variable("speed", -2.0, 2.0, "rad/s")),
        inputs=(INPUT,),
        channels=(variable("seen", unit="rad"),),
        outputs=(variable("angle", unit="rad"),),
        emit=first_state,
        lags=fixed_lag,
        rate=pendulum_rate,
        output=position_out,
    )


@equation
def chain_emit(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return x[0] * x[0], 2.0 * zd[0] + u[0]


@equation
def chain_lags(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return p.lag + 0.1 * x[0] * x[0], 0.5 * p.lag


@equation
def chain_rate(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (3.0 - x[0] - zd[1],)


@pytest.fixture
def chain() -> DelaySystem:
    """A channel that reads a channel: at rest 3 - x - 2 x^2 - u = 0, so at x = 1 and -1.5 without input."""
    return DelaySystem(
        name="chain",
        parameters=Plain(),
        states=(variable("level", 0.0, 5.0),),
        inputs=(INPUT,),
        channels=(variable("first"), variable("second")),
        outputs=(),
        emit=chain_emit,
        lags=chain_lags,
        rate=chain_rate,
        output=nothing_out,
    )


@pytest.fixture
def chain_out(chain: DelaySystem) -> DelaySystem:
    """The same with its level as output, and half the feedback, so that it is stable."""
    return replace(chain, outputs=(variable("level"),), output=first_state, emit=gentle_chain_emit)


@equation
def gentle_chain_emit(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return x[0] * x[0], 0.1 * zd[0] + u[0]


@equation
def nothing_out(p: Plain, x: Vector, u: Vector, zd: Vector) -> tuple[()]:  # noqa: ARG001 - the form of all equations
    return ()


@equation
def loop_emit(p: Plain, x: Vector, u: Vector, zd: Vector) -> Vector:
    return (x[0] + p.gain * np.sin(zd[0]) + u[0],)


@pytest.fixture
def loop() -> DelaySystem:
    """A channel that reads itself: z = x + gain sin(z) + u."""
    return DelaySystem(
        name="loop",
        parameters=Plain(gain=0.5),
        states=(variable("level"),),
        inputs=(INPUT,),
        channels=(variable("echo"),),
        outputs=(),
        emit=loop_emit,
        lags=fixed_lag,
        rate=linear_rate,
        output=nothing_out,
    )


class Wiener(NamedTuple):
    """Parameters of a delayed lag whose output is bent."""

    pole: float = 3.0
    lag: float = 0.3
    lag_slope: float = 0.0
    curve: float = 0.2


@equation
def wiener_emit(p: Wiener, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[0],)


@equation
def wiener_lags(p: Wiener, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.lag + p.lag_slope * x[0],)


@equation
def wiener_rate(p: Wiener, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.pole * (zd[0] - x[0]),)


@equation
def wiener_output(p: Wiener, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    square = x[0] * x[0]
    return x[0], x[0] + p.curve * square, square, x[0] * square, np.minimum(x[0], 0.6), p.curve + 0.0 * x[0]


WIENER_OUTPUTS = ("straight", "bent", "square", "cube", "limited", "constant")


def build_wiener(parameters: Wiener) -> DelaySystem:
    return DelaySystem(
        name="wiener",
        parameters=parameters,
        states=(Variable(name="level", unit="m", low=-4.0, high=50.0, search_low=-3.0, search_high=3.0),),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(variable("sent", unit="N"),),
        outputs=tuple(variable(name) for name in WIENER_OUTPUTS),
        emit=wiener_emit,
        lags=wiener_lags,
        rate=wiener_rate,
        output=wiener_output,
    )


@pytest.fixture(scope="session")
def wiener() -> DelaySystem:
    """x' = 3 (u(t - 0.3) - x), with outputs x, x + 0.2 x^2, x^2, x^3, min(x, 0.6) and a constant."""
    return build_wiener(Wiener())


@pytest.fixture(scope="session")
def shrinking(wiener: DelaySystem) -> DelaySystem:
    """The same with a lag that depends on the level: 0.06 + 0.05 x."""
    return wiener.with_parameters(Wiener(lag=0.06, lag_slope=0.05))


@pytest.fixture(scope="session")
def runaway(wiener: DelaySystem) -> DelaySystem:
    """The same with an unstable pole."""
    return wiener.with_parameters(Wiener(pole=-1.0))
