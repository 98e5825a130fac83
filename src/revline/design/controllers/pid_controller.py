"""The PI or PID controller as an engine computer runs it: one value that simulation, linear analysis and exported code are made from.

Law, with y the measurement, r the command and e = r - y:

    u = u_trim + kp (b r - y) + ki integral(e) dt + kd s/(Tf s + 1) (c r - y)

b and c weigh the set-point; Tf is the time of the derivative's filter. Then come the limits: of the output, of its rate, and
of the integral, so that it does not wind up.

Source: Astrom and Hagglund (2006), Advanced PID Control, sections 3.3 to 3.6 and 13.4.
"""

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.controllers.controller import PidGains
from revline.errors import InvalidInputError, out_of_range
from revline.sampled import CrankSynchronous, FixedRate
from revline.units import Dimensionless, Seconds


class AntiWindup(Enum):
    """What keeps the integral from winding up while the output is at a limit."""

    NONE = "none"
    CLAMPING = "clamping"
    """The integral moves no further than the output reaches its limit, and always moves back."""
    BACK_CALCULATION = "back-calculation"
    """The integral follows what the limits took away, with the tracking time."""


@dataclass(frozen=True, slots=True)
class Continuous:
    """No samples: the law as it stands, without delay."""


Timing = Continuous | FixedRate | CrankSynchronous
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PidController:
    """A PID controller with all that an engine computer puts around its law.

    Attributes:
        gains: in parallel form, with units and origin.
        setpoint_weight: b, of the command in the proportional term.
        derivative_weight: c, of the command in the derivative term.
        filter_time: Tf of the derivative's filter, in s; 0 for none.
        low: lower limit of the output, in its unit.
        high: upper limit of the output.
        rate_limit: largest rate of the output, in its unit per s.
        anti_windup: what keeps the integral from winding up.
        tracking_time: of back-calculation, in s.
        dead_zone: errors within it count as none, in the measurement's unit; 0 for none.
        measurement_step: resolution of the measurement, in its unit; 0 for none.
        output_step: resolution of the output, in its unit; 0 for none.
        hold_samples: how many samples a measurement that is no finite number is replaced by the last good one; after that the output
            is `safe_output`.
        safe_output: output without a measurement, in its unit; by default the output at rest.
        sampling: when it runs.

    Raises:
        InvalidInputError: a value is outside its range, or needs another that is not there.
    """

    gains: PidGains
    setpoint_weight: Dimensionless = 1.0
    derivative_weight: Dimensionless = 0.0
    filter_time: Seconds = 0.0
    low: float = -math.inf
    high: float = math.inf
    rate_limit: float = math.inf
    anti_windup: AntiWindup = AntiWindup.CLAMPING
    tracking_time: Seconds | None = None
    dead_zone: float = 0.0
    measurement_step: float = 0.0
    output_step: float = 0.0
    hold_samples: int = 5
    safe_output: float | None = None
    sampling: Timing = field(default_factory=Continuous)

    def __post_init__(self) -> None:
        drive, measured = self.gains.output_unit, self.gains.input_unit
        for name, value, unit in (
            ("set-point weight", self.setpoint_weight, "1"),
            ("derivative weight", self.derivative_weight, "1"),
            ("filter time", self.filter_time, "s"),
            ("dead zone", self.dead_zone, measured),
            ("measurement step", self.measurement_step, measured),
            ("output step", self.output_step, drive),
            ("hold samples", self.hold_samples, "samples"),
        ):
            if not (math.isfinite(value) and value >= 0.0):
                raise out_of_range(name, value, unit, "the finite numbers from 0 on", "give one, 0 for none")
        if self.hold_samples != int(self.hold_samples):
            raise out_of_range("hold samples", self.hold_samples, "samples", "the whole numbers from 0 on", "give one, 0 for none")
        if not self.low < self.high:
            message = f"the lower limit of the output, {self.low:g} {drive}, is not below the upper, {self.high:g} {drive}; give low < high"
            raise InvalidInputError(message, low=self.low, high=self.high)
        if not self.rate_limit > 0.0:
            raise out_of_range("rate limit", self.rate_limit, f"{drive}/s", "the positive numbers", "leave it out for none")
        if self.safe_output is not None and not self.low <= self.safe_output <= self.high:
            limit = f"the output's limits {self.low:g} to {self.high:g} {drive}"
            raise out_of_range("safe output", self.safe_output, drive, limit, "give one between them")
        self._check_tracking()

    def _check_tracking(self) -> None:
        """Back-calculation needs a tracking time, and one that the sampling follows."""
        given = self.tracking_time
        if (self.anti_windup is AntiWindup.BACK_CALCULATION) != (given is not None):
            message = (
                f"anti-windup {self.anti_windup.value} {'with a' if given is not None else 'without a'} tracking time; "
                "back-calculation needs one and nothing else takes one, for example sqrt(Ti Td), or Ti for PI"
            )
            raise InvalidInputError(message)
        if given is None:
            return
        shortest = self.sampling.period if isinstance(self.sampling, FixedRate) else 0.0
        if not (math.isfinite(given) and given > 0.0 and given >= shortest):
            limit = f"the sampling period of {shortest:g} s and above" if shortest else "the positive numbers"
            raise out_of_range("tracking time", given, "s", limit, "give a longer one: the integral would overshoot what it follows")

    @property
    def integral_time(self) -> Seconds:
        """Ti = kp/ki of the ideal form; infinite without integral action."""
        return self.gains.kp / self.gains.ki if self.gains.ki != 0.0 else math.inf

    @property
    def extras(self) -> tuple[str, ...]:
        """What there is beside gains and limits, in words; nothing for the law of `revline.design.controllers.pid_system`."""
        found = (
            (self.setpoint_weight != 1.0, "a set-point weight"),
            (self.derivative_weight != 0.0, "a derivative weight"),
            (self.filter_time != 0.0, "a derivative filter"),
            (self.anti_windup is not AntiWindup.NONE, "anti-windup"),
            (math.isfinite(self.rate_limit), "a rate limit"),
            (self.dead_zone != 0.0, "a dead zone"),
            (self.measurement_step != 0.0, "a quantised measurement"),
            (self.output_step != 0.0, "a quantised output"),
            (not isinstance(self.sampling, Continuous), "sampling"),
        )
        return tuple(text for there, text in found if there)

    def feedback_transfer(self, s: ArrayLike) -> Complexes:
        """Evaluate kp + ki/s + kd s/(Tf s + 1), the continuous law from measurement to output with its sign reversed.

        Args:
            s: Laplace variable [rad/s], of any shape.

        Raises:
            InvalidInputError: an s is 0, where integral action is infinite.
        """
        points = np.asarray(s, dtype=np.complex128)
        if self.filter_time == 0.0:
            return self.gains.feedback_transfer(points)
        return np.asarray(self.gains.setpoint_transfer(points) + self.gains.kd * points / (self.filter_time * points + 1.0))


AnyPid = PidGains | PidController
"""What stands for a linear law: gains alone, or a controller with weights and a filter."""


def continuous_law(law: AnyPid) -> PidController:
    """Take gains alone, or a controller, as the continuous controller that a linear analysis means.

    Limits, anti-windup, dead zone and quantisation stay where they are: they have no part in small signals.

    Raises:
        InvalidInputError: the controller samples, or weighs the command in an ideal derivative.
    """
    if isinstance(law, PidGains):
        return PidController(gains=law, anti_windup=AntiWindup.NONE)
    if not isinstance(law.sampling, Continuous):
        message = "the controller samples, and its samples would be dropped here; use find_discrete_margins() or run_sampled_step()"
        raise InvalidInputError(message)
    if law.derivative_weight * law.gains.kd != 0.0 and law.filter_time == 0.0:
        message = (
            f"derivative weight = {law.derivative_weight:g} without a filter makes an impulse of each step of the command; "
            "give a filter_time_s, or weight 0"
        )
        raise InvalidInputError(message, derivative_weight=law.derivative_weight)
    return law
