"""The loop of a plant and a PID controller, broken at what the controller drives, every delay exact.

Source: Astrom and Hagglund (2006), Advanced PID Control, section 4.2.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.controllers.pid_controller import AnyPid, PidController, continuous_law
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.stability.loop_stability import HighFrequencyUnstableLoop, LoopStability, UnstableLoop, judge_loop_stability
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.interconnection import feed_back, select
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace, Signal, position
from revline.lti.transfer_function import TransferFunction
from revline.lti.transfer_values import transfer_values

Complexes = NDArray[np.complex128]
Transfer = Callable[[ArrayLike], Complexes]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenLoop:
    """A loop broken at one place: negative feedback closes it.

    Attributes:
        name: of plant and controller, for people.
        transfer: L on complex s of any shape, delays exact.
        delay: that L contains for certain, in s; its phase is unwrapped after removing it.
        unstable_poles: of the closed loop, right of the imaginary axis; infinite where the delay makes them so.
        closed_roots: the right-most ones of the closed loop, in rad/s, where they were found to count the unstable ones; else none.
    """

    name: str
    transfer: Transfer
    delay: float
    unstable_poles: float
    closed_roots: tuple[complex, ...] = ()

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable."""
        return self.unstable_poles == 0


def open_loop_of_model(plant: TransferFunction, law: AnyPid, *, name: str = "model") -> OpenLoop:
    """Break the loop of a transfer function with delay and a controller.

    Raises:
        InvalidInputError: plant and controller do not make a well-posed loop, or the controller samples.
        NotConvergedError: a closed-loop pole lies on the imaginary axis, or too near to tell.
    """
    controller = continuous_law(law)
    unstable = _count(judge_loop_stability(plant, law))

    def transfer(s: ArrayLike) -> Complexes:
        points = np.asarray(s, dtype=complex)
        return np.asarray(plant(points) * controller.feedback_transfer(points))

    return OpenLoop(name=f"{name} under {controller.gains.rule}", transfer=transfer, delay=plant.delay, unstable_poles=unstable)


def _count(verdict: LoopStability) -> float:
    if isinstance(verdict, HighFrequencyUnstableLoop):
        return math.inf
    return float(verdict.unstable_poles) if isinstance(verdict, UnstableLoop) else 0.0


def open_loop_of_system(plant: DelayStateSpace, law: AnyPid, *, wires: LoopSignals = SPEED_BY_THROTTLE, name: str = "system") -> OpenLoop:
    """Break the loop of an exact linear model and a controller.

    An ideal derivative is taken from the plant's own rate output, a filtered one from the measurement.

    Args:
        plant: from `linearize`, for example.
        law: gains alone, or a continuous controller.
        wires: which signals close the loop.
        name: for people.

    Raises:
        InvalidInputError: the plant has no such signals, the controller samples, or the loop is algebraic and has no solution.
        AnalysisError: channels feed one another so that roots to the right may be without number.
        NotConvergedError: the roots of the closed loop could not be counted.
    """
    controller = continuous_law(law)
    gains = controller.gains
    drive, measured = position(plant.inputs, wires.drive), position(plant.outputs, wires.measurement)
    needed = [measured]
    if gains.kd != 0.0 and controller.filter_time == 0.0:
        needed.append(position(plant.outputs, wires.measurement_rate))
    for signal, unit in ((plant.inputs[drive], gains.output_unit), (plant.outputs[measured], gains.input_unit)):
        if signal.unit != unit:
            message = f"{signal.name} is in {signal.unit} and the controller's gains are for {unit}; convert the gains"
            raise InvalidInputError(message, signal=signal.name, unit=unit)
    of_measurement = gains.setpoint_transfer if len(needed) == 2 else controller.feedback_transfer
    weights = (of_measurement, lambda s: gains.kd * np.ones_like(s))

    answers = transfer_values(select(plant, [drive], needed))

    def transfer(s: ArrayLike) -> Complexes:
        points = np.asarray(s, dtype=complex)
        values = answers(points)
        return np.asarray(sum(values[k] * weights[k](points) for k in range(len(needed))))

    closed = characteristic_roots(_close(plant, controller, drive, needed))
    return OpenLoop(
        name=f"{name} under {gains.rule}",
        transfer=transfer,
        delay=_known_delay(plant, transfer) if any((gains.kp, gains.ki, gains.kd)) else 0.0,
        unstable_poles=float(closed.unstable_count),
        closed_roots=tuple(closed.roots.tolist()),
    )


