"""Compiled kernels on disk: found again, never stale, never mixed up, and done without where nothing can be written."""

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import revline
from revline.dde.compiling import warn_once
from revline.dde.kernel import build_kernel
from revline.errors import InvalidInputError
from tests.dde.probe import Probe, probe

HELPER = """
from revline.equations import equation

@equation
def doubled(value):
    return 2.0 * value
"""

MODEL = """
import sys, warnings
from typing import NamedTuple
import numpy as np
from helper import doubled
from revline.dde.kernel import Method, build_kernel
from revline.dde.simulate import Options, Start, simulate
from revline.dde.tableau import HEUN, RK4
from revline.equations import equation
from revline.system import DelaySystem, Variable

class Gain(NamedTuple):
    gain: float

@equation
def emit(p, x, u, zd):
    return (x[0] + 0.0,)

@equation
def lags(p, x, u, zd):
    return (0.5,)

def variable(name):
    return Variable(name=name, unit="m")

def build(target):
    @equation
    def rate(p, x, u, zd):
        return target * p.gain * doubled(zd[0]) + x[1] * x[1], 1.0

    return DelaySystem(name="model", parameters=Gain(1.0), states=(variable("x"), variable("t")), inputs=(), channels=(variable("z"),),
                       outputs=(variable("y"),), emit=emit, lags=lags, rate=rate, output=emit)

start = Start(states=np.array([1.0, 0.0]), inputs=np.array([]))
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for word in sys.argv[1:]:
        name, target = word.split("/")
        model, method = build(float(target)), Method(tableau={"HEUN": HEUN, "RK4": RK4}[name])
        for _ in range(2):
            run = simulate(model, start, {}, until=0.4, step=0.1, options=Options(method=method))
        stats = getattr(build_kernel(model, method), "stats")
        print(word, round(run.states[-1, 0], 6), "loaded" if sum(stats.cache_hits.values()) else "compiled")
for warning in caught:
    print(warning.category.__name__, warning.message)
"""


def write_model(folder: Path) -> Path:
    (folder / "helper.py").write_text(HELPER)
    (folder / "model.py").write_text(MODEL)
    (folder / "home").mkdir()
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_model(tmp_path)


Process = subprocess.Popen[str]


def start_model(
    folder: Path, *words: str, source: Path | None = None, obey: Callable[[], None] | None = None, **environment: str
) -> Process:
    """Start the model in a process of its own, on pairs of a method and a factor of its rate."""
    paths = os.pathsep.join([str(folder), str(source or Path(revline.__file__).parents[1])])
    variables = {"PATH": os.environ["PATH"], "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", "HOME": str(folder / "home")}
    return subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, folder / "model.py", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**variables, "NUMBA_CACHE_DIR": str(folder / "cache"), "NUMBA_OPT": "0", **environment},
        preexec_fn=obey,  # noqa: PLW1509 - these tests start no threads
    )


def lines_of(process: Process) -> list[str]:
    out, errors = process.communicate()
    assert process.returncode == 0, errors
    return out.splitlines()


