"""Simulation to a tolerance: the step is halved until two runs in a row agree.

Source: Runge's principle; Butcher (2016), Numerical Methods for Ordinary Differential Equations, chapter 3.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from revline.dde.run import Floats
from revline.dde.simulate import Options, Progress, Start, held_channels, simulate
from revline.dde.trajectory import Trajectory
from revline.errors import InvalidInputError, NotConvergedError, StepError, out_of_range
from revline.signals import Signal, TermKind
from revline.system import DelaySystem

DEFAULT_TOLERANCE = 1e-6
"""Agreement asked for, as a part of each state's range."""

LAG_SHARE = 0.5
"""Part of the smallest lag at the start that the first step does not exceed."""

TURN_SHARE = 0.25
"""Part of the time in which the fastest sinusoid turns by a radian that the first step does not exceed: a coarser one would miss it."""

MOST_STEPS = 200_000_000
"""Steps in one run beyond which no further run is tried."""

LEAST_RANGE = 1e-6
"""Part of a state's size that counts as its range where it moves less: below, rounding is compared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvergedRun:
    """A simulation whose step was found by halving.

    Attributes:
        trajectory: of the last run, that with the smallest step.
        difference: largest difference to the run before, over all samples and states, as a part of each state's range. The error left
            is smaller: a fifteenth of this where nothing but the method's order counts.
        tolerance: asked for.
        steps: of all runs, in seconds, each half of the one before.
    """

    trajectory: Trajectory
    difference: float
    tolerance: float
    steps: tuple[float, ...]


def simulate_to_tolerance(
    system: DelaySystem,
    start: Start,
    signals: Mapping[str, Signal],
    *,
    until: float,
    interval: float,
    tolerance: float = DEFAULT_TOLERANCE,
    options: Options | None = None,
) -> ConvergedRun:
    """Simulate with a step found by halving, until two runs in a row agree at all samples within a tolerance.

    Args:
        system: what to simulate.
        start: states and base inputs.
        signals: by input name, added to the base inputs.
        until: stop time in seconds; one that is no multiple of the interval is moved to the next, with a note.
        interval: between samples, in seconds; a whole number of steps.
        tolerance: largest difference of any state between the runs, as a part of that state's range.
        options: where its `every` is n, each n-th sample is stored; method and progress.

    Raises:
        InvalidInputError: as for `simulate`, the interval or the tolerance is not positive, or there are more steps than `MOST_STEPS`.
        NotConvergedError: the runs still differ where rounding or the number of steps ends the search.
        SimulationError: as for `simulate`.
    """
    options = options or Options()
    _check_wishes(system, start, until, interval, tolerance)
    task = _Task(system, start, signals, until, interval, options)
    parts = math.ceil(interval / _longest_step(system, start, signals, interval))
    _check_size(task, 2 * parts)
    coarse: Trajectory | None = None
    steps: list[float] = []
    difference = math.inf
    for number in itertools.count():
        if (until - start.time) / interval * parts > MOST_STEPS:
            break
        fine = _try(task, parts, number)
        if fine is not None:
            steps.append(fine.step)
            difference = compare_runs(coarse, fine) if coarse is not None else math.inf
            if difference <= tolerance:
                return ConvergedRun(trajectory=fine, difference=difference, tolerance=tolerance, steps=tuple(steps))
        coarse, parts = fine, 2 * parts
    state = f"still differ by {difference:.2g} of a state's range at step = {2.0 * interval / parts:.3g} s (limit {tolerance:g})"
    message = f"runs of {system.name} to t = {until:g} s {state}; give a larger tolerance, an earlier stop time or a step"
    raise NotConvergedError(message, difference=difference, tolerance=tolerance)


def compare_runs(coarse: Trajectory, fine: Trajectory) -> float:
    """Largest difference of two runs at the same times, over all states, each as a part of its range.

    The end counts too, where it is no sample: there the difference is a part of the state's size.
    """
    low, high = fine.states.min(axis=0), fine.states.max(axis=0)
    scale: Floats = np.maximum(high - low, LEAST_RANGE * np.maximum(np.abs(low), np.abs(high)))
    differences = np.abs(fine.states - coarse.states).max(axis=0)
    first, second = (run.checkpoint.run.state["x"][0][: len(scale)] for run in (coarse, fine))
    return max(_largest_part(differences, scale), _largest_part(np.abs(first - second), np.maximum(np.abs(first), np.abs(second))))


def _largest_part(differences: Floats, scale: Floats) -> float:
    """Largest quotient; what has no scale differs by nothing."""
    return float(np.max(np.divide(differences, scale, out=np.zeros_like(scale), where=scale > 0.0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What all runs of a search have in common."""

    system: DelaySystem
    start: Start
    signals: Mapping[str, Signal]
    until: float
    interval: float
    options: Options


