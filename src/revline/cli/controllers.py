"""A controller file as it runs: sampled, and within the limits of what it drives."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.controller import PidGains
    from revline.design.pid_controller import PidController
    from revline.design.scheduled_pid import AnyController

PERIOD = 0.005
"""Seconds between samples where neither the file nor an option says when the controller runs."""


class TimingChoice(NamedTuple):
    """What --period, --crank-angle and --computation-delay say."""

    period: float | None
    crank_angle: float | None
    computation_delay: float


def read_any_controller(path: Path, choice: TimingChoice) -> "AnyController":
    """Read a controller file as `read_sampled_controller` does, or a gain schedule, which says nothing of sampling.

    Raises:
        InvalidInputError: as for `read_sampled_controller`, or the schedule cannot be read.
    """
    from revline.design.controller import PidGains
    from revline.design.scheduled_pid import ScheduledController
    from revline.io.json_files import read_json
    from revline.io.schedule_files import is_schedule, parse_schedule

    record = read_json(path, "controller file")
    if not is_schedule(record):
        return read_sampled_controller(path, choice)
    schedule = parse_schedule(record)
    unit = schedule.gain_unit.removesuffix(f"/({schedule.units[0]})")
    gains = PidGains(kp=0.0, ki=0.0, kd=0.0, input_unit=schedule.units[0], output_unit=unit, rule="schedule", designed_on=path.name)
    return ScheduledController(controller=_timed(gains, choice), schedule=schedule)


def _timed(gains: "PidGains", choice: TimingChoice) -> "PidController":
    """A controller of these gains, sampled as the options say."""
    from revline.design.pid_controller import PidController

    return sample(PidController(gains=gains), choice)


def read_sampled_controller(path: Path, choice: TimingChoice) -> "PidController":
    """Read a controller file; one that does not say when it samples does as the options say, with anti-windup.

    Args:
        path: the file.
        choice: the options.

    Raises:
        InvalidInputError: both options are given, or one and the file says itself; or the file is none.
    """
    from revline.design.pid_controller import Continuous
    from revline.io.controller_files import read_controller

    found = read_controller(path).controller
    if not isinstance(found.sampling, Continuous):
        if choice != TimingChoice(None, None, 0.0):
            message = f"{path.name} says itself when its controller samples; leave --period, --crank-angle and --computation-delay out"
            raise InvalidInputError(message)
        return found
    return sample(found, choice)


def sample(controller: "PidController", choice: TimingChoice) -> "PidController":
    """Give a continuous controller the sampling that the options say, and anti-windup where it has none."""
    from revline.design.pid_controller import AntiWindup
    from revline.sampled import CrankSynchronous, FixedRate

    period, angle, computation = choice
    if period is not None and angle is not None:
        message = "--period and --crank-angle each say when the controller samples; give one"
        raise InvalidInputError(message)
    windup = AntiWindup.CLAMPING if controller.anti_windup is AntiWindup.NONE else controller.anti_windup
    if angle is not None:
        return replace(controller, sampling=CrankSynchronous(angle=angle, computation_delay=computation), anti_windup=windup)
    timer = FixedRate(period=PERIOD if period is None else period, computation_delay=computation)
    return replace(controller, sampling=timer, anti_windup=windup)


def own_limits(controller: "PidController") -> tuple[float | None, float | None]:
    """Limits that a controller has itself, none where it has none."""
    low, high = controller.low, controller.high
    return low if math.isfinite(low) else None, high if math.isfinite(high) else None
