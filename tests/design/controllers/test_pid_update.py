"""The sampled law by itself: properties that hold for any gains and any measurements."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, PidController
from revline.design.controllers.pid_update import PidCode, integral_bounds, sampled_pid
from revline.errors import InvalidInputError
from revline.sampled import CrankSynchronous, FixedRate, SampledController
from tests.design.examples import C2D

PERIOD = 0.01
LOW, HIGH, REST, SPEED = 0.0, 79.46, 25.0, 240.8

gain = st.floats(0.0, 20.0)
speeds = st.lists(st.floats(0.0, 1000.0), min_size=1, max_size=40)


def make(gains: PidGains = C2D, **changes: Any) -> SampledController:
    values: dict[str, Any] = {"low": LOW, "high": HIGH, "sampling": FixedRate(period=PERIOD)} | changes
    return sampled_pid(PidController(gains=gains, **values), output=REST, measurement=SPEED)


def run(code: SampledController, measured: list[float], command: float = SPEED + 60.0) -> np.ndarray:
    """Outputs at each sample, by name order, of a controller that is started at rest."""
    p, count = code.parameters, len(code.states)
    xd, rows = code.start(p, (SPEED,), (SPEED,), (REST,)), []
    for value in measured:
        result = code.update(p, xd, (value,), (command,), (PERIOD,))
        xd = result[:count]
        rows.append(result[count:])
    return np.array(rows)


@st.composite
def controllers(draw: Any) -> SampledController:
    kind = draw(st.sampled_from(AntiWindup))
    gains = PidGains(kp=draw(gain), ki=draw(gain), kd=draw(gain), input_unit="rad/s", output_unit="deg", rule="any", designed_on="any")
    return make(
        gains,
        anti_windup=kind,
        tracking_time=draw(st.floats(PERIOD, 10.0)) if kind is AntiWindup.BACK_CALCULATION else None,
        setpoint_weight=draw(st.floats(0.0, 1.0)),
        derivative_weight=draw(st.floats(0.0, 1.0)),
        filter_time=draw(st.floats(0.0, 0.1)),
        rate_limit=draw(st.sampled_from([math.inf, 50.0, 1000.0])),
        dead_zone=draw(st.sampled_from([0.0, 1.0])),
        output_step=draw(st.sampled_from([0.0, 0.1])),
    )


@given(code=controllers(), measured=speeds, command=st.floats(0.0, 1000.0))
def test_anti_windup_never_lets_the_integral_leave_its_bound(code: SampledController, measured: list[float], command: float) -> None:
    p: PidCode = code.parameters
    outputs = run(code, measured, command)
    for proportional, integral in outputs[:, 2:4]:
        low, high = integral_bounds(p, command, proportional)
        assert low <= integral <= high
    assert np.all((outputs[:, 0] >= LOW) & (outputs[:, 0] <= HIGH))


@given(measured=speeds)
def test_clamping_moves_the_integral_no_further_than_the_output_reaches_its_limit(measured: list[float]) -> None:
    """The integral moves away from 0 only while the output is within its limits; without it, it would."""
    outputs = run(make(), measured)
    wanted, steps = outputs[:, 1], np.diff(np.concatenate([[0.0], outputs[:, 3]]))
    grown_above = (wanted > HIGH + 1e-9) & (steps > 0.0)
    grown_below = (wanted < LOW - 1e-9) & (steps < 0.0)
    assert not grown_above.any()
    assert not grown_below.any()


def test_without_anti_windup_the_integral_does_grow_beyond_the_limit() -> None:
    """Negative control of the property above."""
    stuck = [SPEED - 100.0] * 10
    outputs = run(make(anti_windup=AntiWindup.NONE), stuck)
    assert np.all(outputs[1:, 1] > HIGH)
    assert np.all(np.diff(outputs[:, 3]) > 0.0)
    assert np.ptp(run(make(), stuck)[:, 3]) == 0.0


@given(
    code=controllers(), measured=st.floats(100.0, 400.0), output=st.floats(5.0, 75.0), rest=st.floats(5.0, 75.0), weight=st.floats(0.0, 1.0)
)
def test_a_bumpless_start_continues_the_output(code: SampledController, measured: float, output: float, rest: float, weight: float) -> None:
    """Whatever the controller was built for: started at any output with the command at the measurement, its first output is that."""
    p = code.parameters._replace(rest_output=rest, setpoint_weight=weight, output_quantised=0.0)
    xd = code.start(p, (measured,), (measured,), (output,))
    first = code.update(p, xd, (measured,), (measured,), (PERIOD,))[len(code.states)]
    assert first == pytest.approx(output, abs=1e-9)


def test_each_term_is_the_textbooks() -> None:
    code = make(filter_time=0.02, setpoint_weight=0.5, derivative_weight=0.25, anti_windup=AntiWindup.NONE, low=-1e9, high=1e9)
    measured = [240.0, 243.0, 247.0]
    command, derivative, integral, before = SPEED + 60.0, 0.0, 0.0, 0.25 * SPEED - SPEED
    for row, value in zip(run(code, measured), measured, strict=True):
        weighted = 0.25 * command - value
        derivative = 0.02 / 0.03 * derivative + C2D.kd / 0.03 * (weighted - before)
        integral += C2D.ki * PERIOD * (command - value)
        proportional = C2D.kp * (0.5 * (command - SPEED) + SPEED - value)
        assert row == pytest.approx(
            [REST + proportional + integral + derivative] * 2 + [proportional, integral, derivative, value], rel=1e-12
        )
        before = weighted


@pytest.mark.parametrize("kind", list(AntiWindup))
def test_a_set_point_weight_of_none_makes_no_jump_however_large_the_command(kind: AntiWindup) -> None:
    """The integral begins far below what it will be at rest; nothing may lift it there at once, neither up nor back down."""
    tracking = 0.5 if kind is AntiWindup.BACK_CALCULATION else None
    code = make(setpoint_weight=0.0, anti_windup=kind, tracking_time=tracking)
    first = run(code, [SPEED], command=SPEED + 60.0)[0]
    assert first[0] == pytest.approx(REST + C2D.ki * PERIOD * 60.0)
    p, count = code.parameters, len(code.states)
    rested = (C2D.kp * 60.0 + 50.0, 0.0, -(SPEED + 60.0), REST + 50.0, SPEED + 60.0, SPEED + 60.0, 0.0)
    back = code.update(p, rested, (SPEED + 60.0,), (SPEED,), (PERIOD,))[count]
    assert back == pytest.approx(REST + 50.0 - C2D.ki * PERIOD * 60.0)


def test_back_calculation_follows_what_the_limits_take_with_the_tracking_time() -> None:
    """Held at a limit by a constant error, the integral tends to where excess times the tracking rate is the integral's own."""
    tracking = 0.5
    code = make(anti_windup=AntiWindup.BACK_CALCULATION, tracking_time=tracking)
    outputs = run(code, [SPEED - 20.0] * 2000)
    excess = outputs[-1, 1] - HIGH
    assert excess == pytest.approx(C2D.ki * 80.0 * tracking, rel=1e-9)


