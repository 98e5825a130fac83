"""The laws of the algebra of linear delay systems, on random systems with several lags, against complex arithmetic and in time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyval

from revline.lti.interconnection import append, feed_back, feedback, inverse, parallel, select, series, to_state_space
from revline.lti.state_space import DelayStateSpace
from revline.lti.time_response import step_response
from revline.lti.transfer_function import TransferFunction
from tests.lti.drawn import named, systems, transfer_functions

POINTS = np.array([0.3j, 1j, 2.0 - 3j, 0.5 + 10j, 40j])
SLOW = st.sampled_from([0.2, 0.5, 0.8])
"""Lags for answers in time: a record has as many pieces as it holds the shortest."""

TIMES = np.array([0.07, 0.31, 0.77, 1.3, 2.13, 2.9])


def at(system: DelayStateSpace) -> np.ndarray:
    return system.transfer(POINTS)


def static(gains: np.ndarray) -> DelayStateSpace:
    """A matrix of gains as a system, all signals in volts."""
    rows, columns = gains.shape
    none = {name: np.zeros(shape) for name, shape in (("A", (0, 0)), ("Bz", (0, 0)), ("Cz", (0, 0)), ("Dzz", (0, 0)))}
    return DelayStateSpace(
        **none, Bu=np.zeros((0, columns)), Cy=np.zeros((rows, 0)), Dyu=gains, Dyz=np.zeros((rows, 0)), Dzu=np.zeros((0, columns)),
        lags=np.zeros(0), states=(), inputs=named("u", columns), outputs=named("y", rows), channels=(),
    )  # fmt: skip


UNIT = static(np.eye(1))
PAIR = static(np.eye(2))


def same(found: DelayStateSpace, wanted: np.ndarray, conditioning: np.ndarray | float = 1.0) -> None:
    """Equal to 1e-12 of the largest term, times how much a solution amplifies what rounding does to its equations."""
    assert np.all(np.abs(at(found) - wanted) <= 1e-12 * (1.0 + np.max(np.abs(wanted))) * conditioning)


def solvable(*matrices: np.ndarray) -> float:
    """Worst condition of some matrices; draws that are worse than 1e3 test rounding and nothing else."""
    worst = max(float(np.max(np.linalg.cond(matrix))) for matrix in matrices)
    assume(worst < 1e3)
    return worst


@given(systems(2, 2), systems(2, 2), systems(2, 2))
def test_products_of_matrices_are_associative_in_the_order_of_flow(a: DelayStateSpace, b: DelayStateSpace, c: DelayStateSpace) -> None:
    same(series(a, b), at(b) @ at(a))
    left, right = series(series(a, b), c), series(a, series(b, c))
    same(left, at(c) @ at(b) @ at(a))
    same(right, at(left))
    assert left.lags.tolist() == right.lags.tolist() == [*a.lags, *b.lags, *c.lags]


@given(systems(2, 2), systems(2, 2), systems(2, 2))
def test_sums_are_associative_and_commute(a: DelayStateSpace, b: DelayStateSpace, c: DelayStateSpace) -> None:
    same(parallel(a, parallel(b, c)), at(a) + at(b) + at(c))
    same(parallel(parallel(a, b), c), at(a) + at(b) + at(c))
    same(parallel(b, a), at(parallel(a, b)))


@given(systems(), systems())
def test_products_of_scalars_commute(a: DelayStateSpace, b: DelayStateSpace) -> None:
    same(series(a, b), at(series(b, a)))


@given(systems(2, 2), systems(2, 2), systems(2, 2))
def test_products_distribute_over_sums(a: DelayStateSpace, b: DelayStateSpace, c: DelayStateSpace) -> None:
    same(series(parallel(a, b), c), at(parallel(series(a, c), series(b, c))))


@given(systems(2, 2))
def test_sensitivities_add_to_one(loop: DelayStateSpace) -> None:
    """S = (1 + L)^-1, T = L (1 + L)^-1: S + T = 1, T = S L."""
    bad = solvable(np.eye(2) + at(loop), np.eye(2) + loop.Dyu[None])
    sensitivity, complement = feedback(PAIR, loop), feedback(loop, PAIR)
    same(parallel(sensitivity, complement), np.broadcast_to(np.eye(2), (POINTS.size, 2, 2)), bad * bad)
    same(complement, np.linalg.solve(np.eye(2) + at(loop), at(loop)), bad)
    same(series(loop, sensitivity), at(complement), bad)


@given(systems(), systems(), systems())
def test_feedback_of_feedback_is_feedback_of_the_sum(a: DelayStateSpace, b: DelayStateSpace, c: DelayStateSpace) -> None:
    bad = solvable(1.0 + at(a) * at(b), 1.0 + at(a) * (at(b) + at(c)))
    for gain in (1.0 + a.Dyu * b.Dyu, 1.0 + a.Dyu * (b.Dyu + c.Dyu)):
        assume(abs(float(gain[0, 0])) > 1e-2)
    assume(np.all(np.abs(1.0 + at(a) * at(b)) > 1e-2) and np.all(np.abs(1.0 + at(a) * (at(b) + at(c))) > 1e-2))
    same(feedback(feedback(a, b), c), at(feedback(a, parallel(b, c))), 1e4 * bad)
    same(feedback(feedback(a, b), b, sign=1.0), at(a), 1e4 * bad)


@given(systems(2, 2))
def test_the_inverse_of_the_inverse_is_the_system(a: DelayStateSpace) -> None:
    direct = replace(a, Dyu=a.Dyu + 3.0 * np.eye(2))
    bad = solvable(at(direct), direct.Dyu)
    same(series(direct, inverse(direct)), np.broadcast_to(np.eye(2), (POINTS.size, 2, 2)), bad)
    same(inverse(inverse(direct)), at(direct), bad)
    assert inverse(direct).lags.tolist() == direct.lags.tolist()


@given(systems(2, 2), systems(1, 1))
def test_appended_systems_do_not_meet(a: DelayStateSpace, b: DelayStateSpace) -> None:
    both = append(a, b)
    same(select(both, [0, 1], [0, 1]), at(a))
    same(select(both, [2], [2]), at(b))
    assert not np.any(at(select(both, [0, 1], [2])))


@given(systems(2, 2), st.lists(st.floats(-0.4, 0.4), min_size=4, max_size=4))
def test_static_gains_close_loops_as_systems_do(a: DelayStateSpace, entries: list[float]) -> None:
    gains = np.array(entries).reshape(2, 2)
    bad = solvable(np.eye(2) - gains @ at(a), np.eye(2) - gains @ a.Dyu[None])
    same(feed_back(a, gains), at(feedback(a, static(gains), sign=1.0)), bad)


@given(st.lists(transfer_functions(), min_size=1, max_size=4))
def test_a_cascade_of_transfer_functions_has_the_sum_of_their_delays(models: list[TransferFunction]) -> None:
    """The same product as a transfer function and as state spaces in series; the delay is exact to 1e-12."""
    whole, product = to_state_space(models[0]), models[0]
    for model in models[1:]:
        whole, product = series(whole, to_state_space(model)), product.series(model)
    assert float(np.sum(whole.lags)) == pytest.approx(product.delay, abs=1e-12)
    # Rounding counts by the terms that are added: near a zero, which a point may hit, these are larger than what is left of them.
    shift = np.exp(-POINTS * product.delay)
    below = [np.abs(polyval(POINTS, model.denominator)) for model in models]
    scale = np.abs(shift) * np.prod([terms(model.numerator) / size for model, size in zip(models, below, strict=True)], axis=0)
    scale *= np.prod([terms(model.denominator) / size for model, size in zip(models, below, strict=True)], axis=0)
    assert np.all(np.abs(at(whole)[:, 0, 0] - product(POINTS)) <= 1e-10 * scale)
    rest = at(replace(whole, lags=np.full(whole.lags.size, 1e-300)))[:, 0, 0] if whole.lags.size else at(whole)[:, 0, 0]
    assert np.all(np.abs(at(whole)[:, 0, 0] - rest * shift) <= 1e-10 * scale)


def terms(coefficients: tuple[float, ...]) -> np.ndarray:
    """Sum of the sizes of a polynomial's terms at the points."""
    return np.asarray(polyval(np.abs(POINTS), np.abs(coefficients)))


