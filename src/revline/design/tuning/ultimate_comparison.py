"""The ultimate gain of a plant by every way side by side, and what makes them differ: exact model, relay, bisection on the plant."""

import math
from dataclasses import dataclass

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import PidController
from revline.design.loops.run_ending import Ending
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, operating_point
from revline.design.stability.discrete_loop import find_discrete_margins, sampled_plant_of_system
from revline.design.stability.open_loop import open_loop_of_system
from revline.design.trials.gain_reserve import LARGEST, RESOLUTION, GainReserve, ReserveSearch, find_gain_reserve
from revline.design.tuning.relay import RelayExperiment, RelayPrediction, RelayTask, predict_relay, run_relay
from revline.design.tuning.ultimate import UltimatePoint, UltimateSource, find_ultimate_point
from revline.errors import AnalysisError
from revline.sampled import FixedRate
from revline.system import DelaySystem, index_of
from revline.units import Seconds

SHARE = 0.9
"""The bisection begins at this part of the exact ultimate gain."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UltimateComparison:
    """The ultimate point by four ways, all about one trim.

    Attributes:
        exact: of the exact linear model, continuous.
        sampled: of the exact linear model as the samples of the bisected loop see it.
        predicted: what the relay's describing function reads from the exact linear model's own oscillation.
        without_hysteresis: the same of a relay that has none: harmonics alone.
        relay: the experiment on the plant.
        bisected: the reserve of a proportional controller, found on the plant.
        bisected_gain: gain that it started from.
        sampling_period: of the bisected loop, in s.
        unit: of the gains.
    """

    exact: UltimatePoint
    sampled: UltimatePoint
    predicted: RelayPrediction
    without_hysteresis: RelayPrediction
    relay: RelayExperiment
    bisected: GainReserve
    bisected_gain: float
    sampling_period: Seconds
    unit: str

    @property
    def bisection(self) -> UltimatePoint:
        """The middle of the bisection's last bounds."""
        middle = 0.5 * (self.bisected.factor + self.bisected.hunts) * self.bisected_gain
        return UltimatePoint(gain=middle, period=self.bisected.period, source=UltimateSource.BISECTION)

    @property
    def ways(self) -> tuple[tuple[str, float, Seconds], ...]:
        """Each way in words, with its gain and period in s."""
        return (
            ("exact linear model", self.exact.gain, self.exact.period),
            ("the same under the relay", self.predicted.gain, self.predicted.period),
            ("relay on the engine", self.relay.ultimate.gain, self.relay.period),
            (f"exact, sampled every {1e3 * self.sampling_period:g} ms", self.sampled.gain, self.sampled.period),
            ("bisection on the engine", self.bisection.gain, self.bisection.period),
        )

    @property
    def reasons(self) -> tuple[str, ...]:
        """What makes each way differ from the exact one, with its size."""
        exact, relay = self.exact.gain, self.relay.ultimate.gain
        harmonics, rest = self.without_hysteresis.gain / exact - 1.0, relay / self.predicted.gain - 1.0
        wider, hysteresis = self.predicted.gain / self.without_hysteresis.gain - 1.0, self.relay.task.hysteresis
        of_hysteresis = f"{_percent(wider)} because of its hysteresis of {hysteresis:g}, " if hysteresis > 0.0 else ""
        sampling, plant = self.sampled.gain / exact - 1.0, self.bisection.gain / self.sampled.gain - 1.0
        of_relay = (
            f"the relay reads {_percent(relay / exact - 1.0)} off the exact gain: {_percent(harmonics)} because its square wave has "
            f"harmonics and it looks every {1e3 * self.relay.task.period:g} ms (the exact model under the same relay), "
            f"{of_hysteresis}{_percent(rest)} because the plant is not linear at an amplitude of {self.relay.amplitude:.3g} (mean shift "
            f"{self.relay.mean_shift:+.3g}, duty {self.relay.duty:.3f} where a linear plant has 0.5) and a period is read to one look"
        )
        of_bisection = (
            f"the bisection is {_percent(self.bisection.gain / exact - 1.0)} off: {_percent(sampling)} because its loop samples every "
            f"{1e3 * self.sampling_period:g} ms, {_percent(plant)} because the plant is not linear and the bisection ends within "
            f"{100.0 * (RESOLUTION - 1.0):g} %"
        )
        return of_relay, of_bisection


def compare_ultimate_points(
    plant: DelaySystem,
    trim: Trim,
    task: RelayTask,
    *,
    command: float,
    sampling_period: Seconds = 1e-3,
    wires: LoopSignals = SPEED_BY_THROTTLE,
) -> UltimateComparison:
    """Find the ultimate point of a plant about a trim by every way.

    Args:
        plant: nonlinear, with its delays.
        trim: its point of rest.
        task: of the relay experiment; the bisection is simulated by its time step too.
        command: step of the command in the bisection, small so that the plant is nearly linear.
        sampling_period: of the bisected loop, in s.
        wires: which signals close the loop.

    Raises:
        InvalidInputError: the relay leaves the input's range, or the plant is no loop of these signals.
        AnalysisError: the plant has no ultimate gain, or a way to it does not come to an end.
        SimulationError: a run ends before its time.
    """
    model = linearize(plant, trim).model
    drive = plant.inputs[index_of(plant.inputs, wires.drive)]
    unit = plant.outputs[index_of(plant.outputs, wires.measurement)].unit

    def proportional(kp: float) -> PidGains:
        return PidGains(kp=kp, ki=0.0, kd=0.0, input_unit=unit, output_unit=drive.unit, rule="proportional", designed_on=plant.name)

    exact = find_ultimate_point(lambda kp: open_loop_of_system(model, proportional(kp), wires=wires, name=plant.name))
    sampled_plant = sampled_plant_of_system(model, wires=wires, name=plant.name)
    predicted, plain = (
        predict_relay(sampled_plant.transfer, task.amplitude, exact.frequency, hysteresis=width, extra_delay=task.period / 2.0)
        for width in (task.hysteresis, 0.0)
    )
    point = operating_point(trim, wires)
    relay = run_relay(plant, point, task, wires=wires)
    begin = SHARE * exact.gain
    controller = PidController(gains=proportional(begin), low=drive.low, high=drive.high, sampling=FixedRate(period=sampling_period))
    rise = find_discrete_margins(sampled_plant, controller).margins.gain_rise
    if rise is None:
        message = f"the loop of {plant.name} sampled every {sampling_period:g} s has no ultimate gain above {begin:g}; sample faster"
        raise AnalysisError(message)
    sampled = UltimatePoint(gain=begin * rise.gain_margin, period=2.0 * math.pi / rise.frequency, source=UltimateSource.EXACT)
    search = ReserveSearch(command=command, step=task.step, near=rise.gain_margin)
    bisected = find_gain_reserve(plant, point, controller, search, place=dict(point.inputs), wires=wires)
    if bisected.ending is not Ending.HUNTS or bisected.factor == 0.0:
        gain = begin * min(bisected.hunts, LARGEST)
        message = (
            f"the bisection finds no hunting of {plant.name} after a step of {command:g}: at a gain of {gain:.4g} the loop"
            f" {bisected.ending.value}; give a smaller step"
        )
        raise AnalysisError(message)
    return UltimateComparison(
        exact=exact,
        sampled=sampled,
        predicted=predicted,
        without_hysteresis=plain,
        relay=relay,
        bisected=bisected,
        bisected_gain=begin,
        sampling_period=sampling_period,
        unit=f"{drive.unit}/({unit})",
    )


def _percent(part: float) -> str:
    return f"{100.0 * part:+.1f} %"