def run_model(folder: Path, *words: str, **how: Any) -> list[str]:
    return lines_of(start_model(folder, *words, **how))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The model with kernels of two methods and two equations on disk, compiled by two processes at the same time.

    Their functions have the same names and stand at the same places of their processes.
    """
    folder = write_model(tmp_path_factory.mktemp("compiled"))
    first, second = start_model(folder, "RK4/1"), start_model(folder, "HEUN/3")
    assert lines_of(first) == ["RK4/1 1.821333 compiled"]
    assert lines_of(second) == ["HEUN/3 3.421852 compiled"]
    return folder


def test_kernels_that_were_compiled_apart_do_not_mix_where_they_meet(compiled: Path) -> None:
    loading = start_model(compiled, "RK4/1", "HEUN/3"), start_model(compiled, "HEUN/3", "RK4/1")
    assert lines_of(loading[0]) == ["RK4/1 1.821333 loaded", "HEUN/3 3.421852 loaded"]
    assert lines_of(loading[1]) == ["HEUN/3 3.421852 loaded", "RK4/1 1.821333 loaded"]


def test_a_kernel_is_made_anew_when_an_equation_in_another_file_changes(compiled: Path) -> None:
    helper = compiled / "helper.py"
    before = helper.stat()
    helper.write_text(HELPER.replace("2.0", "3.0"))
    os.utime(helper, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert run_model(compiled, "RK4/1") == ["RK4/1 2.221333 compiled"]
    helper.write_text(HELPER)
    assert run_model(compiled, "RK4/1") == ["RK4/1 1.821333 loaded"]


def test_damaged_files_are_made_anew(compiled: Path, folder: Path) -> None:
    shutil.copytree(compiled / "cache", folder / "cache")
    for file in (*folder.rglob("*.nbi"), *folder.rglob("*.nbc")):
        file.write_bytes(file.read_bytes()[:100])
    assert run_model(folder, "RK4/1") == ["RK4/1 1.821333 compiled"]
    assert run_model(folder, "RK4/1") == ["RK4/1 1.821333 loaded"]


def obey_permissions() -> None:
    """Let a process of the superuser respect permission bits after its next program starts, as everyone else does."""
    if os.geteuid() == 0:
        drop_from_bounding_set, override, read_search = 24, 1, 2
        for capability in (override, read_search):
            ctypes.CDLL(None).prctl(drop_from_bounding_set, capability, 0, 0, 0)


@pytest.mark.skipif(sys.platform != "linux", reason="permission bits are set as Linux knows them")
def test_where_the_package_cannot_be_written_the_home_folder_is_used_else_no_cache_with_one_warning(folder: Path) -> None:
    source = folder / "source"
    shutil.copytree(Path(revline.__file__).parent, source / "revline", ignore=shutil.ignore_patterns("__pycache__"))
    closed = [folder / "closed", *(place for place in (source, *source.rglob("*")) if place.is_dir())]
    closed[0].mkdir()
    for place in closed:
        place.chmod(0o555)
    try:
        options: dict[str, Any] = {"source": source, "obey": obey_permissions, "NUMBA_CACHE_DIR": str(closed[0])}
        assert run_model(folder, "RK4/1", **options) == ["RK4/1 1.821333 compiled"]
        assert run_model(folder, "RK4/1", **options) == ["RK4/1 1.821333 loaded"]
        assert list((folder / "home").rglob("*kernel_*.nbc"))
        without = {**options, "HOME": str(closed[0]), "XDG_CACHE_HOME": str(closed[0])}
        value, warning = run_model(folder, "RK4/1", **without)
        assert value == "RK4/1 1.821333 compiled"
        assert warning.startswith(
            "RuntimeWarning compiled kernels are not kept, so each start takes seconds: no folder for them can be written; "
        )
    finally:
        for place in closed:
            place.chmod(0o755)


ODD = """
def emit(p, x, u, zd):
    return x[0] + 0.0, u[0] + 0.0, dict(
        a=zd[1])["a"]
"""


def test_an_equation_that_cannot_be_compiled_is_refused_with_its_place(tmp_path: Path) -> None:
    """Such an equation is one that Python computes and traces, but the compiler does not know."""
    file = tmp_path / "odd.py"
    file.write_text(ODD)
    names: dict[str, Any] = {}
    exec(compile(ODD, str(file), "exec"), names)  # noqa: S102 - what is tested
    message = r"^the equations emit, lags, rate, output cannot be compiled, see .*odd\.py, line \d; compute with floats, tuples"
    with pytest.raises(InvalidInputError, match=message):
        build_kernel(replace(probe(), emit=names["emit"]))


def test_a_kernel_is_built_once_for_all_parameters() -> None:
    assert build_kernel(probe(Probe(decay=1.0))) is build_kernel(probe(Probe(decay=2.0)))


def test_the_warning_comes_once() -> None:
    with pytest.warns(RuntimeWarning, match=r"^compiled kernels are not kept, .*: a test; set NUMBA_CACHE_DIR to a folder"):
        warn_once("a test")
    warn_once("a test")  # a second warning would be an error
