"""A controller file as it runs: sampled, and within the limits of what it drives."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.studies.loop_runs import TimingChoice, any_controller, own_limits, throttle_limits

if TYPE_CHECKING:
    from revline.design.controllers.scheduled_pid import AnyController

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


def read_any_controller(path: Path, choice: TimingChoice) -> "AnyController":
    """Read a controller file, or one with a gain schedule; one that does not say when it samples does as the options say, with anti-windup.

    Args:
        path: the file.
        choice: the options.

    Raises:
        InvalidInputError: both options are given, or one and the file says itself; or the file is none.
    """
    from revline.io.json_files import read_json

    return any_controller(read_json(path, "controller file"), path.name, choice)


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
    from revline.design.controllers.scheduled_pid import ScheduledController, law_of

    law = law_of(controller)
    wanted = tuple(option if option is not None else bound for option, bound in zip(limits, own_limits(law), strict=True))
    if saturation is None:
        low, high = -math.inf if wanted[0] is None else wanted[0], math.inf if wanted[1] is None else wanted[1]
    else:
        low, high = throttle_limits((wanted[0], wanted[1]), saturation)
    law = replace(law, low=low, high=high, setpoint_weight=law.setpoint_weight if weight is None else weight)
    return replace(controller, controller=law) if isinstance(controller, ScheduledController) else law
