"""The limit cycle of a loop as one question asks for it: run to its end, its orbit, and how hunting begins."""

from typing import TYPE_CHECKING

from revline.errors import InvalidInputError
from revline.studies.loop_runs import own_limits, throttle_limits

if TYPE_CHECKING:
    from revline.analysis.trim import Trim
    from revline.design.loops.closed_loop import LoopRun, LoopTask
    from revline.design.loops.hunting import HuntingOrbit, UnrefinedCycle
    from revline.design.loops.onset import HuntingOnset
    from revline.io.controller_files import ControllerFile
    from revline.system import DelaySystem

AMPLE = 1.15
"""The family from the onset is followed to this multiple of the cycle's amplitude, so that it passes the gains given."""

WITHOUT_CYCLE = 0.03
"""Where the loop does not hunt, it is followed to this part of the speed."""


def run_until_decided(
    engine: "DelaySystem", trim: "Trim", file: "ControllerFile", task: "LoopTask", *, name: str, remedy: str
) -> "LoopRun":
    """Run a controller's loop until it is known how it ends, within the controller's limits, else those of the engine's throttle.

    Args:
        engine: with the inputs of Lee's engine.
        trim: where the loop begins.
        file: the controller.
        task: step of the command, and how long it is run at least.
        name: what holds the controller, for messages.
        remedy: what can be asked where the controller samples.

    Raises:
        InvalidInputError: the controller samples.
    """
    from revline.design.controllers.pid_controller import Continuous
    from revline.design.loops.closed_loop import Limits
    from revline.design.loops.hunting import run_to_its_end
    from revline.design.plants.loop_signals import operating_point
    from revline.engine.lee1995 import lee1995_parameters

    if not isinstance(file.controller.sampling, Continuous):
        message = (
            f"{name} holds a controller that samples; samples fall differently into each cycle, which then is no orbit of the engine "
            f"alone: {remedy}"
        )
        raise InvalidInputError(message, control="controller")
    limits = Limits(*throttle_limits(own_limits(file.controller), lee1995_parameters(engine).throttle.saturation_angle))
    return run_to_its_end(engine, operating_point(trim), file.feedback_gains, task, limits=limits)


def find_orbit(engine: "DelaySystem", trim: "Trim", run: "LoopRun") -> "HuntingOrbit | UnrefinedCycle | None":
    """Compute the cycle that a run ended in as an orbit; none where it ended otherwise."""
    from revline.design.loops.hunting import refine_cycle
    from revline.design.loops.outcome import LimitCycle
    from revline.design.plants.loop_signals import operating_point

    return refine_cycle(engine, operating_point(trim), run) if isinstance(run.outcome, LimitCycle) else None


def find_onset_of(engine: "DelaySystem", trim: "Trim", run: "LoopRun", orbit: "HuntingOrbit | UnrefinedCycle | None") -> "HuntingOnset":
    """Find at which multiple of all gains hunting begins, and follow its cycles beyond the one that was found.

    Args:
        engine: with the inputs of Lee's engine.
        trim: where the loop began.
        run: of the loop.
        orbit: that it ended in, if it did.
    """
    from revline.design.loops.hunting import UnrefinedCycle
    from revline.design.loops.onset import RayTask, find_onset

    if orbit is None:
        largest = WITHOUT_CYCLE * run.start
    else:
        largest = AMPLE * (orbit.simulated.amplitude if isinstance(orbit, UnrefinedCycle) else float(orbit.harmonics[0]))
    return find_onset(engine, trim, run.gains, RayTask(command=run.command, largest=largest), limits=run.limits)
