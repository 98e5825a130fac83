"""The loop of a plant with exact delays and a sampled controller, as the samples see it: sampling and hold are what they are.

With the period T, the hold and a computation delay d, the plant answers from sample to sample by

    G_d(z) = (1 - 1/z)/T sum over k of G(s_k) exp(-s_k d)/s_k,   z = exp(s T), s_k = s + 2 pi i k/T

which is exact for any delay; the sum is cut off, and what is left out is told. Of a transfer function it is known in closed form
(`revline.design.plants.held_model`). The controller's terms are those of `revline.design.controllers.pid_update`. Nothing
here is a Pade approximation; a continuous loop with T/2 + d more delay is what the equivalent delay stands for where one is used.

Source: Astrom and Wittenmark (1997), Computer-Controlled Systems, sections 7.2 and 7.7; of the count of roots: Nyquist (1932).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.pid_controller import Continuous, PidController
from revline.design.plants.held_model import Held, held_model
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.stability.axis_grid import follow, highest, roots_between
from revline.design.stability.margins import Margins, Peak, PhaseCrossover, gain_crossover, phase_sine
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace, position
from revline.lti.transfer_function import TransferFunction
from revline.units import Seconds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Transfer = Callable[[Complexes], Complexes]

FEWEST_ALIASES, MOST_ALIASES = 40, 5120
"""Terms of the sum to each side, doubled until what is left out is small: it falls with their number to the power of the plant's excess
of poles over zeros."""

ENOUGH_LEFT_OUT, LARGEST_LEFT_OUT = 1e-5, 1e-4
"""What is left out of the sum, as a part of the sum: where the doubling ends, and what is refused with the most terms. A lag behind a whole
number of periods comes between: all its terms have one sign."""

AT_HALF = 1e-4
"""A crossing this near to half the sampling frequency, as a part of it, is the one there, where the loop is real in any case."""

LOWEST_SHARE = 1e-6
"""The loop is followed from this part of half the sampling frequency on; below, integral action alone decides."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledPlant:
    """A plant as a sampled controller meets it.

    Attributes:
        name: for people.
        transfer: from what is driven to what is measured, on complex s of shape (n,), its delays exact.
        unstable_poles: of the plant itself.
        input_unit, output_unit: of what is driven and of what is measured.
        held: the same from sample to sample in closed form, where there is one.
    """

    name: str
    transfer: Transfer
    unstable_poles: int
    input_unit: str
    output_unit: str
    held: Held | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DiscreteMargins:
    """Margins of a loop under a sampled controller, in the frequency of its samples, up to half the sampling frequency.

    Attributes:
        margins: crossovers, peaks and the closed loop's roots outside the unit circle ("unstable"). A delay margin turns the loop at its
            crossover: exact for whole periods, an estimate between them, for part of a period changes what the samples see otherwise.
        period: between samples, in s.
        equivalent_delay: half a period and the computation delay, in s: what a continuous loop needs more to be like this one.
        left_out: part of the sum over aliases that was left out, at most: the difference that half of them make.
    """

    margins: Margins
    period: Seconds
    equivalent_delay: Seconds
    left_out: float


def sampled_plant_of_system(plant: DelayStateSpace, *, wires: LoopSignals = SPEED_BY_THROTTLE, name: str = "system") -> SampledPlant:
    """Take an exact linear model, for example from `linearize`, as the plant of a sampled controller.

    Raises:
        InvalidInputError: the plant has no such signals.
        NotConvergedError: the plant's roots could not be counted.
    """
    drive, measured = position(plant.inputs, wires.drive), position(plant.outputs, wires.measurement)
    return SampledPlant(
        name=name,
        transfer=lambda s: np.asarray(plant.transfer(s)[..., measured, drive]),
        unstable_poles=int(characteristic_roots(plant).unstable_count),
        input_unit=plant.inputs[drive].unit,
        output_unit=plant.outputs[measured].unit,
    )


