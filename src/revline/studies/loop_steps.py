"""Closed loops and time-domain errors: how the linear models' promises hold on the engine. Source: Lee (1995), chapters 5 and 6."""

import math
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from revline import signals
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits, LoopRun, LoopTask, run_linear_loop, run_loop
from revline.design.plants.loop_signals import OperatingPoint
from revline.design.stability.linear_loop import measure_closed_loop
from revline.design.stability.loop_stability import judge_loop_stability
from revline.engine.lee1995 import lee1995_parameters
from revline.errors import AnalysisError, NotSettledError
from revline.lti.transfer_function import TransferFunction
from revline.studies.config import StudyConfig
from revline.studies.results import ControllersResult, ErrorRecord, ErrorsResult, Floats, LoopRow, LoopsResult, ModelsResult, PointResult
from revline.studies.steps import STEP_AT, in_short_steps, throttle_run
from revline.system import DelaySystem

PAIRS = (
    ("c1", ("g1", "g2", "g2d", "engine")),
    ("c2_zn", ("g2", "engine")),
    ("c2_zn_with_gain", ("g2", "engine")),
    ("c2", ("g2", "g2d", "engine")),
    ("c2d_zn", ("g2d", "engine")),
    ("c2d_zn_with_gain", ("g2d", "engine")),
    ("c2d", ("g2d", "engine")),
    ("c2d_reduced", ("g2", "engine")),
)
"""Which controller is run on which plants."""

HORIZONS = ((8.0, 1e-3), (25.0, 1e-3), (80.0, 1e-3), (60.0, 2.5e-4))
"""How long, and in which steps, a loop is run until it can be told how it ends, in s."""

ERROR_SINES = (10.0, 30.0)
"""Frequencies of the sinusoids of Figs 6.4 and 6.5 in Lee (1995), in rad/s."""

ERROR_MODELS = ("g1", "g2", "g2d")


def run_loops(
    engine: DelaySystem, point: PointResult, models: ModelsResult, controllers: ControllersResult, config: StudyConfig
) -> LoopsResult:
    """Run every pair of controller and plant with a command worth the study's throttle amplitude."""
    command = config.command_rad_s or round_to_two(point.gain * config.amplitude_deg)
    rows = []
    for controller, plants in PAIRS:
        gains = controllers.gains[controller]
        for plant in plants:
            run = _run_until_decided(engine, point, models, gains, plant, command)
            bandwidth = 0.0
            if plant != "engine" and judge_loop_stability(models.fit(plant).fit.model, gains).stable:
                bandwidth = measure_closed_loop(models.fit(plant).fit.model, gains).bandwidth
            rows.append(LoopRow(controller, plant, run, bandwidth))
    return LoopsResult(command=command, rows=tuple(rows))


def round_to_two(value: float) -> float:
    """Round to two significant digits, as a person would choose a command.

    Raises:
        AnalysisError: the value is 0, and no command.
    """
    if value == 0.0:
        message = "the throttle does not move the speed at this operating point, so that its amplitude is worth no command; choose another"
        raise AnalysisError(message)
    size = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    return round(value / size) * size


def operating_point(point: PointResult) -> OperatingPoint:
    """Where the engine's loops start."""
    inputs = {v.name: float(value) for v, value in zip(point.trim.input_variables, point.trim.inputs, strict=True)}
    return OperatingPoint(states=point.trim.states, inputs=inputs, measurement=point.trim.output("engine_speed"))


def throttle_limits(engine: DelaySystem) -> Limits:
    """Limits of the controllers: closed, and the angle beyond which the throttle opens no further."""
    return Limits(0.0, lee1995_parameters(engine).throttle.saturation_angle)


def _run_until_decided(
    engine: DelaySystem, point: PointResult, models: ModelsResult, gains: PidGains, plant: str, command: float
) -> LoopRun:
    for position, (until, step) in enumerate(HORIZONS):
        try:
            return _run_once(engine, point, models, gains, plant, LoopTask(command=command, until=until, step=step))
        except NotSettledError:
            if position == len(HORIZONS) - 1:
                raise
    raise AssertionError  # the loop above returns or raises


