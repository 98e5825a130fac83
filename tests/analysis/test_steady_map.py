"""Steady states over an input: the engine's published map, ends found by bisection, what is named in warnings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.analysis import steady_map, trim_branches
from revline.analysis.linearize import linearize
from revline.analysis.steady_equations import SteadyEquations, _newton
from revline.analysis.steady_map import SteadyMap, find_steady_map
from revline.analysis.trim import Trim, find_trim
from revline.analysis.trim_branches import find_rests_along, follow_each
from revline.engine.lee1995 import LEE_1995, lee1995
from revline.errors import InvalidInputError, NoTrimError, RevlineError
from revline.lti.root_batches import characteristic_roots_each
from revline.lti.roots import RightmostRoots
from revline.lti.state_space import DelayStateSpace
from revline.system import DelaySystem, Floats


@pytest.fixture(scope="module")
def engine_map(engine: DelaySystem) -> SteadyMap:
    values = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 90.0])
    return find_steady_map(engine, sweep_input="throttle", values=values, output="engine_speed")


@pytest.mark.reference
def test_engine_map(engine_map: SteadyMap) -> None:
    """Lee (1995), Fig. 4.1, recomputed: speeds, and the equilibria at 4 and 5 deg unstable."""
    assert engine_map.values.tolist() == [4.0, 5.0, 6.0, 10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 90.0]
    assert engine_map.output_values[3:8] == pytest.approx([64.46696, 180.67560, 300.77841, 418.61425, 638.93399], abs=1e-5)
    assert engine_map.stable.tolist() == [False] * 2 + [True] * 8
    assert engine_map.states[:, 1].tolist() == engine_map.output_values.tolist()
    assert engine_map.outputs.shape == (10, 9)


@pytest.mark.reference
def test_lowest_angle(engine: DelaySystem, engine_map: SteadyMap) -> None:
    """The lowest angle whose steady speed is at least 10 rad/s lies between 3 and 5 deg; Lee (1995), recomputed."""
    (boundary,) = engine_map.boundaries
    assert engine_map.lowest == boundary.value
    assert 3.0 < boundary.value < 4.0
    assert 0.0 < boundary.value - boundary.without.value <= 1e-6
    speed = boundary.trim.state("engine_speed")
    slope = linearize(engine, boundary.trim).model.static_gain("throttle", "engine_speed")
    assert -1e-8 <= speed - 10.0 <= 1.01e-6 * slope


def test_saturated_throttle_gives_a_plateau(engine_map: SteadyMap) -> None:
    assert engine_map.output_values[-1] == pytest.approx(engine_map.output_values[-2], rel=1e-12)


def test_warnings_name_what_is_left_out(engine_map: SteadyMap) -> None:
    assert len(engine_map.missing) == 4
    text = "\n".join(engine_map.warnings)
    assert "engine_speed = 0.9708 rad/s, with a lag of 5.6" in text
    assert "engine_speed = 4.743 rad/s" in text
    assert f"no steady state below throttle = {engine_map.lowest:.6g} deg, where engine_speed = 10 rad/s" in text


@given(st.lists(st.floats(-0.5, 0.5), min_size=8, max_size=8), st.sampled_from([-20.0, 0.0, 0.0, 10.0, 40.0, 90.0]), st.integers(3, 9))
@settings(max_examples=8)
def test_a_map_is_what_single_trims_give(changes: list[float], load: float, points: int) -> None:
    """Of any engine, also where it stalls: states, stability and roots within 1e-9, the same values without a steady state."""
    engine, grid = drawn_engine(changes), np.linspace(0.0, 90.0, points)
    alone: dict[float, Trim] = {}
    near: dict[str, float] = {}
    reasons = {}
    for angle in grid.tolist():
        try:
            alone[angle] = find_trim(engine, inputs={"throttle": angle, "load_torque": load}, near=near)
        except NoTrimError as error:
            reasons[angle] = str(error)
        else:
            near = named(alone[angle])
    if not alone:
        with pytest.raises(NoTrimError, match="no steady state at any throttle of 0 to 90 deg"):
            find_steady_map(engine, sweep_input="throttle", values=grid, output="engine_speed", inputs={"load_torque": load})
        return
    found = find_steady_map(engine, sweep_input="throttle", values=grid, output="engine_speed", inputs={"load_torque": load})
    assert found.values.tolist() == list(alone)
    assert [entry.value for entry in found.missing] == list(reasons)
    for entry in found.missing:
        assert entry.reason.split(":")[0].split("(")[0] == reasons[entry.value].split(":")[0].split("(")[0]
    for trim, single in zip(found.trims, alone.values(), strict=True):
        assert trim.states == pytest.approx(single.states, rel=1e-9)
        assert trim.residual <= 1e-8
        assert (trim.stable, trim.unstable_count) == (single.stable, single.unstable_count)
        assert trim.roots.roots == pytest.approx(single.roots.roots, rel=1e-9, abs=1e-9)
        assert len(trim.alternatives) >= len(single.alternatives)
    for boundary in found.boundaries:
        assert abs(boundary.value - boundary.without.value) <= 1e-6
        with pytest.raises(NoTrimError, match="no trim at throttle"):
            find_trim(engine, inputs={"throttle": boundary.without.value, "load_torque": load}, near=named(boundary.trim))
        again = find_trim(engine, inputs={"throttle": boundary.value, "load_torque": load}, near=named(boundary.trim))
        assert again.states == pytest.approx(boundary.trim.states, rel=1e-9)


def test_an_end_where_following_leads_astray_is_found_by_full_searches(linear: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Were what is followed believed, the end would lie at 2.5 N; it lies at 3 N."""
    narrow = replace(linear, states=(replace(linear.states[0], search_low=-10.0, search_high=2.0),))

    def astray(system: DelaySystem, inputs: Sequence[Mapping[str, float]], starts: Floats) -> list[tuple[bool, Floats]]:
        return [(each["force"] < 2.5, found) for each, (_, found) in zip(inputs, follow_each(system, inputs, starts), strict=True)]

    monkeypatch.setattr(steady_map, "follow_each", astray)
    found = find_steady_map(narrow, sweep_input="force", values=[0.0, 2.0, 4.0], output="position", tolerance=1e-6)
    (boundary,) = found.boundaries
    assert boundary.value == pytest.approx(3.0, abs=1.1e-6)


