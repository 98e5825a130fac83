"""The wheel holds the package with its tables and type marker, and nothing else."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel_names(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)  # noqa: S603 - the project's own build
    (wheel,) = folder.glob("*.whl")
    return set(zipfile.ZipFile(wheel).namelist())


def test_the_wheel_carries_data_and_types(wheel_names: set[str]) -> None:
    wanted = {"revline/py.typed", "revline/__init__.py"}
    wanted |= {f"revline/studies/reference/{name}" for name in ("table_4_1.csv", "linear_models.toml", "controllers.toml", "figures.csv")}
    wanted |= {f"revline/report/templates/{name}" for name in ("report.html.jinja", "blocks.html.jinja", "report.css", "report.typ")}
    assert wanted <= wheel_names


def test_the_wheel_carries_nothing_else(wheel_names: set[str]) -> None:
    assert {name.partition("/")[0].partition("-")[0] for name in wheel_names} == {"revline"}
    assert [name for name in wheel_names if "__pycache__" in name or "/tests/" in name] == []
