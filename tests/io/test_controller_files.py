import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controllers.controller import LAW, PidGains
from revline.design.controllers.pid_controller import PidController
from revline.errors import InvalidInputError
from revline.io.controller_files import controller_record, parse_controller, read_controller, write_controller
from revline.io.json_files import format_json, parse_json

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(kp=finite, ki=finite, kd=finite, detail=finite)
def test_gains_read_back_to_the_last_bit(kp: float, ki: float, kd: float, detail: float) -> None:
    gains = PidGains(
        kp=kp, ki=ki, kd=kd, input_unit="rpm", output_unit="%", rule="ours", designed_on="plant ü", details={"x": detail, "note": "a"}
    )
    text = format_json(controller_record(gains, provenance={"program": "test", "year": 1995.0}))
    back = parse_controller(parse_json(text, "here"))
    assert [x.hex() for x in (back.gains.kp, back.gains.ki, back.gains.kd)] == [x.hex() for x in (kp, ki, kd)]
    assert (back.gains.input_unit, back.gains.output_unit, back.gains.rule, back.gains.designed_on) == ("rpm", "%", "ours", "plant ü")
    assert dict(back.gains.details) == {"x": detail, "note": "a"}
    assert dict(back.provenance) == {"program": "test", "year": 1995.0}


def test_a_file_holds_units_law_and_origin(tmp_path: Path) -> None:
    path = tmp_path / "c2d.json"
    gains = PidGains(kp=1.2, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="fine-tuned", designed_on="g2d")
    write_controller(path, gains, provenance={"program": "revline"})
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content == {
        "schema": "revline.controller/1",
        "kp": 1.2,
        "ki": 2.0,
        "kd": 0.1,
        "units": {"kp": "deg/(rad/s)", "ki": "deg/(rad/s)/s", "kd": "deg/(rad/s) s"},
        "input_unit": "rad/s",
        "output_unit": "deg",
        "law": LAW,
        "derivative_acts_on": "measurement",
        "rule": "fine-tuned",
        "designed_on": "g2d",
        "details": {},
        "provenance": {"program": "revline"},
    }
    assert read_controller(path).gains.kp == 1.2


def test_the_law_in_a_file_has_the_weights_and_the_filter_that_stand_beside_it() -> None:
    gains = PidGains(kp=1.2, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="amigo", designed_on="g2d")
    for controller, words in (
        (PidController(gains=gains), LAW),
        (
            PidController(gains=gains, setpoint_weight=0.0, filter_time=0.01),
            f"{LAW}; with weights 0 and 0 of the command, the derivative filtered with 0.01 s",
        ),
    ):
        assert controller_record(controller, provenance={})["law"] == words


def test_three_gains_are_enough_and_more_keys_are_allowed(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text('{"kp": 2, "ki": 0.5, "kd": 0, "colour": null}', encoding="utf-8")
    gains = read_controller(path).gains
    assert (gains.kp, gains.ki, gains.kd) == (2.0, 0.5, 0.0)
    assert (gains.input_unit, gains.output_unit, gains.rule, gains.designed_on) == ("rad/s", "deg", "by hand", "not stated")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"kp": 1, "ki": 1}', r'controller file .*c.json: "kd" is missing, a number; give it, 0 for none'),
        ('{"kp": "1", "ki": 1, "kd": 0}', r'controller file .*c.json: "kp" is "1" \(text\), and a number is wanted'),
        ('{"kp": NaN, "ki": 1, "kd": 0}', r"controller file .*c.json: NaN is no JSON number"),
        ('{"kp": 1e999, "ki": 1, "kd": 0}', r'"kp" is Infinity \(number\), and a finite number is wanted'),
        ('{"schema": "revline.model/1"}', r"its schema is 'revline.model/1', and \"revline.controller/1\" is wanted"),
        ('{"kp": 1, "ki": 1, "kd": 0, "derivative_acts_on": "error"}', r'"derivative_acts_on" is "error", and all methods here'),
        ('{"kp": 1, "ki": 1, "kd": 0, "rule": 5}', r'"rule" is 5 \(number\), and a text is wanted'),
        ('{"kp": 1, "ki": 1, "kd": 0, "filter_time": 0.01}', '"filter_time" is no key of a controller, and "filter_time_s" is one'),
        ('{"kp": 1, "ki": 1, "kd": 0, "rate_limit": 9}', '"rate_limit" is no key of a controller, and "rate_limit_per_s" is one'),
        ('{"kp": 1, "ki": 1, "kd": 0, "sampling": {"period_s": 1, "delay_s": 0}}', '"delay_s" is unknown; there are angle_rad, comp'),
        ('{"kp": 1, "ki": 1, "kd": 0, "units": {"kp": "deg/rpm"}}', r'"units" has kp in deg/rpm, and with "input_unit" rad/s and'),
        ('{"kp": 1, "ki": 1, "kd": 0, "details": {"x": false}}', r'"details.x" is false \(true or false\), and a number is wanted'),
    ],
)
def test_a_wrong_file_is_refused_by_key(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "c.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=message):
        read_controller(path)
