import csv
import itertools
import json
import math
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


ECU = {
    "kp": 0.4,
    "ki": 0.6,
    "kd": 0.02,
    "setpoint_weight": 0.8,
    "filter_time_s": 0.02,
    "output_low": 5.0,
    "output_high": 60.0,
    "rate_limit_per_s": 100.0,
    "sampling": {"kind": "fixed-rate", "period_s": 0.01, "computation_delay_s": 0.002},
}


def write_file(folder: Path, **entries: object) -> Path:
    path = folder / "full.json"
    path.write_text(json.dumps(entries))
    return path


def test_a_sampled_controller_runs_as_its_file_says(revline: Command, tmp_path: Path) -> None:
    """Terms and wind-up at each sample, the rate's limit in the output, what noise and a step of the load do."""
    out, samples = tmp_path / "loop.csv", tmp_path / "samples.csv"
    arguments = ("--throttle", 25, "--step", 20, "--until", 20, "--load-step", 5, "--noise", 0.2, "--seed", 3, "--json")
    done = revline("loop", write_file(tmp_path, **ECU), *arguments, "--out", out, "--samples", samples)
    record = json.loads(done.out)
    assert (record["outcome"], record["samples"], record["overruns"]) == ("settled", 2001, 0)
    assert record["throttle_limits_deg"] == [5.0, 60.0]
    assert record["equivalent_delay_s"] == pytest.approx(0.007)
    assert record["controller"]["sampling"] == record["sampling"] == ECU["sampling"]
    assert record["linear_loop"]["stable"] is True
    assert record["linear_loop"]["gain_margin"] > 2.0
    assert 0.0 < record["disturbed"]["deviation_rms_rad_s"] < 0.5
    assert record["disturbed"]["seed"] == 3
    assert record["load_step"]["at_s"] == pytest.approx(20.0 / 3.0)
    assert 0.5 < record["load_step"]["droop_rad_s"] < 10.0
    assert record["windup"]["largest_deg"] > 5.0  # the output may rise by 1 deg from sample to sample
    rows = [{name: float(cell) for name, cell in row.items()} for row in rows_of(samples)]
    assert len(rows) == 2001
    for before, row in itertools.pairwise(rows):
        assert abs(row["throttle_deg"] - before["throttle_deg"]) <= 1.0 + 1e-9
        assert row["throttle_wanted_deg"] - row["throttle_deg"] == pytest.approx(row["windup_deg"], abs=1e-9)
    columns = list(rows_of(out)[0])
    assert columns[-2:] == ["windup_deg", "quiet_speed_rad_s"]
    again = revline("loop", write_file(tmp_path, **ECU), *arguments)
    assert json.loads(again.out) == record


@pytest.fixture
def lag(tmp_path: Path) -> Path:
    """Model file of a lag with delay."""
    model = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.6), delay=0.02, input_unit="deg", output_unit="rad/s")
    write_model(tmp_path / "lag.json", model, name="lag", provenance={})
    return tmp_path / "lag.json"


def test_a_continuous_controller_with_all_that_has_a_continuous_form(revline: Command, lag: Path, tmp_path: Path) -> None:
    """At a limit back-calculation leads the integral back; without it the integral winds up and the speed overshoots more."""
    law = {"kp": 0.4, "ki": 2.0, "kd": 0.02, "filter_time_s": 0.02, "output_high": 32.0}
    followed = {**law, "anti_windup": "back-calculation", "tracking_time_s": 0.1}
    with_it, without = (
        json.loads(revline("loop", lag, write_file(tmp_path, **one), "--throttle", 25, "--json").out) for one in (followed, law)
    )
    assert with_it["form"].startswith("u = trim + kp e + ki integral of e + kd s/(0.02 s + 1) (-y)")
    assert with_it["terms"]["integral"]["high_deg"] < without["terms"]["integral"]["high_deg"] - 3.0
    assert with_it["overshoot"] < without["overshoot"] - 0.05
    assert with_it["throttle_high_deg"] == without["throttle_high_deg"] == 32.0
    assert with_it["controller"]["tracking_time_s"] == 0.1
    clamped = revline("loop", write_file(tmp_path, **law, anti_windup="clamping"), "--throttle", 25)
    assert clamped.status == 2
    assert "use back-calculation with a tracking_time_s" in " ".join(clamped.err.split())


@pytest.mark.reference
def test_an_unstable_linear_loop_is_run_with_a_warning_that_names_its_margin(revline: Command, c1: Path) -> None:
    """The exact linear engine of Lee (1995) at 25 deg stands 0.576 times the gains of C1: -4.79 dB."""
    done = revline("loop", c1, "--throttle", 25, "--step", 60, "--json")
    record = json.loads(done.out)
    assert (done.status, record["outcome"]) == (0, "limit-cycle")
    assert "2 poles right of the imaginary axis; it would be stable below 0.57" in " ".join(done.err.split())
    assert record["linear_loop"]["stable_to_factor"] == pytest.approx(0.576, abs=1e-3)
    assert (record["linear_loop"]["stable"], record["linear_loop"]["unstable_poles"]) == (False, 2)
    assert record["warnings"] == [done.err.removeprefix("warning: ").strip()]


