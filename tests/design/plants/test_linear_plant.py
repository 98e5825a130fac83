import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline import signals
from revline.analysis.linearize import linearize
from revline.dde.simulate import Start, simulate
from revline.design.plants.linear_plant import MOST_POLES, held_plant, linear_plant, step_limit
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem

OMEGA = np.geomspace(0.01, 20.0, 50)


@dataclass(frozen=True)
class Rest:
    states: np.ndarray
    inputs: np.ndarray
    channels: np.ndarray


def transfer(plant: DelaySystem, base_input: float) -> np.ndarray:
    rest = Rest(np.zeros(MOST_POLES), np.array([base_input]), np.zeros(2))
    return linearize(plant, rest).model.transfer(1j * OMEGA)[:, :, 0]


@st.composite
def models(draw: st.DrawFn) -> TransferFunction:
    """One to eight poles in the left half plane, integrators among them, and fewer zeros anywhere; near 1, so that rounding stays small."""
    corner = st.floats(0.5, 2.0)
    order = draw(st.integers(1, MOST_POLES))
    denominator, left = np.ones(1), order
    while left:
        if left >= 2 and draw(st.booleans()):
            natural, damping = draw(corner), draw(st.floats(0.2, 2.0))
            denominator, left = np.convolve(denominator, [1.0, 2.0 * damping / natural, natural**-2.0]), left - 2
        else:
            factor = [0.0, 1.0] if left == 1 and draw(st.booleans()) else [1.0, 1.0 / draw(corner)]
            denominator, left = np.convolve(denominator, factor), left - 1
    numerator = np.array([draw(st.floats(0.5, 20.0))])
    for _ in range(draw(st.integers(0, order - 1))):
        numerator = np.convolve(numerator, [1.0, draw(st.sampled_from([-1.0, 1.0])) / draw(corner)])
    delay = draw(st.floats(1e-3, 0.5))
    return TransferFunction(numerator=tuple(numerator), denominator=tuple(denominator), delay=delay, input_unit="deg", output_unit="rad/s")


@given(model=models(), base_input=st.floats(-50.0, 50.0), base_output=st.floats(-500.0, 500.0))
def test_the_realisation_has_the_model_s_frequency_response(model: TransferFunction, base_input: float, base_output: float) -> None:
    plant = linear_plant(model, base_input=base_input, base_output=base_output)
    found, exact = transfer(plant, base_input), model(1j * OMEGA)
    small = 1e-12 * min(np.max(np.abs(exact)), 20.0)
    conditioning = polynomial_cancellation(model)
    assert np.all(np.abs(found[:, 0] - exact) <= 1e-12 * conditioning * np.abs(exact) + small)
    fastest = OMEGA + abs(model.denominator[-2] / model.denominator[-1])  # the rate is made of terms of this size
    assert np.all(np.abs(found[:, 1] - 1j * OMEGA * exact) <= fastest * (1e-12 * conditioning * np.abs(exact) + small))
    assert plant.output(plant.parameters, (0.0,) * MOST_POLES, (base_input,), (0.0, 0.0)) == (base_output, 0.0)
    assert set(plant.lags(plant.parameters, (), (), ())) == {model.delay}


def polynomial_cancellation(model: TransferFunction) -> np.ndarray:
    """How far the terms of numerator and denominator cancel: what rounding any realisation must amplify."""
    sizes = []
    for coefficients in (model.numerator, model.denominator):
        powers = OMEGA[:, None] ** np.arange(len(coefficients))
        value = (np.array(coefficients) * (1j) ** np.arange(len(coefficients)) * powers).sum(axis=1)
        sizes.append((np.abs(coefficients) * powers).sum(axis=1) / np.abs(value))
    return np.asarray(sizes[0] + sizes[1])


