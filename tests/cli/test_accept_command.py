"""The commands accept and relay: verdicts, what they rest on, and what is refused."""

import json
from pathlib import Path
from typing import Any

import pytest

from .conftest import Command

MILD = {"kp": 0.4, "ki": 0.6, "kd": 0.02}
C2D = {"kp": 1.2, "ki": 2.0, "kd": 0.1}


def controller(folder: Path, **entries: Any) -> Path:
    path = folder / "controller.json"
    path.write_text(json.dumps(entries))
    return path


def test_a_verdict_with_all_that_it_rests_on(revline: Command, tmp_path: Path) -> None:
    out = tmp_path / "verdict.json"
    file = controller(tmp_path, **MILD, sampling={"kind": "fixed-rate", "period_s": 0.01}, anti_windup="clamping")
    done = revline("accept", file, "--throttle", 25, "--spread", 0, "--until", 6, "--out", out)
    assert done.status == 0
    assert "verdict" in done.out
    assert "passed" in done.out
    record = json.loads(out.read_text())
    assert record["passed"] is True
    assert record["gain_reserve_db"] > 10.0
    assert [run["kind"] for run in record["runs"]] == ["clean", "clean", "noisy", "noisy"]
    assert record["linear_loops"][0]["stable"] is True
    assert record["linear_loops"][0]["sampling_period_s"] == 0.01
    assert (record["battery"]["jitter"], record["battery"]["jitter_unit"]) == (1e-4, "s")
    assert record["gain_reserves"][0]["ending"] == "hunts"
    assert record["controller"]["sampling"] == {"kind": "fixed-rate", "period_s": 0.01, "computation_delay_s": 0.0}
    assert record["controller"]["output_high"] == pytest.approx(79.46)


def test_the_verdict_on_a_schedule_holds_the_schedule_and_no_gains_that_were_not_used(revline: Command, tmp_path: Path) -> None:
    """Gains so high that nothing is run."""
    axes = [
        {"name": "engine_speed", "unit": "rad/s", "values": [100.0, 400.0]},
        {"name": "load_torque", "unit": "N m", "values": [0.0, 40.0]},
    ]
    tables = {"kp": [[4.0, 4.0], [9.0, 9.0]], "ki": [[0.4, 0.4], [1.5, 1.5]], "kd": [[0.0, 0.0], [0.0, 0.0]]}
    schedule = {"axes": axes, **tables, "powers_of_first_axis": {"kp": 1, "ki": 2, "kd": 0}}
    options = ("--throttle", 15, "--load", 20, "--spread", 0, "--until", 2, "--json")
    file = controller(tmp_path, kp_unit="deg/(rad/s)", schedule=schedule)
    record = json.loads(revline("accept", file, *options).out)
    assert (record["scheduled"], record["runs"]) == (True, [])
    assert {key: record["controller"]["schedule"][key] for key in schedule} == schedule
    assert not {"kp", "ki", "kd"} & set(record["controller"])
    again = controller(tmp_path, **record["controller"])
    assert json.loads(revline("accept", again, *options).out)["reasons"] == record["reasons"]


def test_a_failure_is_a_result_and_an_unstable_loop_is_not_run(revline: Command, tmp_path: Path) -> None:
    done = revline("accept", controller(tmp_path, **C2D), "--throttle", 15, "--load", 20, "--json")
    assert done.status == 0
    assert "the linear loop is unstable" in done.err
    record = json.loads(done.out)
    assert record["passed"] is False
    assert record["runs"] == []
    assert "gain_reserve_db" not in record
    out = tmp_path / "crank.json"
    options = ("--throttle", 15, "--spread", 0, "--until", 3, "--crank-angle", 3.14159, "--out", out)
    text = revline("accept", controller(tmp_path, **C2D), *options)
    assert "failed" in text.out
    battery = json.loads(out.read_text())["battery"]
    assert (battery["jitter"], battery["jitter_unit"]) == (pytest.approx(0.01571, abs=1e-5), "rad")
    assert "- throttle 15, load_torque 0: " in text.out


