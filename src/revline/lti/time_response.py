"""Step and impulse responses of linear delay systems, the delays as they are: no approximation of a lag enters anywhere.

The record is computed twice, with polynomials of different degree on different pieces; the difference is the error that is told.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.lti.breakpoints import Breakpoints, find_breakpoints
from revline.lti.method_of_steps import Drive, Record, Scheme, march
from revline.lti.response import Floats
from revline.lti.state_space import DelayStateSpace, Signal, position
from revline.values import make_read_only

ROUGH, FINE = Scheme(degree=16, tail=1e-11), Scheme(degree=24, tail=1e-13)
"""The two ways in which a record is computed; the fine one is given."""

SMOOTHEST = 12
"""Jumps of higher derivatives are no ends of pieces; where one matters, pieces are halved about it."""

BEYOND = 1e-4
"""A record is followed this much beyond its last time, as a part of its length, so that a jump there has both its sides."""

ROUNDING = 1e-13
"""A jump smaller than this part of the output's terms is rounding."""

TOLERANCE = 1e-10


class OutputJump(NamedTuple):
    """A time at which outputs jump, with both sides: values of all outputs just before and just after."""

    time: float
    before: tuple[float, ...]
    after: tuple[float, ...]


class OutputImpulse(NamedTuple):
    """A time at which outputs hold an impulse, with the area for each output."""

    time: float
    areas: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeResponse:
    """How all outputs of a system at rest answer a unit step or a unit impulse on one input at time 0.

    Attributes:
        kind: "step" or "impulse".
        input: the signal that is moved.
        outputs: the signals that answer.
        times: in s, as asked for.
        values: of shape (times, outputs), in output units per input unit, of an impulse's answer per second; at a jump that which
            comes after, 0 before time 0.
        jumps: of outputs from time 0 to the last time, both sides.
        impulses: in the outputs, which `values` cannot show; none in a step's answer.
        errors: for each output, the largest difference between two computations with polynomials of other degree on other pieces.
        degree: of the polynomials.
        pieces: how many polynomials follow one another.
    """

    kind: Literal["step", "impulse"]
    input: Signal
    outputs: tuple[Signal, ...]
    times: Floats
    values: Floats
    jumps: tuple[OutputJump, ...]
    impulses: tuple[OutputImpulse, ...]
    errors: Floats
    degree: int
    pieces: int

    def __post_init__(self) -> None:
        make_read_only(self)

    def output(self, name: str) -> Floats:
        """Give one output at all times.

        Raises:
            InvalidInputError: there is no such output; the message lists those there are.
        """
        values: Floats = self.values[:, position(self.outputs, name)]
        return values


def sample_times(until: float, intervals: int) -> Floats:
    """Give even times from 0 on.

    Args:
        until: the last, in s.
        intervals: between them.

    Raises:
        InvalidInputError: the last is not above 0 or not finite.
    """
    if not 0.0 < until < math.inf:
        raise out_of_range("end of the record", until, "s", "0 to infinity, without the ends", "give a time above 0")
    return np.linspace(0.0, until, intervals + 1)


def step_response(system: DelayStateSpace, times: ArrayLike, *, input_name: str, tolerance: float = TOLERANCE) -> TimeResponse:
    """Find how all outputs answer a unit step on one input at time 0, the delays as they are.

    Args:
        system: linear system with delay channels, at rest before.
        times: in s, in any order.
        input_name: which input.
        tolerance: largest error accepted, relative to the largest sum of the terms of an output.

    Returns:
        The outputs, their jumps with both sides, and the estimated error.

    Raises:
        InvalidInputError: there is no such input, a time is not finite, the tolerance is not above zero, or the answer grew beyond the
            range of numbers or needs too many pieces.
        NotConvergedError: the error is above the tolerance, or there are too many jumps to follow.

    Source:
        Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapters 2 and 3.
    """
    return _respond(system, times, input_name, tolerance, "step")


def impulse_response(system: DelayStateSpace, times: ArrayLike, *, input_name: str, tolerance: float = TOLERANCE) -> TimeResponse:
    """Find how all outputs answer a unit impulse on one input at time 0; see `step_response`.

    What passes straight through, at once or late, arrives as an impulse again; those are listed as `impulses`.

    Args:
        system: linear system with delay channels, at rest before.
        times: in s, in any order.
        input_name: which input.
        tolerance: largest error accepted, relative to the largest sum of the terms of an output.

    Returns:
        The outputs without their impulses, these, and the estimated error.

    Raises:
        InvalidInputError: see `step_response`.
        NotConvergedError: see `step_response`.
    """
    return _respond(system, times, input_name, tolerance, "impulse")


