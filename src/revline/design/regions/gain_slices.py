"""Stabilising gains (kp, ki, kd) in slices of constant kd, with contours of sensitivity, a damping, and controllers placed in them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from revline.design.controllers.controller import PidGains
from revline.design.regions.gain_curve import AXIS, Contour, LoopFamily
from revline.design.regions.gain_rays import RayPlace, place_gains
from revline.design.regions.gain_region import GainRegion, Window, find_gain_region
from revline.design.regions.sensitivity_contour import SensitivityContour, find_peaks, find_sensitivity_contour
from revline.errors import InvalidInputError, NotConvergedError, out_of_range

MakeFamily = Callable[[float, Contour], LoopFamily]
"""Gives a plant with a kd and a contour."""

KD_GROWTH = 1.25
"""By this factor kd is raised until no gains stabilise any more."""

KD_TOLERANCE = 1e-3
"""To this fraction the largest kd is bisected; a region about to vanish is as small as what its boundary is resolved by."""

MOST_KD = 1e3
"""Largest kd tried, as a multiple of kp's reach at a rate of 1 rad/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What is asked of a plant's gains.

    Attributes:
        kds: derivative gains of the slices.
        peaks: values of the peak sensitivity to draw contours of.
        damping: ratio that roots shall have at least; 0 where none is asked for.
        up_to: natural frequency up to which they shall, in rad/s; 0 for the highest one at which the slice's boundary oscillates, of a
            plant without delay for any.
        kp_max, ki_max: largest gains looked at; 0 where they are chosen.
    """

    kds: tuple[float, ...] = (0.0,)
    peaks: tuple[float, ...] = ()
    damping: float = 0.0
    up_to: float = 0.0
    kp_max: float = 0.0
    ki_max: float = 0.0

    def __post_init__(self) -> None:
        if len(set(self.kds)) < len(self.kds):
            message = f"{len(self.kds)} derivative gains are given, some of them alike; give different ones"
            raise InvalidInputError(message)
        if self.up_to != 0.0 and self.damping == 0.0:
            message = f"a damping is asked for up to {self.up_to:g} rad/s but no ratio; give one above 0"
            raise InvalidInputError(message)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A controller to be placed in the slice of its kd.

    Attributes:
        name: for people.
        kp, ki, kd: its gains.
        unit: of kp.
    """

    name: str
    kp: float
    ki: float
    kd: float
    unit: str


