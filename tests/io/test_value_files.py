import base64
import json
import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as nps

from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import FORM, Limits, LoopRun
from revline.design.loops.outcome import LimitCycle, Settled
from revline.design.regions.gain_rays import GainLimit
from revline.design.tuning.fine_tuning import Objective
from revline.errors import InvalidInputError
from revline.io.value_files import SCHEMA, decode, encode, read_value, write_value
from revline.lti.transfer_function import TransferFunction
from revline.signals import TermKind
from revline.system import Variable
from revline.values import fingerprint

number = st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0, math.inf, -math.inf, 5e-324, -1.7976931348623157e308])
text = st.text(st.characters(exclude_categories=["Cs"]))
arrays = st.sampled_from(["<f8", ">f8", "<f4", "<c16", ">c8", "|b1", "|u1", "<i8", ">i2", "<U3"]).flatmap(
    lambda kind: nps.arrays(
        np.dtype(kind),
        nps.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
        elements=nps.from_dtype(np.dtype(kind), allow_nan=False),
    )
)
scalars = (
    number
    | st.integers()
    | st.booleans()
    | text
    | st.complex_numbers(allow_nan=False)
    | st.builds(complex, number, number)
    | st.sampled_from([*Objective, *TermKind])
)
gains = st.builds(
    PidGains,
    kp=st.floats(-1e9, 1e9),
    ki=st.floats(-1e9, 1e9),
    kd=st.floats(-1e9, 1e9),
    input_unit=st.just("rad/s"),
    output_unit=st.just("deg"),
    rule=st.text("abü", min_size=1),
    designed_on=st.just("g2"),
    details=st.dictionaries(st.text("ab", min_size=1), number | text, max_size=3),
)
records = (
    gains
    | st.builds(Limits, number, number)
    | st.builds(GainLimit, number, number)
    | st.builds(Variable, name=text, unit=text, low=number, nominal=number)
    | st.builds(Settled, value=number, steady_error=number, residual=number)
    | st.builds(TransferFunction, numerator=st.tuples(st.floats(1.0, 9.0)), denominator=st.tuples(st.floats(1.0, 9.0), st.floats(1.0, 9.0)))
)
values = st.recursive(
    scalars | arrays | records,
    lambda inner: st.lists(inner, max_size=4).map(tuple) | st.dictionaries(scalars, inner, max_size=3),
    max_leaves=8,
)


def bits(value: Any) -> Any:
    """Everything that makes a value: its type but for mappings, its numbers to the last bit with the signs of zeros, its parts."""
    parts: Any = value
    if isinstance(value, Mapping):
        return ("mapping", [(bits(key), bits(entry)) for key, entry in value.items()])
    if isinstance(value, np.ndarray):
        parts = (value.dtype.str, value.shape, value.tobytes())
    elif isinstance(value, float):
        parts = struct.pack("<d", value)
    elif isinstance(value, complex):
        parts = struct.pack("<dd", value.real, value.imag)
    elif isinstance(value, tuple):
        parts = [bits(item) for item in value]
    elif is_dataclass(value):
        parts = [bits(getattr(value, field.name)) for field in fields(value)]
    return (type(value), parts)


def same(a: Any, b: Any) -> bool:
    return bool(bits(a) == bits(b))


@settings(max_examples=300)
@given(value=values)
def test_every_value_comes_back_to_the_last_bit(value: Any) -> None:
    through = json.loads(json.dumps(encode(value), allow_nan=False))
    again = decode(through)
    assert same(again, value)
    assert fingerprint(again) == fingerprint(value)


def test_a_file_holds_a_nested_record(tmp_path: Path) -> None:
    law = PidGains(kp=0.1, ki=2.0, kd=0.0, input_unit="rad/s", output_unit="deg", rule="r", designed_on="m", details={"a": math.inf})
    cycle = LimitCycle(low=1.0, high=2.0, period=0.1, low_spread=0.0, high_spread=0.0, period_spread=0.0, cycles=5, swings=1, drift=-0.0)
    run = LoopRun(
        plant="g",
        gains=law,
        form=FORM,
        limits=Limits(),
        command=60.0,
        start=0.0,
        rest=0.0,
        times=np.arange(3.0),
        output=np.array([0.1, 0.2, 1 / 3]),
        control=np.zeros(3)[::-1],
        terms=np.empty((0, 3)),
        outcome=cycle,
        overshoot=0.1,
        step=1e-3,
    )
    write_value(tmp_path / "v.json", (run, {"one": (run,)}))
    first, others = read_value(tmp_path / "v.json")
    assert same(first, run)
    assert same(others["one"][0], run)
    assert isinstance(others, MappingProxyType)
    with pytest.raises(ValueError, match="read-only"):
        first.output[0] = 1.0


