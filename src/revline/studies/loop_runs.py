"""A closed loop as one question asks for it: a controller as it runs, on an engine or on a linear model, and all that is told of it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from revline.errors import AnalysisError, InvalidInputError, NotConvergedError, out_of_range

if TYPE_CHECKING:
    from revline.analysis.trim import Trim
    from revline.design.controllers.pid_controller import PidController
    from revline.design.controllers.scheduled_pid import AnyController
    from revline.design.loops.closed_loop import LoopRun, LoopTask
    from revline.design.loops.linear_verdict import LinearVerdict
    from revline.design.loops.load_response import LoadStep
    from revline.design.loops.sampled_loop import Disturbance
    from revline.design.loops.sampled_step import SampledStep
    from revline.io.json_files import JsonRecord
    from revline.io.model_files import ModelFile
    from revline.system import DelaySystem

WIDE_OPEN = 90.0
"""Largest throttle angle [deg]."""

PERIOD = 0.005
"""Seconds between samples where neither the file nor an option says when the controller runs."""


class TimingChoice(NamedTuple):
    """What --period, --crank-angle and --computation-delay say."""

    period: float | None
    crank_angle: float | None
    computation_delay: float


class Surroundings(NamedTuple):
    """What a loop is run with beside its controller: limits of the throttle asked for, disturbance, and a step of the load."""

    limits: tuple[float | None, float | None]
    disturbance: "Disturbance"
    load: "LoadStep | None"


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopResult:
    """What was run.

    Attributes:
        run: the loop and how it ended.
        sampled: the same with what its controller did at its samples; none for a continuous controller.
        record: all of it for JSON, but for warnings.
        warnings: what a reader should know.
    """

    run: "LoopRun"
    sampled: "SampledStep | None"
    record: Mapping[str, object]
    warnings: tuple[str, ...]


def controller_as_it_runs(
    record: "JsonRecord", name: str, timing: TimingChoice, disturbance: "Disturbance", *, samples: object = None
) -> "AnyController":
    """Take the controller of a file's content, sampled as it or the options say; continuous where neither does.

    A gain schedule is sampled in any case.

    Args:
        record: the content.
        name: of the file, for messages.
        timing: what the options say of samples.
        disturbance: what is asked for at samples.
        samples: what shall hold the samples, if anything.

    Raises:
        InvalidInputError: file and options do not agree, or options tell of samples and there are none.
    """
    from revline.design.controllers.pid_controller import Continuous
    from revline.io.controller_files import parse_controller
    from revline.io.schedule_files import is_schedule

    if is_schedule(record):
        return any_controller(record, name, timing)
    found = parse_controller(record).controller
    if not isinstance(found.sampling, Continuous):
        if timing != TimingChoice(None, None, 0.0):
            message = f"{name} says itself when its controller samples; leave --period, --crank-angle and --computation-delay out"
            raise InvalidInputError(message)
        return found
    if timing.period is not None or timing.crank_angle is not None:
        return sample(found, timing)
    alone = [
        ("--computation-delay", timing.computation_delay != 0.0),
        ("--noise", disturbance.noise > 0.0),
        ("--jitter", disturbance.jitter > 0.0),
        ("--samples", samples is not None),
    ]
    wrong = [option for option, given in alone if given]
    if wrong:
        message = f"{', '.join(wrong)} tells of samples, and the controller is continuous; give --period or --crank-angle too"
        raise InvalidInputError(message)
    return found


def any_controller(record: "JsonRecord", name: str, choice: TimingChoice) -> "AnyController":
    """Take a controller, or one with a gain schedule; one that does not say when it samples does as the options say, with anti-windup.

    Args:
        record: content of its file.
        name: of the file, for messages.
        choice: the options.

    Raises:
        InvalidInputError: both options are given, or one and the file says itself; or the file is none.
    """
    from revline.io.controller_files import parse_controller
    from revline.io.schedule_files import is_schedule, parse_scheduled

    if not is_schedule(record):
        return _timed(parse_controller(record).controller, name, choice)
    found = parse_scheduled(record, designed_on=name)
    return replace(found, controller=_timed(found.controller, name, choice))


def _timed(controller: "PidController", name: str, choice: TimingChoice) -> "PidController":
    """A file's controller, sampled as it says itself, else as the options say."""
    from revline.design.controllers.pid_controller import Continuous

    if isinstance(controller.sampling, Continuous):
        return sample(controller, choice)
    if choice != TimingChoice(None, None, 0.0):
        message = f"{name} says itself when its controller samples; leave --period, --crank-angle and --computation-delay out"
        raise InvalidInputError(message)
    return controller


