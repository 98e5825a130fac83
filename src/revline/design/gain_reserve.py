"""How far all gains may rise together until a sampled loop hunts, measured on the nonlinear plant by bisection."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.design.closed_loop import SPEED_BY_THROTTLE, LoopSignals, OperatingPoint
from revline.design.sampled_loop import SampledRun, SampledTask, run_sampled_loop
from revline.design.scheduled_pid import AnyController, law_of, scaled_controller
from revline.design.time_series import Series, upward_crossings
from revline.errors import SimulationError, out_of_range
from revline.system import DelaySystem
from revline.units import Seconds

Floats = NDArray[np.float64]

LARGEST = 64.0
"""Gains are raised, and lowered, to no more than this factor."""

RESOLUTION = 1.01
"""The bisection ends where its bounds are this factor apart: 0.09 dB."""

USUAL_RUNS = 10
"""So many runs a search takes, about."""

QUIET = 1e-3
"""A loop that moves by less than this part of the command in the last fifth of its run is at rest."""

NEARBY, FIRST_PACE = 1.006, 1.009
"""Hunting is looked for first at the expected factor over `NEARBY`, then away from there in steps that begin with `FIRST_PACE`: where it
begins as expected, two runs tell within the resolution, and neither is at the very edge."""

LENGTHENED = 2
"""A run that does not tell is made again, twice as long, so many times."""


FADING = 0.5
"""A loop whose swing falls below this part of itself from one fifth of its run to the next comes to rest."""

DECAYS, NO_SLOWER = 0.95, 1.04
"""A loop rests too whose swing falls below `DECAYS` of itself, and by a share at most `NO_SLOWER` times smaller than before.

