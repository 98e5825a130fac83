"""An engine's steady map over the throttle as one question asks for it, and the range in which a straight line holds."""

from typing import TYPE_CHECKING, NamedTuple

from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.analysis.operating_range import OperatingRange
    from revline.analysis.steady_map import SteadyMap
    from revline.system import DelaySystem


class Angles(NamedTuple):
    """Throttle angles, evenly spaced, in deg.

    Attributes:
        low: the lowest.
        high: the highest.
        points: how many.
    """

    low: float
    high: float
    points: int


class Wording(NamedTuple):
    """How who asks names what it gives, for messages.

    Attributes:
        low: the lowest angle, with what comes before its value.
        high: the highest.
        within: the tolerance.
        control: key that is wrong where the angles do not rise, if it has any.
    """

    low: str
    high: str
    within: str
    control: str = ""


def find_throttle_map(engine: "DelaySystem", angles: Angles, load: float, wording: Wording) -> "SteadyMap":
    """Find the steady states at throttle angles under a load in N m.

    Raises:
        InvalidInputError: the angles do not rise, or one is not finite.
    """
    import math

    import numpy as np

    from revline.analysis.steady_map import find_steady_map

    control = {"control": wording.control} if wording.control else {}
    for name, angle in ((wording.low, angles.low), (wording.high, angles.high)):
        if not math.isfinite(angle):
            message = f"{name} {angle:g} is no angle; give a number of degrees"
            raise InvalidInputError(message, angle=angle, **control)
    if not angles.low < angles.high:
        message = (
            f"{wording.low} {angles.low:g} is not below {wording.high} {angles.high:g}: the angles must rise; give the lower one first"
        )
        raise InvalidInputError(message, low=angles.low, high=angles.high, **control)
    values = np.linspace(*angles)
    return find_steady_map(engine, sweep_input="throttle", values=values, output="engine_speed", inputs={"load_torque": load})


def find_widest(found: "SteadyMap", text: str, centre: float, wording: Wording) -> "OperatingRange":
    """Find the widest range about a throttle angle in which a straight line holds.

    Args:
        found: the map.
        text: the tolerance, a part of the speed's change (1%) or a speed in rad/s (3).
        centre: in deg.
        wording: of the tolerance.

    Raises:
        InvalidInputError: the tolerance is no number, or more than one.
    """
    from revline.analysis.operating_range import ErrorMeasure, find_operating_range
    from revline.io.number_lists import parse_numbers

    percent = text.strip().endswith("%")
    (tolerance, *more) = parse_numbers(text.strip().removesuffix("%"), wording.within)
    if more:
        message = f"{wording.within} {text!r} names more than one tolerance; give one, for example 1% or 3"
        control = {"control": wording.within} if wording.control else {}
        raise InvalidInputError(message, **control)
    if percent:
        return find_operating_range(found, centre=centre, tolerance=float(tolerance) / 100.0, measure=ErrorMeasure.FRACTION)
    return find_operating_range(found, centre=centre, tolerance=float(tolerance), measure=ErrorMeasure.OUTPUT)
