"""A controller that a computer runs: discrete states, an update at each sample, and the events at which samples are taken.

    xd, u = update(p, xd, y, r, t)      at each sample: measurements y, commands r, t = (seconds since the sample before,)
    xd = start(p, y, r, u)              so that the first output is u, where the system rests

The first outputs of `update` drive a system; the rest tell what they are made of. Both equations use + - * / and limits only,
so that the same definition is compiled into simulations and written as C, and both compute the same to the last bit.
"""

import copy
import functools
import math
from dataclasses import dataclass
from typing import Any

from revline.equations import Equation, TracedUpdate, equation_digest, trace
from revline.errors import InvalidInputError, out_of_range
from revline.system import Variable
from revline.units import Radians, Seconds
from revline.values import fingerprint


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedRate:
    """A sample each so many seconds, as a timer gives it.

    Attributes:
        period: seconds between samples.
        computation_delay: seconds from a sample to the output made from it.

    Raises:
        InvalidInputError: the period is not positive, or the computation takes as long as a period.
    """

    period: Seconds
    computation_delay: Seconds = 0.0

    def __post_init__(self) -> None:
        _check_positive("sampling period", self.period, "s", "give one such as 0.01")
        _check_computation(self.computation_delay)
        if self.computation_delay >= self.period:
            limit = f"0 to below the sampling period of {self.period:g} s"
            raise out_of_range("computation delay", self.computation_delay, "s", limit, "sample more slowly or compute faster")

    def period_at(self, speed: float) -> Seconds:  # noqa: ARG002 - the form of all sampling
        """Seconds between samples, at any speed."""
        return self.period


@dataclass(frozen=True, slots=True, kw_only=True)
class CrankSynchronous:
    """A sample each so many radians of the crank, as the ignition of each cylinder asks for.

    Attributes:
        angle: radians of crank angle between samples; pi for four cylinders in four strokes.
        computation_delay: seconds from a sample to the output made from it; it must be over before the next sample.

    Raises:
        InvalidInputError: the angle is not positive, or the computation delay is negative.
    """

    angle: Radians
    computation_delay: Seconds = 0.0

    def __post_init__(self) -> None:
        _check_positive("sampling angle", self.angle, "rad", "give one such as 3.14159")
        _check_computation(self.computation_delay)

    def period_at(self, speed: float) -> Seconds:
        """Seconds between samples at a steady speed.

        Raises:
            InvalidInputError: the speed is not positive, or the computation takes as long as a period there.
        """
        _check_positive("speed", speed, "rad/s", "an engine at rest is never sampled")
        period = self.angle / speed
        if self.computation_delay >= period:
            limit = f"0 to below the sampling period of {period:g} s at {speed:g} rad/s"
            raise out_of_range("computation delay", self.computation_delay, "s", limit, "sample at a larger angle or compute faster")
        return period


Sampling = FixedRate | CrankSynchronous


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledController:
    """A controller with discrete states: two equations, their parameters, and the names and units of all signals.

    Attributes:
        name: for people and files.
        parameters: NamedTuple of floats; the first argument of both equations.
        states, measurements, commands, outputs: the signals, in the order of the equations' tuples.
        drives: how many of the outputs, the first ones, drive the system; the others are its record.
        update: the states after a sample and the outputs made from it, in one tuple.
        start: the states before the first sample, from measurements, commands, and the outputs that shall continue without a jump.

    Raises:
        InvalidInputError: an equation branches on a value, returns the wrong number of results, or there is nothing to drive or measure.
    """

    name: str
    parameters: Any
    states: tuple[Variable, ...]
    measurements: tuple[Variable, ...]
    commands: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    drives: int
    update: Equation
    start: Equation

    def __post_init__(self) -> None:
        if not (1 <= self.drives <= len(self.outputs) and self.measurements):
            message = (
                f"{self.name}: {self.drives} of {len(self.outputs)} outputs drive a system and {len(self.measurements)} signals are "
                "measured; a controller needs at least one of each"
            )
            raise InvalidInputError(message)
        sizes = (("xd", len(self.states)), ("y", len(self.measurements)), ("r", len(self.commands)))
        updated = trace(self.update, self.parameters, *sizes, ("t", 1), kind=TracedUpdate)
        started = trace(self.start, self.parameters, *sizes[1:], ("u", self.drives), kind=TracedUpdate)
        for what, count, wanted in (
            ("update", len(updated), len(self.states) + len(self.outputs)),
            ("start", len(started), len(self.states)),
        ):
            if count != wanted:
                message = f"{self.name}: {what} returns {count} results where {wanted} signals are named"
                raise InvalidInputError(message)

    def with_parameters(self, parameters: Any) -> "SampledController":
        """Make the same controller with other parameters of the same form; its equations are not traced again.

        Raises:
            InvalidInputError: the parameters are of another type.
        """
        if type(parameters) is not type(self.parameters):
            message = f"{self.name} has {type(self.parameters).__name__}, not {type(parameters).__name__}, for parameters; give those"
            raise InvalidInputError(message)
        made = copy.copy(self)
        object.__setattr__(made, "parameters", parameters)
        made.__dict__.pop("content_digest", None)
        return made

    @functools.cached_property
    def equation_digest(self) -> str:
        """Digest of the equations' code, with all that they reach; parameters are not in it."""
        return equation_digest(self.update, self.start)

    @functools.cached_property
    def content_digest(self) -> str:
        """Digest of equations, parameters and signals: equal for controllers that behave alike."""
        signals = (self.states, self.measurements, self.commands, self.outputs, self.drives)
        return fingerprint(self.equation_digest, tuple(self.parameters), type(self.parameters).__name__, *signals)


def _check_positive(name: str, value: float, unit: str, remedy: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise out_of_range(name, value, unit, "the positive numbers", remedy)


def _check_computation(value: float) -> None:
    if not (math.isfinite(value) and value >= 0.0):
        raise out_of_range("computation delay", value, "s", "0 and above", "give the time from a sample to its output")
