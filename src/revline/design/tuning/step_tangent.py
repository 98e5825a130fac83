"""The tangent at the steepest point of a step response: apparent dead time and rise time, as step-response rules want them."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from revline.errors import InvalidInputError, out_of_range
from revline.lti.transfer_function import TransferFunction
from revline.units import Seconds

Floats = NDArray[np.float64]

_DECAYS = 12.0
"""Slopes are sought until exp(-12): a later maximum would be 6e-6 of the first."""
_POINTS = 400


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TangentReading:
    """A tangent to a unit step response, as it may also be read off a plot.

    Attributes:
        dead_time: where the tangent crosses zero, counted from the step.
        rise_time: how long the tangent takes from zero to the final value.
        final_value: what the response settles at: the static gain, in output units per input unit.
        input_unit: unit of what steps.
        output_unit: unit of what responds.

    Raises:
        InvalidInputError: a value is not finite, the final value is 0, or a time is out of range.
    """

    dead_time: Seconds
    rise_time: Seconds
    final_value: float
    input_unit: str = "1"
    output_unit: str = "1"

    def __post_init__(self) -> None:
        gain_unit = f"{self.output_unit} per {self.input_unit}"
        for what, value, unit, possible, limit in (
            ("dead time", self.dead_time, "s", True, "the finite numbers"),
            ("rise time", self.rise_time, "s", self.rise_time > 0.0, "the positive numbers"),
            ("final value", self.final_value, gain_unit, self.final_value != 0.0, "the finite numbers other than 0"),
        ):
            if not (math.isfinite(value) and possible):
                raise out_of_range(what, value, unit, limit, "read it off the tangent again")

    @property
    def slope(self) -> float:
        """Slope of the tangent, in output units per input unit and second."""
        return self.final_value / self.rise_time


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepTangent:
    """The tangent to a model's exact unit step response at its steepest point.

    Attributes:
        reading: the tangent's dead time, rise time and final value.
        inflection_time: when the response is steepest; for a lag of first order that is where it starts.
        inflection_value: the response there.
    """

    reading: TangentReading
    inflection_time: Seconds
    inflection_value: float

    @property
    def dead_time(self) -> Seconds:
        """Where the tangent crosses zero, counted from the step."""
        return self.reading.dead_time

    @property
    def rise_time(self) -> Seconds:
        """How long the tangent takes from zero to the final value."""
        return self.reading.rise_time

    @property
    def final_value(self) -> float:
        """What the response settles at, in output units per input unit."""
        return self.reading.final_value

    @property
    def slope(self) -> float:
        """Slope of the tangent, in output units per input unit and second."""
        return self.reading.slope


def measure_step_tangent(plant: TransferFunction) -> StepTangent:
    """Find the tangent at the steepest point of a model's unit step response.

    The response and its derivatives are exact; the steepest point is a root of the second derivative, or the start of the response
    where that is steeper still. The delay of the model shifts the tangent and so adds to its dead time.

    Args:
        plant: stable, strictly proper, with a static gain other than 0.

    Raises:
        InvalidInputError: the plant is not so, and has no such tangent.

    Example:
        >>> tangent = measure_step_tangent(TransferFunction(numerator=(12.0,), denominator=(1.0, 0.5), delay=0.1))
        >>> tangent.dead_time, tangent.rise_time
        (0.1, 0.5)
    """
    _require_step_response(plant)
    prompt, gain = plant.with_delay(0.0), plant.static_gain
    direction = math.copysign(1.0, gain)
    times = np.array([0.0, *_inflections(prompt)])
    slopes = direction * prompt.impulse_response(times)
    steepest = int(np.argmax(slopes))
    time, slope = float(times[steepest]), direction * float(slopes[steepest])
    value = float(prompt.step_response(time)) if time > 0.0 else 0.0
    reading = TangentReading(
        dead_time=plant.delay + time - value / slope,
        rise_time=gain / slope,
        final_value=gain,
        input_unit=plant.input_unit,
        output_unit=plant.output_unit,
    )
    return StepTangent(reading=reading, inflection_time=plant.delay + time, inflection_value=value)


def _require_step_response(plant: TransferFunction) -> None:
    if not plant.is_strictly_proper:
        message = "the plant's step response jumps (numerator and denominator are of one degree), so no tangent is steepest; add a lag"
        raise InvalidInputError(message)
    if plant.order == 0 or not plant.is_stable:
        poles = ", ".join(f"{p.real:.4g}" if p.imag == 0.0 else f"{p:.4g}" for p in plant.poles) or "none"
        message = f"the plant's step response settles nowhere (poles at {poles} rad/s); a tangent needs a stable plant"
        raise InvalidInputError(message)
    if plant.static_gain == 0.0:
        message = "the plant's static gain is 0, so its step response returns to 0; a tangent needs a response that stays"
        raise InvalidInputError(message)


def _inflections(prompt: TransferFunction) -> list[float]:
    """Find the roots of the step response's second derivative after t = 0, bracketed on a grid that resolves every pole."""
    start = prompt.numerator[-1] / prompt.denominator[-1] if prompt.relative_degree == 1 else 0.0
    shifted = [0.0, *prompt.numerator]
    padded = [*shifted, *([0.0] * (prompt.order + 1 - len(shifted)))]
    numerator = tuple(n - start * d for n, d in zip(padded, prompt.denominator, strict=True))[: prompt.order]
    if not any(numerator):
        return []
    curvature = replace(prompt, numerator=numerator)

    def bend(time: float) -> float:
        return float(curvature.impulse_response(time))

    grid = _time_grid(prompt)
    bends = curvature.impulse_response(grid)
    rounding = 1e-13 * float(np.max(np.abs(bends)))
    signs = np.sign(np.where(np.abs(bends) > rounding, bends, 0.0))
    kept = np.flatnonzero(signs)
    changes = np.flatnonzero(signs[kept[:-1]] * signs[kept[1:]] < 0.0)
    return [float(brentq(bend, grid[kept[i]], grid[kept[i + 1]], xtol=1e-15, rtol=1e-14)) for i in changes]


def _time_grid(prompt: TransferFunction) -> Floats:
    rows = []
    for pole in prompt.poles:
        horizon = _DECAYS / abs(pole.real)
        turns = 10.0 * 2.0 * math.pi / abs(pole.imag) if pole.imag != 0.0 else math.inf
        rows.append(np.linspace(0.0, min(horizon, turns), _POINTS))
    return np.unique(np.concatenate(rows))
