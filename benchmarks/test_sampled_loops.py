"""How long sampled loops and an optimisation take: 100 runs of 10 s at 1 ms in 2 s on two cores, one optimisation in 1 s."""

from collections.abc import Callable

from pytest_benchmark.fixture import BenchmarkFixture

from revline.analysis.linearize import linearize
from revline.analysis.threads import run_all
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import PidController
from revline.design.loops.sampled_loop import Disturbance, SampledTask, run_sampled_loop
from revline.design.optimum.optimise import Optimum, optimise
from revline.design.optimum.optimum_problem import Bounds, Objective, find_scale, make_grid
from revline.design.plants.loop_signals import operating_point
from revline.design.trials.acceptance_runs import Measures, Probe, measure_run
from revline.design.tuning.tuning_plant import tuning_plant
from revline.engine.lee1995 import lee1995
from revline.sampled import FixedRate

BATTERY_BUDGET, OPTIMISATION_BUDGET = 2.0, 1.0
"""Seconds."""

GAINS = PidGains(kp=0.45, ki=1.87, kd=0.0118, input_unit="rad/s", output_unit="deg", rule="amigo", designed_on="the engine")


def test_a_battery_of_a_hundred_runs(benchmark: BenchmarkFixture) -> None:
    """Each with a step of command and load, noise and jitter, sampled every 10 ms, and measured."""
    engine = lee1995()
    point = operating_point(find_trim(engine, inputs={"throttle": 25.0}))
    controller = PidController(gains=GAINS, low=0.0, high=79.46, sampling=FixedRate(period=0.01))
    probe = Probe(command=10.0, load=5.0, until=10.0)

    def one(seed: int, _: Callable[[float], None]) -> Measures:
        task = SampledTask(
            command=probe.command_signal,
            until=10.0,
            disturbance=Disturbance(noise=0.3, jitter=1e-4, seed=seed),
            loads={"load_torque": probe.load_signal},
        )
        return measure_run(run_sampled_loop(engine, point, controller, task), probe, band=0.05, noise=0.3)

    found = benchmark(lambda: run_all(one, range(100), lambda _: 1.0, workers=2))
    assert len({measures.travel for measures in found}) == 100
    assert float(benchmark.stats.stats.min) < BATTERY_BUDGET


def test_an_optimisation(benchmark: BenchmarkFixture) -> None:
    """PID of least load error under Ms at most 2, at one operating point, the plant's grid included."""
    engine = lee1995()
    model = linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model
    scale = find_scale(tuning_plant(model, name="engine"))

    def one() -> Optimum:
        return optimise((make_grid(model),), scale, Bounds(ms=2.0), Objective.LOAD)

    found = benchmark(one)
    assert found.costs[0].sensitivity.max() < 2.0 * (1.0 + 1e-5)
    assert float(benchmark.stats.stats.min) < OPTIMISATION_BUDGET