def drawn_engine(changes: Sequence[float]) -> DelaySystem:
    """An engine whose parameters differ by up to 60 % from the thesis's."""
    p, f = LEE_1995, np.exp(changes).tolist()
    return lee1995(
        p._replace(
            throttle=p.throttle._replace(max_flow=p.throttle.max_flow * f[0]),
            manifold=p.manifold._replace(volume=p.manifold.volume * f[1]),
            cylinders=p.cylinders._replace(pumping=p.cylinders.pumping * f[2]),
            delays=p.delays._replace(intake_to_torque=p.delays.intake_to_torque * f[3]),
            combustion=p.combustion._replace(torque_constant=p.combustion.torque_constant * f[4]),
            friction=p.friction._replace(constant=p.friction.constant * f[5], viscous=p.friction.viscous * f[6]),
            rotation=p.rotation._replace(inertia=p.rotation.inertia * f[7]),
        )
    )


def named(trim: Trim) -> dict[str, float]:
    return {name: trim.state(name) for name in ("manifold_pressure", "engine_speed")}


def test_load_moves_the_map(engine: DelaySystem) -> None:
    values = [20.0, 30.0]
    free = find_steady_map(engine, sweep_input="throttle", values=values, output="engine_speed")
    loaded = find_steady_map(engine, sweep_input="throttle", values=values, output="engine_speed", inputs={"load_torque": 10.0})
    assert np.all(loaded.output_values < free.output_values)
    assert free.boundaries == ()
    assert free.lowest == 20.0


def test_boundary_above(linear: DelaySystem) -> None:
    """The state leaves its search range of 2 m where the force passes 3 N."""
    narrow = replace(linear, states=(replace(linear.states[0], search_low=-10.0, search_high=2.0),))
    found = find_steady_map(narrow, sweep_input="force", values=[0.0, 2.0, 4.0], output="position", tolerance=1e-6)
    (boundary,) = found.boundaries
    assert boundary.value == pytest.approx(3.0, abs=1.1e-6)
    assert found.lowest == 0.0
    assert any(w.startswith("no steady state above force = 3 N, where position = 2 m") for w in found.warnings)


def test_follows_the_branch_it_began_on_and_names_the_others(cubic: DelaySystem) -> None:
    """x^3 - x = u: from u = -2 on the lowest branch, which ends at u = 2 / sqrt(27) = 0.385."""
    found = find_steady_map(cubic, sweep_input="force", values=[-2.0, -1.0, 0.0, 0.3], output="position")
    assert np.all(np.diff(found.output_values) > 0.0)
    assert found.output_values[2] == pytest.approx(-1.0)
    assert found.output_values[3] ** 3 - found.output_values[3] == pytest.approx(0.3)
    assert "at force = 0 N, an unstable steady state besides: position = 1 m" in found.warnings


