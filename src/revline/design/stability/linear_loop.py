"""Closed-loop frequency measures of a linear plant with exact delay under a PID controller.

T(s) = G (kp + ki/s) / (1 + G (kp + ki/s + kd s)) from command to output: the derivative acts on the measurement only,
unless a controller with a filter and set-point weights is given (`revline.design.stability.loop_equation`).
Places on the frequency axis are roots found with certainty (`revline.lti.axis_function`), never points of a grid.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from revline.design.controllers.pid_controller import AnyPid, continuous_law
from revline.design.stability.loop_equation import LoopEquation, form_loop, law_polynomials
from revline.design.stability.loop_stability import HighFrequencyUnstableLoop, UnstableLoop, judge_loop_stability
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.axis_function import make_axis_function, sign_changes
from revline.lti.response import FrequencyResponse, check_frequencies
from revline.lti.transfer_function import TransferFunction
from revline.units import RadiansPerSecond

HALF_POWER: Final = 1.0 / math.sqrt(2.0)
"""Magnitude at the edge of the band: half the power. It is -3.0103 dB; -3 dB exactly is 0.70795."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopMeasures:
    """What the closed loop's magnitude from command to output is judged by.

    Attributes:
        bandwidth: lowest frequency at which the magnitude falls below the level.
        level: magnitude at the edge of the band.
        static_gain: value at zero frequency; 1 with integral action.
        peak: largest magnitude.
        peak_frequency: where it is; 0 where the magnitude is nowhere above that at zero frequency.
    """

    bandwidth: RadiansPerSecond
    level: float
    static_gain: float
    peak: float
    peak_frequency: RadiansPerSecond

    @property
    def peak_db(self) -> float:
        """Largest magnitude in decibels."""
        return 20.0 * math.log10(self.peak)


def closed_loop_response(plant: TransferFunction, law: AnyPid, omega: ArrayLike) -> FrequencyResponse:
    """Evaluate the closed loop from command to output, for Bode plots.

    The values of an unstable loop are those of the formula; no experiment shows them. `judge_loop_stability` tells.

    Args:
        plant: strictly proper, with or without delay.
        law: gains alone, derivative on the measurement, or a continuous controller.
        omega: frequencies in rad/s, strictly rising.

    Raises:
        InvalidInputError: plant and controller do not make a well-posed loop, or frequencies are unusable.
    """
    loop, grid = form_loop(plant, law), check_frequencies(omega)
    return FrequencyResponse(
        omega=grid,
        values=loop.closed_loop(1j * grid),
        input_name=f"{plant.output_name} command",
        input_unit=plant.output_unit,
        output_name=plant.output_name,
        output_unit=plant.output_unit,
        method="closed loop, delay exact",
        known_delay=plant.delay,
    )


def closed_loop_transfer(plant: TransferFunction, law: AnyPid) -> TransferFunction:
    """Give the closed loop from command to output as a transfer function, for its exact step response and poles.

    Args:
        plant: strictly proper, without delay.
        law: gains alone, derivative on the measurement, or a continuous controller.

    Raises:
        InvalidInputError: the plant has a delay: the closed loop is then no rational function; or the loop is not well-posed.
    """
    if plant.delay != 0.0:
        message = f"a loop around a delay of {plant.delay:g} s is no rational transfer function; use closed_loop_response, or simulate it"
        raise InvalidInputError(message, delay=plant.delay)
    loop = form_loop(plant, law)
    return replace(
        plant,
        numerator=tuple(loop.command.tolist()),
        denominator=tuple(loop.own.tolist()),
        input_name=f"{plant.output_name} command",
        input_unit=plant.output_unit,
    )


def closed_loop_transfer_to_control(plant: TransferFunction, law: AnyPid) -> TransferFunction:
    """Give the transfer function from command to what the controller drives, for the exact control after a step of the command.

    Args:
        plant: strictly proper, without delay.
        law: gains alone, derivative on the measurement, or a continuous controller.

    Raises:
        InvalidInputError: as for `closed_loop_transfer`.
    """
    closed = closed_loop_transfer(plant, law)
    setpoint = law_polynomials(continuous_law(law)).setpoint
    scale = form_loop(plant, law).own[-1] / closed.denominator[-1]
    return replace(
        closed,
        numerator=tuple((np.convolve(plant.denominator, setpoint) / scale).tolist()),
        output_name=plant.input_name,
        output_unit=plant.input_unit,
    )


