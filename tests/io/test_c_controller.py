"""Exported C code against the simulation, to the last bit, compiled by the machine's compiler."""

import ctypes
import itertools
import math
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from revline import signals
from revline.analysis.trim import find_trim
from revline.design.controllers.gain_schedule import GainSchedule, Scaling
from revline.design.controllers.pid_controller import AntiWindup, PidController
from revline.design.controllers.pid_update import ROUNDING_SINGLE, sampled_pid
from revline.design.controllers.scheduled_pid import ScheduledController, scheduled_pid
from revline.design.loops.sampled_loop import Disturbance, SampledRun, SampledTask, run_sampled_loop
from revline.design.plants.loop_signals import operating_point
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.io.c_controller import COMPILE, Precision, write_c_controller
from revline.io.matlab_controller import write_matlab_controller
from revline.io.recorded_operations import Operation, given
from revline.sampled import CrankSynchronous, FixedRate, SampledController
from tests.design.examples import C2D

Floats = NDArray[np.float64]

PLAIN = PidController(gains=C2D, low=0.0, high=79.46, sampling=FixedRate(period=0.01))
CASES = {
    "plain": (PLAIN, 20.0),
    "saturated": (PLAIN, 150.0),
    "crank": (replace(PLAIN, sampling=CrankSynchronous(angle=math.pi), filter_time=0.01), 30.0),
    "everything": (
        replace(
            PLAIN,
            setpoint_weight=0.6,
            derivative_weight=0.2,
            filter_time=0.013,
            rate_limit=150.0,
            anti_windup=AntiWindup.BACK_CALCULATION,
            tracking_time=0.4,
            dead_zone=0.2,
            measurement_step=0.1,
            output_step=0.05,
        ),
        40.0,
    ),
}


@dataclass(frozen=True)
class Compiled:
    """A compiled controller: its library and the types of its structures."""

    start: Any
    step: Any
    names: tuple[str, ...]
    outputs: tuple[str, ...]


def build(
    code: SampledController,
    folder: Path,
    precision: Precision = Precision.DOUBLE,
    *,
    change: Callable[[str], str] = str,
    flags: str = "",
    readings: int = 1,
) -> Compiled:
    """Compile a controller as a shared library with the flags that its file states."""
    text = change(
        write_c_controller(code, name="pid", precision=precision, about={"made by": "a test */ of /* comments"}, units={"kp": "deg */"})
    )
    (folder / "pid.c").write_text(text)
    # Linked without the flags: fast-math at that step would set the whole process to flush the smallest numbers to zero.
    compiling = [*COMPILE.split(), *flags.split(), "-fPIC", "pid.c", "-o", "pid.o"]
    for command in (compiling, ["gcc", "-shared", "pid.o", "-o", "pid.so"]):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603 - the compiler
        assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(folder / "pid.so"))
    real = ctypes.c_double if precision is Precision.DOUBLE else ctypes.c_float
    names, outputs = tuple(v.name for v in code.states), tuple(v.name for v in code.outputs)
    state = type("State", (ctypes.Structure,), {"_fields_": [(name, real) for name in names]})
    output = type("Output", (ctypes.Structure,), {"_fields_": [(name, real) for name in outputs]})
    library.pid_start.restype, library.pid_start.argtypes = state, [real] * (2 + readings)
    library.pid_step.restype, library.pid_step.argtypes = output, [ctypes.POINTER(state), *[real] * (2 + readings)]
    return Compiled(library.pid_start, library.pid_step, names, outputs)


def replay(made: Compiled, run: SampledRun, measured: Floats | None = None) -> Floats:
    """Feed a run's measurements to the compiled code; states and outputs at each sample."""
    rest = run.code.parameters.rest_output
    state = made.start(run.start, run.start, rest)
    rows = []
    values = run.sampled.measurements[:, 0] if measured is None else measured
    for y, r, seconds in zip(values, run.sampled.commands[:, 0], run.sampled.elapsed, strict=True):
        output = made.step(ctypes.byref(state), y, r, seconds)
        rows.append([*(getattr(state, name) for name in made.names), *(getattr(output, name) for name in made.outputs)])
    return np.array(rows)


def simulate(controller: PidController, step: float) -> SampledRun:
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    task = SampledTask(
        command=signals.step(step, start=0.1),
        until=4.0,
        disturbance=Disturbance(noise=0.3, jitter=1e-4, seed=7),
        loads={"load_torque": signals.step(8.0, start=2.0)},
    )
    return run_sampled_loop(engine, point, controller, task)


def recorded(run: SampledRun) -> Floats:
    return np.hstack([run.sampled.states, run.sampled.outputs])