def test_back_calculation_does_not_overshoot_where_the_crank_turns_slowly() -> None:
    """Samples 0.2 s apart, as at 16 rad/s, and a tracking time of 0.05 s: the integral gives what the limit took, not four times that."""
    code = make(anti_windup=AntiWindup.BACK_CALCULATION, tracking_time=0.05, sampling=CrankSynchronous(angle=math.pi))
    p, count = code.parameters, len(code.states)
    xd = code.start(p, (SPEED,), (SPEED,), (REST,))
    result = code.update(p, xd, (SPEED,), (SPEED + 60.0,), (0.2,))
    wanted, proportional, integral = result[count + 1 : count + 4]
    assert wanted > HIGH
    assert REST + proportional + integral == pytest.approx(HIGH)


def test_the_rate_is_limited_and_quantisation_is_to_the_nearest_step() -> None:
    outputs = run(make(rate_limit=50.0, output_step=0.25, measurement_step=0.5), [SPEED + 0.3] * 100)
    assert np.abs(np.diff(np.concatenate([[REST], outputs[:, 0]]))).max() <= 0.5 + 0.25
    assert np.array_equal(outputs[:-1, 0] / 0.25, np.round(outputs[:-1, 0] / 0.25))
    assert np.array_equal(outputs[:, 5], [241.0] * 100)


