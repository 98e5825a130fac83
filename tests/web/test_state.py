"""States of the workbench: what is accepted, and how what is not is told."""

import math
from pathlib import Path
from typing import Any

import pytest

from revline.engine.lee1995 import lee1995, lee1995_parameters
from revline.errors import InvalidInputError
from revline.io.engine_files import format_engine
from revline.studies.config import read_config
from revline.web.parameters import changed_engine, list_parameters
from revline.web.state import State, parse_state
from revline.web.study_file import format_study


def test_what_is_left_out_keeps_its_default() -> None:
    state = parse_state({})
    assert (state.throttle, state.speed_rad_s, state.load_n_m, state.step) == (25.0, None, 0.0, "command")
    assert parse_state({"speed_rad_s": 300}).throttle is None
    assert parse_state(state.model_dump(exclude_none=True)) == state


@pytest.mark.parametrize(
    ("entries", "control", "words"),
    [
        ({"throttle_deg": 95.0}, "throttle_deg", "throttle_deg = 95 is outside its range; give 90 or less"),
        ({"kp": "much"}, "kp", "kp = 'much': input should be a valid number"),
        ({"kp": True}, "kp", "kp = True: input should be a valid number"),
        ({"ki": math.nan}, "ki", "ki = nan: input should be a finite number"),
        ({"kd": math.inf}, "kd", "kd = inf"),
        ({"step": "jump"}, "step", "step = 'jump': input should be 'command', 'load' or 'throttle'"),
        ({"trottle_deg": 3.0}, "trottle_deg", "there is no 'trottle_deg', did you mean throttle_deg?; leave it out"),
        ({"throttle_deg": 20.0, "speed_rad_s": 200.0}, "", "one is known, the other is found; leave one out"),
        ({"engine": "lee1996"}, "", "engine: there is none named 'lee1996', did you mean lee1995?"),
        ({"parameters": {"rotation.inertia": "heavy"}}, "parameters.rotation.inertia", "input should be a valid number"),
        ({"throttle_deg": 10**400}, "throttle_deg", "throttle_deg = 1000000000"),
        ({"parameters": {"\ud800": 1.0}}, "", "parameters: a name holds what cannot be printed"),
        ({"schema": "revline.workbench/2"}, "schema", "input should be 'revline.workbench/1'"),
    ],
)
def test_what_is_wrong_names_its_control(entries: dict[str, Any], control: str, words: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        parse_state(entries)
    assert words in str(caught.value)
    assert caught.value.details.get("control", "") == control


def test_an_engine_has_the_parameters_that_were_changed_and_no_others() -> None:
    engine = changed_engine("lee1995", (("rotation.inertia", 0.2), ("delays.intake_to_torque", 6.0)))
    found, nominal = lee1995_parameters(engine), lee1995_parameters(lee1995())
    assert (found.rotation.inertia, found.delays.intake_to_torque) == (0.2, 6.0)
    assert found._replace(rotation=nominal.rotation, delays=nominal.delays) == nominal
    assert engine.name == "lee1995, changed"


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("rotation.mass", 1.0, "the engine lee1995 has no parameter 'rotation.mass'"),
        ("rotation.inertia", -1.0, "rotation.inertia = -1 kg m2 is outside"),
    ],
)
def test_a_parameter_that_cannot_be_names_its_control(key: str, value: float, words: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        changed_engine("lee1995", ((key, value),))
    assert words in str(caught.value)
    assert caught.value.details["control"] == f"parameters.{key}"


def test_every_parameter_is_listed_with_its_unit_meaning_and_range() -> None:
    record = list_parameters("lee1995")
    rows = {row["key"]: row for row in record["parameters"]}
    inertia = rows["rotation.inertia"]
    assert (inertia["value"], inertia["unit"], inertia["meaning"]) == (0.1454, "kg m2", "inertia of engine and load")
    assert len(rows) == sum(len(part) for part in lee1995_parameters(lee1995()))
    assert all(row["low"] <= row["value"] <= row["high"] for row in rows.values())
    assert all(row["source"] for row in rows.values())


@pytest.mark.parametrize(
    "entries",
    [
        {},
        {"throttle_deg": 8.0, "load_n_m": 2.0, "amplitude_deg": 3.0},
        {"speed_rad_s": 700.0},
        {"parameters": {"rotation.inertia": 0.2}, "step": "load"},
        {"throttle_deg": 84.0, "amplitude_deg": 2.0},
    ],
)
def test_a_study_file_is_one_that_a_study_reads(entries: dict[str, Any], tmp_path: Path) -> None:
    state = parse_state(entries)
    (tmp_path / "study.toml").write_text(format_study(state))
    (tmp_path / "engine.toml").write_text(format_engine(changed_engine(state.engine, state.changed)))
    config = read_config(tmp_path / "study.toml")
    assert config.amplitude_deg == state.amplitude_deg
    assert config.load_n_m == state.load_n_m
    assert config.engine.endswith("engine.toml" if state.parameters else "lee1995")
    if state.throttle is not None:
        assert config.throttle_deg == state.throttle


def test_what_a_study_does_not_take_stands_in_its_file_as_comments() -> None:
    entries = {"kp": 0.5, "low_deg": 5.0, "high_deg": 60.0, "step": "load", "load_step_n_m": 7.0, "until_s": 9.0}
    text = format_study(parse_state(entries))
    for line in ("# kp = 0.5", "# low_deg = 5.0", "# high_deg = 60.0", '# step = "load"', "# load_step_n_m = 7.0", "# until_s = 9.0"):
        assert line in text.splitlines()
    assert "throttle_step_deg" not in text
    assert not any(line.startswith(tuple(entries)) for line in text.splitlines())


def test_a_study_s_amplitude_must_have_room() -> None:
    with pytest.raises(InvalidInputError, match="amplitude_deg = 20 deg leaves 0 to 90 deg from 10 deg; give 10 deg or less"):
        format_study(State(throttle_deg=10.0, amplitude_deg=20.0))
