import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.engine import air
from revline.engine.lee1995 import GENERIC_EFFICIENCY, LEE_1995, THESIS_EFFICIENCY
from revline.units import unit_of

THROTTLE, MANIFOLD, CYLINDERS = LEE_1995.throttle, LEE_1995.manifold, LEE_1995.cylinders
FULLY_OPEN = (90.0 + 1.06) / 1.14459

PRESSURES = st.floats(min_value=1.0, max_value=99.0)
SPEEDS = st.floats(min_value=10.0, max_value=1500.0)
ANGLES = st.floats(min_value=0.1, max_value=79.4)
MASSES = st.floats(min_value=1e-5, max_value=3e-3)


@pytest.mark.parametrize(
    ("pressure", "expected"),
    [(-5.0, 0.999876590195913), (0.0, 0.999876590195913), (50.0, 0.988891003461758), (100.0, 0.0), (120.0, 0.0)],
)
def test_pressure_influence_by_hand(pressure: float, expected: float) -> None:
    """1 - exp(-9) below zero pressure, 1 - exp(-4.5) at half of ambient, none from ambient on. Source: Lee (1995), eq. 2.2."""
    assert air.pressure_influence(THROTTLE, pressure) == pytest.approx(expected, rel=1e-14, abs=1e-15)


@given(PRESSURES, PRESSURES)
def test_pressure_influence_never_rises_and_stays_in_its_range(low: float, high: float) -> None:
    low, high = sorted((low, high))
    assert 0.0 <= air.pressure_influence(THROTTLE, high) <= air.pressure_influence(THROTTLE, low) < 1.0


@pytest.mark.reference
def test_the_throttle_characteristic_reaches_one_at_79_56_degrees() -> None:
    """Source: Lee (1995), eq. 2.3, where the corrected angle 1.14459 alpha - 1.06 is 90 degrees."""
    assert pytest.approx(79.56, abs=0.005) == FULLY_OPEN
    assert air.throttle_characteristic(THROTTLE, FULLY_OPEN) == pytest.approx(1.0, abs=1e-15)
    assert air.throttle_characteristic(THROTTLE, 79.46) == pytest.approx(1.0 - 0.002, abs=1e-4)
    for angle in (FULLY_OPEN + 0.01, 90.0, 120.0):
        assert air.throttle_characteristic(THROTTLE, angle) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (25.0, 1.0 - math.cos(math.radians(27.55475))),
        (0.0, 1.0 - math.cos(math.radians(1.06))),
        (-10.0, 1.0 - math.cos(math.radians(1.06))),
        (61.06 / 1.14459, 0.5),
    ],
)
def test_throttle_characteristic_by_hand(angle: float, expected: float) -> None:
    assert air.throttle_characteristic(THROTTLE, angle) == pytest.approx(expected, rel=1e-13)


@given(st.floats(min_value=-10.0, max_value=100.0), st.floats(min_value=-10.0, max_value=100.0))
def test_the_throttle_opens_with_its_angle_but_for_its_last_degree(first: float, second: float) -> None:
    """Below the offset's angle of 0.93 degrees the cosine is on its other branch, so the closed throttle leaks slightly more."""
    low, high = sorted((first, second))
    least = 1.06 / 1.14459
    if low >= least:
        assert air.throttle_characteristic(THROTTLE, low) <= air.throttle_characteristic(THROTTLE, high)
    assert 0.0 <= air.throttle_characteristic(THROTTLE, low) <= 1.0


def test_throttle_flow_is_the_product() -> None:
    expected = 0.1843 * (1.0 - math.exp(-4.5)) * 0.5
    assert air.throttle_flow(THROTTLE, 61.06 / 1.14459, 50.0) == pytest.approx(expected, rel=1e-13)


def test_manifold_by_hand() -> None:
    """At 100 kPa 0.27 kPa m3 over 0.2882920 * 310 kJ/kg; a flow of 1 g/s raises the pressure by 33.1 kPa/s."""
    energy = 8.31434 / 28.84 * 310.0
    assert air.manifold_air_mass(MANIFOLD, 100.0) == pytest.approx(0.27 / energy, rel=1e-14)
    assert air.manifold_air_mass(MANIFOLD, 100.0) == pytest.approx(3.02113e-3, rel=1e-5)
    assert air.manifold_pressure_rate(MANIFOLD, 0.003, 0.002) == pytest.approx(33.1002, rel=1e-5)
    assert air.manifold_pressure_rate(MANIFOLD, 0.003, 0.003) == 0.0


@given(PRESSURES, st.floats(min_value=-0.1, max_value=0.1))
def test_the_manifold_keeps_the_mass(pressure: float, flow: float) -> None:
    """The rate of the air mass that follows from the pressure's rate is the flow itself."""
    rate = air.manifold_pressure_rate(MANIFOLD, flow, 0.0)
    gained = air.manifold_air_mass(MANIFOLD, pressure + rate) - air.manifold_air_mass(MANIFOLD, pressure)
    assert gained == pytest.approx(flow, rel=1e-9, abs=1e-15)


