"""Whether a linear loop with exact delay is stable: its unstable poles counted, none missed."""

import math
from dataclasses import dataclass
from typing import ClassVar

from revline.design.controllers.pid_controller import AnyPid, continuous_law
from revline.design.stability.loop_equation import LoopEquation, form_loop
from revline.errors import AnalysisError
from revline.lti.axis_function import argument_change
from revline.lti.transfer_function import TransferFunction

COUNT_TOLERANCE = 1e-6
"""How far a count may be from a whole number; what is left is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StableLoop:
    """All closed-loop poles lie left of the imaginary axis.

    Attributes:
        high_frequency_gain: loop gain at infinite frequency. From 1 on, a loop without delay is stable only as long as it has none.
    """

    stable: ClassVar[bool] = True

    high_frequency_gain: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnstableLoop:
    """Some closed-loop poles lie right of the imaginary axis.

    Attributes:
        unstable_poles: how many, each as often as it is multiple.
        high_frequency_gain: loop gain at infinite frequency.
    """

    stable: ClassVar[bool] = False

    unstable_poles: int
    high_frequency_gain: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HighFrequencyUnstableLoop:
    """The derivative leaves a loop gain of 1 or more at infinite frequency, and the delay makes infinitely many poles of it.

    Attributes:
        high_frequency_gain: loop gain at infinite frequency, 1 or more.
    """

    stable: ClassVar[bool] = False

    high_frequency_gain: float


LoopStability = StableLoop | UnstableLoop | HighFrequencyUnstableLoop


def judge_loop_stability(plant: TransferFunction, law: AnyPid) -> LoopStability:
    """Judge whether the loop of a linear plant and a controller is stable, the delay exact.

    Args:
        plant: strictly proper, with or without delay.
        law: gains alone, derivative on the measurement, or a continuous controller.

    Raises:
        InvalidInputError: plant and controller do not make a well-posed loop.
        NotConvergedError: a closed-loop pole lies on the imaginary axis, or too near to tell.

    Source:
        Principle of the argument, with the change of argument along the axis certain by bounds (`revline.lti.axis_function`);
        poles at high frequency where plant and derivative are of one degree (neutral equation): Bellman and Cooke (1963),
        Differential-Difference Equations, chapter 12.

    Example:
        >>> from revline.design.controllers.controller import PidGains
        >>> plant = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=1.0)
        >>> gains = PidGains(kp=1.5, ki=0.0, kd=0.0, input_unit="1", output_unit="1", rule="by hand", designed_on="integrator")
        >>> judge_loop_stability(plant, gains).stable, judge_loop_stability(plant, gains.scaled(kp=1.1)).stable
        (True, False)
    """
    loop = form_loop(plant, law)
    if loop.delay > 0.0 and loop.high_frequency_gain >= 1.0:
        return HighFrequencyUnstableLoop(high_frequency_gain=loop.high_frequency_gain)
    count = _count(loop)
    if count == 0:
        return StableLoop(high_frequency_gain=loop.high_frequency_gain)
    return UnstableLoop(unstable_poles=count, high_frequency_gain=loop.high_frequency_gain)


def count_unstable_poles(plant: TransferFunction, law: AnyPid) -> int:
    """Count the closed-loop poles right of the imaginary axis, each as often as it is multiple.

    Args:
        plant: strictly proper, with or without delay.
        law: gains alone, derivative on the measurement, or a continuous controller.

    Raises:
        InvalidInputError: plant and controller do not make a well-posed loop.
        NotConvergedError: a closed-loop pole lies on the imaginary axis, or too near to tell.
        AnalysisError: there are infinitely many.
    """
    verdict = judge_loop_stability(plant, law)
    if isinstance(verdict, HighFrequencyUnstableLoop):
        message = (
            f"infinitely many poles are unstable: kd = {continuous_law(law).gains.kd:g} leaves a loop gain of "
            f"{verdict.high_frequency_gain:g} at infinite frequency (limit 1), behind a delay of {plant.delay:g} s; lower kd"
        )
        raise AnalysisError(message, high_frequency_gain=verdict.high_frequency_gain)
    return verdict.unstable_poles if isinstance(verdict, UnstableLoop) else 0


def _count(loop: LoopEquation) -> int:
    """Count zeros in the right half plane: along the axis up to where the leading power rules, then along a half circle."""
    if loop.order == 0:
        return 0
    high = loop.frequency_beyond(math.inf)
    function = loop.characteristic()
    turned = argument_change(function, high)
    leading = loop.own[-1] * (1j * high) ** loop.order
    beyond = complex(function(high)) / complex(leading)
    count = loop.order / 2.0 - (turned - math.atan2(beyond.imag, beyond.real)) / math.pi
    if abs(count - round(count)) > COUNT_TOLERANCE:
        message = (
            f"counted {count:.6g} unstable poles, which is no whole number; the coefficients are too far apart, use another unit of time"
        )
        raise AnalysisError(message, count=count)
    return round(count)
