"""Plants under all PI controllers with one derivative gain, from transfer functions and from exact linear models."""

import numpy as np
from numpy.typing import NDArray

from revline.design.closed_loop import SPEED_BY_THROTTLE, LoopSignals
from revline.design.controller import PidGains
from revline.design.gain_region import Inverse, LoopFamily
from revline.design.open_loop import OpenLoop, open_loop_of_model, open_loop_of_system
from revline.errors import InvalidInputError
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace, position
from revline.lti.transfer_function import TransferFunction

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

NEAR_REST = 1e-9
"""An integrating plant has a root at the origin without control; its roots are counted at this part of the gain of 1/P at 1 rad/s."""


def family_of_model(plant: TransferFunction, *, kd: float = 0.0, name: str = "model") -> LoopFamily:
    """Take a transfer function with delay.

    Args:
        plant: proper, with or without delay.
        kd: derivative gain.
        name: of the plant.

    Raises:
        InvalidInputError: the plant does not answer at rest, or the loop with that derivative is not well-posed.
        NotConvergedError: a root lies on the imaginary axis without control, so that none can be counted there.
    """
    if plant.numerator[0] == 0.0:
        raise _no_answer_at_rest(name)

    def inverse(omega: Floats) -> Complexes:
        return np.asarray(1.0 / plant(1j * omega))

    at_rest = plant.denominator[0] / plant.numerator[0]
    base = _base(inverse, at_rest)
    counted = open_loop_of_model(plant, _gains(base, kd, plant.input_unit, plant.output_unit))
    unit = f"{plant.input_unit}/({plant.output_unit})"
    return LoopFamily(name=name, inverse=inverse, at_rest=at_rest, kd=kd, base=base, unstable=_finite(counted, name, kd), gain_unit=unit)


def family_of_system(
    plant: DelayStateSpace, *, kd: float = 0.0, wires: LoopSignals = SPEED_BY_THROTTLE, name: str = "system"
) -> LoopFamily:
    """Take an exact linear model; the derivative acts on its own rate output.

    Args:
        plant: from `linearize`, for example.
        kd: derivative gain.
        wires: which signals close the loop.
        name: of the plant.

    Raises:
        InvalidInputError: the plant has no such signals, or does not answer at rest.
        AnalysisError: the plant integrates, or channels feed one another so that roots may be without number.
        NotConvergedError: the roots without control could not be counted.
    """
    row, column = position(plant.outputs, wires.measurement), position(plant.inputs, wires.drive)
    gain = plant.static_gain(wires.drive, wires.measurement)
    if gain == 0.0:
        raise _no_answer_at_rest(name)

    def inverse(omega: Floats) -> Complexes:
        return np.asarray(1.0 / plant.transfer(1j * omega)[..., row, column])

    units = plant.inputs[column].unit, plant.outputs[row].unit
    if kd == 0.0:
        unstable = characteristic_roots(plant).unstable_count
    else:
        unstable = _finite(open_loop_of_system(plant, _gains(0.0, kd, *units), wires=wires), name, kd)
    return LoopFamily(
        name=name,
        inverse=inverse,
        at_rest=1.0 / gain,
        kd=kd,
        base=0.0,
        unstable=unstable,
        gain_unit=f"{units[0]}/({units[1]})",
    )


def _base(inverse: Inverse, at_rest: float) -> float:
    if at_rest != 0.0:
        return 0.0
    return NEAR_REST * float(np.abs(inverse(np.array([1.0])))[0])


def _gains(kp: float, kd: float, drive: str, measured: str) -> PidGains:
    return PidGains(kp=kp, ki=0.0, kd=kd, input_unit=measured, output_unit=drive, rule="none", designed_on="none")


def _finite(counted: OpenLoop, name: str, kd: float) -> int:
    if not np.isfinite(counted.unstable_poles):
        message = f"kd = {kd:g} makes infinitely many roots of {name} unstable, whatever kp and ki are; lower it, or filter the derivative"
        raise InvalidInputError(message, kd=kd)
    return round(counted.unstable_poles)


def _no_answer_at_rest(name: str) -> InvalidInputError:
    message = f"{name} does not answer at rest (a zero at s = 0), so that integral action has nothing to hold; control another signal"
    return InvalidInputError(message)