@pytest.mark.parametrize("missing", [math.nan, math.inf, -math.inf])
def test_a_sensor_that_is_lost_is_held_then_the_output_is_safe_and_it_comes_back(missing: float) -> None:
    code = make(hold_samples=3, safe_output=10.0)
    outputs = run(code, [250.0, 251.0, *[missing] * 6, 252.0], command=255.0)
    held = run(code, [250.0, *[251.0] * 4], command=255.0)
    assert np.all(np.isfinite(outputs))
    assert outputs[4, 5] == 251.0
    assert outputs[2:5, 3] == pytest.approx(outputs[1, 3])  # the integral waits
    assert held[2, 3] > outputs[2, 3]
    assert outputs[5:8, 0] == pytest.approx(10.0, abs=0.0)
    assert outputs[8, 5] == 252.0
    assert outputs[8, 0] != 10.0


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", [0, 1, 2], ids=["measurement", "command", "output"])
def test_a_start_without_a_number_is_a_start_at_rest(wrong: float, place: int) -> None:
    """Whatever is missing when the controller takes over: no state is poisoned, and without a measurement the output is safe at once."""
    code = make(hold_samples=3, safe_output=10.0, filter_time=0.01)
    values = [SPEED, SPEED, REST]
    values[place] = wrong
    xd = code.start(code.parameters, (values[0],), (values[1],), (values[2],))
    assert np.all(np.isfinite(xd))
    lost = code.update(code.parameters, xd, (values[0],), (SPEED,), (PERIOD,))
    found = code.update(code.parameters, lost[: len(xd)], (SPEED,), (SPEED,), (PERIOD,))
    assert lost[len(xd)] == pytest.approx(10.0 if place == 0 else REST, abs=1e-9)
    assert found[len(xd)] == pytest.approx(REST, abs=1e-9)


@pytest.mark.parametrize("seconds", [0.0, -0.01, math.nan, math.inf])
def test_a_sample_without_time_between_adds_nothing(seconds: float) -> None:
    code = make(filter_time=0.01)
    count, p = len(code.states), code.parameters
    xd = code.start(p, (SPEED,), (SPEED,), (REST,))
    before = code.update(p, xd, (SPEED + 1.0,), (SPEED + 3.0,), (PERIOD,))
    twice = code.update(p, before[:count], (SPEED + 1.0,), (SPEED + 3.0,), (seconds,))
    assert twice == pytest.approx(before, rel=1e-6)
    after = code.update(p, twice[:count], (SPEED + 1.0,), (SPEED + 3.0,), (PERIOD,))
    assert after[count + 3] == pytest.approx(2.0 * before[count + 3], rel=1e-6)


def test_the_dead_zone_leaves_small_errors_alone() -> None:
    outputs = run(make(dead_zone=2.0), [SPEED + 0.5] * 5, command=SPEED + 1.0)
    assert np.array_equal(outputs[:, 2:4], np.zeros((5, 2)))
    beyond = run(make(dead_zone=2.0), [SPEED] * 2, command=SPEED + 3.0)
    assert beyond[0, 2] == pytest.approx(C2D.kp * 1.0)


@pytest.mark.parametrize(
    ("changes", "place", "message"),
    [
        ({"sampling": None}, {}, "a continuous controller has no sampled form; give it a sampling"),
        ({}, {"output": 90.0}, "output at rest = 90 deg is outside the controller's limits 0 to 79.46 deg; widen the limits"),
        ({}, {"measurement": math.nan}, "measurement at rest = nan rad/s is outside the finite numbers"),
        ({"output_step": 1e-20}, {}, r"output step = 1e-20 deg is outside 3.53e-14 deg and above; give a coarser one"),
        ({"measurement_step": 1e-20}, {}, r"measurement step = 1e-20 rad/s is outside"),
    ],
)
def test_what_has_no_sampled_form_is_refused(changes: Any, place: Any, message: str) -> None:
    values: dict[str, Any] = {"low": LOW, "high": HIGH, "sampling": FixedRate(period=PERIOD)} | changes
    if values["sampling"] is None:
        del values["sampling"]
    with pytest.raises(InvalidInputError, match=message):
        sampled_pid(PidController(gains=C2D, **values), **({"output": REST, "measurement": SPEED} | place))
