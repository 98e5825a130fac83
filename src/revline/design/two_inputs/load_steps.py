"""A step of the load on a nonlinear closed loop of two inputs, and what it is judged by.

Source: the idle-speed problem as in Hrovat and Sun (1997), Control Engineering Practice 5(8), 1093-1100.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline import signals as inputs
from revline.analysis.trim import Trim
from revline.dde.simulate import Options, Start
from revline.dde.tolerance import ConvergedRun, simulate_to_tolerance
from revline.dde.trajectory import Trajectory
from revline.design.loops.loop_simulation import describe_stall
from revline.design.loops.outcome import Stalled
from revline.design.two_inputs.mid_ranging_margins import close_both, resting_point
from revline.design.two_inputs.one_input import TwoInputSignals
from revline.design.two_inputs.torque_reserve import TorqueReserve
from revline.design.two_inputs.two_output_system import OutputRange, TwoOutputGains
from revline.errors import InvalidInputError, LagError, SimulationError, out_of_range
from revline.signals import Signal
from revline.system import DelaySystem, Floats, index_of
from revline.values import make_read_only

FINER, FINEST = 4, 16
"""A run that fails by a lag is made again with its samples the first times closer, up to the second."""

CONTROLLER_OUTPUTS = 4
"""The controller's outputs are the last of a loop: fast, slow, and both before their limits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadStep:
    """A step of the load at time 0, and how the answer is judged.

    Attributes:
        size: of the step, in the disturbance's unit.
        until: end of the record, in s.
        interval: between samples, in s.
        band: half width of the settling band, as a part of the measurement at rest.
        back: the fast input counts as back within this part of its own range about the set-point.
        tolerance: of the simulation, as a part of each state's range.

    Raises:
        InvalidInputError: a number is out of its range.
    """

    size: float
    until: float = 20.0
    interval: float = 0.01
    band: float = 0.01
    back: float = 0.02
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        if not (math.isfinite(self.size) and self.size != 0.0):
            raise out_of_range("step of the load", self.size, "", "finite values but 0", "give one such as 4")
        if not 10.0 * self.interval <= self.until <= 1e6 * self.interval:
            limit = f"{10.0 * self.interval:g} to {1e6 * self.interval:g} s"
            raise out_of_range("stop time", self.until, "s", limit, "give one in that range")
        for name, value in (("settling band", self.band), ("band of the fast input", self.back)):
            if not 0.0 < value < 1.0:
                raise out_of_range(name, value, "", "above 0 and below 1", "give one such as 0.01")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadStepRun:
    """What a loop did after a step of the load.

    Attributes:
        name: of the loop.
        task: the step.
        reserve: authority of the fast input at the trim.
        fast_range, slow_range: values at rest and limits of both inputs.
        times: in s from the step, shape (n,).
        measurement: what is controlled, shape (n,).
        fast, slow: both inputs after their limits, shape (n,).
        fast_wanted, slow_wanted: before their limits, shape (n,).
        step: of the simulation, in s.
        difference: to the run with twice that step, as a part of a state's range.
    """

    name: str
    task: LoadStep
    reserve: TorqueReserve
    fast_range: OutputRange
    slow_range: OutputRange
    times: Floats
    measurement: Floats
    fast: Floats
    slow: Floats
    fast_wanted: Floats
    slow_wanted: Floats
    step: float
    difference: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def error(self) -> Floats:
        """Measurement less its value at rest."""
        return np.asarray(self.measurement - self.measurement[0])

    @property
    def droop(self) -> float:
        """Largest deviation to the side to which the load pushes: below for a load that brakes, above for one taken away."""
        return float(np.max(-math.copysign(1.0, self.task.size) * self.error))

    @property
    def droop_time(self) -> float:
        """When the droop is largest, in s, to a sample."""
        return float(self.times[int(np.argmax(-math.copysign(1.0, self.task.size) * self.error))])

    @property
    def rebound(self) -> float:
        """Largest deviation to the other side."""
        return float(np.max(math.copysign(1.0, self.task.size) * self.error))

    @property
    def integrated_error(self) -> float:
        """Integral of the magnitude of the error, IAE, over the record."""
        return float(np.trapezoid(np.abs(self.error), self.times))

    @property
    def settling_time(self) -> float | None:
        """From when on the measurement stays within its band; none where it leaves it in the record's last tenth."""
        return self._from_when(np.abs(self.error) > self.task.band * abs(self.measurement[0]))

    @property
    def return_time(self) -> float | None:
        """From when on the fast input stays at its set-point, within its band; none where it is not back by the last tenth."""
        width = self.task.back * (self.fast_range.high - self.fast_range.low)
        return self._from_when(np.abs(self.fast - self.fast_range.rest) > width)

    def _from_when(self, outside: NDArray[np.bool_]) -> float | None:
        last = np.flatnonzero(outside)
        if not last.size:
            return 0.0
        k = min(int(last[-1]) + 1, self.times.size - 1)
        return float(self.times[k]) if self.times[k] < 0.9 * self.task.until else None

    @property
    def fast_travel(self) -> float:
        """Way of the fast input, both ways."""
        return float(np.sum(np.abs(np.diff(self.fast))))

    @property
    def slow_travel(self) -> float:
        """Way of the slow input, both ways."""
        return float(np.sum(np.abs(np.diff(self.slow))))

    @property
    def fast_left(self) -> float:
        """Distance of the fast input from its set-point at the end."""
        return float(abs(self.fast[-1] - self.fast_range.rest))

    @property
    def reserve_used(self) -> float:
        """Largest part of the reserve that the fast input called on, at the charge of the trim."""
        return max(0.0, float(np.max(self.reserve.quantity_at(self.fast) - self.reserve.value)) / self.reserve.reserve)

    @property
    def fast_saturated(self) -> float:
        """Part of the record in which the fast input stands at a limit."""
        return float(np.mean((self.fast_wanted < self.fast_range.low) | (self.fast_wanted > self.fast_range.high)))

    @property
    def slow_saturated(self) -> float:
        """Part of the record in which the slow input stands at a limit."""
        return float(np.mean((self.slow_wanted < self.slow_range.low) | (self.slow_wanted > self.slow_range.high)))