def _close(plant: DelayStateSpace, controller: PidController, drive: int, needed: list[int]) -> DelayStateSpace:
    """Close the loop, the controller's integral and filter as states more where they feed back."""
    gains, system, gain = controller.gains, plant, controller.gains.kp
    fed: list[tuple[int, float]] = [(row, gains.kd) for row in needed[1:]]
    if controller.filter_time > 0.0 and gains.kd != 0.0:  # kd s/(Tf s + 1) y = kd/Tf (y - x), Tf dx/dt = y - x
        share = 1.0 / controller.filter_time
        system = _with_state(system, needed[0], rate=share, decay=share, name="filtered")
        gain += gains.kd * share
        fed.append((len(system.outputs) - 1, -gains.kd * share))
    if gains.ki != 0.0:
        system = _with_state(system, needed[0], rate=1.0, decay=0.0, name="integral_of")
        fed.append((len(system.outputs) - 1, gains.ki))
    feedback = np.zeros((len(system.inputs), len(system.outputs)))
    feedback[drive, needed[0]] = -gain
    for row, weight in fed:
        feedback[drive, row] = -weight
    return feed_back(system, feedback)


def _with_state(plant: DelayStateSpace, row: int, *, rate: float, decay: float, name: str) -> DelayStateSpace:
    """Add a state x with dx/dt = rate y - decay x, y being an output, and x as the last output."""
    n, m = len(plant.states), len(plant.channels)
    unit = plant.outputs[row].unit
    added = Signal(f"{name}_{plant.outputs[row].name}", unit if decay else f"{unit} s")
    return DelayStateSpace(
        A=np.block([[plant.A, np.zeros((n, 1))], [rate * plant.Cy[[row]], np.full((1, 1), -decay)]]),
        Bu=np.concatenate((plant.Bu, rate * plant.Dyu[[row]])),
        Bz=np.concatenate((plant.Bz, rate * plant.Dyz[[row]])),
        Cy=np.block([[plant.Cy, np.zeros((len(plant.outputs), 1))], [np.zeros((1, n)), np.ones((1, 1))]]),
        Dyu=np.concatenate((plant.Dyu, np.zeros((1, len(plant.inputs))))),
        Dyz=np.concatenate((plant.Dyz, np.zeros((1, m)))),
        Cz=np.concatenate((plant.Cz, np.zeros((m, 1))), axis=1),
        Dzu=plant.Dzu,
        Dzz=plant.Dzz,
        lags=plant.lags,
        states=(*plant.states, added),
        inputs=plant.inputs,
        outputs=(*plant.outputs, added),
        channels=plant.channels,
    )


def _known_delay(plant: DelayStateSpace, transfer: Transfer) -> float:
    """The sum of lags that the loop's phase turns by at high frequency, among those of any one or all of the channels."""
    fastest = float(np.max(np.abs(np.linalg.eigvals(plant.A)), initial=1.0))
    shortest = float(np.min(plant.lags, initial=1.0))
    omega = 300.0 * fastest + np.linspace(0.0, 1.0, 64) / shortest
    values = transfer(1j * omega)
    if not np.all(np.isfinite(values)) or np.any(values == 0.0):
        message = "the loop has no phase at high frequency; check that the plant answers what the controller drives"
        raise AnalysisError(message)
    slope = -float(np.polyfit(omega, np.unwrap(np.angle(values)), 1)[0])
    candidates = np.array([0.0, *plant.lags, np.sum(plant.lags)])
    return float(candidates[np.argmin(np.abs(candidates - slope))])
