"""The compiled kernel: an explicit Runge-Kutta mesh that meets every breakpoint, also those that travel through the lags.

`build_kernel` specialises it to a system's equations. Compiled code is kept on disk under a digest of all it computes with.
In all functions `p` are the parameters, `s` is the run's state.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapters 3 and 4.
"""

import functools
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from types import ModuleType
from typing import Any

import numba
import numpy as np
from numba.extending import register_jitable
from numba.np.unsafe.ndarray import to_fixed_tuple

from revline.dde import events, stepping
from revline.dde.history import begin_segment, pass_smooth_boundaries, push_node, read_cubic, read_linear
from revline.dde.run import DONE, NEEDS_ROOM, Floats, Record
from revline.dde.tableau import RK4, Tableau
from revline.dde.tables import samples_of
from revline.equations import Equation, equation_digest, reached_functions
from revline.signals import NEVER
from revline.system import DelaySystem

Kernel = Callable[[Any, Any], int]
Part = Callable[..., Any]


class Interpolant(Enum):
    """How a channel is read between its nodes."""

    CUBIC = "cubic"
    LINEAR = "linear"


class Propagation(Enum):
    """Whether the mesh meets the breakpoints that travel through the lags; not doing so is the order tests' negative control."""

    THROUGH_LAGS = "through lags"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Method:
    """What integrates: the Runge-Kutta method, how history is read, and what happens to breakpoints."""

    tableau: Tableau = RK4
    interpolant: Interpolant = Interpolant.CUBIC
    propagation: Propagation = Propagation.THROUGH_LAGS


STANDARD = Method()
"""Fourth order throughout."""


@dataclass(frozen=True, slots=True)
class Specialisation:
    """What a kernel is compiled for; two with the same equations, sizes and method are the same."""

    digest: str
    sizes: tuple[int, int, int, int]
    method: Method
    chained: bool
    equations: tuple[Equation, Equation, Equation, Equation] = field(compare=False, repr=False)


def build_kernel(system: DelaySystem, method: Method = STANDARD) -> Kernel:
    """Specialise the kernel to a system's equations; parameters, inputs and states are its arguments.

    Args:
        system: whose emit, lags, rate and output are compiled in.
        method: what integrates.

    Returns:
        A compiled function of parameters, and state (an array of one record); it advances the run and returns a status.
    """
    sizes = (len(system.states), len(system.inputs), len(system.channels), len(system.outputs))
    chained = any(name.startswith("zd") for sources in system.structure.lags for name in sources)
    return _build(Specialisation(system.equation_digest, sizes, method, chained, (system.emit, system.lags, system.rate, system.output)))


@functools.cache
def _build(special: Specialisation) -> Kernel:
    begin, step_once = _make_parts(special)
    for function in reached_functions(begin, step_once):
        _register(function)
    parts = ModuleType(f"{__name__}.of_{equation_digest(begin, step_once)}")
    parts.begin, parts.step_once = begin, step_once  # type: ignore[attr-defined]  # a module of our own making
    sys.modules[parts.__name__] = parts
    compiled: Kernel = numba.njit(cache=True, nogil=True, error_model="numpy")(_make_advance(parts))
    return compiled


@functools.cache
def _register(function: Part) -> Part:
    """Let compiled code call a plain function; once per function."""
    registered: Part = register_jitable(function)
    return registered


def _make_advance(parts: ModuleType) -> Kernel:
    """Close over the parts as a module named by their digest: that name is the kernel's place in the cache on disk."""

    def advance(p: Any, state: Any) -> int:
        s = state[0]
        if s.newest_segment == 0:
            parts.begin(p, s)
        status = DONE
        while status == DONE and s.grid_index < s.grid_target:
            status = parts.step_once(p, s)
        return status

    return advance


