import json
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.loops.classify import Criteria
from revline.design.loops.closed_loop import FORM, Limits, LoopTask, describe_outcome, run_linear_loop, run_loop, trace_linear_loop
from revline.design.loops.outcome import Diverged, LimitCycle, Settled, Stalled
from revline.design.plants.linear_plant import linear_plant
from revline.design.plants.loop_signals import OF_LINEAR_MODEL, LoopSignals, OperatingPoint, operating_point
from revline.engine.lee1995 import lee1995
from revline.errors import DivergedError, InvalidInputError, NotSettledError, StepError
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem

THROTTLE = Limits(0.0, 79.46)
G1 = TransferFunction(numerator=(12.2316,), denominator=(1.0, 0.58020), input_unit="deg", output_unit="rad/s")
G2 = TransferFunction(numerator=(12.0149,), denominator=(1.0, 0.55104, 0.035517), input_unit="deg", output_unit="rad/s")
G2D = G2.with_delay(0.0214)


def gains(kp: float, ki: float, kd: float) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="test")


C1 = gains(2.153, 16.85, 0.0)
C2 = gains(20.0, 250.0, 0.4)


@pytest.fixture(scope="module")
def engine() -> DelaySystem:
    return lee1995()


@pytest.fixture(scope="module")
def point(engine: DelaySystem) -> OperatingPoint:
    return operating_point(find_trim(engine, inputs={"throttle": 25.0}))


Rate = Callable[[float, np.ndarray, float], list[float]]


