"""Equations that not every number can be put into: roots of what is negative, exponentials beyond all numbers, outputs without a value."""

from typing import NamedTuple

import numpy as np
import pytest

from revline.analysis.steady_map import find_steady_map
from revline.analysis.trim import find_trim
from revline.equations import Equation, equation
from revline.errors import InvalidInputError, NoTrimError
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]


class Constants(NamedTuple):
    """How steep the step is."""

    steepness: float = 0.0


@equation
def nothing(p: Constants, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return ()


@equation
def height(p: Constants, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def inverse(p: Constants, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 / x[0],)


@equation
def through_a_hole(p: Constants, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[0] - np.sqrt(x[0]),)


@equation
def over_a_step(p: Constants, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[0] - x[0] - 1.0 / (1.0 + np.exp(p.steepness * (x[0] - 0.45))),)


def tank(rate: Equation, steepness: float = 0.0, output: Equation = height, low: float = -np.inf) -> DelaySystem:
    level = Variable(name="level", unit="m", low=low, search_low=max(low, -2.0), search_high=10.0)
    return DelaySystem(
        name="tank",
        parameters=Constants(steepness=steepness),
        states=(level,),
        inputs=(Variable(name="flow", unit="m/s", low=0.0, high=3.0),),
        channels=(),
        outputs=(level,),
        emit=nothing,
        lags=nothing,
        rate=rate,
        output=output,
    )


def test_a_search_stays_where_its_equations_have_values() -> None:
    """Torricelli's law x' = u - sqrt(x), at rest where x = u^2: trial points below 0 have a value among complex numbers only."""
    flows = np.linspace(0.0, 2.8, 29)
    found = find_steady_map(tank(through_a_hole), sweep_input="flow", values=flows, output="level")
    assert found.values.tolist() == flows.tolist()
    assert found.output_values == pytest.approx(flows**2, abs=1e-9)
    assert (found.missing, found.boundaries) == ((), ())


@equation
def rising_slowly(p: Constants, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (u[0] - 1.0 - np.log(1.0 + 4.0 * x[0]),)


def test_a_limit_at_which_an_equation_is_infinitely_steep_holds_no_search() -> None:
    """The tank again, its level stated to be 0 or more: the steps of Newton's method lead below, and at 0 a root is infinitely steep."""
    for flow in (0.0, 1e-3, 0.05, 0.1, 0.25, 1.0, 2.8):
        found = find_trim(tank(through_a_hole, low=0.0), inputs={"flow": flow})
        assert found.state("level") == pytest.approx(flow**2, rel=1e-9, abs=1e-15)


def test_a_steady_state_on_a_limit_is_found() -> None:
    """At rest log(1 + 4 x) = u - 1: the steps of Newton's method lead beyond 0, where at u = 1 the steady state is."""
    assert find_trim(tank(rising_slowly, low=0.0), inputs={"flow": 1.0}).state("level") == pytest.approx(0.0, abs=1e-15)
    with pytest.raises(NoTrimError, match=r"no trim at flow = 0.9 m/s: level still drifts by 0.1 m/s "):
        find_trim(tank(rising_slowly, low=0.0), inputs={"flow": 0.9})


@pytest.mark.parametrize(("flow", "level"), [(0.3, -0.7), (1.2, 1.2)])
def test_an_exponential_beyond_complex_numbers_is_no_end(flow: float, level: float) -> None:
    """Far from the step exp(900 (x - 0.45)) overflows, so that trial points have a value and no complex step."""
    assert find_trim(tank(over_a_step, steepness=900.0), inputs={"flow": flow}).state("level") == pytest.approx(level, abs=1e-9)


def test_a_derivative_without_a_value_is_named() -> None:
    with pytest.raises(InvalidInputError, match=r"tank: the rate of level has no finite derivative by level at this steady state \(nan\)"):
        find_trim(tank(over_a_step, steepness=5000.0), inputs={"flow": 1.2})


def test_an_output_without_a_value_is_named() -> None:
    with pytest.raises(InvalidInputError, match=r"level = inf m at rest; an output without a value makes no trim"):
        find_trim(tank(through_a_hole, output=inverse), inputs={"flow": 0.0})
