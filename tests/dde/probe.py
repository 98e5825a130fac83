"""One delay system that serves all problems with known solutions by its parameters, so that few kernels are compiled."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from revline.dde.kernel import STANDARD, Method
from revline.dde.simulate import Options, Start, Trajectory, simulate
from revline.equations import equation
from revline.signals import Signal, evaluate_term
from revline.system import DelaySystem, Variable

Floats = NDArray[np.float64]
Vector = tuple[float, ...]
Solution = Callable[[Floats], Floats]


class Probe(NamedTuple):
    """Weights of all terms; with all of them zero nothing moves but the clock."""

    decay: float = 0.0
    growth: float = 0.0
    source: float = 0.0
    feedback: float = 0.0
    direct: float = 0.0
    feed: float = 0.0
    lag: float = 1.0
    lag_state: float = 0.0
    lag_clock: float = 0.0
    lag_input: float = 0.0
    second_lag: float = 1.0
    second_lag_read: float = 0.0


@equation
def truth(t: Any) -> Any:
    """The solution that the source makes true: 1 before time 0."""
    after = np.maximum(t, 0.0)
    return 1.0 + np.sin(after) * np.exp(-0.3 * after)


@equation
def truth_rate(t: float) -> float:
    """Its rate after time 0."""
    return (np.cos(t) - 0.3 * np.sin(t)) * np.exp(-0.3 * t)


@equation
def first_lag(p: Probe, x: float, t: float) -> float:
    return p.lag + p.lag_state * x + p.lag_clock * np.sin(t)


@equation
def emit(p: Probe, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return x[0] + 0.0, u[0] + 0.0, zd[1] + 0.0


@equation
def lags(p: Probe, x: Vector, u: Vector, zd: Vector) -> Vector:
    lag = first_lag(p, x[0], x[1]) + p.lag_input * u[1]
    return lag, lag, p.second_lag + p.second_lag_read * zd[0]


@equation
def rate(p: Probe, x: Vector, u: Vector, zd: Vector) -> Vector:
    t = x[1]
    past = truth(t - first_lag(p, truth(t), t))
    forcing = truth_rate(t) + p.decay * truth(t) - p.feedback * past
    own = p.source * forcing - p.decay * x[0] + p.growth * x[0] * x[0]
    return own + p.direct * (u[0] + u[1]) + p.feedback * zd[0] + p.feed * zd[1], 1.0


@equation
def output(p: Probe, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return x[0] + 0.0, zd[1] + 0.0, zd[2] + 0.0


def variable(name: str, low: float = -math.inf, high: float = math.inf) -> Variable:
    return Variable(name=name, unit="m", low=low, high=high)


def probe(parameters: Probe | None = None, *, low: float = -math.inf, high: float = math.inf) -> DelaySystem:
    """The system with some parameters; x leaves its range beyond low or high."""
    return DelaySystem(
        name="probe",
        parameters=parameters or Probe(),
        states=(variable("x", low, high), variable("clock")),
        inputs=(variable("u", -1e3, 1e3), variable("shift", -1e3, 1e3)),
        channels=(variable("x_old"), variable("u_old"), variable("u_older")),
        outputs=(variable("x"), variable("u_old"), variable("u_older")),
        emit=emit,
        lags=lags,
        rate=rate,
        output=output,
    )


def start(x: float = 0.0, *, u: float = 0.0, time: float = 0.0) -> Start:
    return Start(states=np.array([x, time]), inputs=np.array([u, 0.0]), time=time)


@dataclass(frozen=True)
class Problem:
    """A problem with the solution of one output."""

    parameters: Probe
    until: float
    solution: Solution
    x0: float = 0.0
    signals: Mapping[str, Signal] = field(default_factory=dict)
    output: str = "x"

    def run(self, count: int, method: Method = STANDARD) -> Trajectory:
        options = Options(method=method)
        return simulate(probe(self.parameters), start(self.x0), self.signals, until=self.until, step=self.until / count, options=options)

    def error(self, count: int, method: Method = STANDARD) -> float:
        """Largest error over all samples of a run in so many steps."""
        run = self.run(count, method)
        return float(np.max(np.abs(run.output(self.output) - self.solution(run.times))))


def observed_order(problem: Problem, counts: Sequence[int], method: Method = STANDARD) -> float:
    """Slope of the error over the step on logarithmic axes, by least squares: meshes that do not align make single pairs scatter."""
    errors = [problem.error(count, method) for count in counts]
    return -float(np.polyfit(np.log(np.array(counts, dtype=float)), np.log(errors), 1)[0])


def solve_by_steps(feedback: float, lag: float) -> Solution:
    """Solution of x' = feedback x(t - lag), x = 1 before time 0: by the method of steps a polynomial in each interval of a lag."""

    def solution(times: Floats) -> Floats:
        total = np.ones_like(times)
        for k in range(1, int(times[-1] / lag) + 2):
            total += feedback**k * np.maximum(times - (k - 1) * lag, 0.0) ** k / math.factorial(k)
        return total

    return solution


def solve_forced(parameters: Probe, until: float, **signals: Signal) -> Solution:
    """Solution of x' = feed u(t - lag(t)) + direct (u(t) + shift(t)) - decay x from 0, piece by piece between breaks, to rounding."""
    p = parameters

    def read_time(t: float) -> float:
        return t - p.lag - p.lag_clock * math.sin(t)

    def value(name: str, t: float, reference: float) -> float:
        signal = signals.get(name, Signal())
        return sum(evaluate_term(row, signal.record, t, reference) for row in signal.rows())

    def rate_at(t: float, x: float, reference: float) -> float:
        direct = value("u", t, reference) + value("shift", t, reference)
        return p.feed * value("u", read_time(t), read_time(reference)) + p.direct * direct - p.decay * x

    breaks = {point.time for signal in signals.values() for point in signal.breakpoints(-1.0, until)}
    met = {brentq(lambda t, b=b: read_time(t) - b, 0.0, until, xtol=1e-15) for b in breaks if read_time(0.0) < b < read_time(until)}
    edges = [0.0, *sorted(b for b in breaks | met if 0.0 < b < until), until]

    def solution(times: Floats) -> Floats:
        result, x = np.zeros_like(times), 0.0
        for low, high in itertools.pairwise(edges):
            middle = 0.5 * (low + high)
            found = solve_ivp(
                lambda t, y, m=middle: [rate_at(t, y[0], m)], (low, high), [x], "DOP853", dense_output=True, rtol=1e-13, atol=1e-15
            )
            inside = (times >= low) & (times <= high)
            x = float(found.y[0, -1])
            if inside.any():
                result[inside] = found.sol(times[inside])[0]
        return result

    return solution
