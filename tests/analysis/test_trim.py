"""Steady states: all of them, their stability, those left out, and how near a search came where there is none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.analysis.halton import halton
from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim, find_trim, pose
from revline.analysis.trim_refusals import LeftOut
from revline.errors import InvalidInputError, NoTrimError
from revline.system import DelaySystem


@pytest.mark.reference
@pytest.mark.parametrize(
    ("angle", "speed", "tolerance"),
    [
        (10.0, 64.46696, 1e-5),
        (15.0, 121.238, 5e-4),
        (20.0, 180.67560, 1e-5),
        (25.0, 240.79901, 1e-5),
        (30.0, 300.77841, 1e-5),
        (35.0, 360.154, 5e-4),
        (40.0, 418.61425, 1e-5),
        (50.0, 531.854, 5e-4),
        (60.0, 638.93399, 1e-5),
    ],
)
def test_engine_speed_at_throttle_angle(engine: DelaySystem, angle: float, speed: float, tolerance: float) -> None:
    """Steady speeds of the engine of Lee (1995), Fig. 4.1, recomputed."""
    trim = find_trim(engine, inputs={"throttle": angle})
    assert trim.state("engine_speed") == pytest.approx(speed, abs=tolerance)
    assert trim.stable
    assert (trim.unstable_count, trim.alternatives, trim.left_out) == (0, (), ())
    assert trim.residual < 1e-12


@pytest.mark.reference
def test_operating_point(engine: DelaySystem) -> None:
    """The operating point of Lee (1995), chapter 4: 35.8072 kPa at 25 deg; lags are 5.48 and 1.30 rad over the speed."""
    trim = find_trim(engine, inputs={"throttle": 25.0})
    assert trim.state("manifold_pressure") == pytest.approx(35.80718, abs=1e-5)
    assert trim.lag("charge") == pytest.approx(5.48 / 240.79901, rel=1e-7)
    assert trim.output("engine_acceleration") == pytest.approx(0.0, abs=1e-9)
    assert trim.input("air_fuel_ratio") == 15.0
    assert trim.channel("spark_influence") == pytest.approx(np.cos(np.pi / 18) ** 2.875)
    assert trim.roots.roots[0].real == pytest.approx(-2.0717, abs=1e-4)


@pytest.mark.reference
@pytest.mark.parametrize(("angle", "unstable"), [(3.0, 2), (4.0, 2), (5.0, 2), (6.0, 0), (7.0, 0)])
def test_low_angles_are_unstable(engine: DelaySystem, angle: float, unstable: int) -> None:
    """At 3 to 5 deg two roots lie in the right half-plane, from 6 deg none; recomputed from Lee (1995), chapter 2."""
    pressure, speed = engine.states
    low = replace(engine, states=(pressure, replace(speed, search_low=1.0)))
    trim = find_trim(low, inputs={"throttle": angle})
    assert trim.unstable_count == unstable
    assert trim.stable is (unstable == 0)


def test_speed_and_load_prescribed_free_throttle(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"load_torque": 10.0}, outputs={"engine_speed": 240.0}, free=("throttle",))
    assert trim.state("engine_speed") == pytest.approx(240.0, abs=1e-10)
    again = find_trim(engine, inputs={"load_torque": 10.0, "throttle": trim.input("throttle")})
    assert again.states == pytest.approx(trim.states, rel=1e-12)


@given(st.floats(6.0, 75.0), st.floats(-5.0, 20.0))
@settings(max_examples=15, deadline=None)
def test_throttle_to_speed_and_back(angle: float, load: float) -> None:
    from revline.engine.lee1995 import lee1995  # noqa: PLC0415 - a fixture cannot serve a property test

    engine = lee1995()
    try:
        trim = find_trim(engine, inputs={"throttle": angle, "load_torque": load})
    except NoTrimError:
        assert load > 0.0
        return
    speed = trim.state("engine_speed")
    back = find_trim(engine, inputs={"load_torque": load}, outputs={"engine_speed": speed}, free=("throttle",))
    angles = [t.input("throttle") for t in (back, *back.alternatives)]
    assert min(abs(a - angle) for a in angles) < 1e-8


def test_any_output_can_be_prescribed(engine: DelaySystem) -> None:
    trim = find_trim(engine, outputs={"cylinder_air_rate": 0.02, "friction_torque": 40.0}, free=("throttle", "load_torque"))
    assert trim.output("cylinder_air_rate") == pytest.approx(0.02, rel=1e-9)
    assert trim.output("friction_torque") == pytest.approx(40.0, rel=1e-9)


def test_linear_trim_in_closed_form(linear: DelaySystem) -> None:
    trim = find_trim(linear, inputs={"force": 3.0})
    assert trim.states == pytest.approx([2.0], rel=1e-14)
    assert trim.channels == pytest.approx([2.0], rel=1e-14)
    assert trim.system == "linear"


def test_pendulum_hangs_and_stands(pendulum: DelaySystem) -> None:
    trim = find_trim(pendulum)
    assert trim.state("angle") == pytest.approx(0.0, abs=1e-12)
    assert trim.stable
    (standing,) = trim.alternatives
    assert standing.state("angle") == pytest.approx(np.pi, abs=1e-12)
    assert (standing.stable, standing.unstable_count) == (False, 1)


def test_near_chooses_the_nearest(pendulum: DelaySystem) -> None:
    trim = find_trim(pendulum, near={"angle": 3.0})
    assert trim.state("angle") == pytest.approx(np.pi, abs=1e-12)
    assert trim.alternatives[0].state("angle") == pytest.approx(0.0, abs=1e-12)


def test_all_solutions_are_found_and_ordered(cubic: DelaySystem) -> None:
    """x' = x - x(t - 1)^3: unstable at -1 and 1 with two roots each, at 0 with one; fewest first, then the largest output."""
    trim = find_trim(cubic)
    found = [(round(t.state("position"), 9), t.unstable_count) for t in (trim, *trim.alternatives)]
    assert found == [(0.0, 1), (1.0, 2), (-1.0, 2)]


