"""The steps of the study of Lee (1995), each a function from frozen values to a frozen value."""

from collections.abc import Callable, Iterable
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from revline import signals
from revline.analysis.linear_range import LinearRanges, find_linear_ranges
from revline.analysis.linearize import linearize
from revline.analysis.operating_range import LineFit, OperatingRange, find_operating_range, fit_line
from revline.analysis.periodic import Excitation
from revline.analysis.sinestream import Sinestream, find_sinestream
from revline.analysis.steady_map import SteadyMap, find_steady_map
from revline.analysis.threads import Progress
from revline.analysis.trim import Trim, find_trim
from revline.dde.simulate import Options, Start, Trajectory, simulate
from revline.design.controllers.controller import PidGains
from revline.design.fitting.model_choice import choose_model, fit_all_models, judge_model
from revline.design.tuning.fine_tuning import FineTuning, Objective, fine_tune
from revline.design.tuning.rules_step import tune_pi_pole_placement, tune_pid_ziegler_nichols, tune_pid_ziegler_nichols_without_gain
from revline.design.tuning.step_tangent import measure_step_tangent
from revline.engine.lee1995 import lee1995_parameters
from revline.engine.torque import Rotation
from revline.errors import AnalysisError, InvalidInputError, StepError
from revline.lti.response import FrequencyResponse
from revline.studies.config import StartingGains, StudyConfig, read_table_4_1
from revline.studies.results import ControllersResult, ModelsResult, NoRange, PointResult, RangeResult, SineRecord, StepsResult, TimeRecord
from revline.system import DelaySystem

T = TypeVar("T")

STEP = 1e-3
"""Distance of samples, and step of the simulations where the lags allow it, in s. Source: Lee (1995), chapter 3."""

LAG_SHARE = 0.5
"""Part of the shortest lag at the start that a step does not exceed."""

MOST_PIECES = 256
"""Into how many steps the distance of samples is cut at most."""

HELD_INERTIA = 1e12
"""Inertia in kg m2 with which the speed does not move: the pressure's own answer."""

HELD_SPEED = 240.0
"""Speed in rad/s at which the pressure's answer is shown. Source: Lee (1995), Fig. 3.8."""

STEP_AT = 0.5
"""When throttle steps begin, in s. Source: Lee (1995), Figs 3.7-3.9."""

SHOWN_SINE = 0.5
"""Frequency of the sinusoid that is shown in time, in rad/s. Source: Lee (1995), Fig. 4.3."""

REDUCTION = 0.1
"""Part of C2d's proportional gain in the over-reduced case. Source: Lee (1995), section 5.6."""

RANGE_FREQUENCIES, RANGE_AMPLITUDES = 17, 10
"""How many frequencies and amplitudes the linear model's range is looked for at."""

RANGE_TOLERANCE = 0.01
"""Largest error of the straight line, as a fraction of its span, for the range chosen automatically."""


def find_point(engine: DelaySystem, config: StudyConfig) -> PointResult:
    """Find the operating point and its exact small-signal response."""
    trim = find_trim(engine, inputs={"throttle": config.throttle_deg, "load_torque": config.load_n_m})
    model = linearize(engine, trim).model
    return PointResult(
        trim=trim,
        gain=model.static_gain("throttle", "engine_speed"),
        exact=model.response(np.array(config.frequencies), "throttle", "engine_speed"),
    )


def find_range(engine: DelaySystem, config: StudyConfig) -> RangeResult:
    """Find the steady map to 90 deg, the line over the range asked for, and the widest range within a tolerance."""
    low, high = config.throttle_deg - config.half_range_deg, config.throttle_deg + config.half_range_deg
    angles = np.unique(np.concatenate([np.arange(0.0, 91.0), [low, high, config.throttle_deg]]))
    steady_map = find_steady_map(
        engine,
        sweep_input="throttle",
        values=angles[(angles >= 0.0) & (angles <= 90.0)],
        output="engine_speed",
        inputs={"load_torque": config.load_n_m},
    )
    return RangeResult(
        steady_map=steady_map,
        line=_line(steady_map, low, high),
        widest=_widest(steady_map, config.throttle_deg),
    )


