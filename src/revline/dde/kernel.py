"""The compiled kernel: an explicit Runge-Kutta mesh that meets every breakpoint, also those that travel through the lags.

`build_kernel` specialises it to a system's equations. In all functions `s` is the run's state; parameters are read from where it says.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapters 3 and 4.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from revline.dde import events, sampling, stepping
from revline.dde.compiling import Layout, compile_kernel
from revline.dde.history import SMOOTH, begin_segment, read_cubic, read_linear
from revline.dde.memory import load_tuple, loader_of, parameter_type, samples_of, store_tuple
from revline.dde.run import AT_BREAK, DONE, NEEDS_ROOM, REFUSED, Floats, Record, state_type
from revline.dde.sampling import Sampler, no_event, sampler_of
from revline.dde.tableau import RK4, Tableau
from revline.equations import Equation
from revline.sampled import SampledController
from revline.system import DelaySystem

Kernel = Callable[[Any], int]
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
    """What a kernel is compiled for; two with the same equations, sizes, parameter types and method are the same."""

    digest: str
    sizes: tuple[int, int, int, int]
    layout: Layout
    method: Method
    chained: bool
    equations: tuple[Equation, Equation, Equation, Equation] = field(compare=False, repr=False)
    sampler: Sampler | None = None


def build_kernel(system: DelaySystem, method: Method = STANDARD, controller: SampledController | None = None) -> Kernel:
    """Specialise the kernel to a system's equations; parameters, inputs and states are read from the run's state.

    Args:
        system: whose emit, lags, rate and output are compiled in.
        method: what integrates.
        controller: whose update is compiled in too, where one is sampled.

    Returns:
        A compiled function of a state (an array of one record); it advances the run and returns a status.
    """
    return specialise(specialisation_of(system, method, controller))


def specialisation_of(system: DelaySystem, method: Method = STANDARD, controller: SampledController | None = None) -> Specialisation:
    """Tell which kernel a system needs."""
    sampler = None if controller is None else sampler_of(controller)
    return Specialisation(
        digest=system.equation_digest,
        sizes=(len(system.states), len(system.inputs), len(system.channels), len(system.outputs)),
        layout=Layout(state_type(system), parameter_type(system.parameters), None if sampler is None else sampler.parameters),
        method=method,
        chained=any(name.startswith("zd") for sources in system.structure.lags for name in sources),
        equations=(system.emit, system.lags, system.rate, system.output),
        sampler=sampler,
    )


@functools.cache
def specialise(special: Specialisation) -> Kernel:
    """Build the kernel of a specialisation, once per process."""
    load_parameters = loader_of(special.layout.parameters)
    read_channels = _make_read_channels(special, load_parameters)
    parts = {
        "read_channels": read_channels,
        "try_step": _make_try_step(special, load_parameters, read_channels),
        "emit_now": _make_emit_now(special, load_parameters),
        "store": _make_store(special, load_parameters),
        "aim": sampling.aim if special.sampler else no_event,
        "missed": sampling.missed if special.sampler else no_event,
        "sample": _make_sample(special, special.sampler, load_parameters) if special.sampler else no_event,
    }
    equations = special.equations if special.sampler is None else (*special.equations, special.sampler.update)
    return compile_kernel(functools.partial(_make_advance, special), parts, equations, special.layout)


def _make_advance(special: Specialisation, parts: Any) -> Kernel:
    states, _, channels, _ = special.sizes
    smooth = SMOOTH if special.method.propagation is Propagation.THROUGH_LAGS else 0

    def advance(state: Any) -> int:
        """Advance a run to its target on the grid; `state` is an array of its one record."""
        s = state[0]
        while s.grid_index <= s.grid_target:
            if stepping.lacks_room(s):
                return NEEDS_ROOM
            parts.aim(s)
            events.choose_step(s)
            searching = True
            while searching:
                parts.try_step(s)
                searching = events.seek_breakpoint(s, channels) or parts.missed(s)
            if not stepping.adopt_step(s, states, channels):
                return REFUSED
            parts.emit_now(s)
            stepping.keep_emitted(s, channels)
            if s.place == AT_BREAK:
                parts.sample(s)
                rough = stepping.pass_breakpoints(s, states, channels, smooth)
                parts.read_channels(s, s.time)
                if not stepping.adopt_readings(s, channels):
                    return REFUSED
                parts.emit_now(s)
                if rough:
                    begin_segment(s, channels)
            if s.time == s.grid_time and s.landing > s.time:
                parts.store(s)
                stepping.pass_grid_point(s)
        return DONE

    return advance


def _make_read_channels(special: Specialisation, load_parameters: Part) -> Part:
    _, lags, _, _ = special.equations
    n_states, n_inputs, n_channels, _ = special.sizes
    read = read_cubic if special.method.interpolant is Interpolant.CUBIC else read_linear
    rounds = n_channels if special.chained else min(n_channels, 1)  # a lag may depend on an earlier channel's reading

    def read_channels(s: Record, time: float) -> None:
        """Read all channels for the states and inputs of the tried step."""
        p = load_parameters(s)
        x, u = load_tuple(s.x_next, n_states), load_tuple(s.u, n_inputs)
        for first in range(rounds):
            lag = lags(p, x, u, load_tuple(s.zd_next, n_channels))
            store_tuple(lag, s.lag)
            for channel in range(first, n_channels if rounds == 1 else first + 1):
                read_time = time - s.lag[channel]
                s.read_time_next[channel] = read_time
                s.zd_next[channel] = read(s, channel, read_time)

    return read_channels


def _make_try_step(special: Specialisation, load_parameters: Part, read_channels: Part) -> Part:
    _, _, rate, _ = special.equations
    n_states, n_inputs, n_channels, _ = special.sizes
    stages = len(special.method.tableau.nodes)
    nodes, weights = np.array([*special.method.tableau.nodes, 1.0]), np.array(special.method.tableau.weights)

    def try_step(s: Record) -> None:
        """Step to the state's `end`; what comes out is its `_next`."""
        p = load_parameters(s)
        length = s.end - s.time
        reference = s.time + 0.5 * length
        if s.inputs_known == 0:
            events.set_inputs(s, s.time, reference)
        s.inputs_known = 0
        store_tuple(load_tuple(s.x, n_states), s.x_next)
        store_tuple(load_tuple(s.zd, n_channels), s.zd_next)
        for i in range(n_states):
            s.total[i] = 0.0
        for k in range(stages):
            x, u, zd = load_tuple(s.x_next, n_states), load_tuple(s.u, n_inputs), load_tuple(s.zd_next, n_channels)
            store_tuple(rate(p, x, u, zd), s.rates)
            for i in range(n_states):
                s.total[i] += weights[k] * s.rates[i]
                s.x_next[i] = s.x[i] + length * (nodes[k + 1] * s.rates[i] if k + 1 < stages else s.total[i])
            time = s.time + nodes[k + 1] * length if k + 1 < stages else s.end
            if nodes[k + 1] != nodes[k]:
                events.set_inputs(s, time, reference)
            read_channels(s, time)

    return try_step