def _make_parts(special: Specialisation) -> tuple[Part, Part]:
    read_channels, emit_into, store = _make_evaluators(special)
    try_step = _make_try_step(special, read_channels)
    accept, break_here = _make_landing(special, read_channels, emit_into)
    locate = _make_locate(special, try_step)
    channels = special.sizes[2]

    def begin(p: Any, s: Record) -> None:
        break_here(p, s, True)  # noqa: FBT003 - compiled: no keywords
        store(p, s)

    def march(p: Any, s: Record, stop: float) -> int:
        status = DONE
        pieces = stepping.pieces_to(s)
        while status == DONE and pieces > 0:
            end = stepping.piece_end(s.time, stop, pieces)
            try_step(p, s, end)
            status = accept(p, s, end, pieces == 1)
            pieces -= 1
        return status

    def step_once(p: Any, s: Record) -> int:
        if stepping.lacks_room(s):
            return NEEDS_ROOM
        grid_end = events.grid_end(s)
        stop = events.next_stop(s)
        end = stepping.piece_end(s.time, stop, stepping.pieces_to(s))
        try_step(p, s, end)
        status = DONE
        meets = events.is_input_break(s, end)
        if events.crossing_ahead(s, channels):
            meets = True
            end = locate(p, s, end)
            if abs(end - grid_end) < events.TOLERANCE * s.step:
                end = grid_end
            if end - s.time > events.TOLERANCE * s.step:
                status = march(p, s, end)
        else:
            status = accept(p, s, end, meets)
        if status == DONE and meets:
            break_here(p, s, False)  # noqa: FBT003 - compiled: no keywords
        if status == DONE and s.time == grid_end:
            s.grid_index += 1
            store(p, s)
        return status

    return begin, step_once


def _make_locate(special: Specialisation, try_step: Part) -> Part:
    channels = special.sizes[2]

    def cross(p: Any, s: Record, channel: int, end: float) -> float:
        low, high = s.time, end
        low_excess = events.excess(s, channel, s.read_time[channel])
        high_excess = events.excess(s, channel, s.read_time_new[channel])
        if low_excess >= 0.0:
            return low
        for k in range(100):
            if high - low <= 1e-13 * s.step or high_excess == 0.0:
                break
            middle = 0.5 * (low + high) if k % 3 == 2 else events.next_estimate(low, low_excess, high, high_excess)
            try_step(p, s, middle)
            middle_excess = events.excess(s, channel, s.read_time_new[channel])
            if middle_excess < 0.0:
                low, low_excess = middle, middle_excess
            else:
                high, high_excess = middle, middle_excess
        return high

    def locate(p: Any, s: Record, end: float) -> float:
        first = end
        for channel in range(channels):
            beyond = events.excess(s, channel, s.read_time_new[channel])
            if first > s.time and beyond > events.TOLERANCE * s.step:
                first = cross(p, s, channel, first)
                if first > s.time:
                    try_step(p, s, first)
        return first

    return locate


def _make_landing(special: Specialisation, read_channels: Part, emit_into: Part) -> tuple[Part, Part]:
    propagates = special.method.propagation is Propagation.THROUGH_LAGS
    states, _, channels, _ = special.sizes

    def accept(p: Any, s: Record, end: float, ends_segment: bool) -> int:  # noqa: FBT001 - compiled: no keywords
        status = stepping.check_states(s, states)
        if status == DONE:
            status = stepping.check_lags(s, end, channels)
        if status == DONE:
            stepping.adopt_step(s, end)
            emit_into(p, s)
            push_node(s, ends_segment)
            for channel in range(channels):
                pass_smooth_boundaries(s, channel)
        return status

    def break_here(p: Any, s: Record, is_start: bool) -> None:  # noqa: FBT001 - compiled: no keywords
        events.take_input_orders(s)
        events.take_reading_orders(s, channels)
        if is_start:
            for k in range(s.input_orders.shape[0]):
                s.input_orders[k] = 0
        events.spread_orders(s, channels)
        if not propagates:
            for k in range(s.emitted_orders.shape[0]):
                s.emitted_orders[k] = NEVER
        following = min(events.next_break(s), s.time + s.step)
        events.set_inputs(s, s.time, 0.5 * (s.time + following))
        s.inputs_known = 1
        read_channels(p, s, s.x, s.time, s.zd, s.read_time)
        emit_into(p, s)
        if is_start or events.must_be_met(s, channels):
            begin_segment(s)

    return accept, break_here


