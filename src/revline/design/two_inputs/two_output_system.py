"""The continuous controller of two inputs as a system: one fast with little room, one slow that takes over what the fast one holds.

    fast = limited(kp e + J),                         dJ/dt = ki e + fast_tracking (fast - fast_wanted)
    slow = limited(slow_kp q + I - slow_kd dy/dt),    dI/dt = slow_ki q + slow_tracking (slow - slow_wanted)
    q = fast_wanted - fast_set + share_of_error e,    e = command - y

The integral terms J and I begin at what the outputs are at rest: the fast one's set-point and the slow one's trim.

With share_of_error 0 the slow controller sees what the fast one asks for and takes it over, so that the fast input returns to its
set-point: mid-ranging, or valve-position control. With kp = ki = 0 and share_of_error 1 it is a PID controller of the slow input alone.

Source: Allison and Isaksson (1998), Journal of Process Control 8(5-6), 469-474; back-calculation: Astrom and Hagglund (2006), Advanced
PID Control, section 3.5.
"""

import math
from typing import NamedTuple

import numpy as np

from revline.analysis.linearize import rate_unit
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]


class TwoOutputGains(NamedTuple):
    """Gains of the law; units follow from those of the signals.

    Attributes:
        kp, ki: fast output per error, and per error and second.
        slow_kp, slow_ki: slow output per fast output (or per error, where `share_of_error` is 1), and per second.
        slow_kd: slow output per rate of the measurement.
        share_of_error: part of the error that the slow controller sees beside the fast one's demand.
        fast_tracking, slow_tracking: inverse tracking times, in 1/s; 0 for no anti-windup.
    """

    kp: float
    ki: float
    slow_kp: float
    slow_ki: float
    slow_kd: float
    share_of_error: float
    fast_tracking: float
    slow_tracking: float


class OutputRange(NamedTuple):
    """An output at rest, and the limits that it keeps."""

    rest: float
    low: float = -math.inf
    high: float = math.inf


class TwoOutputParameters(NamedTuple):
    """Gains, and both outputs' ranges."""

    gains: TwoOutputGains
    fast: OutputRange
    slow: OutputRange


@equation
def laws(p: TwoOutputParameters, x: Vector, u: Vector) -> tuple[float, float, float, float, float]:
    """What the slow controller sees, and both outputs before and after their limits."""
    command, measurement, measurement_rate = u
    error = command - measurement
    fast_wanted = p.gains.kp * error + x[0]
    seen = fast_wanted - p.fast.rest + p.gains.share_of_error * error
    slow_wanted = p.gains.slow_kp * seen + x[1] - p.gains.slow_kd * measurement_rate
    fast = np.minimum(np.maximum(fast_wanted, p.fast.low), p.fast.high)
    slow = np.minimum(np.maximum(slow_wanted, p.slow.low), p.slow.high)
    return seen, fast_wanted, fast, slow_wanted, slow


@equation
def emit(p: TwoOutputParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Nothing is delayed."""
    return ()


@equation
def rate(p: TwoOutputParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Both integral terms, each led back where its output is limited."""
    seen, fast_wanted, fast, slow_wanted, slow = laws(p, x, u)
    error = u[0] - u[1]
    g = p.gains
    return g.ki * error + g.fast_tracking * (fast - fast_wanted), g.slow_ki * seen + g.slow_tracking * (slow - slow_wanted)


@equation
def output(p: TwoOutputParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Both outputs after their limits, and before them."""
    _, fast_wanted, fast, slow_wanted, slow = laws(p, x, u)
    return fast, slow, fast_wanted, slow_wanted


def two_output_system(
    gains: TwoOutputGains, *, fast: OutputRange, slow: OutputRange, measurement: Variable, units: tuple[str, str]
) -> DelaySystem:
    """Build the controller as a system.

    Args:
        gains: of the law.
        fast: set-point and limits of the fast output.
        slow: trim and limits of the slow output.
        measurement: what is controlled.
        units: of the fast and the slow output.

    Raises:
        InvalidInputError: limits exclude the value at rest, or a gain is not finite.
    """
    for name, value in zip(TwoOutputGains._fields, gains, strict=True):
        if not math.isfinite(value):
            message = f"{name} = {value} is no finite number; give a finite gain, 0 for none"
            raise InvalidInputError(message, field=name)
    for name, entry, unit in (("fast", fast, units[0]), ("slow", slow, units[1])):
        if not (math.isfinite(entry.rest) and entry.low <= entry.rest <= entry.high):
            message = (
                f"the {name} output at rest, {entry.rest:g} {unit}, lies outside its limits {entry.low:g} to {entry.high:g} {unit}; "
                "give limits about it"
            )
            raise InvalidInputError(message, rest=entry.rest, low=entry.low, high=entry.high)
    fast_unit, slow_unit = units
    return DelaySystem(
        name="two_outputs",
        parameters=TwoOutputParameters(TwoOutputGains(*map(float, gains)), OutputRange(*map(float, fast)), OutputRange(*map(float, slow))),
        states=(
            Variable(name="fast_integral", unit=fast_unit, description="integral term of the fast controller"),
            Variable(name="slow_integral", unit=slow_unit, description="integral term of the slow controller"),
        ),
        inputs=(
            Variable(name="command", unit=measurement.unit, description="wanted value"),
            Variable(name="measurement", unit=measurement.unit, description="measured value"),
            Variable(name="measurement_rate", unit=rate_unit(measurement), description="its rate of change"),
        ),
        channels=(),
        outputs=(
            Variable(name="fast", unit=fast_unit, description="fast output after its limits"),
            Variable(name="slow", unit=slow_unit, description="slow output after its limits"),
            Variable(name="fast_wanted", unit=fast_unit, description="fast output before its limits"),
            Variable(name="slow_wanted", unit=slow_unit, description="slow output before its limits"),
        ),
        emit=emit,
        lags=emit,
        rate=rate,
        output=output,
    )
