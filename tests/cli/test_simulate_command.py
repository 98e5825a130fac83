"""The command simulate, as a user calls it."""

import csv
import json
import subprocess
import sys
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
        (("--continue", "none.csv", "--throttle", "20"), 2, "--throttle cannot be given with --continue"),
        (("--continue", "none.csv", "--input", "sine:1@1", "--step", "0.001"), 2, "--input, --step cannot be given with --continue"),
        (("--continue", "none.csv", "--load", "0"), 2, "--load cannot be given with --continue"),
        (("--continue", "none.csv", "--every", "1", "--tolerance", "1e-3"), 2, "--tolerance, --every cannot be given with --continue"),
        (("--continue", "none.csv", "--engine", "lee1995"), 2, "--engine cannot be given with --continue"),
        (("--step", "0.001", "--tolerance", "1e-3"), 2, "--step fixes the step, and --tolerance has it found; give one of them"),
        (("--tolerance", "2"), 2, "tolerance = 2 of each state's range is outside 0 to 1"),
        (("--until", "1e5"), 2, "1e+08 samples are more than a file shall hold, 10000000; give --every 10 or more"),
        (
            ("--input", "sine:5@2000", "--step", "0.001"),
            2,
            "sine frequency of throttle = 2000 rad/s is outside what a step of 0.001 s resolves",
        ),
        (("--input", "pulses:5/1e-7"), 2, "cycle duration = 1e-07 s is outside durations whose periods are at most 1000000"),
        (("--input", "spark=step:81@0.5"), 2, "spark = 91 deg is outside -90 to 90 deg"),
        (("--input", "spark=sine:81@1"), 2, "spark = 91 deg is outside -90 to 90 deg"),
        (("--input", "air_fuel_ratio=step:-14.5@0"), 2, "air_fuel_ratio = 0.5 is outside 1 to 100; give"),
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


RIDES = {
    "nothing": "",
    "a step between grid points": "step:5@0.50037",
    "a sine": "sine:5@10",
    "a recording and a step": "file:drive.csv+step:1@0.3",
    "a load": "load_torque=step:10@1.0005",
    "all inputs": "load_torque=ramp:10@1/0.5+spark=sine:5@7+air_fuel_ratio=pulses:1/0.2",
}


@pytest.mark.parametrize("spec", RIDES.values(), ids=RIDES.keys())
def test_a_run_in_three_parts_is_the_whole_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], spec: str
) -> None:
    """The parts end between samples, and at times that are moved to the next grid point; one part may hold no sample."""
    monkeypatch.chdir(tmp_path)
    Path("drive.csv").write_text("time_s,throttle_deg\n0.05,25\n0.4,28\n1.9,23\n")
    mesh = ("--step", "0.0007", "--every", "100")
    assert simulate(Path("whole.csv"), "--input", spec, *mesh, "--until", "2.5") == 0
    assert simulate(Path("p0.csv"), "--input", spec, *mesh, "--until", "0.9999") == 0
    for number, stop in enumerate(("1.003", "1.7", "2.5"), start=1):
        assert simulate(Path(f"p{number}.csv"), "--continue", f"p{number - 1}.csv", "--until", stop) == 0
    together = [rows(Path(f"p{number}.csv")) for number in range(4)]
    assert together[1][1:] == []
    assert together[0] + together[2][1:] + together[3][1:] == rows(Path("whole.csv"))
    capsys.readouterr()


def test_a_moved_stop_time_and_an_end_between_samples_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run.csv"
    assert run(["simulate", "--out", str(out), "--step", "0.001", "--every", "300", "--until", "1.0004", "--json"]) == 0
    captured = capsys.readouterr()
    assert "stop time 1.0004 s is no multiple of the step 0.001 s: moved to 1.001 s" in captured.err
    assert "the run stops at 1.001 s, and the last sample is at 0.9 s" in captured.err
    record = json.loads(captured.out)
    assert (record["samples"], record["to_s"]) == (4, pytest.approx(1.001, rel=1e-12))
    assert run(["simulate", "--continue", str(out), "--until", "1.1", "--out", str(tmp_path / "more.csv"), "--json"]) == 0
    captured = capsys.readouterr()
    assert "the run stops at 1.1 s, and no sample was stored" in captured.err
    assert json.loads(captured.out)["speed_rad_s"] == pytest.approx(240.799, abs=1e-3)
    assert "from_s" not in json.loads(captured.out)