def test_state_outside_search_range_is_left_out_and_named(chain: DelaySystem) -> None:
    trim = find_trim(chain)
    assert trim.state("level") == pytest.approx(1.0)
    (other,) = trim.left_out
    assert other.quantity == "level"
    assert other.value == pytest.approx(-1.5)
    assert other.longest_lag == pytest.approx(1.0 + 0.1 * 2.25)
    # s + 1 = 6 exp(-1.725 s) has one real root and one pair right of the imaginary axis.
    stability = "unstable (3 roots right of the imaginary axis)"
    assert str(other) == f"left out: a steady state at level = -1.5 m, with a lag of 1.23 s, {stability}, below the search limit 0 m"


@pytest.mark.reference
def test_what_is_left_out_says_its_stability(engine: DelaySystem) -> None:
    """At 3 deg the thesis's engine rests at 4.74 rad/s, unstable with two roots."""
    with pytest.raises(NoTrimError, match=r"engine_speed = 4\.743 rad/s, with a lag of 1\.16 s, unstable \(2 roots"):
        find_trim(engine, inputs={"throttle": 3.0})


def test_left_out_above_without_lag() -> None:
    entry = LeftOut(quantity="a", value=7.0, unit="m", limit=5.0, longest_lag=0.0)
    assert str(entry) == "left out: a steady state at a = 7 m, above the search limit 5 m"


@pytest.mark.reference
def test_engine_at_closed_throttle_has_only_what_no_engine_runs_at(engine: DelaySystem) -> None:
    """0.97 rad/s at 0 deg, with lags over a second; recomputed from Lee (1995), chapter 2."""
    with pytest.raises(
        NoTrimError, match=r"no trim at throttle = 0 deg inside the search range .*engine_speed = 0.9708 rad/s, with a lag of 5.6"
    ):
        find_trim(engine, inputs={"throttle": 0.0})


def test_channel_loop_trims(loop: DelaySystem) -> None:
    """At rest x = -2 z, so that z (1 + 2) = 0.5 sin z, which holds at 0 alone."""
    trim = find_trim(loop)
    assert trim.states == pytest.approx([0.0], abs=1e-12)


def test_system_without_states_rests_at_once(linear: DelaySystem) -> None:
    """A pure delay: y = 2 u(t - 1)."""

    def emit(p: object, x: tuple[()], u: tuple[float], zd: tuple[float]) -> tuple[float]:  # noqa: ARG001 - the form of all equations
        return (2.0 * u[0],)

    def nothing(p: object, x: tuple[()], u: tuple[float], zd: tuple[float]) -> tuple[()]:  # noqa: ARG001 - the form of all equations
        return ()

    def reading(p: object, x: tuple[()], u: tuple[float], zd: tuple[float]) -> tuple[float]:  # noqa: ARG001 - the form of all equations
        return (zd[0],)

    delay = replace(linear, states=(), emit=emit, rate=nothing, output=reading)
    trim = find_trim(delay, inputs={"force": 1.5})
    assert (trim.output("position"), trim.residual, trim.stable, trim.alternatives) == (3.0, 0.0, True, ())
    assert find_trim(delay, outputs={"position": 5.0}, free=("force",)).input("force") == pytest.approx(2.5)


