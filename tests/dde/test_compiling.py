"""Kernels that different processes compiled, loaded from the disk side by side."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

PROGRAM = """
import sys
from typing import NamedTuple
import numpy as np
from revline.dde.simulate import Start, simulate
from revline.equations import equation
from revline.system import DelaySystem, Variable

class Slope(NamedTuple):
    value: float = 1.0

@equation
def emit(p, x, u, zd):
    return (1.0 * x[0],)

@equation
def lags(p, x, u, zd):
    return (0.5,)

@equation
def output(p, x, u, zd):
    return (1.0 * x[0],)

def build(target):
    @equation
    def rate(p, x, u, zd):
        return (p.value * target + 0.0 * zd[0],)
    place = Variable(name="place", unit="m")
    return DelaySystem(name="s", parameters=Slope(), states=(place,), inputs=(), channels=(place,), outputs=(place,),
                       emit=emit, lags=lags, rate=rate, output=output)

for text in sys.argv[1:]:
    run = simulate(build(float(text)), Start(states=np.zeros(1), inputs=np.zeros(0)), {}, until=1.0, step=0.25)
    print(round(float(run.outputs[-1, 0]), 12))
"""


def start(folder: Path, *targets: str) -> "subprocess.Popen[str]":
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "NUMBA_CACHE_DIR": str(folder / "cache")}
    return subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, str(folder / "program.py"), *targets], stdout=subprocess.PIPE, text=True, env=environment
    )


def outcome(process: "subprocess.Popen[str]") -> list[float]:
    text, _ = process.communicate()
    assert process.returncode == 0
    return [float(line) for line in text.split()]


@pytest.mark.slow
def test_kernels_of_different_processes_are_not_taken_for_one_another(tmp_path: Path) -> None:
    """Functions of one name, compiled at the same place of two processes, once answered for each other when both came from the disk."""
    (tmp_path / "program.py").write_text(PROGRAM)
    compiling = (start(tmp_path, "2"), start(tmp_path, "-7"))
    assert [outcome(process) for process in compiling] == [[2.0], [-7.0]]
    loading = (start(tmp_path, "2", "-7"), start(tmp_path, "-7", "2"))
    assert [outcome(process) for process in loading] == [[2.0, -7.0], [-7.0, 2.0]]
