"""Answers in time for a view: the nonlinear engine and its linear models after a step of command, load or throttle."""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.design.controllers.controller import PidGains
from revline.design.loops.classify import classify_outcome
from revline.design.loops.closed_loop import Limits, LoopTask, record_loop, trace_linear_loop
from revline.design.loops.hunting import UnrefinedCycle, refine_cycle, run_to_its_end
from revline.design.loops.loop_run import LoopRun
from revline.design.loops.loop_simulation import LoopRecord, LoopTrace, describe_stall
from revline.design.loops.outcome import LimitCycle
from revline.design.loops.step_measures import measure_overshoot
from revline.design.plants.loop_signals import operating_point
from revline.errors import InvalidInputError, NotSettledError, RevlineError, SimulationError
from revline.io.cycle_records import orbit_record, run_record, unrefined_record
from revline.io.loop_records import loop_record
from revline.studies.steps import LAG_SHARE, in_short_steps, throttle_run
from revline.system import DelaySystem
from revline.web.plants import MODELS, Place, Point, check_amplitude, find_point, fit_model, gains_of, limits_of, loop_with_model, place_of
from revline.web.state import State
from revline.web.view.drawing import drawn, thin

Floats = NDArray[np.float64]

STEP: Final = 1e-3
"""Step in s of the engine's simulation where its lags allow it."""

MOST_STEPS: Final = 10_000
"""A model's answer is computed in steps of 1 ms, or so many where it lasts longer."""

LEAST_SHOWN: Final = 0.02
"""A run that ends earlier than this, in s, is not shown."""

LONGER: Final = 4.0
"""Where the time shown after a load's step does not decide how it ends, so many times it is run."""

BEYOND: Final = 20.0
"""An unstable model's answer is drawn until it is this many times the step away."""


def view_loop(state: State) -> Mapping[str, Any]:
    """Give the engine's answer to the step that the state names."""
    if state.step == "throttle":
        return _throttle_answer(state)
    if state.step == "load":
        return _load_answer(state)
    _check_command(state)
    return _engine_answer(state)


def view_answers(state: State) -> Mapping[str, Any]:
    """Give the fitted models' answers to the step; of a load they know nothing."""
    if state.step == "load":
        return {}
    if state.step == "throttle":
        _check_throttle_step(state)
    else:
        _check_command(state)
    check_amplitude(state, find_point(place_of(state)))
    answer = _model_to_throttle if state.step == "throttle" else _model_answer
    found: dict[str, Any] = {}
    for name in MODELS:
        try:
            found[name] = answer(state, name)
        except RevlineError as error:
            found[name] = {"problem": str(error)}
    return found


def view_cycle(state: State) -> Mapping[str, Any]:
    """Give the limit cycle that the loop hunts in after a step of its command, as `revline limit-cycle --json` does."""
    run = _run(*_asked(state))
    record = dict(run_record(run))
    if not isinstance(run.outcome, LimitCycle):
        return record
    point = find_point(place_of(state))
    found = refine_cycle(point.engine, operating_point(point.trim), run)
    return {**record, **(unrefined_record(found) if isinstance(found, UnrefinedCycle) else orbit_record(found))}


def _check_command(state: State) -> None:
    if state.command_rad_s == 0.0:
        message = "command_rad_s = 0 rad/s moves nothing; give a size other than 0"
        raise InvalidInputError(message, control="command_rad_s")


def _engine_answer(state: State) -> Mapping[str, Any]:
    place, gains, limits, command, until = _asked(state)
    try:
        run = _run(place, gains, limits, command, until)
    except NotSettledError as error:
        point = find_point(place)
        task = LoopTask(command=command, until=until, step=_step_of(point))
        _, record = record_loop(point.engine, operating_point(point.trim), _gains(gains), task, limits=limits)
        trace = record.trace
        return {"undecided": str(error), **_trace(trace.times, trace.output, trace.control)}
    shown = run.first_part(until) if run.times[-1] > until else run
    return {**loop_record(run), **_trace(shown.times, shown.output, shown.control), "limits_deg": list(run.limits)}


def _asked(state: State) -> tuple[Place, tuple[float, float, float], Limits, float, float]:
    place = place_of(state)
    limits = limits_of(state, find_point(place))
    return place, (state.kp, state.ki, state.kd), limits, state.command_rad_s, state.until_s


def _gains(values: tuple[float, float, float]) -> PidGains:
    kp, ki, kd = values
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="the workbench")


@lru_cache(maxsize=32)
def _run(place: Place, gains: tuple[float, float, float], limits: Limits, command: float, until: float) -> LoopRun:
    point = find_point(place)
    task = LoopTask(command=command, until=until, step=_step_of(point))
    return run_to_its_end(point.engine, operating_point(point.trim), _gains(gains), task, limits=limits)


def _step_of(point: Point) -> float:
    """Step in s that the lags at rest allow."""
    return min(STEP, LAG_SHARE * float(min(point.trim.lags, default=math.inf)))


def _model_step(until: float) -> float:
    return max(STEP, until / MOST_STEPS)


def _model_answer(state: State, name: str) -> Mapping[str, Any]:
    place, gains = place_of(state), gains_of(state)
    model = fit_model(place, state.amplitude_deg, name).fit.model
    point = find_point(place)
    start, rest = point.trim.output("engine_speed"), point.trim.input("throttle")
    trace = trace_linear_loop(model, gains, LoopTask(command=state.command_rad_s, until=state.until_s, step=_model_step(state.until_s)))
    far = np.flatnonzero(np.abs(trace.output) > BEYOND * abs(state.command_rad_s))
    if far.size:
        trace = trace.first(max(int(far[0]), 2))
    stable = loop_with_model(state, name).stable
    record: dict[str, Any] = {"stable": stable}
    command = state.command_rad_s
    if stable and int(np.argmax(trace.output * np.sign(command))) < trace.output.size - 1:  # else it may go on rising
        record["overshoot"] = measure_overshoot(trace.times, trace.output, start=0.0, target=command, command=command)
    return {**record, **_trace(trace.times, start + trace.output, rest + trace.control)}


