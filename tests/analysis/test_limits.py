"""Limits are found in the equations and not between samples, each with its distance; a one-sided derivative says its side."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from revline.analysis.limits import Limit
from revline.analysis.linearize import Kink, linearize
from revline.analysis.trim import find_trim
from revline.engine.catalogue import build_engine
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Floats

SATURATION = (90.0 + 1.06) / 1.14459
"""Throttle angle at which the characteristic reaches 1. Source: Lee (1995), eq. 2.3."""


@dataclass(frozen=True)
class Point:
    states: Floats
    inputs: Floats
    channels: Floats


def limits_at(system: DelaySystem, **inputs: float) -> dict[tuple[str, int], Limit]:
    return {(limit.argument, round(limit.at)): limit for limit in linearize(system, find_trim(system, inputs=inputs)).find_limits()}


@pytest.mark.parametrize("angle", [8.0, 25.0, 60.0, 79.5, 85.0])
def test_the_throttle_s_saturation_is_found_from_anywhere(engine: DelaySystem, angle: float) -> None:
    found = limits_at(engine, throttle=angle)[("throttle", 80)]
    assert found.at == pytest.approx(SATURATION, rel=1e-12)
    assert found.change == pytest.approx(SATURATION - angle, rel=1e-10)
    assert found.results == ("rate of manifold_pressure", "output throttle_air_rate")
    assert found.unit == "deg"
    assert found.share == pytest.approx(abs(found.change) / 90.0)


def test_each_limit_of_the_engine_is_there(engine: DelaySystem) -> None:
    """Air/fuel influence ends 90/7.3834 from 13.5, the pressure ratio at 1; the generic efficiency changes at 362.25 rad/s."""
    found = limits_at(engine, throttle=25.0)
    assert found[("manifold_pressure", 100)].at == pytest.approx(100.0, rel=1e-12)
    generic = limits_at(build_engine("lee1995-generic"), throttle=25.0)
    assert generic[("engine_speed", 362)].at == pytest.approx(362.25, rel=1e-12)
    assert "channel charge" in generic[("engine_speed", 362)].results
    assert found[("air_fuel_ratio", 26)].at == pytest.approx(13.5 + 90.0 / 7.3834, rel=1e-12)


def test_a_limit_near_by_is_a_warning_and_one_far_away_is_not(engine: DelaySystem) -> None:
    near = linearize(engine, find_trim(engine, inputs={"throttle": 79.5}))
    assert near.kinks == ()
    (text,) = near.warnings(near.find_limits())
    assert text == "a limit of rate of manifold_pressure begins near by, at throttle = 79.5569 deg, 0.0569 deg above this point"
    far = linearize(engine, find_trim(engine, inputs={"throttle": 25.0}))
    assert far.warnings(far.find_limits()) == ()
    assert far.residual < 1e-12


@pytest.mark.parametrize(("position", "side"), [(0.0, "kink"), (0.05, "above"), (-0.05, "below")])
def test_the_distance_to_a_kink_is_signed(kinked: DelaySystem, position: float, side: str) -> None:
    """max(z, 2 z) bends at 0; the force is limited at 1."""
    force = position if position <= 0.0 else 2.0 * position
    found = linearize(kinked, Point(np.array([position]), np.array([force]), np.array([position])))
    (bend,) = [limit for limit in found.find_limits() if limit.argument == "reading of echo"]
    assert bend.change == pytest.approx(-position, abs=1e-15)
    assert {"kink": True, "above": bend.change < 0.0, "below": bend.change > 0.0}[side]
    (force_limit,) = [limit for limit in found.find_limits() if limit.argument == "force"]
    assert force_limit.at == pytest.approx(1.0, rel=1e-14)


def test_a_one_sided_derivative_says_its_side(kinked: DelaySystem) -> None:
    (kink,) = linearize(kinked, Point(np.zeros(1), np.zeros(1), np.zeros(1))).kinks
    assert kink.side == {-1.0: "below", -2.0: "above"}[kink.used]
    assert str(kink).endswith(f"the model has {kink.used:g}, which holds {kink.side} alone")
    neither = replace(kink, used=-1.5)
    assert neither.side == "neither"
    assert str(neither).endswith("the model has -1.5, which is neither")
    assert Kink(result="a", argument="b", below=1.0, above=1.0, used=1.0).side == "both"


def test_a_drift_that_is_allowed_is_remarked_upon(linear: DelaySystem) -> None:
    """x' = -x/2 - x(t - 1) + u: at 1e-9 of its range per second a warning, at 1e-7 an error."""
    drifting = linearize(linear, Point(np.array([1.0]), np.array([1.5 + 2e-8]), np.array([1.0])))
    assert drifting.residual == pytest.approx(1e-9, rel=1e-6)
    assert drifting.warnings(drifting.find_limits()) == (
        "the point drifts by 1e-09 of a state's range per second; refine it (limit 1e-08)",
    )
    with pytest.raises(InvalidInputError, match="no steady state: position drifts by 2e-06"):
        linearize(linear, Point(np.array([1.0]), np.array([1.5 + 2e-6]), np.array([1.0])))


def test_other_steady_states_are_told(cubic: DelaySystem) -> None:
    found = linearize(cubic, find_trim(cubic))
    assert found.other_points == 2
    assert found.warnings(found.find_limits()) == ("one of 3 steady states known for these inputs; the model holds about this one alone",)
