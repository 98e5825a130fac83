"""Plants that are compared in the nu-gap: their transfer function with exact delay, and what the axis alone does not tell.

A plant stands for itself; `Weight` puts a constant or a controller in series with it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.controllers.controller import PidGains
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.stability.open_loop import open_loop_of_model, open_loop_of_system
from revline.errors import InvalidInputError, out_of_range
from revline.lti.roots import axis_widths, characteristic_roots
from revline.lti.state_space import DelayStateSpace, position
from revline.lti.transfer_function import TransferFunction

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Transfer = Callable[[ArrayLike], Complexes]

NOTHING_AT_REST = 1e-12
"""A gain at rest this small, relative to that at 1 rad/s, is zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedPlant:
    """A plant of one input and one output, as the nu-gap sees it.

    Attributes:
        name: for people.
        transfer: from input to output on complex s of any shape, delays exact.
        delay: the longest that its phase turns by for certain, in s.
        unstable_poles: right of the imaginary axis.
        order_at_rest: poles at s = 0 less zeros there.
        excess: degree of the denominator less that of the numerator; infinite where it only is known that the response falls.
        leading: what s to the power of the excess times the transfer function goes to without its delay; 0 where not known.
        units: of input and output.
        unstable_closed: counts the unstable poles of the loop under a controller.
    """

    name: str
    transfer: Transfer
    delay: float
    unstable_poles: int
    order_at_rest: int
    excess: float
    leading: float
    units: tuple[str, str]
    unstable_closed: Callable[[PidGains], float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Weight:
    """What stands in series with both plants, so that signals of different units can be compared at all.

    Attributes:
        text: in words.
        transfer: on complex s of any shape.
        poles_at_rest: at s = 0.
        rise: the power of s that it rises by at high frequency.
        leading: what it goes to, over that power of s.
        gains: the controller, where that is the weight.
    """

    text: str
    transfer: Transfer
    poles_at_rest: int
    rise: int
    leading: float
    gains: PidGains | None = None


def constant_weight(value: float) -> Weight:
    """Weigh plants by a constant, in input units per output unit: 1 compares them in the units that they have.

    Raises:
        InvalidInputError: the constant is not above 0.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise out_of_range("weight", value, "input units per output unit", "values above 0", "give 1, or the inverse of the gain at rest")

    def transfer(s: ArrayLike) -> Complexes:
        return np.full(np.shape(s), value, dtype=complex)

    return Weight(text=f"the constant {value:g}", transfer=transfer, poles_at_rest=0, rise=0, leading=value)


def controller_weight(gains: PidGains) -> Weight:
    """Weigh plants by the controller that is to hold on both: their loops are compared, which have no units.

    Raises:
        InvalidInputError: all gains are 0.
    """
    leading = next((value for value in (gains.kd, gains.kp, gains.ki) if value != 0.0), None)
    if leading is None:
        message = "all gains of the controller are 0, so that there is no loop; give one that is not"
        raise InvalidInputError(message)
    rise = 1 if gains.kd != 0.0 else 0 if gains.kp != 0.0 else -1
    return Weight(
        text=f"the controller ({gains.rule})",
        transfer=gains.feedback_transfer,
        poles_at_rest=int(gains.ki != 0.0),
        rise=rise,
        leading=leading,
        gains=gains,
    )


def plant_of_model(model: TransferFunction, *, name: str = "model") -> ComparedPlant:
    """Take a transfer function with delay as a plant to be compared.

    Raises:
        InvalidInputError: the transfer function is zero, has poles on the imaginary axis other than at 0, or poles and zeros at 0 that
            cancel.
    """
    if model.numerator == (0.0,):
        message = f"{name} is zero at all frequencies: there is nothing to compare"
        raise InvalidInputError(message, name=name)
    poles_at_rest = next(k for k, c in enumerate(model.denominator) if c != 0.0)
    zeros_at_rest = next(k for k, c in enumerate(model.numerator) if c != 0.0)
    if poles_at_rest and zeros_at_rest:
        message = f"{name} has poles and zeros at s = 0 that cancel; divide both by the common power of s"
        raise InvalidInputError(message, name=name)
    _refuse_axis_poles(model.poles[model.poles != 0.0], name)
    return ComparedPlant(
        name=name,
        transfer=model,
        delay=model.delay,
        unstable_poles=int(np.sum(model.poles.real > 0.0)),
        order_at_rest=poles_at_rest - zeros_at_rest,
        excess=model.relative_degree,
        leading=model.numerator[-1] / model.denominator[-1],
        units=(model.input_unit, model.output_unit),
        unstable_closed=lambda gains: open_loop_of_model(model, gains, name=name).unstable_poles,
    )


def plant_of_system(plant: DelayStateSpace, *, wires: LoopSignals = SPEED_BY_THROTTLE, name: str = "system") -> ComparedPlant:
    """Take an exact linear model as a plant to be compared.

    Args:
        plant: from `linearize`, for example.
        wires: which signals are input and output.
        name: for people.

    Raises:
        InvalidInputError: the plant has no such signals, a root on the imaginary axis, or does not answer its input at rest.
        AnalysisError: channels feed one another so that roots to the right may be without number.
        NotConvergedError: the roots could not be counted.
    """
    drive, measured = position(plant.inputs, wires.drive), position(plant.outputs, wires.measurement)

    def transfer(s: ArrayLike) -> Complexes:
        return plant.transfer(s)[..., measured, drive]

    roots = characteristic_roots(plant)
    _refuse_axis_poles(roots.roots, name)
    if abs(complex(transfer(0.0))) <= NOTHING_AT_REST * abs(complex(transfer(1j))):
        message = f"{name} does not answer {wires.drive} at rest (a zero at s = 0): integral action would never settle"
        raise InvalidInputError(message, name=name)
    return ComparedPlant(
        name=name,
        transfer=transfer,
        delay=float(np.sum(plant.lags)),
        unstable_poles=roots.unstable_count,
        order_at_rest=0,
        excess=math.inf,
        leading=0.0,
        units=(plant.inputs[drive].unit, plant.outputs[measured].unit),
        unstable_closed=lambda gains: open_loop_of_system(plant, gains, wires=wires, name=name).unstable_poles,
    )


def _refuse_axis_poles(poles: Complexes, name: str) -> None:
    on_axis = poles[np.abs(poles.real) <= axis_widths(poles)]
    if on_axis.size:
        place = abs(float(on_axis[0].imag))
        message = (
            f"{name} has a pole on the imaginary axis at {place:g} rad/s: its response has no end there, and no distance is given; "
            "give it a little damping, or an integrator as a transfer function"
        )
        raise InvalidInputError(message, name=name, frequency=place)
