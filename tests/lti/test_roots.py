"""Right-most characteristic roots: closed forms, an independent count, and what has no answer."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.special import lambertw

from revline.errors import AnalysisError, InvalidInputError, NotConvergedError
from revline.lti.feedback import FeedbackBlock, feedback_blocks
from revline.lti.roots import characteristic_roots, differentiation_matrix
from revline.lti.state_space import DelayStateSpace, Signal

Build = Callable[..., DelayStateSpace]


def scalar(a: float, b: float, lag: float) -> DelayStateSpace:
    """x' = a x + b x(t - lag)."""
    one, none = np.ones((1, 1)), np.zeros((1, 0))
    x = (Signal("x"),)
    return DelayStateSpace(
        A=a * one,
        Bu=none,
        Bz=b * one,
        Cy=none.T,
        Dyu=np.zeros((0, 0)),
        Dyz=none.T,
        Cz=one,
        Dzu=none,
        Dzz=0.0 * one,
        lags=np.array([lag]),
        states=x,
        inputs=(),
        outputs=(),
        channels=x,
    )


def lambert_roots(a: float, b: float, lag: float, branches: int = 60) -> np.ndarray:
    """s = a + W_k(b lag exp(-a lag)) / lag, right-most first. Source: Corless et al. (1996), section 2."""
    found = a + lambertw(b * lag * math.exp(-a * lag), np.arange(-branches, branches + 1)) / lag
    return found[np.argsort(-found.real, kind="stable")]


@pytest.mark.parametrize("lag", [0.1, 0.5, 1.0, 1.5, 2.0, 5.0, 20.0, 50.0])
def test_pure_delayed_feedback(lag: float) -> None:
    found = characteristic_roots(scalar(0.0, -1.0, lag), count=8)
    exact = lambert_roots(0.0, -1.0, lag)
    assert found.roots.size == 8
    assert found.roots.real == pytest.approx(exact[:8].real, abs=1e-10)
    assert np.max(np.min(np.abs(found.roots[:, None] - exact), axis=1)) < 1e-10
    assert found.unstable_count == int(np.sum(exact.real > 0.0))
    assert np.all(found.residuals < 1e-12)
    assert found.degree > 0


@given(st.floats(-5.0, 2.0), st.floats(0.1, 4.0), st.booleans(), st.floats(0.05, 3.0))
@settings(max_examples=60, deadline=None)
def test_scalar_with_both_terms(a: float, size: float, negative: bool, lag: float) -> None:  # noqa: FBT001 - drawn by the property test
    b = -size if negative else size
    exact = lambert_roots(a, b, lag)
    axis = np.min(np.abs(exact.real))
    double = abs(b * lag * math.exp(-a * lag) + math.exp(-1.0))
    if axis < 1e-6 or double < 1e-3:
        return
    found = characteristic_roots(scalar(a, b, lag), count=4)
    assert found.spectral_abscissa == pytest.approx(exact[0].real, abs=1e-9)
    assert np.max(np.min(np.abs(found.roots[:, None] - exact), axis=1)) < 1e-9
    assert found.unstable_count == int(np.sum(exact.real > 0.0))
    assert found.stable is bool(exact[0].real < 0.0)


def test_critical_lag_is_half_pi() -> None:
    """At lag pi/2 the right-most pair of x' = -x(t - lag) is +-j: neither stable nor unstable."""
    found = characteristic_roots(scalar(0.0, -1.0, 0.5 * math.pi), count=2)
    assert found.roots == pytest.approx([1j, -1j], abs=1e-12)
    assert (found.stable, found.unstable_count) == (False, 0)
    assert characteristic_roots(scalar(0.0, -1.0, 0.5 * math.pi - 1e-6)).stable
    assert characteristic_roots(scalar(0.0, -1.0, 0.5 * math.pi + 1e-6)).unstable_count == 2


def test_double_root() -> None:
    """x' = -x(t - 1/e) has the double root -e, known to the square root of rounding, and says so."""
    found = characteristic_roots(scalar(0.0, -1.0, math.exp(-1.0)), count=2)
    assert found.roots == pytest.approx([-math.e, -math.e], abs=1e-6)
    assert np.all(np.abs(found.roots + math.e) <= 10.0 * found.errors + 1e-10)