@given(transfer_functions(delays=SLOW), transfer_functions(excess=1, delays=SLOW))
@settings(max_examples=15)
def test_steps_obey_the_algebra_too(a: TransferFunction, b: TransferFunction) -> None:
    """The step of a product is that of its transfer function, and does not depend on the order."""
    first, second = to_state_space(a), to_state_space(b)
    product = a.series(b).step_response(TIMES)
    for chain in (series(first, second), series(second, first)):
        found = step_response(chain, TIMES, input_name=chain.inputs[0].name)
        assert found.values[:, 0] == pytest.approx(product, abs=1e-9 * (1.0 + np.max(np.abs(product))))


@given(systems(lags=SLOW, most=1), systems(lags=SLOW, most=1))
@settings(max_examples=15)
def test_steps_of_feedback_satisfy_the_loop(a: DelayStateSpace, b: DelayStateSpace) -> None:
    """What the loop gives at its output is what the forward system makes of command less feedback: T's step + (L T)'s step = G's step."""
    assume(abs(1.0 + float(a.Dyu[0, 0] * b.Dyu[0, 0])) > 0.1)
    closed = feedback(a, b)
    answers = [step_response(one, TIMES, input_name="u0").values for one in (closed, series(closed, series(b, a)), a)]
    assert answers[0] + answers[1] == pytest.approx(answers[2], abs=1e-9 * (1.0 + np.max(np.abs(answers))))


def test_a_swapped_order_would_be_seen() -> None:
    """Negative control: products of matrices do not commute, and a law that held for both orders would prove nothing."""
    a, b = static(np.array([[0.0, 1.0], [0.0, 0.0]])), static(np.array([[0.0, 0.0], [1.0, 0.0]]))
    assert np.max(np.abs(at(series(a, b)) - at(series(b, a)))) == 1.0
