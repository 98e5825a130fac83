"""Single questions: the same objects as the command line prints, and the same refusals."""

import json
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from revline.cli import run
from revline.web.answers import answer
from revline.web.asked.registry import ASKED

C2D = {"kp": 1.2, "ki": 2.0, "kd": 0.1}
GENTLE = {"kp": 0.4, "ki": 0.8, "kd": 0.0}
C1 = {"kp": 2.1536, "ki": 16.8546, "kd": 0.0}
SAMPLED = {**C2D, "sampling": {"kind": "fixed-rate", "period_s": 0.01}}
MODEL = {"schema": "revline.model/1", "name": "g2d", "numerator": [12.0], "denominator": [1.0, 0.55, 0.034], "delay_s": 0.021}
CSV = "frequency_rad_s,amplitude_rad_s,phase_deg\n" + "".join(
    f"{w},{60.0 / (1.0 + (0.5 * w) ** 2) ** 0.5},{-20.0 * w**0.6}\n"
    for w in (0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0)
)


def asked(name: str, entries: Mapping[str, Any]) -> dict[str, Any]:
    """The answer to a question."""
    found = answer(name, json.dumps(dict(entries)).encode())
    assert found.status == 200, found.body
    return dict(json.loads(found.body))


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    """What the command line prints as JSON."""
    status = run([*(str(argument) for argument in arguments), "--json", "-q"])
    out, err = capsys.readouterr()
    assert status == 0, err
    return dict(json.loads(out))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files that commands read, named as the questions' answers name them."""
    for name, content in (("controller", C2D), ("c1", C1), ("gentle", GENTLE), ("sampled", SAMPLED), ("g2d", MODEL)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    (tmp_path / "response.csv").write_text(CSV)
    return tmp_path


def place(k: int) -> tuple[dict[str, float], tuple[object, ...]]:
    """A random operating point, for a question and for a command."""
    draw = random.Random(k)  # noqa: S311 - points of a test, the same in each run
    throttle, load = round(draw.uniform(12.0, 60.0), 2), round(draw.uniform(0.0, 15.0), 2)
    return {"throttle_deg": throttle, "load_n_m": load}, ("--throttle", throttle, "--load", load)


def test_resting_engines(capsys: pytest.CaptureFixture[str]) -> None:
    for k in range(2):
        entries, options = place(k)
        assert asked("trim", entries) == told(capsys, "trim", *options)
        assert asked("linearize", {**entries, "roots": 6}) == told(capsys, "linearize", *options, "--roots", 6)
        right = {**entries, "roots_right_of_rad_s": -8.0}
        assert asked("linearize", right) == told(capsys, "linearize", *options, "--roots-right-of", -8.0)
    assert asked("trim", {"speed_rad_s": 300.0}) == told(capsys, "trim", "--speed", 300)


def test_maps(capsys: pytest.CaptureFixture[str]) -> None:
    entries = {"from_deg": 10.0, "to_deg": 40.0, "points": 13, "line_deg": [15, 35], "linear_within": "1%", "load_n_m": 2.0}
    options = ("--from", 10, "--to", 40, "--points", 13, "--line", "15,35", "--linear-within", "1%", "--load", 2)
    assert asked("map", entries) == told(capsys, "map", *options)
    assert asked("map", {**entries, "linear_within": "3"})["operating_range"]["tolerance_is"] == "rad/s"


@pytest.mark.parametrize("method", ["exact", "harmonic-balance", "peaks"])
def test_responses(method: str, capsys: pytest.CaptureFixture[str]) -> None:
    entries, options = place(7)
    frequencies = [0.5, 2.0, 9.0, 25.0]
    found = asked("response", {**entries, "frequencies_rad_s": frequencies, "method": method, "amplitude_deg": 3.0})
    listed = ",".join(str(w) for w in frequencies)
    assert found == told(capsys, "response", *options, "--frequencies", listed, "--method", method, "--amplitude", 3.0)


def test_fits(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--zeros", 0, "--poles", 2, "--delay", "free", "--weight", "relative", "--amplitude", 5)
    entries = {"zeros": 0, "poles": 2, "delay": "free", "weight": "relative", "amplitude_deg": 5}
    assert asked("fit", {**entries, "csv": CSV}) == told(capsys, "fit", folder / "response.csv", *options)
    rows = [dict(zip(CSV.split("\n")[0].split(","), map(float, line.split(",")), strict=True)) for line in CSV.split("\n")[1:-1]]
    found = asked("fit", {**entries, "frequency_response": rows})
    assert found["numerator"] == asked("fit", {**entries, "csv": CSV})["numerator"]
    assert (found["input_name"], found["output_unit"]) == ("throttle", "rad/s")
    fixed = asked("fit", {"csv": CSV, "zeros": 0, "poles": 1, "delay": "fixed", "delay_s": 0.02})
    assert fixed["delay_s"] == 0.02
    assert "5 deg assumed" in fixed["notes"][0]


def test_rules(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries, options = place(3)
    rule = ("--rule", "simc-pi", "--closed-loop-lag", 0.1)
    assert asked("tune", {**entries, "rule": "simc-pi", "closed_loop_lag_s": 0.1}) == told(capsys, "tune", *options, *rule)
    compared = told(capsys, "tune", folder / "g2d.json", "--compare")
    assert asked("tune", {"model": MODEL, "compare": True}) == compared
    start = {"rule": "fine-tuning", "start": C2D, "free": "ki", "model": MODEL}
    told_start = told(capsys, "tune", folder / "g2d.json", "--rule", "fine-tuning", "--start", folder / "controller.json", "--free", "ki")
    assert without_origin(asked("tune", start)) == without_origin(told_start)


def without_origin(record: dict[str, Any]) -> dict[str, Any]:
    """A record without the file that its plant came from."""
    return {key: value for key, value in record.items() if key != "provenance"}


def test_margins(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries, options = place(4)
    for name, controller in (("controller", C2D), ("c1", C1), ("sampled", SAMPLED)):
        file = folder / f"{name}.json"
        assert asked("margins", {**entries, "controller": controller}) == told(capsys, "margins", file, *options)
        assert asked("margins", {"model": MODEL, "controller": controller}) == told(capsys, "margins", folder / "g2d.json", file)
    of_response = told(capsys, "margins", folder / "response.csv", folder / "controller.json", "--amplitude", 5)
    assert asked("margins", {"csv": CSV, "controller": C2D, "amplitude_deg": 5}) == of_response


def test_regions(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries, options = place(5)
    more = ("--kd", "0,0.1", "--ms", "2", "--mark", folder / "c1.json", "--largest-kd")
    question = {"kd": [0, 0.1], "ms": [2], "mark": [{"name": "c1", "controller": C1}], "largest_kd": True}
    assert asked("region", {**entries, **question}) == told(capsys, "region", *options, *more)
    damped = ("--damping", 0.3, "--damping-up-to", 20, "--kp-max", 2, "--ki-max", 20)
    question = {"model": MODEL, "damping": 0.3, "damping_up_to_rad_s": 20, "kp_max": 2, "ki_max": 20}
    assert asked("region", question) == told(capsys, "region", folder / "g2d.json", *damped)


def test_loops(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries, options = {"throttle_deg": 31.0, "load_n_m": 4.0}, ("--throttle", 31.0, "--load", 4.0)
    file, run_options = folder / "gentle.json", ("--step", 20, "--until", 15, "--low", 2, "--load-step", 1.5, "--load-at", 7)
    question = {**entries, "controller": GENTLE, "step_rad_s": 20, "until_s": 15, "low_deg": 2, "load_step_n_m": 1.5, "load_at_s": 7}
    assert asked("loop", question) == told(capsys, "loop", file, *options, *run_options)
    noisy = ("--period", 0.01, "--noise", 0.2, "--seed", 3, "--step", 20, "--until", 15)
    question = {**entries, "controller": GENTLE, "step_rad_s": 20, "until_s": 15, "period_s": 0.01, "noise_rad_s": 0.2, "seed": 3}
    assert asked("loop", question) == told(capsys, "loop", file, *options, *noisy)
    assert asked("loop", {"model": MODEL, "controller": GENTLE}) == told(capsys, "loop", folder / "g2d.json", file)
    placed = told(capsys, "loop", folder / "g2d.json", file, *options)
    found = asked("loop", {**entries, "model": MODEL, "controller": GENTLE, "series": True})
    series = found.pop("series")
    assert found == placed
    assert len(series["time_s"]) == len(series["speed_rad_s"]) == len(series["throttle_deg"]) > 1000
    assert series["speed_rad_s"][0] == placed["start_rad_s"]


def test_limit_cycles(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hunting = told(capsys, "limit-cycle", folder / "c1.json", "--throttle", 25, "--onset")
    assert asked("limit-cycle", {"throttle_deg": 25, "controller": C1, "onset": True}) == hunting
    assert hunting["hunts"] is True
    at_rest = told(capsys, "limit-cycle", folder / "controller.json", "--throttle", 25)
    assert asked("limit-cycle", {"throttle_deg": 25, "controller": C2D}) == at_rest
    assert at_rest["hunts"] is False


@pytest.mark.parametrize(
    ("name", "entries", "status", "words"),
    [
        ("trim", {}, 2, "give either throttle_deg or speed_rad_s"),
        ("trim", {"throttle_deg": 25, "speed_rad_s": 300}, 2, "give either throttle_deg or speed_rad_s"),
        ("trim", {"throttle": 25}, 2, "there is no 'throttle', did you mean throttle_deg?; leave it out"),
        ("trim", {"throttle_deg": 91}, 2, "throttle_deg = 91 is outside its range; give 90 or less"),
        ("trim", {"throttle_deg": "25"}, 2, "throttle_deg = '25': input should be a valid number"),
        ("trim", {"throttle_deg": 25, "engine": "v8"}, 2, "there is no built-in engine 'v8'"),
        ("trim", {"throttle_deg": 25, "engine": "/etc/passwd"}, 2, "there is no built-in engine '/etc/passwd'"),
        ("trim", {"throttle_deg": 2}, 1, "no trim at throttle = 2 deg"),
        ("map", {"from_deg": 40, "to_deg": 30}, 2, "from_deg = 40 is not below to_deg = 30"),
        ("map", {"linear_within": "1,2", "points": 2}, 2, "names more than one tolerance"),
        ("linearize", {}, 2, "throttle_deg is missing; give it"),
        ("linearize", {"throttle_deg": 25, "roots": 3, "roots_right_of_rad_s": -5}, 2, "give either roots or roots_right_of_rad_s"),
        ("response", {"throttle_deg": 25, "frequencies_rad_s": []}, 2, "frequencies_rad_s"),
        ("response", {"throttle_deg": 25, "frequencies_rad_s": [2, 1], "method": "exact"}, 2, "sort the frequencies"),
        ("fit", {"zeros": 0, "poles": 1}, 2, "give a response either as csv"),
        ("fit", {"zeros": 0, "poles": 1, "csv": CSV, "delay": "fixed"}, 2, "give delay fixed and delay_s together"),
        ("fit", {"zeros": 0, "poles": 1, "csv": "\0"}, 2, "is a binary file; give a CSV file"),
        ("fit", {"zeros": 0, "poles": 1, "csv": CSV, "data_name": "../x"}, 2, "data_name"),
        ("fit", {"zeros": 0, "poles": 1, "frequency_response": [{}]}, 2, "has no row with numbers"),
        ("fit", {"zeros": 0, "poles": 1, "frequency_response": [{"a": 1}, {"b": 1}]}, 2, "response.csv, row 2: a are not all numbers"),
        ("tune", {"throttle_deg": 25}, 2, "no rule is given"),
        ("tune", {"throttle_deg": 25, "rule": "simc", "compare": True}, 2, "compare shows every rule with its defaults"),
        ("tune", {"model": MODEL, "throttle_deg": 25, "rule": "simc"}, 2, "a model has its own, leave them out"),
        ("margins", {"controller": C2D}, 2, "neither a model nor throttle_deg is given"),
        ("margins", {"controller": C2D, "throttle_deg": 25, "delay_s": 0.1}, 2, "are for a frequency response; give csv"),
        ("margins", {"controller": SAMPLED, "csv": CSV}, 2, "which no response shows; give a model"),
        ("margins", {"controller": {"kp": 1}, "throttle_deg": 25}, 2, 'controller: "ki" is missing'),
        ("region", {"throttle_deg": 25, "kp_max": -1}, 2, "kp_max = -1 is outside values above 0"),
        ("loop", {"model": MODEL, "controller": C2D, "low_deg": 1}, 2, "low_deg and high_deg limit an engine's throttle"),
        ("loop", {"model": MODEL, "controller": C2D, "load_step_n_m": 1}, 2, "load_step_n_m steps an engine's load torque"),
        ("loop", {"model": MODEL, "controller": C2D, "load_n_m": 1}, 2, "place a linear model at an engine's trim"),
        ("loop", {"throttle_deg": 25, "controller": C2D, "until_s": 1e9}, 2, "until_s = 1e+09 is outside its range; give 300 or less"),
        ("limit-cycle", {"throttle_deg": 25, "controller": SAMPLED}, 2, "the request holds a controller that samples; samples fall"),
    ],
)
def test_refusals_tell_what_is_wrong(name: str, entries: dict[str, Any], status: int, words: str) -> None:
    found = answer(name, json.dumps(entries).encode())
    problem = json.loads(found.body)
    assert (found.status, found.kind) == (422, "application/problem+json")
    assert problem["exit_status"] == status
    assert words in problem["detail"]


def test_there_is_a_question_for_each_step_of_the_chain() -> None:
    chain = {"trim", "map", "linearize", "response", "fit", "tune", "margins", "region", "loop", "limit-cycle"}
    assert set(ASKED) == chain