@pytest.mark.parametrize(
    ("entries", "options", "words"),
    [
        (MILD, ["--throttle", "25", "--period", "0.01", "--crank-angle", "3"], "give one"),
        ({**MILD, "sampling": {"period_s": 0.01}}, ["--throttle", "25", "--period", "0.01"], "says itself when its controller samples"),
        (MILD, ["--throttle", "25", "--low", "30"], "output at rest = 25 deg is outside the controller's limits 30 to 79.46"),
        (MILD, ["--throttle", "x"], "no finite number"),
        (MILD, ["--throttle", "25", "--jitter", "1"], "jitter = 1 s is outside"),
        (MILD, ["--throttle", "25", "--spread", "0.9"], "spread of the parameters"),
        (MILD, ["--throttle", "25", "--time-step", "0"], "step = 0 s is outside values above 0"),
        (MILD, ["--throttle", "25", "--time-step", "0.02"], "give a step below 0.00539869 s"),
        (MILD, ["--throttle", "25", "--max-overshoot", "0"], "required overshoot"),
        ({**MILD, "sampling": {"period_s": 1e-7}}, ["--throttle", "25"], "sampling period = 1e-07 s is outside 1e-05 s and above for runs"),
        (MILD, ["--throttle", "79.9"], "output at rest = 79.9 deg is outside the controller's limits 0 to 79.46 deg"),
        ({"kp": 0, "ki": 0, "kd": 0}, ["--throttle", "25"], "all gains of by hand are 0, so that there is no loop"),
        ({**MILD, "anti_windup": "magic"}, ["--throttle", "25"], '"anti_windup" is "magic"; it is one of none, clamping, back-calculation'),
        ({**MILD, "sampling": 5}, ["--throttle", "25"], '"sampling" is 5; write an object'),
        ({**MILD, "sampling": {"kind": "daily"}}, ["--throttle", "25"], '"kind" is "daily"; it is fixed-rate or crank-synchronous'),
        ({**MILD, "sampling": {"period_s": 0.01}, "hold_samples": 0.5}, ["--throttle", "25"], "a whole number is wanted"),
    ],
)
def test_wrong_input_is_told_in_one_message(revline: Command, tmp_path: Path, entries: Any, options: list[str], words: str) -> None:
    done = revline("accept", controller(tmp_path, **entries), *options)
    assert done.status == 2
    assert words in " ".join(done.err.split())


def test_no_trim_is_an_analysis_that_could_not_be_completed(revline: Command, tmp_path: Path) -> None:
    done = revline("accept", controller(tmp_path, **MILD), "--throttle", 25, "--load", 500)
    assert done.status == 1
    assert "no trim" in done.err


def test_what_would_be_dropped_is_refused_by_commands_that_know_the_plain_law(revline: Command, tmp_path: Path) -> None:
    """A set-point weight is nothing to the loop alone; a filter is much, and the message names what takes it."""
    file = controller(tmp_path, **MILD, filter_time_s=0.02)
    done = revline("limit-cycle", file, "--throttle", 25)
    assert done.status == 2
    assert "the controller has a derivative filter, which would be dropped here" in " ".join(done.err.split())
    assert "`loop`, `margins`, `accept` and `export`" in " ".join(done.err.split())
    assert revline("region", "--throttle", 25, "--mark", file).status == 2
    sampled = revline("limit-cycle", controller(tmp_path, **MILD, sampling={"period_s": 0.01}), "--throttle", 25)
    assert sampled.status == 2
    assert "holds a controller that samples" in " ".join(sampled.err.split())
    weighted = controller(tmp_path, **MILD, setpoint_weight=0.5)
    assert revline("region", "--throttle", 25, "--mark", weighted).status == 0


def test_the_ultimate_gain_by_every_way(revline: Command, tmp_path: Path) -> None:
    out = tmp_path / "ultimate.json"
    done = revline("relay", "--throttle", 25, "--out", out)
    assert done.status == 0
    assert "because its square wave has harmonics" in " ".join(done.out.split())
    record = json.loads(out.read_text())
    assert record["exact"]["gain"] == pytest.approx(2.1064, abs=2e-4)
    assert record["relay_predicted"]["gain"] == pytest.approx(record["relay"]["gain"], rel=3e-3)
    assert record["bisection"]["rests_at"] < record["exact_sampled"]["gain"] * 1.005
    assert record["bisection"]["hunts_at"] > record["exact_sampled"]["gain"] * 0.995
    assert len(record["reasons"]) == 2
    assert revline("relay", "--throttle", 25, "--amplitude", 60).status == 2
    assert revline("relay", "--throttle", 25, "--until", 0.5).status == 1


def test_sampling_that_takes_longer_than_the_delay_is_warned_of(revline: Command, tmp_path: Path) -> None:
    slow = {"kp": 0.05, "ki": 0.1, "kd": 0.0}
    done = revline("accept", controller(tmp_path, **slow), "--throttle", 25, "--period", 0.05, "--spread", 0, "--until", 4, "--json")
    assert done.status == 0
    assert "samples every 0.05 s, longer than the plant's delay of 0.0228 s" in " ".join(done.err.split())
    assert "sample faster" in json.loads(done.out)["linear_loops"][0]["warning"]


def test_margins_of_a_controller_that_samples_are_those_of_its_samples(revline: Command, tmp_path: Path) -> None:
    """C2d every 10 ms: a gain margin of 1.0715 on the engine, where 1.50 is left without sampling."""
    file = controller(tmp_path, **C2D, sampling={"period_s": 0.01})
    record = json.loads(revline("margins", file, "--throttle", 25, "--json").out)
    assert record["stable"] is True
    assert record["gain_margin"] == pytest.approx(1.0715, abs=5e-4)
    assert record["equivalent_delay_s"] == 0.005
    model = tmp_path / "m.json"
    model.write_text('{"numerator": [12.0], "denominator": [1.0, 0.55, 0.034], "delay_s": 0.02}')
    assert "equivalent delay" in revline("margins", model, file).out
    response = tmp_path / "r.csv"
    response.write_text("frequency_rad_s,magnitude,phase_deg\n1,2,-3\n")
    refused = revline("margins", response, file)
    assert refused.status == 2
    assert "which no response shows; give a model" in " ".join(refused.err.split())
