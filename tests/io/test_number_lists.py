import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.io.number_lists import parse_numbers, parse_pairs


@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_numbers_come_back(values: list[float]) -> None:
    assert parse_numbers(", ".join(map(repr, values)), "numbers") == tuple(values)


@pytest.mark.parametrize("text", ["", "1,", "a", "1;2", "nan", "inf", "1_000", "1,,2"])
def test_what_is_no_list_of_numbers_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match="is no finite number; give numbers separated by commas"):
        parse_numbers(text, "numbers")


def test_pairs_are_read() -> None:
    assert parse_pairs("a=b, c = d=e", "--columns") == {"a": "b", "c": "d=e"}


@pytest.mark.parametrize("text", ["", "a", "a=", "=b", "a=b,,c=d"])
def test_what_is_no_pair_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match="is no pair; give KEY=VALUE, separated by commas"):
        parse_pairs(text, "--columns")


def test_a_key_twice_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="a stands there twice; keep one"):
        parse_pairs("a=b,a=c", "--columns")
