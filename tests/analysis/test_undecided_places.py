"""Steady maps in which one place lacks a lag, a derivative or an output: it alone is told, and no end is seen in it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from revline.analysis.operating_range import fit_line
from revline.analysis.steady_map import SteadyMap, Undecided, find_steady_map
from revline.analysis.trim import find_trim
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]


class Steep(NamedTuple):
    gain: float = 1.0
    lag: float = 1.0


def follower(**changes: object) -> DelaySystem:
    """x' = u - x, so that x = u at rest."""
    position = Variable(name="position", unit="m", search_low=-10.0, search_high=10.0)
    system = DelaySystem(
        name="follower",
        parameters=Steep(),
        states=(position,),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(replace(position, name="echo"),),
        outputs=(position,),
        emit=lambda p, x, u, zd: (x[0],),  # noqa: ARG005 - the form of all equations
        lags=lambda p, x, u, zd: (p.lag + 0.0 * x[0],),  # noqa: ARG005 - the form of all equations
        rate=lambda p, x, u, zd: (u[0] - x[0] + 0.0 * zd[0],),  # noqa: ARG005 - the form of all equations
        output=lambda p, x, u, zd: (x[0],),  # noqa: ARG005 - the form of all equations
    )
    return replace(system, **changes)  # type: ignore[arg-type]  # equations, which differ in their form alone


def mapped(system: DelaySystem, values: object = (0.0, 0.25, 0.5, 0.75, 1.0)) -> SteadyMap:
    return find_steady_map(system, sweep_input="force", values=values, output="position")  # type: ignore[arg-type]  # a list will do


def touching_lag(p: Steep, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return ((u[0] - 0.5) ** 2,)


def lag_of_a_root(p: Steep, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (np.sqrt((u[0] - 0.5) ** 2 - 0.01),)


def pole(p: Steep, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 / (u[0] - 0.5),)


def overflowing(p: Steep, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Near 0.5 the exponential is beyond the range of numbers, and among complex ones its part has no value."""
    return (u[0] - x[0] + 1e-12 * zd[0] / (1.0 + np.exp(4e4 * (0.02 - (x[0] - 0.51) ** 2))),)


def at_an_edge(p: Steep, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Near 0 the exponential is beyond the range of numbers, and below 0 there is no value."""
    return (u[0] - x[0] + 0.0 * np.sqrt(x[0]) + 1e-12 * zd[0] / (1.0 + np.exp(4e4 * (0.02 - (x[0] - 0.01) ** 2))),)


BAD_AT_HALF = [
    pytest.param({"lags": touching_lag}, "lag of echo = 0 s is outside", id="no lag"),
    pytest.param({"lags": lag_of_a_root}, "lag of echo = nan s is outside", id="lag without value"),
    pytest.param({"output": pole}, "position = inf m at rest; an output without", id="no output"),
    pytest.param({"rate": overflowing}, "the rate of position has no finite derivative by position", id="no derivative"),
]


@pytest.mark.parametrize(("change", "reason"), BAD_AT_HALF)
def test_one_bad_place_is_told_and_the_others_are_found(change: dict[str, object], reason: str) -> None:
    system = follower(**change)
    found = mapped(system)
    assert found.values.tolist() == [0.0, 0.25, 0.75, 1.0]
    assert [trim.state("position") for trim in found.trims] == pytest.approx([0.0, 0.25, 0.75, 1.0], abs=1e-9)
    (bad,) = found.missing
    assert isinstance(bad, Undecided)
    assert (bad.value, found.boundaries) == (0.5, ())
    assert reason in bad.reason
    assert found.warnings == (f"at force = 0.5 N, undecided: {bad.reason}",)
    with pytest.raises(InvalidInputError, match=reason):
        find_trim(system, inputs={"force": 0.5})
    with pytest.raises(
        InvalidInputError, match=r"the steady state at force = 0.5 N inside the range is undecided \(.*\); narrow the range"
    ):
        fit_line(found, low=0.0, high=1.0)


@pytest.mark.parametrize(("change", "reason"), BAD_AT_HALF)
def test_a_map_of_bad_places_alone_is_refused(change: dict[str, object], reason: str) -> None:
    """At the other value the state leaves its search range: the map has no trim."""
    narrow = replace(follower(**change), states=(replace(follower().states[0], search_high=0.6),))
    with pytest.raises(InvalidInputError, match=reason):
        mapped(narrow, (0.5, 4.0))


def test_a_place_where_differences_give_no_slope_either_is_told() -> None:
    found = mapped(follower(rate=at_an_edge), (0.0, 0.5, 1.0))
    assert found.values.tolist() == [0.5, 1.0]
    assert [(entry.value, type(entry)) for entry in found.missing] == [(0.0, Undecided)]


def test_an_end_among_undecided_places_is_not_enclosed_closer_than_it_is_known() -> None:
    """Steady states go on to 3 N, where x leaves its search range; between 2 and 3 N nothing is known of their stability."""
    system = follower(
        states=(replace(follower().states[0], search_high=3.0),),
        lags=lambda p, x, u, zd: (np.maximum((u[0] - 2.0) * (u[0] - 3.0), 0.0),),  # noqa: ARG005 - the form of all equations
    )
    for values in ((0.0, 1.0, 2.5, 4.0), (0.0, 1.0, 4.0)):
        found = mapped(system, values)
        (end,) = found.boundaries
        assert 1.9 < end.value <= 2.0
        assert end.without.value == pytest.approx(3.0, abs=2e-6)
        assert "lag of echo = 0 s" in end.undecided
        assert (
            f"steady states end above force = {end.value:.6g} N, where position = {end.value:.4g} m, and before 3 N; undecided"
            in "".join(found.warnings)
        )
    plain = mapped(replace(system, lags=follower().lags), (0.0, 1.0, 4.0)).boundaries[0]
    assert plain.value == pytest.approx(3.0, abs=2e-6)
    assert not plain.undecided