class LoopCase(NamedTuple):
    """A loop to run: its name, plant, law, and where it starts."""

    name: str
    system: DelaySystem
    law: TwoOutputGains
    trim: Trim


@dataclass(frozen=True, slots=True, kw_only=True)
class StalledRun:
    """A loop that a step of the load stalled.

    Attributes:
        name: of the loop.
        task: the step.
        stalled: when, and which state.
    """

    name: str
    task: LoadStep
    stalled: Stalled


def fast_limits(reserve: TorqueReserve, low: float | None = None, high: float | None = None) -> OutputRange:
    """Give limits of the fast input, by default as far back from the set-point as it is to the best value on the other side.

    Args:
        reserve: of the fast input.
        low: lower limit asked for.
        high: upper limit asked for.

    Raises:
        InvalidInputError: a limit lies beyond where the gain keeps its sign, or the set-point is not between them.
    """
    ends = reserve.range
    travel = abs(reserve.best - reserve.rest)
    chosen = (max(ends[0], reserve.rest - travel) if low is None else low, min(ends[1], reserve.rest + travel) if high is None else high)
    for name, value in zip(("lower", "upper"), chosen, strict=True):
        if not ends[0] <= value <= ends[1]:
            message = (
                f"{name} limit of {reserve.input} = {value:g} {reserve.unit} lies beyond {ends[0]:.6g} to {ends[1]:.6g} {reserve.unit}, "
                f"where {reserve.quantity} answers it with one sign; give limits within"
            )
            raise InvalidInputError(message, limit=value)
    if not chosen[0] < reserve.rest < chosen[1]:
        message = (
            f"limits {chosen[0]:g} to {chosen[1]:g} {reserve.unit} of {reserve.input} leave no room to both sides of its set-point, "
            f"{reserve.rest:g} {reserve.unit}; give limits about it"
        )
        raise InvalidInputError(message, low=chosen[0], high=chosen[1])
    return OutputRange(reserve.rest, *chosen)


def run_load_step(
    case: LoopCase, task: LoadStep, *, reserve: TorqueReserve, ranges: tuple[OutputRange, OutputRange], signals: TwoInputSignals
) -> LoadStepRun | StalledRun:
    """Run a nonlinear loop after a step of the load, to a tolerance, or tell that the load stalled it.

    Args:
        case: the loop.
        task: the step.
        reserve: of the fast input.
        ranges: of the fast and of the slow input.
        signals: names of the signals.

    Raises:
        InvalidInputError: limits exclude the trim, or the load leaves its range.
        NotConvergedError: halving the step did not reach the tolerance.
        SimulationError: the run failed in another way than by a stall.
    """
    fast, slow = ranges
    loop = close_both(case.system, case.law, fast=fast, slow=slow, signals=signals)
    point = resting_point(loop, case.trim, case.trim.output(signals.measurement))
    drive = {signals.disturbance: inputs.step(task.size)}
    found = _simulate(loop, Start(states=point.states, inputs=point.inputs), drive, task)
    if isinstance(found, SimulationError):
        return StalledRun(name=case.name, task=task, stalled=describe_stall(found, loop))
    return _record(case.name, task, reserve, ranges, (found.trajectory, found.difference, index_of(loop.outputs, signals.measurement)))


def _simulate(
    loop: DelaySystem, start: Start, drive: Mapping[str, Signal], task: LoadStep, pieces: int = 1
) -> ConvergedRun | SimulationError:
    """Run to a tolerance; what fails by a lag is run again with shorter steps, to tell whether the step or the model is at fault."""
    options, interval = Options(every=pieces), task.interval / pieces
    try:
        return simulate_to_tolerance(loop, start, drive, until=task.until, interval=interval, tolerance=task.tolerance, options=options)
    except LagError as error:
        return error if pieces >= FINEST else _simulate(loop, start, drive, task, FINER * pieces)
    except SimulationError as error:
        return error


def _record(
    name: str, task: LoadStep, reserve: TorqueReserve, ranges: tuple[OutputRange, OutputRange], found: tuple[Trajectory, float, int]
) -> LoadStepRun:
    trajectory, difference, row = found
    fast, slow, fast_wanted, slow_wanted = trajectory.outputs[:, -CONTROLLER_OUTPUTS:].T
    return LoadStepRun(
        name=name,
        task=task,
        reserve=reserve,
        fast_range=ranges[0],
        slow_range=ranges[1],
        times=trajectory.times,
        measurement=trajectory.outputs[:, row],
        fast=fast,
        slow=slow,
        fast_wanted=fast_wanted,
        slow_wanted=slow_wanted,
        step=trajectory.step,
        difference=difference,
    )
