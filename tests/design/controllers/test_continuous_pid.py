"""The continuous controller with all that has a continuous form, against an integrator that knows nothing of it."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from revline.design.controllers.continuous_pid import check_continuous, continuous_pid
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, PidController
from revline.design.loops.classify import Criteria
from revline.design.loops.closed_loop import LoopTask, run_linear_loop
from revline.design.stability.loop_equation import form_loop
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import open_loop_of_model, open_loop_of_system
from revline.errors import InvalidInputError
from revline.lti.interconnection import to_state_space
from revline.sampled import FixedRate
from tests.design.examples import delayed_lag

Floats = NDArray[np.float64]

GAIN, LAG, DELAY, BASE, REST = 12.0, 0.5, 0.05, 25.0, 240.0
MODEL = delayed_lag(DELAY, gain=GAIN, lag=LAG)
GAINS = PidGains(kp=0.5, ki=1.2, kd=0.02, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a lag")


TASK = LoopTask(command=40.0, until=1.5, step=2e-3, criteria=Criteria(rest=0.2))


def controller(**changes: Any) -> PidController:
    values: dict[str, Any] = {
        "setpoint_weight": 0.6,
        "derivative_weight": 0.3,
        "filter_time": 0.02,
        "dead_zone": 0.05,
        "low": 20.0,
        "high": 32.0,
        "anti_windup": AntiWindup.BACK_CALCULATION,
        "tracking_time": 0.2,
    }
    return PidController(gains=GAINS, **values | changes)


def by_steps(law: PidController, command: float, until: float) -> tuple[Floats, Floats]:
    """Output and wanted control of the loop each 2 ms, delay by delay, with a method of order 8 and the law written out anew."""
    g, tracking = law.gains, 1.0 / law.tracking_time if law.tracking_time else 0.0

    def wanted(y: float, integral: float, x: float) -> float:
        e = command - y
        beyond = e - min(max(e, -law.dead_zone), law.dead_zone)
        derivative = g.kd * (law.derivative_weight * command - y - x) / law.filter_time
        return BASE + g.kp * (beyond + (law.setpoint_weight - 1.0) * command) + integral + derivative

    def rates(t: float, state: Floats, before: Any) -> list[float]:
        y, integral, x = state
        e, u = command - y, wanted(y, integral, x)
        beyond = e - min(max(e, -law.dead_zone), law.dead_zone)
        lost = min(max(u, law.low), law.high) - u
        filtered = (law.derivative_weight * command - y - x) / law.filter_time
        drive = BASE if before is None else min(max(wanted(*before(t)), law.low), law.high)
        return [(GAIN * (drive - BASE) - y) / LAG, g.ki * beyond + tracking * lost, filtered]

    state, rows, before = np.zeros(3), [], None
    inside = np.arange(round(DELAY / 2e-3)) * 2e-3
    for _ in range(round(until / DELAY)):
        found = solve_ivp(rates, (0.0, DELAY), state, args=(before,), method="RK45", rtol=1e-6, atol=1e-7, max_step=0.01, dense_output=True)
        state, before = found.y[:, -1], found.sol
        rows.append(before(inside))
    y, integral, x = np.concatenate(rows, axis=1)
    return y, np.array([wanted(*values) for values in zip(y, integral, x, strict=True)])


def test_the_whole_law_agrees_with_the_method_of_steps() -> None:
    """Limits reached, integral led back, dead zone entered: all of it, the sum of the terms included."""
    run = run_linear_loop(MODEL, controller(), TASK, name="lag", base=(BASE, REST))
    output, wanted = by_steps(controller(), TASK.command, TASK.until)
    assert run.output[:-1] - REST == pytest.approx(output, abs=2e-4)
    assert run.wanted[:-1] == pytest.approx(wanted, abs=2e-4)
    assert run.control.max() == 32.0
    assert run.windup.max() == pytest.approx(max(wanted.max() - 32.0, 0.0), abs=2e-4)
    assert run.windup.max() > 2.0


@pytest.mark.parametrize("change", [{"tracking_time": 0.25}, {"filter_time": 0.03}, {"setpoint_weight": 0.7}, {"dead_zone": 0.2}])
def test_another_controller_is_another_loop(change: dict[str, float]) -> None:
    """Negative control: each part of the law shows in what the comparison above sees."""
    one, other = (run_linear_loop(MODEL, controller(**c), TASK, name="lag", base=(BASE, REST)) for c in ({}, change))
    assert np.abs(one.output - other.output).max() > 0.02


def test_without_delay_the_formula_agrees_with_another_program() -> None:
    law = controller(dead_zone=0.0, low=-math.inf, high=math.inf, anti_windup=AntiWindup.NONE, tracking_time=None)
    run = run_linear_loop(replace(MODEL, delay=0.0), law, LoopTask(command=5.0, until=4.0, step=1e-3), name="lag")
    b, c, tf = law.setpoint_weight, law.derivative_weight, law.filter_time
    feedback = np.polyadd(np.polymul([GAINS.kp, GAINS.ki], [tf, 1.0]), [GAINS.kd, 0.0, 0.0])
    setpoint = np.polyadd(np.polymul([b * GAINS.kp, GAINS.ki], [tf, 1.0]), [c * GAINS.kd, 0.0, 0.0])
    below = np.polyadd(np.polymul(np.polymul([tf, 1.0, 0.0], [LAG, 1.0]), [1.0]), GAIN * feedback)
    _, wanted, _ = lsim((GAIN * setpoint, below), np.full(run.times.size, 5.0), run.times)
    assert run.output == pytest.approx(wanted, abs=1e-8)
    integral = GAINS.ki * np.concatenate([[0.0], np.cumsum((5.0 - 0.5 * (wanted[1:] + wanted[:-1])) * 1e-3)])
    assert run.terms[:, 1] == pytest.approx(integral, abs=1e-5)
    assert run.terms.sum(axis=1) == pytest.approx(run.control, abs=1e-9)


def test_a_filter_is_in_the_margins_of_model_and_system_alike() -> None:
    """At the gain margin the delayed characteristic equation has a root on the axis; without the filter it has none there."""
    law = controller()
    found = find_margins(open_loop_of_model(MODEL, law)).gain_rise
    assert found is not None
    s, k = 1j * found.frequency, found.gain_margin
    feedback = GAINS.kp + GAINS.ki / s + GAINS.kd * s / (law.filter_time * s + 1.0)
    assert abs(1.0 + k * feedback * GAIN * np.exp(-DELAY * s) / (LAG * s + 1.0)) < 1e-8
    system = to_state_space(MODEL, input_name="throttle", output_name="engine_speed")
    same = find_margins(open_loop_of_system(system, law))
    assert same.gain_rise is not None
    assert (same.gain_rise.frequency, same.gain_rise.gain_margin) == pytest.approx((found.frequency, k), rel=1e-9)
    for factor, poles in ((0.999, 0.0), (1.001, 2.0)):
        scaled = replace(law, gains=GAINS.scaled(kp=k * factor, ki=k * factor, kd=k * factor))
        assert open_loop_of_model(MODEL, scaled).unstable_poles == poles
        assert open_loop_of_system(system, scaled).unstable_poles == poles


def test_what_has_no_continuous_form_is_refused_with_its_remedy() -> None:
    for change, message in (
        ({"rate_limit": 100.0, "output_step": 0.1}, "has a rate limit, a quantised output, which jumps"),
        ({"measurement_step": 0.1}, "a quantised measurement"),
        ({"anti_windup": AntiWindup.CLAMPING, "tracking_time": None}, "use back-calculation with a tracking_time_s"),
        ({"filter_time": 0.0}, "derivative weight = 0.3 without a filter makes an impulse"),
        ({"sampling": FixedRate(period=0.01)}, "the controller samples, and its samples would be dropped here"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            check_continuous(controller(**change))
    with pytest.raises(InvalidInputError, match="the output at the trim, 40 deg at 240 rad/s, lies outside the limits 20 to 32 deg"):
        continuous_pid(controller(), bias=40.0, measurement=REST)
    with pytest.raises(InvalidInputError, match="limits and a dead zone have no place"):
        run_linear_loop(replace(MODEL, delay=0.0), controller(), TASK, name="lag", base=(BASE, REST))
    with pytest.raises(InvalidInputError, match="samples would be dropped"):
        form_loop(MODEL, controller(sampling=FixedRate(period=0.01)))
