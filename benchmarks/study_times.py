"""Measure the thesis's whole study: with an empty cache of compiled kernels, with a full one, and its numbers alone.

    python benchmarks/study_times.py [--repeats N]

Each run is a process of its own and writes into an empty folder; the time is that from start to end of the process. Kernels
are kept in a folder made for this, so that the first run finds none. Status 1: a run takes longer than its budget, or fails.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import revline

STUDY = "import sys; from revline.cli import run; sys.exit(run(['study', '--quiet', '--out', sys.argv[1]]))"
NUMBERS = """
import sys
from pathlib import Path
from revline.studies.config import StudyConfig
from revline.studies.study import compute_study

folder = Path(sys.argv[1])
folder.mkdir()
compute_study(StudyConfig(), folder, lambda *_: None)
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A way to run the study, and the seconds that it may take on two cores."""

    name: str
    program: str
    budget: float
    compiled: bool


CASES = (
    Case(name="whole study, nothing compiled yet", program=STUDY, budget=90.0, compiled=False),
    Case(name="whole study, compiled", program=STUDY, budget=45.0, compiled=True),
    Case(name="its numbers alone, compiled", program=NUMBERS, budget=10.0, compiled=True),
)


def run_case(case: Case, folder: Path, number: int) -> tuple[float, float]:
    """Run once in a fresh process; the seconds from start to end, and those of all processors. CalledProcessError: it fails."""
    kernels = folder / ("kernels" if case.compiled else f"kernels_{number}")
    environment = {**os.environ, "PYTHONPATH": str(Path(revline.__file__).parents[1]), "NUMBA_CACHE_DIR": str(kernels)}
    out = folder / f"out_{CASES.index(case)}_{number}"
    begun, busy = time.perf_counter(), processor_seconds()
    subprocess.run([sys.executable, "-c", case.program, out], check=True, stdout=subprocess.DEVNULL, env=environment)
    return time.perf_counter() - begun, processor_seconds() - busy


def processor_seconds() -> float:
    """What the processes that have ended took of all processors: on a machine that does other work too, it tells more than the clock."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Measure all cases, and compare with the budgets."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--repeats", type=int, default=3, help="runs of each case; the least times count")
    arguments = parser.parse_args()
    over = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run_case(next(case for case in CASES if case.program is NUMBERS), folder, -1)  # fills the kernels that count as compiled
        for case in CASES:
            least, busy = (min(values) for values in zip(*(run_case(case, folder, k) for k in range(arguments.repeats)), strict=True))
            print(f"  {case.name:34s} {least:6.1f} s, budget {case.budget:g} s; processors {busy:6.1f} s", flush=True)
            if least > case.budget:
                over.append(f"{case.name}: {least:.1f} s is over its budget of {case.budget:g} s")
    print("\n".join(over), file=sys.stderr, end="\n" if over else "")
    return int(bool(over))


if __name__ == "__main__":
    sys.exit(main())