def test_two_lags(build: Build) -> None:
    """x' = -x(t - 1) - x(t - 2)/2: each root solves s + e^-s + e^-2s / 2 = 0, and none is missing."""
    system = build([1.0, 2.0], A=0.0, Bz=[[-1.0, -0.5]], Cz=[[1.0], [1.0]])
    found = characteristic_roots(system, count=10)
    s = found.roots
    assert s + np.exp(-s) + 0.5 * np.exp(-2.0 * s) == pytest.approx(np.zeros(s.size), abs=1e-10)
    (block,) = feedback_blocks(system)
    for k in range(1, 9, 2):
        assert block.count_right_of(float(np.mean(s.real[k : k + 2]))) == k + 1


def test_commensurate_chain_equals_one_long_lag(build: Build) -> None:
    """A channel of 0.3 s that reads one of 0.7 s is one of 1 s."""
    chain = build([0.7, 0.3], A=-0.2, Bz=[[0.0, -1.5]], Cz=[[1.0], [0.0]], Dzz=[[0.0, 0.0], [1.0, 0.0]])
    found = characteristic_roots(chain, count=6)
    assert found.roots == pytest.approx(characteristic_roots(scalar(-0.2, -1.5, 1.0), count=6).roots, abs=1e-9)


def test_channels_outside_the_loop_add_nothing(build: Build) -> None:
    """The first channel is fed by the input alone, the second is read by nothing but the output."""
    system = build([0.5, 0.9], A=[[-1.0, 2.0], [0.0, -3.0]], Bz=[[1.0, 0.0], [0.0, 0.0]], Cz=[[0.0, 0.0], [1.0, 1.0]], Dzu=[[1.0], [0.0]])
    found = characteristic_roots(replace(system))
    assert found.roots.tolist() == [-1.0, -3.0]
    assert (found.degree, found.stable) == (0, True)


def test_cascade_through_a_delay_has_finitely_many_roots(build: Build) -> None:
    system = build([0.5], A=[[-1.0, 0.0], [0.0, -2.0]], Bz=[[0.0], [1.0]], Cz=[[1.0, 0.0]])
    assert characteristic_roots(system, count=10).roots.tolist() == [-1.0, -2.0]


def test_identical_loops_count_twice(build: Build) -> None:
    system = build([1.0, 1.0], A=np.zeros((2, 2)), Bz=-2.0 * np.eye(2), Cz=np.eye(2))
    found = characteristic_roots(system, count=4)
    right = lambert_roots(0.0, -2.0, 1.0)[0]
    upper = found.roots[found.roots.imag > 0.0]
    assert upper == pytest.approx([complex(right.real, abs(right.imag))] * 2, abs=1e-10)
    assert found.unstable_count == 4


def test_pairs_are_not_torn() -> None:
    assert characteristic_roots(scalar(0.0, -1.0, 1.0), count=1).roots.size == 2


def test_neutral_loop(build: Build) -> None:
    """z = x + z(t - 1)/2, x' = -x - z(t - 1): the roots solve s + 1 + e^-s / (1 - e^-s / 2) = 0."""
    system = build([1.0], A=-1.0, Bz=-1.0, Cz=1.0, Dzz=0.5)
    found = characteristic_roots(system, count=6)
    s = found.roots
    assert s + 1.0 + np.exp(-s) / (1.0 - 0.5 * np.exp(-s)) == pytest.approx(np.zeros(s.size), abs=1e-9)
    assert found.stable


def test_loop_of_channels_without_states(build: Build) -> None:
    """z = -z(t - 2)/2: roots (ln(1/2) + j pi (2 k + 1)) / 2."""
    found = characteristic_roots(build([2.0], Dzz=-0.5), count=4)
    assert found.roots == pytest.approx(0.5 * (math.log(0.5) + 1j * math.pi * np.array([1, -1, 3, -3])), abs=1e-10)


def test_system_without_roots(build: Build) -> None:
    found = characteristic_roots(build([2.0], Dzu=1.0, Dyz=1.0))
    assert found.roots.size == 0
    assert found.spectral_abscissa == -math.inf
    assert found.stable


def test_weak_feedback_hides_what_is_far_left() -> None:
    """Feedback of 1e-30 leaves one root that counts; the others lie some 70 lags' worth to the left."""
    found = characteristic_roots(scalar(-1.0, 1e-30, 1.0))
    assert found.roots[0] == pytest.approx(-1.0, abs=1e-12)
    assert found.stable


def test_fast_unstable_state_beside_a_long_lag() -> None:
    found = characteristic_roots(scalar(1000.0, 1.0, 1.0), count=1)
    assert found.roots == pytest.approx([1000.0])
    assert found.unstable_count == 1


