"""A session that builds too many kernels fails, however many processes share its tests; those that build the same one count it once."""

import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"
BUILDS = """
import sys
def test_build():
    sys.modules.update({{"revline.dde.compiling.kernel_" + name: sys for name in {names!r}}})
"""


@pytest.mark.parametrize(
    ("processes", "most", "status", "words"),
    [
        ("2", 3, 0, "3 kernels were built, at most 3 may be"),
        ("2", 2, 1, "FAILED: too many kernels"),
        ("0", 2, 1, "FAILED: too many kernels"),
    ],
)
def test_different_kernels_are_counted_over_all_processes(tmp_path: Path, processes: str, most: int, status: int, words: str) -> None:
    text = CONFTEST.read_text()
    assert "MOST_KERNELS = 25\n" in text
    (tmp_path / "conftest.py").write_text(text.replace("MOST_KERNELS = 25\n", f"MOST_KERNELS = {most}\n"))
    for k, names in enumerate((["a", "b"], ["b", "c"])):
        (tmp_path / f"test_{k}.py").write_text(BUILDS.format(names=names))
    command = [sys.executable, "-m", "pytest", "-q", "-n", processes, "--dist", "loadscope", "-p", "no:cacheprovider", "--rootdir", "."]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603 - our own test
    assert done.returncode == status, done.stdout + done.stderr
    assert words in done.stdout
    assert "2 passed" in done.stdout
