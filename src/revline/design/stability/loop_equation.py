"""The equation of a linear loop with exact delay.

Plant N(s)/D(s) exp(-s tau) under kp + ki/s (from the command) and kp + ki/s + kd s (from the measurement) gives the closed loop

    T(s) = command(s) exp(-s tau) / (own(s) + fed(s) exp(-s tau))

with own = s D, fed = N (kp s + ki + kd s^2), command = N (kp s + ki), all divided by s where ki is 0. Without delay, fed joins own.
A filter of the derivative multiplies all but kd s^2 by Tf s + 1; set-point weights b and c make N ((b kp s + ki)(Tf s + 1) + c kd s^2) of
command.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike, NDArray

from revline.design.controllers.pid_controller import AnyPid, PidController, continuous_law
from revline.errors import InvalidInputError
from revline.lti.axis_function import AxisFunction, make_axis_function
from revline.lti.polynomial import polynomial_values
from revline.lti.transfer_function import TransferFunction
from revline.units import RadiansPerSecond, Seconds
from revline.values import make_read_only

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

CANCELLED = 1e-12
"""A leading coefficient this small, relative to its parts, is rounding of zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopEquation:
    """The closed loop's polynomials, ascending and of one length, and its delay.

    Attributes:
        own: what plant and integrator contribute to the characteristic equation by themselves.
        fed: what comes back through the delay.
        command: from the command, through the delay.
        delay: of the loop.
        high_frequency_gain: loop gain that the ideal derivative leaves at infinite frequency; 0 unless the plant is of relative degree 1.
    """

    own: Floats
    fed: Floats
    command: Floats
    delay: Seconds
    high_frequency_gain: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def order(self) -> int:
        """Degree of `own`."""
        return self.own.size - 1

    @property
    def static_gain(self) -> float:
        """T(0), where it has a value."""
        return float(self.command[0] / (self.own[0] + self.fed[0]))

    def closed_loop(self, s: ArrayLike) -> Complexes:
        """Evaluate T(s) from command to output, of any shape."""
        points = np.asarray(s, dtype=complex)
        turn = np.exp(-points * self.delay)
        below = polynomial_values(self.own, points) + polynomial_values(self.fed, points) * turn
        return np.asarray(polynomial_values(self.command, points) * turn / below)

    def characteristic(self) -> AxisFunction:
        """Give own + fed exp(-s tau) along s = jw."""
        return make_axis_function(_along_axis(self.own), _along_axis(self.fed), self.delay)

    def characteristic_squared(self) -> AxisFunction:
        """Give a function whose real part is |own + fed exp(-s tau)|^2 along s = jw."""
        own, fed = _along_axis(self.own), _along_axis(self.fed)
        plain = np.convolve(own, np.conj(own)) + np.convolve(fed, np.conj(fed))
        return make_axis_function(plain, 2.0 * np.convolve(np.conj(own), fed), self.delay)

    def command_squared(self) -> Floats:
        """Coefficients of |command|^2 along s = jw, in powers of w."""
        command = _along_axis(self.command)
        return np.convolve(command, np.conj(command)).real

    def frequency_beyond(self, level: float) -> RadiansPerSecond:
        """Find a frequency beyond which |T| stays below a level; level infinity: beyond which the leading power rules the equation.

        The magnitudes of all lower terms against the leading one form a polynomial with one change of sign, so it has one positive
        root (Descartes' rule), and what holds above that root holds for ever.
        """
        lower = np.abs(self.own) + np.abs(self.fed) + np.abs(self.command) / level
        margin = np.append(-lower[:-1], abs(self.own[-1]) - abs(self.fed[-1]))
        high = 1.0
        while poly.polyval(high, margin) <= 0.0:
            high *= 2.0
        return high


class LawPolynomials(NamedTuple):
    """A linear law as polynomials, ascending: setpoint/below from the command, feedback/below from the measurement, sign reversed."""

    below: Floats
    setpoint: Floats
    feedback: Floats


def law_polynomials(controller: PidController) -> LawPolynomials:
    """Write the law of a continuous controller as polynomials, s cancelled where there is no integral action.

    Args:
        controller: limits and the like have no part in it.
    """
    gains, b, c = controller.gains, controller.setpoint_weight, controller.derivative_weight
    integral = [] if gains.ki == 0.0 else [gains.ki]
    below, top = np.array([0.0] * len(integral) + [1.0]), len(integral) + 1
    setpoint, feedback = np.array([*integral, b * gains.kp]), np.array([*integral, gains.kp])
    if controller.filter_time == 0.0:
        return LawPolynomials(below, setpoint, np.append(feedback, gains.kd))
    lag, rated = np.array([1.0, controller.filter_time]), np.zeros(top + 1)
    rated[top] = gains.kd
    return LawPolynomials(np.convolve(below, lag), np.convolve(setpoint, lag) + c * rated, np.convolve(feedback, lag) + rated)


def form_loop(plant: TransferFunction, law: AnyPid) -> LoopEquation:
    """Close the loop around a plant.

    Args:
        plant: strictly proper, with or without delay.
        law: gains alone, or a continuous controller.

    Raises:
        InvalidInputError: the units of plant and controller do not meet, the plant is not strictly proper, the closed loop is not
            well-posed because derivative action cancels the plant's highest derivative, or the controller samples.
    """
    controller = continuous_law(law)
    gains = controller.gains
    if (plant.input_unit, plant.output_unit) != (gains.output_unit, gains.input_unit):
        message = (
            f"the plant goes from {plant.input_unit} to {plant.output_unit}, the controller from {gains.input_unit} to "
            f"{gains.output_unit}; convert one of them first"
        )
        raise InvalidInputError(message)
    if not plant.is_strictly_proper:
        message = (
            "the plant passes its input straight through (numerator and denominator are of one degree), and its loop with an ideal "
            "derivative has no limit at high frequency; add the lag that every real plant has"
        )
        raise InvalidInputError(message)
    below, setpoint, feedback = law_polynomials(controller)
    own = np.convolve(below, plant.denominator)
    fed = _padded(np.convolve(plant.numerator, feedback), own.size)
    command = _padded(np.convolve(plant.numerator, setpoint), own.size)
    gain = float(abs(fed[-1] / own[-1]))
    if plant.delay == 0.0:
        top = own[-1]
        own, fed = own + fed, np.zeros(own.size)
        if abs(own[-1]) <= CANCELLED * abs(top):
            unit = gains.gain_units["kd"]
            message = f"kd = {gains.kd:g} {unit} cancels the plant's highest derivative: the loop is not well-posed; change kd"
            raise InvalidInputError(message, kd=gains.kd)
    return LoopEquation(own=own, fed=fed, command=command, delay=plant.delay, high_frequency_gain=gain)


def _padded(coefficients: Floats, size: int) -> Floats:
    return np.concatenate([coefficients[:size], np.zeros(max(size - coefficients.size, 0))])


def _along_axis(coefficients: Floats) -> Complexes:
    """Coefficients in powers of w where s = jw."""
    return np.asarray(coefficients * 1j ** np.arange(coefficients.size))
