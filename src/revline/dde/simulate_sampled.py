"""Simulation of a system under a sampled controller: continuous between events, which the mesh meets, discrete at them.

Source: Astrom and Wittenmark (1997), Computer-Controlled Systems, chapter 3; of the numerics between events: `revline.dde.kernel`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from revline.dde import run as runs
from revline.dde.failures import explain
from revline.dde.inputs import check_resolved, tabulate_signals
from revline.dde.kernel import build_kernel
from revline.dde.memory import as_floats, attach_tables, flatten
from revline.dde.run import Floats
from revline.dde.simulate import Options, Start, grid_target, make_trajectory, new_run, reserve_samples
from revline.dde.trajectory import Checkpoint, Run, Trajectory, make_room
from revline.errors import InvalidInputError, StoppedError
from revline.sampled import CrankSynchronous, SampledController, Sampling
from revline.signals import Signal
from revline.system import DelaySystem, index_of
from revline.values import fingerprint, make_read_only

Disturb = Callable[[int], Floats]
"""Gives the next rows of what disturbs the samples: shift of each, then what is added to each measurement."""

ROWS = 1024
"""Fewest samples for which there is room at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """How a sampled controller meets a system, all by name.

    Attributes:
        drives: inputs of the system, one for each of the controller's outputs that drive.
        measures: outputs of the system, one for each measurement.
        commands: inputs of the system whose signals the controller reads as commands; the system's equations need not.
        angle: state that counts the crank's angle, for sampling by it.
    """

    drives: tuple[str, ...]
    measures: tuple[str, ...]
    commands: tuple[str, ...]
    angle: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampler:
    """A controller, how it meets the system, when it samples, and what disturbs it.

    Attributes:
        controller: what is sampled.
        wiring: how it meets the system.
        sampling: when.
        states: of the controller before the first sample, shape (n_states,).
        elapsed: seconds since a sample before the first, as the controller takes them.
        disturb: gives what disturbs the samples, in their order; nothing by default.
    """

    controller: SampledController
    wiring: Wiring
    sampling: Sampling
    states: Floats
    elapsed: float
    disturb: Disturb | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledTrajectory:
    """A simulation under a sampled controller.

    Attributes:
        trajectory: samples of the system on the grid.
        times: of the controller's samples, shape (k,).
        elapsed: seconds since the sample before, as the controller took them, shape (k,).
        measurements: with what disturbed them, shape (k, n_measurements).
        commands: shape (k, n_commands).
        states: of the controller after each sample, shape (k, n_states).
        outputs: of the controller, shape (k, n_outputs).
        overruns: how many outputs were not ready before the next sample; one that is ready at it is in time.
    """

    trajectory: Trajectory
    times: Floats
    elapsed: Floats
    measurements: Floats
    commands: Floats
    states: Floats
    outputs: Floats
    overruns: int

    def __post_init__(self) -> None:
        make_read_only(self)


def simulate_sampled(
    system: DelaySystem,
    start: Start,
    signals: Mapping[str, Signal],
    sampler: Sampler,
    *,
    until: float,
    step: float,
    options: Options | None = None,
) -> SampledTrajectory:
    """Simulate a system under a sampled controller; the first sample is taken at the start.

    Args:
        system: what is controlled.
        start: states and base inputs; the inputs that the controller drives are held at their base until its first output.
        signals: by input name, added to the base inputs; not for inputs that the controller drives.
        sampler: the controller.
        until: stop time in seconds.
        step: of the mesh, in seconds; below the smallest lag.
        options: storing, method and progress.

    Raises:
        InvalidInputError: a signal is missing or driven twice, the counts do not fit, or as for `simulate`.
        SimulationError: as for `simulate`.
    """
    options = options or Options()
    check_resolved(signals, step)
    run = new_run(system, start, step, options.every)
    _wire(system, run.state[0], sampler, signals)
    return _advance(system, signals, run, sampler, until=until, options=options)


def _wire(system: DelaySystem, s: runs.Record, sampler: Sampler, signals: Mapping[str, Signal]) -> None:
    """Write into a run's state what a controller reads and drives, and when it samples first."""
    controller, wiring = sampler.controller, sampler.wiring
    groups = (
        ("driven_input", "drives", wiring.drives, system.inputs, controller.drives),
        ("measured_output", "measures", wiring.measures, system.outputs, len(controller.measurements)),
        ("command_input", "commands", wiring.commands, system.inputs, len(controller.commands)),
    )
    for field, what, names, variables, wanted in groups:
        if len(names) != wanted or wanted > runs.SMALLEST_WIDTH:
            message = f"{controller.name} {what} {wanted} signals (at most {runs.SMALLEST_WIDTH}) and {len(names)} are wired; wire each"
            raise InvalidInputError(message)
        s[field][:] = -1
        s[field][:wanted] = [index_of(variables, name) for name in names]
    twice = set(wiring.drives) & set(signals)
    if twice:
        message = f"{', '.join(sorted(twice))} is driven by the controller and by a signal; leave the signal out"
        raise InvalidInputError(message)
    width = max(len(controller.states), len(controller.outputs), len(system.outputs))
    if width > runs.WIDEST:
        message = f"{system.name} and {controller.name} have {width} signals of a kind, more than {runs.WIDEST}; leave some out"
        raise InvalidInputError(message)
    if sampler.states.shape != (len(controller.states),):
        message = f"{sampler.states.size} states were given where {controller.name} has {len(controller.states)}; see its start"
        raise InvalidInputError(message)
    s["xd"][: len(controller.states)] = sampler.states
    s["computation_delay"] = sampler.sampling.computation_delay
    s["sample_time"] = s["event"] = s["time"]
    s["sample_before"] = s["time"] - sampler.elapsed
    if isinstance(sampler.sampling, CrankSynchronous):
        if wiring.angle is None:
            message = "sampling by the crank's angle needs a state that counts it; name it in the wiring"
            raise InvalidInputError(message)
        s["sampling"], s["sampled_state"] = runs.BY_STATE, index_of(system.states, wiring.angle)
        s["state_origin"] = s["state_target"] = s["x"][s["sampled_state"]]
        s["state_spacing"] = sampler.sampling.angle
    else:
        s["sampling"], s["period"] = runs.BY_TIME, sampler.sampling.period