def test_scalars_of_numpy_become_plain_ones_and_arrays_are_locked() -> None:
    for value, plain in ((np.float64(0.1), 0.1), (np.float32(0.5), 0.5), (np.int64(3), 3), (np.bool_(1), True), (np.complex128(1j), 1j)):
        again = decode(encode(value))
        assert (again, type(again)) == (plain, type(plain))
    turned = np.arange(6.0).reshape(2, 3).T
    again = decode(encode(turned))
    np.testing.assert_array_equal(again, turned)
    with pytest.raises(ValueError, match="read-only"):
        again[0, 0] = 1.0


@dataclass(frozen=True)
class Foreign:
    value: float = 1.0


class ForeignTuple(NamedTuple):
    value: float = 1.0


class ForeignEnum(Enum):
    ONE = 1


@pytest.mark.parametrize("value", [Foreign(), ForeignTuple(), ForeignEnum.ONE, None, [1.0], {1.0}, object(), b"bytes", Path(), len])
def test_what_could_not_be_read_again_is_not_written(value: object, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=rf"a value of type {type(value).__name__} cannot be written; give records of this package"):
        write_value(tmp_path / "v.json", (value,))
    assert not list(tmp_path.iterdir())


def test_classes_made_inside_functions_and_shadowed_ones_are_not_written() -> None:
    @dataclass(frozen=True)
    class Local:
        value: float = 1.0

    Local.__module__ = "revline.system"
    with pytest.raises(InvalidInputError, match="a value of type Local cannot be written"):
        encode(Local())
    Local.__qualname__ = "Variable"
    with pytest.raises(InvalidInputError, match="a value of type Local cannot be written"):
        encode(Local())


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (math.nan, "a value is NaN"),
        (np.float64("nan"), "a value is NaN"),
        (complex(0.0, math.nan), "a value is NaN"),
        (np.array([1.0, math.nan]), "an array holds NaN"),
        (np.array([complex(math.nan, 0.0)]), "an array holds NaN"),
        (np.array([None]), "an array of type object cannot be written"),
        (np.zeros(1, dtype=[("a", "f8")]), r"an array of type \[\('a', '<f8'\)\] cannot be written"),
        (np.zeros(1, dtype="M8[s]"), r"an array of type datetime64\[s\] cannot be written"),
        (np.datetime64("2020-01-01"), "a number of type datetime64 cannot be written"),
        (np.longdouble(1), "a number of type longdouble cannot be written"),
    ],
)
def test_numbers_that_are_none_are_not_written(value: object, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        encode({"key": (value,)})


def test_a_text_that_utf_8_cannot_hold_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="cannot be written"):
        write_value(tmp_path / "v.json", "\ud800")
    assert not list(tmp_path.iterdir())


GOOD = {"array": "<f8", "shape": [2], "data": base64.b64encode(b"\0" * 16).decode()}


