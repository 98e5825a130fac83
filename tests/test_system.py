import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable, check_range, index_of

Equation = Callable[[Any, Any, Any, Any], Any]


class Gains(NamedTuple):
    gain: float


class OtherGains(NamedTuple):
    gain: float


def signals(*names: str, low: float = -math.inf, high: float = math.inf, nominal: float = 0.0) -> tuple[Variable, ...]:
    return tuple(Variable(name=name, unit="1", low=low, high=high, nominal=nominal) for name in names)


def system(**changes: Any) -> DelaySystem:
    """Two states, two inputs, two channels of which the second's lag reads the first."""
    fields: dict[str, Any] = {
        "name": "loop",
        "parameters": Gains(2.0),
        "states": signals("a", "b"),
        "inputs": signals("u", "v", low=-1.0, high=5.0, nominal=0.5),
        "channels": signals("c", "d"),
        "outputs": signals("a", "sum"),
        "emit": lambda p, x, u, zd: (p.gain * x[0], u[1] * zd[0]),
        "lags": lambda p, x, u, zd: (0.1, 0.2 + 0.01 * zd[0]),  # noqa: ARG005 - the form of all equations
        "rate": lambda p, x, u, zd: (-x[0] + u[0], zd[1] - x[1]),  # noqa: ARG005 - the form of all equations
        "output": lambda p, x, u, zd: (x[0], x[0] + p.gain * x[1]),  # noqa: ARG005 - the form of all equations
    }
    return DelaySystem(**(fields | changes))


def returning(*results: float) -> Equation:
    return lambda p, x, u, zd: results  # noqa: ARG005 - the form of all equations


def test_structure_tells_what_depends_on_what() -> None:
    structure = system().structure
    assert structure.emit == (frozenset({"x0"}), frozenset({"u1", "zd0"}))
    assert structure.lags == (frozenset(), frozenset({"zd0"}))
    assert structure.rate == (frozenset({"x0", "u0"}), frozenset({"x1", "zd1"}))
    assert structure.output == (frozenset({"x0"}), frozenset({"x0", "x1"}))


@pytest.mark.parametrize("what", ["emit", "lags", "rate", "output"])
def test_a_wrong_number_of_results_is_refused(what: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^loop: {what} returns 3 results where 2 signals are named$"):
        system(**{what: returning(1.0, 1.0, 1.0)})


@pytest.mark.parametrize(("position", "reading"), [(0, 0), (0, 1), (1, 1)])
def test_a_lag_that_reads_its_own_or_a_later_channel_is_refused(position: int, reading: int) -> None:
    def lags(p: Any, x: Any, u: Any, zd: Any) -> Any:  # noqa: ARG001 - the form of all equations
        return tuple(0.1 + zd[reading] if k == position else 0.1 for k in range(2))

    channel = "cd"[position]
    with pytest.raises(
        InvalidInputError, match=f"^loop: the lag of channel {channel} depends on its own or a later .*; order the channels$"
    ):
        system(lags=lags)


@pytest.mark.parametrize("what", ["states", "inputs", "channels", "outputs"])
def test_a_name_borne_twice_is_refused(what: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^loop: 2 {what} are named a; give each its own name$"):
        system(**{what: signals("a", "a")})


def test_digests_follow_equations_and_parameters() -> None:
    first, again = system(), system()
    assert first.equation_digest == again.equation_digest
    assert first.content_digest == again.content_digest
    stronger = first.with_parameters(Gains(3.0))
    assert stronger.parameters == Gains(3.0)
    assert stronger.equation_digest == first.equation_digest
    assert stronger.content_digest != first.content_digest
    other = system(output=lambda p, x, u, zd: (x[0], x[0] - p.gain * x[1]))  # noqa: ARG005 - the form of all equations
    assert other.equation_digest != first.equation_digest
    assert other.content_digest != first.content_digest
    assert replace(first, name="another").content_digest == first.content_digest
    assert system(inputs=signals("u", "v")).content_digest != first.content_digest


@pytest.mark.parametrize("parameters", [OtherGains(2.0), (2.0,), 2.0])
def test_parameters_of_another_type_are_refused(parameters: object) -> None:
    with pytest.raises(InvalidInputError, match=r"^loop has Gains, not \w+, for parameters; give those$"):
        system().with_parameters(parameters)


def test_inputs_not_named_are_nominal() -> None:
    np.testing.assert_array_equal(system().input_vector(), [0.5, 0.5])
    np.testing.assert_array_equal(system().input_vector({"v": 5.0}), [0.5, 5.0])


def test_an_unknown_input_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"^loop has no input w, z; its inputs are u, v$"):
        system().input_vector({"z": 1.0, "u": 1.0, "w": 1.0})


@pytest.mark.parametrize("value", [5.1, -1.1, math.nan, math.inf, -math.inf])
def test_a_value_out_of_range_is_refused(value: float) -> None:
    expected = f"u = {value:g} is outside -1 to 5; give a value in that range"
    with pytest.raises(InvalidInputError, match=f"^{re.escape(expected)}$"):
        system().input_vector({"u": value})


def test_a_range_includes_its_ends() -> None:
    variable = Variable(name="speed", unit="rad/s", low=0.0, high=10.0)
    check_range(variable, 0.0)
    check_range(variable, 10.0)
    check_range(Variable(name="speed", unit="rad/s"), -1e300)
    with pytest.raises(InvalidInputError, match=r"^speed = inf rad/s is outside -inf to inf rad/s"):
        check_range(Variable(name="speed", unit="rad/s"), math.inf)


def test_a_variable_is_found_by_name() -> None:
    assert index_of(signals("a", "b"), "b") == 1
    with pytest.raises(InvalidInputError, match=r"^there is no signal c; there are a, b$") as caught:
        index_of(signals("a", "b"), "c")
    assert caught.value.details["name"] == "c"