def _advance(
    system: DelaySystem, signals: Mapping[str, Signal], run: Run, sampler: Sampler, *, until: float, options: Options
) -> SampledTrajectory:
    s, controller = run.state[0], sampler.controller
    target, notes = grid_target(s, until)
    span = (float(s["origin"]), float(s["origin"]) + (target + 1) * float(s["step"]))
    tables = tabulate_signals(system, s["base"][: len(system.inputs)], signals, span)
    tables["samples"] = samples = reserve_samples(system, s, target)
    for name, owner in (("parameters", system), ("controller", controller)):
        tables[name] = np.array([list(flatten(as_floats(owner.parameters, owner.name)))])
    log = _Log(sampler, span[1] - span[0])
    kernel = build_kernel(system, options.method, controller)
    done = 0
    while done < target:
        if options.progress is not None:
            options.progress(done / target)
        s["grid_target"] = min(target, done + options.chunk)
        run, s = make_room(run, int(s["grid_target"]) - done, log.events_at_once), run.state[0]
        log.make_room(s)
        attach_tables(run.state, {**tables, "nodes": run.nodes, "segments": run.segments, **log.tables})
        if kernel(run.state) == runs.REFUSED:
            raise explain(system, s)
        done = int(s["grid_index"]) - 1
        if done < target and options.stopped is not None and options.stopped():
            break
    digests = (system.content_digest, fingerprint(dict(signals)))
    checkpoint = Checkpoint(system_digest=digests[0], signal_digest=digests[1], method=options.method, run=make_room(run, 0))
    found = log.cut(make_trajectory(system, samples[: int(s["stored"])], notes, checkpoint), s)
    if done < target:
        message = f"{system.name} at t = {checkpoint.time:.6g} s of {until:g} s, stopped from outside"
        raise StoppedError(message, run=found, time=checkpoint.time)
    if options.progress is not None:
        options.progress(1.0)
    return found


class _Log:
    """The tables of a sampled controller, which grow as samples come."""

    def __init__(self, sampler: Sampler, duration: float) -> None:
        controller = sampler.controller
        self.sampler = sampler
        self.sizes = [2, len(controller.measurements), len(controller.commands), len(controller.states), len(controller.outputs)]
        expected = duration / sampler.sampling.period if not isinstance(sampler.sampling, CrankSynchronous) else 0.0
        self.rows = max(ROWS, math.ceil(expected) + 2 * runs.ROOM_UPDATES)
        self.tables = {
            "updates": np.zeros((0, sum(self.sizes))),
            "disturbances": np.zeros((0, 1 + len(controller.measurements))),
        }

    @property
    def events_at_once(self) -> int:
        """Segments of history for which there should be room: some for each sample."""
        return min(4 * self.rows, 4096)

    def make_room(self, s: runs.Record) -> None:
        """Add rows where they run short."""
        updates, disturbances = self.tables["updates"], self.tables["disturbances"]
        if len(updates) - int(s["updates_stored"]) >= runs.ROOM_UPDATES and len(disturbances) - int(s["sample_index"]) >= runs.ROOM_UPDATES:
            return
        more = np.zeros((self.rows, disturbances.shape[1])) if self.sampler.disturb is None else self.sampler.disturb(self.rows)
        self.tables = {
            "updates": np.concatenate([updates, np.zeros((self.rows, updates.shape[1]))]),
            "disturbances": np.concatenate([disturbances, more]),
        }

    def cut(self, trajectory: Trajectory, s: runs.Record) -> SampledTrajectory:
        """Give what was recorded."""
        rows = self.tables["updates"][: int(s["updates_stored"])]
        _, y, r, xd, u = np.split(rows, np.cumsum(self.sizes)[:-1], axis=1)
        return SampledTrajectory(
            trajectory=trajectory,
            times=rows[:, 0],
            elapsed=rows[:, 1],
            measurements=y,
            commands=r,
            states=xd,
            outputs=u,
            overruns=int(s["overruns"]),
        )
