import json
import math
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.io.json_files import format_compact_json, format_json, parse_json, read_json, write_json

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(number=finite, numbers=st.lists(finite, min_size=1), text=st.text(st.characters(exclude_categories=["Cs"]), min_size=1))
def test_everything_reads_back_to_the_last_bit(number: float, numbers: list[float], text: str) -> None:
    record = parse_json(format_json({"a": number, "b": numbers, "c": text, "d": {"x": number, "y": text}}), "here")
    assert record.number("a").hex() == number.hex()
    assert [x.hex() for x in record.numbers("b")] == [x.hex() for x in numbers]
    assert record.text("c", "other") == text
    assert record.notes("d") == {"x": number, "y": text}


def test_a_file_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"a": 0.1, "wahr": True, "list": (1, 2.5)}, "test file")
    assert read_json(path, "test file").entries == {"a": 0.1, "wahr": True, "list": [1, 2.5]}
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert read_json(path, "test file").number("a") == 0.1


def test_arrays_are_written_as_lists() -> None:
    text = format_json({"a": np.array([1.0, 2.0]), "b": np.float64(0.1), "c": np.arange(2), "d": np.ones(1, dtype=bool)[0]})
    assert json.loads(text) == {"a": [1.0, 2.0], "b": 0.1, "c": [0, 1], "d": True}


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"a": {"b": [0.0, math.nan]}}, r'"a.b\[1\]" is nan and has no JSON form: leave out what does not exist'),
        ({"a": np.array([math.inf])}, r'"a\[0\]" is inf and has no JSON form'),
        ({"a": None}, r'"a" is of type NoneType and has no JSON form'),
        ({"a": 1j}, r'"a" is of type complex and has no JSON form'),
        ({"a": {"b": [np.float64(1.0), None]}}, r'"a.b\[1\]" is of type NoneType and has no JSON form'),
    ],
)
def test_what_has_no_json_form_is_refused(record: dict[str, object], message: str) -> None:
    for written in (format_json, format_compact_json):
        with pytest.raises(InvalidInputError, match=message):
            written(record)


def test_the_compact_form_holds_the_same() -> None:
    nested = MappingProxyType({"b": np.array([1.0, 0.1]), "c": (True, np.int64(2), np.float64(1e-300)), "d": "null, not a null", "e": "ä"})
    text = format_compact_json({"a": nested})
    assert json.loads(text) == json.loads(format_json({"a": nested}))
    assert text == '{"a":{"b":[1.0,0.1],"c":[true,2,1e-300],"d":"null, not a null","e":"ä"}}'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": NaN}', "here: NaN is no JSON number"),
        ('{"a": -Infinity}', "here: -Infinity is no JSON number"),
        ('{"a": 1, "a": 2}', 'here: "a" stands there twice'),
        ('{"a": 1,\n "b": }', "here, line 2, column 7: no JSON"),
        ("[1, 2]", "here: holds list, and an object is wanted"),
        ("null", "here: holds null, and an object"),
        ("[" * 100_000, "here: nested too deeply"),
        ('{"a": ' + "9" * 5000 + "}", "here: Exceeds the limit"),
    ],
)
def test_what_is_no_object_of_json_is_refused(text: str, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        parse_json(text, "here")


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"test file '.*missing.json' cannot be read: No such file or directory"):
        read_json(tmp_path / "missing.json", "test file")
    with pytest.raises(InvalidInputError, match=r"cannot be read: Is a directory"):
        read_json(tmp_path, "test file")
    with pytest.raises(InvalidInputError, match=r"cannot be read: .*null"):
        read_json("a\0b", "test file")
    (tmp_path / "latin.json").write_bytes(b'{"a": "\xfc"}')
    with pytest.raises(InvalidInputError, match=r"test file .*latin.json: not UTF-8 text .* at byte 7"):
        read_json(tmp_path / "latin.json", "test file")


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('"abc"', r'here: "a" is "abc" \(text\), and a number is wanted'),
        ("true", r'"a" is true \(true or false\), and a number'),
        ("null", r'"a" is null \(null\), and a number'),
        ("[1]", r'"a" is \[1\] \(list\), and a number'),
        ('{"x": 1}', r'"a" is {"x": 1} \(object\), and a number'),
        ("1e999", r'"a" is Infinity \(number\), and a finite number'),
        ("1" + "0" * 400, r'"a" is 10+\.\.\. \(number\), and a finite number'),
    ],
)
def test_a_number_must_be_one(entry: str, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        parse_json(f'{{"a": {entry}}}', "here").number("a")


def test_keys_are_checked() -> None:
    record = parse_json('{"a": [], "b": 1, "c": [1, "x"], "d": "", "e": {"f": [1]}, "schema": "other/1"}', "here")
    with pytest.raises(InvalidInputError, match=r'here: "z" is missing, a number; give it, 0 for none'):
        record.number("z")
    with pytest.raises(InvalidInputError, match=r'here: "z" is missing, a list of numbers'):
        record.numbers("z")
    with pytest.raises(InvalidInputError, match=r'"a" is \[\] \(list\), and a list of at least one number'):
        record.numbers("a")
    with pytest.raises(InvalidInputError, match=r'"b" is 1 \(number\), and a list of at least one number'):
        record.numbers("b")
    with pytest.raises(InvalidInputError, match=r'"c\[1\]" is "x" \(text\), and a number is wanted'):
        record.numbers("c")
    with pytest.raises(InvalidInputError, match=r'"d" is "" \(text\), and a text is wanted'):
        record.text("d", "default")
    with pytest.raises(InvalidInputError, match=r'"b" is 1 \(number\), and a text is wanted'):
        record.text("b", "default")
    with pytest.raises(InvalidInputError, match=r'"b" is 1 \(number\), and an object of numbers and texts'):
        record.notes("b")
    with pytest.raises(InvalidInputError, match=r'"e.f" is \[1\] \(list\), and a number is wanted'):
        record.notes("e")
    with pytest.raises(InvalidInputError, match=r"here: its schema is 'other/1', and \"mine/1\" is wanted"):
        record.require_schema("mine/1")
    record.require_schema("other/1")
    assert record.text("z", "default") == "default"
    assert record.notes("z") == {}