def steps_of_the_delay(model: TransferFunction, law: PidGains, command: float, until: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The loop by the method of steps: on each delay's length an ordinary equation, what is read back from the dense solution before.

    States: output before the delay and its derivatives (companion form), and the integral of the error.
    """
    order, lag = model.order, model.delay
    scale, top = model.denominator[-1], model.numerator[0] / model.denominator[-1]
    falling = np.array(model.denominator[:-1]) / scale
    solutions: list[Callable[[float], np.ndarray]] = []

    def read(k: int, time: float) -> tuple[float, float]:
        """Delayed output and its rate; in the first interval there is none."""
        if k == 0:
            return 0.0, 0.0
        state = solutions[k - 1](time - lag)
        return float(state[0]), float(rate_before(k - 1, time - lag, state))

    def control(k: int, time: float, state: np.ndarray) -> float:
        y, slope = read(k, time)
        return law.kp * (command - y) + law.ki * float(state[-1]) - law.kd * slope

    def rate_before(k: int, time: float, state: np.ndarray) -> float:
        """Rate of the output before the delay: the second state, but the equation itself for a single lag."""
        return float(state[1]) if order > 1 else float(-falling[0] * state[0] + top * control(k, time, state))

    def rates(time: float, state: np.ndarray, k: int) -> list[float]:
        highest = top * control(k, time, state) - float(falling @ state[:order])
        return [*state[1:order].tolist(), highest, command - read(k, time)[0]]

    times, outputs, controls = [], [], []
    state = np.zeros(order + 1)
    for k in range(math.ceil(until / lag)):
        span = (k * lag, (k + 1) * lag)
        solution = solve_ivp(rates, span, state, args=(k,), method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
        solutions.append(solution.sol)
        state = solution.y[:, -1]
        inside = np.linspace(*span, 6)[1:-1]
        times += inside.tolist()
        outputs += [read(k, t)[0] for t in inside]
        controls += [control(k, t, solution.sol(t)) for t in inside]
    return np.array(times), np.array(outputs), np.array(controls)


@pytest.mark.parametrize(
    ("model", "law"),
    [
        (G2D, gains(1.2, 2.0, 0.1)),
        (G2D, gains(1.02, 8.0, 0.0)),
        (G2.with_delay(0.2), gains(0.1, 0.15, 0.02)),
        (G1.with_delay(0.1), gains(0.2, 0.5, 0.02)),
        (G1.with_delay(0.1), gains(0.0, 0.3, -0.01)),
    ],
    ids=["g2d", "g2d-pi", "long-delay", "neutral", "negative-derivative"],
)
def test_a_delayed_loop_agrees_with_the_method_of_steps(model: TransferFunction, law: PidGains) -> None:
    """The single lag with a derivative is a neutral equation: its control jumps at every multiple of the delay, for ever."""
    until = 8.0 * model.delay
    times, output, control = steps_of_the_delay(model, law, 60.0, until)
    trace = trace_linear_loop(model, law, LoopTask(command=60.0, until=until, step=model.delay / 50.0))
    wanted = np.round(times / (model.delay / 50.0)).astype(int)
    np.testing.assert_allclose(trace.times[wanted], times, rtol=1e-9)
    np.testing.assert_allclose(trace.output[wanted], output, rtol=0.0, atol=6e-5)
    np.testing.assert_allclose(trace.control[wanted], control, rtol=0.0, atol=6e-5 * (1.0 + abs(law.kp) + abs(law.kd) / model.delay))
    np.testing.assert_allclose(trace.terms.sum(axis=1), trace.control, rtol=1e-12, atol=1e-9)
    fine = trace_linear_loop(model, law, LoopTask(command=60.0, until=until, step=model.delay / 200.0))
    wanted *= 4
    np.testing.assert_allclose(fine.output[wanted], output, rtol=0.0, atol=60.0 * 1e-7)


def test_a_loop_without_delay_agrees_with_another_program() -> None:
    for law in (C2, gains(0.3, 1.0, 0.05), gains(0.5, 0.0, 0.1)):
        trace = trace_linear_loop(G2, law, LoopTask(command=-3.0, until=2.0, step=1e-3))
        gain = G2.numerator[0]
        below = [G2.denominator[2], G2.denominator[1] + gain * law.kd, 1.0 + gain * law.kp, gain * law.ki]
        _, output, _ = lsim(([gain * law.kp, gain * law.ki], below), np.full(trace.times.size, -3.0), trace.times)
        np.testing.assert_allclose(trace.output, output, rtol=0.0, atol=3e-9)
        control = (
            output + G2.denominator[1] * np.gradient(output, 1e-3) + G2.denominator[2] * np.gradient(np.gradient(output, 1e-3), 1e-3)
        ) / gain
        np.testing.assert_allclose(trace.control[5:-5], control[5:-5], rtol=0.0, atol=0.02 * np.abs(control).max())
        assert trace.control[0] == pytest.approx(law.kp * -3.0, rel=1e-12)
        assert (trace.step, trace.terms.shape) == (0.0, (0, 3))


@pytest.mark.reference
@pytest.mark.parametrize(
    ("law", "low", "high", "period"),
    [(C1, 291.15, 310.07, 0.2088), (C2, 291.7, 307.2, 0.137)],
    ids=["c1", "c2"],
)
def test_hot_controllers_hunt_on_the_engine(
    engine: DelaySystem, point: OperatingPoint, law: PidGains, low: float, high: float, period: float
) -> None:
    """Lee (1995), section 5.5, recomputed: C1 hunts from 291.15 to 310.07 rad/s with 0.2088 s, C2 from 291.7 to 307.2 with 0.137 s."""
    run = run_loop(engine, point, law, LoopTask(command=60.0, until=8.0), limits=THROTTLE)
    assert isinstance(run.outcome, LimitCycle)
    digits = 0.01 if law is C1 else 0.06
    assert (run.outcome.low, run.outcome.high) == pytest.approx((low, high), abs=digits)
    assert run.outcome.period == pytest.approx(period, abs=0.05 * 10 ** -(3 if law is C1 else 2))
    if law is C1:
        late = run.times > 2.0
        assert (run.control[late].min(), run.control[late].max()) == pytest.approx((7.0, 49.0), abs=0.6)
        assert 0.0 < run.saturated_share < 0.05
    assert describe_outcome(run).startswith("hunts between 291.")
    assert not run.is_stable


@pytest.mark.reference
def test_a_small_command_ends_in_a_larger_cycle_at_the_lower_limit(engine: DelaySystem, point: OperatingPoint) -> None:
    """C1 with a command of 1 rad/s, recomputed: 222 to 259 rad/s, 0.304 s, touching the throttle's lower limit.

    It goes further than ten times its command from the target, and has not diverged.
    """
    run = run_loop(engine, point, C1, LoopTask(command=1.0, until=8.0), limits=THROTTLE)
    assert isinstance(run.outcome, LimitCycle)
    assert (run.outcome.low, run.outcome.high) == pytest.approx((222.0, 259.0), abs=0.5)
    assert run.outcome.period == pytest.approx(0.304, abs=5e-4)
    assert run.control[run.times > 4.0].min() == 0.0


@pytest.mark.reference
@pytest.mark.parametrize(("ki", "linear", "nonlinear"), [(2.0, 0.081, 0.083), (2.5, 0.107, 0.108)])
def test_the_delayed_model_foretells_the_engine(
    engine: DelaySystem, point: OperatingPoint, ki: float, linear: float, nonlinear: float
) -> None:
    """C2d, recomputed from Lee (1995), section 5.4: overshoot on G2d and engine 8.1 and 8.3 % with ki 2.0; 10.7 and 10.8 % with 2.5."""
    law, task = gains(1.2, ki, 0.1), LoopTask(command=60.0, until=8.0)
    on_model = run_linear_loop(G2D, law, task, name="g2d", base=(25.0, 240.8))
    on_engine = run_loop(engine, point, law, task, limits=THROTTLE)
    assert (on_model.overshoot, on_engine.overshoot) == pytest.approx((linear, nonlinear), abs=6e-4)
    for run, start in ((on_model, 240.8), (on_engine, point.measurement)):
        assert isinstance(run.outcome, Settled)
        assert run.is_stable
        assert run.outcome.value == pytest.approx(start + 60.0, abs=0.01)
        assert run.measures().overshoot == run.overshoot
        assert (run.target, run.form) == (start + 60.0, FORM)
        assert describe_outcome(run) == f"settles at {run.outcome.value:.6g} rad/s, overshoot {100 * run.overshoot:.1f} % of the command"
        low, high = run.limits
        np.testing.assert_allclose(run.control, np.clip(25.0 + run.terms.sum(axis=1), low, high), rtol=1e-12, atol=1e-11)
    assert on_model.saturated_share == 0.0


@pytest.mark.reference
@pytest.mark.parametrize("law", [C1, C2], ids=["c1", "c2"])
def test_hot_controllers_diverge_on_the_delayed_model(law: PidGains) -> None:
    """Lee (1995), section 5.5, recomputed: C1 and C2 on G2d diverge. The record ends where the bound is passed."""
    run = run_linear_loop(G2D, law, LoopTask(command=60.0, until=8.0), name="g2d", base=(25.0, 240.8))
    assert isinstance(run.outcome, Diverged)
    assert run.outcome.bound == 600.0
    assert run.times[-1] == run.outcome.time
    assert abs(run.outcome.value - 300.8) > 600.0 >= abs(run.output[-2] - 300.8)
    assert run.output[-1] == run.outcome.value
    assert describe_outcome(run) == f"diverges: beyond 600 rad/s from its target after {run.outcome.time:.3g} s"
    assert not run.is_stable
    with pytest.raises(NotSettledError, match="not settled"):
        run.measures()


@pytest.mark.parametrize("model", [G2D, G2], ids=["delayed", "rational"])
def test_no_infinity_leaves_a_loop_that_outgrows_all_numbers(model: TransferFunction) -> None:
    law, task = gains(-30.0, 0.0, 0.0), LoopTask(command=60.0, until=500.0, step=1e-2)
    run = run_linear_loop(model, law, task, name="g")
    assert isinstance(run.outcome, Diverged)
    json.dumps([run.outcome.time, run.outcome.value, run.overshoot, *run.control.tolist(), *run.output.tolist()], allow_nan=False)
    assert run.outcome.time < 1.0
    if model is G2D:
        with pytest.raises(DivergedError, match="no finite number any more"):
            trace_linear_loop(model, law, task)
    else:
        assert trace_linear_loop(model, law, task).times[-1] < 500.0


def test_a_command_to_zero_stalls_the_engine(engine: DelaySystem, point: OperatingPoint) -> None:
    """The speed falls until its lag grows faster than time passes; a smaller step does not mend that."""
    run = run_loop(engine, point, C1, LoopTask(command=-240.0, until=8.0), limits=THROTTLE)
    assert isinstance(run.outcome, Stalled)
    assert run.outcome.state == "engine_speed"
    assert run.output[-1] == pytest.approx(run.outcome.value, abs=0.1)
    assert 20.0 < run.outcome.value < 30.0
    assert run.times[-1] == pytest.approx(run.outcome.time, abs=2e-3)
    assert describe_outcome(run) == f"stalls after {run.outcome.time:.3g} s, at engine speed {run.outcome.value:.4g} rad/s"
    assert run.saturated_share == 1.0


def test_a_step_longer_than_a_lag_on_the_way_is_refused(engine: DelaySystem, point: OperatingPoint) -> None:
    """At 660 rad/s the spark's lag is 1.97 ms: a step of 2 ms fits at the start and no longer then."""
    law = gains(1.2, 2.0, 0.1)
    with pytest.raises(StepError, match=r"step = 0.002 s is longer than a lag during the run, 0.00199\d* s of spark_influence"):
        run_loop(engine, point, law, LoopTask(command=420.0, until=8.0, step=2e-3), limits=THROTTLE)
    with pytest.raises(InvalidInputError, match=r"step = 0.006 s is not below the lag of spark_influence at the start"):
        run_loop(engine, point, law, LoopTask(command=1.0, until=4.0, step=6e-3), limits=THROTTLE)


def test_an_undecided_record_says_so(engine: DelaySystem, point: OperatingPoint) -> None:
    with pytest.raises(NotSettledError, match=r"the record of 8 s is neither at rest at its end nor holds 5 cycles"):
        run_loop(engine, point, gains(0.12, 2.0, 0.1), LoopTask(command=60.0, until=8.0), limits=THROTTLE)
    with pytest.raises(NotSettledError, match=r"the record of 8 s is neither at rest at its end nor holds 5 cycles"):
        run_linear_loop(G2, gains(0.12, 2.0, 0.1), LoopTask(command=60.0, until=8.0), name="g2")


def test_operating_points_and_limits_are_checked(engine: DelaySystem, point: OperatingPoint) -> None:
    task = LoopTask(command=60.0, until=1.0)
    with pytest.raises(InvalidInputError, match=r"the output at the trim, 25 deg, lies outside the limits 30 to 79.46 deg"):
        run_loop(engine, point, C1, task, limits=Limits(30.0, 79.46))
    with pytest.raises(InvalidInputError, match=r"no value for throttle, which the controller drives; it has spark"):
        run_loop(engine, replace(point, inputs={"spark": 10.0}), C1, task)
    with pytest.raises(InvalidInputError, match=r"has no input sparc"):
        run_loop(engine, replace(point, inputs={"throttle": 25.0, "sparc": 10.0}), C1, task)
    with pytest.raises(InvalidInputError, match=r"there is no signal throtle"):
        run_loop(
            engine, point, C1, task, wires=LoopSignals(drive="throtle", measurement="engine_speed", measurement_rate="engine_acceleration")
        )
    with pytest.raises(
        InvalidInputError, match=r"engine_speed = 240 rad/s is given for an operating point whose states make it 240\.799 rad/s"
    ):
        run_loop(engine, replace(point, measurement=240.0), C1, task)
    with pytest.raises(InvalidInputError, match=r"engine_acceleration in rad/s2 cannot feed pid's measurement in rad/s"):
        run_loop(
            engine, point, C1, task, wires=LoopSignals(drive="throttle", measurement="engine_acceleration", measurement_rate="engine_speed")
        )


@pytest.mark.parametrize(
    ("command", "until", "step", "message"),
    [
        (0.0, 8.0, 1e-3, "command step = 0 moves nothing"),
        (math.nan, 8.0, 1e-3, "command step = nan moves nothing"),
        (60.0, 0.0, 1e-3, "stop time = 0 s is outside values above 0"),
        (60.0, math.inf, 1e-3, "stop time = inf s is outside"),
        (60.0, 0.006, 1e-3, r"stop time = 0.006 s is outside 7 time steps of 0.001 s; run longer, or take shorter time steps"),
        (60.0, 8.0, -1e-3, r"time step = -0.001 s is outside values above 0"),
    ],
)
def test_tasks_are_checked(command: float, until: float, step: float, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        LoopTask(command=command, until=until, step=step)


def test_models_that_cannot_be_run_are_refused() -> None:
    task = LoopTask(command=60.0, until=8.0)
    with pytest.raises(InvalidInputError, match="needs more poles than zeros"):
        run_linear_loop(TransferFunction(numerator=(1.0, 1.0), denominator=(1.0, 1.0), delay=0.1), C1, task, name="g")
    with pytest.raises(InvalidInputError, match="straight through"):
        run_linear_loop(TransferFunction(numerator=(1.0,), denominator=(1.0,), input_unit="deg", output_unit="rad/s"), C1, task, name="g")
    for model in (G2, G2D):
        with pytest.raises(InvalidInputError, match="convert"):
            run_linear_loop(replace(model, output_unit="rpm"), C1, task, name="g")
    with pytest.raises(
        InvalidInputError, match=r"time step = 2.5e-10 s is outside 8e-08 s and above for 8 s; run it shorter, or drop so short"
    ):
        run_linear_loop(G2.with_delay(1e-9), C1, task, name="g")
    with pytest.raises(InvalidInputError, match=r"time step = 1e-09 s is outside"):
        run_linear_loop(G2, C1, replace(task, step=1e-9), name="g")


def test_a_short_delay_is_simulated_finely_and_recorded_as_asked() -> None:
    run = run_linear_loop(G2.with_delay(1e-3), gains(0.3, 0.5, 0.05), LoopTask(command=60.0, until=6.0, step=0.01), name="g")
    assert run.step == 0.01 / 40
    np.testing.assert_allclose(run.times, np.arange(601) * 0.01, rtol=1e-12)


def test_records_that_do_not_fit_together_are_refused() -> None:
    run = run_linear_loop(G2D, gains(1.2, 2.0, 0.1), LoopTask(command=60.0, until=8.0), name="g2d")
    with pytest.raises(InvalidInputError, match=r"times, output and control have 8001, 8000 and 8001 samples"):
        replace(run, output=run.output[1:])
    with pytest.raises(InvalidInputError, match=r"there are 8000 samples of the controller's terms and 8001 of the output"):
        replace(run, terms=run.terms[1:])
    with pytest.raises(InvalidInputError, match=r"holds numbers that are not finite"):
        replace(run, control=np.full(8001, np.inf))
    with pytest.raises(ValueError, match="read-only"):
        run.output[0] = 1.0


def test_the_linear_plant_is_a_system_like_any_other() -> None:
    plant = linear_plant(G2D, base_input=25.0, base_output=240.8)
    rest = OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": 25.0}, measurement=240.8)
    law, task = gains(1.2, 2.0, 0.1), LoopTask(command=60.0, until=4.0, criteria=Criteria(rest=0.01))
    run = run_loop(plant, rest, law, task, wires=OF_LINEAR_MODEL)
    same = run_linear_loop(G2D, law, task, name="g2d", base=(25.0, 240.8))
    np.testing.assert_allclose(run.output, same.output, rtol=0.0, atol=1e-9)
    limited = run_loop(plant, rest, law, task, wires=OF_LINEAR_MODEL, limits=Limits(24.0, 60.0))
    assert (run.control.max() > 90.0, limited.control.max()) == (True, 60.0)
    assert 0.0 < limited.saturated_share < 0.1


@pytest.mark.parametrize("delay", [0.0, 0.02], ids=["formula", "simulated"])
def test_a_creeping_loop_does_not_count_as_at_rest(delay: float) -> None:
    """With ki = 1e-6 the loop's time constant is 83,000 s: within 20 s it moves by 2e-4 of the command, and rests nowhere there."""
    model = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.5), delay=delay, input_unit="deg", output_unit="rad/s")
    gains = PidGains(kp=0.0, ki=1e-6, kd=0.0, input_unit="rad/s", output_unit="deg", rule="test", designed_on="test")
    with pytest.raises(NotSettledError, match=r"can rest at 60 rad/s only: it still creeps there") as caught:
        run_linear_loop(model, gains, LoopTask(command=60.0, until=20.0), name="lag")
    assert caught.value.details["end"] == pytest.approx(60.0)


def test_a_loop_that_rests_off_its_target_for_good_still_settles() -> None:
    """A zero at the origin keeps integral action from the target: s/(1 + s)^2 under 2/s rests at 2/3 of the command."""
    model = TransferFunction(numerator=(0.0, 1.0), denominator=(1.0, 2.0, 1.0), input_unit="deg", output_unit="rad/s")
    gains = PidGains(kp=0.0, ki=2.0, kd=0.0, input_unit="rad/s", output_unit="deg", rule="test", designed_on="test")
    run = run_linear_loop(model, gains, LoopTask(command=60.0, until=40.0), name="washout")
    assert isinstance(run.outcome, Settled)
    assert run.outcome.value == pytest.approx(40.0, abs=1e-6)
    still = run_linear_loop(
        TransferFunction(numerator=(3.0,), denominator=(0.0, 1.0), input_unit="deg", output_unit="rad/s"),
        gains.scaled(ki=0.0),
        LoopTask(command=60.0, until=4.0),
        name="integrator",
    )
    assert isinstance(still.outcome, Settled)