def sampled_plant_of_model(model: TransferFunction, *, name: str = "model") -> SampledPlant:
    """Take a transfer function with delay as the plant of a sampled controller.

    Raises:
        InvalidInputError: the model is not strictly proper, or has a pole on the imaginary axis.
    """
    if len(model.numerator) >= len(model.denominator):
        message = f"{name} has as many zeros as poles or more; what is sampled must not jump with what is held: add a lag"
        raise InvalidInputError(message)
    if np.any(np.abs(model.poles.real) <= 1e-9 * np.maximum(np.abs(model.poles), 1e-9)):
        message = f"{name} has a pole on the imaginary axis, an integrator for example; its sampled loop's roots cannot be counted here"
        raise InvalidInputError(message)
    return SampledPlant(
        name=name,
        transfer=lambda s: np.asarray(model(s)),
        unstable_poles=int(np.count_nonzero(model.poles.real > 0.0)),
        input_unit=model.input_unit,
        output_unit=model.output_unit,
        held=held_model(model),
    )


def find_discrete_margins(plant: SampledPlant, controller: PidController, *, speed: float | None = None) -> DiscreteMargins:
    """Find the margins of the loop that a sampled controller closes, exactly as its samples see it.

    Sampling by the crank's angle is taken at a steady speed: about a point of rest its period changes nothing to first order. Limits,
    dead zone and quantisation have no part in small signals.

    Args:
        plant: with exact delays.
        controller: sampled.
        speed: in rad/s, for sampling by the crank's angle.

    Raises:
        InvalidInputError: the controller is continuous or has no gain, units differ, no speed is given where one is needed, or the sampling
            period is so long that the sum over aliases does not settle.
        NotConvergedError: the loop cannot be followed: it has a root on the unit circle.
    """
    period, computation = _timing(controller, speed)
    for ours, theirs, what in (
        (controller.gains.input_unit, plant.output_unit, "the measurement"),
        (controller.gains.output_unit, plant.input_unit, "the output"),
    ):
        if ours != theirs:
            message = f"the controller has {what} in {ours} and {plant.name} in {theirs}; convert the gains"
            raise InvalidInputError(message)
    if controller.gains.kp == controller.gains.ki == controller.gains.kd == 0.0:
        message = f"all gains of {controller.gains.rule} are 0, so that there is no loop and no margin; give a gain"
        raise InvalidInputError(message)
    loop = SampledLoop(plant.transfer, controller, period, computation, held=plant.held)
    half = math.pi / period
    start = np.concatenate([np.geomspace(LOWEST_SHARE * half, 0.1 * half, 120), np.linspace(0.1 * half, half * (1.0 - 1e-9), 120)[1:]])
    name = f"the sampled loop of {plant.name} under {controller.gains.rule}"
    grid, followed = follow(lambda w: np.stack([loop(w), loop.characteristic(w)]), start, delay=computation, name=name)
    values, characteristic = followed
    turns = float(np.sum(np.angle(characteristic[1:] / characteristic[:-1])))
    unstable = plant.unstable_poles - round(turns / math.pi)
    if unstable < 0:
        message = f"{name}: the count of its roots outside the unit circle comes out as {unstable}; its curve could not be followed"
        raise NotConvergedError(message, count=unstable)
    unity = roots_between(lambda w: np.abs(loop(w)) - 1.0, grid, np.abs(values) - 1.0)
    real = roots_between(lambda w: phase_sine(loop(w)), grid, phase_sine(values))
    margins = Margins(
        loop=name,
        stable=unstable == 0,
        unstable_poles=float(unstable),
        gain_crossovers=tuple(gain_crossover(float(w), complex(v)) for w, v in zip(unity, loop(unity), strict=True)),
        phase_crossovers=_phase_crossovers(loop, np.append(real[real < (1.0 - AT_HALF) * half], half)),
        sensitivity=_peak(loop, lambda v: 1.0 / (1.0 + v), grid, values),
        complementary=_peak(loop, lambda v: 1.0 - 1.0 / (1.0 + v), grid, values),
        disk=_peak(loop, lambda v: 1.0 / (1.0 + v) - 0.5, grid, values),
        searched=(float(grid[0]), half),
        points=grid.size,
    )
    return DiscreteMargins(margins=margins, period=period, equivalent_delay=period / 2.0 + computation, left_out=loop.left_out)


def _timing(controller: PidController, speed: float | None) -> tuple[float, float]:
    sampling = controller.sampling
    if isinstance(sampling, Continuous):
        message = "a continuous controller has no samples; use find_margins, or give it a sampling"
        raise InvalidInputError(message)
    if speed is None:
        period = getattr(sampling, "period", None)
        if period is None:
            message = "sampling by the crank's angle has a period at a speed only; give the speed in rad/s"
            raise InvalidInputError(message)
        return float(period), sampling.computation_delay
    return sampling.period_at(speed), sampling.computation_delay


