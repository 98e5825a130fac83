"""To and from python-control: what is rational comes back, what is not says its error, and nothing loses a delay silently."""

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from revline.errors import InvalidInputError
from revline.lti.control_exchange import (
    approximate_lags,
    response_from_control,
    response_to_control,
    state_space_from_control,
    to_control,
)
from revline.lti.interconnection import to_state_space
from revline.lti.response import FrequencyResponse
from revline.lti.state_space import DelayStateSpace, Signal
from revline.lti.transfer_function import TransferFunction

Build = Callable[..., DelayStateSpace]
OMEGA = np.geomspace(0.1, 30.0, 25)


@pytest.fixture(scope="session")
def control() -> Any:
    """The extra itself; its import takes seconds."""
    return pytest.importorskip("control")


def several(build: Build) -> DelayStateSpace:
    """Two inputs, two outputs, two lags of which one follows the other, and direct feedthrough."""
    return build(
        [0.05, 0.12], A=[[-1.0, 0.4], [0.0, -3.0]], Bu=[[1.0, 0.0], [0.0, 2.0]], Bz=[[0.5, 0.0], [0.0, -1.0]], Cy=np.eye(2),
        Dyu=[[0.0, 0.1], [0.0, 0.0]], Dyz=[[0.0, 0.3], [0.2, 0.0]], Cz=[[1.0, 0.0], [0.0, 0.5]], Dzu=[[0.0, 1.0], [0.0, 0.0]],
        Dzz=[[0.0, 0.0], [0.6, 0.0]],
    )  # fmt: skip


def values(model: Any, omega: np.ndarray) -> np.ndarray:
    """Response of a system of python-control, as (frequencies, outputs, inputs)."""
    return np.moveaxis(np.atleast_3d(model(1j * omega, squeeze=False)), -1, 0)


@pytest.mark.parametrize("order", [1, 3, 6])
def test_the_error_is_that_of_the_approximant(control: Any, order: int) -> None:
    """For a lone delay |approximate - exact| is known from python-control's own approximant, and largest at the band's end."""
    model = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.5), delay=0.1, input_name="throttle", output_name="speed")
    found = to_control(model, order=order, low=0.1, high=30.0)
    own = control.tf(*control.pade(0.1, order))
    exact = np.exp(-0.1j * 30.0)
    assert found.max_relative_error == pytest.approx(abs(complex(own(30j)) - exact), rel=1e-5, abs=1e-12)
    assert found.frequency == pytest.approx(30.0)
    assert (found.order, found.low, found.high) == (order, 0.1, 30.0)
    assert (found.input_name, found.output_name) == ("throttle", "speed")
    assert found.system.input_labels == ["throttle"]
    assert values(found.system, OMEGA)[:, 0, 0] == pytest.approx(own(1j * OMEGA) * 2.0 / (1.0 + 0.5j * OMEGA), rel=1e-9)


def test_several_inputs_and_delays_converge_with_the_order(control: Any, build: Build) -> None:
    system = several(build)
    exact = system.transfer(1j * OMEGA)
    errors = []
    for order in (1, 2, 4, 8):
        found = to_control(system, order=order, low=0.1, high=30.0)
        assert isinstance(found.system, control.StateSpace)
        there = np.max(np.abs(values(found.system, OMEGA) - exact) / np.maximum(np.abs(exact), 1e-300))
        assert there <= found.max_relative_error * (1.0 + 1e-6)
        errors.append(found.max_relative_error)
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 0.1
    assert errors[-1] < 1e-8


def test_without_lags_nothing_is_approximated(control: Any) -> None:
    plain = TransferFunction(numerator=(1.0, 0.2), denominator=(1.0, 0.5, 0.1))
    found = to_control(plain, order=1, low=0.1, high=10.0)
    assert found.max_relative_error < 1e-14
    back = state_space_from_control(found.system)
    assert back.transfer(1j * OMEGA)[:, 0, 0] == pytest.approx(plain(1j * OMEGA), rel=1e-13)
    assert isinstance(found.system, control.StateSpace)


def test_models_of_python_control_are_taken(control: Any) -> None:
    model = control.tf([[[1.0, 2.0], [3.0]], [[1.0], [0.5, 0.0, 1.0]]], [[[1.0, 4.0], [2.0, 1.0]], [[1.0], [1.0, 1.0, 7.0]]])
    found = state_space_from_control(model, units={"u[0]": "deg", "y[1]": "rad/s"})
    assert found.transfer(1j * OMEGA) == pytest.approx(values(model, OMEGA), rel=1e-12)
    assert (found.inputs[0], found.inputs[1], found.outputs[1]) == (Signal("u[0]", "deg"), Signal("u[1]", "1"), Signal("y[1]", "rad/s"))
    space = control.ss([[-1.0, 2.0], [0.0, -3.0]], np.eye(2), [[1.0, 1.0]], [[0.0, 0.5]])
    assert state_space_from_control(space).transfer(1j * OMEGA) == pytest.approx(values(space, OMEGA), rel=1e-12)
    assert state_space_from_control(control.tf([2.0], [1.0])).Dyu.tolist() == [[2.0]]


