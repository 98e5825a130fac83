"""How long a start takes: `import revline` in a fresh process, and building the thesis's engine.

A budget is about five times what was measured when it was set, so that a slower machine passes and a careless import does not.
"""

import subprocess
import sys
from pathlib import Path

from pytest_benchmark.fixture import BenchmarkFixture

import revline

IMPORT_BUDGET = 0.040
"""Seconds that `import revline` may add to a bare interpreter."""

HELP_BUDGET = 0.5
"""Seconds that `revline --help` may take, from start to end of its process."""

BUILD_BUDGET = 0.0005
"""Seconds that building the engine may take, its equations traced."""


def fastest(benchmark: BenchmarkFixture) -> float:
    """Shortest round measured, in seconds."""
    return float(benchmark.stats.stats.min)


def time_import() -> float:
    """Seconds that the import takes in a fresh process, by that process's own clock."""
    program = "import time; start = time.perf_counter(); import revline; print(time.perf_counter() - start)"
    environment = {"PYTHONPATH": str(Path(revline.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout)


def test_import_is_cheap(benchmark: BenchmarkFixture) -> None:
    benchmark.pedantic(time_import, rounds=5)
    assert min(time_import() for _ in range(5)) < IMPORT_BUDGET


def run_help() -> None:
    """Ask for the list of commands in a fresh process."""
    environment = {"PYTHONPATH": str(Path(revline.__file__).parents[1])}
    program = "import sys; from revline.cli import run; sys.exit(run(['--help']))"
    subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, env=environment)


def test_help_is_there_at_once(benchmark: BenchmarkFixture) -> None:
    benchmark.pedantic(run_help, rounds=5)
    assert fastest(benchmark) < HELP_BUDGET


def test_engine_is_built_at_once(benchmark: BenchmarkFixture) -> None:
    benchmark(revline.lee1995)
    assert fastest(benchmark) < BUILD_BUDGET
