import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.values import fingerprint, make_read_only


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    values: np.ndarray
    name: str = "a"

    def __post_init__(self) -> None:
        make_read_only(self)


@dataclass(frozen=True)
class Other:
    values: object


class Pair(NamedTuple):
    first: float
    second: float


class Colour(Enum):
    RED = 1
    BLUE = 2


def test_a_results_arrays_cannot_be_written() -> None:
    result = Result(values=np.ones(3))
    with pytest.raises(ValueError, match="read-only"):
        result.values[0] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        result.values += 1.0  # type: ignore[misc]  # the assignment is refused too, after the addition


@pytest.mark.parametrize(
    "part", [lambda array: array, lambda array: array[:, 0], lambda array: array.T], ids=["whole", "column", "transposed"]
)
def test_a_result_does_not_follow_the_array_it_was_made_from(part: Callable[[np.ndarray], np.ndarray]) -> None:
    source = np.arange(6.0).reshape(3, 2)
    expected = part(source).copy()
    result = Result(values=part(source))
    source[:] = -1.0
    np.testing.assert_array_equal(result.values, expected)


def test_a_view_locked_over_an_open_array_is_copied_too() -> None:
    source = np.arange(3.0)
    view = source[:]
    view.setflags(write=False)
    result = Result(values=view)
    source[:] = -1.0
    np.testing.assert_array_equal(result.values, [0.0, 1.0, 2.0])


def test_a_locked_array_is_shared_without_a_copy() -> None:
    first = Result(values=np.ones(3))
    assert Result(values=first.values).values is first.values


def test_only_dataclasses_can_be_locked() -> None:
    with pytest.raises(TypeError, match=r"^Pair is no dataclass$"):
        make_read_only(Pair(1.0, 2.0))


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.complex_numbers() | st.text() | st.binary()
contents = st.recursive(
    scalars,
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text(), inner) | st.frozensets(scalars, max_size=3),
    max_leaves=8,
)


@given(contents, contents)
def test_equal_fingerprints_mean_equal_content(a: object, b: object) -> None:
    assert (fingerprint(a) == fingerprint(b)) == (plain(a) == plain(b))


def plain(value: object) -> object:
    """An independent normal form: text that names type and content of everything."""
    if isinstance(value, dict):
        return "mapping", frozenset((key, plain(entry)) for key, entry in value.items())
    if isinstance(value, frozenset):
        return "set", frozenset(plain(entry) for entry in value)
    if isinstance(value, tuple | list):
        return type(value).__name__, tuple(plain(entry) for entry in value)
    return type(value).__name__, repr(value)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ((1, 2), (12,)),
        (("a", "b"), ("ab",)),
        (1, 1.0),
        (0.0, -0.0),
        (1, True),
        ("1", 1),
        (Pair(1.0, 2.0), (1.0, 2.0)),
        (Colour.RED, Colour.BLUE),
        (Colour.RED, 1),
        (np.ones(2), np.ones((2, 1))),
        (np.ones(2), np.ones(2, dtype=np.float32)),
        (np.array([1.0]), np.array([1.0 + 2e-16])),
        (({}, {"a": 1}), ({"a": 1}, {})),
        ({"a": 1}, {"a": 2}),
        (frozenset("ab"), frozenset("ac")),
        (Other(1.0), Other(2.0)),
        (Other(1.0), (1.0,)),
    ],
)
def test_different_content_gives_different_fingerprints(a: object, b: object) -> None:
    assert fingerprint(a) != fingerprint(b)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (1.5, np.float64(1.5)),
        (3, np.int64(3)),
        (True, np.bool_(True)),  # noqa: FBT003 - the value under test
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}),
        ({"a": 1}, MappingProxyType({"a": 1})),
        (np.arange(6.0).reshape(2, 3).T, np.ascontiguousarray(np.arange(6.0).reshape(2, 3).T)),
        (Other(np.ones(2)), Other(np.ones(2))),
    ],
)
def test_equal_content_gives_equal_fingerprints(a: object, b: object) -> None:
    assert fingerprint(a) == fingerprint(b)


def test_a_content_digest_stands_for_its_owner() -> None:
    class Owner:
        content_digest = "abc"

    class Twin:
        content_digest = "abc"

    assert fingerprint(Owner()) == fingerprint(Twin()) != fingerprint("abc")


def test_fingerprints_are_the_same_in_another_process() -> None:
    code = "from revline.values import fingerprint as f; import numpy as np\n"
    code += "print(f(frozenset({frozenset('abc'), frozenset('xyz'), 'q'}), {'b': 1.0, 'a': np.arange(3)}, 'text', 0.1))"
    here = fingerprint(frozenset({frozenset("abc"), frozenset("xyz"), "q"}), {"b": 1.0, "a": np.arange(3)}, "text", 0.1)
    assert len(here) == 32
    for seed in ("1", "2", "3"):
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(__file__).parents[1] / "src")}
        command = [sys.executable, "-c", code]
        found = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout  # noqa: S603 - our own code
        assert found.strip() == here


@pytest.mark.parametrize("value", [object(), {1, 2}, int, Other, len])
def test_what_has_no_content_is_refused(value: object) -> None:
    with pytest.raises(InvalidInputError, match=r"^no fingerprint for a value of type \w+: give numbers, texts, arrays or frozen records"):
        fingerprint(1.0, value)


def test_an_array_of_objects_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"^no fingerprint for an array of Python objects: give an array of numbers$"):
        fingerprint(np.array([object()], dtype=object))
