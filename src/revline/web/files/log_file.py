"""A recorded log of the user's own: its throttle played on the nonlinear engine and on linear models, and held against its speed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.analysis.logged_response import Between, estimate_response, looks_held
from revline.dde.simulate import Options, Start, simulate
from revline.errors import AnalysisError, InvalidInputError, RevlineError, out_of_range, suggestion
from revline.io.csv_table import CsvTable, parse_csv_table
from revline.io.recorded_files import check_times
from revline.lti.sampled_inputs import answer_to_samples
from revline.lti.time_response import step_response
from revline.studies.steps import in_short_steps
from revline.units import rpm_to_speed
from revline.web.files.fitting import fit_record_of, fitted_models
from revline.web.files.response_file import compare_with_engine
from revline.web.plants import MODELS, Point, find_point, fit_model, place_of
from revline.web.problems import problem_of
from revline.web.state import State
from revline.web.view.drawing import drawn, thin
from revline.web.view.responses import curve

Floats = NDArray[np.float64]

TIME: Final = "time_s"
THROTTLE: Final = "throttle_deg"
LOAD: Final = "load_torque_n_m"
SPEEDS: Final = ("engine_speed_rad_s", "speed_rad_s", "engine_speed_rpm", "speed_rpm")
"""Names that the column of the speed may have."""

COMMANDS: Final = ("speed_command_rad_s", "speed_command_rpm")
"""Names that the column of a controller's speed command may have."""

BETWEEN: Final = "between_samples"
"""Key of the comment line that says what the throttle does between samples: held, straight or smooth."""

UNKNOWN: Final = (
    "the throttle is taken to go straight from sample to sample; where it was held, its delay is half a sample shorter: write "
    f"`# {BETWEEN}: held` (or straight, or smooth) above the header"
)

FEEDBACK: Final = (
    "where a controller moved the throttle, it answered what disturbs the speed, and the response is partly the controller's: log its "
    f"command too, as {COMMANDS[0]}"
)

FASTEST: Final = 1e4
"""No engine of this kind turns faster, in rad/s: a larger value is a fault of the log."""

LARGEST_LOAD: Final = 1e4
"""Largest load torque of either sign, in N m, as the engine's own input has it."""

LATEST: Final = 1e10
"""Largest time of either sign, in s: clocks that count from 1970 stay below."""

MOST_ROWS: Final = 200_000
LONGEST: Final = 600.0
"""Longest log in s."""

SPACING: Final = 2e-3
"""Distance of samples in s at which engine and models are played."""

SETTLED: Final = 25.0
"""The exact model's step response is followed for so many times of its slowest root, at which it is within e^-25 of its end."""

FAST: Final = 4.0
"""It is followed for so long at least, in s."""

OFF: Final = 0.02
"""A log that begins further from the engine's rest than this part of the speed is said not to begin at rest."""


class Log(NamedTuple):
    """What a log holds: times from 0 on in s, throttle in deg, speed in rad/s, load in N m, and what is known of the throttle.

    That is what it does between samples, and the command in rad/s of a controller that moved it, if there was one.
    """

    times: Floats
    throttle: Floats
    speed: Floats
    load: Floats
    between: Between | None
    command: Floats | None

    def moves(self) -> Floats:
        """Times between which the throttle goes straight: those of a held input lie half a sample later, where its steps' middles are."""
        held = self.between is Between.HELD or (self.between is None and looks_held(self.throttle))
        return self.times + 0.5 * float(np.median(np.diff(self.times))) if held else self.times


def read_log_file(text: str, name: str, state: State) -> Mapping[str, Any]:
    """Play a log on the engine of a state, and compare.

    The operating point is that of the log's mean throttle; the engine begins at rest at its first throttle. The load is the log's where it
    has the column load_torque_n_m, else the state's.

    Args:
        text: of a CSV file with the columns time_s, throttle_deg and a speed, and where a controller moved the throttle its command.
        name: what messages call it.
        state: the engine, its load, and the amplitude at which models are fitted.

    Returns:
        `log`, `engine`, `exact` and `models` with their speeds and errors, `response` estimated from the log with its own models and the
        comparison with the engine, and `notes`.

    Raises:
        InvalidInputError: the file is none, lacks a column, or is too long; with line and column.
        NoTrimError: the engine has no steady state at the log's mean throttle.
    """
    log = _read(parse_csv_table(text, Path(name)), state.load_n_m)
    throttle, load = float(log.throttle.mean()), float(log.load.mean())
    here = state.model_copy(update={"throttle_deg": throttle, "speed_rad_s": None, "load_n_m": load})
    point = find_point(place_of(here))
    clock = np.linspace(0.0, log.times[-1], int(np.ceil(log.times[-1] / SPACING)) + 1)
    return {
        "kind": "log",
        "name": name,
        "throttle_deg": throttle,
        "load_n_m": load,
        "duration_s": float(log.times[-1]),
        "samples": int(log.times.size),
        "log": _series(log.times, log.speed, log.throttle),
        "engine": _attempt(lambda: _judged(log, *_engine_speed(log, here, point))),
        "exact": _attempt(lambda: _judged(log, clock, _exact_speed(log, clock, point))),
        "models": {name: _attempt(lambda name=name: _judged(log, clock, _model_speed(log, clock, here, name))) for name in MODELS},
        "response": _attempt(lambda: _estimated(log, here)),
        "notes": _notes(log, here),
    }


