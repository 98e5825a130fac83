"""How the command loop runs what it was given: continuous or sampled, on an engine or on a linear model."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from revline.cli.controllers import TimingChoice, own_limits, read_any_controller, sample
from revline.cli.options import DEFAULT_ENGINE
from revline.cli.plants import EngineChoice, find_engine_trim
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError, out_of_range

if TYPE_CHECKING:
    from revline.design.controllers.pid_controller import PidController
    from revline.design.controllers.scheduled_pid import AnyController
    from revline.design.loops.closed_loop import LoopRun, LoopTask
    from revline.design.loops.linear_verdict import LinearVerdict
    from revline.design.loops.load_response import LoadStep
    from revline.design.loops.sampled_loop import Disturbance
    from revline.design.loops.sampled_step import SampledStep

WIDE_OPEN = 90.0
"""Largest throttle angle [deg]."""

WANTING = "a loop around an engine needs --throttle, the angle [deg] of the trim that it starts from"


class LoopOptions(NamedTuple):
    """What the command's options say of a loop."""

    choice: EngineChoice
    limits: tuple[float | None, float | None]
    timing: TimingChoice
    disturbance: "Disturbance"
    load: "LoadStep | None"
    samples: Path | None


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


def run_files(files: list[Path], task: "LoopTask", options: LoopOptions) -> LoopResult:
    """Run the controller of the last file on the model of the first, or on the engine.

    Raises:
        InvalidInputError: files and options make no loop.
        AnalysisError: the loop cannot be run, or its record does not decide.
    """
    from revline.design.controllers.scheduled_pid import ScheduledController

    _check_files(files, options)
    controller = _controller(files[-1], options)
    if len(files) == 1:
        return _run_engine(controller, task, options)
    if isinstance(controller, ScheduledController):
        message = f"{files[-1].name} holds a gain schedule over signals that a linear model does not have; run it on an engine"
        raise InvalidInputError(message)
    return _run_model(files[0], controller, task, options)


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


def _check_files(files: list[Path], options: LoopOptions) -> None:
    """Refuse files and options that make no loop."""
    engine, throttle, load = options.choice
    if len(files) > 2:
        message = f"{len(files)} files were given; give a controller file, or a model file and a controller file"
        raise InvalidInputError(message)
    if len(files) == 2 and options.limits != (None, None):
        message = "--low and --high limit an engine's throttle; a linear model runs without limits, leave them out"
        raise InvalidInputError(message)
    if len(files) == 2 and options.load is not None:
        message = "--load-step steps an engine's load torque; a linear model has no load, leave it out"
        raise InvalidInputError(message)
    if len(files) == 2 and throttle is None and (load != 0.0 or engine != DEFAULT_ENGINE):
        message = "--engine and --load place a linear model at an engine's trim; give --throttle too, or leave them out"
        raise InvalidInputError(message)
    if len(files) == 1 and throttle is None:
        raise InvalidInputError(WANTING)


def _controller(path: Path, options: LoopOptions) -> "AnyController":
    """The file's controller, sampled as it or the options say; continuous where neither does. A schedule is sampled in any case."""
    from revline.design.controllers.pid_controller import Continuous
    from revline.io.controller_files import read_controller
    from revline.io.json_files import read_json
    from revline.io.schedule_files import is_schedule

    if is_schedule(read_json(path, "controller file")):
        return read_any_controller(path, options.timing)
    found, timing = read_controller(path).controller, options.timing
    if not isinstance(found.sampling, Continuous):
        if timing != TimingChoice(None, None, 0.0):
            message = f"{path.name} says itself when its controller samples; leave --period, --crank-angle and --computation-delay out"
            raise InvalidInputError(message)
        return found
    if timing.period is not None or timing.crank_angle is not None:
        return sample(found, timing)
    alone = [
        ("--computation-delay", timing.computation_delay != 0.0),
        ("--noise", options.disturbance.noise > 0.0),
        ("--jitter", options.disturbance.jitter > 0.0),
        ("--samples", options.samples is not None),
    ]
    wrong = [name for name, given in alone if given]
    if wrong:
        message = f"{', '.join(wrong)} tells of samples, and the controller is continuous; give --period or --crank-angle too"
        raise InvalidInputError(message)
    return found


def _run_engine(controller: "AnyController", task: "LoopTask", options: LoopOptions) -> LoopResult:
    from revline.design.controllers.scheduled_pid import ScheduledController, law_of
    from revline.design.loops.closed_loop import run_loop
    from revline.design.loops.linear_verdict import judge_linear_system
    from revline.design.loops.sampled_step import local_law, run_sampled_step
    from revline.design.plants.loop_signals import operating_point
    from revline.engine.lee1995 import lee1995_parameters

    plant, trim = find_engine_trim(options.choice, WANTING)
    law, point = law_of(controller), operating_point(trim)
    wanted = tuple(option if option is not None else own for option, own in zip(options.limits, own_limits(law), strict=True))
    low, high = throttle_limits((wanted[0], wanted[1]), lee1995_parameters(plant).throttle.saturation_angle)
    law = replace(law, low=low, high=high)
    bounded = replace(controller, controller=law) if isinstance(controller, ScheduledController) else law
    local = local_law(bounded, point)
    found: LoopRun | SampledStep
    if _is_sampled(law):
        found = run_sampled_step(plant, point, bounded, task, disturbance=options.disturbance)
    else:
        found = run_loop(plant, point, law, task)
    return _result(found, options.load, local, lambda: judge_linear_system(plant, trim, local))


def _run_model(path: Path, controller: "PidController", task: "LoopTask", options: LoopOptions) -> LoopResult:
    from revline.design.loops.closed_loop import run_linear_loop
    from revline.design.loops.linear_verdict import judge_linear_model
    from revline.design.loops.sampled_step import run_sampled_linear_step
    from revline.io.loop_records import bandwidth_fields
    from revline.io.model_files import read_model
    from revline.sampled import CrankSynchronous

    file, base = read_model(path), _place(options.choice)
    bounded = math.isfinite(controller.low) or math.isfinite(controller.high)
    if bounded and options.choice.throttle is None:
        message = (
            "the controller's limits are those of the throttle itself, and a model by itself knows deviations only; give --throttle, the "
            "angle [deg] of the trim that the model belongs to, or leave output_low and output_high out of the file"
        )
        raise InvalidInputError(message)
    if options.choice.throttle is None and isinstance(controller.sampling, CrankSynchronous):
        message = (
            "sampling by the crank's angle needs the speed itself; give --throttle, the angle [deg] of the trim that the model belongs to"
        )
        raise InvalidInputError(message)
    if _is_sampled(controller):
        step = run_sampled_linear_step(file.model, controller, task, name=file.name, base=base, disturbance=options.disturbance)
        return _result(step, None, controller, lambda: judge_linear_model(file.model, controller, speed=base[1]))
    run = run_linear_loop(file.model, controller, task, name=file.name, base=base)
    result = _result(run, None, controller, lambda: judge_linear_model(file.model, controller))
    return replace(result, record={**result.record, **bandwidth_fields(file.model, controller)})


def _is_sampled(controller: "PidController") -> bool:
    from revline.design.controllers.pid_controller import Continuous

    return not isinstance(controller.sampling, Continuous)


def _place(choice: EngineChoice) -> tuple[float, float]:
    """Throttle and speed at the trim that a model is placed at; 0 without one."""
    if choice.throttle is None:
        return 0.0, 0.0
    _, trim = find_engine_trim(choice, WANTING)
    return choice.throttle, trim.output("engine_speed")


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