def test_a_sampled_controller_on_a_model(revline: Command, lag: Path, tmp_path: Path) -> None:
    """A lag under a sampled PI, two samples late: a recursion of its samples; placed at a trim, limits are the throttle's own."""
    pi = write_file(tmp_path, kp=1.0, ki=6.0, kd=0.0)
    samples = tmp_path / "samples.csv"
    record = json.loads(revline("loop", lag, pi, "--period", 0.01, "--until", 4, "--samples", samples, "--json").out)
    output, integral, shrink, late, peak = 0.0, 0.0, math.exp(-0.01 / 0.6), [0.0, 0.0], 0.0
    for row in rows_of(samples):
        assert float(row["speed_measured_rad_s"]) == pytest.approx(output, abs=1e-6)
        integral += 0.06 * (60.0 - output)
        late.append(60.0 - output + integral)
        assert float(row["throttle_deg"]) == pytest.approx(late[-1], abs=1e-6)
        held = 12.0 * late.pop(0)
        output, peak = held + (output - held) * shrink, max(peak, output)
    assert record["overshoot"] == pytest.approx(peak / 60.0 - 1.0, abs=2e-3)
    limited = write_file(tmp_path, kp=1.0, ki=6.0, kd=0.0, output_low=0.0, output_high=60.0)
    alone = revline("loop", lag, limited, "--period", 0.01)
    assert alone.status == 2
    assert "a model by itself knows deviations only" in " ".join(alone.err.split())
    placed = json.loads(revline("loop", lag, limited, "--period", 0.01, "--throttle", 25, "--json").out)
    assert placed["throttle_limits_deg"] == [0.0, 60.0]
    assert placed["throttle_high_deg"] == 60.0


def test_a_gain_schedule_runs_with_the_gains_of_each_sample(revline: Command, g1: Path, tmp_path: Path) -> None:
    speeds, loads = [100, 160, 220, 280, 340, 400], [0, 10, 20, 40]  # as many as the study's schedule has, to share its kernel
    axes = [
        {"name": "engine_speed", "unit": "rad/s", "values": speeds},
        {"name": "load_torque", "unit": "N m", "values": loads},
    ]
    parts = [(speed - 100) / 300 for speed in speeds]
    tables = {
        "kp": [[0.2 + 0.3 * part] * len(loads) for part in parts],
        "ki": [[0.4 + 1.1 * part] * len(loads) for part in parts],
        "kd": [[0] * len(loads) for _ in parts],
    }
    powers = {"kp": 0, "ki": 0, "kd": 0}
    schedule = write_file(tmp_path, kp_unit="deg/(rad/s)", schedule={"axes": axes, **tables, "powers_of_first_axis": powers})
    samples = tmp_path / "samples.csv"
    record = json.loads(revline("loop", schedule, "--throttle", 25, "--step", 20, "--samples", samples, "--json").out)
    assert (record["outcome"], record["scheduled"], record["linear_loop"]["stable"]) == ("settled", True, True)
    rows = rows_of(samples)
    for row in rows[:: len(rows) // 20]:
        assert float(row["kp_deg_s_per_rad"]) == pytest.approx(0.2 + 0.3 * (float(row["speed_measured_rad_s"]) - 100.0) / 300.0)
    assert record["controller"]["kp"] == pytest.approx(0.2 + 0.3 * (record["start_rad_s"] - 100.0) / 300.0)
    assert record["warnings"] == []
    beyond = json.loads(revline("loop", schedule, "--throttle", 40, "--step", 5, "--until", 6, "--json").out)
    assert "whose edge's gains hold there: engine_speed = 418.614 to 4" in " ".join(beyond["warnings"])
    refused = revline("loop", g1, schedule)
    assert refused.status == 2
    assert "holds a gain schedule over signals that a linear model does not have" in " ".join(refused.err.split())


@pytest.mark.parametrize(
    ("entries", "arguments", "message"),
    [
        ({}, ("--noise", 0.1), "--noise tells of samples, and the controller is continuous"),
        ({}, ("--computation-delay", 0.001), "--computation-delay tells of samples"),
        ({}, ("--samples", "x.csv"), "--samples tells of samples, and the controller is continuous"),
        ({}, ("--load-at", 3), "--load-at says when the load steps, and there is no step"),
        ({}, ("--load-step", 5, "--load-at", 30), "load-at = 30 s is outside values below the stop time of 20 s"),
        ({}, ("--load-step", 0), "step of the load = 0 moves nothing"),
        ({"output_step": 0.1}, (), "has a quantised output, which jumps"),
        (ECU, ("--period", 0.005), "says itself when its controller samples"),
        ({}, ("--period", 0.01, "--jitter", 0.01), "jitter = 0.01 s is outside"),
    ],
)
def test_what_a_sampled_loop_refuses(
    entries: dict[str, object], arguments: tuple[object, ...], message: str, revline: Command, tmp_path: Path
) -> None:
    done = revline("loop", write_file(tmp_path, **{"kp": 1.2, "ki": 2.0, "kd": 0.1} | entries), "--throttle", 25, *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in " ".join(done.err.split())


def test_what_a_model_s_loop_refuses(revline: Command, g1: Path, tmp_path: Path) -> None:
    plain = write_controller(tmp_path / "c.json", 1.2, 2.0, 0.0)
    for arguments, message in (
        (("--load-step", 5), "a linear model has no load"),
        (("--crank-angle", 3.14), "sampling by the crank's angle needs the speed itself"),
    ):
        done = revline("loop", g1, plain, *arguments)
        assert done.status == 2
        assert message in " ".join(done.err.split())


def test_a_step_of_the_load_at_the_end_warns(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "c2d.json"
    path.write_text(json.dumps({"kp": 1.2, "ki": 2.0, "kd": 0.1}))
    done = revline("loop", path, "--throttle", 25, "--step", 10, "--until", 4, "--load-step", 5, "--load-at", 3.9999, "--json")
    assert "warning: only 0.0001 s of the record follow the load's step at 3.9999 s" in done.err
    assert any("the outcome says nothing of the answer" in text for text in json.loads(done.out)["warnings"])