def sample(controller: "PidController", choice: TimingChoice) -> "PidController":
    """Give a continuous controller the sampling that the options say, and anti-windup where it has none."""
    from revline.design.controllers.pid_controller import AntiWindup
    from revline.sampled import CrankSynchronous, FixedRate

    period, angle, computation = choice
    if period is not None and angle is not None:
        message = "--period and --crank-angle each say when the controller samples; give one"
        raise InvalidInputError(message)
    windup = AntiWindup.CLAMPING if controller.anti_windup is AntiWindup.NONE else controller.anti_windup
    if angle is not None:
        return replace(controller, sampling=CrankSynchronous(angle=angle, computation_delay=computation), anti_windup=windup)
    timer = FixedRate(period=PERIOD if period is None else period, computation_delay=computation)
    return replace(controller, sampling=timer, anti_windup=windup)


def own_limits(controller: "PidController") -> tuple[float | None, float | None]:
    """Limits that a controller has itself, none where it has none."""
    low, high = controller.low, controller.high
    return low if math.isfinite(low) else None, high if math.isfinite(high) else None


def throttle_limits(wanted: tuple[float | None, float | None], saturation: float) -> tuple[float, float]:
    """Limits asked for, else 0 and where the throttle saturates; refused where no throttle can reach them."""
    low, high = (default if value is None else value for value, default in zip(wanted, (0.0, saturation), strict=True))
    for name, value in (("--low", low), ("--high", high)):
        if not 0.0 <= value <= WIDE_OPEN:
            raise out_of_range(name, value, "deg", f"0 to {WIDE_OPEN:g} deg", "give an angle that the throttle can reach")
    if not low < high:
        message = f"--low = {low:g} deg is not below --high = {high:g} deg; give limits with room between them"
        raise InvalidInputError(message, low=low, high=high)
    return low, high


def load_step_of(size: float | None, at: float | None, until: float) -> "LoadStep | None":
    """Take a step of the load, if there is one, at a third of the stop time where nothing else is said.

    Args:
        size: in N m.
        at: when, in s.
        until: stop time in s.

    Raises:
        InvalidInputError: there is a time and no step, or the step is not within the run.
    """
    from revline.design.loops.load_response import LoadStep

    if size is None:
        if at is not None:
            message = "--load-at says when the load steps, and there is no step; give --load-step too"
            raise InvalidInputError(message)
        return None
    when = until / 3.0 if at is None else at
    if not when < until:
        raise out_of_range("--load-at", when, "s", f"values below the stop time of {until:g} s", "step the load earlier")
    return LoadStep(size=size, at=when)


def loop_task(sizes: tuple[float, float, float], load: "LoadStep | None") -> "LoopTask":
    """Put together what is asked of a loop.

    Args:
        sizes: step of the command in rad/s, stop time and time step in s.
        load: step of the load, if any.
    """
    from revline import signals
    from revline.design.loops.closed_loop import LoopTask

    loads = () if load is None else (("load_torque", signals.step(load.size, start=load.at)),)
    return LoopTask(command=sizes[0], until=sizes[1], step=sizes[2], loads=loads)


def run_on_engine(plant: "DelaySystem", trim: "Trim", controller: "AnyController", task: "LoopTask", around: Surroundings) -> LoopResult:
    """Run a controller on an engine from a trim.

    Raises:
        InvalidInputError: controller and limits make no loop.
        AnalysisError: the loop cannot be run, or its record does not decide.
    """
    from revline.design.controllers.scheduled_pid import ScheduledController, law_of
    from revline.design.loops.closed_loop import run_loop
    from revline.design.loops.linear_verdict import judge_linear_system
    from revline.design.loops.sampled_loop import check_schedule
    from revline.design.loops.sampled_step import local_law, run_sampled_step
    from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, operating_point
    from revline.engine.lee1995 import lee1995_parameters

    law, point = law_of(controller), operating_point(trim)
    wanted = tuple(option if option is not None else own for option, own in zip(around.limits, own_limits(law), strict=True))
    low, high = throttle_limits((wanted[0], wanted[1]), lee1995_parameters(plant).throttle.saturation_angle)
    law = replace(law, low=low, high=high)
    bounded = replace(controller, controller=law) if isinstance(controller, ScheduledController) else law
    check_schedule(plant, bounded, SPEED_BY_THROTTLE)
    local = local_law(bounded, point)
    found: LoopRun | SampledStep
    if _is_sampled(law):
        found = run_sampled_step(plant, point, bounded, task, disturbance=around.disturbance)
    else:
        found = run_loop(plant, point, law, task)
    return _result(found, around.load, local, lambda: judge_linear_system(plant, trim, local))


