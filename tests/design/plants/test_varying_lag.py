"""The model with a delay of an angle over its own output: exact small-signal response, and what the variation does."""

from pathlib import Path

import numpy as np
import pytest

from revline import signals
from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.dde.simulate import Start, simulate
from revline.design.fitting.fit import DelayRule, fit_transfer_function
from revline.design.plants.varying_lag import varying_lag_model
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError, LagError
from revline.io.response_files import read_response
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem

W0, ANGLE = 240.0, 5.5
TAU = ANGLE / W0
OMEGA = np.geomspace(0.05, 100.0, 40)
SECOND = TransferFunction(numerator=(9.0, 0.05), denominator=(1.0, 0.6, 0.05), input_unit="deg", output_unit="rad/s")
OTHERS = (
    TransferFunction(numerator=(9.0,), denominator=(1.0, 0.6), input_unit="deg", output_unit="rad/s"),
    TransferFunction(numerator=(9.0, 0.1, 0.01), denominator=(1.0, 0.7, 0.06, 0.002), input_unit="deg", output_unit="rad/s"),
    TransferFunction(numerator=(9.0, 1.0), denominator=(1.0, 0.75, 0.1, 0.01, 0.0002), input_unit="deg", output_unit="rad/s"),
)


def build(model: TransferFunction, angle: float = ANGLE) -> DelaySystem:
    return varying_lag_model(model, angle=angle, base_input=25.0, base_output=W0)


def step_error(amplitude: float, angle: float = ANGLE) -> float:
    """Largest difference from the fixed lag, per unit of a step of an amplitude to both sides, averaged: its odd part is left."""
    system, start = build(SECOND, angle), Start(states=np.zeros(4), inputs=np.array([25.0]))
    up, down = (simulate(system, start, {"input": signals.step(size)}, until=1.0, step=1e-3) for size in (amplitude, -amplitude))
    odd = (up.output("output") - down.output("output")) / (2.0 * amplitude)
    return float(np.max(np.abs(odd - SECOND.with_delay(TAU).step_response(up.times))))


@pytest.mark.parametrize("model", [SECOND, *OTHERS], ids=lambda m: f"order {len(m.denominator) - 1}")
def test_small_signals_see_the_fixed_lag(model: TransferFunction) -> None:
    system = build(model)
    response = linearize(system, find_trim(system, inputs={"input": 25.0})).model.transfer(1j * OMEGA)[:, 0, 0]
    exact = model.with_delay(TAU)(1j * OMEGA)
    assert np.max(np.abs(response / exact - 1.0)) < 1e-12


def test_another_angle_is_noticed() -> None:
    """Negative control: a wrong angle is another response."""
    system = build(SECOND, 1.01 * ANGLE)
    response = linearize(system, find_trim(system, inputs={"input": 25.0})).model.transfer(1j * OMEGA)[:, 0, 0]
    assert np.max(np.abs(response / SECOND.with_delay(TAU)(1j * OMEGA) - 1.0)) > 1e-2


def test_a_vanishing_step_is_that_of_the_fixed_lag_and_the_difference_is_of_second_order() -> None:
    small, double = step_error(1.0), step_error(2.0)
    assert step_error(1e-3) < 1e-6
    assert np.log2(double / small) == pytest.approx(2.0, abs=0.1)


def test_a_wrong_angle_leaves_a_difference_however_small_the_step() -> None:
    """Negative control of the limit of small steps."""
    assert step_error(1e-3, 1.05 * ANGLE) > 1e-3


def test_an_output_that_falls_to_nothing_is_an_error() -> None:
    """The lag grows without limit on the way, so that the delayed time runs backwards before the output is 0."""
    with pytest.raises(LagError, match=r"stalled: varying_lag_model at t = .*deviation = -1.* the lag of drive grows to"):
        simulate(build(SECOND), Start(states=np.zeros(4), inputs=np.array([25.0])), {"input": signals.step(-60.0)}, until=4.0, step=1e-3)


@pytest.mark.parametrize(("angle", "base"), [(0.0, W0), (ANGLE, 0.0), (float("nan"), W0)])
def test_what_makes_no_delay_is_refused(angle: float, base: float) -> None:
    with pytest.raises(InvalidInputError, match="makes no delay angle / base_output above 0"):
        varying_lag_model(SECOND, angle=angle, base_input=25.0, base_output=base)


def test_models_of_another_kind_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="2 zeros and 2 poles; a varying lag needs 1 to 4 poles"):
        build(TransferFunction(numerator=(1.0, 1.0, 1.0), denominator=(1.0, 1.0, 0.1)))
    with pytest.raises(InvalidInputError, match=r"slowest pole is .* needs it real and stable"):
        build(TransferFunction(numerator=(1.0,), denominator=(1.0, 0.1, 1.0)))


def test_on_the_thesis_s_step_the_joint_fit_helps_much_and_the_varying_lag_little() -> None:
    """Lee (1995), Fig. 6.2: 5 deg from 25 deg. The errors were 0.965, 0.432, 0.435 and 0.429 rad/s (root mean square) when written."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    speed = trim.output("engine_speed")
    angle = trim.lag("charge") * speed
    signal = signals.step(5.0, start=0.5)
    truth = simulate(engine, Start(states=trim.states, inputs=trim.inputs), {"throttle": signal}, until=4.0, step=1e-3)
    data = read_response(Path(__file__).parents[2] / "reference" / "table_4_1.csv").response
    delays: dict[str, DelayRule | float] = {"line": DelayRule.PHASE_LINE, "free": DelayRule.FREE, "known": angle / speed}
    models = {name: fit_transfer_function(data, zeros=0, poles=2, delay=delay).model for name, delay in delays.items()}
    error = {}
    for name, model in models.items():
        after = truth.times >= 0.5
        answer = np.zeros(truth.times.size)
        answer[after] = 5.0 * model.step_response(truth.times[after] - 0.5)
        error[name] = answer + speed - truth.output("engine_speed")
    system = varying_lag_model(models["known"], angle=angle, base_input=25.0, base_output=speed)
    start = Start(states=np.zeros(4), inputs=np.array([25.0]))
    varying = simulate(system, start, {"input": signal}, until=4.0, step=1e-3)
    error["varying"] = varying.output("output") - truth.output("engine_speed")
    rms = {name: float(np.sqrt(np.mean(values**2))) for name, values in error.items()}
    assert angle == pytest.approx(5.48, rel=1e-9)
    assert rms["line"] == pytest.approx(0.965, abs=0.002)
    assert rms["free"] == pytest.approx(0.4321, abs=0.001)
    assert rms["known"] == pytest.approx(0.4346, abs=0.001)
    assert rms["varying"] == pytest.approx(0.4286, abs=0.001)