@pytest.mark.reference
def test_thesis_efficiency_by_hand() -> None:
    """Source: Lee (1995), eq. 2.5, with the constant -3.1e4 of Cho and Hedrick (1989); at 1 g and 200 rad/s.

    (4900 - 31000) 1e-6 + (-33.4 + 222) 1e-3 + 0.162 + 0.352 = -0.0261 + 0.1886 + 0.514.
    """
    assert air.thesis_efficiency(THESIS_EFFICIENCY, 1e-3, 200.0) == pytest.approx(0.6765, rel=1e-14)
    assert air.thesis_efficiency(THESIS_EFFICIENCY, 0.0, 0.0) == 0.352


def thesis_generic(speed: float) -> float:
    """The pieces as the thesis prints them. Source: Lee (1995), chapter 2."""
    if speed < 362.25:
        return 0.81 + 1.51e-4 * (speed - 50.0)
    return -2e-6 * speed**2 + 1.6e-3 * speed + 0.54


@pytest.mark.reference
@given(st.floats(min_value=0.0, max_value=1500.0))
def test_generic_efficiency_follows_the_thesiss_pieces(speed: float) -> None:
    """Equal below 362.25 rad/s; above it lower by the step between the pieces, 1.25e-7. Source: Lee (1995), chapter 2."""
    step = 0.0 if speed < 362.25 else 1.25e-7
    assert air.generic_efficiency(GENERIC_EFFICIENCY, 1e-3, speed) == pytest.approx(thesis_generic(speed) - step, abs=1e-14)


def test_the_pieces_of_the_generic_efficiency_meet_with_one_slope() -> None:
    """Both slopes are 1.51e-4 there: the parabola's is -4e-6 * 362.25 + 1.6e-3."""
    at = air.generic_efficiency(GENERIC_EFFICIENCY, 0.0, 362.25)
    assert at == pytest.approx(0.81 + 1.51e-4 * 312.25, rel=1e-15)
    for side in (-1.0, 1.0):
        step = side * 1e-3
        beside = air.generic_efficiency(GENERIC_EFFICIENCY, 0.0, 362.25 + step)
        assert (beside - at) / step == pytest.approx(1.51e-4, abs=2.1e-9)
    for step in (1e-6, 1e-9):
        assert abs(air.generic_efficiency(GENERIC_EFFICIENCY, 0.0, 362.25 + step) - at) < 1.6e-4 * step + 1e-15


@given(MASSES, MASSES, SPEEDS)
def test_generic_efficiency_knows_no_mass(first: float, second: float, speed: float) -> None:
    assert air.generic_efficiency(GENERIC_EFFICIENCY, first, speed) == air.generic_efficiency(GENERIC_EFFICIENCY, second, speed)


def test_cylinder_flow_by_hand() -> None:
    assert air.cylinder_flow(CYLINDERS, 0.8, 240.0, 1e-3) == pytest.approx(0.112 * 0.8 * 240.0 * 1e-3, rel=1e-15)


@pytest.mark.reference
def test_pumping_follows_from_both_volumes() -> None:
    """Source: Lee (1995), eq. 2.9: displacement 0.0038 m3 over four pi times 0.0027 m3, printed as 0.112."""
    assert pytest.approx(0.0038 / (4.0 * math.pi * MANIFOLD.volume), abs=5e-4) == CYLINDERS.pumping


@given(PRESSURES, ANGLES, MASSES, SPEEDS, st.floats(min_value=0.3, max_value=1.2))
def test_complex_step_gives_the_derivatives(
    derivatives_agree: Callable[..., None], pressure: float, angle: float, mass: float, speed: float, efficiency: float
) -> None:
    equations: list[tuple[Any, Any, tuple[float, ...], float]] = [
        (air.pressure_influence, THROTTLE, (pressure,), 1.0),
        (air.throttle_characteristic, THROTTLE, (angle,), 1.0),
        (air.throttle_flow, THROTTLE, (angle, pressure), 0.1843),
        (air.manifold_air_mass, MANIFOLD, (pressure,), 1e-3),
        (air.manifold_pressure_rate, MANIFOLD, (0.01, 0.02), 300.0),
        (air.thesis_efficiency, THESIS_EFFICIENCY, (mass, speed), 1.0),
        (air.cylinder_flow, CYLINDERS, (efficiency, speed, mass), 0.1),
    ]
    if abs(speed - 362.25) > 1.0:
        equations.append((air.generic_efficiency, GENERIC_EFFICIENCY, (mass, speed), 1.0))
    for function, part, point, scale in equations:
        derivatives_agree(function, part, point, scale)


def test_units_are_the_sources() -> None:
    assert unit_of(air.ThesisEfficiency, "mass_squared") == "1/kg2"
    assert unit_of(air.GenericEfficiency, "parabola_squared") == "s2/rad2"
    assert unit_of(air.Manifold, "gas_constant") == "kJ/(kg K)"