def test_scheduled_gains_compute_the_same_bits_too(tmp_path: Path) -> None:
    """A table over speed and load, powers of the speed taken out: its look-up is exported with the law."""
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    schedule = GainSchedule(
        names=("engine_speed", "load_torque"),
        units=("rad/s", "N m"),
        gain_unit="deg/(rad/s)",
        first=np.array([100.0, 240.0, 400.0]),
        second=np.array([0.0, 20.0]),
        kp=np.array([[0.2, 0.15], [0.5, 0.45], [0.9, 1.0]]),
        ki=np.array([[0.3, 0.3], [1.5, 1.4], [4.0, 4.5]]),
        kd=np.full((3, 2), 0.01),
        scaling=Scaling(),
    )
    controller = ScheduledController(controller=PLAIN, schedule=schedule)
    task = SampledTask(command=signals.ramp(30.0, limit=90.0), until=4.0, loads={"load_torque": signals.step(8.0, start=2.0)})
    run = run_sampled_loop(engine, point, controller, task)
    assert run.of_controller("kp_used").max() > 0.7
    made = build(run.code, tmp_path, readings=2)
    state = made.start(run.start, run.start, 0.0, 25.0)
    rows = []
    for y, r, seconds in zip(run.sampled.measurements[:, 0], run.sampled.commands, run.sampled.elapsed, strict=True):
        output = made.step(ctypes.byref(state), y, *r, seconds)
        rows.append([*(getattr(state, name) for name in made.names), *(getattr(output, name) for name in made.outputs)])
    assert np.array(rows).tobytes() == recorded(run).tobytes()


def test_a_compiler_is_there() -> None:
    """Nothing below may be passed over for want of one."""
    assert shutil.which("gcc"), "install gcc; the exported code is compiled by the tests"


@pytest.mark.parametrize("case", CASES)
def test_the_code_computes_the_same_bits_as_the_closed_loop_on_the_engine(case: str, tmp_path: Path) -> None:
    controller, step = CASES[case]
    run = simulate(controller, step)
    assert replay(build(run.code, tmp_path), run).tobytes() == recorded(run).tobytes()
    if case == "saturated":
        assert run.saturated_share > 0.01


@pytest.mark.parametrize(
    ("change", "flags"),
    [
        (lambda text: text.replace("(real)2.0, /* ki */", "(real)2.0000000000000004, /* ki */"), ""),
        (lambda text: text.replace('#error "fast-math', '//error "'), "-std=gnu99 -ffast-math"),
    ],
    ids=["a last digit", "fast-math"],
)
def test_a_planted_fault_changes_bits(change: Callable[[str], str], flags: str, tmp_path: Path) -> None:
    """Negative control: one unit in the last place of a gain, or a compiler that does not round as it should."""
    controller, step = CASES["everything"]
    run = simulate(controller, step)
    assert replay(build(run.code, tmp_path, change=change, flags=flags), run).tobytes() != recorded(run).tobytes()
    assert 5e-324 * 1.0 > 0.0, "the process must not flush the smallest numbers to zero"


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only"])
def test_fast_math_is_refused_by_the_file_itself(flag: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="fast-math changes what this file computes"):
        build(sampled_pid(PLAIN, output=25.0, measurement=240.0), tmp_path, flags=flag)


def test_single_precision_stays_within_its_bound(tmp_path: Path) -> None:
    """The output's rounding: each sample adds some units in the last place of the terms' largest value, and the integral keeps them.

    With a thousand samples at most, terms up to 100 deg and 2^-24 for a rounding, 1000 * 8 * 100 * 6e-8 = 0.05 deg bounds the integral.
    The derivative divides the measurement's own rounding, 250 rad/s * 6e-8, by the period: 0.1/0.01 * 2 * 1.5e-5 = 3e-4 deg.
    """
    run = simulate(PLAIN, 20.0)
    code = sampled_pid(PLAIN, output=25.0, measurement=run.start, rounding=ROUNDING_SINGLE)
    found, wanted = replay(build(code, tmp_path, Precision.FLOAT), run), recorded(run)
    control = len(run.code.states)
    error = float(np.max(np.abs(found[:, control] - wanted[:, control])))
    assert 0.0 < error < 0.05


def test_a_lost_sensor_is_bridged_then_safe_and_comes_back(tmp_path: Path) -> None:
    """No number, or infinity, in place of the measurement: held for five samples, then the safe output, in C as in Python."""
    controller = replace(PLAIN, safe_output=12.5)
    run = simulate(controller, 5.0)
    made = build(run.code, tmp_path)
    measured = run.sampled.measurements[:, 0].copy()
    measured[50:60], measured[100:103], measured[150] = math.nan, math.inf, -math.inf
    found = replay(made, run, measured)
    code, p = run.code, run.code.parameters
    xd, rows = code.start(p, (run.start,), (run.start,), (25.0,)), []
    for y, r, seconds in zip(measured, run.sampled.commands[:, 0], run.sampled.elapsed, strict=True):
        result = code.update(p, xd, (float(y),), (float(r),), (float(seconds),))
        xd = result[: len(code.states)]
        rows.append(result)
    assert np.array(rows, dtype=float).tobytes() == found.tobytes()
    control = found[:, len(code.states)]
    assert np.all(np.isfinite(found))
    assert np.all(control[55:60] == 12.5)
    assert np.all(control[50:55] != 12.5)
    assert np.all(found[50:60, 4] == measured[49])
    assert control[60] != 12.5


