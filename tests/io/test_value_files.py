"""Values are kept to the last bit, and what was not written by this package is not made."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controller import PidGains
from revline.design.fine_tuning import Objective
from revline.errors import InvalidInputError
from revline.io.value_files import decode, encode, read_value, write_value
from revline.studies.config import StudyConfig
from revline.values import fingerprint

numbers = st.floats(allow_nan=False) | st.integers() | st.complex_numbers(allow_nan=False) | st.booleans() | st.text() | st.none()
values = st.recursive(numbers, lambda inner: st.tuples(inner, inner) | st.dictionaries(st.text(), inner).map(MappingProxyType))


@given(value=values)
def test_numbers_and_structures_read_back_to_the_last_bit(value: Any) -> None:
    again = decode(json.loads(json.dumps(encode(value), allow_nan=False)))
    assert again == value
    assert type(again) is type(value)


@pytest.mark.parametrize("array", [np.array([0.1, -0.0, math.inf]), np.eye(2) * (1 + 2j), np.arange(3), np.zeros((0, 2))])
def test_arrays_keep_bytes_type_and_shape(array: np.ndarray, tmp_path: Path) -> None:
    write_value(tmp_path / "array.json", array)
    again = read_value(tmp_path / "array.json")
    assert (again.dtype, again.shape, again.tobytes()) == (array.dtype, array.shape, array.tobytes())


def test_records_and_enums_come_back_as_what_they_were() -> None:
    law = PidGains(kp=1.0, ki=0.1, kd=0.0, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="g1")
    assert fingerprint(decode(encode(law))) == fingerprint(law)
    assert decode(encode(StudyConfig(throttle_deg=20.0))) == StudyConfig(throttle_deg=20.0)
    assert decode(encode(Objective.LOAD_ERROR)) is Objective.LOAD_ERROR


def test_not_a_number_stays_so() -> None:
    assert math.isnan(decode(json.loads(json.dumps(encode(math.nan), allow_nan=False))))


def test_what_is_no_value_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="a value of type list cannot be written; give records"):
        write_value(tmp_path / "list.json", [1.0])
    assert list(tmp_path.iterdir()) == []


def _edit(change: Callable[[dict[str, Any]], None], path: Path) -> None:
    content = json.loads(path.read_text())
    change(content["value"])
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda v: v.update({"class": "os:system"}), "is no class of this package"),
        (lambda v: v.update({"class": "revline.io.value_files:encode"}), "is no record"),
        (lambda v: v.update({"class": "revline.no_such:Thing"}), "No module named"),
        (lambda v: v["fields"].update({"extra": 1}), "extra"),
        (lambda v: v["fields"].update({"throttle_deg": "wide"}), "must be real number"),
    ],
)
def test_a_file_of_other_making_is_refused(change: Callable[[dict[str, Any]], None], reason: str, tmp_path: Path) -> None:
    path = tmp_path / "value.json"
    write_value(path, StudyConfig())
    _edit(change, path)
    with pytest.raises(InvalidInputError, match=rf"cannot be made again \(.*{reason}.*remove it"):
        read_value(path)