def run_on_model(
    file: "ModelFile", controller: "PidController", task: "LoopTask", base: tuple[float, float] | None, disturbance: "Disturbance"
) -> LoopResult:
    """Run a controller on a linear model.

    Args:
        file: the model with its name.
        controller: sampled or continuous.
        task: what is asked.
        base: throttle in deg and speed in rad/s at the trim that the model is placed at; none where it stands alone.
        disturbance: at samples.

    Raises:
        InvalidInputError: controller and model make no loop, or the controller needs the trim.
        AnalysisError: the loop cannot be run, or its record does not decide.
    """
    from revline.design.loops.closed_loop import run_linear_loop
    from revline.design.loops.linear_verdict import judge_linear_model
    from revline.design.loops.sampled_step import run_sampled_linear_step
    from revline.io.loop_records import bandwidth_fields
    from revline.sampled import CrankSynchronous

    at = base or (0.0, 0.0)
    bounded = math.isfinite(controller.low) or math.isfinite(controller.high)
    if bounded and base is None:
        message = (
            "the controller's limits are those of the throttle itself, and a model by itself knows deviations only; give --throttle, the "
            "angle [deg] of the trim that the model belongs to, or leave output_low and output_high out of the file"
        )
        raise InvalidInputError(message)
    if base is None and isinstance(controller.sampling, CrankSynchronous):
        message = (
            "sampling by the crank's angle needs the speed itself; give --throttle, the angle [deg] of the trim that the model belongs to"
        )
        raise InvalidInputError(message)
    if _is_sampled(controller):
        step = run_sampled_linear_step(file.model, controller, task, name=file.name, base=at, disturbance=disturbance)
        return _result(step, None, controller, lambda: judge_linear_model(file.model, controller, speed=at[1]))
    run = run_linear_loop(file.model, controller, task, name=file.name, base=at)
    result = _result(run, None, controller, lambda: judge_linear_model(file.model, controller))
    return replace(result, record={**result.record, **bandwidth_fields(file.model, controller)})


def _is_sampled(controller: "PidController") -> bool:
    from revline.design.controllers.pid_controller import Continuous

    return not isinstance(controller.sampling, Continuous)


def _result(
    found: "LoopRun | SampledStep", load: "LoadStep | None", controller: "PidController", judge: "Callable[[], LinearVerdict]"
) -> LoopResult:
    from revline.design.loops.sampled_step import SampledStep
    from revline.io.loop_records import late_load, loop_record, loop_warnings, verdict_fields
    from revline.io.margin_records import controller_fields
    from revline.io.sampled_loop_records import sampled_fields

    run = found.run if isinstance(found, SampledStep) else found
    late: tuple[str, ...] = ()
    if load is not None:  # what the load does to the speed is no overshoot of the command
        late = late_load(run, load)
        run = replace(run, overshoot=run.first_part(load.at).overshoot)
    sampled = replace(found, run=run) if isinstance(found, SampledStep) else None
    record = {**loop_record(run, load), **({} if sampled is None else sampled_fields(sampled))}
    warnings = [*late, *loop_warnings(run), *(() if sampled is None else sampled.notes)]
    try:
        verdict = judge()
    except (AnalysisError, InvalidInputError, NotConvergedError) as error:
        warnings.append(f"whether the linear loop at the operating point is stable was not told: {error}")
    else:
        record |= verdict_fields(verdict)
        warnings += [text for text in (verdict.warning, verdict.slow) if text]
    record |= {"controller": controller_fields(controller), "warnings": warnings}
    return LoopResult(run=run, sampled=sampled, record=record, warnings=tuple(warnings))
