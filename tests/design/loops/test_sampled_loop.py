"""Sampled loops against an exact solution: a lag with delay between samples is a sum of exponentials, its controller plain Python."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from revline import signals
from revline.analysis.trim import find_trim
from revline.dde.kernel import STANDARD, Method, Propagation
from revline.dde.simulate import Options
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, Continuous, PidController
from revline.design.controllers.scheduled_pid import law_of
from revline.design.loops.closed_loop import Limits, LoopTask, run_loop
from revline.design.loops.sampled_loop import Disturbance, SampledRun, SampledTask, run_sampled_loop, with_command
from revline.design.plants.linear_plant import linear_plant
from revline.design.plants.loop_signals import OF_LINEAR_MODEL, OperatingPoint, operating_point
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, StoppedError
from revline.sampled import CrankSynchronous, FixedRate
from tests.design.examples import C2D, delayed_lag

GAIN, LAG, DELAY, BASE, REST = 12.0, 0.5, 0.0213, 25.0, 240.0
MODEL = delayed_lag(DELAY, gain=GAIN, lag=LAG)
GAINS = PidGains(kp=0.8, ki=1.5, kd=0.02, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a lag")


def run_lag(controller: PidController, **changes: Any) -> SampledRun:
    plant = linear_plant(MODEL, base_input=BASE, base_output=REST)
    point = OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": BASE}, measurement=REST)
    values: dict[str, Any] = {"command": signals.step(10.0), "until": 1.0, "step": 2e-3} | changes
    return run_sampled_loop(plant, point, controller, SampledTask(**values), wires=OF_LINEAR_MODEL)


class ExactLag:
    """The lag's output and its integral under inputs that jump, in closed form: jumps of the input so far are all it knows."""

    def __init__(self, lag: float = LAG) -> None:
        self.jumps: list[tuple[float, float]] = []
        self.level, self.lag = BASE, lag

    def drive(self, time: float, value: float) -> None:
        self.jumps.append((time, value - self.level))
        self.level = value

    def output(self, time: float) -> float:
        return REST + sum(GAIN * size * -math.expm1(-(time - at - DELAY) / self.lag) for at, size in self.jumps if time > at + DELAY)

    def angle(self, time: float) -> float:
        since = [(size, time - at - DELAY) for at, size in self.jumps if time > at + DELAY]
        return REST * time + sum(GAIN * size * (t + self.lag * math.expm1(-t / self.lag)) for size, t in since)


def replay(run: SampledRun, times_of: Any) -> ExactLag:
    """Run the controller's equations in Python against the exact lag."""
    code, lag = run.code, ExactLag()
    p, count, sampling = code.parameters, len(code.states), law_of(run.controller).sampling
    assert not isinstance(sampling, Continuous)
    xd = code.start(p, (REST,), (REST,), (BASE,))
    for k, elapsed in enumerate(run.sampled.elapsed):
        time = times_of(k, lag)
        assert run.sampled.times[k] == pytest.approx(time, abs=1e-9)
        assert run.sampled.measurements[k, 0] == pytest.approx(lag.output(time), rel=1e-9)
        result = code.update(p, xd, (lag.output(time),), (REST + 10.0,), (elapsed,))
        xd = result[:count]
        lag.drive(time + sampling.computation_delay, result[count])
    return lag


@pytest.mark.parametrize("computation", [0.0, 0.004])
def test_a_fixed_rate_loop_is_the_exact_one(computation: float) -> None:
    """Samples between the points of the mesh, outputs that take effect later, a delay no multiple of either."""
    controller = PidController(gains=GAINS, low=0.0, high=60.0, sampling=FixedRate(period=0.0173, computation_delay=computation))
    run = run_lag(controller)
    lag = replay(run, lambda k, _: 0.0173 * k)
    assert run.output == pytest.approx([lag.output(t) for t in run.times], rel=1e-9)
    assert 255.0 > run.output.max() > 249.0


def test_samples_at_angles_of_the_crank_are_where_the_speeds_integral_says() -> None:
    controller = PidController(gains=GAINS, low=0.0, high=60.0, sampling=CrankSynchronous(angle=math.pi))
    run = run_lag(controller)

    def time_of(k: int, lag: ExactLag) -> float:
        guess = run.sampled.times[k]
        return 0.0 if k == 0 else float(brentq(lambda t: lag.angle(t) - k * math.pi, guess - 1e-3, guess + 1e-3, xtol=1e-14))

    lag = replay(run, time_of)
    assert np.diff(run.sampled.times) == pytest.approx(run.sampled.elapsed[1:], abs=1e-12)
    assert run.output == pytest.approx([lag.output(t) for t in run.times], rel=1e-9)


