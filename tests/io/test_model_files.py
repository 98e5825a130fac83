import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.io.json_files import format_json, parse_json
from revline.io.model_files import model_record, parse_model, read_model, write_model
from revline.lti.transfer_function import TransferFunction

coefficient = st.floats(-100.0, 100.0).filter(lambda c: abs(c) > 1e-3)


@given(
    numerator=st.lists(coefficient, min_size=1, max_size=3),
    denominator=st.lists(coefficient, min_size=2, max_size=4),
    delay=st.floats(0, 9),
)
def test_a_model_reads_back_to_the_last_bit(numerator: list[float], denominator: list[float], delay: float) -> None:
    model = TransferFunction(
        numerator=tuple(numerator),
        denominator=tuple(denominator),
        delay=delay,
        input_name="u",
        input_unit="%",
        output_name="y",
        output_unit="rpm",
    )
    text = format_json(model_record(model, name="ours", provenance={"weight": "none"}))
    back = parse_model(parse_json(text, "here"), name="other")
    assert back.model == model
    assert back.name == "ours"
    assert dict(back.provenance) == {"weight": "none"}


def test_a_file_holds_units_poles_and_origin(tmp_path: Path) -> None:
    path = tmp_path / "g.json"
    model = TransferFunction(
        numerator=(12.0, 3.0),
        denominator=(1.0, 0.75, 0.125),
        delay=0.02,
        input_name="throttle",
        input_unit="deg",
        output_name="engine_speed",
        output_unit="rad/s",
    )
    write_model(path, model, name="g", provenance={"fitted_to": "table.csv"})
    content = json.loads(path.read_text(encoding="utf-8"))
    assert [complex(*pole) for pole in content.pop("poles")] == pytest.approx([-2.0, -4.0])
    assert content == {
        "schema": "revline.model/1",
        "name": "g",
        "numerator": [12.0, 3.0],
        "denominator": [1.0, 0.75, 0.125],
        "delay_s": 0.02,
        "input_name": "throttle",
        "input_unit": "deg",
        "output_name": "engine_speed",
        "output_unit": "rad/s",
        "zeros": [[-4.0, 0.0]],
        "provenance": {"fitted_to": "table.csv"},
    }
    assert read_model(path).model == model


def test_the_least_file_is_named_after_itself_and_takes_the_engine_units(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text('{"numerator": [24], "denominator": [2, 1], "delay_s": 0, "poles": "not read"}', encoding="utf-8")
    file = read_model(path)
    assert file.name == "mine"
    assert file.model == TransferFunction(
        numerator=(12.0,),
        denominator=(1.0, 0.5),
        input_name="throttle",
        input_unit="deg",
        output_name="engine_speed",
        output_unit="rad/s",
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"numerator": [1], "denominator": [1, 1]}', r'model file .*g.json: "delay_s" is missing, a number; give it, 0 for none'),
        ('{"numerator": 1, "denominator": [1, 1], "delay_s": 0}', r'"numerator" is 1 \(number\), and a list of at least one number'),
        ('{"numerator": [1], "denominator": [1, null], "delay_s": 0}', r'"denominator\[1\]" is null \(null\), and a number'),
        ('{"numerator": [1], "denominator": [0, 0], "delay_s": 0}', r"model file .*g.json: the denominator is zero"),
        ('{"numerator": [1], "denominator": [1, 1], "delay_s": -0.1}', r"model file .*g.json: delay = -0.1 s is outside"),
        ('{"numerator": [1], "denominator": [1, Infinity], "delay_s": 0}', r"model file .*g.json: Infinity is no JSON number"),
        ('{"schema": "revline.controller/1"}', r"its schema is 'revline.controller/1', and \"revline.model/1\" is wanted"),
        ('{"numerator": [1], "denominator": [1, 1], "delay_s": 0, "input_unit": 3}', r'"input_unit" is 3 \(number\), and a text'),
    ],
)
def test_a_wrong_file_is_refused_by_key(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "g.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=message):
        read_model(path)