def _make_try_step(special: Specialisation, read_channels: Part) -> Part:
    _, _, rate, _ = special.equations
    n_states, n_inputs, n_channels, _ = special.sizes
    pack_x, pack_u, pack_z = _make_pack(n_states), _make_pack(n_inputs), _make_pack(n_channels)
    unpack_x = _make_unpack(n_states)
    tableau = special.method.tableau
    stages = len(tableau.nodes)
    nodes, coupling, weights = np.array(tableau.nodes), np.array(tableau.coupling), np.array(tableau.weights)

    def combine(s: Record, factors: Floats, count: int, length: float, target: Floats) -> None:
        for i in range(n_states):
            total = 0.0
            for j in range(count):
                total += factors[j] * s.rates[j, i]
            target[i] = s.x[i] + length * total

    def try_step(p: Any, s: Record, end: float) -> None:
        length = end - s.time
        reference = s.time + 0.5 * length
        if s.inputs_known == 0:
            events.set_inputs(s, s.time, reference)
        unpack_x(rate(p, pack_x(s.x), pack_u(s.u), pack_z(s.zd)), s.rates[0])
        for k in range(1, stages):
            combine(s, coupling[k], k, length, s.x_stage)
            time = s.time + nodes[k] * length
            if nodes[k] != nodes[k - 1]:
                events.set_inputs(s, time, reference)
            read_channels(p, s, s.x_stage, time, s.zd_stage, s.read_time_stage)
            unpack_x(rate(p, pack_x(s.x_stage), pack_u(s.u), pack_z(s.zd_stage)), s.rates[k])
        combine(s, weights, stages, length, s.x_new)
        if nodes[stages - 1] != 1.0:
            events.set_inputs(s, end, reference)
        read_channels(p, s, s.x_new, end, s.zd_new, s.read_time_new)
        s.inputs_known = 0

    return try_step


def _make_evaluators(special: Specialisation) -> tuple[Part, Part, Part]:
    emit, lags, _, output = special.equations
    n_states, n_inputs, n_channels, n_outputs = special.sizes
    pack_x, pack_u, pack_z = _make_pack(n_states), _make_pack(n_inputs), _make_pack(n_channels)
    unpack_z, unpack_y = _make_unpack(n_channels), _make_unpack(n_outputs)
    read = read_cubic if special.method.interpolant is Interpolant.CUBIC else read_linear

    def read_nothing(p: Any, s: Record, x: Floats, time: float, zd: Floats, read_time: Floats) -> None:
        pass

    def read_in_order(p: Any, s: Record, x: Floats, time: float, zd: Floats, read_time: Floats) -> None:
        for channel in range(n_channels):  # a lag may depend on an earlier channel's reading
            read_time[channel] = time - lags(p, pack_x(x), pack_u(s.u), pack_z(zd))[channel]
            zd[channel] = read(s, channel, read_time[channel])

    def emit_into(p: Any, s: Record) -> None:
        unpack_z(emit(p, pack_x(s.x), pack_u(s.u), pack_z(s.zd)), s.z)

    def store(p: Any, s: Record) -> None:
        if s.grid_index % s.store_every == 0:
            row = samples_of(s)[s.stored]
            row[0] = s.time
            for k in range(n_states):
                row[1 + k] = s.x[k]
            for k in range(n_inputs):
                row[1 + n_states + k] = s.u[k]
            unpack_y(output(p, pack_x(s.x), pack_u(s.u), pack_z(s.zd)), row[1 + n_states + n_inputs :])
            s.stored += 1

    def read_at_once(p: Any, s: Record, x: Floats, time: float, zd: Floats, read_time: Floats) -> None:
        lag = lags(p, pack_x(x), pack_u(s.u), pack_z(zd))
        for channel in range(n_channels):
            read_time[channel] = time - lag[channel]
            zd[channel] = read(s, channel, read_time[channel])

    read_some = read_in_order if special.chained else read_at_once
    return (read_nothing if n_channels == 0 else read_some), emit_into, store


def _make_pack(size: int) -> Part:
    """Make a function from an array to a tuple of a length that the compiler knows."""
    if size == 0:
        return lambda _: ()
    return lambda array: to_fixed_tuple(array, size)


def _make_unpack(size: int) -> Part:
    """Make a function that copies a tuple of a known length into an array."""

    def nothing(_: Any, __: Any) -> None:
        pass

    def copy(values: Any, target: Any) -> None:
        for k in range(size):
            target[k] = values[k]

    return nothing if size == 0 else copy