def find_bandwidth(plant: TransferFunction, law: AnyPid, *, level: float = HALF_POWER) -> RadiansPerSecond:
    """Find the lowest frequency at which the closed loop's magnitude falls below a level.

    Args:
        plant: strictly proper, with or without delay.
        law: gains alone, derivative on the measurement, or a continuous controller.
        level: magnitude, not decibels.

    Raises:
        InvalidInputError: plant and controller do not make a well-posed loop, or the level is not positive.
        AnalysisError: the loop is unstable, or its magnitude is below the level from zero frequency on.
    """
    return _bandwidth(_stable_loop(plant, law), level)


def measure_closed_loop(plant: TransferFunction, law: AnyPid, *, level: float = HALF_POWER) -> ClosedLoopMeasures:
    """Measure bandwidth and resonance of the closed loop from command to output.

    Args:
        plant: strictly proper, with or without delay.
        law: gains alone, derivative on the measurement, or a continuous controller.
        level: magnitude at the edge of the band, not decibels.

    Raises:
        InvalidInputError: plant and controller do not make a well-posed loop, or the level is not positive.
        AnalysisError: the loop is unstable, or its magnitude is below the level from zero frequency on.

    Example:
        >>> from revline.design.controllers.controller import PidGains
        >>> plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0))
        >>> gains = PidGains(kp=3.0, ki=0.0, kd=0.0, input_unit="1", output_unit="1", rule="by hand", designed_on="integrator")
        >>> round(measure_closed_loop(plant, gains).bandwidth, 12)
        3.0
    """
    loop = _stable_loop(plant, law)
    bandwidth = _bandwidth(loop, level)
    peak_frequency = _peak_frequency(loop)
    return ClosedLoopMeasures(
        bandwidth=bandwidth,
        level=level,
        static_gain=loop.static_gain,
        peak=float(abs(loop.closed_loop(1j * peak_frequency))),
        peak_frequency=peak_frequency,
    )


def _stable_loop(plant: TransferFunction, law: AnyPid) -> LoopEquation:
    verdict = judge_loop_stability(plant, law)
    if isinstance(verdict, UnstableLoop | HighFrequencyUnstableLoop):
        count = str(verdict.unstable_poles) if isinstance(verdict, UnstableLoop) else "infinitely many"
        message = f"the closed loop is unstable ({count} poles right of the imaginary axis) and has no band; lower the gains"
        raise AnalysisError(message, unstable_poles=count)
    return form_loop(plant, law)


def _bandwidth(loop: LoopEquation, level: float) -> float:
    if not (math.isfinite(level) and level > 0.0):
        message = f"level = {level:g} is no magnitude; give a positive number, 0.7071 for half power"
        raise InvalidInputError(message, level=level)
    static = abs(loop.static_gain)
    if static <= level:
        message = (
            f"the closed loop's magnitude at zero frequency is {static:.4g}, not above the level of {level:.4g}: there is no band; "
            "add integral action, or give a lower level"
        )
        raise AnalysisError(message, static_gain=static, level=level)
    high = loop.frequency_beyond(level)
    command = make_axis_function(loop.command_squared(), [0.0], loop.delay)
    excess = command.plus(loop.characteristic_squared().times(np.array([-(level**2)])))
    edges = [*sign_changes(excess, high), high]
    after = (np.array(edges[:-1]) + np.array(edges[1:])) / 2.0
    below = excess(after).real < 0.0
    return float(edges[int(np.argmax(below))])


def _peak_frequency(loop: LoopEquation) -> float:
    """Find the highest of all stationary points of |T|^2 = a/b, where a' b - a b' changes its sign."""
    samples = loop.frequency_beyond(math.inf) * np.logspace(-6.0, 0.0, 61)
    floor = max(abs(loop.static_gain), float(np.max(np.abs(loop.closed_loop(1j * samples)))))
    above, below = loop.command_squared(), loop.characteristic_squared()
    slope = below.times(poly.polyder(above)).plus(below.derivative().times(-above))
    high = loop.frequency_beyond(0.5 * floor)
    candidates = np.array([0.0, *sign_changes(slope, high)])
    return float(candidates[int(np.argmax(np.abs(loop.closed_loop(1j * candidates))))])
