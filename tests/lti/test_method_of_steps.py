"""The pieces that responses are made of: their order, and what happens where a breakpoint is missed."""

import math

import numpy as np
import pytest
from scipy.special import gammainc

from revline.errors import InvalidInputError, NotConvergedError
from revline.lti import breakpoints as corners
from revline.lti import method_of_steps
from revline.lti.breakpoints import Breakpoints, find_breakpoints
from revline.lti.interconnection import feedback, series, to_state_space
from revline.lti.method_of_steps import Drive, Scheme, chebyshev_tail, march
from revline.lti.state_space import DelayStateSpace
from revline.lti.transfer_function import TransferFunction

LAG, RATE, UNTIL = 0.7, 1.3, 3.5


def loop(lag: float = LAG, rate: float = RATE) -> DelayStateSpace:
    """x' = 1 - rate x - x(t - lag) under a step."""
    plant, late = (TransferFunction(numerator=(1.0,), denominator=d, delay=k) for d, k in (((rate, 1.0), 0.0), ((1.0,), lag)))
    return feedback(to_state_space(plant), to_state_space(late))


def exact(times: np.ndarray) -> np.ndarray:
    """Sum of (-1)^k / (rate^(k + 1)) P(k + 1, rate (t - k lag)), P the regularised incomplete gamma function."""
    return np.asarray(
        sum((-1.0) ** k * gammainc(k + 1, RATE * np.maximum(times - k * LAG, 0.0)) / RATE ** (k + 1) for k in range(8)), dtype=float
    )


def error(degree: int, pieces: int, missed: int = 0) -> float:
    """Largest error with pieces of even length, as many in two lags, some of the first breakpoints left out."""
    system = loop()
    found = find_breakpoints(system, np.array([1.0]), impulse=np.zeros(1), until=UNTIL, smoothest=12)
    left = Breakpoints(times=found.times[missed:], orders=found.orders[missed:], kicks=found.kicks[missed:])
    drive = Drive(start=np.zeros(1), constant=np.array([2.3]))
    record = march(system, drive, left, until=UNTIL, scheme=Scheme(degree=degree, longest=2.0 * LAG / pieces))
    times = np.linspace(0.0, UNTIL, 400)
    return float(np.max(np.abs(record.at(times)[:, 0] - 2.3 * exact(times))))


def observed_order(degree: int, missed: int = 0, pieces: int = 9) -> float:
    """Pieces of an odd number in two lags do not end at one lag by chance."""
    return math.log(error(degree, pieces, missed) / error(degree, 3 * pieces, missed)) / math.log(3.0)


@pytest.mark.parametrize("degree", [2, 3, 4, 5, 6])
def test_the_order_is_the_degree(degree: int) -> None:
    assert observed_order(degree) == pytest.approx(degree, abs=0.2)


def test_a_high_degree_is_exact_to_rounding() -> None:
    assert error(24, 2) < 1e-14


def test_a_breakpoint_that_is_missed_costs_the_order() -> None:
    """Negative control: past the first jump left out, of the second derivative, no degree helps."""
    for degree in (4, 6, 24):
        assert observed_order(degree, missed=1) < 2.7
    assert error(24, 15, missed=1) > 1e-6


def test_jumps_are_carried_by_the_lags_and_smoothed_by_states() -> None:
    """A step into a channel passes a state on every return: orders 0, 1, 2 at one, two, three lags."""
    found = find_breakpoints(loop(0.5), np.array([1.0]), impulse=np.zeros(1), until=2.2, smoothest=12)
    assert found.times.tolist() == [0.5, 1.0, 1.5, 2.0]
    assert found.orders.tolist() == [1, 2, 3, 4]
    assert find_breakpoints(loop(0.5), np.array([1.0]), impulse=np.zeros(1), until=2.2, smoothest=2).times.tolist() == [0.5, 1.0]


def test_times_that_meet_are_one() -> None:
    """0.1 + 0.2 and 0.3 by rounding differ."""
    chain = series(*(to_state_space(TransferFunction(numerator=(1.0,), denominator=(1.0,), delay=d)) for d in (0.1, 0.2)))
    both = DelayStateSpace(
        **{name: np.kron(np.eye(2), getattr(chain, name)) for name in ("A", "Bu", "Bz", "Cy", "Dyu", "Dyz", "Cz", "Dzu", "Dzz")},
        lags=np.array([0.1, 0.2, 0.15, 0.15]), states=(), inputs=tuple(s._replace(name=n) for s in chain.inputs for n in "ab"),
        outputs=tuple(s._replace(name=n) for s in chain.outputs for n in "ab"),
        channels=tuple(s._replace(name=n + s.name) for n in "ab" for s in chain.channels),
    )  # fmt: skip
    found = find_breakpoints(both, np.array([0.0, math.inf, 0.0, math.inf]), impulse=np.zeros(4), until=1.0, smoothest=12)
    assert found.times == pytest.approx([0.1, 0.15, 0.3], abs=1e-15)
    assert found.orders.tolist() == [0, 0, 0]


def test_too_many_jumps_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corners, "MOST_BREAKPOINTS", 3)
    with pytest.raises(NotConvergedError, match=r"more than 3 jumps run through the channels within 4 s, the shortest lag being 0\.7 s"):
        find_breakpoints(loop(), np.array([1.0]), impulse=np.zeros(1), until=4.0, smoothest=12)


def test_pieces_without_end_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    drive, none = Drive(start=np.zeros(1), constant=np.ones(1)), Breakpoints(
        times=np.zeros(0), orders=np.zeros(0, dtype=np.int64), kicks=np.zeros((0, 1))
    )  # fmt: skip
    with pytest.raises(NotConvergedError, match=r"the answer near 0 s is not smooth on any piece, however short"):
        march(loop(), drive, none, until=4.0, scheme=Scheme(degree=2, tail=0.0, longest=0.3))
    monkeypatch.setattr(method_of_steps, "MOST_PIECES", 10)
    with pytest.raises(InvalidInputError, match="a record of 4 s needs more than 10 pieces"):
        march(loop(), drive, none, until=4.0, scheme=Scheme(degree=2, longest=0.1))


def test_last_coefficients_of_known_polynomials() -> None:
    x = -np.cos(np.pi * np.arange(7) / 6)
    values = np.polynomial.chebyshev.chebval(x, [1.0, 2.0, 0.0, 3.0, -1.0, 0.25, -0.5])
    assert chebyshev_tail(6) @ values == pytest.approx([0.25, -0.5], abs=1e-14)
