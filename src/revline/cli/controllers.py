"""A controller file as it runs: sampled, and within the limits of what it drives."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.pid_controller import PidController

PERIOD = 0.005
"""Seconds between samples where neither the file nor an option says when the controller runs."""


class TimingChoice(NamedTuple):
    """What --period, --crank-angle and --computation-delay say."""

    period: float | None
    crank_angle: float | None
    computation_delay: float


def read_sampled_controller(path: Path, choice: TimingChoice) -> "PidController":
    """Read a controller file; one that does not say when it samples does as the options say, with anti-windup.

    Args:
        path: the file.
        choice: the options.

    Raises:
        InvalidInputError: both options are given, or one and the file says itself; or the file is none.
    """
    from revline.design.pid_controller import AntiWindup, Continuous
    from revline.io.controller_files import read_controller
    from revline.sampled import CrankSynchronous, FixedRate

    found = read_controller(path).controller
    period, angle, computation = choice
    if period is not None and angle is not None:
        message = "--period and --crank-angle each say when the controller samples; give one"
        raise InvalidInputError(message)
    if not isinstance(found.sampling, Continuous):
        if choice != TimingChoice(None, None, 0.0):
            message = f"{path.name} says itself when its controller samples; leave --period, --crank-angle and --computation-delay out"
            raise InvalidInputError(message)
        return found
    windup = AntiWindup.CLAMPING if found.anti_windup is AntiWindup.NONE else found.anti_windup
    if angle is not None:
        return replace(found, sampling=CrankSynchronous(angle=angle, computation_delay=computation), anti_windup=windup)
    timer = FixedRate(period=PERIOD if period is None else period, computation_delay=computation)
    return replace(found, sampling=timer, anti_windup=windup)


def own_limits(controller: "PidController") -> tuple[float | None, float | None]:
    """Limits that a controller has itself, none where it has none."""
    low, high = controller.low, controller.high
    return low if math.isfinite(low) else None, high if math.isfinite(high) else None