def test_the_step_is_found_and_its_error_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The true error, against a far finer run, is within the difference told, and that within the tolerance."""
    spec, ends = ("--input", "step:20@0.5003", "--until", "2", "--json"), {}
    for name, mesh in (("default", ()), ("tight", ("--tolerance", "1e-10")), ("true", ("--step", "2.5e-5", "--every", "40"))):
        assert simulate(tmp_path / f"{name}.csv", *spec, *mesh) == 0
        ends[name] = json.loads(capsys.readouterr().out)
    assert ends["tight"]["step_s"] < ends["default"]["step_s"]
    assert "difference_to_twice_the_step" not in ends["true"]
    truth = np.array([float(row["engine_speed_rad_s"]) for row in csv.DictReader(rows(tmp_path / "true.csv"))])
    for name, tolerance in (("default", 1e-6), ("tight", 1e-10)):
        speeds = np.array([float(row["engine_speed_rad_s"]) for row in csv.DictReader(rows(tmp_path / f"{name}.csv"))])
        error = np.max(np.abs(speeds - truth)) / np.ptp(truth)
        assert error < ends[name]["difference_to_twice_the_step"] <= tolerance
        assert "# difference_to_twice_the_step: " in (tmp_path / f"{name}.csv").read_text()


def test_a_run_goes_on_from_anywhere_with_the_files_that_it_began_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    begun, elsewhere = tmp_path / "begun", tmp_path / "elsewhere"
    begun.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(begun)
    assert run(["engines", "lee1995"]) == 0
    Path("mine.toml").write_text(capsys.readouterr().out.replace("inertia = 0.1454", "inertia = 0.2"))
    Path("drive.csv").write_text("time_s,throttle_deg\n0,25\n1,30\n")
    assert simulate(Path("run.csv"), "--engine", "mine.toml", "--input", "file:drive.csv", "--until", "1.5") == 0
    monkeypatch.chdir(elsewhere)
    assert simulate(Path("more.csv"), "--continue", str(begun / "run.csv"), "--until", "2") == 0
    (begun / "drive.csv").write_text("time_s,throttle_deg\n0,25\n1,31\n")
    assert simulate(Path("more.csv"), "--continue", str(begun / "run.csv"), "--until", "2") == 2
    assert "this run was made with other input signals" in capsys.readouterr().err


def test_a_continued_run_is_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run.csv"
    assert simulate(out, "--until", "1") == 0
    before = out.read_text()
    assert simulate(out, "--continue", str(out), "--until", "2") == 2
    assert "would replace the run that is continued" in capsys.readouterr().err
    assert out.read_text() == before


def test_a_recording_that_does_not_cover_the_run_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("late.csv").write_text("time_s,throttle_deg\n0.5,20\n1,26\n")
    assert run(["simulate", "--input", "file:late.csv", "--until", "2", "--out", "run.csv"]) == 0
    told = capsys.readouterr().err
    assert "the recording of throttle begins at 0.5 s: before, its first value is held, 20 deg" in told
    assert "the recording of throttle ends at 1 s, before the stop time 2 s: from there on its last value is held, 26 deg" in told
    assert "throttle jumps at 0 s from the trim's 25 deg to the recorded 20 deg" in told
    assert run(["simulate", "--continue", "run.csv", "--until", "3", "--out", "more.csv"]) == 0
    told = capsys.readouterr().err
    assert "ends at 1 s, before the stop time 3 s" in told
    assert "begins" not in told
    assert "jumps" not in told


def test_samples_are_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """What a run wrote drives another run, its inputs without a unit too."""
    monkeypatch.chdir(tmp_path)
    assert simulate(Path("run.csv"), "--input", "air_fuel_ratio=ramp:-1@0.1/0.5", "--step", "0.001", "--until", "1") == 0
    assert simulate(Path("again.csv"), "--input", "air_fuel_ratio=file:run.csv", "--step", "0.001", "--until", "1") == 0
    first, second = ([float(row["engine_speed_rad_s"]) for row in csv.DictReader(rows(Path(name)))] for name in ("run.csv", "again.csv"))
    assert second == pytest.approx(first, rel=1e-9)
    assert first[-1] != first[0]
    capsys.readouterr()


def test_an_unstable_trim_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "--throttle", "4", "--until", "1", "--out", str(tmp_path / "run.csv")]) == 0
    assert "the trim at 4 deg is unstable" in capsys.readouterr().err


def test_ctrl_c_keeps_what_there_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a process of its own: it is interrupted once it has told that it runs."""
    whole, part, rest = (tmp_path / f"{name}.csv" for name in ("whole", "part", "rest"))
    spec = ["--input", "sine:5@1", "--step", "0.001", "--every", "1000"]
    program = (
        "import os, signal, sys\n"
        "from revline.cli import run, simulate_command\n"
        "tell = simulate_command._Told.tell\n"
        "def interrupt(self, done):\n"
        "    tell(self, done)\n"
        "    if done > 0.0:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "simulate_command._Told.tell = interrupt\n"
        "sys.exit(run(sys.argv[1:]))\n"
    )
    command = [sys.executable, "-c", program, "simulate", "--out", str(part), *spec, "--until", "5000"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - this interpreter, on a program that stands above
    assert done.returncode == 1, done.stderr
    assert "error: interrupted: lee1995 at t = 400 s of 5000 s" in done.stderr
    assert "holds the 401 samples until then and says that it is partial" in done.stderr
    assert "# partial: interrupted at 400 s" in part.read_text()
    assert simulate(rest, "--continue", str(part), "--until", "500") == 0
    assert simulate(whole, *spec, "--until", "500") == 0
    assert rows(part) + rows(rest)[1:] == rows(whole)
    capsys.readouterr()


def test_a_damaged_state_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run.csv"
    assert simulate(out, "--until", "1") == 0
    assert read_run_state(out).origin.engine == "lee1995"
    whole = state_path(out).read_bytes()
    state_path(out).write_bytes(whole[: len(whole) // 2])
    assert simulate(tmp_path / "more.csv", "--continue", str(out), "--until", "2") == 2
    assert "holds no state of a run" in capsys.readouterr().err
