"""The layers that `lint-imports` checks: the contracts hold, and they break where an import points upward."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run import-linter on the package below a folder, with the project's own contracts."""
    program = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    environment = {"PYTHONPATH": str(folder / "src"), "PATH": ""}
    return subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False, env=environment)  # noqa: S603 - our own program


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "src", tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_the_layers_hold(copy: Path) -> None:
    done = lint(copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


@pytest.mark.parametrize(
    ("module", "line", "contract"),
    [
        ("errors.py", "import revline.system", "Imports point downward BROKEN"),
        ("dde/planted.py", "import revline.engine.lee1995", "Imports point downward BROKEN"),
        ("analysis/planted.py", "import revline.engine.lee1995", "Methods know no engine BROKEN"),
        ("design/stability/planted.py", "import revline.design.loops.closed_loop", "Design's parts point downward BROKEN"),
        ("design/planted.py", "def f():\n    import revline.engine.lee1995", "Methods know no engine BROKEN"),
        ("nowhere.py", "", "Imports point downward BROKEN"),
    ],
)
def test_a_planted_import_breaks_them(copy: Path, module: str, line: str, contract: str) -> None:
    with (copy / "src" / "revline" / module).open("a") as handle:
        handle.write(f"\n{line}\n")
    done = lint(copy)
    assert done.returncode != 0
    assert contract in done.stdout
