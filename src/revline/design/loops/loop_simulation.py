"""Simulating a loop to its end, or as far as it goes: what failed is told beside the record up to there.

A run that meets a lag shorter than its step is made again with a smaller one; what a smaller step does not mend is the model's own.
"""

import math
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.dde.simulate import Options, Start, Trajectory, simulate
from revline.design.loops.outcome import Stalled
from revline.errors import LagError, SimulationError, StalledError, StepError, out_of_range
from revline.system import DelaySystem

Floats = NDArray[np.float64]

T = TypeVar("T")

HALVINGS = 4
"""How many times the step is halved where a run fails by a lag that is not merely shorter than the step."""

LEAST_STEPS = 20
"""A run that is cut short is recorded with at least this many steps."""

MOST_STEPS = 1e8
"""More steps than this would run for minutes."""

MOST_RECORDED = 1_000_000
"""Of a run of more steps each how-manieth is recorded, so that there are no more samples: a run and its judgement then take 1 GB."""

CONTROLLER_OUTPUTS = 5
"""The controller's outputs are the last of a loop: control, control wanted, and its three terms."""


class LoopTrace(NamedTuple):
    """What a closed loop did: times (n,), measurement (n,), control (n,), its terms (n, 3) or none, and the simulation's step."""

    times: Floats
    output: Floats
    control: Floats
    terms: Floats
    step: float

    def first(self, count: int) -> "LoopTrace":
        """Keep the first samples."""
        return LoopTrace(self.times[:count], self.output[:count], self.control[:count], self.terms[:count], self.step)


class LoopRecord(NamedTuple):
    """A trace of finite numbers, and what ended it before its time, if anything did."""

    trace: LoopTrace
    failure: SimulationError | None


class Mesh(NamedTuple):
    """Until when a loop is run, at which distance it is recorded, and how many steps lie between two records."""

    until: float
    spacing: float
    pieces: int = 1

    def thinned(self) -> "Mesh":
        """Record at a multiple of the distance where there would be too many samples to hold; the steps stay."""
        every = max(1, math.ceil(self.until / self.spacing / MOST_RECORDED))
        return Mesh(self.until, every * self.spacing, every * self.pieces)


class Ended(NamedTuple, Generic[T]):
    """What a run gave as far as it went, its step in s, and what ended it before its time, if anything did."""

    result: T
    step: float
    failure: SimulationError | None


def simulate_loop(
    loop: DelaySystem, start: Start, command: float, mesh: Mesh, *, measured: int, loads: Sequence[tuple[str, signals.Signal]] = ()
) -> LoopRecord:
    """Simulate a loop whose last input is the command, after a step of it at time 0.

    Args:
        loop: a plant connected to a controller, in that order.
        start: at rest.
        command: size of the step.
        mesh: how long and how finely.
        measured: position of the measurement among the outputs.
        loads: signals of further inputs, by name.

    Raises:
        InvalidInputError: the step is not below the smallest lag at the start, or there would be too many of them.
        StepError: a lag fell below the step.
        SimulationError: the loop fails within its first step, so that there is no record.
    """
    check_steps(mesh)
    drive = {**dict(loads), loop.inputs[-1].name: signals.step(command)}

    def run(mesh: Mesh) -> Trajectory:
        step = mesh.spacing / mesh.pieces
        return simulate(loop, start, drive, until=mesh.until, step=step, options=Options(every=mesh.pieces))

    record, _, failure = run_as_far_as_it_goes(run, mesh)
    trace = LoopTrace(
        times=record.times,
        output=record.outputs[:, measured],
        control=record.outputs[:, -CONTROLLER_OUTPUTS],
        terms=record.outputs[:, -3:],
        step=record.step,
    )
    return LoopRecord(keep_finite(trace), failure)


def check_steps(mesh: Mesh) -> None:
    """Refuse more steps than can be waited for.

    Raises:
        InvalidInputError: there are too many.
    """
    step = mesh.spacing / mesh.pieces
    if mesh.until / step > MOST_STEPS:
        raise out_of_range(
            "time step",
            step,
            "s",
            f"{mesh.until / MOST_STEPS:g} s and above for {mesh.until:g} s",
            "run it shorter, or drop so short a delay",
        )


def run_as_far_as_it_goes(run: Callable[[Mesh], T], mesh: Mesh, halvings: int = HALVINGS) -> Ended[T]:
    """Run to the end or to what fails, with smaller steps where a lag fails otherwise than by being shorter than the step.

    Args:
        run: simulates the loop as long and as finely as a mesh says.
        mesh: how far and how finely at first.
        halvings: of the step, at most.

    Raises:
        SimulationError: it fails at once, or at a step that can not be taken.
    """
    step = mesh.spacing / mesh.pieces
    try:
        return Ended(run(mesh), step, None)
    except StepError:
        raise
    except LagError as error:
        if halvings > 0:
            return run_as_far_as_it_goes(run, mesh._replace(pieces=2 * mesh.pieces), halvings - 1)
        failure: SimulationError = error
    except SimulationError as error:
        failure = error
    lasted = float(failure.details["time"])
    if lasted <= 0.0:
        raise failure
    count = math.floor(lasted / step + 1e-9)
    every = mesh.pieces if count // mesh.pieces >= LEAST_STEPS else 1
    if count < LEAST_STEPS:
        count, step = LEAST_STEPS, lasted / (LEAST_STEPS + 2)
    return Ended(run(Mesh(count * step, every * step, every)), step, failure)


def keep_finite(trace: LoopTrace) -> LoopTrace:
    """Leave out what comes after the last sample of finite numbers."""
    whole = np.isfinite(trace.output) & np.isfinite(trace.control)
    if trace.terms.size:
        whole &= np.isfinite(trace.terms).all(axis=1)
    return trace.first(len(whole) if whole.all() else int(np.argmin(whole)))


def describe_stall(failure: SimulationError, loop: DelaySystem) -> Stalled:
    """Say which state stalled a loop: the one that left its range, or the one that the lags depend on.

    Raises:
        SimulationError: the failure is no stall: a state is no number, or a lag that depends on no state is shorter than any step.
    """
    time, units = float(failure.details["time"]), {v.name: v.unit for v in loop.states}
    if isinstance(failure, StalledError):
        state = str(failure.details["state"])
        return Stalled(time=time, state=state, value=float(failure.details["value"]), unit=units[state])
    sources = frozenset[str]().union(*loop.structure.lags)
    names = [v.name for k, v in enumerate(loop.states) if f"x{k}" in sources]
    if not (isinstance(failure, LagError) and names):
        raise failure
    return Stalled(time=time, state=names[0], value=float(failure.details[names[0]]), unit=units[names[0]])
