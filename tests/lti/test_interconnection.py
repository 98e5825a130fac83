"""Linear delay systems put together: the algebra of their transfer functions holds to rounding, every delay exact."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.lti.interconnection import append, feed_back, feedback, inverse, parallel, select, series, to_state_space
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace, Signal
from revline.lti.transfer_function import TransferFunction
from tests.lti.drawn import systems

Build = Callable[..., DelayStateSpace]
POINTS = np.array([0.3j, 1j, 2.0 - 3j, 0.5 + 10j, 40j])


def close(found: DelayStateSpace, wanted: np.ndarray) -> None:
    """Equal to 1e-12 of the largest term."""
    values = found.transfer(POINTS)[:, 0, 0]
    assert np.max(np.abs(values - wanted) / (1.0 + np.abs(wanted))) < 1e-12


def at(system: DelayStateSpace) -> np.ndarray:
    return system.transfer(POINTS)[:, 0, 0]


@given(systems(), systems(), systems())
def test_series_is_the_product_and_associative(a: DelayStateSpace, b: DelayStateSpace, c: DelayStateSpace) -> None:
    close(series(a, b), at(a) * at(b))
    close(series(series(a, b), c), at(series(a, series(b, c))))
    assert series(a, b).lags.tolist() == [*a.lags, *b.lags]


@given(systems(), systems())
def test_parallel_is_the_sum_and_commutes(a: DelayStateSpace, b: DelayStateSpace) -> None:
    close(parallel(a, b), at(a) + at(b))
    close(parallel(b, a), at(parallel(a, b)))


@given(systems(), systems())
def test_feedback_is_its_formula(a: DelayStateSpace, b: DelayStateSpace) -> None:
    wanted = at(a) / (1.0 + at(a) * at(b))
    close(feedback(a, b), wanted)
    close(feedback(a, b, sign=1.0), at(a) / (1.0 - at(a) * at(b)))


@given(systems())
def test_an_inverse_undoes(a: DelayStateSpace) -> None:
    direct = replace(a, Dyu=np.array([[3.0]]))
    close(inverse(direct), 1.0 / at(direct))
    close(series(direct, inverse(direct)), np.ones(POINTS.size))


@given(st.lists(st.floats(0.001, 3.0), min_size=1, max_size=6))
def test_a_cascade_of_delays_is_the_delay_of_their_sum(delays: list[float]) -> None:
    omega = np.geomspace(0.01, 300.0, 50)
    whole = to_state_space(TransferFunction(numerator=(1.0,), denominator=(1.0,), delay=delays[0]))
    for delay in delays[1:]:
        whole = series(whole, to_state_space(TransferFunction(numerator=(1.0,), denominator=(1.0,), delay=delay)))
    values = whole.transfer(1j * omega)[:, 0, 0]
    exact = np.exp(-1j * omega * np.sum(delays))
    assert np.max(np.abs(values - exact)) < 1e-12 * (1.0 + 300.0 * np.sum(delays))


def test_an_integrator_with_delay_fed_back_has_its_known_roots() -> None:
    """x' = -k x(t - tau): marginal at k tau = pi/2, where the roots are +-j pi/(2 tau)."""
    integrator = to_state_space(TransferFunction(numerator=(0.5 * np.pi / 0.4,), denominator=(0.0, 1.0), delay=0.4))
    gain = to_state_space(TransferFunction(numerator=(1.0,), denominator=(1.0,)))
    roots = characteristic_roots(feedback(integrator, gain)).roots
    assert roots[0].real == pytest.approx(0.0, abs=1e-10)
    assert abs(roots[0].imag) == pytest.approx(0.5 * np.pi / 0.4, rel=1e-10)


@pytest.mark.parametrize("delay", [0.0, 0.7])
@pytest.mark.parametrize("numerator", [(2.0,), (1.0, -0.5), (1.0, 0.2, 0.3)])
def test_a_realisation_is_its_transfer_function(numerator: tuple[float, ...], delay: float) -> None:
    model = TransferFunction(numerator=numerator, denominator=(1.0, 0.55, 0.035), delay=delay, input_unit="deg", output_unit="rad/s")
    found = to_state_space(model, input_name="throttle", output_name="speed")
    close(found, model(POINTS))
    assert (found.inputs, found.outputs) == ((Signal("throttle", "deg"),), (Signal("speed", "rad/s"),))
    assert found.lags.tolist() == ([delay] if delay else [])


def test_a_dropped_delay_would_be_seen() -> None:
    """Negative control: were the delay of one part lost, the tests above would fail by far more than their tolerance."""
    late, prompt = (to_state_space(TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=d)) for d in (0.02, 0.0))
    assert np.max(np.abs(at(series(late, prompt)) - at(series(prompt, prompt)))) > 1e-3


def test_names_that_meet_are_numbered(build: Build) -> None:
    one = build([0.1], A=-1.0, Bu=1.0, Cy=1.0, Cz=1.0)
    both = append(append(one, one), one)
    assert [signal.name for signal in both.states] == ["x0", "x0_2", "x0_3"]
    assert [signal.name for signal in both.channels] == ["z0", "z0_2", "z0_3"]
    assert select(both, [2], [1]).inputs[0].name == "u0_3"


def test_unfit_connections_are_refused(build: Build) -> None:
    single = build([], A=-1.0, Bu=1.0, Cy=1.0)
    double = build([], A=-1.0, Bu=[[1.0, 2.0]], Cy=1.0)
    with pytest.raises(InvalidInputError, match="1 outputs of the first meet 2 inputs of the second"):
        series(single, double)
    with pytest.raises(InvalidInputError, match=r"y0 in V meets u0 in N"):
        series(single, single)
    with pytest.raises(InvalidInputError, match=r"gains of shape \(1, 1\) where 2 inputs are made of 1 outputs"):
        feed_back(double, [[1.0]])
    with pytest.raises(InvalidInputError, match="2 inputs and 1 outputs have no inverse"):
        inverse(double)
    with pytest.raises(InvalidInputError, match="y0 answers its input late or not at all"):
        inverse(single)
    with pytest.raises(InvalidInputError, match="2 zeros and 1 poles make no state space"):
        to_state_space(TransferFunction(numerator=(1.0, 1.0, 1.0), denominator=(1.0, 1.0)))


def test_an_algebraic_loop_without_solution_is_refused_by_name() -> None:
    direct = to_state_space(TransferFunction(numerator=(1.0, 1.0), denominator=(1.0, 0.5)))  # at once 2 of the input
    half = to_state_space(TransferFunction(numerator=(0.5,), denominator=(1.0,)))
    close(feedback(direct, half), at(direct) / (1.0 + 0.5 * at(direct)))
    with pytest.raises(InvalidInputError, match=r"the algebraic loop from .* to .* has no solution"):
        feedback(direct, half, sign=1.0)