class SampledLoop:
    """The open loop in the frequency of the samples: called with frequencies in rad/s of shape (n,), it gives its values there.

    Args:
        transfer: of the plant, on complex s of shape (n,).
        controller: its law and filter.
        period: between samples, in s.
        computation: delay of the output, in s.
        held: the plant from sample to sample in closed form; without it the sum over aliases is taken.

    Raises:
        InvalidInputError: the sum over aliases does not settle at this period.
    """

    def __init__(
        self, transfer: Transfer, controller: PidController, period: float, computation: float, *, held: Held | None = None
    ) -> None:
        self._transfer, self._controller, self._held = transfer, controller, held
        self._period, self._computation = period, computation
        self._aliases, self.left_out = self._choose_aliases() if held is None else (0, 0.0)

    def __call__(self, omega: Floats) -> Complexes:
        """Evaluate the open loop."""
        if self._held is not None:
            return self._control(omega) * self._held(omega, self._period, self._computation)
        return self._control(omega) * self._plant(omega, self._aliases)

    def characteristic(self, omega: Floats) -> Complexes:
        """1 + L without the integral's pole on the unit circle."""
        pole = -np.expm1(-1j * omega * self._period) if self._controller.gains.ki != 0.0 else 1.0
        return np.asarray((1.0 + self(omega)) * pole)

    def _choose_aliases(self) -> tuple[int, float]:
        """Double the number of aliases until half of them make no difference; give it, and what it leaves out at most."""
        half = math.pi / self._period
        probes = np.array([0.01, 0.1, 0.3, 0.6, 0.9, 1.0]) * half
        aliases, values, left_out = FEWEST_ALIASES, self._plant(probes, FEWEST_ALIASES // 2), math.inf
        while aliases <= MOST_ALIASES:
            finer = self._plant(probes, aliases)
            left_out = float(np.max(np.abs(finer - values) / np.abs(finer)))
            if left_out <= ENOUGH_LEFT_OUT or (aliases == MOST_ALIASES and left_out <= LARGEST_LEFT_OUT):
                return aliases, left_out
            aliases, values = 2 * aliases, finer
        limit = f"periods at which the sum over {MOST_ALIASES} aliases settles to {LARGEST_LEFT_OUT:g}; it is {left_out:.2g} off here"
        raise out_of_range("sampling period", self._period, "s", limit, "sample faster, or a plant that falls faster with frequency")

    def _control(self, omega: Floats) -> Complexes:
        """The sampled law from error to output: backward sum, backward difference behind the filter. Source: `pid_update`."""
        gains, filter_time, period = self._controller.gains, self._controller.filter_time, self._period
        difference = -np.expm1(-1j * omega * period)
        value = gains.kp + np.zeros_like(difference)
        if gains.ki != 0.0:
            value += gains.ki * period / difference
        return np.asarray(value + gains.kd * difference / (period + filter_time * difference))

    def _plant(self, omega: Floats, aliases: int) -> Complexes:
        """The plant behind hold and computation delay, from sample to sample."""
        period = self._period
        shift = 2.0 * math.pi / period * np.arange(-aliases, aliases + 1)
        s = 1j * (omega[:, None] + shift)
        terms = self._transfer(s.reshape(-1)).reshape(s.shape) / s * np.exp(-s * self._computation)
        # pairs of opposite aliases nearly cancel: the smallest are added first
        order = np.argsort(-np.abs(shift))
        return np.asarray(-np.expm1(-1j * omega * period) / period * np.sum(terms[:, order], axis=1))


def _phase_crossovers(loop: SampledLoop, omega: Floats) -> tuple[PhaseCrossover, ...]:
    """Where the loop is real and negative; at half the sampling frequency it is real in any case."""
    values = loop(omega)
    return tuple(
        PhaseCrossover(frequency=float(w), gain_margin=1.0 / abs(complex(v))) for w, v in zip(omega, values, strict=True) if v.real < 0.0
    )


def _peak(loop: SampledLoop, measure: Callable[[Complexes], Complexes], grid: Floats, values: Complexes) -> Peak:
    value, frequency = highest(lambda w: np.abs(measure(loop(w))), grid, np.abs(measure(values)))
    return Peak(value=value, frequency=frequency)
