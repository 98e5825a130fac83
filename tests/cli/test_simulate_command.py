"""The command simulate, as a user calls it."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from revline.cli import run
from revline.io.run_files import read_run_state, state_path


def rows(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


def simulate(out: Path, *arguments: str) -> int:
    return run(["simulate", "--out", str(out), "--quiet", *arguments])


def test_a_continued_run_is_that_of_one_go(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = ("--input", "pulses:3/0.7+sine:1@20", "--every", "10")
    assert simulate(tmp_path / "whole.csv", *spec, "--until", "3") == 0
    assert simulate(tmp_path / "first.csv", *spec, "--until", "1.25") == 0
    assert simulate(tmp_path / "rest.csv", "--continue", str(tmp_path / "first.csv"), "--until", "3") == 0
    assert rows(tmp_path / "first.csv") + rows(tmp_path / "rest.csv")[1:] == rows(tmp_path / "whole.csv")
    capsys.readouterr()


def test_a_step_ends_at_the_other_trim(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run.csv"
    assert simulate(out, "--input", "step:5@0.5", "--until", "9", "--every", "9", "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert record["speed_rad_s"] == pytest.approx(300.778, abs=1e-3)
    table = list(csv.DictReader(rows(out)))
    assert set(table[0]) >= {"time_s", "throttle_deg", "engine_speed_rad_s", "manifold_pressure_kpa", "load_torque_n_m"}
    speeds = np.array([float(row["engine_speed_rad_s"]) for row in table])
    assert speeds[0] == pytest.approx(240.799, abs=1e-3)
    assert len(table) == 1001


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--step", "0.01"), 2, "is not below the lag of spark_influence at the start"),
        (("--until", "-1"), 2, "stop time = -1 s is outside values after the start"),
        (("--input", "step:70@0.5"), 2, "throttle = 95 deg is outside 0 to 90 deg"),
        (("--throttle", "91"), 2, "throttle = 91 deg is outside 0 to 90 deg"),
        (("--input", "file:none.csv"), 2, "none.csv"),
        (("--continue", "none.csv"), 2, "none.csv cannot be continued"),
        (("--every", "0"), 2, "every = 0 steps is outside 1 and above"),
        (("--engine", "lee1996"), 2, "lee1996"),
        (("--input", "load_torque=step:200@1"), 1, "stalled: lee1995 at t = 1.1"),
    ],
)
def test_what_simulate_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], status: int, message: str
) -> None:
    assert simulate(tmp_path / "run.csv", *arguments) == status
    captured = capsys.readouterr()
    assert message in captured.err
    assert "Traceback" not in captured.err
    assert not (tmp_path / "run.csv").exists()


def test_a_damaged_state_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run.csv"
    assert simulate(out, "--until", "1") == 0
    assert read_run_state(out).origin.engine == "lee1995"
    whole = state_path(out).read_bytes()
    state_path(out).write_bytes(whole[: len(whole) // 2])
    assert simulate(tmp_path / "more.csv", "--continue", str(out), "--until", "2") == 2
    assert "holds no state of a run" in capsys.readouterr().err