def _check_wishes(system: DelaySystem, start: Start, until: float, interval: float, tolerance: float) -> None:
    if not (math.isfinite(interval) and interval > 0.0):
        raise out_of_range("sample interval", interval, "s", "values above 0", "give one such as 0.01")
    if not 0.0 < tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "of each state's range", "0 to 1", f"give one such as {DEFAULT_TOLERANCE:g}")
    if not (math.isfinite(until) and until > start.time):
        raise out_of_range("stop time", until, "s", f"values after the start at {start.time:g} s", "give a later stop time")
    if not system.states:
        message = f"{system.name} has no states to compare; simulate it with a step"
        raise InvalidInputError(message)


def _check_size(task: _Task, parts: int) -> None:
    """Refuse a search whose first two runs would not be made."""
    count = (task.until - task.start.time) / task.interval * parts
    if count > MOST_STEPS:
        fastest = f"step = {task.interval / parts:.3g} s, which the inputs and lags ask for"
        message = f"a run to t = {task.until:g} s takes {count:.3g} steps at {fastest}, and at most {MOST_STEPS:.3g} are tried"
        raise InvalidInputError(f"{message}; give an earlier stop time, slower inputs, or a step", steps=count)


def _try(task: _Task, parts: int, number: int) -> Trajectory | None:
    """Run with a step, which may turn out to be longer than a lag on the way: then there is no run."""
    # The stop is on the grid of samples, so that all runs end at one time.
    start, interval, options = task.start, task.interval, task.options
    last = start.time + math.ceil((task.until - start.time) / interval * (1.0 - 1e-12) - 1e-9) * interval
    chosen = replace(options, every=options.every * parts, progress=_share_of_search(options, number))
    try:
        run = simulate(task.system, start, task.signals, until=last, step=interval / parts, options=chosen)
    except StepError:
        return None
    if abs(last - task.until) <= 1e-9 * interval:
        return run
    note = f"stop time {task.until:g} s is no multiple of the sample interval {interval:g} s: moved to {last:.12g} s"
    return replace(run, notes=(*run.notes, note))


def _share_of_search(options: Options, number: int) -> Progress | None:
    """Tell a run's progress as that of the search: run k takes 2^k times the first one's time, and the second is taken for the last."""
    told = options.progress
    if told is None:
        return None
    before, own, whole = 2**number - 1, 2**number, 2 ** (max(number, 1) + 1) - 1
    return lambda done: told((before + own * done) / whole)


def _longest_step(system: DelaySystem, start: Start, signals: Mapping[str, Signal], interval: float) -> float:
    """Longest step worth a try: well below the lags at the start and the turns of all sinusoids."""
    x, u = tuple(map(float, start.states)), tuple(map(float, start.inputs))
    with np.errstate(all="ignore"):
        try:
            lags = system.lags(system.parameters, x, u, tuple(map(float, held_channels(system, start))))
        except ZeroDivisionError:
            lags = ()
    limits = [LAG_SHARE * float(lag) for lag in lags if lag > 0.0]
    limits += [TURN_SHARE / term.first for signal in signals.values() for term in signal.terms if term.kind is TermKind.SINE]
    return min([interval, *limits])
