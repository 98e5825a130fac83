"""Small systems to connect: a lag behind a delay, and a summing point; with what their connections must give."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from revline.analysis.linearize import linearize
from revline.equations import equation
from revline.system import DelaySystem, Variable

Vector = tuple[Any, ...]


class Block(NamedTuple):
    """One lag behind a delay: x' = gain u(t - delay) - pole x; y = x + direct u."""

    gain: float = 2.0
    pole: float = 3.0
    delay: float = 0.2
    direct: float = 0.5


@equation
def send(p: Block, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.gain * u[0],)


@equation
def delay(p: Block, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.delay,)


@equation
def lag(p: Block, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (zd[0] - p.pole * x[0],)


@equation
def strictly(p: Block, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 * x[0],)


@equation
def directly(p: Block, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0] + p.direct * u[0],)


@equation
def read_out(p: Block, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 * zd[0],)


@equation
def nothing(p: Any, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return ()


def block(name: str, output: Any, parameters: Block | None = None) -> DelaySystem:
    return DelaySystem(
        name=name,
        parameters=parameters or Block(),
        states=(Variable(name="level", unit="m"),),
        inputs=(Variable(name="drive", unit="m"),),
        channels=(Variable(name="sent", unit="m/s"),),
        outputs=(Variable(name="answer", unit="m"),),
        emit=send,
        lags=delay,
        rate=lag,
        output=output,
    )


class Difference(NamedTuple):
    """u = scale (r - y), and what limits, bends or divides it."""

    scale: float = 1.0


@equation
def difference(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.scale * (u[0] - u[1]),)


@equation
def limited(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (np.minimum(p.scale * (u[0] - u[1]), 1.0),)


@equation
def scheduled(p: Difference, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (np.exp(0.1 * u[0]) * (u[0] - u[1]) * p.scale / (2.0 + np.sin(u[0])) - 0.0 * u[1] + (-(+u[1])),)


def summing(output: Any = difference, scale: float = 1.0) -> DelaySystem:
    return DelaySystem(
        name="sum",
        parameters=Difference(scale),
        states=(),
        inputs=(Variable(name="command", unit="m"), Variable(name="measured", unit="m")),
        channels=(),
        outputs=(Variable(name="error", unit="m"),),
        emit=nothing,
        lags=nothing,
        rate=nothing,
        output=output,
    )


@dataclass(frozen=True)
class Rest:
    states: np.ndarray
    inputs: np.ndarray
    channels: np.ndarray


def transfer(system: DelaySystem, s: np.ndarray, output: int = -1) -> np.ndarray:
    rest = Rest(*(np.zeros(len(v)) for v in (system.states, system.inputs, system.channels)))
    return linearize(system, rest).model.transfer(s)[..., output, :]


def exact(p: Block, s: np.ndarray, *, direct: bool) -> np.ndarray:
    return np.asarray(p.gain * np.exp(-s * p.delay) / (s + p.pole) + (p.direct if direct else 0.0))
