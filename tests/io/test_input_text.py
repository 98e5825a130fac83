from pathlib import Path

import pytest

from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.io.input_text import parse_input
from revline.signals import Signal

BASE = {"throttle": 25.0, "air_fuel_ratio": 15.0, "spark": 10.0, "load_torque": 0.0}


def parse(text: str) -> dict[str, Signal]:
    return parse_input(text, lee1995(), BASE)


@pytest.mark.parametrize(
    ("text", "time", "value"),
    [
        ("step:5@0.5", 0.4, 0.0),
        ("step:5@0.5", 0.5, 5.0),
        ("step:5@0.5/0.2", 0.6, 2.5),
        ("ramp:-5@0.5/0.2", 0.6, -2.5),
        ("sine:5@10", 0.15707963267948966, 5.0),
        ("sine:5@10/0.5", 0.4, 0.0),
        ("trapezoids:5/2", 3.0, 5.0),
        ("sinecycle:5/2", 0.6, 5.0),
        ("pulses:5/2", 0.2, 5.0),
        ("pulses:5/2", 0.4, 0.0),
        ("step:1e+1@0+step:-2@1", 2.0, 8.0),
    ],
)
def test_each_form_gives_its_signal(text: str, time: float, value: float) -> None:
    assert parse(text)["throttle"](time) == pytest.approx(value, abs=1e-12)


def test_terms_go_to_the_inputs_that_they_name() -> None:
    found = parse("step:5@0.5+load_torque=step:10@1+step:1@2")
    assert {name: signal(3.0) for name, signal in found.items()} == {"throttle": 6.0, "load_torque": 10.0}


def test_a_recording_takes_the_inputs_place(tmp_path: Path) -> None:
    path = tmp_path / "drive.csv"
    path.write_text("time_s,throttle_deg\n0,25\n1,30\n2,20\n")
    signal = parse(f"file:{path}")["throttle"]
    assert [25.0 + signal(time) for time in (0.0, 0.5, 1.0, 2.0, 5.0)] == [25.0, 27.5, 30.0, 20.0, 20.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stepp:5@0.5", "'stepp' is no kind of signal, did you mean step"),
        ("step:5", "'step:5' has not the numbers that step needs"),
        ("ramp:5@0.5", "has not the numbers that ramp needs"),
        ("step:five@0.5", "has not the numbers that step needs"),
        ("5", "'5' is no signal; write step:"),
        ("thrttle=step:5@0", "there is no signal thrttle"),
        ("sine:5@-1", "sine frequency = -1 rad/s is outside values above 0"),
        ("file:nowhere.csv", "nowhere.csv"),
    ],
)
def test_other_texts_are_refused_with_the_forms(text: str, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        parse(text)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time_s,throttle_deg\n0,25\n1,30\n1,31\n", "line 4, column time_s: 1 s repeats 1 s in line 3; keep one of the two"),
        ("time_s,throttle_deg\n0,25\n1,x\n", "line 3, column throttle_deg: 'x' is no finite number"),
        ("time_s,pedal\n0,25\n1,30\n", "there is no column throttle_deg; the columns are time_s, pedal"),
        ("time_s,throttle_deg\n0,25\n2,30\n1,31\n", "line 4, column time_s: 1 s comes after 2 s in line 3; sort the rows by time"),
        ("time_s,throttle_deg\n0,25\n1,95\n", "line 3, column throttle_deg: throttle = 95 deg is outside 0 to 90 deg"),
        ("time_s,throttle_deg\n0,25\n", "has one row; a recording needs two or more"),
        ("time_s,throttle_deg\n0,25\n1\n", "line 3"),
        ("", "empty"),
    ],
)
def test_bad_recordings_name_file_line_and_column(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "drive.csv"
    path.write_text(content)
    with pytest.raises(InvalidInputError, match=message) as caught:
        parse(f"file:{path}")
    assert "drive.csv" in str(caught.value)