A decay towards a limit cycle slows down and is run longer: swings c + a q^k pass only where c is below 0.4 of the last one.
"""

STEADY = 0.98
"""In the longest run, a swing that keeps more than this part of itself is hunting."""


class Ending(Enum):
    """How a run with changed gains ends."""

    RESTS = "comes to rest"
    HUNTS = "hunts"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReserveSearch:
    """How hunting is looked for.

    Attributes:
        command: size of its step.
        until: length of a run, in s.
        step: of the simulation, in s.
        near: factor at which hunting is expected to begin, for example the gain margin of the exact linear loop; it saves runs and
            decides nothing.
    """

    command: float
    until: Seconds = 10.0
    step: Seconds = 1e-3
    near: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GainReserve:
    """The factor on all gains at which a loop begins to hunt after a step of its command.

    Attributes:
        place: inputs at the trim, by name.
        factor: the largest at which it was seen to come to rest; below 1 where it hunts with its own gains.
        hunts: the smallest at which it was seen to hunt; infinite where it was not up to the largest tried.
        period: of the hunting there, in s; infinite where there is none, or where the plant stalls instead.
        runs: how many were made.
    """

    place: Mapping[str, float]
    factor: float
    hunts: float
    period: Seconds
    runs: int

    @property
    def decibels(self) -> float:
        """Distance from the designed gains to the onset, in dB; a lower bound where no hunting was found."""
        return 20.0 * math.log10(self.factor) if self.factor > 0.0 else -math.inf


def find_gain_reserve(
    plant: DelaySystem,
    point: OperatingPoint,
    controller: AnyController,
    search: ReserveSearch,
    *,
    place: Mapping[str, float],
    wires: LoopSignals = SPEED_BY_THROTTLE,
    progress: Callable[[float], None] | None = None,
) -> GainReserve:
    """Bisect the factor on kp, ki and kd at which a sampled loop begins to hunt.

    A run without noise tells: the loop rests where it moves no more at its end or its oscillation fades fast, it hunts where that does
    not decay or where the plant stalls. A run that tells neither is made longer, up to four times.

    Args:
        plant: nonlinear, with its delays.
        point: of rest.
        controller: sampled.
        search: how.
        place: inputs at the point, kept with the result.
        wires: which signals close the loop.
        progress: called before each run, so that it can end the search.

    Raises:
        InvalidInputError: as for `run_sampled_loop`, or the command is 0.
    """
    if not (math.isfinite(search.command) and search.command != 0.0):
        raise out_of_range("step of the command", search.command, "", "the finite numbers but 0", "give the size of a step")
    runs, period = 0, math.inf

    def tries(factor: float) -> Ending:
        nonlocal runs, period
        if progress is not None:
            progress(runs / USUAL_RUNS)
        runs += 1
        scaled = scaled_controller(controller, factor)
        ending, found = _ending(plant, point, scaled, search, wires)
        period = found if ending is Ending.HUNTS else period
        return ending

    rests, hunts = _bracket(tries, search.near)
    while rests > 0.0 and math.isfinite(hunts) and hunts > RESOLUTION * rests:
        middle = math.sqrt(rests * hunts)
        if tries(middle) is Ending.RESTS:
            rests = middle
        else:
            hunts = middle
    return GainReserve(place=place, factor=rests, hunts=hunts, period=period, runs=runs)


def _bracket(tries: Callable[[float], Ending], near: float | None) -> tuple[float, float]:
    """Change the factor until one rests and one hunts; 0 or infinity where none does within what is tried.

    The loop's own gains come first, then the factor at which hunting is expected to begin, then more or less in growing steps.
    """
    if tries(1.0) is Ending.HUNTS:
        return _fall(tries, 1.0, 2.0)
    if near is None or not NEARBY < near < LARGEST:
        return _rise(tries, 1.0, 2.0)
    if tries(near / NEARBY) is Ending.RESTS:
        return _rise(tries, near / NEARBY, FIRST_PACE)
    rests, hunts = _fall(tries, near / NEARBY, FIRST_PACE, least=1.0)
    return max(rests, 1.0), hunts


def _rise(tries: Callable[[float], Ending], rests: float, pace: float) -> tuple[float, float]:
    while rests * pace <= LARGEST:
        if tries(rests * pace) is Ending.HUNTS:
            return rests, rests * pace
        rests, pace = rests * pace, min(2.0, pace * pace)
    return rests, math.inf


def _fall(tries: Callable[[float], Ending], hunts: float, pace: float, least: float = 1.0 / LARGEST) -> tuple[float, float]:
    while hunts / pace >= least:
        if tries(hunts / pace) is Ending.RESTS:
            return hunts / pace, hunts
        hunts, pace = hunts / pace, min(2.0, pace * pace)
    return 0.0, hunts


def _ending(
    plant: DelaySystem, point: OperatingPoint, controller: AnyController, search: ReserveSearch, wires: LoopSignals
) -> tuple[Ending, float]:
    """Tell how a run ends, and the period of its hunting."""
    until = search.until
    for _ in range(LENGTHENED):
        run = _try(plant, point, controller, replace(search, until=until), wires)
        if run is None:
            return Ending.HUNTS, math.inf
        first, before, last = _swings(run)[-3:].tolist()
        if last <= QUIET * abs(search.command) + 2.0 * law_of(controller).measurement_step or fades(first, before, last):
            return Ending.RESTS, math.inf
        if last >= before and math.isfinite(_period(run)):
            return Ending.HUNTS, _period(run)
        until *= 2.0
    run = _try(plant, point, controller, replace(search, until=until), wires)
    if run is None:
        return Ending.HUNTS, math.inf
    before, last = _swings(run)[-2:].tolist()
    hunts = last > STEADY * before and math.isfinite(_period(run))  # what creeps without oscillating does not hunt
    return (Ending.HUNTS, _period(run)) if hunts else (Ending.RESTS, math.inf)


def fades(first: float, before: float, last: float) -> bool:
    """Whether swings in equal spans, one after the other, go to none: they fall fast, or fall and do not slow down.

    Args:
        first: range of the output in the first of three spans.
        before: in the second.
        last: in the third.
    """
    if last < FADING * before:
        return True
    return last <= DECAYS * before and (first - before) * before <= NO_SLOWER * (before - last) * first


def _try(
    plant: DelaySystem, point: OperatingPoint, controller: AnyController, search: ReserveSearch, wires: LoopSignals
) -> SampledRun | None:
    """Run a loop; none where the plant stalls or diverges, which is no rest."""
    task = SampledTask(command=signals.step(search.command), until=search.until, step=search.step)
    try:
        return run_sampled_loop(plant, point, controller, task, wires=wires)
    except SimulationError:
        return None


def _swings(run: SampledRun) -> Floats:
    """Range of the output in each fifth of a run."""
    return np.array([np.ptp(part) for part in np.array_split(run.output, 5)])


def _period(run: SampledRun) -> float:
    """Mean period in the last two fifths of a run; infinite where it does not oscillate."""
    part = run.times >= 0.6 * run.times[-1]
    series = Series(run.times[part], run.output[part])
    level = float(series.values.max() + series.values.min()) / 2.0
    crossings = upward_crossings(series, level, 0.05 * float(np.ptp(series.values)))
    return float(np.mean(np.diff(crossings))) if crossings.size > 2 else math.inf
