"""A plant as tuning rules ask of it: its step response's tangent, a lag with delay that is like it, its ultimate point, its loop.

Each is found when a rule asks for it, from the exact plant, its delay kept: a transfer function with delay, or a linearised system.
"""

import functools
import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.controller import PidGains
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model, open_loop_of_system
from revline.design.tuning.step_tangent import StepTangent, TangentReading, measure_step_tangent
from revline.design.tuning.ultimate import UltimatePoint, find_ultimate_point
from revline.errors import InvalidInputError
from revline.lti.interconnection import select, series, to_state_space
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace, position
from revline.lti.time_response import sample_times, step_response
from revline.lti.transfer_function import TransferFunction
from revline.units import Seconds

Floats = NDArray[np.float64]

INTERVALS = 4000
"""Between samples of a step response; it lasts some of the slowest time constants."""

DECAYS = 12.0
"""So many of the slowest time constants: what is left then is 6e-6 of the response."""


WEAK = 0.1
"""Loop gain at rest, or at 1 rad/s, from which the ultimate gain is sought."""


REAL = 1e-3
"""A root counts as real up to this part of imaginary part: roots of a polynomial that are m times the same are known to 1e-16^(1/m)."""


class LagReading(Enum):
    """How a lag with delay is read from a step response."""

    TANGENT = "tangent"
    """Delay and lag are those of the steepest tangent: where it crosses 0, and from there to the final value."""
    SHARE = "63"
    """The delay is the tangent's; delay and lag together last to 63.2 % of the final value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayedLag:
    """A lag with delay, K exp(-L s)/(T s + 1), read from a plant's step response.

    Attributes:
        gain: K, in output units per input unit.
        lag: T, in s.
        delay: L, in s.
        reading: how it was read.
        largest_difference: between its step response and the plant's, as a part of the final value.
    """

    gain: float
    lag: Seconds
    delay: Seconds
    reading: LagReading
    largest_difference: float

    @property
    def normalised_delay(self) -> float:
        """L/(L + T), between 0 and 1."""
        return self.delay / (self.delay + self.lag)


@dataclass(frozen=True, kw_only=True, eq=False)
class TuningPlant:
    """What tuning rules may ask of a plant; `tuning_plant` builds it.

    Attributes:
        name: for people.
        plant: the transfer function, or the linearised system.
        wires: which signals of a system close the loop.
    """

    name: str
    plant: TransferFunction | DelayStateSpace
    wires: LoopSignals = SPEED_BY_THROTTLE

    @property
    def input_unit(self) -> str:
        """Unit of what is driven."""
        plant = self.plant
        return plant.input_unit if isinstance(plant, TransferFunction) else plant.inputs[position(plant.inputs, self.wires.drive)].unit

    @property
    def output_unit(self) -> str:
        """Unit of what is measured."""
        plant = self.plant
        if isinstance(plant, TransferFunction):
            return plant.output_unit
        return plant.outputs[position(plant.outputs, self.wires.measurement)].unit

    @property
    def model(self) -> TransferFunction:
        """The transfer function.

        Raises:
            InvalidInputError: the plant is a linearised system.
        """
        if isinstance(self.plant, TransferFunction):
            return self.plant
        message = f"this rule needs a transfer function, and {self.name} is a system with delays inside; fit a model first, `revline fit`"
        raise InvalidInputError(message)

    @functools.cached_property
    def tangent(self) -> StepTangent:
        """The tangent at the steepest point of the exact step response; of a system, where it is steepest between two samples.

        Raises:
            InvalidInputError: the plant is unstable, answers a step with a jump, or rests at 0.
        """
        if isinstance(self.plant, TransferFunction):
            return measure_step_tangent(self.plant)
        self._require_answer()
        times, values = self._step
        _, k = self._steepest(times, values)
        near = np.linspace(times[max(k - 1, 0)], times[min(k + 2, times.size - 1)], INTERVALS + 1)
        fine = step_response(self.plant, near, input_name=self.wires.drive).output(self.wires.measurement)
        slope, k = self._steepest(near, fine)
        time, value = 0.5 * float(near[k] + near[k + 1]), 0.5 * float(fine[k] + fine[k + 1])
        reading = TangentReading(
            dead_time=time - value / slope,
            rise_time=self.static_gain / slope,
            final_value=self.static_gain,
            input_unit=self.input_unit,
            output_unit=self.output_unit,
        )
        return StepTangent(reading=reading, inflection_time=time, inflection_value=value)

    @functools.cached_property
    def static_gain(self) -> float:
        """Gain at rest, in output units per input unit."""
        plant = self.plant
        if isinstance(plant, TransferFunction):
            return plant.static_gain
        return plant.static_gain(self.wires.drive, self.wires.measurement)

    @functools.cached_property
    def ultimate(self) -> UltimatePoint:
        """The ultimate point, exact.

        Raises:
            InvalidInputError: the plant is stable and its gain is negative.
            AnalysisError: there is no gain up to which the loop is stable and at which it oscillates.
        """
        if self._size == 0.0:
            self._require_answer()
        begin = WEAK / self._size
        if self._rises_against and self.loop(self._gains(begin)).stable:
            message = f"{self.name} answers against its input (gain {self.static_gain:g}); turn the sign of the input round and tune again"
            raise InvalidInputError(message, gain=self.static_gain)
        return find_ultimate_point(lambda kp: self.loop(self._gains(kp)), begin=begin)

    @property
    def _integrates(self) -> bool:
        """Whether a transfer function has a pole at 0, so that there is no gain at rest."""
        return isinstance(self.plant, TransferFunction) and self.plant.denominator[0] == 0.0

    @property
    def _rises_against(self) -> bool:
        return not self._integrates and self.static_gain < 0.0

    @property
    def _size(self) -> float:
        """Size of the gain at rest; of a plant that integrates or rests at 0 that at 1 rad/s."""
        if not self._integrates and self.static_gain != 0.0:
            return abs(self.static_gain)
        if isinstance(self.plant, TransferFunction):
            return float(abs(self.plant(1j)))
        row, drive = position(self.plant.outputs, self.wires.measurement), position(self.plant.inputs, self.wires.drive)
        return float(abs(self.plant.transfer(np.array([1j]))[0, row, drive]))

    def _require_answer(self) -> None:
        """Refuse a plant that a step does not move for good, as a throttle that is wide open already."""
        if self.static_gain == 0.0:
            message = (
                f"{self.name} does not answer its input at rest (gain 0 {self.output_unit} per {self.input_unit}); "
                "choose another operating point or another plant"
            )
            raise InvalidInputError(message, gain=0.0)

    def lag(self, reading: LagReading) -> DelayedLag:
        """Read a lag with delay from the exact step response.

        Args:
            reading: how.

        Raises:
            InvalidInputError: the plant has no step response that settles.
        """
        tangent = self.tangent
        times, values = self._step
        share = values / self.static_gain
        delay, lag = tangent.dead_time, tangent.rise_time
        if reading is LagReading.SHARE:
            reached = int(np.argmax(share >= 1.0 - math.exp(-1.0)))
            first, last = share[reached - 1], share[reached]
            time = times[reached - 1] + (1.0 - math.exp(-1.0) - first) / (last - first) * (times[reached] - times[reached - 1])
            lag = float(time) - delay
        alike = -np.expm1(-np.maximum(times - delay, 0.0) / lag)
        return DelayedLag(
            gain=self.static_gain, lag=lag, delay=delay, reading=reading, largest_difference=float(np.max(np.abs(alike - share)))
        )

    def loop(self, gains: PidGains, *, filter_time: Seconds = 0.0) -> OpenLoop:
        """The loop of the plant under some gains, its delay exact.

        A filtered derivative, kd s/(Tf s + 1), is the same as gains kp + ki Tf, ki and kd + kp Tf before a lag Tf, which joins the plant.

        Args:
            gains: of the controller.
            filter_time: Tf of its derivative, in s; 0 for none.
        """
        if filter_time > 0.0:
            kp, ki, kd = gains.kp, gains.ki, gains.kd
            return self._behind(filter_time).loop(replace(gains, kp=kp + ki * filter_time, kd=kd + kp * filter_time))
        if isinstance(self.plant, TransferFunction):
            return open_loop_of_model(self.plant, gains, name=self.name)
        return open_loop_of_system(self.plant, gains, wires=self.wires, name=self.name)

    def _behind(self, lag: Seconds) -> "TuningPlant":
        """The plant with a lag before what is driven."""
        plant = self.plant
        if isinstance(plant, TransferFunction):
            denominator = tuple(np.polynomial.polynomial.polymul(plant.denominator, (1.0, lag)).tolist())
            return replace(self, plant=replace(plant, denominator=denominator))
        drive = position(plant.inputs, self.wires.drive)
        unit = plant.inputs[drive].unit
        model = TransferFunction(numerator=(1.0,), denominator=(1.0, lag), input_unit=unit, output_unit=unit)
        first = to_state_space(model, input_name=self.wires.drive, output_name=self.wires.drive)
        return replace(self, plant=series(first, select(plant, (drive,), range(len(plant.outputs)))))

    @functools.cached_property
    def _step(self) -> tuple[Floats, Floats]:
        """Times and the exact unit step response until it has settled."""
        plant = self.plant
        if isinstance(plant, TransferFunction):
            measure_step_tangent(plant)  # refuses what has no step response that settles
            slowest = float(np.min(np.abs(plant.poles.real)))
            times = sample_times(plant.delay + DECAYS / slowest, INTERVALS)
            prompt = plant.with_delay(0.0)
            return times, np.where(times > plant.delay, prompt.step_response(np.maximum(times - plant.delay, 0.0)), 0.0)
        roots = characteristic_roots(plant)
        if roots.unstable_count:
            message = (
                f"{self.name} is unstable, with {roots.unstable_count} roots right of the imaginary axis; no rule from a step suits it"
            )
            raise InvalidInputError(message)
        times = sample_times(DECAYS / abs(float(roots.roots[0].real)), INTERVALS)
        return times, step_response(plant, times, input_name=self.wires.drive).output(self.wires.measurement)

    def _steepest(self, times: Floats, values: Floats) -> tuple[float, int]:
        """Steepest slope between two samples, and the first of them."""
        slopes = np.diff(values) / np.diff(times)
        k = int(np.argmax(math.copysign(1.0, self.static_gain) * slopes))
        return float(slopes[k]), k

    def _gains(self, kp: float) -> PidGains:
        return PidGains(kp=kp, ki=0.0, kd=0.0, input_unit=self.output_unit, output_unit=self.input_unit, rule="P", designed_on=self.name)


def tuning_plant(plant: TransferFunction | DelayStateSpace, *, name: str, wires: LoopSignals = SPEED_BY_THROTTLE) -> TuningPlant:
    """Take a plant for tuning; what rules ask of it is found when they ask.

    Args:
        plant: a transfer function with delay, or a linearised system.
        name: for people.
        wires: which signals of a system close the loop.
    """
    return TuningPlant(name=name, plant=plant, wires=wires)


def reduce_by_half_rule(model: TransferFunction, *, order: int) -> tuple[float, float, float, float]:
    """Reduce a model with real poles to one or two lags and a delay by the half rule.

    The largest lag left out is shared half and half between the last one kept and the delay; all smaller ones, and lags of zeros in the
    right half plane, go to the delay.

    Args:
        model: stable, with real poles, its zeros if any in the right half plane.
        order: lags to keep, 1 or 2.

    Returns:
        Gain, first lag, second lag (0 where one is kept), effective delay in s.

    Raises:
        InvalidInputError: the poles are not real and stable, or a zero lies in the left half plane, for which the rule has other cases.

    Source:
        Skogestad (2003), Journal of Process Control 13(4), 291-309, section 2.
    """
    poles, zeros = model.poles, model.zeros
    if not poles.size or np.any(np.abs(poles.imag) > REAL * np.abs(poles)) or np.any(poles.real >= 0.0):
        message = (
            "the half rule needs real stable poles; this model has others or none: fit one lag with delay, or use an ultimate-gain rule"
        )
        raise InvalidInputError(message)
    if model.static_gain == 0.0:
        message = "the model's gain at rest is 0, so that no controller holds a command; the half rule needs a plant that answers for good"
        raise InvalidInputError(message)
    if np.any(np.abs(zeros.imag) > REAL * np.abs(zeros)) or np.any(zeros.real < 0.0):
        message = "the half rule as it stands here takes zeros in the right half plane only; fit a model without zeros"
        raise InvalidInputError(message)
    lags = sorted((1.0 / -poles.real).tolist(), reverse=True)
    kept = [*lags, 0.0, 0.0][:order]
    left = lags[order:]
    delay = model.delay + float(np.sum(1.0 / zeros.real)) + sum(left) - (0.5 * left[0] if left else 0.0)
    kept[-1] += 0.5 * left[0] if left else 0.0
    return model.static_gain, kept[0], kept[1] if order > 1 else 0.0, delay
