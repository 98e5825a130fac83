"""A controller file as it runs: sampled, and within the limits of what it drives."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.controllers.pid_controller import PidController
    from revline.design.controllers.scheduled_pid import AnyController

PERIOD = 0.005
"""Seconds between samples where neither the file nor an option says when the controller runs."""


SetpointWeightOption = Annotated[
    float | None, typer.Option("--setpoint-weight", metavar="B", help="Weight of the command in the proportional term; else the file's.")
]
LowOption = Annotated[
    float | None, typer.Option("--low", metavar="DEG", help="Lower limit of the throttle [deg]; else the file's, else 0.")
]
HighOption = Annotated[
    float | None,
    typer.Option("--high", metavar="DEG", help="Upper limit of the throttle [deg]; else the file's, else where it saturates."),
]


class TimingChoice(NamedTuple):
    """What --period, --crank-angle and --computation-delay say."""

    period: float | None
    crank_angle: float | None
    computation_delay: float


def read_any_controller(path: Path, choice: TimingChoice) -> "AnyController":
    """Read a controller file, or one with a gain schedule; one that does not say when it samples does as the options say, with anti-windup.

    Args:
        path: the file.
        choice: the options.

    Raises:
        InvalidInputError: both options are given, or one and the file says itself; or the file is none.
    """
    from revline.io.controller_files import parse_controller
    from revline.io.json_files import read_json
    from revline.io.schedule_files import is_schedule, parse_scheduled

    record = read_json(path, "controller file")
    if not is_schedule(record):
        return _timed(parse_controller(record).controller, path, choice)
    found = parse_scheduled(record, designed_on=path.name)
    return replace(found, controller=_timed(found.controller, path, choice))


def _timed(controller: "PidController", path: Path, choice: TimingChoice) -> "PidController":
    """A file's controller, sampled as it says itself, else as the options say."""
    from revline.design.controllers.pid_controller import Continuous

    if isinstance(controller.sampling, Continuous):
        return sample(controller, choice)
    if choice != TimingChoice(None, None, 0.0):
        message = f"{path.name} says itself when its controller samples; leave --period, --crank-angle and --computation-delay out"
        raise InvalidInputError(message)
    return controller


def sample(controller: "PidController", choice: TimingChoice) -> "PidController":
    """Give a continuous controller the sampling that the options say, and anti-windup where it has none."""
    from revline.design.controllers.pid_controller import AntiWindup
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


def surrounded(
    controller: "AnyController", *, weight: float | None, limits: tuple[float | None, float | None], saturation: float | None = None
) -> "AnyController":
    """Give a controller the set-point weight and the limits of the output that options say; else its own, else those of the throttle.

    Args:
        controller: from a file.
        weight: option.
        limits: options.
        saturation: angle from which the throttle is open, in deg, where it is known.

    Raises:
        InvalidInputError: a limit is none that the throttle reaches, or the limits or the weight are none.
    """
    from revline.cli.loop_runs import throttle_limits
    from revline.design.controllers.scheduled_pid import ScheduledController, law_of

    law = law_of(controller)
    wanted = tuple(option if option is not None else bound for option, bound in zip(limits, own_limits(law), strict=True))
    if saturation is None:
        low, high = -math.inf if wanted[0] is None else wanted[0], math.inf if wanted[1] is None else wanted[1]
    else:
        low, high = throttle_limits((wanted[0], wanted[1]), saturation)
    law = replace(law, low=low, high=high, setpoint_weight=law.setpoint_weight if weight is None else weight)
    return replace(controller, controller=law) if isinstance(controller, ScheduledController) else law