def test_a_sampled_loop_tends_to_the_continuous_one_with_order_one() -> None:
    """Backward sums and a zero-order hold: the error falls with the period itself, neither faster nor more slowly."""
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    step = 1e-3
    wanted = run_loop(engine, point, C2D, LoopTask(command=5.0, until=10.0, step=step), limits=Limits(0.0, 79.46))
    periods = np.array([0.008, 0.004, 0.002])
    errors = []
    for period in periods:
        controller = PidController(gains=C2D, low=0.0, high=79.46, anti_windup=AntiWindup.NONE, sampling=FixedRate(period=period))
        run = run_sampled_loop(engine, point, controller, SampledTask(command=signals.step(5.0), until=10.0, step=step))
        assert run.times == pytest.approx(wanted.times)
        errors.append(np.abs(run.output - wanted.output).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(1.0, abs=0.25)


def test_the_equivalent_delay_of_a_sampled_loop_is_half_a_period() -> None:
    """The command comes midway between samples: half a period more delay brings a continuous loop ten times nearer to the sampled one."""
    period, step = 0.016, 2e-3
    gains, shift = replace(GAINS, kd=0.0), round(period / 2.0 / step)
    controller = PidController(gains=gains, low=-100.0, high=200.0, anti_windup=AntiWindup.NONE, sampling=FixedRate(period=period))
    run = run_lag(controller, until=4.0, command=signals.step(10.0, start=period / 2.0))
    errors = []
    for extra in (0.0, period / 2.0):
        plant = linear_plant(replace(MODEL, delay=DELAY + extra), base_input=BASE, base_output=REST)
        point = OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": BASE}, measurement=REST)
        other = run_loop(plant, point, gains, LoopTask(command=10.0, until=4.0, step=step), wires=OF_LINEAR_MODEL)
        errors.append(np.abs(other.output[:-shift] - run.output[shift:]).max())
    assert errors[1] < 0.1 * errors[0]


def test_equal_seeds_give_equal_runs_and_noise_is_what_was_asked_for() -> None:
    controller = PidController(gains=GAINS, low=0.0, high=60.0, sampling=FixedRate(period=0.002))
    noisy = Disturbance(noise=0.5, jitter=1e-4, seed=3)
    first, second = (run_lag(controller, disturbance=noisy, command=signals.step(0.0)) for _ in range(2))
    assert np.array_equal(first.output, second.output)
    assert np.array_equal(first.sampled.times, second.sampled.times)
    other = run_lag(controller, disturbance=replace(noisy, seed=4), command=signals.step(0.0))
    assert not np.array_equal(first.output, other.output)
    shifts = first.sampled.times - 0.002 * np.arange(first.sampled.times.size)
    assert shifts[0] == 0.0
    assert np.std(shifts) == pytest.approx(1e-4, rel=0.15)
    exact = np.interp(first.sampled.times, first.times, first.output)
    assert np.std(first.sampled.measurements[:, 0] - exact) == pytest.approx(0.5, rel=0.15)


def test_an_output_that_comes_after_the_next_sample_is_an_overrun() -> None:
    """The computation takes 13 ms, a turn by pi at 240 rad/s 13.09 ms, and less at the higher speed commanded."""
    controller = PidController(gains=GAINS, low=0.0, high=60.0, sampling=CrankSynchronous(angle=math.pi, computation_delay=0.013))
    run = run_lag(controller)
    assert run.sampled.overruns == np.count_nonzero(np.diff(run.sampled.times) < 0.013) > 0
    assert run_lag(replace(controller, sampling=CrankSynchronous(angle=math.pi))).sampled.overruns == 0


def test_a_run_is_bumpless_and_tells_its_terms() -> None:
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    controller = PidController(gains=C2D, low=0.0, high=79.46, setpoint_weight=0.5, sampling=FixedRate(period=0.01))
    run = run_sampled_loop(
        engine,
        point,
        controller,
        SampledTask(command=signals.step(0.0), until=2.0, loads={"load_torque": signals.step(10.0, start=1.0)}),
    )
    before = run.times < 1.0
    assert np.ptp(run.output[before]) < 1e-6
    assert run.control[before] == pytest.approx(25.0, abs=1e-6)
    assert run.output.min() < 239.0
    total = sum(run.of_controller(name) for name in ("proportional", "integral", "derivative"))
    assert 25.0 + total == pytest.approx(run.of_controller("control_wanted"))
    assert run.saturated_share == 0.0


def test_a_run_can_be_stopped_and_tells_how_far_it_is() -> None:
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    controller = PidController(gains=C2D, low=0.0, high=79.46, sampling=FixedRate(period=0.01))
    told: list[float] = []
    options = Options(progress=told.append, stopped=lambda: len(told) > 0)
    task = SampledTask(command=signals.step(1.0), until=1e4)
    with pytest.raises(StoppedError, match="stopped from outside") as stopped:
        run_sampled_loop(engine, point, controller, task, options=options)
    assert told == [0.0]
    assert len(stopped.value.run.times) > 1000  # type: ignore[attr-defined] # a sampled run
    whole: list[float] = []
    run_sampled_loop(engine, point, controller, replace(task, until=0.1), options=Options(progress=whole.append))
    assert whole == [0.0, 1.0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sampling": None}, "a continuous controller has no sampled form"),
        ({"low": -1.0}, r"output from -1 to 80 deg leaves the range of throttle, 0 to 90 deg; limit its output"),
        ({"gains": replace(C2D, input_unit="rpm")}, r"the controller counts engine_speed in rpm and lee1995 has it in rad/s; convert"),
        ({"gains": replace(C2D, output_unit="%")}, r"the controller counts throttle in % and lee1995 has it in deg; convert"),
        ({"low": 30.0}, "output at rest = 25 deg is outside the controller's limits 30 to 80 deg"),
    ],
)
def test_a_controller_that_does_not_fit_the_engine_is_refused(changes: Any, message: str) -> None:
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    values: dict[str, Any] = {"gains": C2D, "low": 0.0, "high": 80.0, "sampling": FixedRate(period=0.01)} | changes
    if values["sampling"] is None:
        del values["sampling"]
    with pytest.raises(InvalidInputError, match=message):
        run_sampled_loop(engine, point, PidController(**values), SampledTask(command=signals.step(1.0), until=0.1))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Disturbance(noise=-1.0), "noise = -1 is outside 0 and above; give a standard deviation"),
        (lambda: Disturbance(jitter=math.inf), "jitter = inf is outside 0 and above"),
        (
            lambda: run_lag(
                PidController(gains=GAINS, low=0.0, high=60.0, sampling=FixedRate(period=0.01)), disturbance=Disturbance(jitter=0.002)
            ),
            "jitter = 0.002 s is outside 0 to below 0.00125 s; shifts must leave the samples in their order",
        ),
        (
            lambda: run_lag(
                PidController(gains=GAINS, low=0.0, high=60.0, sampling=FixedRate(period=0.01)), loads={"input": signals.step(1.0)}
            ),
            "input is driven by the controller and by a signal; leave the signal out",
        ),
    ],
)
def test_disturbances_that_cannot_be_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        make()