SPECIAL = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, -1.0, 5e-324, 1.7e308)


def test_limits_treat_zeros_infinities_and_no_numbers_as_the_compiled_kernel_does(tmp_path: Path) -> None:
    """All pairs of special values through minimum, maximum, fmin and fmax: in C, in the compiler of the kernels, and in numpy."""
    functions = ("minimum", "maximum", "fmin", "fmax")

    @numba.njit
    def compiled(a: float, b: float) -> Any:
        return np.minimum(a, b), np.maximum(a, b), np.fmin(a, b), np.fmax(a, b)

    plain = simulate(PLAIN, 1.0).code
    code = replace(
        plain,
        states=plain.states[:1],
        outputs=plain.outputs[:4],
        update=lambda p, xd, y, r, t: (  # noqa: ARG005 - the form of all updates
            xd[0],
            *(getattr(np, name)(y[0], r[0]) for name in functions),
        ),
        start=lambda p, y, r, u: (u[0],),  # noqa: ARG005 - the form of all starts
    )
    made = build(code, tmp_path)
    state = made.start(0.0, 0.0, 0.0)
    for a, b in itertools.product(SPECIAL, repeat=2):
        output = made.step(ctypes.byref(state), a, b, 1.0)
        found = np.array([getattr(output, name) for name in made.outputs])
        wanted = np.array(compiled(a, b))
        same = (found == wanted) | (np.isnan(found) & np.isnan(wanted))
        assert same.all(), (a, b, found, wanted)
        with np.errstate(all="ignore"):
            by_numpy = np.array([getattr(np, name)(a, b) for name in functions])
        assert ((found == by_numpy) | (np.isnan(found) & np.isnan(by_numpy))).all(), (a, b)


def test_what_cannot_be_written_is_refused() -> None:
    code = sampled_pid(PLAIN, output=25.0, measurement=240.0)
    for name in ("Speed", "1st", "a-b", ""):
        with pytest.raises(InvalidInputError, match="is no name for C code; give lower-case letters"):
            write_c_controller(code, name=name, precision=Precision.DOUBLE, about={}, units={})
    for signal in ("load torque", "double", "command", "v1"):
        renamed = replace(code, commands=(*code.commands, replace(code.commands[0], name=signal)))
        for write in (partial(write_c_controller, precision=Precision.DOUBLE), write_matlab_controller):
            with pytest.raises(InvalidInputError, match=f"the signal '{signal}' cannot be named so in code; give it a name"):
                write(renamed, name="pid", about={}, units={})
    with pytest.raises(InvalidInputError, match=r"an update calls numpy\.exp, which cannot be written as code"):
        np.exp(given("x"))
    assert isinstance(1.0 / -given("x") - 2.0 * given("y"), Operation)


def test_nodes_that_single_precision_does_not_tell_apart_are_refused() -> None:
    """Between them the gains would be 0/0."""
    flat = np.ones((3, 2))
    schedule = GainSchedule(
        names=("engine_speed", "load_torque"),
        units=("rad/s", "N m"),
        gain_unit="deg/(rad/s)",
        first=np.array([100.0, 100.000001, 400.0]),
        second=np.array([0.0, 20.0]),
        kp=flat,
        ki=flat,
        kd=0.0 * flat,
    )
    write = partial(write_c_controller, scheduled_pid(schedule, PLAIN, output=25.0, measurement=240.0), name="pid", about={}, units={})
    assert "100.000001" in write(precision=Precision.DOUBLE)
    with pytest.raises(InvalidInputError, match=r"nodes 100.0 and 100.000001 of the schedule's first axis are one number in single"):
        write(precision=Precision.FLOAT)


@pytest.mark.parametrize("kp", [1e39, -1e300, 1e-40])
def test_what_single_precision_cannot_hold_is_refused(kp: float) -> None:
    """Else C would make it infinite, or take digits, without a word."""
    code = sampled_pid(replace(PLAIN, gains=replace(C2D, kp=kp)), output=25.0, measurement=240.0)
    write = partial(write_c_controller, code, name="pid", about={}, units={"kp": "deg/(rad/s)"})
    assert repr(kp) in write(precision=Precision.DOUBLE)
    with pytest.raises(InvalidInputError, match=r"parameter kp = .* deg/\(rad/s\).*single precision.*export in double precision"):
        write(precision=Precision.FLOAT)