def test_stable_alternative_is_named(pendulum: DelaySystem) -> None:
    system = replace(pendulum, states=(replace(pendulum.states[0], search_low=-1.0, search_high=7.5), pendulum.states[1]))
    found = find_steady_map(system, sweep_input="force", values=[0.0, 0.1], output="angle")
    assert any("at force = 0 N, a stable steady state besides: angle = " in w for w in found.warnings)


def test_trim_with_something_left_out_warns(chain: DelaySystem) -> None:
    shown = replace(chain, outputs=chain.states, output=lambda p, x, u, zd: (x[0],))  # noqa: ARG005 - the form of all equations
    found = find_steady_map(shown, sweep_input="force", values=[0.0, 0.5], output="level")
    assert found.warnings[0].startswith("at force = 0 N, left out: a steady state at level = -1.5 m")


def test_no_steady_state_anywhere(endless: DelaySystem) -> None:
    with pytest.raises(
        NoTrimError, match=r"no steady state at any force of 0 to 1 N; the first: no trim at nominal inputs: position still drifts"
    ):
        find_steady_map(endless, sweep_input="force", values=[0.0, 1.0], output="position")


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        ({"values": [1.0]}, r"values of force have shape \(1,\); give a list of at least two"),
        ({"values": [1.0, 1.0]}, r"values of force do not rise strictly"),
        ({"values": [np.inf, np.inf]}, r"values of force hold inf; give finite ones"),
        ({"values": [0.0, 9.0]}, r"force = 9 N is outside -5 to 5 N"),
        ({"sweep_input": "power"}, r"there is no signal power"),
        ({"output": "power"}, r"there is no signal power"),
        ({"tolerance": 0.0}, r"tolerance = 0 N is outside 0 to infinity, without 0"),
        ({"inputs": {"force": 1.0}}, r"force is both swept and given as 1; leave one out"),
    ],
)
def test_request_that_makes_no_sense_is_refused(linear: DelaySystem, change: dict[str, object], pattern: str) -> None:
    request = {"sweep_input": "force", "values": [0.0, 1.0], "output": "position"} | change
    with pytest.raises(InvalidInputError, match=pattern):
        find_steady_map(linear, **request)  # type: ignore[arg-type]  # the requests differ in their arguments


def test_map_checks_itself(engine_map: SteadyMap) -> None:
    with pytest.raises(InvalidInputError, match=r"2 values for 10 steady states"):
        replace(engine_map, values=np.array([1.0, 2.0]))
    with pytest.raises(ValueError, match="read-only"):
        engine_map.values[0] = 0.0


def test_a_branch_is_followed_both_ways_over_many_values(cubic: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    """x^3 - x = u has three roots where |u| < 0.385: of one start each, a value finds one, and the others through its neighbours."""
    monkeypatch.setattr(trim_branches, "STARTS", 1)
    forces = np.linspace(-1.0, 1.0, 41)
    for force, rests in zip(forces, find_rests_along(cubic, [{"force": float(force)} for force in forces]), strict=True):
        roots = np.roots([1.0, 0.0, -1.0, -force])
        outer = np.sort([z.real for z in roots if abs(z.imag) < 1e-9 and abs(z.real) > 1.0 / np.sqrt(3.0)])
        states = np.array([trim.state("position") for trim in rests.candidates])
        assert np.max(np.min(np.abs(outer[:, None] - states), axis=1)) < 1e-6


def test_many_values_are_searched_in_parts(cubic: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that memory is bounded: of 40 values no more than 8 at once, with the same answer."""
    whole = find_steady_map(cubic, sweep_input="force", values=np.linspace(-2.0, 2.0, 40), output="position")
    searched, judged = list[int](), list[int]()

    def counted(equations: SteadyEquations, starts: Floats, known: Floats | None) -> Floats:
        searched.append(1 if known is None else len(np.unique(known, axis=0)))
        return _newton(equations, starts, known)

    def judging(systems: Sequence[DelayStateSpace]) -> tuple[RightmostRoots | RevlineError, ...]:
        judged.append(len(systems))
        return characteristic_roots_each(systems)

    monkeypatch.setattr("revline.analysis.steady_equations._newton", counted)
    monkeypatch.setattr("revline.analysis.trim.characteristic_roots_each", judging)
    for module in ("steady_equations", "trim"):
        monkeypatch.setattr(f"revline.analysis.{module}.AT_ONCE", 8)
    parts = find_steady_map(cubic, sweep_input="force", values=np.linspace(-2.0, 2.0, 40), output="position")
    assert (max(searched), max(judged)) == (8, 8)
    assert sum(judged) > 40
    assert parts.states.tolist() == whole.states.tolist()
    assert [len(entry.alternatives) for entry in parts.trims] == [len(entry.alternatives) for entry in whole.trims]