def _run_once(engine: DelaySystem, point: PointResult, models: ModelsResult, gains: PidGains, plant: str, task: LoopTask) -> LoopRun:
    if plant == "engine":
        start, limits = operating_point(point), throttle_limits(engine)
        return in_short_steps(
            lambda pieces: run_loop(engine, start, gains, replace(task, step=task.step / pieces), limits=limits),
            task.step,
            point.trim.lags,
        )
    coarse = LoopTask(command=task.command, until=task.until, step=max(task.step, task.until / 4000.0))
    model = models.fit(plant).fit.model
    return run_linear_loop(model, gains, coarse, name=plant, base=(point.trim.input("throttle"), point.trim.output("engine_speed")))


def find_errors(engine: DelaySystem, point: PointResult, models: ModelsResult, config: StudyConfig) -> ErrorsResult:
    """Compare engine and linear models in time, after a step and under sinusoids."""
    records = (
        _compare(engine, point, models, signals.step(config.amplitude_deg, start=STEP_AT), config, 0.0),
        *(_compare(engine, point, models, signals.sine(config.amplitude_deg, w), config, w) for w in ERROR_SINES),
    )
    return ErrorsResult(records=records, equal_frequency=_equal_frequency(models))


def _compare(
    engine: DelaySystem, point: PointResult, models: ModelsResult, signal: signals.Signal, config: StudyConfig, frequency: float
) -> ErrorRecord:
    cycles = 10.0 * 2.0 * math.pi / frequency if frequency else 0.0
    until = max(4.0, cycles)
    run = throttle_run(engine, point.trim, signal, until)
    start = 0.0 if frequency else STEP_AT
    answers = []
    for name in ERROR_MODELS:
        model = models.fit(name).fit.model
        answers.append(
            config.amplitude_deg * (sine_answer(model, frequency, run.times) if frequency else step_answer(model, run.times - start))
        )
    return ErrorRecord(
        kind="sine" if frequency else "step",
        frequency=frequency,
        start=start,
        times=run.times,
        speed=run.output("engine_speed") - point.trim.output("engine_speed"),
        models=ERROR_MODELS,
        answers=np.array(answers),
        judged_from=until / 2.0 if frequency else 0.0,
    )


def step_answer(model: TransferFunction, times: Floats) -> Floats:
    """Exact answer to a unit step at time 0."""
    after = times >= 0.0
    answer = np.zeros_like(times)
    answer[after] = model.step_response(times[after])
    return answer


def sine_answer(model: TransferFunction, frequency: float, times: Floats) -> Floats:
    """Exact answer to sin(wt) from rest: the impulse response of the model behind w/(s^2 + w^2)."""
    source = TransferFunction(
        numerator=(frequency,), denominator=(frequency**2, 0.0, 1.0), input_unit=model.input_unit, output_unit=model.input_unit
    )
    return source.series(model).impulse_response(times)


def _equal_frequency(models: ModelsResult) -> float:
    """Frequency in rad/s, from 5 to 60, at which G2 and G2d err alike, or 0; the response is read by a cubic spline in log frequency."""
    response = models.response
    logarithm = CubicSpline(np.log(response.omega), np.log(response.magnitude) + 1j * np.deg2rad(response.phase_deg))

    def advantage(log_omega: float) -> float:
        truth = np.exp(logarithm(log_omega))
        s = 1j * math.exp(log_omega)
        g2, g2d = (complex(models.fit(name).fit.model(s)) for name in ("g2", "g2d"))
        return float(abs(g2 - truth) - abs(g2d - truth))

    low, high = math.log(max(response.omega[0], 5.0)), math.log(min(response.omega[-1], 60.0))
    if low >= high or advantage(low) * advantage(high) > 0.0:
        return 0.0
    return math.exp(float(brentq(advantage, low, high)))