def _line(steady_map: SteadyMap, low: float, high: float) -> LineFit:
    try:
        return fit_line(steady_map, low=low, high=high)
    except InvalidInputError as error:
        message = f"study.half_range_deg: {error}; give another half_range_deg or throttle_deg"
        raise InvalidInputError(message, **error.details) from error


def _widest(steady_map: SteadyMap, centre: float) -> OperatingRange | NoRange:
    try:
        return find_operating_range(steady_map, centre=centre, tolerance=RANGE_TOLERANCE)
    except AnalysisError as error:
        return NoRange(tolerance=RANGE_TOLERANCE, reason=str(error))


def run_steps(engine: DelaySystem, point: PointResult, config: StudyConfig) -> StepsResult:
    """Simulate throttle steps from the operating point, with the speed free and with it held."""
    trim = point.trim
    speed = HELD_SPEED if config.is_the_thesis else trim.output("engine_speed")
    rest = find_trim(engine, inputs={"throttle": config.throttle_deg}, outputs={"engine_speed": speed}, free=("load_torque",))
    parameters = lee1995_parameters(engine)
    heavy = engine.with_parameters(parameters._replace(rotation=Rotation(inertia=HELD_INERTIA)))
    return StepsResult(
        sizes=config.steps_deg,
        start=STEP_AT,
        free=tuple(_throttle_step(engine, trim, size, 4.0) for size in config.steps_deg),
        held=tuple(_throttle_step(heavy, rest, size, 2.0) for size in config.steps_deg),
        held_speed=speed,
    )


def run_sine(engine: DelaySystem, point: PointResult, config: StudyConfig) -> SineRecord:
    """Simulate the sinusoid that is shown: three periods, of which the first is the transient's."""
    omega = SHOWN_SINE
    period = 2.0 * np.pi / omega
    run = throttle_run(engine, point.trim, signals.sine(config.amplitude_deg, omega), 3.0 * period, period / 8000.0)
    kept = run.times >= period * (1.0 - 1e-9)
    speed = run.output("engine_speed") - point.trim.output("engine_speed")
    return SineRecord(omega, run.times[kept], run.input("throttle")[kept], speed[kept])


def excitation(config: StudyConfig) -> Excitation:
    """What the sinusoids move, how far, and what is watched."""
    return Excitation(input_name="throttle", output_name="engine_speed", amplitude=config.amplitude_deg)


def find_response(engine: DelaySystem, point: PointResult, config: StudyConfig, progress: Progress | None = None) -> Sinestream:
    """Find the frequency response by simulation."""
    return find_sinestream(engine, point.trim, excitation(config), np.array(config.frequencies), progress=progress)


def find_linear_range(engine: DelaySystem, point: PointResult, config: StudyConfig, progress: Progress | None = None) -> LinearRanges:
    """Find up to which amplitude the exact linear model holds, over the study's frequencies and up to its half range."""
    frequencies = np.geomspace(config.frequencies[0], config.frequencies[-1], RANGE_FREQUENCIES)
    room = min(config.half_range_deg, point.trim.input("throttle"), 90.0 - point.trim.input("throttle"))
    amplitudes = np.linspace(room / RANGE_AMPLITUDES, room, RANGE_AMPLITUDES)
    return find_linear_ranges(engine, point.trim, ("throttle", "engine_speed"), frequencies, amplitudes, progress=progress)


def table_response() -> FrequencyResponse:
    """Table 4.1 of Lee (1995) as a frequency response, G = (A/5) exp(-j lag)."""
    rows = read_table_4_1()
    return FrequencyResponse(
        omega=np.array([row["frequency_rad_s"] for row in rows]),
        values=np.array([row["speed_amplitude_rad_s"] / 5.0 * np.exp(-1j * np.deg2rad(row["phase_lag_deg"])) for row in rows]),
        input_name="throttle",
        input_unit="deg",
        output_name="engine_speed",
        output_unit="rad/s",
        method="Table 4.1 of Lee (1995)",
    )


def fit_models(response: FrequencyResponse) -> ModelsResult:
    """Fit all six structures and judge them; where all are rejected the study goes on, and its warnings say so."""
    fits = fit_all_models(response)
    verdicts = tuple(judge_model(named.fit) for named in fits)
    accepted = any(verdict.accepted for verdict in verdicts)
    return ModelsResult(response=response, fits=fits, verdicts=verdicts, chosen=choose_model(fits).chosen.name if accepted else "")


