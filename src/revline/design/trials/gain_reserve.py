"""How far all gains may rise together until a sampled loop hunts, measured on the nonlinear plant by bisection."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from revline import signals
from revline.design.controllers.scheduled_pid import AnyController, scaled_controller
from revline.design.loops.run_ending import Ending, Seen, judge_ending
from revline.design.loops.sampled_loop import SampledRun, SampledTask, run_sampled_loop
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, OperatingPoint
from revline.errors import DivergedError, LagError, NotConvergedError, StalledError, StepError, out_of_range
from revline.system import DelaySystem
from revline.units import Seconds

LARGEST = 64.0
"""Gains are raised, and lowered, to no more than this factor."""

RESOLUTION = 1.01
"""The bisection ends where its bounds are this factor apart: 0.09 dB."""

NEARBY, FIRST_PACE = 1.006, 1.009
"""Hunting is looked for first at the expected factor over `NEARBY`, then away from there in steps that begin with `FIRST_PACE`: where it
begins as expected, two runs tell within the resolution, and neither is at the very edge."""

USUAL_RUNS = 10
"""So many runs a search takes, about."""

LONG = 2
"""A run that does not tell is made again, twice as long; after so many times it is long."""

LONGEST = 6
"""A run is doubled so many times at most: a slow oscillation needs that."""


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
        factor: the largest at which it was seen to come to rest; below 1 where it does not with its own gains, 0 where it never does.
        hunts: the smallest at which it was seen not to; infinite where it came to rest up to the largest tried.
        ending: what it does there instead: it hunts, drifts away or stalls; it "comes to rest" where `hunts` is infinite.
        period: of the hunting there, in s; infinite where there is none.
        runs: how many were made.
    """

    place: Mapping[str, float]
    factor: float
    hunts: float
    ending: Ending
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

    A run without noise tells: the loop rests where it moves no more at its end or what moves fades fast. It does not where its oscillation
    does not decay, where it drifts away or its output stays at a limit, or where the plant stalls. A run that tells neither is made
    longer.

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
        NotConvergedError: the loop moves so slowly that no run tells.
        StepError: the step is longer than a lag that a run comes to.
    """
    if not (math.isfinite(search.command) and search.command != 0.0):
        raise out_of_range("step of the command", search.command, "", "the finite numbers but 0", "give the size of a step")
    runs, worst = 0, Seen(Ending.RESTS)

    def tries(factor: float) -> Ending:
        nonlocal runs, worst
        if progress is not None:
            progress(runs / USUAL_RUNS)
        runs += 1
        seen = _ending(plant, point, scaled_controller(controller, factor), search, wires)
        worst = worst if seen.ending is Ending.RESTS else seen
        return seen.ending

    rests, hunts = _bracket(tries, search.near)
    while rests > 0.0 and math.isfinite(hunts) and hunts > RESOLUTION * rests:
        middle = math.sqrt(rests * hunts)
        if tries(middle) is Ending.RESTS:
            rests = middle
        else:
            hunts = middle
    return GainReserve(place=place, factor=rests, hunts=hunts, ending=worst.ending, period=worst.period, runs=runs)


def _bracket(tries: Callable[[float], Ending], near: float | None) -> tuple[float, float]:
    """Change the factor until one rests and one hunts; 0 or infinity where none does within what is tried.

    The loop's own gains come first, then the factor at which hunting is expected to begin, then more or less in growing steps.
    """
    if tries(1.0) is not Ending.RESTS:
        return _fall(tries, 1.0, 2.0)
    if near is None or not NEARBY < near < LARGEST:
        return _rise(tries, 1.0, 2.0)
    if tries(near / NEARBY) is Ending.RESTS:
        return _rise(tries, near / NEARBY, FIRST_PACE)
    rests, hunts = _fall(tries, near / NEARBY, FIRST_PACE, least=1.0)
    return max(rests, 1.0), hunts


def _rise(tries: Callable[[float], Ending], rests: float, pace: float) -> tuple[float, float]:
    while rests * pace <= LARGEST:
        if tries(rests * pace) is not Ending.RESTS:
            return rests, rests * pace
        rests, pace = rests * pace, min(2.0, pace * pace)
    return rests, math.inf


def _fall(tries: Callable[[float], Ending], hunts: float, pace: float, least: float = 1.0 / LARGEST) -> tuple[float, float]:
    while hunts / pace >= least:
        if tries(hunts / pace) is Ending.RESTS:
            return hunts / pace, hunts
        hunts, pace = hunts / pace, min(2.0, pace * pace)
    return 0.0, hunts


def _ending(plant: DelaySystem, point: OperatingPoint, controller: AnyController, search: ReserveSearch, wires: LoopSignals) -> Seen:
    """Tell how a run ends, made longer until it tells.

    Raises:
        NotConvergedError: the longest does not.
    """
    for doubled in range(LONGEST + 1):
        run = _try(plant, point, controller, replace(search, until=2.0**doubled * search.until), wires)
        if run is None:
            return Seen(Ending.STALLS)
        for seen in judge_ending(run, search.command, long=doubled >= LONG):
            return seen
    longest = 2.0**LONGEST * search.until
    message = (
        f"no run of {search.until:g} to {longest:g} s tells whether the loop comes to rest or hunts: it moves too slowly; give longer runs"
    )
    raise NotConvergedError(message, until=longest)


def _try(
    plant: DelaySystem, point: OperatingPoint, controller: AnyController, search: ReserveSearch, wires: LoopSignals
) -> SampledRun | None:
    """Run a loop; none where the plant stalls or diverges, which is no rest. A step longer than a lag is no fault of the loop."""
    task = SampledTask(command=signals.step(search.command), until=search.until, step=search.step)
    try:
        return run_sampled_loop(plant, point, controller, task, wires=wires)
    except StepError:
        raise
    except (StalledError, LagError, DivergedError):
        return None
