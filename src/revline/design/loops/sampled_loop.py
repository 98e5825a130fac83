"""Closed loops whose controller is sampled, on any system with its delays: simulated as an engine computer would run them.

The controller sees the measurement at its samples only, with noise and at shifted times where these are asked for; between, its
output is held. Source: Astrom and Wittenmark (1997), Computer-Controlled Systems, chapters 3 and 9.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.connection import connect
from revline.dde.simulate import Options, Start
from revline.dde.simulate_sampled import SampledTrajectory, Sampler, Wiring, simulate_sampled
from revline.design.controllers.pid_controller import Continuous, PidController
from revline.design.controllers.pid_update import sampled_pid
from revline.design.controllers.scheduled_pid import MEASUREMENT_BEFORE, AnyController, ScheduledController, law_of, scheduled_pid
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, OperatingPoint
from revline.equations import equation
from revline.errors import InvalidInputError, out_of_range
from revline.sampled import CrankSynchronous, FixedRate, SampledController
from revline.signals import Signal
from revline.system import DelaySystem, Variable, index_of
from revline.units import Seconds
from revline.values import make_read_only

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Vector = tuple[float, ...]

COMMAND, ANGLE = "command", "crank_angle"

SHIFT_LIMIT = 4.0
"""Noise and shifts of samples are cut off at so many standard deviations."""

AT_LIMIT = 1e-9
"""An output this near to a limit, as a part of it, is at it: clamping keeps a sum there, which rounds."""


class Counter(NamedTuple):
    """Parameter of what counts the crank's angle: radians of the crank per radian of the measured speed."""

    ratio: float


