"""Questions about closed loops in time: how they end, and the cycles that they hunt in."""

from collections.abc import Mapping
from typing import Final

from revline.design.controllers.scheduled_pid import ScheduledController
from revline.design.loops.closed_loop import LoopTask
from revline.design.loops.hunting import UnrefinedCycle
from revline.design.loops.sampled_loop import Disturbance
from revline.errors import InvalidInputError
from revline.io.cycle_records import onset_record, orbit_record, run_record, unrefined_record
from revline.studies.cycle_search import find_onset_of, find_orbit, run_until_decided
from revline.studies.loop_runs import (
    LoopResult,
    Surroundings,
    TimingChoice,
    controller_as_it_runs,
    load_step_of,
    loop_task,
    run_on_engine,
    run_on_model,
)
from revline.web.asked.plants import at_trim, content_of, controller_of, model_of
from revline.web.questions import LimitCycleQuestion, LoopQuestion

REMEDY: Final = "the question loop runs it and tells the cycle with its spread"


def find_loop_record(asked: LoopQuestion) -> Mapping[str, object]:
    """Answer as `revline loop --json`, with all samples as `series` beside where they are asked for."""
    result = _run(asked)
    if not asked.series:
        return result.record
    run = result.run
    return {**result.record, "series": {"time_s": run.times, "speed_rad_s": run.output, "throttle_deg": run.control}}


def _run(asked: LoopQuestion) -> LoopResult:
    disturbance = Disturbance(noise=asked.noise_rad_s, jitter=asked.jitter_s, seed=asked.seed)
    timing = TimingChoice(asked.period_s, asked.crank_angle_rad, asked.computation_delay_s)
    load = load_step_of(asked.load_step_n_m, asked.load_at_s, asked.until_s)
    controller = controller_as_it_runs(content_of(asked.controller), "controller", timing, disturbance)
    task = loop_task((asked.step_rad_s, asked.until_s, asked.time_step_s), load)
    model = model_of(asked)
    if model is None:
        place = at_trim(asked, asked.throttle_deg)
        around = Surroundings((asked.low_deg, asked.high_deg), disturbance, load)
        return run_on_engine(place.engine, place.trim, controller, task, around)
    _check_model(asked)
    if isinstance(controller, ScheduledController):
        message = "controller holds a gain schedule over signals that a linear model does not have; run it on an engine"
        raise InvalidInputError(message, control="controller")
    base = None
    if asked.throttle_deg is not None:
        base = asked.throttle_deg, at_trim(asked, asked.throttle_deg).trim.output("engine_speed")
    return run_on_model(model, controller, task, base, disturbance)


def _check_model(asked: LoopQuestion) -> None:
    """Refuse what a linear model knows nothing of, lest it be ignored."""
    if asked.low_deg is not None or asked.high_deg is not None:
        message = "low_deg and high_deg limit an engine's throttle; a linear model runs without limits, leave them out"
        raise InvalidInputError(message, control="low_deg")
    if asked.load_step_n_m is not None:
        message = "load_step_n_m steps an engine's load torque; a linear model has no load, leave it out"
        raise InvalidInputError(message, control="load_step_n_m")
    if asked.throttle_deg is None and (asked.load_n_m != 0.0 or asked.parameters or asked.engine != "lee1995"):
        message = "engine, parameters and load_n_m place a linear model at an engine's trim; give throttle_deg too, or leave them out"
        raise InvalidInputError(message, control="throttle_deg")


def find_cycle_record(asked: LimitCycleQuestion) -> Mapping[str, object]:
    """Answer as `revline limit-cycle --json`."""
    place = at_trim(asked, asked.throttle_deg)
    task = LoopTask(command=asked.command_rad_s, until=asked.until_s)
    run = run_until_decided(place.engine, place.trim, controller_of(asked.controller), task, name="the request", remedy=REMEDY)
    record, orbit = dict(run_record(run)), find_orbit(place.engine, place.trim, run)
    if orbit is not None:
        record |= unrefined_record(orbit) if isinstance(orbit, UnrefinedCycle) else orbit_record(orbit)
    if asked.onset:
        record |= onset_record(find_onset_of(place.engine, place.trim, run, orbit))
    return record
