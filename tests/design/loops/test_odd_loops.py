"""Closed loops around a plant of signals and failures that an engine does not have."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import LoopRun, LoopTask, run_linear_loop, run_loop
from revline.design.loops.loop_simulation import describe_stall
from revline.design.loops.outcome import Stalled
from revline.design.plants.linear_plant import linear_plant
from revline.design.plants.loop_signals import LoopSignals, OperatingPoint
from revline.equations import equation
from revline.errors import DivergedError, LagError, StepError
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem, Variable

G2D = TransferFunction(numerator=(12.0149,), denominator=(1.0, 0.55104, 0.035517), delay=0.0214, input_unit="deg", output_unit="rad/s")


class Odd(NamedTuple):
    """A plant with signals named like the controller's, a lag that may shrink, and a state that nothing shows."""

    lag: float = 0.1
    lag_slope: float = 0.0
    growth: float = 0.0


@equation
def odd_emit(p: Odd, x: tuple[float, ...], u: tuple[float, ...], zd: tuple[float, ...]) -> tuple[float, ...]:  # noqa: ARG001 - one form
    return (1.0 * u[1],)


@equation
def odd_lags(p: Odd, x: tuple[float, ...], u: tuple[float, ...], zd: tuple[float, ...]) -> tuple[float, ...]:  # noqa: ARG001 - one form
    return (p.lag + p.lag_slope * x[1],)


@equation
def odd_rate(p: Odd, x: tuple[float, ...], u: tuple[float, ...], zd: tuple[float, ...]) -> tuple[float, ...]:
    return p.growth * x[0] * x[0], zd[0] - x[1] + u[0]


@equation
def odd_output(p: Odd, x: tuple[float, ...], u: tuple[float, ...], zd: tuple[float, ...]) -> tuple[float, ...]:  # noqa: ARG001 - one form
    return 1000.0 + x[0], 1.0 * x[1], zd[0] - x[1] + u[0], 1.0 * x[0]


ODD_WIRES = LoopSignals(drive="drive", measurement="level", measurement_rate="slope")


def run_odd(parameters: Odd, task: LoopTask, law: tuple[float, float, float] = (0.5, 1.0, 0.0), *, low: float = -math.inf) -> LoopRun:
    plant = DelaySystem(
        name="odd",
        parameters=parameters,
        states=(Variable(name="hidden", unit="1"), Variable(name="level", unit="m", low=low)),
        inputs=(Variable(name="command", unit="m"), Variable(name="drive", unit="V")),
        channels=(Variable(name="sent", unit="V"),),
        outputs=(
            Variable(name="control", unit="1"),
            Variable(name="level", unit="m"),
            Variable(name="slope", unit="m/s"),
            Variable(name="integral", unit="1"),
        ),
        emit=odd_emit,
        lags=odd_lags,
        rate=odd_rate,
        output=odd_output,
    )
    controller = PidGains(kp=law[0], ki=law[1], kd=law[2], input_unit="m", output_unit="V", rule="by hand", designed_on="test")
    rest = OperatingPoint(states=np.array([1.0, 0.0]), inputs={"drive": 0.0, "command": 0.0}, measurement=0.0)
    return run_loop(plant, rest, controller, task, wires=ODD_WIRES)


def test_a_plant_with_signals_of_the_controller_s_names_is_not_confused() -> None:
    run = run_odd(Odd(), LoopTask(command=2.0, until=20.0, step=0.01))
    model = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=0.1, input_unit="V", output_unit="m")
    law = PidGains(kp=0.5, ki=1.0, kd=0.0, input_unit="m", output_unit="V", rule="by hand", designed_on="test")
    # The delay stands before the lag here and behind it there; the loop's output is the same.
    same = run_linear_loop(model, law, LoopTask(command=2.0, until=20.0, step=0.01), name="same")
    np.testing.assert_allclose(run.output, same.output, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(run.control, same.control, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(run.terms, same.terms, rtol=0.0, atol=1e-7)


def test_a_hidden_state_that_outgrows_all_numbers_is_an_error_and_no_outcome() -> None:
    """The level settles; what nothing shows goes to infinity at 1 / growth."""
    with pytest.raises(DivergedError, match=r"hidden is no finite number any more"):
        run_odd(Odd(growth=0.06), LoopTask(command=2.0, until=20.0, step=0.01))
    with pytest.raises(DivergedError, match=r"hidden is no finite number any more"):
        run_odd(Odd(growth=0.5), LoopTask(command=2.0, until=20.0, step=0.01))


def test_a_state_that_leaves_its_range_is_named() -> None:
    run = run_odd(Odd(), LoopTask(command=-2.0, until=20.0, step=0.01), low=-1.0)
    assert isinstance(run.outcome, Stalled)
    assert run.outcome.state == "level"
    assert run.outcome.value < -1.0 <= run.output[-1]
    early = run_odd(Odd(), LoopTask(command=-2.0, until=20.0, step=0.01), (100.0, 0.0, 0.0), low=-1e-3)
    assert isinstance(early.outcome, Stalled)
    assert (early.times.size, early.step < 0.01) == (21, True)


def test_a_lag_that_falls_below_any_step_is_the_step_s_fault() -> None:
    with pytest.raises(
        StepError, match=r"step = 0.01 s is longer than a lag during the run, 0.0095\d* s of sent: odd with pid at t = 0.89 s"
    ):
        run_odd(Odd(lag=0.1, lag_slope=-0.1), LoopTask(command=2.0, until=20.0, step=0.01))


def test_a_lag_that_depends_on_no_state_is_no_stall() -> None:
    """Such a failure is the step's or the model's; made by hand here, as a constant lag is checked before the run."""
    plant = linear_plant(G2D)
    with pytest.raises(LagError, match="made by hand"):
        describe_stall(LagError("made by hand", time=1.0), plant)
