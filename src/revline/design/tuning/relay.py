"""The relay experiment: a plant oscillates under a relay, and the oscillation tells its ultimate gain, more or less.

A relay of amplitude d makes the plant oscillate near its ultimate frequency; by the describing function the ultimate gain is
4 d/(pi a), with a the amplitude of the output. That is biased: the square wave has harmonics, the relay a hysteresis and a sampling
period, the plant is not linear. `predict_relay` gives the oscillation of the exact linear model, harmonics and delay included
(Tsypkin's condition), so that each part of the bias can be told from the others.

Source: Astrom and Hagglund (1984), Automatica 20(5), 645-651; Tsypkin (1984), Relay Control Systems, chapter 4.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from revline import signals
from revline.dde.simulate import Options, Start
from revline.dde.simulate_sampled import SampledTrajectory, Sampler, Wiring, simulate_sampled
from revline.design.loops.sampled_loop import COMMAND, with_command
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, OperatingPoint
from revline.design.tuning.ultimate import UltimatePoint, UltimateSource
from revline.equations import equation
from revline.errors import InvalidInputError, NotConvergedError, NotSettledError, out_of_range
from revline.sampled import FixedRate, SampledController
from revline.system import DelaySystem, Variable, index_of
from revline.units import Seconds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Transfer = Callable[[Complexes], Complexes]
Vector = tuple[float, ...]

STEEP = 1e12
"""The relay switches within this part of the measurement's unit of its threshold: exactly, for all that is measured."""

HARMONICS = 400
"""Harmonics of the square wave that are summed; the plant damps the last of them far below rounding."""

CYCLES = 6
"""So many of the last cycles are averaged, and must agree."""

LOST = 1e-9
"""An oscillation by less than this part of its level is lost in rounding."""

REPEAT = 5e-3
"""They agree where periods and amplitudes differ by less than this part."""


class RelayCode(NamedTuple):
    """Parameters of the relay: output at rest, amplitude, hysteresis."""

    rest_output: float
    amplitude: float
    hysteresis: float


@equation
def update(p: RelayCode, xd: Vector, y: Vector, r: Vector, t: Vector) -> Vector:  # noqa: ARG001 - the form of all updates
    """Switch where the error leaves the hysteresis; between, keep the side."""
    error = r[0] - y[0]
    rise = np.minimum(np.maximum((error - p.hysteresis) * STEEP, 0.0), 2.0)
    fall = np.minimum(np.maximum((error + p.hysteresis) * STEEP, -2.0), 0.0)
    side = np.minimum(np.maximum(xd[0] + rise + fall, -1.0), 1.0)
    return side, p.rest_output + p.amplitude * side


@equation
def start(p: RelayCode, y: Vector, r: Vector, u: Vector) -> Vector:  # noqa: ARG001 - the form of all starts
    """Begin on the upper side."""
    return (1.0 + 0.0 * y[0],)


@dataclass(frozen=True, slots=True, kw_only=True)
class RelayTask:
    """How a relay experiment is made.

    Attributes:
        amplitude: of the relay about the output at rest, in the control's unit.
        hysteresis: half its width, in the measurement's unit.
        until: length, in s.
        period: between two looks of the relay, in s: half of it is a delay more.
        step: of the simulation, in s.

    Raises:
        InvalidInputError: a value is outside its range.
    """

    amplitude: float
    hysteresis: float = 0.0
    until: Seconds = 6.0
    period: Seconds = 2e-4
    step: Seconds = 1e-3

    def __post_init__(self) -> None:
        positive = (("relay's amplitude", self.amplitude, ""), ("length of the experiment", self.until, "s"), ("time step", self.step, "s"))
        for name, value, unit in positive:
            if not (math.isfinite(value) and value > 0.0):
                raise out_of_range(name, value, unit, "the positive numbers", "give one")
        if not (math.isfinite(self.hysteresis) and self.hysteresis >= 0.0):
            raise out_of_range("relay's hysteresis", self.hysteresis, "", "0 and above", "give half its width, 0 for none")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RelayExperiment:
    """What a relay experiment showed.

    Attributes:
        task: how it was made.
        period: of the oscillation, in s, mean of the cycles judged.
        amplitude: half of the output's range, in its unit.
        fundamental: amplitude of the output's first harmonic.
        mean_shift: mean of the output less its value at rest.
        duty: part of a period that the relay is on its upper side; 0.5 for a linear plant.
        spread: largest difference of period or amplitude among the cycles judged, as a part.
    """

    task: RelayTask
    period: Seconds
    amplitude: float
    fundamental: float
    mean_shift: float
    duty: float
    spread: float

    @property
    def ultimate(self) -> UltimatePoint:
        """By the describing function, from the amplitude as it is read off: the textbook's."""
        inner = math.sqrt(self.amplitude - self.task.hysteresis) * math.sqrt(self.amplitude + self.task.hysteresis)
        return UltimatePoint(gain=4.0 * self.task.amplitude / (math.pi * inner), period=self.period, source=UltimateSource.RELAY)

    @property
    def gain_by_fundamental(self) -> float:
        """Ratio of the first harmonics of relay and output: what the plant divides by at this frequency, harmonics left aside."""
        wave = 4.0 * self.task.amplitude / math.pi * math.sin(math.pi * self.duty)
        return wave / self.fundamental


