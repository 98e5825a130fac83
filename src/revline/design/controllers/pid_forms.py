"""The three forms in which the gains of a PID controller are written, and the ways between them.

    parallel   kp + ki/s + kd s
    ideal      K (1 + 1/(Ti s) + Td s)
    series     K' (1 + 1/(Ti' s)) (1 + Td' s)

Source: Astrom and Hagglund (2006), Advanced PID Control, section 3.2.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from revline.errors import InvalidInputError, out_of_range
from revline.units import Seconds


class ParallelForm(NamedTuple):
    """Gains kp + ki/s + kd s."""

    kp: float
    ki: float
    kd: float


@dataclass(frozen=True, slots=True, kw_only=True)
class IdealForm:
    """K (1 + 1/(Ti s) + Td s); a Ti of infinity is no integral action.

    Raises:
        InvalidInputError: the gain is 0 or no finite number, Ti is not positive or Td is negative.
    """

    gain: float
    integral_time: Seconds
    derivative_time: Seconds = 0.0

    def __post_init__(self) -> None:
        _check(self.gain, self.integral_time, self.derivative_time)

    def to_parallel(self) -> ParallelForm:
        """Give the same law in parallel form."""
        return ParallelForm(self.gain, self.gain / self.integral_time, self.gain * self.derivative_time)

    def to_series(self) -> "SeriesForm":
        """Give the same law in series form.

        Raises:
            InvalidInputError: the zeros are complex (Ti below 4 Td): no series form is the same.
        """
        if math.isinf(self.integral_time):
            return SeriesForm(gain=self.gain, integral_time=math.inf, derivative_time=self.derivative_time)
        root = 1.0 - 4.0 * self.derivative_time / self.integral_time
        if root < 0.0:
            limit = f"{4.0 * self.derivative_time:g} s (4 Td) and above"
            remedy = "a PID controller with complex zeros has no series form: keep the ideal one, or take a shorter derivative time"
            raise out_of_range("integral time", self.integral_time, "s", limit, remedy)
        share = (1.0 + math.sqrt(root)) / 2.0
        # Td' = Ti (1 - share), written without the difference of near numbers
        return SeriesForm(gain=self.gain * share, integral_time=self.integral_time * share, derivative_time=self.derivative_time / share)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesForm:
    """K' (1 + 1/(Ti' s)) (1 + Td' s), as pneumatic controllers and some rules have it.

    Raises:
        InvalidInputError: the gain is 0 or no finite number, Ti' is not positive or Td' is negative.
    """

    gain: float
    integral_time: Seconds
    derivative_time: Seconds = 0.0

    def __post_init__(self) -> None:
        _check(self.gain, self.integral_time, self.derivative_time)

    def to_ideal(self) -> IdealForm:
        """Give the same law in ideal form; where Td' is above Ti', the series form that comes back has the two exchanged."""
        factor = 1.0 + self.derivative_time / self.integral_time
        return IdealForm(gain=self.gain * factor, integral_time=self.integral_time * factor, derivative_time=self.derivative_time / factor)

    def to_parallel(self) -> ParallelForm:
        """Give the same law in parallel form."""
        return self.to_ideal().to_parallel()


def ideal_of_parallel(kp: float, ki: float, kd: float) -> IdealForm:
    """Write parallel gains in ideal form.

    Args:
        kp: proportional gain.
        ki: integral gain [1/s].
        kd: derivative gain [s].

    Raises:
        InvalidInputError: kp is 0 while another gain is not, or the times come out negative: there is no ideal form.
    """
    if kp == 0.0:
        message = f"kp = 0 with ki = {ki:g} and kd = {kd:g} has no ideal form, which is a multiple of kp; keep the parallel form"
        raise InvalidInputError(message, ki=ki, kd=kd)
    return IdealForm(gain=kp, integral_time=kp / ki if ki != 0.0 else math.inf, derivative_time=kd / kp)


def _check(gain: float, integral_time: float, derivative_time: float) -> None:
    if not (math.isfinite(gain) and gain != 0.0):
        raise out_of_range("controller gain", gain, "", "the finite numbers but 0", "give one")
    if not integral_time > 0.0:
        raise out_of_range("integral time", integral_time, "s", "the positive numbers", "give one; infinity for no integral action")
    if not (math.isfinite(derivative_time) and derivative_time >= 0.0):
        raise out_of_range("derivative time", derivative_time, "s", "0 and above", "give one; 0 for no derivative action")