def _load_answer(state: State) -> Mapping[str, Any]:
    """The engine's loop after a step of the load alone; models of the throttle's influence know no load."""
    if state.load_step_n_m == 0.0:
        message = "load_step_n_m = 0 N m moves nothing; give a size other than 0"
        raise InvalidInputError(message, control="load_step_n_m")
    point, gains = find_point(place_of(state)), gains_of(state)
    limits = limits_of(state, point)
    loads = (("load_torque", signals.step(state.load_step_n_m)),)

    def run_until(until: float) -> tuple[DelaySystem, LoopRecord]:
        def run(pieces: int) -> tuple[DelaySystem, LoopRecord]:
            task = LoopTask(command=TINY, until=until, step=STEP / pieces, loads=loads)
            return record_loop(point.engine, operating_point(point.trim), gains, task, limits=limits)

        return in_short_steps(run, STEP, point.trim.lags)

    loop, (trace, failure) = run_until(state.until_s)
    start = point.trim.output("engine_speed")
    error = trace.output - start
    worst = int(np.argmax(np.abs(error)))
    outcome = _ended(failure, loop) if failure is not None else _load_outcome(trace, start)
    if "undecided" in outcome:  # nearly at rest, or too few cycles yet: what comes after the time shown decides
        _, (longer, ended) = run_until(LONGER * state.until_s)
        outcome = outcome if ended is not None else _load_outcome(longer, start)
    found: dict[str, Any] = {
        "start_rad_s": start,
        "droop_rad_s": float(abs(error[worst])),
        "droop_at_s": float(trace.times[worst]),
        "end_error_rad_s": float(error[-1]),
        "saturated_share": float(np.mean((trace.control <= limits.low) | (trace.control >= limits.high))),
        "limits_deg": list(limits),
        **outcome,
    }
    return {**found, **_trace(trace.times, trace.output, trace.control)}


def _ended(failure: SimulationError, system: DelaySystem) -> dict[str, str]:
    """How a run ended before its time, in short and in full."""
    try:
        return {"ended": str(describe_stall(failure, system)), "reason": str(failure)}
    except SimulationError:
        return {"ended": f"ends after {float(failure.details['time']):.3g} s", "reason": str(failure)}


def _load_outcome(trace: LoopTrace, start: float) -> dict[str, Any]:
    """How the loop ends after a step of its load, judged by its droop; the integral of the error only where it comes to rest."""
    error = trace.output - start
    worst = int(np.argmax(np.abs(error)))
    if worst == error.size - 1:
        return {"still_moving": True}
    try:
        outcome = classify_outcome(trace.times, trace.output, target=start, command=float(abs(error[worst])))
    except NotSettledError as undecided:
        return {"undecided": str(undecided)}
    if isinstance(outcome, LimitCycle):
        cycle = {"low_rad_s": outcome.low, "high_rad_s": outcome.high, "period_s": outcome.period}
        return {"outcome": outcome.name, "limit_cycle": cycle}
    return {"outcome": outcome.name, "iae_rad": float(np.trapezoid(np.abs(error), trace.times))}


TINY: Final = 1e-12
"""Step of the command in rad/s where the load steps alone: far below what is shown."""


def _check_throttle_step(state: State) -> None:
    size = state.throttle_step_deg
    angle = find_point(place_of(state)).trim.input("throttle")
    if size == 0.0 or not 0.0 <= angle + size <= 90.0:
        message = (
            f"throttle_step_deg = {size:g} deg leads from {angle:.4g} deg to {angle + size:.4g} deg; give a step other than 0 that stays "
            "within 0 to 90 deg"
        )
        raise InvalidInputError(message, control="throttle_step_deg")


def _throttle_answer(state: State) -> Mapping[str, Any]:
    """The engine after a step of its throttle, without a controller; as far as it goes."""
    _check_throttle_step(state)
    point = find_point(place_of(state))
    signal = signals.step(state.throttle_step_deg)
    record: dict[str, Any] = {"open_loop": True, "start_rad_s": point.trim.output("engine_speed")}
    try:
        run = throttle_run(point.engine, point.trim, signal, state.until_s)
    except SimulationError as error:
        lasted = STEP * (math.floor(float(error.details.get("time", 0.0)) / STEP) - 1)
        if lasted < LEAST_SHOWN:
            raise
        run = throttle_run(point.engine, point.trim, signal, lasted)
        record |= _ended(error, point.engine)
    return {**record, **_trace(run.times, run.output("engine_speed"), run.input("throttle"))}


def _model_to_throttle(state: State, name: str) -> Mapping[str, Any]:
    point, size = find_point(place_of(state)), state.throttle_step_deg
    model = fit_model(place_of(state), state.amplitude_deg, name).fit.model
    times = np.arange(0.0, state.until_s, _model_step(state.until_s))
    angle, start = point.trim.input("throttle"), point.trim.output("engine_speed")
    return _trace(times, start + size * model.step_response(times), np.full(times.size, angle + size))


def _trace(times: Floats, speed: Floats, throttle: Floats) -> dict[str, Any]:
    kept = thin(times, speed, throttle)
    return dict(zip(("time_s", "speed_rad_s", "throttle_deg"), map(drawn, kept), strict=True))
