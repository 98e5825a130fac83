"""Measure simulations of one engine against a C program that integrates the same equations by the same method.

    python benchmarks/simulation_against_c.py [--steps N] [--repeats N]

Contestants run by turns, so that a busy machine slows them alike; the ratio of each run to the first contestant's run of
the same round is taken, and the median ratio reported. Before any time counts, all results must agree. revline's time is that
of the whole call, the C program's that of its loop. Status 1: revline takes longer than its budget.
"""

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from revline.dde.simulate import Options, Start, simulate
from revline.engine.lee1995 import lee1995
from revline.io.engine_vectors import write_engine_vector
from revline.signals import Signal, sine
from revline.system import DelaySystem

SOURCE = Path(__file__).with_name("engine_rk4.c")
AGREEMENT = 1e-9
"""Largest relative difference between results of two contestants."""


BUDGET = 1.3
"""Largest median ratio of revline's time to that of C in any case."""

REVLINE = "revline"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A run from a constant history: throttle + amplitude sin(omega t), from a state, over a number of steps."""

    name: str
    step: float = 1e-3
    steps: int = 200_000
    throttle: float = 25.0
    amplitude: float = 5.0
    omega: float = 10.0
    pressure: float = 35.8072
    speed: float = 240.799


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Where a run ended, and what a step took."""

    time: float
    pressure: float
    speed: float
    nanoseconds_per_step: float


Contestant = tuple[str, Callable[[Case], Run]]

CASES = (
    Case(name="sine, 25 +- 5 deg at 10 rad/s"),
    Case(name="constant, 25 deg", amplitude=0.0),
    Case(name="sine, 45 +- 15 deg at 5 rad/s", throttle=45.0, amplitude=15.0, omega=5.0, pressure=50.0, speed=450.0, step=5e-4),
)


def compile_c(folder: Path, flags: Sequence[str] = ("-O3",)) -> Path:
    """Compile the C program with gcc; FileNotFoundError says that there is none."""
    compiler = shutil.which("gcc")
    if compiler is None:
        message = "gcc is not installed; the C program cannot be compiled"
        raise FileNotFoundError(message)
    program = folder / "_".join(["engine_rk4", *(flag.strip("-") for flag in flags)])
    subprocess.run([compiler, "-std=c11", "-D_DEFAULT_SOURCE", *flags, "-Wall", "-Werror", SOURCE, "-o", program, "-lm"], check=True)
    return program


def run_c(program: Path, vector: Path, case: Case) -> Run:
    """Run the compiled program on a file of parameters; RuntimeError says why it stopped."""
    numbers = (case.step, case.steps, case.throttle, case.amplitude, case.omega, case.pressure, case.speed)
    done = subprocess.run([program, vector, *map(repr, numbers)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        message = f"status {done.returncode}: {done.stderr.strip()}"
        raise RuntimeError(message)
    time, pressure, speed, nanoseconds = map(float, done.stdout.split())
    return Run(time=time, pressure=pressure, speed=speed, nanoseconds_per_step=nanoseconds)


def c_contestant(name: str, folder: Path, engine: DelaySystem, flags: Sequence[str]) -> Contestant:
    """Make a contestant of the C program, compiled with some flags."""
    program, vector = compile_c(folder, flags), folder / "engine.vec"
    write_engine_vector(engine, vector)
    return name, lambda case: run_c(program, vector, case)


def run_revline(engine: DelaySystem, case: Case) -> Run:
    """Simulate the same run; the last sample alone is stored."""
    start = Start(states=np.array([case.pressure, case.speed]), inputs=engine.input_vector({"throttle": case.throttle}))
    throttle = sine(case.amplitude, case.omega) if case.amplitude else Signal()
    until, options = case.steps * case.step, Options(every=case.steps)
    begun = time.perf_counter()
    run = simulate(engine, start, {"throttle": throttle}, until=until, step=case.step, options=options)
    elapsed = time.perf_counter() - begun
    pressure, speed = map(float, run.states[-1])
    return Run(time=float(run.times[-1]), pressure=pressure, speed=speed, nanoseconds_per_step=1e9 * elapsed / case.steps)


def measure(contestants: Sequence[Contestant], case: Case, repeats: int) -> dict[str, list[Run]]:
    """Run all contestants by turns; RuntimeError says whose result differs from the first one's."""
    runs: dict[str, list[Run]] = {name: [] for name, _ in contestants}
    first = contestants[0][0]
    for _ in range(repeats):
        for name, run in contestants:
            runs[name].append(run(case))
            want, have = runs[first][-1], runs[name][-1]
            for quantity in ("time", "pressure", "speed"):
                expected, found = getattr(want, quantity), getattr(have, quantity)
                if not abs(found - expected) <= AGREEMENT * abs(expected):
                    message = f"{case.name}: {name} ends at {quantity} {found!r}, {first} at {expected!r}"
                    raise RuntimeError(message)
    return runs


def show(runs: dict[str, list[Run]]) -> float:
    """Print time per step and the median ratio to the first contestant; give the last one's ratio."""
    first = next(iter(runs.values()))
    ratio = 1.0
    for name, own in runs.items():
        ratios = [run.nanoseconds_per_step / base.nanoseconds_per_step for run, base in zip(own, first, strict=True)]
        times = [run.nanoseconds_per_step for run in own]
        ratio = statistics.median(ratios)
        print(f"  {name:24s} {statistics.median(times):8.1f} ns per step, least {min(times):8.1f}, ratio {ratio:6.3f}")
    return ratio


def main() -> int:
    """Measure all cases, and compare with the budget."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--steps", type=int, default=200_000, help="steps per run")
    parser.add_argument("--repeats", type=int, default=7, help="runs of each contestant")
    arguments = parser.parse_args()
    engine = lee1995()
    ratios = []
    run_revline(engine, CASES[0])  # compiles
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        contestants = (
            c_contestant("C, gcc -O3", folder, engine, ("-O3",)),
            c_contestant("C, gcc -O3 -march=native", folder, engine, ("-O3", "-march=native")),
            (REVLINE, lambda case: run_revline(engine, case)),
        )
        for base in CASES:
            case = replace(base, steps=arguments.steps)
            print(f"{case.name}, step {case.step:g} s, {case.steps} steps")
            ratios.append(show(measure(contestants, case, arguments.repeats)))
    if max(ratios) > BUDGET:
        print(f"revline takes {max(ratios):.3f} times as long as C, over its budget of {BUDGET:g}", file=sys.stderr)
    return int(max(ratios) > BUDGET)


if __name__ == "__main__":
    sys.exit(main())
