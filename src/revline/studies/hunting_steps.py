"""The study's step on hunting: limit cycles computed as orbits of the engine's loops, held against their simulation, and their onset."""

from revline.design.loops.closed_loop import LoopRun
from revline.design.loops.hunting import confirm_cycle
from revline.design.loops.onset import RayTask, find_onset
from revline.design.loops.outcome import LimitCycle
from revline.errors import NotConvergedError, RevlineError
from revline.studies.hunting_results import CycleRow, HuntingResult, NoCycle, OnsetRow
from revline.studies.loop_steps import operating_point, throttle_limits
from revline.studies.results import ControllersResult, LoopsResult, PointResult
from revline.system import DelaySystem

CONTROLLERS = ("c1", "c2", "c2d")
ONSET_OF = ("c1",)
"""Controllers whose onset is looked for; C2's kd leaves nothing to be stabilised."""

LARGEST = 0.2
"""Up to this part of the command the amplitude of cycles is followed from the onset on."""


def find_hunting(engine: DelaySystem, point: PointResult, controllers: ControllersResult, loops: LoopsResult) -> HuntingResult:
    """Compute the limit cycle of every controller that hunts on the engine, and how its hunting begins.

    Raises:
        AnalysisError: a cycle computed and its simulation disagree; the message has the numbers.
    """
    hunting = [name for name in CONTROLLERS if isinstance(loops.row(name, "engine").run.outcome, LimitCycle)]
    cycles = [_cycle(engine, point, name, loops.row(name, "engine").run) for name in hunting]
    onsets = [_onset(engine, point, controllers, loops, name) for name in hunting if name in ONSET_OF]
    return HuntingResult(
        cycles=tuple(row for row in cycles if isinstance(row, CycleRow)),
        without_cycle=tuple(row for row in cycles if isinstance(row, NoCycle)),
        onsets=tuple(row for row in onsets if isinstance(row, OnsetRow)),
        without_onset=tuple(row for row in onsets if isinstance(row, NoCycle)),
    )


def _cycle(engine: DelaySystem, point: PointResult, name: str, run: LoopRun) -> CycleRow | NoCycle:
    try:
        orbit = confirm_cycle(engine, operating_point(point), run)
    except NotConvergedError as error:
        return NoCycle(name, str(error))
    last = run.times >= run.times[-1] - orbit.period
    return CycleRow(
        controller=name,
        low=orbit.low,
        high=orbit.high,
        control_low=orbit.control_low,
        control_high=orbit.control_high,
        period=orbit.period,
        error=orbit.cycle.error,
        stable=orbit.cycle.stable,
        multiplier=orbit.cycle.largest,
        multiplier_error=orbit.cycle.multiplier_error,
        at_low=orbit.at_low,
        at_high=orbit.at_high,
        gap=orbit.gap,
        tolerance=orbit.tolerance,
        speed=orbit.wave("engine_speed"),
        control=orbit.wave("control"),
        simulated_speed=run.output[last],
        simulated_control=run.control[last],
    )


def _onset(engine: DelaySystem, point: PointResult, controllers: ControllersResult, loops: LoopsResult, name: str) -> OnsetRow | NoCycle:
    task = RayTask(command=loops.command, largest=LARGEST * abs(loops.command))
    try:
        found = find_onset(engine, point.trim, controllers.gains[name], task, limits=throttle_limits(engine))
    except RevlineError as error:
        return NoCycle(name, str(error))
    return OnsetRow(
        controller=name,
        factor=found.factor,
        frequency=found.frequency,
        kind=found.kind,
        lowest_factor=found.lowest_factor,
        throttle=found.rest.inputs["throttle"],
        speed=found.rest.measurement,
        points=found.points,
    )