def design_controllers(models: ModelsResult, config: StudyConfig) -> ControllersResult:
    """Design C1, C2 and C2d as Lee (1995), chapter 5, with Ziegler-Nichols' rule as it is there and as it is right."""
    g1, g2, g2d = (models.fit(name).fit.model for name in ("g1", "g2", "g2d"))
    tangents = {"g2": measure_step_tangent(g2), "g2d": measure_step_tangent(g2d)}
    gains = {
        "c1": tune_pi_pole_placement(g1, natural_frequency=config.natural_frequency_rad_s, damping=config.damping_ratio, designed_on="g1"),
        "c2_zn": tune_pid_ziegler_nichols_without_gain(tangents["g2"], designed_on="g2"),
        "c2_zn_with_gain": tune_pid_ziegler_nichols(tangents["g2"], designed_on="g2"),
        "c2d_zn": tune_pid_ziegler_nichols_without_gain(tangents["g2d"], designed_on="g2d"),
        "c2d_zn_with_gain": tune_pid_ziegler_nichols(tangents["g2d"], designed_on="g2d"),
    }
    tunings: dict[str, FineTuning] = {}
    for name, model, start, rule in (
        ("c2", g2, config.starting_gains_g2, gains["c2_zn"]),
        ("c2d", g2d, config.starting_gains_g2d, gains["c2d_zn_with_gain"]),
    ):
        begin, free, objective = _start_of_tuning(start, rule, name)
        tunings[name] = fine_tune(model, begin, overshoot_limit=config.overshoot_limit, free=free, objective=objective)
        gains[name] = tunings[name].gains
    gains["c2d_reduced"] = gains["c2d"].scaled(kp=REDUCTION)
    return ControllersResult(gains=MappingProxyType(gains), tangents=MappingProxyType(tangents), tunings=MappingProxyType(tunings))


def _start_of_tuning(start: StartingGains | None, rule: PidGains, name: str) -> tuple[PidGains, tuple[str, ...], Objective]:
    if start is None:
        free = ("ki",) if name == "c2" else ("kp", "ki", "kd")
        return rule, free, Objective.LOAD_ERROR if name == "c2" else Objective.SETPOINT_ERROR
    begin = PidGains(
        kp=start.kp,
        ki=start.ki,
        kd=start.kd,
        input_unit=rule.input_unit,
        output_unit=rule.output_unit,
        rule="tuned by hand",
        designed_on=rule.designed_on,
    )
    return begin, start.free, Objective.LOAD_ERROR


def throttle_run(engine: DelaySystem, trim: Trim, signal: signals.Signal, until: float, spacing: float = STEP) -> Trajectory:
    """Simulate the engine from a trim under a throttle signal, in steps short enough for its lags, with samples at a spacing."""
    start = Start(states=trim.states, inputs=trim.inputs)

    def run(pieces: int) -> Trajectory:
        return simulate(engine, start, {"throttle": signal}, until=until, step=spacing / pieces, options=Options(every=pieces))

    return in_short_steps(run, spacing, trim.lags)


def in_short_steps(run: Callable[[int], T], spacing: float, lags: Iterable[float]) -> T:
    """Run with a spacing cut into 1, 2, 4, ... pieces: the fewest that suit the lags at the start and those that the run comes to.

    Args:
        run: told how many pieces.
        spacing: to be cut, in s.
        lags: at the start, in s.

    Raises:
        AnalysisError: a lag is too short to be simulated.
    """
    longest = LAG_SHARE * min(lags)
    pieces = 1
    while pieces <= MOST_PIECES:
        if spacing / pieces <= longest:
            try:
                return run(pieces)
            except StepError:
                pass
        pieces *= 2
    message = f"a lag of the engine is shorter than {spacing / MOST_PIECES:g} s, too short for a study; give longer delays"
    raise AnalysisError(message)


def time_record(run: Trajectory) -> TimeRecord:
    """Keep what the study shows of a simulation."""
    return TimeRecord(run.times, run.input("throttle"), run.output("manifold_pressure"), run.output("engine_speed"))


def _throttle_step(engine: DelaySystem, trim: Trim, size: float, until: float) -> TimeRecord:
    return time_record(throttle_run(engine, trim, signals.step(size, start=STEP_AT), until))
