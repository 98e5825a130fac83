"""The C program against a plain Python integration of revline's own equations by the same scheme."""

import math
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from revline.engine.lee1995 import LEE_1995, EngineParameters, lee1995
from revline.io.engine_vectors import write_engine_vector
from revline.system import DelaySystem
from tests.benchmarks.loading import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("simulation_against_c")


@pytest.fixture(scope="module")
def program(script: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    try:
        path: Path = script.compile_c(tmp_path_factory.mktemp("c"), ("-O3", "-Wextra", "-Wconversion", "-pedantic"))
    except FileNotFoundError as error:
        pytest.skip(str(error))
    return path


@pytest.fixture(scope="module")
def vector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("vector") / "engine.vec"
    write_engine_vector(lee1995(), path)
    return path


class Reference:
    """Fixed-step Runge-Kutta of order four with Lagrange's cubic through four samples, none of them before t = 0."""

    def __init__(self, engine: DelaySystem, case: Any) -> None:
        self.engine, self.case = engine, case
        self.state = (case.pressure, case.speed)
        self.before = self.emit()
        self.samples = [self.before]

    def emit(self) -> tuple[float, ...]:
        return tuple(map(float, self.engine.emit(self.engine.parameters, self.state, self.inputs(0.0), (0.0, 0.0))))

    def inputs(self, time: float) -> tuple[float, float, float, float]:
        return self.case.throttle + self.case.amplitude * math.sin(self.case.omega * time), 15.0, 10.0, 0.0

    def read_back(self, channel: int, time: float) -> float:
        if time < 0.0:
            return self.before[channel]
        place = time / self.case.step
        assert place <= len(self.samples) - 1
        first = max(0, min(int(place) - 1, len(self.samples) - 4))
        total = 0.0
        for i in range(first, first + 4):
            weight = math.prod((place - j) / (i - j) for j in range(first, first + 4) if j != i)
            total += weight * self.samples[i][channel]
        return total

    def rate(self, state: tuple[float, float], time: float) -> tuple[float, float]:
        parameters, inputs = self.engine.parameters, self.inputs(time)
        lags = self.engine.lags(parameters, state, inputs, (0.0, 0.0))
        arriving = tuple(self.read_back(channel, time - lag) for channel, lag in enumerate(lags))
        pressure, speed = self.engine.rate(parameters, state, inputs, arriving)
        return float(pressure), float(speed)

    def advance(self) -> None:
        step = self.case.step
        number = len(self.samples) - 1
        start, middle, end = number * step, number * step + 0.5 * step, (number + 1) * step
        x = self.state
        k1 = self.rate(x, start)
        k2 = self.rate((x[0] + 0.5 * step * k1[0], x[1] + 0.5 * step * k1[1]), middle)
        k3 = self.rate((x[0] + 0.5 * step * k2[0], x[1] + 0.5 * step * k2[1]), middle)
        k4 = self.rate((x[0] + step * k3[0], x[1] + step * k3[1]), end)
        pressure, speed = (x[i] + step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) for i in range(2))
        self.state = (pressure, speed)
        self.samples.append(self.emit())

    def run(self) -> tuple[float, float]:
        for _ in range(self.case.steps):
            self.advance()
        return self.state


CASES: dict[str, dict[str, Any]] = {
    "sine": {"steps": 500},
    "constant": {"steps": 300, "amplitude": 0.0},
    "fast": {"steps": 700, "omega": 100.0, "step": 5e-4},
    "wide, over the limits of the throttle": {
        "steps": 400,
        "throttle": 60.0,
        "amplitude": 40.0,
        "omega": 20.0,
        "speed": 500.0,
        "step": 4e-4,
    },
    "idle": {"steps": 300, "throttle": 6.0, "amplitude": 0.5, "pressure": 30.0, "speed": 30.0, "step": 2e-3},
}


