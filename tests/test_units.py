import math
from typing import Annotated, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.units import DEGREE, RPM, Kilograms, Meaning, NewtonMetres, meaning_of, rpm_to_speed, speed_to_rpm, unit_of


class Record(NamedTuple):
    plain: float
    mass: Kilograms
    first_torque: Annotated[NewtonMetres, Meaning("torque at first", "Newton (1687)")]


def test_a_unit_is_read_back() -> None:
    assert [unit_of(Record, field) for field in Record._fields] == ["1", "kg", "N m"]


def test_a_meaning_is_read_back_or_made_of_the_name() -> None:
    assert meaning_of(Record, "first_torque") == Meaning("torque at first", "Newton (1687)")
    assert meaning_of(Record, "mass") == Meaning("mass", "")


def test_an_unknown_field_has_no_unit() -> None:
    with pytest.raises(KeyError, match="volume"):
        unit_of(Record, "volume")


def test_a_turn_is_360_degrees_and_60_per_minute() -> None:
    assert pytest.approx(2.0 * math.pi) == 360.0 * DEGREE
    assert pytest.approx(2.0 * math.pi) == 60.0 * RPM
    assert speed_to_rpm(2.0 * math.pi) == pytest.approx(60.0)


@given(st.floats(min_value=-1e9, max_value=1e9))
def test_conversions_are_inverse(speed: float) -> None:
    assert rpm_to_speed(speed_to_rpm(speed)) == pytest.approx(speed, rel=1e-15)