class RelayPrediction(NamedTuple):
    """The oscillation of a linear model under the relay, exact: its period, and the gain that the describing function reads from it."""

    period: Seconds
    gain: float
    amplitude: float


def run_relay(plant: DelaySystem, point: OperatingPoint, task: RelayTask, *, wires: LoopSignals = SPEED_BY_THROTTLE) -> RelayExperiment:
    """Let a plant oscillate under a relay about a point of rest, and measure the oscillation.

    Args:
        plant: nonlinear or linear, with its delays.
        point: of rest.
        task: how.
        wires: which signals close the loop.

    Raises:
        InvalidInputError: the relay leaves the input's range, or signals are missing.
        NotSettledError: the oscillation does not repeat within the experiment, or there are too few cycles.
        SimulationError: the run ends before its time, for example because the engine stalls.
    """
    rest, drive = float(point.inputs[wires.drive]), plant.inputs[index_of(plant.inputs, wires.drive)]
    if not (drive.low <= rest - task.amplitude and rest + task.amplitude <= drive.high):
        limit = f"0 to {min(rest - drive.low, drive.high - rest):g} {drive.unit} at {rest:g} {drive.unit}"
        raise out_of_range("relay's amplitude", task.amplitude, drive.unit, limit, "give a smaller one")
    whole = with_command(plant, wires.measurement)
    code = _relay(plant, task, rest, wires)
    measured = point.measurement
    sampler = Sampler(
        controller=code,
        wiring=Wiring(drives=(wires.drive,), measures=(wires.measurement,), commands=(COMMAND,)),
        sampling=FixedRate(period=task.period),
        states=np.array(code.start(code.parameters, (measured,), (measured,), (rest,))),
        elapsed=task.period,
    )
    inputs = whole.input_vector({**point.inputs, COMMAND: measured})
    begin = Start(states=np.append(point.states, 0.0), inputs=inputs)
    signals_of = {COMMAND: signals.step(0.0)}
    found = simulate_sampled(whole, begin, signals_of, sampler, until=task.until, step=task.step, options=Options(every=10))
    return _measure(found, task, rest=rest, level=measured)


def _relay(plant: DelaySystem, task: RelayTask, rest: float, wires: LoopSignals) -> SampledController:
    drive = plant.inputs[index_of(plant.inputs, wires.drive)].unit
    unit = plant.outputs[index_of(plant.outputs, wires.measurement)].unit
    return SampledController(
        name="relay",
        parameters=RelayCode(rest, task.amplitude, task.hysteresis),
        states=(Variable(name="side", unit="1", description="1 or -1"),),
        measurements=(Variable(name="measurement", unit=unit),),
        commands=(Variable(name="command", unit=unit),),
        outputs=(Variable(name="control", unit=drive),),
        drives=1,
        update=update,
        start=start,
    )


