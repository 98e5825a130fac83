import json
import math

import numpy as np
import pytest
from scipy.optimize import fsolve

from .conftest import Command


def steady_speed(throttle: float) -> float:
    """Speed at rest by an independent solver from the equations of Lee (1995), chapter 2, written out here."""

    def rates(unknowns: tuple[float, float]) -> list[float]:
        pressure, speed = unknowns
        mass = pressure * 0.0027 / (8.31434 / 28.84 * 310.0)
        efficiency = (24.5 * speed - 3.1e4) * mass**2 + (-0.167 * speed + 222.0) * mass + 8.1e-4 * speed + 0.352
        drawn = 0.112 * efficiency * speed * mass
        opening = 1.0 - math.cos(math.radians(min(1.14459 * throttle - 1.06, 90.0)))
        inflow = 0.1843 * (1.0 - math.exp(9.0 * (pressure / 100.0 - 1.0))) * opening
        mixture, spark = math.cos(math.radians(7.3834 * 1.5)), math.cos(math.radians(10.0)) ** 2.875
        torque = 498636.0 * drawn * mixture / speed * spark
        return [1e3 * (inflow - drawn), torque - 15.1 - 0.1056 * speed]

    return float(fsolve(rates, (36.0, 12.0 * throttle - 57.0), xtol=1e-12)[1])


@pytest.fixture(scope="module")
def angles() -> np.ndarray:
    return np.linspace(10.0, 40.0, 301)


@pytest.fixture(scope="module")
def speeds(angles: np.ndarray) -> np.ndarray:
    return np.array([steady_speed(angle) for angle in angles])


def test_a_line_over_a_range_is_the_least_squares_line(revline: Command, angles: np.ndarray, speeds: np.ndarray) -> None:
    slope, intercept = np.polyfit(angles, speeds, 1)
    errors = slope * angles + intercept - speeds
    found = json.loads(revline("map", "--line", "10,40", "--json").out)["line"]
    assert (found["low_deg"], found["high_deg"]) == (10.0, 40.0)
    assert found["slope_rad_s_per_deg"] == pytest.approx(slope, rel=1e-5)
    assert found["intercept_rad_s"] == pytest.approx(intercept, rel=1e-4)
    assert found["max_error_rad_s"] == pytest.approx(np.abs(errors).max(), rel=1e-3)
    assert found["max_error_at_deg"] == pytest.approx(angles[np.argmax(np.abs(errors))])
    assert found["max_error_of_span"] == pytest.approx(np.abs(errors).max() / np.ptp(speeds), rel=1e-3)


@pytest.mark.parametrize(("asked", "is_of"), [("0.5%", "part of the span"), ("2", "rad/s")])
def test_the_widest_linear_range_just_meets_its_tolerance(revline: Command, asked: str, is_of: str) -> None:
    found = json.loads(revline("map", "--from", 10, "--to", 40, "--points", 61, "--linear-within", asked, "--json").out)["operating_range"]
    assert found["tolerance_is"] == is_of
    grid = np.linspace(found["low_deg"], found["high_deg"], 301)
    exact = np.array([steady_speed(angle) for angle in grid])
    slope, intercept = np.polyfit(grid, exact, 1)
    worst = np.abs(slope * grid + intercept - exact).max()
    error = worst / np.ptp(exact) if asked.endswith("%") else worst
    assert error == pytest.approx(found["tolerance"], rel=2e-3)
    assert found["limited_by"] == "tolerance"
    assert 0.5 * (found["low_deg"] + found["high_deg"]) == pytest.approx(25.0)


def test_line_and_range_are_shown_to_people(revline: Command) -> None:
    out = revline("map", "--from", 10, "--to", 40, "--points", 31, "--line", "15,35", "--linear-within", "50", "--around", 20).out
    for part in ("Straight line over 15 to 35 deg", "slope", "rad/s per deg", "of the speed's change"):
        assert part in out
    assert "Widest range around 20 deg that is linear within 50 rad/s" in out
    assert "the end of the map" in out


def test_the_json_has_what_the_file_has(revline: Command) -> None:
    rows = json.loads(revline("map", "--from", 20, "--to", 30, "--points", 3, "--json").out)["steady_map"]
    assert rows[1]["indicated_torque_n_m"] == pytest.approx(15.1 + 0.1056 * rows[1]["speed_rad_s"])
    assert rows[1]["friction_torque_n_m"] == pytest.approx(rows[1]["indicated_torque_n_m"])
    assert rows[1]["cylinder_air_rate_kg_s"] == pytest.approx(0.0208406, rel=1e-5)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--line", "10"), 2, "--line '10' names 1 angles; give the two ends of a range"),
        (("--line", "2,40"), 2, "range 2 to 40 deg is empty or reaches beyond the map"),
        (("--linear-within", "x"), 2, "'x' is no finite number"),
        (("--linear-within", "1,2"), 2, "names more than one tolerance"),
        (("--linear-within", "0%"), 2, "tolerance = 0 of the span is outside 0 to infinity"),
        (("--linear-within", "1%", "--around", 3), 2, "centre = 3 deg is outside"),
        (("--linear-within", "1e-9%"), 1, "no range around throttle = 25 deg that holds 3 values of the map is linear within"),
        (("--from", 41, "-q"), 2, "--from 41 is not below --to 40: the angles must rise; give the lower one first"),
    ],
)
def test_what_map_refuses(arguments: tuple[object, ...], status: int, message: str, revline: Command) -> None:
    done = revline("map", "--from", 10, "--to", 40, "--points", 31, *arguments)
    assert (done.status, done.out) == (status, "")
    assert message in done.err
    assert len(done.err.splitlines()) == 1