def test_no_trim_says_how_near_it_came(endless: DelaySystem) -> None:
    pattern = r"no trim at nominal inputs: position still drifts by 1(\.\d+)? m/s \(limit 2e-07 m/s\)\. .*see find_steady_map"
    with pytest.raises(NoTrimError, match=pattern) as caught:
        find_trim(endless)
    assert caught.value.details["drift"] == pytest.approx(1.0, abs=1e-3)


def test_no_trim_names_the_request(engine: DelaySystem) -> None:
    with pytest.raises(NoTrimError, match=r"no trim at engine_speed = 314.2 rad/s, load_torque = 500 N m: .* still (drifts|misses)"):
        find_trim(engine, inputs={"load_torque": 500.0}, outputs={"engine_speed": 314.2}, free=("throttle",))


def test_missed_output_is_named(linear: DelaySystem) -> None:
    """The force reaches 5 N, which holds 3.33 m; 9 m are out of reach."""
    with pytest.raises(NoTrimError, match=r"position (still drifts|still misses its value) by"):
        find_trim(linear, outputs={"position": 9.0}, free=("force",))


def test_output_that_cannot_be_met_is_named(linear: DelaySystem) -> None:
    """The output is bounded by 1 at any state."""

    def bounded(p: object, x: tuple[float], u: tuple[float], zd: tuple[float]) -> tuple[float]:  # noqa: ARG001 - the form of all equations
        return (np.tanh(x[0]),)

    system = replace(linear, output=bounded, outputs=(replace(linear.outputs[0], name="shown", unit="V"),))
    with pytest.raises(NoTrimError, match=r"no trim at shown = 3 V: shown still misses its value by \d.* V \(limit .* V\)"):
        find_trim(system, outputs={"shown": 3.0}, free=("force",))


def test_a_target_out_of_reach_names_what_is_reached(engine: DelaySystem, linear: DelaySystem) -> None:
    """The engine's speed at full throttle; and x = u / 1.5 with a force of 5 N at most, where a search to 10 m goes further."""
    with pytest.raises(
        NoTrimError, match=r"the nearest steady state met has engine_speed = 825.947 rad/s, at throttle = \d+ deg"
    ) as caught:
        find_trim(engine, outputs={"engine_speed": 850.0}, free=("throttle",))
    assert caught.value.details["nearest"] == pytest.approx(825.9470938506817, rel=1e-9)
    with pytest.raises(NoTrimError, match=r"the nearest steady state met has position = 3.33333 m, at force = 5 N") as caught:
        find_trim(linear, outputs={"position": 4.0}, free=("force",))
    assert caught.value.details["nearest"] == pytest.approx(5.0 / 1.5)


def test_a_target_that_no_steady_state_exists_for_names_none(endless: DelaySystem) -> None:
    with pytest.raises(NoTrimError) as caught:
        find_trim(endless, outputs={"position": 1.0}, free=("force",))
    assert "nearest" not in caught.value.details


def test_a_standstill_is_named_once(engine: DelaySystem) -> None:
    with pytest.raises(NoTrimError) as caught:
        find_trim(engine, outputs={"engine_speed": 0.0}, free=("throttle",))
    assert str(caught.value).count("left out") == 1


def test_states_free_to_rest_anywhere_are_refused(idle: DelaySystem) -> None:
    with pytest.raises(NoTrimError, match="steady states are not isolated"):
        find_trim(idle)


def test_state_that_rests_anywhere_can_be_held(idle: DelaySystem) -> None:
    trim = find_trim(idle, outputs={"position": 4.0}, free=("force",))
    assert trim.states == pytest.approx([4.0])
    assert trim.inputs == pytest.approx([0.0], abs=1e-12)


def test_state_without_range_is_sought_from_its_nominal_value(linear: DelaySystem) -> None:
    endless_range = replace(linear.states[0], search_low=-np.inf, search_high=np.inf)
    trim = find_trim(replace(linear, states=(endless_range,)), inputs={"force": 3.0})
    assert trim.states == pytest.approx([2.0])


