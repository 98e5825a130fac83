"""Scheduled gains: the equations against an interpolation of scipy's, the schedule between its nodes, the sampled law that uses them."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from revline.dde.kernel import specialisation_of
from revline.design.controllers.controller import PidGains
from revline.design.controllers.gain_schedule import PLAIN, GainSchedule, Scaling
from revline.design.controllers.pid_controller import PidController
from revline.design.controllers.pid_update import sampled_pid
from revline.design.controllers.scheduled_pid import scheduled_pid
from revline.design.loops.sampled_loop import with_command
from revline.design.maps import schedule_design
from revline.design.maps.gain_map import Design, GainGrid, GainMap, GainPoint, find_gain_map, solve_point
from revline.design.maps.schedule_design import ScheduleResult, design_schedule, try_place
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, NotConvergedError
from revline.sampled import FixedRate
from tests.design.examples import C2D

SPEEDS = np.array([100.0, 200.0, 400.0])
LOADS = np.array([0.0, 40.0])


def schedule(kp: object = None, *, scaling: Scaling = PLAIN, first: object = None) -> GainSchedule:
    table = np.array([[0.1, 0.2], [0.5, 0.4], [1.5, 1.0]])
    return GainSchedule(
        names=("engine_speed", "load_torque"),
        units=("rad/s", "N m"),
        gain_unit="deg/(rad/s)",
        first=SPEEDS if first is None else np.array(first),
        second=LOADS,
        kp=table if kp is None else np.array(kp),
        ki=3.0 * table,
        kd=0.1 * table,
        scaling=scaling,
    )


@pytest.fixture(scope="module")
def speed_map() -> GainMap:
    axes = GainGrid(
        first="engine_speed", first_values=np.geomspace(80.0, 240.0, 3), second="load_torque", second_values=np.array([0.0, 40.0])
    )
    return find_gain_map(lee1995(), axes)


@pytest.fixture(scope="module")
def designed(speed_map: GainMap) -> ScheduleResult:
    return design_schedule(lee1995(), speed_map)


def test_interpolation_is_bilinear_and_held_at_the_ends() -> None:
    made = schedule()
    other = RegularGridInterpolator((SPEEDS, LOADS), made.kp)
    rng = np.random.default_rng(2)
    for a, b in rng.uniform((50.0, -10.0), (500.0, 60.0), (50, 2)):
        wanted = float(other((np.clip(a, 100.0, 400.0), np.clip(b, 0.0, 40.0))))
        kp, ki, kd = made.gains_at(a, b)
        assert kp == pytest.approx(wanted, rel=1e-12)
        assert (ki, kd) == pytest.approx((3.0 * wanted, 0.1 * wanted), rel=1e-12)


def test_scaled_tables_keep_their_nodes_and_are_exact_for_powers() -> None:
    """A gain that is its power of the speed is met everywhere, which plain interpolation misses."""
    ratio = (SPEEDS / 400.0)[:, None] * np.ones((1, 2))
    exact = GainSchedule(
        names=("w", "t"),
        units=("rad/s", "N m"),
        gain_unit="1",
        first=SPEEDS,
        second=LOADS,
        kp=ratio,
        ki=ratio**2,
        kd=0.0 * ratio,
        scaling=Scaling(),
    )
    kp, ki, _ = exact.gains_at(290.0, 13.0)
    assert (kp, ki) == pytest.approx((290.0 / 400.0, (290.0 / 400.0) ** 2), rel=1e-12)
    made = schedule(scaling=Scaling())
    for i, a in enumerate(SPEEDS):
        for j, b in enumerate(LOADS):
            assert made.gains_at(a, b) == pytest.approx((made.kp[i, j], made.ki[i, j], made.kd[i, j]), rel=1e-12)


def test_the_bound_is_kept_between_the_nodes(designed: ScheduleResult, speed_map: GainMap) -> None:
    """At random points that the design did not see; what is lowered at the nodes is what interpolation costs."""
    assert designed.holds
    assert 1.2 < designed.node_peak <= 2.0
    assert designed.search_error < 0.01
    assert not designed.lost
    rng = np.random.default_rng(4)
    for a, b in rng.uniform((80.0, 0.0), (240.0, 40.0), (8, 2)):
        point = solve_point(lee1995(), speed_map.grid, Design(), (float(a), float(b)))
        assert isinstance(point, GainPoint)
        assert try_place(point, designed.schedule.gains_at).peak <= designed.worst + 0.005


def test_gains_that_do_not_follow_the_speed_are_noticed(designed: ScheduleResult, speed_map: GainMap) -> None:
    """Negative control: the gains of the fastest node at the slowest point are unstable there."""
    fast = designed.schedule.gains_at(240.0, 0.0)
    slow = next(point for point in speed_map.found if point.place == (80.0, 40.0))
    assert try_place(slow, lambda _, __: fast).peak == np.inf
    assert try_place(slow, designed.schedule.gains_at).peak <= 2.0
    assert designed.slowest > 0.0


def test_a_bound_that_is_not_kept_between_the_nodes_is_refused(speed_map: GainMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the bound itself at the nodes it is exceeded between them, as long as the peak at the nodes is not lowered."""
    monkeypatch.setattr(schedule_design, "ATTEMPTS", 1)
    with pytest.raises(NotConvergedError, match="between the nodes of the schedule the sensitivity peaks at"):
        design_schedule(lee1995(), speed_map, scaling=PLAIN)


