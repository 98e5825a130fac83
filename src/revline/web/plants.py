"""What the parts of a view share, found once and kept: engine, operating point, linear model, frequency response and fitted models.

Each is a function of frozen values alone, so that the last ones asked for can be kept by the process that found them.
"""

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.analysis.balance_attempts import PartialBalance, attempt_balance
from revline.analysis.harmonic_balance import HarmonicBalance
from revline.analysis.linearize import Linearization, linearize
from revline.analysis.periodic import Excitation
from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.controller import PidGains
from revline.design.fitting.fit import add_phase_line
from revline.design.fitting.model_choice import MODEL_STRUCTURES, ModelStructure, NamedFit, fit_structure
from revline.design.loops.loop_run import Limits
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model
from revline.engine.lee1995 import lee1995_parameters
from revline.errors import InvalidInputError, RevlineError, out_of_range
from revline.studies.config import read_table_4_1
from revline.system import DelaySystem
from revline.web.parameters import changed_engine
from revline.web.state import State

Floats = NDArray[np.float64]

KEPT: Final = 64
"""So many operating points are kept at most."""

WIDE_OPEN: Final = 90.0
"""End of the throttle's way, in deg."""

MODELS: Final = ("g1", "g2", "g2d")
"""The fitted models that a view shows. Source: Lee (1995), chapter 4."""


class Place(NamedTuple):
    """An engine and where it rests: at a throttle angle, or at a speed."""

    engine: str
    changed: tuple[tuple[str, float], ...]
    throttle: float | None
    speed: float | None
    load: float


class Point(NamedTuple):
    """An engine at rest, with its exact linear model there."""

    engine: DelaySystem
    trim: Trim
    linear: Linearization


def place_of(state: State) -> Place:
    """Take the operating point out of a state."""
    return Place(state.engine, state.changed, state.throttle, state.speed_rad_s, state.load_n_m)


@lru_cache(maxsize=KEPT)
def find_engine(name: str, changed: tuple[tuple[str, float], ...]) -> DelaySystem:
    """Build an engine with some parameters changed, as `changed_engine` does: once for all points at which it rests."""
    return changed_engine(name, changed)


def find_point(place: Place) -> Point:
    """Find the operating point.

    Raises:
        InvalidInputError: the engine or a parameter is wrong, or the values lie outside the engine's ranges.
        NoTrimError: there is no steady state; `details` has the control that asked for it.
    """
    found = _try_point(place)
    if isinstance(found, Point):
        return found
    raise found.with_traceback(None)  # kept, and raised again for each part that asks


@lru_cache(maxsize=KEPT)
def _try_point(place: Place) -> Point | RevlineError:
    """The operating point, or why there is none: a long search that fails is not made again for each part of a view."""
    try:
        engine = find_engine(place.engine, place.changed)
        if place.speed is None:
            trim = find_trim(engine, inputs={"throttle": float(place.throttle or 0.0), "load_torque": place.load})
        else:
            trim = find_trim(engine, inputs={"load_torque": place.load}, outputs={"engine_speed": place.speed}, free=("throttle",))
        return Point(engine, trim, linearize(engine, trim))
    except RevlineError as error:
        return error


@lru_cache(maxsize=KEPT)
def find_balance(place: Place, amplitude: float) -> HarmonicBalance | PartialBalance:
    """Find the response by harmonic balance at the frequencies of Lee (1995), Table 4.1."""
    point = find_point(place)
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=amplitude)
    omega = np.array([row["frequency_rad_s"] for row in read_table_4_1()])
    return attempt_balance(point.engine, point.trim, excitation, omega)


@lru_cache(maxsize=KEPT)
def fit_model(place: Place, amplitude: float, name: str) -> NamedFit:
    """Fit a model to the response by harmonic balance, as far as that was found."""
    if name == "g2d":  # the second-order model's optimum, with its phase line
        plain = fit_model(place, amplitude, "g2")
        return NamedFit(structure=_structure(name), fit=add_phase_line(plain.fit))
    found = find_balance(place, amplitude)
    balance = found.finished if isinstance(found, PartialBalance) else found
    return fit_structure(balance.response(), _structure(name))


def _structure(name: str) -> ModelStructure:
    return next(one for one in MODEL_STRUCTURES if one.name == name)