def _respond(
    system: DelayStateSpace, times: ArrayLike, input_name: str, tolerance: float, kind: Literal["step", "impulse"]
) -> TimeResponse:
    column, grid = position(system.inputs, input_name), np.array(times, dtype=float)
    if grid.ndim != 1 or not grid.size or not np.all(np.isfinite(grid)):
        message = f"times of shape {grid.shape} cannot be used; give a list of finite times in s"
        raise InvalidInputError(message)
    if not 0.0 < tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "(relative)", "0 to 1, without the ends", "give a small one, such as 1e-10")
    last = max(float(np.max(grid)), 0.0)
    moving = _moving_part(system, column)
    breakpoints, drive = _prepare(moving, kind, (1.0 + BEYOND) * last)
    if last == 0.0:
        fine = _standstill(moving, drive)
        errors = np.finfo(float).eps * fine.largest
    else:
        rough, fine = (march(moving, drive, breakpoints, until=(1.0 + BEYOND) * last, scheme=scheme) for scheme in (ROUGH, FINE))
        errors = _difference(rough, fine, grid[grid >= 0.0])
    if np.any(errors > tolerance * fine.largest):
        worst = int(np.argmax(errors - tolerance * fine.largest))
        name, limit = system.outputs[worst].name, tolerance * fine.largest[worst]
        message = f"two computations of {name} differ by {errors[worst]:.3g} (limit {limit:.3g}) within {last:g} s; ask for earlier times"
        raise NotConvergedError(message + ", or a larger tolerance", error=float(errors[worst]), limit=float(limit))
    values = np.zeros((grid.size, len(system.outputs)))
    values[grid >= 0.0] = fine.at(grid[grid >= 0.0])
    return TimeResponse(
        kind=kind,
        input=system.inputs[column],
        outputs=system.outputs,
        times=grid,
        values=values,
        jumps=_jumps(fine, breakpoints, last),
        impulses=_impulses(moving, breakpoints, last) if kind == "impulse" else (),
        errors=errors,
        degree=FINE.degree,
        pieces=len(fine.outputs),
    )


def _moving_part(system: DelayStateSpace, column: int) -> DelayStateSpace:
    """Keep one input, and of states and channels those that it moves and that move an output: others cost pieces and tell nothing."""
    n, inputs = len(system.states), np.array([column])
    whole = np.block([[system.A, system.Bz], [system.Cz, system.Dzz]]) != 0.0
    reached = np.concatenate((system.Bu[:, column], system.Dzu[:, column])) != 0.0
    felt = np.any(np.concatenate((system.Cy, system.Dyz), axis=1) != 0.0, axis=0)
    for _ in range(len(whole)):
        reached = reached | np.any(whole & reached[None, :], axis=1)
        felt = felt | np.any(whole & felt[:, None], axis=0)
    kept = np.flatnonzero(reached & felt)
    x, z = kept[kept < n], kept[kept >= n] - n
    return DelayStateSpace(
        A=system.A[np.ix_(x, x)],
        Bu=system.Bu[np.ix_(x, inputs)],
        Bz=system.Bz[np.ix_(x, z)],
        Cy=system.Cy[:, x],
        Dyu=system.Dyu[:, [column]],
        Dyz=system.Dyz[:, z],
        Cz=system.Cz[np.ix_(z, x)],
        Dzu=system.Dzu[np.ix_(z, inputs)],
        Dzz=system.Dzz[np.ix_(z, z)],
        lags=system.lags[z],
        states=tuple(system.states[k] for k in x),
        inputs=(system.inputs[column],),
        outputs=system.outputs,
        channels=tuple(system.channels[k] for k in z),
    )


def _prepare(system: DelayStateSpace, kind: str, until: float) -> tuple[Breakpoints, Drive]:
    """Breakpoints, and what moves the system just after time 0."""
    by_state = np.where(np.any(system.Cz != 0.0, axis=1) & bool(np.any(system.Bu != 0.0)), 1.0, math.inf)
    entering = np.where(system.Dzu[:, 0] != 0.0, 0.0, by_state)
    step = kind == "step"
    drive = Drive(start=np.zeros(len(system.states)) if step else system.Bu[:, 0].copy(), constant=np.array([1.0 if step else 0.0]))
    found = find_breakpoints(
        system,
        entering if step else entering - 1.0,
        impulse=np.zeros(system.lags.size) if step else system.Dzu[:, 0],
        until=until,
        smoothest=SMOOTHEST,
    )
    return found, drive


def _standstill(system: DelayStateSpace, drive: Drive) -> Record:
    """What there is at time 0, where that alone is asked for."""
    values = system.Cy @ drive.start + system.Dyu @ drive.constant
    largest = np.abs(system.Cy) @ np.abs(drive.start) + np.abs(system.Dyu) @ np.abs(drive.constant)
    return Record(edges=np.array([0.0, 1.0]), outputs=np.broadcast_to(values, (1, 2, values.size)).copy(), largest=largest)


def _difference(rough: Record, fine: Record, times: Floats) -> Floats:
    """Largest difference of each output at the times asked for and in the middle of all pieces, rounding counted too."""
    checked = np.concatenate((times, 0.5 * (fine.edges[1:] + fine.edges[:-1])))
    largest: Floats = np.max(np.abs(rough.at(checked) - fine.at(checked)), axis=0)
    return np.maximum(largest, np.finfo(float).eps * fine.largest)


def _jumps(record: Record, breakpoints: Breakpoints, last: float) -> tuple[OutputJump, ...]:
    found = []
    limit = ROUNDING * record.largest
    times = np.concatenate(([0.0], breakpoints.times[(breakpoints.orders <= 0) & (breakpoints.times <= last * (1.0 + ROUNDING))]))
    for time in times:
        piece = int(np.searchsorted(record.edges, time))
        after = record.outputs[piece, 0]
        before = record.outputs[piece - 1, -1] if piece else np.zeros(after.size)
        if np.any(np.abs(after - before) > limit):
            found.append(OutputJump(float(time), tuple(before.tolist()), tuple(after.tolist())))
    return tuple(found)


def _impulses(system: DelayStateSpace, breakpoints: Breakpoints, last: float) -> tuple[OutputImpulse, ...]:
    within = breakpoints.times <= last * (1.0 + ROUNDING)
    areas = np.concatenate((system.Dyu[:, 0][None, :], breakpoints.kicks[within] @ system.Dyz.T))
    times = np.concatenate(([0.0], breakpoints.times[within]))
    return tuple(OutputImpulse(float(t), tuple(a.tolist())) for t, a in zip(times, areas, strict=True) if np.any(a != 0.0))
