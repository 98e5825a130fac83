"""A sampled controller in the kernel: when it samples, what it reads, when its output takes effect. `s` is a run's state.

Samples and outputs are events that the mesh meets; an output is a jump of what it drives, and travels through the lags as any
breakpoint does. A sample at an angle of the crank is found as the time at which a state passes a value.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from revline.dde.events import choose_step
from revline.dde.history import FAR
from revline.dde.memory import disturbances_of, load_tuple, loader_of, parameter_type, store_tuple, updates_of
from revline.dde.run import BY_STATE, BY_TIME, Record
from revline.equations import Equation
from revline.sampled import SampledController

MOST_CORRECTIONS = 20
"""The time at which a smooth state passes a value is found in two or three; a state that stands still is never there."""

NEAR = 100.0
"""After these, a sample this near in tolerances is in time, for the state rounds; one that is not is refused."""


@dataclass(frozen=True, slots=True)
class Sampler:
    """What of a controller a kernel is compiled for."""

    digest: str
    sizes: tuple[int, int, int, int, int]
    parameters: Any
    update: Equation = field(compare=False, repr=False)


def sampler_of(controller: SampledController) -> Sampler:
    """Tell what of a controller a kernel is compiled for."""
    groups = (controller.states, controller.measurements, controller.commands, controller.outputs)
    sizes = (len(groups[0]), len(groups[1]), len(groups[2]), len(groups[3]), controller.drives)
    return Sampler(controller.equation_digest, sizes, parameter_type(controller.parameters), controller.update)


def no_event(s: Record) -> bool:  # noqa: ARG001 - the form of all these
    """Where nothing is sampled."""
    return False


def aim(s: Record) -> bool:
    """Foretell when the state passes the next value, by its latest rate, where that is what is waited for."""
    if s.sampling == BY_STATE:
        rate = s.rates[s.sampled_state]
        s.sample_time = s.time + (s.state_target - s.x[s.sampled_state]) / rate if rate > 0.0 else FAR
        s.corrections = 0
        set_event(s)
    return False


def missed(s: Record) -> bool:
    """Say whether the tried step must be tried anew, to where the state passes its next value, which it ran past or fell short of."""
    if s.sampling != BY_STATE:
        return False
    rate = s.rates[s.sampled_state]
    if rate <= 0.0:
        return False
    late = (s.x_next[s.sampled_state] - s.state_target) / rate
    if not (late > s.tolerance or (s.end >= s.sample_time - s.tolerance and late < -s.tolerance)):
        return False
    if s.corrections >= MOST_CORRECTIONS:
        if late > NEAR * s.tolerance or late < -NEAR * s.tolerance:
            s.x_next[s.sampled_state] = np.nan  # the step is refused
        return False
    s.corrections += 1
    s.sample_time = s.end - late if s.end - late > s.time else s.time + s.tolerance
    set_event(s)
    choose_step(s)
    return True


def set_event(s: Record) -> None:
    """The next event: a sample, or an output that takes effect."""
    s.event = s.sample_time if s.sample_time < s.act_time else s.act_time


def is_due(s: Record) -> bool:
    """Whether a sample is to be taken now."""
    due = s.sample_time <= s.time + s.tolerance
    if s.sampling == BY_STATE:
        due = due or s.x[s.sampled_state] >= s.state_target
    return due


def act_if_due(s: Record) -> None:
    """Let the output take effect where it is time for it; or at the next sample, where the computation took longer than that."""
    late = s.act_time < FAR and is_due(s)
    if s.act_time <= s.time + s.tolerance:
        act(s)
    elif late:
        s.overruns += 1
        act(s)


def act(s: Record) -> None:
    """Drive the inputs by the output; what changes is a jump."""
    for k in range(s.driven_input.shape[0]):
        driven = s.driven_input[k]
        if driven >= 0 and s.base[driven] != s.updated[k]:
            s.base[driven] = s.updated[k]
            s.event_orders[driven] = 0
    s.act_time = FAR
    set_event(s)


def make_update(sampler: Sampler) -> Callable[[Record], None]:
    """Make the function that reads the measurements, updates the controller, and plans its next events."""
    update, load_parameters = sampler.update, loader_of(sampler.parameters, "controller")
    n_states, n_measured, n_commands, n_outputs, _ = sampler.sizes
    width = n_states + n_outputs

    def run_controller(s: Record) -> None:
        """Take a sample: outputs of the system and inputs stand in the state."""
        disturbance, row = disturbances_of(s)[s.sample_index], updates_of(s)[s.updates_stored]
        for k in range(n_measured):
            s.y[k] = s.outputs[s.measured_output[k]] + disturbance[1 + k]
        for k in range(n_commands):
            s.r[k] = s.u[s.command_input[k]]
        elapsed = s.time - s.sample_before if s.sampling == BY_STATE else s.period
        y, r = load_tuple(s.y, n_measured), load_tuple(s.r, n_commands)
        result = update(load_parameters(s), load_tuple(s.xd, n_states), y, r, (elapsed,))
        row[0], row[1] = s.time, elapsed
        store_tuple(y, row[2:])
        store_tuple(r, row[2 + n_measured :])
        store_tuple(result, row[2 + n_measured + n_commands :])
        for k in range(n_states):
            s.xd[k] = row[2 + n_measured + n_commands + k]
        for k in range(n_states, width):
            s.updated[k - n_states] = row[2 + n_measured + n_commands + k]
        s.updates_stored += 1
        plan(s)

    return run_controller


def plan(s: Record) -> None:
    """Plan when the output takes effect and the next sample; shifts of samples do not add up."""
    s.act_time = s.time + s.computation_delay
    s.sample_before = s.time
    s.sample_index += 1
    shift = disturbances_of(s)[s.sample_index, 0]
    if s.sampling == BY_TIME:
        s.sample_time = s.origin + s.sample_index * s.period + shift
    else:
        s.state_target = s.state_origin + s.sample_index * s.state_spacing + shift
        s.sample_time = FAR
    if s.computation_delay == 0.0:
        act(s)
    set_event(s)
