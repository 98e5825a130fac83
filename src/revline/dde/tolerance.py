"""Simulation to a tolerance: the step is halved until two runs in a row agree.

Source: Runge's principle; Butcher (2016), Numerical Methods for Ordinary Differential Equations, chapter 3.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from revline.dde.run import Floats
from revline.dde.simulate import Options, Start, held_channels, simulate
from revline.dde.trajectory import Trajectory
from revline.errors import InvalidInputError, NotConvergedError, StepError, out_of_range
from revline.signals import Signal, TermKind
from revline.system import DelaySystem

DEFAULT_TOLERANCE = 1e-6
"""Agreement asked for, as a part of each output's range."""

LAG_SHARE = 0.5
"""Part of the smallest lag at the start that the first step does not exceed."""

TURN_SHARE = 0.25
"""Part of the time in which the fastest sinusoid turns by a radian that the first step does not exceed: a coarser one would miss it."""

MOST_STEPS = 200_000_000
"""Steps in one run beyond which no further run is tried."""

LEAST_RANGE = 1e-6
"""Part of an output's size that counts as its range where it moves less: below, rounding is compared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvergedRun:
    """A simulation whose step was found by halving.

    Attributes:
        trajectory: of the last run, that with the smallest step.
        difference: largest difference to the run before, over all samples and outputs, as a part of each output's range. The error left
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
) -> ConvergedRun:
    """Simulate with a step found by halving, until two runs in a row agree at all samples within a tolerance.

    Args:
        system: what to simulate.
        start: states and base inputs.
        signals: by input name, added to the base inputs.
        until: stop time in seconds.
        interval: between samples, in seconds; a whole number of steps.
        tolerance: largest difference of any output between the runs, as a part of that output's range.

    Raises:
        InvalidInputError: as for `simulate`, or the interval or the tolerance is not positive.
        NotConvergedError: the runs still differ where rounding or the number of steps ends the search.
        SimulationError: as for `simulate`.
    """
    if not (math.isfinite(interval) and interval > 0.0):
        raise out_of_range("sample interval", interval, "s", "values above 0", "give one such as 0.01")
    if not 0.0 < tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "of each output's range", "0 to 1", f"give one such as {DEFAULT_TOLERANCE:g}")
    if not system.outputs:
        message = f"{system.name} has no outputs to compare; simulate it with a step"
        raise InvalidInputError(message)
    every = math.ceil(interval / _longest_step(system, start, signals, interval))
    coarse: Trajectory | None = None
    steps: list[float] = []
    difference = math.inf
    while (until - start.time) / interval * every <= MOST_STEPS:
        fine = _try(system, start, signals, until, interval, every)
        if fine is not None:
            steps.append(fine.step)
            difference = compare_runs(coarse, fine) if coarse is not None else math.inf
            if difference <= tolerance:
                return ConvergedRun(trajectory=fine, difference=difference, tolerance=tolerance, steps=tuple(steps))
        coarse, every = fine, 2 * every
    state = f"still differ by {difference:.2g} of an output's range at step = {2.0 * interval / every:.3g} s (limit {tolerance:g})"
    message = f"runs of {system.name} to t = {until:g} s {state}; give a larger tolerance, an earlier stop time or a step"
    raise NotConvergedError(message, difference=difference, tolerance=tolerance)


def compare_runs(coarse: Trajectory, fine: Trajectory) -> float:
    """Largest difference of two runs at the same times, over all outputs, each as a part of its range."""
    low, high = fine.outputs.min(axis=0), fine.outputs.max(axis=0)
    scale: Floats = np.maximum(high - low, LEAST_RANGE * np.maximum(np.abs(low), np.abs(high)))
    differences = np.abs(fine.outputs - coarse.outputs).max(axis=0)
    return float(np.max(np.divide(differences, scale, out=np.zeros_like(scale), where=scale > 0.0)))


def _try(system: DelaySystem, start: Start, signals: Mapping[str, Signal], until: float, interval: float, every: int) -> Trajectory | None:
    """Run with a step, which may turn out to be longer than a lag on the way: then there is no run."""
    # The stop is on the grid of samples, so that all runs end at one time.
    last = start.time + math.ceil((until - start.time) / interval * (1.0 - 1e-12) - 1e-9) * interval
    try:
        run = simulate(system, start, signals, until=last, step=interval / every, options=Options(every=every))
    except StepError:
        return None
    if abs(last - until) <= 1e-9 * interval:
        return run
    note = f"stop time {until:g} s is no multiple of the sample interval {interval:g} s: moved to {last:.12g} s"
    return replace(run, notes=(*run.notes, note))


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
