import csv
import json
from pathlib import Path

import pytest

from revline.io.model_files import write_model
from revline.lti.transfer_function import TransferFunction

from .conftest import Command


def write_controller(path: Path, kp: float, ki: float, kd: float) -> Path:
    path.write_text(json.dumps({"kp": kp, "ki": ki, "kd": kd}))
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


@pytest.mark.reference
def test_c1_on_g1(revline: Command, g1: Path, c1: Path, tmp_path: Path) -> None:
    """Lee (1995), chapter 5: overshoot 7.7 %, bandwidth 51.57 rad/s."""
    path = tmp_path / "loop.csv"
    done = revline("loop", g1, c1, "--step", 60, "--until", 3, "--out", path, "--json")
    record = json.loads(done.out)
    assert record["overshoot"] == pytest.approx(0.0770, abs=5e-4)
    assert record["bandwidth_rad_s"] == pytest.approx(51.57, abs=0.01)
    assert (record["stable"], record["outcome"], record["plant"]) == (True, "settled", "g1")
    assert record["settling_time_s"] == pytest.approx(0.277, abs=1e-3)
    assert "throttle_limits_deg" not in record
    rows = rows_of(path)
    assert list(rows[0]) == ["time_s", "speed_rad_s", "throttle_deg", "proportional_deg", "integral_deg", "derivative_deg", "windup_deg"]
    for row in rows[:: len(rows) // 20]:
        terms = [float(row[f"{name}_deg"]) for name in ("proportional", "integral", "derivative")]
        assert float(row["throttle_deg"]) == pytest.approx(sum(terms), abs=1e-9)
        assert terms[2] == pytest.approx(0.0, abs=1e-9)  # C1 has no derivative
    assert max(float(row["speed_rad_s"]) for row in rows) == pytest.approx(60.0 * 1.077, abs=0.05)
    assert record["form"] in path.read_text()


def test_a_model_can_be_placed_at_the_engine_s_trim(revline: Command, g1: Path, c1: Path) -> None:
    record = json.loads(revline("loop", g1, c1, "--throttle", 25, "--until", 3, "--json").out)
    assert record["start_rad_s"] == pytest.approx(240.799, abs=1e-3)
    assert record["target_rad_s"] == pytest.approx(300.799, abs=1e-3)


def test_a_loop_cut_short_has_no_settling_time_and_says_so(revline: Command, g1: Path, c1: Path) -> None:
    done = revline("loop", g1, c1, "--until", 3, "--step", 60)
    assert "settling time" in done.out
    assert "overshoot 7.7 % of the command" in done.out
    short = revline("loop", g1, write_controller(c1.with_name("slow.json"), 0.5, 0.9, 0.0), "--until", 0.4)
    assert short.status == 1
    assert "it decides nothing; simulate about" in short.err


@pytest.mark.slow
@pytest.mark.reference
def test_c1_diverges_on_g2d_and_hunts_on_the_engine(revline: Command, c1: Path, table: Path, tmp_path: Path) -> None:
    """Lee (1995), chapter 5; converged: 291.15 to 310.07 rad/s, 0.2088 s."""
    g2d = tmp_path / "g2d.json"
    revline("fit", table, "--zeros", 0, "--poles", 2, "--delay", "phase-line", "--out", g2d)
    record = json.loads(revline("loop", g2d, c1, "--until", 3, "--json").out)
    assert (record["stable"], record["outcome"]) == (False, "diverged")
    assert "overshoot" not in record
    assert "bandwidth_rad_s" not in record
    path = tmp_path / "loop.csv"
    done = revline("loop", c1, "--throttle", 25, "--step", 60, "--until", 20, "--out", path, "--json")
    record = json.loads(done.out)
    cycle = record["limit_cycle"]
    assert (record["stable"], record["outcome"]) == (False, "limit-cycle")
    assert cycle["low_rad_s"] == pytest.approx(291.15, abs=0.02)
    assert cycle["high_rad_s"] == pytest.approx(310.07, abs=0.02)
    assert cycle["period_s"] == pytest.approx(0.2088, abs=1e-4)
    assert record["throttle_limits_deg"] == [0.0, 79.46]
    rows = rows_of(path)
    assert list(rows[0]) == ["time_s", "speed_rad_s", "throttle_deg", "proportional_deg", "integral_deg", "derivative_deg", "windup_deg"]
    free = [row for row in rows if 0.0 < float(row["throttle_deg"]) < 79.46]
    for row in free[:: len(free) // 50]:
        terms = sum(float(row[f"{name}_deg"]) for name in ("proportional", "integral", "derivative"))
        assert float(row["throttle_deg"]) == pytest.approx(25.0 + terms, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "needs --throttle"),
        (("--throttle", 120), "throttle = 120 deg is outside 0 to 90 deg"),
        (("--throttle", 25, "--step", 0), "command step = 0 moves nothing"),
        (("--throttle", 25, "--until", 0), "stop time = 0 s is outside values above 0"),
        (("--throttle", 25, "--until", -1), "stop time = -1 s is outside values above 0"),
        (("--throttle", 25, "--time-step", 0), "time step = 0 s is outside values above 0"),
        (("--throttle", 25, "--time-step", 0.01), "step = 0.01 s is not below the lag of"),
        (("--throttle", 25, "--low", 30), "lies outside the limits 30 to 79.46 deg"),
        (("--throttle", 85), "lies outside the limits 0 to 79.46 deg"),
    ],
)
def test_what_a_loop_refuses(arguments: tuple[object, ...], message: str, revline: Command, tmp_path: Path) -> None:
    done = revline("loop", write_controller(tmp_path / "c.json", 1.2, 2.0, 0.1), *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.err


@pytest.mark.slow
def test_a_step_longer_than_a_lag_during_the_run_is_wrong_input(revline: Command, c1: Path) -> None:
    done = revline("loop", c1, "--throttle", 25, "--time-step", 0.005)
    assert (done.status, done.out) == (2, "")
    assert "error: step = 0.005 s is longer than a lag during the run, 0.0049" in done.err


def test_files_that_do_not_fit_a_loop_are_refused(revline: Command, g1: Path, c1: Path, tmp_path: Path) -> None:
    assert "3 files were given" in revline("loop", g1, g1, c1).err
    assert "--low and --high limit an engine's throttle" in revline("loop", g1, c1, "--high", 60).err
    assert '"kp" is missing' in revline("loop", g1, "--throttle", 25).err or "its schema is" in revline("loop", g1, "--throttle", 25).err
    c1.write_text("{")
    assert "no JSON" in revline("loop", g1, c1).err
    feed = TransferFunction(numerator=(1.0, 1.0), denominator=(1.0, 1.0), input_unit="deg", output_unit="rad/s")
    write_model(tmp_path / "feed.json", feed, name="feed", provenance={})
    done = revline("loop", tmp_path / "feed.json", write_controller(tmp_path / "c.json", 1.0, 1.0, 0.0))
    assert done.status == 2
    assert "Traceback" not in done.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--load", 20), "--engine and --load place a linear model at an engine's trim; give --throttle too"),
        (("--engine", "lee1995-generic"), "--engine and --load place a linear model"),
        (("--low", 10), "--low and --high limit an engine's throttle"),
    ],
)
def test_no_option_is_dropped_for_a_model(options: tuple[object, ...], message: str, revline: Command, g1: Path, c1: Path) -> None:
    done = revline("loop", g1, c1, *options)
    assert (done.status, done.out) == (2, "")
    assert message in done.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--low", -5), "--low = -5 deg is outside 0 to 90 deg"),
        (("--high", 120), "--high = 120 deg is outside 0 to 90 deg"),
        (("--low", 50, "--high", 40), "--low = 50 deg is not below --high = 40 deg"),
        (("--low", 30), "the output at the trim, 25 deg, lies outside the limits 30 to 79.46 deg"),
    ],
)
def test_limits_that_no_throttle_reaches_are_refused(options: tuple[object, ...], message: str, revline: Command, c1: Path) -> None:
    done = revline("loop", c1, "--throttle", 25, *options)
    assert (done.status, done.out) == (2, "")
    assert message in done.err