def _read(table: CsvTable, load: float) -> Log:
    speed, command = _speeds(table, SPEEDS, "engine's speed"), _speeds(table, COMMANDS, "command")
    if speed is None:
        message = f"{table.path}, line {table.header_line}: no column for the engine's speed among {', '.join(table.header)}; name one"
        raise InvalidInputError(f"{message} {', '.join(SPEEDS)}", role="speed")
    if len(table.rows) > MOST_ROWS:
        message = f"{table.path} has {len(table.rows)} rows; give {MOST_ROWS} at most, thinned evenly"
        raise InvalidInputError(message, rows=float(len(table.rows)))
    times, throttle = _column(table, TIME, -LATEST, LATEST), _column(table, THROTTLE, 0.0, 90.0)
    loads = _column(table, LOAD, -LARGEST_LOAD, LARGEST_LOAD) if LOAD in table.header else np.full(times.size, load)
    check_times(table, times)
    if times.size < 2 or times[-1] - times[0] > LONGEST:
        raise out_of_range(f"duration of {table.path}", float(times[-1] - times[0]), "s", f"0 to {LONGEST:g} s", "give a part of the log")
    return Log(times - times[0], throttle, speed, loads, _between(table), command)


def _speeds(table: CsvTable, names: tuple[str, ...], role: str) -> Floats | None:
    """A column of speeds in rad/s, or none where the table has none of these names."""
    found = [name for name in names if name in table.header]
    if len(found) > 1:
        message = f"{table.path}, line {table.header_line}: {' and '.join(found)} for the {role}; name one {', '.join(names)}"
        raise InvalidInputError(message, role=role)
    if not found:
        return None
    factor = rpm_to_speed(1.0) if found[0].endswith("rpm") else 1.0
    return factor * _column(table, found[0], 0.0, FASTEST / factor)


def _column(table: CsvTable, name: str, low: float, high: float) -> Floats:
    values = table.numbers(name)
    wrong = np.flatnonzero((values < low) | (values > high))
    if wrong.size:
        row = int(wrong[0])
        raise table.error(row, name, f"{values[row]:g} is outside {low:g} to {high:.6g}; mend or leave out that row")
    return values


def _between(table: CsvTable) -> Between | None:
    """What the file says of the throttle between samples, if anything."""
    said = table.metadata.get(BETWEEN)
    kinds = [kind.value for kind in Between]
    if said is not None and said not in kinds:
        message = f"{table.path}: {BETWEEN} is {said!r}{suggestion(said, kinds)}; write one of {', '.join(kinds)}"
        raise InvalidInputError(message, key=BETWEEN)
    return None if said is None else Between(said)


def _engine_speed(log: Log, state: State, point: Point) -> tuple[Floats, Floats]:
    """Times and speed of the nonlinear engine under the log's throttle and load, from rest at the first of them."""
    first = {"throttle_deg": float(log.throttle[0]), "load_n_m": float(log.load[0])}
    rest = find_point(place_of(state.model_copy(update=first))).trim
    start = Start(states=rest.states, inputs=rest.inputs)
    moved = {"throttle": signals.recorded(log.moves(), log.throttle - log.throttle[0])}
    if np.ptp(log.load) > 0.0:
        moved["load_torque"] = signals.recorded(log.times, log.load - log.load[0])
    until = float(log.times[-1])
    run = in_short_steps(
        lambda pieces: simulate(point.engine, start, moved, until=until, step=SPACING / pieces, options=Options(every=pieces)),
        SPACING,
        rest.lags,
    )
    return run.times, run.output("engine_speed")


