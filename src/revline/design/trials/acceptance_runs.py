"""What a run of the acceptance battery is made of, a step of the command and then of the load, and what is measured in it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.design.loops.sampled_loop import SampledRun
from revline.errors import InvalidInputError, out_of_range
from revline.signals import Signal
from revline.units import Seconds

Floats = NDArray[np.float64]

TAIL = 0.2
"""The last part of the time after a step whose mean counts as where it rests."""

NOISE_BAND = 3.0
"""A noisy run may leave its settling band by so many standard deviations of the noise: no controller could do better in time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """A step of the command at the start, and one of the load at half time.

    Attributes:
        command: size of the command's step.
        load: size of the load's step.
        until: length of the run, in s.
    """

    command: float
    load: float
    until: Seconds

    @property
    def half(self) -> Seconds:
        """When the load steps."""
        return self.until / 2.0

    @property
    def command_signal(self) -> Signal:
        """The command, relative to rest."""
        return signals.step(self.command)

    @property
    def load_signal(self) -> Signal:
        """The load, relative to rest."""
        return signals.step(self.load, start=self.half)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measures:
    """What a run was like; values are in the measurement's unit unless said otherwise.

    Attributes:
        overshoot: beyond the target after the command's step, as a fraction of the step.
        command_settling_time: from the command's step to where it stays within the band, in s; infinite where it does not.
        load_settling_time: likewise after the load's step.
        command_error: where it rests after the command's step, less the target.
        load_error: likewise after the load's step.
        command_iae: integral of the absolute error after the command's step, in the unit times s.
        load_iae: likewise after the load's step.
        droop: largest distance from the target after the load's step.
        travel: sum of all movements of the control, in its unit.
        saturated_share: part of the controller's samples with its output at a limit.
        integral_low, integral_high: range of the integral term, in the control's unit.
        uncertain: how far a mean may be off by noise alone: a standard deviation, which a loop that rings comes to and no other.
        overruns: outputs that were not ready before the next sample.
    """

    overshoot: float
    command_settling_time: Seconds
    load_settling_time: Seconds
    command_error: float
    load_error: float
    command_iae: float
    load_iae: float
    droop: float
    travel: float
    saturated_share: float
    integral_low: float
    integral_high: float
    uncertain: float
    overruns: int


def measure_run(run: SampledRun, probe: Probe, *, band: float, noise: float) -> Measures:
    """Measure a run of the battery.

    Args:
        run: from rest, under the probe.
        probe: what it went through.
        band: half width of the settling band, as a fraction of the command's step; after the load's, of the larger of that and the droop.
        noise: standard deviation of the measurement's noise.
    """
    target = run.start + probe.command
    error = run.output - target
    first, second = run.times < probe.half, run.times >= probe.half
    droop = float(np.max(np.abs(error[second])))
    spare = NOISE_BAND * noise
    after_command = _settling(run.times[first], error[first], band * abs(probe.command) + spare)
    after_load = _settling(run.times[second] - probe.half, error[second], band * max(droop, abs(probe.command)) + spare)
    control, integral = run.of_controller("control"), run.of_controller("integral")
    return Measures(
        overshoot=max(0.0, float(np.max(error[first] * math.copysign(1.0, probe.command))) / abs(probe.command)),
        command_settling_time=after_command,
        load_settling_time=after_load,
        command_error=_rest(error[first]),
        load_error=_rest(error[second]),
        command_iae=float(np.trapezoid(np.abs(error[first]), run.times[first])),
        load_iae=float(np.trapezoid(np.abs(error[second]), run.times[second])),
        droop=droop,
        travel=float(np.sum(np.abs(np.diff(control)))),
        saturated_share=run.saturated_share,
        integral_low=float(integral.min()),
        integral_high=float(integral.max()),
        uncertain=noise,
        overruns=run.sampled.overruns,
    )


def _settling(times: Floats, error: Floats, width: float) -> float:
    """Time after which the error stays within the band; infinite where it is outside in the last tenth."""
    outside = np.flatnonzero(np.abs(error) > width)
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    return float(times[last]) if times[last] <= times[0] + 0.9 * (times[-1] - times[0]) else math.inf


def _rest(error: Floats) -> float:
    return float(np.mean(error[-max(1, round(TAIL * error.size)) :]))


def refuse_probe(command: float, load: float, until: float) -> None:
    """Refuse steps that measure nothing.

    Raises:
        InvalidInputError: a step is 0 or no finite number, or the run has no length.
    """
    for name, value in (("step of the command", command), ("step of the load", load)):
        if not math.isfinite(value) or value == 0.0:
            message = f"the {name} is {value:g}; give a finite size that is not 0"
            raise InvalidInputError(message, value=value)
    if not (math.isfinite(until) and until > 0.0):
        raise out_of_range("length of a run", until, "s", "the positive numbers", "give some seconds, for example 10")