def test_an_interruption_ends_the_design(speed_map: GainMap) -> None:
    def stop(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        design_schedule(lee1995(), speed_map, progress=stop)


def controller(unit: str = "rad/s") -> PidController:
    gains = PidGains(kp=0.5, ki=2.0, kd=0.01, input_unit=unit, output_unit="deg", rule="none", designed_on="none")
    return PidController(gains=gains, low=0.0, high=79.0, filter_time=0.02, setpoint_weight=0.5, sampling=FixedRate(period=0.01))


def test_equal_gains_at_all_nodes_are_the_law_to_the_last_bit() -> None:
    flat = np.ones((3, 2))
    made = GainSchedule(
        names=("engine_speed", "load_torque"),
        units=("rad/s", "N m"),
        gain_unit="deg/(rad/s)",
        first=SPEEDS,
        second=LOADS,
        kp=0.5 * flat,
        ki=2.0 * flat,
        kd=0.01 * flat,
    )
    plain = sampled_pid(controller(), output=25.0, measurement=240.0)
    code = scheduled_pid(made, controller(), output=25.0, measurement=240.0)
    one, other = (c.start(c.parameters, (240.0,), r, (25.0,)) for c, r in ((plain, (240.0,)), (code, (240.0, 10.0))))
    assert one == other
    rng = np.random.default_rng(5)
    for speed, command in rng.uniform(90.0, 410.0, (50, 2)):
        first = plain.update(plain.parameters, one, (speed,), (command,), (0.01,))
        second = code.update(code.parameters, other, (speed,), (command, speed / 10.0), (0.01,))
        assert second[:-3] == first
        assert second[-3:] == (0.5, 2.0, 0.01)
        one, other = first[:7], second[:7]


def test_a_schedule_without_its_signals_goes_on() -> None:
    """No number for the speed: the last one; none for the load: the table's last, where an engine allows least."""
    code = scheduled_pid(schedule(), controller(), output=25.0, measurement=200.0)
    states = code.start(code.parameters, (200.0,), (200.0, 0.0), (25.0,))
    nothing = code.update(code.parameters, states, (float("nan"),), (200.0, float("nan")), (0.01,))
    assert nothing[-3] == pytest.approx(0.4)
    assert np.all(np.isfinite(nothing))
    blind = code.start(code.parameters, (float("nan"),), (200.0, 0.0), (25.0,))
    assert blind[:-1] == code.start(code.parameters, (200.0,), (200.0, 0.0), (25.0,))[:-1]
    assert blind[-1] == controller().hold_samples  # nothing has been measured that could be held


def test_what_cannot_be_scheduled_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="axis engine_speed of the schedule"):
        schedule(first=[1.0, 1.0, 2.0])
    with pytest.raises(InvalidInputError, match="table kp of the schedule has shape"):
        schedule(kp=[[1.0, 2.0]])
    with pytest.raises(InvalidInputError, match="scaling by powers"):
        schedule(scaling=Scaling(kp=3))
    with pytest.raises(InvalidInputError, match="it is scheduled by what it measures"):
        scheduled_pid(schedule(), controller("V"), output=25.0, measurement=200.0)
    engine = lee1995()
    row = find_gain_map(engine, GainGrid(first="throttle", first_values=np.array([20.0]), second="load_torque", second_values=LOADS))
    with pytest.raises(InvalidInputError, match="has nothing to interpolate"):
        design_schedule(engine, row)
    poor = GainGrid(first="throttle", first_values=np.array([10.0, 20.0]), second="load_torque", second_values=LOADS)
    with pytest.raises(NotConvergedError, match="no gains at the node throttle = 10 deg, load_torque = 40 N m"):
        design_schedule(engine, find_gain_map(engine, poor))


def test_tables_of_other_sizes_are_other_kernels() -> None:
    """One kernel taken for another of the same equations would read its tables from the wrong places."""
    first, second = (
        scheduled_pid(_flat(size), PidController(gains=C2D, sampling=FixedRate(period=0.01)), output=25.0, measurement=240.0)
        for size in (2, 3)
    )
    engine = with_command(lee1995(), "engine_speed")
    one, other = (specialisation_of(engine, controller=code) for code in (first, second))
    assert one != other
    assert one.layout != other.layout
    assert str(one.layout.controller) != str(other.layout.controller)


def _flat(size: int) -> GainSchedule:
    shape = (size, 2)
    return GainSchedule(
        names=("engine_speed", "load_torque"),
        units=("rad/s", "N m"),
        gain_unit="deg/(rad/s)",
        first=np.linspace(100.0, 400.0, size),
        second=np.array([0.0, 20.0]),
        kp=np.full(shape, 0.5),
        ki=np.full(shape, 1.5),
        kd=np.zeros(shape),
    )
