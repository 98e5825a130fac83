"""How a sampled loop's run after a step of its command ends: at rest, hunting, or drifting away; or that it is too short to tell."""

import math
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.scheduled_pid import law_of
from revline.design.loops.sampled_loop import SampledRun
from revline.design.loops.time_series import Series, upward_crossings
from revline.units import Seconds

Floats = NDArray[np.float64]

QUIET = 1e-3
"""A loop that moves by less than this part of the command in the last fifth of its run is at rest."""

RESOLVED = 2.5
"""A loop whose quantised output moves by no more of its steps than this is at rest: no law holds it better."""

FADING = 0.5
"""A loop whose swing falls below this part of itself from one fifth of its run to the next comes to rest."""

FADED = 0.02
"""A short run must have faded below this part of the command: a large swing may fade to a smaller one that stays."""

STEADY = 0.98
"""In a long run, a swing that keeps more than this part of itself is hunting."""

FEWEST_PERIODS = 4
"""So many periods in the last two fifths of a run make an oscillation whose swing is measured."""

FEWEST_SAMPLES = 4
"""So many samples of the controller in the last fifth tell what it does there."""

ENOUGH_PERIODS = 20
"""A long run has so many periods in its last two fifths at least."""

CREEPING = 1.1
"""A loop whose way is no longer than its range, but for this factor, creeps: it goes one way."""


class Ending(Enum):
    """How a run ends."""

    RESTS = "comes to rest"
    HUNTS = "hunts"
    DRIFTS = "drifts away, or its output stays at a limit"
    STALLS = "stalls or diverges"


class Seen(NamedTuple):
    """How a run ends, and the period of its hunting; infinite where it does not hunt."""

    ending: Ending
    period: Seconds = math.inf


def judge_ending(run: SampledRun, command: float, *, long: bool) -> tuple[Seen, ...]:
    """Tell how a run ends.

    Args:
        run: without noise, after a step of its command.
        command: size of the step.
        long: whether the run is long enough to call a swing that hardly fades hunting, and a way that grows shorter rest.

    Returns:
        One ending; none where the run is too short to tell.
    """
    parts = np.array_split(run.output, 5)
    quiet = QUIET * abs(command) + 2.0 * law_of(run.controller).measurement_step
    if np.count_nonzero(_last(run)) < FEWEST_SAMPLES or (not long and np.ptp(run.output) <= quiet):  # the plant's delay is not over
        return ()
    if _is_held(run, quiet):
        return (Seen(Ending.DRIFTS),)
    if np.ptp(parts[-1]) <= quiet or _is_resolved(run):
        return (Seen(Ending.RESTS),)
    crossings = _crossings(run)
    if crossings.size > FEWEST_PERIODS:
        return _judge_swing(run, crossings, 0.0 if long else FADED * abs(command))
    creeps = float(np.sum(np.abs(np.diff(run.output[_late(run)])))) <= CREEPING * float(np.ptp(run.output[_late(run)]))
    return _judge_creeping(run, float(np.ptp(parts[-2])), float(np.ptp(parts[-1])), long=long) if creeps else ()


def _late(run: SampledRun) -> NDArray[np.bool_]:
    """The last two fifths."""
    return run.times >= 0.6 * run.times[-1]


def _last(run: SampledRun) -> NDArray[np.bool_]:
    """The controller's samples in the last fifth."""
    return run.sampled.times >= 0.8 * run.times[-1]


def _is_held(run: SampledRun, quiet: float) -> bool:
    """Whether nothing is controlled in the last fifth: the output stays at a limit, or the integral at its bound, off the target."""
    last = _last(run)
    if np.all(run.at_low_limit[last]) or np.all(run.at_high_limit[last]):
        return True
    integral, law = run.of_controller("integral"), law_of(run.controller)
    error = run.sampled.commands[last, 0] - run.of_controller("measurement_used")[last]
    stays = np.ptp(integral) > 0.0 and np.ptp(integral[last]) <= 1e-12 * float(np.max(np.abs(integral)))
    return bool(stays and np.min(np.abs(error)) > law.dead_zone + quiet)


def _is_resolved(run: SampledRun) -> bool:
    """Whether a quantised output moves by its resolution alone in the last fifth."""
    step = law_of(run.controller).output_step
    control = run.of_controller("control")[_last(run)]
    return step > 0.0 and float(np.ptp(control)) <= RESOLVED * step


def _crossings(run: SampledRun) -> Floats:
    """Times in the last two fifths at which the output passes its middle upwards."""
    series = Series(run.times[_late(run)], run.output[_late(run)])
    level = float(series.values.max() + series.values.min()) / 2.0
    return upward_crossings(series, level, 0.05 * float(np.ptp(series.values)))


def _judge_swing(run: SampledRun, crossings: Floats, faded: float) -> tuple[Seen, ...]:
    """Judge an oscillation by its swing about the mean of half a period before and after it, in which what creeps beside has no part.

    `faded` is the swing below which a short run shows that it fades; 0 for a long run, in which any fading does.
    """
    period = float(np.mean(np.diff(crossings)))
    half = max(1, round(0.5 * period / float(run.times[1] - run.times[0])))
    output = run.output[_late(run)]
    swing = output[half:-half] - 0.5 * (output[: -2 * half] + output[2 * half :])
    before, last = (float(np.ptp(part)) for part in np.array_split(swing, 2))
    if last < FADING * before and (last < faded or faded == 0.0):
        return (Seen(Ending.RESTS),)
    if last >= before:
        return (Seen(Ending.HUNTS, period),)
    if faded > 0.0 or crossings.size <= ENOUGH_PERIODS:
        return ()
    return (Seen(Ending.HUNTS, period),) if last > STEADY * before else (Seen(Ending.RESTS),)


def _judge_creeping(run: SampledRun, before: float, last: float, *, long: bool) -> tuple[Seen, ...]:
    """Judge a loop that goes one way.

    It comes to rest where its way towards its target grows shorter, and drifts where it grows and leads further off than the run began.
    """
    error = np.abs(run.output[_late(run)] - run.command[-1])
    nearer = bool(error[-1] <= error[0])
    if nearer and (last < FADING * before or (long and last < before)):
        return (Seen(Ending.RESTS),)
    far = bool(error[-1] > abs(run.command[-1] - run.start))
    return (Seen(Ending.DRIFTS),) if long and last >= before and far and not nearer else ()