def _measure(found: SampledTrajectory, task: RelayTask, *, rest: float, level: float) -> RelayExperiment:
    """Measure the last cycles, from switch to switch upwards."""
    times, output, control = found.times, found.measurements[:, 0], found.outputs[:, 0]
    ups = np.flatnonzero((control[1:] > rest) & (control[:-1] < rest)) + 1
    if ups.size < CYCLES + 2:
        message = (
            f"the relay made {max(ups.size - 1, 0)} cycles in {task.until:g} s and {CYCLES + 1} are needed; "
            "let it run longer, or lower the hysteresis"
        )
        raise NotSettledError(message, cycles=max(int(ups.size) - 1, 0))
    edges = ups[-(CYCLES + 1) :]
    spans = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    periods = np.diff(times[edges])
    swings = np.array([np.ptp(output[span]) / 2.0 for span in spans])
    if not np.min(swings) > max(task.hysteresis, LOST * abs(level)):
        message = (
            f"the output moves by {float(np.min(swings)):.3g} under the relay, no more than its hysteresis or what rounding leaves at "
            f"{level:g}; give a larger relay"
        )
        raise NotSettledError(message, swing=float(np.min(swings)))
    # a period is read to one sample, so its scatter by that is no sign of change
    unlike = max(0.0, np.ptp(periods) - 2.0 * task.period) / np.mean(periods)
    spread = float(max(unlike, np.ptp(swings) / np.mean(swings)))
    if spread > REPEAT:
        message = (
            f"the last {CYCLES} cycles under the relay differ by {spread:.3g} of themselves, more than {REPEAT:g}; let it run longer than "
            f"{task.until:g} s"
        )
        raise NotSettledError(message, spread=spread)
    whole = slice(int(edges[0]), int(edges[-1]))
    period = float(np.mean(periods))
    phase = np.exp(-2j * math.pi * (times[whole] - times[edges[0]]) / period)
    return RelayExperiment(
        task=task,
        period=period,
        amplitude=float(np.mean(swings)),
        fundamental=float(2.0 * abs(np.mean((output[whole] - level) * phase))),
        mean_shift=float(np.mean(output[whole]) - level),
        duty=float(np.mean(control[whole] > rest)),
        spread=spread,
    )


def predict_relay(
    transfer: Transfer, amplitude: float, near: float, *, hysteresis: float = 0.0, extra_delay: Seconds = 0.0
) -> RelayPrediction:
    """Find the oscillation of a linear model under a relay, every harmonic and the delay exact (Tsypkin's condition).

    The relay switches upwards where the output is at -hysteresis: with G(s) exp(-s extra_delay), the sum over odd k of
    (4 d/(pi k)) Im G(i k w) is -hysteresis, and the output falls there.

    Args:
        transfer: from control to measurement, on complex s of shape (n,); stable.
        amplitude: d, of the relay.
        near: frequency near which the oscillation is sought, in rad/s: that of the ultimate point.
        hysteresis: half its width.
        extra_delay: of the relay, in s: half its sampling period.

    Raises:
        InvalidInputError: the amplitude is not positive.
        NotConvergedError: there is no oscillation between half and twice the frequency.
    """
    if not amplitude > 0.0:
        raise out_of_range("relay's amplitude", amplitude, "", "the positive numbers", "give one")
    orders = np.arange(1, 2 * HARMONICS, 2)

    def waves(omega: float) -> Complexes:
        s: Complexes = np.asarray(1j * omega * orders, dtype=np.complex128)
        return np.asarray(4.0 * amplitude / (math.pi * orders) * transfer(s) * np.exp(-s * extra_delay))

    def at_switch(omega: float) -> float:
        return float(np.sum(waves(omega).imag)) + hysteresis

    grid = np.geomspace(near / 2.0, 2.0 * near, 200)
    values = np.array([at_switch(w) for w in grid])
    changes = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0) | (values[:-1] >= 0.0) & (values[1:] < 0.0))
    if not changes.size:
        message = f"the model has no oscillation under this relay between {grid[0]:g} and {grid[-1]:g} rad/s; try a smaller hysteresis"
        raise NotConvergedError(message, low=float(grid[0]), high=float(grid[-1]))
    nearest = min(changes, key=lambda k: abs(math.log(grid[k] / near)))
    omega = float(brentq(at_switch, grid[nearest], grid[nearest + 1], xtol=1e-12, rtol=1e-12))
    found = waves(omega)
    turn = np.linspace(0.0, math.pi, 4001)
    # y(t) = sum of |c| sin(k w t + arg c): the square wave begins to be high at t = 0
    wave = np.zeros_like(turn)
    for order, value in zip(orders, found, strict=True):
        wave += (value * np.exp(1j * order * turn)).imag
    largest = float(np.max(np.abs(wave)))
    if not largest > hysteresis:
        message = f"the oscillation's amplitude {largest:g} is not above the hysteresis {hysteresis:g}"
        raise InvalidInputError(message, amplitude=largest)
    gain = 4.0 * amplitude / (math.pi * math.sqrt(largest - hysteresis) * math.sqrt(largest + hysteresis))
    return RelayPrediction(period=2.0 * math.pi / omega, gain=gain, amplitude=largest)