@equation
def _emit(p: Counter, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return ()


@equation
def _rate(p: Counter, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.ratio * u[0],)


@equation
def _output(p: Counter, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return 1.0 * x[0], 1.0 * u[1]


def _counter(unit: str) -> DelaySystem:
    return DelaySystem(
        name="sampling",
        parameters=Counter(1.0),
        states=(Variable(name=ANGLE, unit="rad", description="angle of the crank since the start"),),
        inputs=(
            Variable(name="crank_speed", unit="rad/s", description="speed of the crank"),
            Variable(name=COMMAND, unit=unit, description="wanted value"),
        ),
        channels=(),
        outputs=(
            Variable(name=ANGLE, unit="rad", description="angle of the crank since the start"),
            Variable(name=COMMAND, unit=unit, description="wanted value"),
        ),
        emit=_emit,
        lags=_emit,
        rate=_rate,
        output=_output,
    )


@functools.lru_cache(maxsize=64)
def with_command(plant: DelaySystem, measurement: str) -> DelaySystem:
    """Add to a plant what a sampled controller reads beside it: a command, and the crank's angle where a speed is measured.

    Args:
        plant: what is controlled.
        measurement: name of the output that the controller measures.
    """
    unit = plant.outputs[index_of(plant.outputs, measurement)].unit
    wires = {"crank_speed": measurement} if unit == "rad/s" else {}
    return connect(plant, _counter(unit), to_first={}, to_second=wires, name=f"{plant.name} with command")


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """What disturbs the samples, from a seeded generator: equal seeds give equal runs.

    Attributes:
        noise: standard deviation of what is added to each measurement, in its unit; normal, cut off at four deviations.
        jitter: standard deviation of each sample's shift, in s (for sampling by the crank's angle in rad); likewise.
        seed: of the generator.

    Raises:
        InvalidInputError: a deviation is negative or no finite number.
    """

    noise: float = 0.0
    jitter: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in (("noise", self.noise), ("jitter", self.jitter)):
            if not (np.isfinite(value) and value >= 0.0):
                raise out_of_range(name, value, "", "0 and above", "give a standard deviation")


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledTask:
    """What is asked of a sampled loop.

    Attributes:
        command: added to the measurement at rest, a signal.
        until: stop time, in s.
        step: of the simulation, in s.
        disturbance: noise and jitter.
        loads: signals of inputs that the controller does not drive, by name, for example a step of "load_torque".
        every: each how-manieth step of the simulation is kept.
    """

    command: Signal
    until: Seconds
    step: Seconds = 1e-3
    disturbance: Disturbance = field(default_factory=Disturbance)
    loads: Mapping[str, Signal] = field(default_factory=lambda: MappingProxyType({}))
    every: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledRun:
    """A loop under a sampled controller: what the system did, and what the controller did at each sample.

    Attributes:
        plant: name of the plant.
        controller: what was sampled.
        code: its sampled form, with the parameters that it ran with.
        start: measurement before the run, in its unit.
        times: of the system's samples, shape (n,), in s.
        output: the measured output without noise, shape (n,).
        command: shape (n,).
        control: what drives the system, shape (n,).
        sampled: all that was recorded, also at the controller's samples.
    """

    plant: str
    controller: AnyController
    code: SampledController
    start: float
    times: Floats
    output: Floats
    command: Floats
    control: Floats
    sampled: SampledTrajectory

    def __post_init__(self) -> None:
        make_read_only(self)

    def of_controller(self, name: str) -> Floats:
        """One of the controller's outputs at its samples, for example "integral", shape (k,).

        Raises:
            InvalidInputError: there is no such output.
        """
        return self.sampled.outputs[:, index_of(self.code.outputs, name)]

    @property
    def at_low_limit(self) -> Bools:
        """At which of its samples the controller's output is held by the lower limit, shape (k,)."""
        low = law_of(self.controller).low
        return self.of_controller("control") <= low + _rounding_at(low)

    @property
    def at_high_limit(self) -> Bools:
        """At which of its samples the controller's output is held by the upper limit, shape (k,)."""
        high = law_of(self.controller).high
        return self.of_controller("control") >= high - _rounding_at(high)

    @property
    def saturated_share(self) -> float:
        """Part of the samples at which the output was held by one of its limits."""
        return float(np.mean(self.at_low_limit | self.at_high_limit))


def _rounding_at(bound: float) -> float:
    return AT_LIMIT * max(1.0, abs(bound)) if math.isfinite(bound) else 0.0


def run_sampled_loop(
    plant: DelaySystem,
    point: OperatingPoint,
    controller: AnyController,
    task: SampledTask,
    *,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    options: Options | None = None,
) -> SampledRun:
    """Run a loop under a sampled controller from a point of rest, without a jump at its start.

    Args:
        plant: nonlinear or linear, with its delays.
        point: of rest, for example a trim's.
        controller: fixed-rate or crank-synchronous; a scheduled one reads its second signal from the plant's input of that name.
        task: what is asked.
        wires: which signals close the loop.
        options: method, progress and interruption; storing is the task's.

    Raises:
        InvalidInputError: signals are missing, the controller is continuous, its limits leave the input's range or exclude the trim, or
            the samples are shifted so far that their order could change.
        SimulationError: the run ends before its time, with time and place.
    """
    law = law_of(controller)
    _check_limits(plant, law, wires)
    check_schedule(plant, controller, wires)
    rest = float(point.inputs[wires.drive])
    if isinstance(controller, ScheduledController):
        code = scheduled_pid(controller.schedule, law, output=rest, measurement=point.measurement)
        read = [(COMMAND, point.measurement), (controller.schedule.names[1], float(point.inputs[controller.schedule.names[1]]))]
    else:
        code = sampled_pid(law, output=rest, measurement=point.measurement)
        read = [(COMMAND, point.measurement)]
    whole = with_command(plant, wires.measurement)
    states = np.array(code.start(code.parameters, (point.measurement,), tuple(value for _, value in read), (rest,)), dtype=float)
    sampler = _sampler(law, code, states, tuple(name for name, _ in read), task, wires)
    inputs = whole.input_vector({**point.inputs, COMMAND: point.measurement})
    start = Start(states=np.append(point.states, 0.0), inputs=inputs)
    signals = {COMMAND: task.command, **task.loads}
    options = options or Options()
    found = simulate_sampled(
        whole,
        start,
        signals,
        sampler,
        until=task.until,
        step=task.step,
        options=replace(options, every=task.every),
    )
    record = found.trajectory
    return SampledRun(
        plant=plant.name,
        controller=controller,
        code=code,
        start=point.measurement,
        times=record.times,
        output=record.output(wires.measurement),
        command=record.output(COMMAND),
        control=record.input(wires.drive),
        sampled=found,
    )


def check_schedule(plant: DelaySystem, controller: AnyController, wires: LoopSignals) -> None:
    """Refuse a gain schedule over signals that its controller does not read from a plant; fixed gains pass.

    Args:
        plant: what is controlled.
        controller: with its schedule, if it has one.
        wires: which signals close the loop.

    Raises:
        InvalidInputError: the first signal is not the measurement, the second is no input of the plant, or is counted in another unit.
    """
    if not isinstance(controller, ScheduledController):
        return
    first, second = controller.schedule.names
    if first != wires.measurement:
        message = f"the gain schedule is over {first}, and the controller measures {wires.measurement}; schedule over that"
        raise InvalidInputError(message)
    ours, theirs = controller.schedule.units[1], plant.inputs[index_of(plant.inputs, second)].unit
    if ours != theirs:
        message = f"the gain schedule counts {second} in {ours} and {plant.name} has it in {theirs}; convert its axis"
        raise InvalidInputError(message)


def _check_limits(plant: DelaySystem, controller: PidController, wires: LoopSignals) -> None:
    drive = plant.inputs[index_of(plant.inputs, wires.drive)]
    if not (drive.low <= controller.low and controller.high <= drive.high):
        message = (
            f"the controller's output from {controller.low:g} to {controller.high:g} {controller.gains.output_unit} leaves the range of "
            f"{drive.name}, {drive.low:g} to {drive.high:g} {drive.unit}; limit its output"
        )
        raise InvalidInputError(message, low=controller.low, high=controller.high)
    measured = plant.outputs[index_of(plant.outputs, wires.measurement)]
    for ours, theirs, name in (
        (controller.gains.output_unit, drive.unit, drive.name),
        (controller.gains.input_unit, measured.unit, measured.name),
    ):
        if ours != theirs:
            message = f"the controller counts {name} in {ours} and {plant.name} has it in {theirs}; convert the gains"
            raise InvalidInputError(message)


def _sampler(
    controller: PidController, code: SampledController, states: Floats, commands: tuple[str, ...], task: SampledTask, wires: LoopSignals
) -> Sampler:
    sampling = controller.sampling
    if isinstance(sampling, Continuous):
        message = "a continuous controller is not sampled; give it a sampling, or run it with run_loop()"
        raise InvalidInputError(message)
    crank = isinstance(sampling, CrankSynchronous)
    if crank and controller.gains.input_unit != "rad/s":
        message = f"sampling by the crank's angle needs a speed in rad/s; the measurement is in {controller.gains.input_unit}"
        raise InvalidInputError(message)
    spacing = sampling.period if isinstance(sampling, FixedRate) else sampling.angle
    room = spacing - sampling.computation_delay if isinstance(sampling, FixedRate) else spacing
    largest = SHIFT_LIMIT * task.disturbance.jitter
    if 2.0 * largest >= room:
        unit = "rad" if crank else "s"
        limit = f"0 to below {room / (2.0 * SHIFT_LIMIT):.3g} {unit}"
        remedy = "shifts must leave the samples in their order, and the output in time"
        raise out_of_range("jitter", task.disturbance.jitter, unit, limit, remedy)
    measured = float(states[MEASUREMENT_BEFORE])
    return Sampler(
        controller=code,
        wiring=Wiring(drives=(wires.drive,), measures=(wires.measurement,), commands=commands, angle=ANGLE if crank else None),
        sampling=sampling,
        states=states,
        elapsed=sampling.period_at(measured),
        disturb=_disturb(task.disturbance),
    )


def _disturb(disturbance: Disturbance) -> "_Rows | None":
    return _Rows(disturbance) if disturbance.noise > 0.0 or disturbance.jitter > 0.0 else None


class _Rows:
    """Rows of shifts and noise, from one generator, so that they do not depend on how many are asked for at once."""

    def __init__(self, disturbance: Disturbance) -> None:
        self._generator = np.random.default_rng(disturbance.seed)
        self._sizes = np.array([disturbance.jitter, disturbance.noise])
        self._first = True

    def __call__(self, count: int) -> Floats:
        rows = np.clip(self._generator.standard_normal((count, 2)), -SHIFT_LIMIT, SHIFT_LIMIT) * self._sizes
        if self._first:
            rows[0, 0], self._first = 0.0, False
        return np.asarray(rows)
