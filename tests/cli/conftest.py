from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from revline.cli import run

REFERENCE = Path(__file__).parents[1] / "reference"
TABLE = REFERENCE / "table_4_1.csv"


class Done(NamedTuple):
    """What a command left: its exit status, its stdout and its stderr."""

    status: int
    out: str
    err: str


Command = Callable[..., Done]


@pytest.fixture
def revline(capsys: pytest.CaptureFixture[str]) -> Command:
    """Run the command line in this process, as `main` does."""

    def call(*arguments: object) -> Done:
        status = run([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return Done(status, out, err)

    return call


@pytest.fixture
def table() -> Path:
    return TABLE


@pytest.fixture
def g1(revline: Command, tmp_path: Path) -> Path:
    """Model file of G1, fitted to Table 4.1."""
    path = tmp_path / "g1.json"
    assert revline("fit", TABLE, "--zeros", 0, "--poles", 1, "--out", path, "-q").status == 0
    return path


@pytest.fixture
def c1(revline: Command, g1: Path, tmp_path: Path) -> Path:
    """Controller file of C1, tuned on G1."""
    path = tmp_path / "c1.json"
    rule = ("--rule", "pole-placement", "--natural-frequency", 18.85, "--damping", 1.25)
    assert revline("tune", g1, *rule, "--out", path).status == 0
    return path
