"""Plants under all PI controllers with one derivative gain, from transfer functions and from exact linear models."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.controller import PidGains
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.regions.gain_curve import AXIS, Contour, Inverse, LoopFamily
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model, open_loop_of_system
from revline.errors import InvalidInputError
from revline.lti.interconnection import feed_back, select, to_state_space
from revline.lti.roots import RightmostRoots, characteristic_roots
from revline.lti.state_space import DelayStateSpace, position
from revline.lti.transfer_function import TransferFunction
from revline.lti.transfer_values import TransferValues, transfer_values

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

NEAR_REST = 1e-9
"""An integrating plant has a root at the origin without control; its roots are counted at this part of the gain of 1/P at 1 rad/s."""


MOST_ROOTS = 400
"""Most roots that are listed to count those right of a contour."""


@dataclass(frozen=True, slots=True, eq=False)
class _OfModel:
    """1/P of a transfer function: a value, so that what holds it can be kept, and sent to another process."""

    plant: TransferFunction

    def __call__(self, s: Complexes) -> Complexes:
        return np.asarray(1.0 / self.plant(s))


@dataclass(frozen=True, slots=True, eq=False)
class _OfSystem:
    """The same of a system with one input and one output."""

    answers: TransferValues

    def __call__(self, s: Complexes) -> Complexes:
        return np.asarray(1.0 / self.answers(s)[0])


def family_of_model(plant: TransferFunction, *, kd: float = 0.0, name: str = "model", contour: Contour = AXIS) -> LoopFamily:
    """Take a transfer function with delay.

    Args:
        plant: proper, with or without delay.
        kd: derivative gain.
        name: of the plant.
        contour: the line that roots are counted right of.

    Raises:
        InvalidInputError: the plant does not answer at rest, the loop with that derivative is not well-posed, or infinitely many roots lie
            right of the contour.
        NotConvergedError: a root lies on the imaginary axis without control, so that none can be counted there.
    """
    if plant.numerator[0] == 0.0:
        raise _no_answer_at_rest(name)

    inverse = _OfModel(plant)
    at_rest = plant.denominator[0] / plant.numerator[0]
    base = _base(inverse, at_rest)
    if contour.damping == 0.0:
        counted = open_loop_of_model(plant, _gains(base, kd, plant.input_unit, plant.output_unit))
        outside = _finite(counted, name, kd)
    else:
        _refuse_endless_ray(contour, plant.delay > 0.0, name)
        outside = _count_right(_loop_without_integral(plant, base, kd), contour, name, kd)
    unit = f"{plant.input_unit}/({plant.output_unit})"
    marks = (*plant.poles, *plant.zeros)
    return LoopFamily(
        name=name,
        inverse=inverse,
        at_rest=at_rest,
        kd=kd,
        base=base,
        unstable=outside,
        gain_unit=unit,
        contour=contour,
        landmarks=_frequencies(np.array(marks, dtype=complex)),
    )


def family_of_system(
    plant: DelayStateSpace,
    *,
    kd: float = 0.0,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    name: str = "system",
    contour: Contour = AXIS,
    roots: RightmostRoots | None = None,
) -> LoopFamily:
    """Take an exact linear model; the derivative acts on its own rate output.

    Args:
        plant: from `linearize`, for example.
        kd: derivative gain.
        wires: which signals close the loop.
        name: of the plant.
        contour: the line that roots are counted right of.
        roots: of the plant, from its trim for example, lest they be found again.

    Raises:
        InvalidInputError: the plant has no such signals, does not answer at rest, or infinitely many roots lie right of the contour.
        AnalysisError: the plant integrates, or channels feed one another so that roots may be without number.
        NotConvergedError: the roots without control could not be counted.
    """
    row, column = position(plant.outputs, wires.measurement), position(plant.inputs, wires.drive)
    gain = plant.static_gain(wires.drive, wires.measurement)
    if gain == 0.0:
        raise _no_answer_at_rest(name)
    units = plant.inputs[column].unit, plant.outputs[row].unit
    own = roots or characteristic_roots(plant)
    if contour.damping == 0.0 and kd == 0.0:
        outside = own.unstable_count
    elif contour.damping == 0.0:
        outside = _finite(open_loop_of_system(plant, _gains(0.0, kd, *units), wires=wires), name, kd)
    else:
        _refuse_endless_ray(contour, bool(plant.lags.size), name)
        outside = _count_right(_with_derivative(plant, kd, wires), contour, name, kd)
    return LoopFamily(
        name=name,
        inverse=_OfSystem(transfer_values(select(plant, [column], [row]))),
        at_rest=1.0 / gain,
        kd=kd,
        base=0.0,
        unstable=outside,
        gain_unit=f"{units[0]}/({units[1]})",
        contour=contour,
        landmarks=_frequencies(own.roots),
    )


def _frequencies(roots: Complexes) -> tuple[float, ...]:
    """Where on the axis roots near it are felt: at their height and as far to both sides as they are away."""
    upper = roots[roots.imag > 0.0]
    spread = np.abs(upper.real)
    return tuple(float(w) for w in np.concatenate((upper.imag - spread, upper.imag, upper.imag + spread)) if w > 0.0)


def _loop_without_integral(plant: TransferFunction, kp: float, kd: float) -> DelayStateSpace:
    """The closed loop of a plant under kp + kd s."""
    over = np.convolve(plant.numerator, (kp, kd)) if kd != 0.0 else kp * np.array(plant.numerator)
    loop = TransferFunction(numerator=tuple(float(c) for c in over), denominator=plant.denominator, delay=plant.delay)
    return feed_back(to_state_space(loop), [[-1.0]])


def _with_derivative(plant: DelayStateSpace, kd: float, wires: LoopSignals) -> DelayStateSpace:
    if kd == 0.0:
        return plant
    feedback = np.zeros((len(plant.inputs), len(plant.outputs)))
    feedback[position(plant.inputs, wires.drive), position(plant.outputs, wires.measurement_rate)] = -kd
    return feed_back(plant, feedback)


def _count_right(closed: DelayStateSpace, contour: Contour, name: str, kd: float) -> int:
    """Count the roots right of a contour among the right-most, of which enough are listed to reach past it."""
    count = 8
    while count <= MOST_ROOTS:
        roots = characteristic_roots(closed, count=count).roots
        if roots.size < count or roots[-1].real < -contour.decay:
            return int(np.sum(contour.is_right(roots)))
        count *= 2
    message = (
        f"more than {MOST_ROOTS} roots of {name} with kd = {kd:g} decay slower than {contour.decay:g} 1/s, the decay asked for at "
        f"{contour.up_to:g} rad/s; ask for less damping, or up to a lower frequency"
    )
    raise InvalidInputError(message, kd=kd, decay=contour.decay)


def _refuse_endless_ray(contour: Contour, delayed: bool, name: str) -> None:  # noqa: FBT001 - a fact, not a mode
    if delayed and not np.isfinite(contour.up_to):
        message = (
            f"a damping of {contour.damping:g} at every frequency is out of reach for {name}: its delay leaves roots whose damping ratio "
            "goes to 0 while they decay ever faster; say up to which natural frequency roots must be damped"
        )
        raise InvalidInputError(message, damping=contour.damping)


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
