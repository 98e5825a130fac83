"""How the command loop runs what it was given: continuous or sampled, on an engine or on a linear model."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from revline.cli.options import DEFAULT_ENGINE
from revline.cli.plants import EngineChoice, find_engine_trim
from revline.errors import InvalidInputError
from revline.studies.loop_runs import LoopResult, Surroundings, TimingChoice, controller_as_it_runs, run_on_engine, run_on_model

if TYPE_CHECKING:
    from revline.design.loops.closed_loop import LoopTask
    from revline.design.loops.load_response import LoadStep
    from revline.design.loops.sampled_loop import Disturbance

WANTING = "a loop around an engine needs --throttle, the angle [deg] of the trim that it starts from"


class LoopOptions(NamedTuple):
    """What the command's options say of a loop."""

    choice: EngineChoice
    limits: tuple[float | None, float | None]
    timing: TimingChoice
    disturbance: "Disturbance"
    load: "LoadStep | None"
    samples: Path | None


def run_files(files: list[Path], task: "LoopTask", options: LoopOptions) -> LoopResult:
    """Run the controller of the last file on the model of the first, or on the engine.

    Raises:
        InvalidInputError: files and options make no loop.
        AnalysisError: the loop cannot be run, or its record does not decide.
    """
    from revline.design.controllers.scheduled_pid import ScheduledController
    from revline.io.json_files import read_json
    from revline.io.model_files import read_model

    _check_files(files, options)
    record = read_json(files[-1], "controller file")
    controller = controller_as_it_runs(record, files[-1].name, options.timing, options.disturbance, samples=options.samples)
    if len(files) == 1:
        plant, trim = find_engine_trim(options.choice, WANTING)
        return run_on_engine(plant, trim, controller, task, Surroundings(options.limits, options.disturbance, options.load))
    if isinstance(controller, ScheduledController):
        message = f"{files[-1].name} holds a gain schedule over signals that a linear model does not have; run it on an engine"
        raise InvalidInputError(message)
    return run_on_model(read_model(files[0]), controller, task, _place(options.choice), options.disturbance)


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


def _place(choice: EngineChoice) -> tuple[float, float] | None:
    """Throttle and speed at the trim that a model is placed at, if it is placed."""
    if choice.throttle is None:
        return None
    _, trim = find_engine_trim(choice, WANTING)
    return choice.throttle, trim.output("engine_speed")