def test_responses_go_and_come_with_their_delays_exact(control: Any, build: Build) -> None:
    system = several(build)
    data = response_to_control(system, OMEGA)
    assert isinstance(data, control.FrequencyResponseData)
    assert np.moveaxis(data.frdata, -1, 0) == pytest.approx(system.transfer(1j * OMEGA), rel=1e-15)
    back = response_from_control(data, input_name="u1", output_name="y0", units={"u1": "N"})
    assert back.values.tolist() == system.transfer(1j * OMEGA)[:, 0, 1].tolist()
    assert (back.input_unit, back.output_unit, back.method) == ("N", "1", "python-control")
    model = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.5), delay=0.1)
    single = response_from_control(response_to_control(model, OMEGA))
    assert single.values.tolist() == model.response(OMEGA).values.tolist()
    again = response_to_control(FrequencyResponse(omega=OMEGA, values=single.values))
    assert again.frdata[0, 0].tolist() == single.values.tolist()


@pytest.mark.parametrize(("lag", "order", "kept"), [(1.5, 1, True), (1.6, 1, False), (1.6, 4, True)])
def test_an_approximant_that_changes_stability_says_so(build: Build, lag: float, order: int, kept: bool) -> None:  # noqa: FBT001 - a column of the table
    """x' = -x(t - lag) is unstable from lag pi/2 on, with a first-order approximant from 2 on: roots of s^2 lag/2 + s (1 - lag/2) + 1."""
    found = to_control(build([lag], A=0.0, Bu=1.0, Bz=-1.0, Cy=1.0, Cz=1.0), order=order, low=0.1, high=10.0)
    assert found.unstable_roots == (2 if lag > 0.5 * math.pi else 0)
    assert found.keeps_stability is kept


def test_what_cannot_be_taken_is_refused(control: Any, build: Build) -> None:
    with pytest.raises(InvalidInputError, match=r"the model is discrete, with a period of 0\.01 s.*convert it to continuous time first"):
        state_space_from_control(control.tf([1.0], [1.0, 0.5], 0.01))
    with pytest.raises(InvalidInputError, match="the model is discrete, of unknown period"):
        state_space_from_control(control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], dt=True))
    with pytest.raises(InvalidInputError, match="the model's time base is not given"):
        state_space_from_control(control.tf([1.0], [1.0, 0.5], None))
    with pytest.raises(InvalidInputError, match="float is no StateSpace and no TransferFunction of python-control"):
        state_space_from_control(1.0)
    with pytest.raises(InvalidInputError, match="2 zeros and 1 poles make no state space"):
        state_space_from_control(control.tf([1.0, 1.0, 1.0], [1.0, 1.0]))
    with pytest.raises(InvalidInputError, match="float is no FrequencyResponseData"):
        response_from_control(1.0)
    with pytest.raises(InvalidInputError, match=r"the data have 2 inputs, u0, u1; give input_name"):
        response_from_control(response_to_control(several(build), OMEGA))
    with pytest.raises(InvalidInputError, match="a response has its own frequencies, a model needs some"):
        response_to_control(several(build))
    with pytest.raises(InvalidInputError, match="the model is discrete, with a period of 1 s"):
        response_from_control(control.FRD([1.0, 0.5], [0.1, 0.2], dt=1))


@pytest.mark.parametrize("order", [0, 21, 2.5])
def test_orders_out_of_range_are_refused(order: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"order of the Pade approximant = .* is outside 1 to 20"):
        to_control(TransferFunction(numerator=(1.0,), denominator=(1.0,), delay=1.0), order=order, low=0.1, high=1.0)


def test_bands_that_are_none_are_refused() -> None:
    model = TransferFunction(numerator=(1.0,), denominator=(1.0,), delay=1.0)
    for low, high in ((0.0, 1.0), (2.0, 1.0), (1.0, math.inf)):
        with pytest.raises(InvalidInputError, match=r"a band from .* rad/s cannot be compared over; give two rising frequencies above 0"):
            to_control(model, order=2, low=low, high=high)
    with pytest.raises(InvalidInputError, match=r"the lags turn 1.59e\+05 times between 1 and 1e\+06 rad/s, too often to compare"):
        to_control(model, order=2, low=1.0, high=1e6)
    with pytest.raises(InvalidInputError, match=r"the model is zero from 0\.1 to 1 rad/s"):
        to_control(model.scaled(0.0), order=2, low=0.1, high=1.0)


def test_an_approximant_that_closes_an_algebraic_loop_is_refused(build: Build) -> None:
    """Of odd order an approximant is -1 at infinite frequency: z = -z(t - 1) is a loop of gain 1 then, though the delay makes it none."""
    with pytest.raises(InvalidInputError, match=r"the algebraic loop from .* to .* has no solution"):
        approximate_lags(build([1.0], Dzz=-1.0, Dzu=1.0, Dyz=1.0), 1)


def test_a_dropped_delay_would_be_seen() -> None:
    """Negative control: the same model without its lag errs by as much as the lag turns."""
    late = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=0.1)
    prompt = to_state_space(late.with_delay(0.0)).transfer(30j)[0, 0]
    assert abs(prompt / late(30j) - 1.0) > 1.0


def test_the_extra_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InvalidInputError, match=r"python-control is not installed; pip install revline\[control\]"):
        to_control(TransferFunction(numerator=(1.0,), denominator=(1.0,)), order=2, low=0.1, high=1.0)