def test_a_plant_without_a_speed_has_no_crank() -> None:
    model = replace(MODEL, output_unit="kPa")
    assert "sampling_crank_speed" not in [v.name for v in with_command(linear_plant(MODEL), "output").inputs]
    plant = linear_plant(model, base_input=BASE, base_output=REST)
    point = OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": BASE}, measurement=REST)
    gains = replace(GAINS, input_unit="kPa")
    controller = PidController(gains=gains, low=0.0, high=60.0, sampling=CrankSynchronous(angle=math.pi))
    with pytest.raises(InvalidInputError, match="sampling by the crank's angle needs a speed in rad/s; the measurement is in kPa"):
        run_sampled_loop(plant, point, controller, SampledTask(command=signals.step(1.0), until=0.1), wires=OF_LINEAR_MODEL)


def error_of_a_fast_lag(step: float, method: Method) -> float:
    """Largest error of a sampled loop around a fast lag, its samples between the points of the mesh, against its closed form."""
    model = replace(MODEL, denominator=(1.0, 0.05))
    plant = linear_plant(model, base_input=BASE, base_output=REST)
    point = OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": BASE}, measurement=REST)
    gains = replace(GAINS, kp=0.05, ki=0.5, kd=0.0)
    controller = PidController(gains=gains, low=-100.0, high=200.0, sampling=FixedRate(period=0.0173))
    task = SampledTask(command=signals.step(10.0), until=0.5, step=step)
    run = run_sampled_loop(plant, point, controller, task, wires=OF_LINEAR_MODEL, options=Options(method=method))
    lag = ExactLag(0.05)
    for time, value in zip(run.sampled.times, run.of_controller("control"), strict=True):
        lag.drive(float(time), float(value))
    return float(np.max(np.abs(run.output - [lag.output(t) for t in run.times])))


def test_between_events_the_simulation_keeps_its_order() -> None:
    errors = [error_of_a_fast_lag(step, STANDARD) for step in (0.002, 0.001)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.25)
    assert errors[1] < 1e-7


def test_without_meeting_outputs_that_come_back_delayed_the_order_is_lost() -> None:
    """Negative control of the order: cubics that span the bends which a delay brings back."""
    careless = [error_of_a_fast_lag(step, replace(STANDARD, propagation=Propagation.NONE)) for step in (0.002, 0.001)]
    assert math.log2(careless[0] / careless[1]) < 1.5
    assert careless[1] > 100.0 * error_of_a_fast_lag(0.001, STANDARD)


def test_a_run_does_not_depend_on_how_it_is_cut() -> None:
    controller = PidController(gains=GAINS, low=0.0, high=60.0, sampling=FixedRate(period=0.0173, computation_delay=0.004))
    plant = linear_plant(MODEL, base_input=BASE, base_output=REST)
    point = OperatingPoint(states=np.zeros(len(plant.states)), inputs={"input": BASE}, measurement=REST)
    task = SampledTask(command=signals.step(10.0), until=1.0, step=2e-3, disturbance=Disturbance(noise=0.1, jitter=1e-4))
    whole, cut = (run_sampled_loop(plant, point, controller, task, wires=OF_LINEAR_MODEL, options=Options(chunk=n)) for n in (10**6, 7))
    assert whole.output.tobytes() == cut.output.tobytes()
    assert whole.sampled.outputs.tobytes() == cut.sampled.outputs.tobytes()