@given(st.integers(0, 10_000))
@example(305)  # a spurious candidate whose exp(-s lag) overflows
@settings(max_examples=40, deadline=None)
def test_listed_and_counted_agree_on_random_systems(seed: int) -> None:
    """The argument principle counts as many roots right of a line as collocation lists, on lines between the listed roots."""
    draw = np.random.default_rng(seed)
    n, m = int(draw.integers(1, 4)), int(draw.integers(1, 4))
    A, B, C = draw.normal(size=(n, n)) - np.eye(n), 2.0 * draw.normal(size=(n, m)), draw.normal(size=(m, n))
    x, z = tuple(Signal(f"x{k}") for k in range(n)), tuple(Signal(f"z{k}") for k in range(m))
    system = DelayStateSpace(
        A=A,
        Bu=np.zeros((n, 0)),
        Bz=B,
        Cy=np.zeros((0, n)),
        Dyu=np.zeros((0, 0)),
        Dyz=np.zeros((0, m)),
        Cz=C,
        Dzu=np.zeros((m, 0)),
        Dzz=np.zeros((m, m)),
        lags=draw.uniform(0.1, 1.0, size=m),
        states=x,
        inputs=(),
        outputs=(),
        channels=z,
    )
    found = characteristic_roots(system, count=10)
    (block,) = feedback_blocks(system)
    reals = found.roots.real
    for k in range(reals.size - 1):
        if reals[k] - reals[k + 1] > 1e-3:
            assert block.count_right_of(0.5 * (reals[k] + reals[k + 1])) == k + 1
    assert np.all(np.linalg.svd(system.characteristic(found.roots), compute_uv=False)[:, -1] < 1e-9 * np.exp(np.maximum(-reals, 0.0)))


def test_derivative_of_characteristic_matrix() -> None:
    (block,) = feedback_blocks(scalar(-0.3, 0.7, 0.8))
    below, slope, above = (block.characteristic(np.array([s], dtype=complex)) for s in (0.4 + 2j - 1e-6, 0.4 + 2j, 0.4 + 2j + 1e-6))
    assert slope[1] == pytest.approx((above[0] - below[0]) / 2e-6, abs=1e-9)


def test_differentiation_is_exact_on_polynomials() -> None:
    points = np.cos(np.pi * np.arange(9) / 8)
    assert differentiation_matrix(8) @ points**7 == pytest.approx(7.0 * points**6, abs=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        differentiation_matrix(8)[0, 0] = 1.0


def test_no_roots_asked_for_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="0 roots asked for; ask for at least 1"):
        characteristic_roots(scalar(0.0, -1.0, 1.0), count=0)


def test_channel_loop_with_gain_one_is_refused(build: Build) -> None:
    with pytest.raises(AnalysisError, match="feed one another in a loop with a gain of 1 or more"):
        characteristic_roots(build([1.0], A=-1.0, Bz=-1.0, Cz=1.0, Dzz=1.0))
    with pytest.raises(AnalysisError, match="feed one another in a loop with a gain of 1 or more"):
        characteristic_roots(build([1.0], Dzz=2.0))


def test_lag_too_long_for_a_fast_oscillation_is_refused(build: Build) -> None:
    """Undamped at 1 rad/s, fed back after 10 000 s: hundreds of roots crowd near the axis, nearer than any polynomial tells."""
    system = build([1e4], A=[[0.0, 1.0], [-1.0, 0.0]], Bz=[[0.0], [0.5]], Cz=[[1.0, 0.0]])
    with pytest.raises(NotConvergedError, match=r"did not settle with \d+ points .*the longest lag, 1e\+04 s"):
        characteristic_roots(system)


def test_root_on_the_line_cannot_be_counted() -> None:
    block = FeedbackBlock(A=np.zeros((1, 1)), B=np.zeros((1, 0)), C=np.zeros((0, 1)), D=np.zeros((0, 0)), lags=np.zeros(0))
    with pytest.raises(NotConvergedError, match="the roots right of 0 rad/s cannot be counted: one lies on that line"):
        block.count_right_of(0.0)


def test_roots_must_be_sorted_and_agree_with_the_count() -> None:
    found = characteristic_roots(scalar(0.0, -1.0, 1.0), count=4)
    with pytest.raises(InvalidInputError, match="roots are not listed from the right-most on"):
        replace(found, roots=found.roots[::-1].copy())
    with pytest.raises(InvalidInputError, match="0 roots listed right of the imaginary axis, 2 counted"):
        replace(found, unstable_count=2)