@pytest.mark.parametrize(
    ("request_", "pattern"),
    [
        ({"inputs": {"force": 6.0}}, r"force = 6 N is outside -5 to 5 N"),
        ({"inputs": {"power": 1.0}}, r"linear has no input power; its inputs are force"),
        ({"outputs": {"power": 1.0}, "free": ("force",)}, r"there is no signal power; there are position"),
        ({"outputs": {"position": 1.0}, "free": ("power",)}, r"there is no signal power; there are force"),
        ({"outputs": {"position": float("nan")}, "free": ("force",)}, r"position = nan m is outside"),
        ({"outputs": {"position": 1.0}}, r"1 prescribed outputs need as many free inputs, not 0"),
        ({"free": ("force",)}, r"0 prescribed outputs need as many free inputs, not 1"),
        ({"inputs": {"force": 1.0}, "outputs": {"position": 1.0}, "free": ("force",)}, r"force is both given as 1 and free; leave one out"),
        ({"near": {"speed": 1.0}}, r"there is no signal speed"),
        ({"starts": 0}, r"0 starts asked for; ask for at least 1"),
    ],
)
def test_request_that_makes_no_sense_is_refused(linear: DelaySystem, request_: dict[str, object], pattern: str) -> None:
    with pytest.raises(InvalidInputError, match=pattern):
        find_trim(linear, **request_)  # type: ignore[arg-type]  # the requests differ in their arguments


def test_prescribed_state_below_its_range_is_refused(engine: DelaySystem) -> None:
    with pytest.raises(InvalidInputError, match=r"engine_speed = -5 rad/s is outside 0 to inf rad/s"):
        find_trim(engine, outputs={"engine_speed": -5.0}, free=("throttle",))


def test_unknown_names_are_refused_by_getters(linear: DelaySystem) -> None:
    trim = find_trim(linear)
    for getter in (trim.state, trim.input, trim.output, trim.channel, trim.lag):
        with pytest.raises(InvalidInputError, match="there is no signal nothing"):
            getter("nothing")


def test_trim_is_read_only_and_checked(linear: DelaySystem) -> None:
    trim = find_trim(linear)
    with pytest.raises(ValueError, match="read-only"):
        trim.states[0] = 1.0
    with pytest.raises(InvalidInputError, match=r"position drifts by 1 m/s; that is no trim"):
        replace(trim, drift=np.array([1.0]))


def test_trim_serves_linearisation(pendulum: DelaySystem) -> None:
    trim = find_trim(pendulum)
    assert isinstance(trim, Trim)
    assert linearize(pendulum, trim).model.A[1, 0] == pytest.approx(-0.9)


@pytest.mark.parametrize(
    ("held", "free"), [({}, ()), ({"engine_speed": 240.0}, ("throttle",)), ({"friction_torque": 40.0}, ("load_torque",))]
)
def test_slopes_of_the_steady_equations(engine: DelaySystem, held: dict[str, float], free: tuple[str, ...]) -> None:
    """Against differences: one pass with imaginary steps carries the channels along; inputs may differ from point to point."""
    equations = pose(engine, {}, held, free)
    random = np.random.default_rng(2)
    points = np.array([35.0, 240.0, 25.0])[: 2 + len(free)] * random.uniform(0.8, 1.2, (5, 2 + len(free)))
    known = equations.known * random.uniform(0.9, 1.0, (5, 1))
    for given_inputs in (None, known):
        misses, slopes = equations.misses_and_slopes(points, given_inputs)
        assert misses == pytest.approx(equations.misses(points, given_inputs), rel=1e-12, abs=1e-13)
        for k, scale in enumerate(equations.scales):
            step = np.zeros(points.shape[1])
            step[k] = 1e-6 * scale
            sides = [equations.misses(points + sign * step, given_inputs) for sign in (1.0, -1.0)]
            assert slopes[..., k] == pytest.approx((sides[0] - sides[1]) / 2e-6, rel=1e-4, abs=1e-6)


def test_halton_points_are_even_and_distinct() -> None:
    points = halton(64, 20)
    assert points.shape == (64, 20)
    assert np.all((points > 0.0) & (points < 1.0))
    assert np.all(np.abs(np.mean(points[:, :4], axis=0) - 0.5) < 0.05)
    assert len({tuple(column) for column in points.T}) == 20
    assert points[:3, 0].tolist() == [0.5, 0.25, 0.75]