def _make_emit_now(special: Specialisation, load_parameters: Part) -> Part:
    emit, _, _, _ = special.equations
    n_states, n_inputs, n_channels, _ = special.sizes

    def emit_now(s: Record) -> None:
        """Find what enters the channels at the present."""
        x, u, zd = load_tuple(s.x, n_states), load_tuple(s.u, n_inputs), load_tuple(s.zd, n_channels)
        store_tuple(emit(load_parameters(s), x, u, zd), s.z)

    return emit_now


def _make_store(special: Specialisation, load_parameters: Part) -> Part:
    _, _, _, output = special.equations
    n_states, n_inputs, n_channels, _ = special.sizes

    def store(s: Record) -> None:
        """Write time, states, inputs and outputs as a sample, each n-th time."""
        if s.grid_index % s.store_every == 0:
            x, u, zd = load_tuple(s.x, n_states), load_tuple(s.u, n_inputs), load_tuple(s.zd, n_channels)
            row: Floats = samples_of(s)[s.stored]
            row[0] = s.time
            store_tuple(x, row[1:])
            store_tuple(u, row[1 + n_states :])
            store_tuple(output(load_parameters(s), x, u, zd), row[1 + n_states + n_inputs :])
            s.stored += 1

    return store


def _make_sample(special: Specialisation, sampler: Sampler, load_parameters: Part) -> Part:
    _, _, _, output = special.equations
    n_states, n_inputs, n_channels, _ = special.sizes
    run_controller = sampling.make_update(sampler)

    def sample(s: Record) -> bool:
        """Let the controller's output take effect, or sample and update it, where it is time for either."""
        sampling.act_if_due(s)
        if sampling.is_due(s):
            events.set_inputs(s, s.time, s.time + events.LANDED * s.tolerance)
            x, u, zd = load_tuple(s.x, n_states), load_tuple(s.u, n_inputs), load_tuple(s.zd, n_channels)
            store_tuple(output(load_parameters(s), x, u, zd), s.outputs)
            run_controller(s)
        return False

    return sample