@pytest.mark.parametrize("name", CASES)
def test_the_c_program_agrees_with_revlines_equations(script: ModuleType, program: Path, vector: Path, name: str) -> None:
    case = script.Case(name=name, **CASES[name])
    found = script.run_c(program, vector, case)
    assert found.time == case.steps * case.step
    assert found.nanoseconds_per_step > 0.0
    assert (found.pressure, found.speed) == pytest.approx(Reference(lee1995(), case).run(), rel=1e-11)


def test_the_c_program_reads_all_parameters(script: ModuleType, program: Path, tmp_path: Path) -> None:
    """Every number that the equations use is another than the thesis's, and the results still agree."""
    unlike = EngineParameters._make(type(part)._make(value * 1.01 for value in part) for part in LEE_1995)
    constants = {"pressure_exponent": 9.0, "ambient_pressure": 100.0}
    unlike = unlike._replace(
        throttle=unlike.throttle._replace(**constants), manifold=unlike.manifold._replace(gas_constant=LEE_1995.manifold.gas_constant)
    )
    vector = write_engine_vector(lee1995(unlike), tmp_path / "unlike.vec")
    assert vector.notes == ()
    case = script.Case(name="unlike", steps=200)
    found = script.run_c(program, tmp_path / "unlike.vec", case)
    assert (found.pressure, found.speed) == pytest.approx(Reference(lee1995(unlike), case).run(), rel=1e-11)
    thesis = Reference(lee1995(), case).run()
    assert abs(found.speed - thesis[1]) > 0.5


@pytest.mark.reference
def test_the_c_program_settles_where_the_thesiss_engine_does(script: ModuleType, program: Path, vector: Path) -> None:
    """Source: Lee (1995), Fig. 4.1, recomputed: 300.778 rad/s at 30 degrees."""
    found = script.run_c(program, vector, script.Case(name="step", steps=40_000, throttle=30.0, amplitude=0.0))
    assert found.speed == pytest.approx(300.778, abs=6e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"step": 0.01}, r"status 1: stopped at t = 0\.01 s, speed 240\.799 rad/s: a lag is no longer than three steps or longer than 1 s"),
        ({"throttle": 1.0, "amplitude": 0.0, "pressure": 5.0, "speed": 30.0}, r"status 1: stopped at t = .* or the engine stalled"),
        ({"speed": -1.0}, "status 2: STEP must be above 1e-9, STEPS at least 1 and SPEED above 0"),
        ({"omega": math.nan}, "status 2: nan is no number"),
    ],
)
def test_the_c_program_says_why_it_stops(script: ModuleType, program: Path, vector: Path, changes: dict[str, float], message: str) -> None:
    with pytest.raises(RuntimeError, match=message):
        script.run_c(program, vector, replace(script.Case(name="wrong", steps=3000), **changes))


def test_the_c_program_refuses_a_short_vector(script: ModuleType, program: Path, tmp_path: Path) -> None:
    (tmp_path / "short.vec").write_text("1 2 3\n")
    with pytest.raises(RuntimeError, match=r"status 2: usage: engine_rk4 VECTOR STEP STEPS .*, VECTOR a file of 24 numbers"):
        script.run_c(program, tmp_path / "short.vec", script.Case(name="short"))


def test_results_that_differ_are_not_timed(script: ModuleType) -> None:
    def run(speed: float) -> Any:
        return script.Run(time=1.0, pressure=30.0, speed=speed, nanoseconds_per_step=1.0)

    equal = (("one", lambda _: run(100.0)), ("two", lambda _: run(100.0 + 1e-8)))
    assert [len(runs) for runs in script.measure(equal, script.Case(name="equal"), 3).values()] == [3, 3]
    with pytest.raises(RuntimeError, match=r"differ: two ends at speed 100\.1, one at 100\.0"):
        script.measure((equal[0], ("two", lambda _: run(100.1))), script.Case(name="differ"), 1)


def test_a_missing_compiler_is_named(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="gcc is not installed; the C program cannot be compiled"):
        script.compile_c(tmp_path)