def _exact_speed(log: Log, clock: Floats, point: Point) -> Floats:
    """Speed of the exact linear model about the log's mean throttle and load."""
    if not point.trim.stable:
        message = (
            f"the engine is open-loop unstable at the log's mean throttle of {point.trim.input('throttle'):.4g} deg: no model rests there"
        )
        raise AnalysisError(message)
    until = min(float(clock[-1]), max(FAST, SETTLED / abs(point.trim.roots.spectral_abscissa)))
    times = clock[: max(2, int(np.searchsorted(clock, until)) + 1)]
    speed = np.full(clock.size, point.trim.output("engine_speed"))
    for name, values in (("throttle", log.throttle), ("load_torque", log.load)):
        moved = np.interp(clock, log.moves() if name == "throttle" else log.times, values) - point.trim.input(name)
        if np.any(moved):
            answer = step_response(point.linear.model, times, input_name=name).output("engine_speed")
            speed += moved[0] * point.linear.model.static_gain(name, "engine_speed") + answer_to_samples(answer, moved)
    return speed


def _model_speed(log: Log, clock: Floats, state: State, name: str) -> Floats:
    """Speed of a model fitted at the log's mean throttle; it knows no load."""
    point = find_point(place_of(state))
    angle = point.trim.input("throttle")
    model = fit_model(place_of(state), min(state.amplitude_deg, angle, 90.0 - angle), name).fit.model
    moved = np.interp(clock, log.moves(), log.throttle) - angle
    answer = answer_to_samples(model.step_response(clock), moved)
    return np.asarray(point.trim.output("engine_speed") + moved[0] * model.numerator[0] + answer)


def _judged(log: Log, clock: Floats, speed: Floats) -> Mapping[str, Any]:
    """A speed with its errors at the log's samples; also those of the second half, which the beginning has left behind."""
    error = np.interp(log.times, clock, speed) - log.speed
    late = error[log.times >= 0.5 * log.times[-1]]
    shown, values = thin(clock, speed)
    return {
        "time_s": drawn(shown),
        "speed_rad_s": drawn(values),
        "rms_error_rad_s": float(np.sqrt(np.mean(error**2))),
        "max_error_rad_s": float(np.max(np.abs(error))),
        "mean_error_rad_s": float(np.mean(error)),
        "late_rms_error_rad_s": float(np.sqrt(np.mean(late**2))),
    }


def _estimated(log: Log, state: State) -> Mapping[str, Any]:
    """The frequency response that the log itself tells, with models fitted to it, held against the engine."""
    found = estimate_response(
        log.times,
        log.throttle,
        log.speed,
        names=("throttle", "engine_speed"),
        units=("deg", "rad/s"),
        between=log.between,
        command=log.command,
    )
    remarks = [text for text, due in ((UNKNOWN, not found.known), (FEEDBACK, log.command is None)) if due]
    models = {
        name: {"problem": problem_of(fit)} if isinstance(fit, RevlineError) else fit_record_of(name, fit)
        for name, fit in fitted_models(found.response).items()
    }
    return {
        **curve(found.response),
        "coherence": drawn(found.coherence),
        "relative_deviation": drawn(found.deviation),
        "relative_bias": drawn(found.bias),
        "between_samples": found.between.value,
        "between_samples_known": found.known,
        **({"remark": "; ".join(remarks)} if remarks else {}),
        "left_out": found.left_out,
        "models": models,
        "engine": compare_with_engine(found.response, state),
    }


def _notes(log: Log, state: State) -> list[str]:
    notes: list[str] = []
    try:
        rest = find_point(place_of(state.model_copy(update={"throttle_deg": float(log.throttle[0]), "load_n_m": float(log.load[0])})))
    except RevlineError:
        return notes
    begins, at_rest = float(log.speed[0]), rest.trim.output("engine_speed")
    if abs(begins - at_rest) > OFF * at_rest:
        notes.append(
            f"the log begins at {begins:.4g} rad/s and the engine rests at {at_rest:.4g} rad/s at its first throttle: the beginning is "
            "compared with an engine that was elsewhere"
        )
    if np.ptp(log.load) > 0.0:
        notes.append("the load moves in this log: the fitted models know nothing of it")
    return notes


def _series(times: Floats, speed: Floats, throttle: Floats) -> Mapping[str, Any]:
    kept = thin(times, speed, throttle)
    return dict(zip(("time_s", "speed_rad_s", "throttle_deg"), map(drawn, kept), strict=True))


def _attempt(find: Any) -> Mapping[str, Any]:
    """What is found, or the problem in its place."""
    try:
        found: Mapping[str, Any] = find()
    except RevlineError as error:
        return {"problem": problem_of(error)}
    return found