def gains_of(state: State) -> PidGains:
    """Take the controller out of a state."""
    return _gains(state.kp, state.ki, state.kd)


def _gains(kp: float, ki: float, kd: float) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="the workbench")


def loop_with_model(state: State, name: str) -> OpenLoop:
    """Break the loop of a fitted model and a state's controller, and tell whether it is stable when closed.

    Raises:
        RevlineError: the model cannot be fitted, or its loop not be judged.
    """
    return _loop_with_model(place_of(state), state.amplitude_deg, name, (state.kp, state.ki, state.kd))


@lru_cache(maxsize=3 * KEPT)
def _loop_with_model(place: Place, amplitude: float, name: str, gains: tuple[float, float, float]) -> OpenLoop:
    return open_loop_of_model(fit_model(place, amplitude, name).fit.model, _gains(*gains))


def limits_of(state: State, point: Point) -> Limits:
    """Limits of the throttle: those asked for, else 0 and where it saturates.

    Raises:
        InvalidInputError: the lower one is not below the upper one, or the angle at rest is not within them.
    """
    saturation = _saturation(state.engine, state.changed)
    low = 0.0 if state.low_deg is None else state.low_deg
    high = saturation if state.high_deg is None else state.high_deg
    if not low < high:
        message = f"low_deg = {low:g} deg is not below high_deg = {high:g} deg; give limits with room between them"
        raise InvalidInputError(message, control="low_deg", low=low, high=high)
    angle = point.trim.input("throttle")
    if not low <= angle <= high:
        asked = "low_deg" if angle < low else "high_deg"
        control = asked if getattr(state, asked) is not None else _control_of_point(state)
        message = (
            f"the throttle rests at {angle:.4g} deg, outside its limits of {low:g} to {high:g} deg; give other limits, or another point"
        )
        raise InvalidInputError(message, control=control, low=low, high=high, angle=angle)
    return Limits(low, high)


@lru_cache(maxsize=KEPT)
def _saturation(name: str, changed: tuple[tuple[str, float], ...]) -> float:
    """The throttle angle from which on it lets no more air pass."""
    return lee1995_parameters(find_engine(name, changed)).throttle.saturation_angle


def control_of(error: RevlineError, state: State) -> str:
    """Name the key of a state that an error is about, as far as that can be told; the operating point's where it has no steady state."""
    named = error.details.get("control")
    if isinstance(named, str):
        return named
    return {
        "NoTrimError": _control_of_point(state),
        "StalledError": "command_rad_s",
    }.get(type(error).__name__, "")


def _control_of_point(state: State) -> str:
    return "throttle_deg" if state.speed_rad_s is None else "speed_rad_s"


def check_amplitude(state: State, point: Point) -> None:
    """Refuse a sinusoid that would leave the throttle's range.

    Raises:
        InvalidInputError: it would; `details` has the control that can mend it.
    """
    angle = point.trim.input("throttle")
    room = min(angle, WIDE_OPEN - angle)
    if room <= 0.0:
        message = (
            f"about {angle:.4g} deg there is no room for a sinusoid: the throttle goes from 0 to {WIDE_OPEN:g} deg; move it off its end"
        )
        raise InvalidInputError(message, control=_control_of_point(state), angle=angle)
    if state.amplitude_deg > room:
        error = out_of_range(
            "amplitude_deg",
            state.amplitude_deg,
            "deg",
            f"0 to {room:.4g} deg, the room that the throttle has about {angle:.4g} deg within 0 to {WIDE_OPEN:g} deg",
            f"give {room:.4g} deg or less",
        )
        raise InvalidInputError(str(error), **{**error.details, "control": "amplitude_deg"})


def check_influence(state: State, point: Point) -> None:
    """Refuse an operating point at which the speed does not answer the throttle.

    Raises:
        InvalidInputError: it does not.
    """
    if point.linear.model.static_gain("throttle", "engine_speed") == 0.0:
        angle = point.trim.input("throttle")
        message = (
            f"at {angle:.4g} deg the air no longer follows the throttle: to move it changes nothing, so that there is no response "
            "and no loop; choose a smaller angle"
        )
        raise InvalidInputError(message, control=_control_of_point(state), angle=angle)


def has_control(state: State) -> bool:
    """Whether any gain of the controller is other than 0."""
    return bool(state.kp or state.ki or state.kd)