@pytest.mark.parametrize("order", [1, 2, 7, 8])
def test_the_simulated_answer_is_the_exact_one_and_padded_states_stay_zero(order: int) -> None:
    denominator = tuple(np.poly(-np.arange(1.0, order + 1.0))[::-1])
    model = TransferFunction(numerator=(2.0 * denominator[0],), denominator=denominator, delay=0.3, input_unit="deg", output_unit="m")
    plant = linear_plant(model, base_input=5.0, base_output=-7.0)
    start = Start(states=np.zeros(MOST_POLES), inputs=np.array([5.0]))
    run = simulate(plant, start, {"input": signals.step(1.5)}, until=6.0, step=0.005)
    np.testing.assert_allclose(run.output("output"), -7.0 + 1.5 * model.step_response(run.times), rtol=0.0, atol=3e-8)
    after = run.times > 0.3
    np.testing.assert_allclose(run.output("output_rate")[after], 1.5 * model.impulse_response(run.times)[after], rtol=0.0, atol=1e-6)
    assert not np.any(run.states[:, order:])


@pytest.mark.parametrize(("unit", "rate"), [("rad/s", "rad/s2"), ("m", "m/s"), ("km/s", "km/s2"), ("1", "1/s")])
def test_units_are_those_of_the_model(unit: str, rate: str) -> None:
    model = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=0.1, input_unit="deg", output_unit=unit)
    plant = linear_plant(model)
    assert [v.unit for v in plant.outputs] == [v.unit for v in plant.channels] == [unit, rate]
    assert plant.inputs[0].unit == "deg"


def test_what_cannot_be_realised_is_refused() -> None:
    model = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=0.1)
    with pytest.raises(InvalidInputError, match=r"delay = 0 s has no delay to simulate; its closed loop is rational"):
        linear_plant(model.with_delay(0.0))
    with pytest.raises(InvalidInputError, match=r"1 zeros and 1 poles; a plant needs more poles than zeros: add a lag"):
        linear_plant(TransferFunction(numerator=(1.0, 1.0), denominator=(1.0, 1.0), delay=0.1))
    with pytest.raises(InvalidInputError, match=r"0 zeros and 0 poles; a plant needs more"):
        linear_plant(TransferFunction(numerator=(1.0,), denominator=(1.0,), delay=0.1))
    with pytest.raises(InvalidInputError, match=r"9 poles, more than the 8 that can be simulated; fit one of lower order"):
        linear_plant(TransferFunction(numerator=(1.0,), denominator=tuple(np.poly(-np.ones(9))), delay=0.1))
    assert math.isfinite(linear_plant(TransferFunction(numerator=(0.0,), denominator=(1.0, 1.0), delay=0.1)).parameters.delay)


def test_the_step_follows_the_fastest_pole_and_the_delay() -> None:
    model = TransferFunction(numerator=(1.0,), denominator=(1.0, 0.01), delay=0.5)
    assert step_limit(model) == pytest.approx(0.25 / 100.0)
    assert step_limit(model.with_delay(0.004)) == 0.001
    integrator = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=0.2)
    assert step_limit(integrator) == 0.05


def test_a_held_model_without_delay_is_itself_and_one_with_delay_the_delayed_plant() -> None:
    model = TransferFunction(numerator=(2.0, 0.3), denominator=(1.0, 0.7, 0.1), input_unit="deg", output_unit="rad/s")
    plant = held_plant(model, base_input=3.0, base_output=7.0)
    rest = Rest(np.zeros(MOST_POLES), np.array([3.0]), np.zeros(0))
    found = linearize(plant, rest).model.transfer(1j * OMEGA)[:, 0, 0]
    np.testing.assert_allclose(found, model(1j * OMEGA), rtol=1e-12)
    assert plant.output(plant.parameters, (0.0,) * MOST_POLES, (3.0,), ()) == (7.0,)
    delayed = model.with_delay(0.1)
    assert held_plant(delayed).equation_digest == linear_plant(delayed).equation_digest
    assert step_limit(model) == pytest.approx(0.25 / np.abs(model.poles).max())
