"""Views of states against the command line: the same numbers, whatever the state."""

import json
import random
from pathlib import Path
from typing import Any

import pytest

from revline.cli import run
from revline.io.engine_files import format_engine
from revline.web.parameters import changed_engine
from revline.web.state import parse_state
from tests.web.viewing import view

STATES = 50


def random_states() -> list[dict[str, Any]]:
    draw = random.Random(1995)  # noqa: S311 - states of a test, the same in each run
    states = []
    for k in range(STATES):
        state: dict[str, Any] = {
            "throttle_deg": round(draw.uniform(12.0, 60.0), 2),
            "load_n_m": round(draw.uniform(0.0, 15.0), 2),
            "kp": round(draw.uniform(0.05, 1.2), 4),
            "ki": round(draw.uniform(0.2, 3.0), 4),
            "kd": round(draw.uniform(0.0, 0.05), 4) if k % 2 else 0.0,
            "amplitude_deg": round(draw.uniform(1.0, 6.0), 2),
            "command_rad_s": round(draw.uniform(10.0, 40.0), 1),
            "until_s": 8.0,
        }
        if k % 5 == 4:
            state["parameters"] = {"rotation.inertia": round(draw.uniform(0.1, 0.25), 4)}
        if k % 7 == 6:
            state["speed_rad_s"] = round(draw.uniform(150.0, 500.0), 1)
            del state["throttle_deg"]
        states.append(state)
    return states


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    """What the command line prints as JSON."""
    status = run([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert status == 0, err
    return dict(json.loads(out))


@pytest.mark.parametrize("k", range(STATES))
def test_numbers_are_those_of_the_command_line(k: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each state asks all parts that have a command of their own; their numbers are the same to the last bit."""
    entries = random_states()[k]
    state = parse_state(entries)
    engine = tmp_path / "engine.toml"
    engine.write_text(format_engine(changed_engine(state.engine, state.changed)))
    gains = tmp_path / "gains.json"
    gains.write_text(json.dumps({"kp": state.kp, "ki": state.ki, "kd": state.kd, "rule": "by hand", "designed_on": "the workbench"}))
    place = ("--engine", engine, "--load", state.load_n_m)
    found = view(entries, "point", "margins", "gains", "loop")
    where = ("--speed", state.speed_rad_s) if state.throttle is None else ("--throttle", state.throttle)
    assert found["point"] == told(capsys, "trim", *place, *where, "--json", "-q")
    angle = found["point"]["throttle_deg"]
    margins = told(capsys, "margins", gains, *place, "--throttle", angle, "--json", "-q")
    shown = {key: value for key, value in found["margins"].items() if key not in {"loop", "stable_factors"}}
    agree(shown, {key: value for key, value in margins.items() if key != "loop"}, exactly=state.throttle is not None)
    region = told(capsys, "region", *place, "--throttle", angle, "--kd", state.kd, "--json", "-q")
    agree(found["gains"]["window"], region["window"], exactly=state.throttle is not None)
    agree(found["gains"]["area"], region["area_in_window"], exactly=state.throttle is not None)
    options = ("--throttle", angle, "--step", state.command_rad_s, "--until", state.until_s)
    status = run([str(a) for a in ("loop", gains, *place, *options, "--json", "-q")])
    out, err = capsys.readouterr()
    if status:  # too short a record for the command, which says so; the view runs it longer
        assert status == 1
        assert "simulate" in err, err
        assert "undecided" in found["loop"] or found["loop"]["until_s"] > state.until_s
        return
    loop = json.loads(out)
    for key in ("outcome", "overshoot", "settling_time_s", "steady_error_rad_s", "limit_cycle", "saturated_share", "throttle_high_deg"):
        assert (key in loop) == (key in found["loop"])
        if key in loop:
            agree(found["loop"][key], loop[key], exactly=state.throttle is not None)


def agree(found: Any, expected: Any, *, exactly: bool) -> None:
    """Whether numbers agree: to the last bit, or, where an angle was found and given again, nearly so."""
    if exactly:
        assert found == expected
    elif isinstance(expected, dict):
        assert set(found) >= set(expected)
        for key, value in expected.items():
            agree(found[key], value, exactly=False)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_models_are_those_that_fit_finds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From the file that the response command writes at the same frequencies."""
    entries = {"throttle_deg": 31.0, "load_n_m": 4.0, "amplitude_deg": 4.0}
    found = view(entries, "models", "response", "promises")
    omega = found["response"]["harmonic_balance"]["frequency_rad_s"]
    data, listed = tmp_path / "response.csv", ",".join(str(w) for w in omega)
    asked = ("--throttle", 31, "--load", 4, "--amplitude", 4, "--frequencies", listed, "--method", "harmonic-balance", "--check", "none")
    told(capsys, "response", *asked, "--out", data, "--json", "-q")
    for name, (zeros, poles, delay) in {"g1": (0, 1, "none"), "g2": (0, 2, "none"), "g2d": (0, 2, "phase-line")}.items():
        model = tmp_path / f"{name}.json"
        fit = told(capsys, "fit", data, "--zeros", zeros, "--poles", poles, "--delay", delay, "--out", model, "--json", "-q")
        shown = found["models"][name]
        for key in ("numerator", "denominator", "delay_s", "max_phase_error_deg", "max_magnitude_error_db"):
            assert shown[key] == pytest.approx(fit[key], rel=1e-9), key
        assert (shown["accepted"], shown["verdict"]) == (fit["accepted"], fit["verdict"])
    gains = tmp_path / "gains.json"
    gains.write_text(json.dumps({"kp": 1.2, "ki": 2.0, "kd": 0.1}))
    margins = told(capsys, "margins", tmp_path / "g2d.json", gains, "--json", "-q")
    assert found["promises"]["g2d"]["gain_margin_db"] == pytest.approx(margins["gain_margin_db"], rel=1e-8)


def test_the_map_and_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    found = view({"load_n_m": 3.0}, "map")["map"]
    asked = ("--load", 3, "--points", 46, "--linear-within", "1%", "--around", 25, "--json", "-q")
    record = told(capsys, "map", *asked)
    assert found["speed_rad_s"] == pytest.approx([row["speed_rad_s"] for row in record["steady_map"]], rel=1e-6)
    line = record["operating_range"]
    assert found["line"]["slope_rad_s_per_deg"] == pytest.approx(line["slope_rad_s_per_deg"], rel=1e-9)