@pytest.mark.parametrize(
    "value",
    [
        {"class": "os:system", "fields": {}},
        {"class": "builtins:exec", "fields": {}},
        {"class": "subprocess:Popen", "fields": {"args": "true"}},
        {"class": "pathlib:Path", "fields": {}},
        {"class": "revlines.evil:Class", "fields": {}},
        {"class": "revline:errors", "fields": {}},
        {"class": "revline.io.value_files:importlib.import_module", "fields": {"name": "os"}},
        {"class": "revline.io.value_files:Path", "fields": {}},
        {"class": "revline.io.value_files:MappingProxyType", "fields": {}},
        {"class": "revline.io.value_files:InvalidInputError", "fields": {"message": "m"}},
        {"class": "revline.errors:InvalidInputError", "fields": {"message": "m"}},
        {"class": "revline.io.value_files:write_value", "fields": {}},
        {"class": "revline.io.value_files:write_value.__globals__", "fields": {}},
        {"class": "revline.system:Variable.__init__", "fields": {}},
        {"class": "revline.system:Variable.__class__", "fields": {}},
        {"class": "revline.system:Variable.__mro__", "fields": {}},
        {"class": "revline.design.loops.closed_loop:Settled", "fields": {"value": 1.0, "steady_error": 0.0, "residual": 0.0}},
        {"class": "revline.system:", "fields": {}},
        {"class": "revline.system", "fields": {}},
        {"class": "revline..system:Variable", "fields": {}},
        {"class": "revline.no_such_module:Variable", "fields": {}},
        {"class": "revline.system:Variable\0", "fields": {}},
        {"class": 5, "fields": {}},
        {"class": "revline.system:Variable", "fields": {"name": "a"}},
        {"class": "revline.system:Variable", "fields": {"name": "a", "unit": "m", "more": 1.0}},
        {"class": "revline.system:Variable", "fields": ["name"]},
        {"class": "revline.system:Variable", "member": "name"},
        {"class": "revline.system:Variable"},
        {"class": "revline.design.tuning.fine_tuning:Objective", "member": "OTHER"},
        {"class": "revline.design.tuning.fine_tuning:Objective", "fields": {"value": "load-error"}},
        {
            "class": "revline.lti.transfer_function:TransferFunction",
            "fields": {"numerator": {"tuple": [1.0]}, "denominator": {"tuple": [0.0]}},
        },
        {**GOOD, "array": "|O"},
        {**GOOD, "array": "|V8"},
        {**GOOD, "array": "f8,f8"},
        {**GOOD, "array": "("},
        {**GOOD, "array": ["<f8"]},
        {**GOOD, "array": "<f99"},
        {**GOOD, "shape": [3]},
        {**GOOD, "shape": [-1]},
        {**GOOD, "shape": [-2, -1]},
        {**GOOD, "shape": 2},
        {**GOOD, "shape": [2.0]},
        {**GOOD, "shape": [10**30, 0]},
        {**GOOD, "data": GOOD["data"][:-5]},
        {**GOOD, "data": "*" + str(GOOD["data"])},
        {**GOOD, "data": 5},
        {"array": "<f8"},
        {"float": "nan"},
        {"float": "x"},
        {"float": 10**400},
        {"complex": ["1.0"]},
        {"complex": ["1.0", "2.0", "3.0"]},
        {"complex": ["nan", "2.0"]},
        {"mapping": [[1.0]]},
        {"mapping": [[{"mapping": []}, 1.0]]},
        {"mapping": [[GOOD, 1.0]]},
        {"mapping": 1.0},
        {"tuple": 1.0},
        {"tuple": [[1.0]]},
        {"other": 1.0},
        {},
        [],
        None,
    ],
    ids=lambda value: str(value)[:60],
)
def test_a_forged_or_damaged_file_is_refused(value: Any, tmp_path: Path) -> None:
    path = tmp_path / "v.json"
    path.write_text(json.dumps({"schema": SCHEMA, "value": value}))
    with pytest.raises(InvalidInputError, match=r"v\.json holds a value that cannot be made again \(.*\); .* remove it"):
        read_value(path)


@pytest.mark.parametrize("depth", [200, 400, 700, 2000, 100_000])
def test_a_file_nested_too_deeply_is_refused(depth: int, tmp_path: Path) -> None:
    path = tmp_path / "v.json"
    opening, closing = '{"tuple": [' * depth, "]}" * depth
    path.write_text('{"schema": "' + SCHEMA + '", "value": ' + opening + "1.0" + closing + "}")
    try:
        value = read_value(path)
    except InvalidInputError as error:
        assert re.search(r"v\.json.*(cannot be made again|nested too deeply)", str(error))  # noqa: PT017 - shallow files are read
        return
    assert depth < 700
    for _ in range(depth):
        (value,) = value
    assert value == 1.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no JSON"),
        ('{"schema": "revline.value/1", "value": {"tuple": [1.0, 2.', "no JSON"),
        ('{"value": 1.0}', "its schema or its value is missing"),
        ('{"schema": "revline.value/1"}', "its schema or its value is missing"),
        ('{"schema": "revline.value/2", "value": 1.0}', "its schema is 'revline.value/2', and \"revline.value/1\" is wanted"),
        ('{"schema": "revline.controller/1", "value": 1.0}', "its schema is 'revline.controller/1'"),
        ('{"schema": "revline.value/1", "value": NaN}', "NaN is no JSON number"),
        ("[1.0]", "an object is wanted"),
        (b"\xff\xfe", "not UTF-8"),
    ],
)
def test_other_files_are_refused(content: str | bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "v.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InvalidInputError, match=message):
        read_value(path)


@given(cut=st.integers(0, 400))
def test_a_file_cut_anywhere_is_refused(cut: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("cut") / "v.json"
    write_value(path, (np.arange(4.0), Limits(), "text"))
    whole = path.read_bytes()
    path.write_bytes(whole[: min(cut, len(whole.rstrip()) - 1)])
    with pytest.raises(InvalidInputError, match=r"v\.json"):
        read_value(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"result file '.*none\.json' cannot be read: No such file"):
        read_value(tmp_path / "none.json")