def mark_controller(name: str, gains: PidGains) -> Mark:
    """Name a controller to be placed."""
    return Mark(name=name, kp=gains.kp, ki=gains.ki, kd=gains.kd, unit=gains.gain_units["kp"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """Where a controller lies.

    Attributes:
        mark: the controller.
        place: on the ray of its kp and ki, at its kd.
        peak: of the sensitivity; 0 for a loop that is not stable.
        damped: whether its roots are damped as is asked; false where nothing is.
    """

    mark: Mark
    place: RayPlace
    peak: float
    damped: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class GainSlice:
    """One kd: the stabilising gains and what else was asked for.

    Attributes:
        region: stabilising gains.
        contours: of the peak sensitivity, in the order asked for.
        damped: gains that damp the loop as asked, in the same window; none where no damping was asked for, or no gains stabilise.
        placed: controllers with this kd.
    """

    region: GainRegion
    contours: tuple[SensitivityContour, ...]
    damped: tuple[GainRegion, ...]
    placed: tuple[Placed, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestKd:
    """How far kd may rise before no kp and ki stabilise the loop.

    Attributes:
        stabilised: largest kd found at which some do.
        lost: smallest one found above it at which none are found; infinite where some still are at the largest tried.
        reason: why none are found there.
    """

    stabilised: float
    lost: float
    reason: str


def find_slices(make: MakeFamily, question: Question, *, marks: tuple[Mark, ...] = (), delayed: bool) -> tuple[GainSlice, ...]:
    """Find the stabilising gains at some kd, and those of the marked controllers.

    Args:
        make: gives the plant's family.
        question: what is asked.
        marks: controllers; each is placed in the slice of its own kd, which is added where it was not asked for.
        delayed: whether the plant has a delay, so that a damping can only be asked for up to a frequency.

    Returns:
        One slice for each kd, in the order asked for, added ones behind.

    Raises:
        InvalidInputError: a gain, a peak or a damping cannot be asked for, or infinitely many roots are unstable at a kd.
        NotConvergedError: a curve turns too fast to be followed.
    """
    kds = tuple(dict.fromkeys((*question.kds, *(mark.kd for mark in marks))))
    if not kds:
        message = "no derivative gain is given, and no controller that has one; give kd = 0 for none"
        raise InvalidInputError(message)
    return tuple(_slice(make, kd, question, tuple(m for m in marks if m.kd == kd), delayed=delayed) for kd in kds)


def _slice(make: MakeFamily, kd: float, question: Question, marks: tuple[Mark, ...], *, delayed: bool) -> GainSlice:
    family = make(kd, AXIS)
    for mark in marks:
        _check_units(mark, family)
    region = _region(family, question, marks)
    contours = tuple(find_sensitivity_contour(region, peak) for peak in question.peaks)
    damped: tuple[GainRegion, ...] = ()
    if question.damping != 0.0 and not region.empty:
        contour = Contour(damping=question.damping, up_to=question.up_to or _highest(region, delayed=delayed))
        damped = (find_gain_region(make(kd, contour), region.window),)
    return GainSlice(region=region, contours=contours, damped=damped, placed=tuple(_placed(mark, region, damped) for mark in marks))


def _region(family: LoopFamily, question: Question, marks: tuple[Mark, ...]) -> GainRegion:
    """The region in a window that is asked for, or chosen so that it holds the marks."""
    found = find_gain_region(family)
    window = found.window
    if question.kp_max != 0.0:
        window = replace(window, kp_low=min(window.kp_low, -0.1 * abs(question.kp_max)), kp_high=question.kp_max)
    if question.ki_max != 0.0:
        window = replace(window, ki_high=question.ki_max)
    for mark in marks:
        kp, ki = mark.kp, mark.ki
        window = Window(kp_low=min(window.kp_low, 1.1 * kp), kp_high=max(window.kp_high, 1.1 * kp), ki_high=max(window.ki_high, 1.1 * ki))
    return found if window == found.window else find_gain_region(family, window)


def _highest(region: GainRegion, *, delayed: bool) -> float:
    if not delayed:
        return math.inf
    if not region.rim.any():
        message = f"the stabilising gains of {region.family.name} have no boundary in the window; say up to which frequency they shall damp"
        raise InvalidInputError(message)
    return float(region.omega[region.rim][-1])


def _check_units(mark: Mark, family: LoopFamily) -> None:
    unit = mark.unit
    if family.gain_unit and unit != family.gain_unit:
        message = f"controller {mark.name} has gains in {unit} and {family.name} takes {family.gain_unit}; convert the gains"
        raise InvalidInputError(message, unit=unit)
    if mark.ki < 0.0:
        raise out_of_range(f"ki of {mark.name}", mark.ki, f"{unit}/s", "0 and above", "turn the sign of the gains")


def _placed(mark: Mark, region: GainRegion, damped: tuple[GainRegion, ...]) -> Placed:
    kp, ki = mark.kp, mark.ki
    place = place_gains(region, kp, ki)
    peak = float(find_peaks(region, kp, ki)) if place.inside else 0.0
    return Placed(mark=mark, place=place, peak=peak, damped=any(place_gains(other, kp, ki).inside for other in damped))


def find_largest_kd(make: MakeFamily) -> LargestKd:
    """Find the largest kd up to which, from 0 on, some kp and ki stabilise the loop.

    It is raised by a quarter at a time and then bisected: gains that no kd stabilises within less than that pass unseen.

    Args:
        make: gives the plant's family.

    Raises:
        InvalidInputError: no gains stabilise the loop at kd = 0 either.
    """
    region = find_gain_region(make(0.0, AXIS))
    if region.empty:
        message = f"no kp and ki stabilise {region.family.name} with kd = 0, so that there is no largest kd; give slices of kd instead"
        raise InvalidInputError(message)
    unit = max(abs(region.window.kp_low), abs(region.window.kp_high))
    low, high = 0.0, 1e-3 * unit
    reason = _why_none(make, high)
    while not reason:
        low, high = high, KD_GROWTH * high
        if high > MOST_KD * unit:
            return LargestKd(stabilised=low, lost=math.inf, reason="")
        reason = _why_none(make, high)
    while high - low > KD_TOLERANCE * high:
        middle = 0.5 * (low + high)
        found = _why_none(make, middle)
        low, high, reason = (low, middle, found) if found else (middle, high, reason)
    return LargestKd(stabilised=low, lost=high, reason=reason)


def _why_none(make: MakeFamily, kd: float) -> str:
    """Why no gains stabilise, as far as can be told; empty where some do."""
    try:
        return "no kp and ki stabilise" if find_gain_region(make(kd, AXIS)).empty else ""
    except InvalidInputError as error:
        if "kd" not in error.details:
            raise
        return str(error)
    except NotConvergedError as error:
        return str(error)
