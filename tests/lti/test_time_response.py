"""Step and impulse responses with every delay exact: closed forms, the definition of the Laplace transform, other integrators."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from revline.errors import InvalidInputError, NotConvergedError
from revline.lti import time_response
from revline.lti.interconnection import feedback, parallel, series, to_state_space
from revline.lti.method_of_steps import Scheme
from revline.lti.state_space import DelayStateSpace
from revline.lti.time_response import TimeResponse, impulse_response, step_response
from revline.lti.transfer_function import TransferFunction
from tests.lti.drawn import systems, transfer_functions

Build = Callable[..., DelayStateSpace]


def rational(numerator: Sequence[float], denominator: Sequence[float] = (1.0,), delay: float = 0.0) -> DelayStateSpace:
    return to_state_space(TransferFunction(numerator=tuple(numerator), denominator=tuple(denominator), delay=delay))


def after(times: np.ndarray, start: float, values: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Values from a time on, zero before."""
    later = times >= start - 1e-12
    return np.where(later, values(np.where(later, times - start, 0.0)), 0.0)


def power(t: np.ndarray, *, degree: int, factor: float) -> np.ndarray:
    return np.asarray(factor * t**degree / math.factorial(degree))


def integrator_fed_back(times: np.ndarray, lag: float) -> np.ndarray:
    """x' = 1 - x(t - lag) from rest: x = sum of (-1)^k (t - k lag)^(k + 1) / (k + 1)!, by the method of steps."""
    total, k = np.zeros(times.shape), 0
    while k * lag <= np.max(times):
        total += after(times, k * lag, partial(power, degree=k + 1, factor=(-1.0) ** k))
        k += 1
    return total


@pytest.mark.parametrize("lag", [0.3, 0.7, 1.0, math.pi / 2.0, 2.5])
def test_an_integrator_with_delay_fed_back(lag: float) -> None:
    """Stable below lag pi/2, unstable above: exact in both."""
    loop = feedback(rational([1.0], [0.0, 1.0]), rational([1.0], delay=lag))
    times = np.linspace(0.0, 8.0, 321)
    found = step_response(loop, times, input_name="input")
    exact = integrator_fed_back(times, lag)
    assert np.max(np.abs(found.values[:, 0] - exact)) < 1e-11 * np.max(np.abs(exact))
    assert found.errors[0] < 1e-11 * np.max(np.abs(exact))
    assert (found.jumps, found.impulses, found.kind, found.input.name) == ((), (), "step", "input")
    slope = impulse_response(loop, times, input_name="input")
    derivative = after(times, 0.0, np.ones_like) - np.interp(times - lag, times, exact, left=0.0)
    on_grid = np.abs((times - lag) / 0.025 - np.round((times - lag) / 0.025)) < 1e-9
    assert np.max(np.abs(slope.values[on_grid, 0] - derivative[on_grid]), initial=0.0) < 1e-10 * np.max(np.abs(exact))
    assert slope.jumps[0] == (0.0, (0.0,), (1.0,))


def test_first_order_with_dead_time() -> None:
    """Step K (1 - exp(-(t - L)/T)), impulse K/T exp(-(t - L)/T), which jumps at L and has both sides there."""
    plant, times = rational([2.0], [1.0, 0.5], 0.3), np.array([-1.0, 0.0, 0.1, 0.29, 0.3, 0.31, 1.0, 7.0, 0.5])
    step, impulse = step_response(plant, times, input_name="input"), impulse_response(plant, times, input_name="input")
    assert step.output("output") == pytest.approx(after(times, 0.3, lambda t: 2.0 * (1.0 - np.exp(-t / 0.5))), abs=1e-12)
    assert impulse.output("output") == pytest.approx(after(times, 0.3, lambda t: 4.0 * np.exp(-t / 0.5)), abs=1e-12)
    assert step.jumps == ()
    ((time, before, behind),) = impulse.jumps
    assert (time, before) == (0.3, (0.0,))
    assert behind == pytest.approx((4.0,), abs=1e-12)


def test_a_cascade_of_delays_jumps_once_at_their_sum() -> None:
    """The time of the jump is exact to 1e-12, and an impulse comes out whole."""
    delays = (0.1, 0.2, 0.3, 0.123456789, 1e-3)
    whole = rational([1.5], delay=delays[0])
    for delay in delays[1:]:
        whole = series(whole, rational([2.0], delay=delay))
    total = sum(delays)
    step = step_response(whole, [0.0, total - 1e-9, total, 1.0], input_name="input")
    assert step.values[:, 0].tolist() == pytest.approx([0.0, 0.0, 24.0, 24.0], rel=1e-14)
    ((time, before, behind),) = step.jumps
    assert before == (0.0,)
    assert behind == pytest.approx((24.0,), rel=1e-14)
    assert time == pytest.approx(total, abs=1e-12)
    impulse = impulse_response(whole, [1.0], input_name="input")
    assert impulse.values.tolist() == [[0.0]]
    ((time, areas),) = impulse.impulses
    assert areas == (24.0,)
    assert time == pytest.approx(total, abs=1e-12)


def test_proportional_integral_control_of_dead_time_by_the_method_of_steps() -> None:
    """T = sum of (-1)^k L^(k + 1): with the integral time equal to the lag, L = k exp(-s D)/s, each term is a power of time."""
    lag, dead, gain = 0.6, 0.2, 2.5
    controller, plant = rational([gain, gain * lag], [0.0, 1.0]), rational([1.0], [1.0, lag], dead)
    loop = feedback(series(controller, plant), rational([1.0]))
    times = np.linspace(0.0, 4.0, 201)
    exact, k = np.zeros(times.shape), 1
    while k * dead <= 4.0:
        exact += after(times, k * dead, partial(power, degree=k, factor=-((-gain) ** k)))
        k += 1
    found = step_response(loop, times, input_name="input")
    assert np.max(np.abs(found.values[:, 0] - exact)) < 1e-11
    general = feedback(series(rational([0.8, 1.1], [0.0, 1.0]), plant), rational([1.0]))
    assert step_response(general, [60.0], input_name="input").values[0, 0] == pytest.approx(1.0, abs=1e-9)


def test_echoes_without_states_jump_at_every_return() -> None:
    """y = u - y(t - 0.4)/2: jumps of (-1/2)^k at 0.4 k, an impulse of that area each."""
    echo = feedback(rational([1.0]), rational([0.5], delay=0.4))
    times = np.array([0.0, 0.39, 0.4, 0.41, 0.8, 1.2, 2.0])
    step = step_response(echo, times, input_name="input")
    assert step.values[:, 0] == pytest.approx([1.0, 1.0, 0.5, 0.5, 0.75, 0.625, 0.65625], abs=1e-14)
    assert [jump.time for jump in step.jumps] == pytest.approx([0.0, 0.4, 0.8, 1.2, 1.6, 2.0], abs=1e-14)
    assert [jump.after[0] - jump.before[0] for jump in step.jumps] == pytest.approx([(-0.5) ** k for k in range(6)], abs=1e-14)
    impulse = impulse_response(echo, times, input_name="input")
    assert [entry.areas[0] for entry in impulse.impulses] == [(-0.5) ** k for k in range(6)]
    assert not np.any(impulse.values)


def test_an_impulse_that_comes_late_moves_the_states_again(build: Build) -> None:
    """x' = -x + u + u(t - 0.5) exactly: two exponentials, the second from 0.5 on."""
    system = build([0.5], A=-1.0, Bu=1.0, Bz=1.0, Cy=1.0, Dzu=1.0)
    times = np.array([0.0, 0.25, 0.5, 0.75, 3.0])
    exact = np.exp(-times) + after(times, 0.5, lambda t: np.exp(-t))
    found = impulse_response(system, times, input_name="u0")
    assert found.values[:, 0] == pytest.approx(exact, abs=1e-13)
    assert [jump.time for jump in found.jumps] == [0.0, 0.5]


GAUSS = np.polynomial.legendre.leggauss(20)


def transformed(respond: Callable[[np.ndarray], TimeResponse], lags: np.ndarray, s: np.ndarray, until: float) -> np.ndarray:
    """Integrate y(t) exp(-s t) from 0 on by Gauss's rule between all sums of lags; shape (s, outputs)."""
    sums = {0.0, until, *np.linspace(0.0, until, 25).tolist()}
    for counts in itertools.product(range(7), repeat=lags.size):
        sums.add(round(float(np.dot(counts, lags)), 9))
    edges = np.array(sorted(t for t in sums if t <= until))
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    times, weights = (middle[:, None] + half[:, None] * GAUSS[0]).ravel(), (half[:, None] * GAUSS[1]).ravel()
    values = respond(times).values
    return np.asarray((np.exp(-np.outer(s, times)) * weights) @ values)


LAGS = st.sampled_from([0.25, 0.5, 0.75, 1.0, 0.6180339887])
S = np.array([9.0, 9.5 + 2.0j, 10.0 - 5.0j])
"""So far right that what grows fastest among the drawn systems has vanished at the record's end."""


@given(systems(inputs=2, outputs=2, lags=LAGS), st.sampled_from(["u0", "u1"]))
@settings(max_examples=40)
def test_the_laplace_transform_of_a_response_is_the_transfer_function(system: DelayStateSpace, name: str) -> None:
    """Random systems with delays that feed one another and with direct feedthrough; an impulse's answer with its impulses."""
    wanted = system.transfer(S)[:, :, int(name[1])]
    step = transformed(lambda t: step_response(system, t, input_name=name), system.lags, S, 6.0)
    assert np.max(np.abs(step - wanted / S[:, None])) < 1e-9
    impulses = impulse_response(system, [6.0], input_name=name).impulses
    regular = transformed(lambda t: impulse_response(system, t, input_name=name), system.lags, S, 6.0)
    for time, areas in impulses:
        regular = regular + np.exp(-S * time)[:, None] * np.array(areas)
    assert np.max(np.abs(regular - wanted)) < 1e-9


def test_a_shifted_lag_would_be_seen() -> None:
    """Negative control of the test above: one lag a thousandth of a second longer."""
    system = rational([1.0], [1.0, 0.3], 0.5)
    found = transformed(lambda t: step_response(replace(system, lags=np.array([0.501])), t, input_name="input"), system.lags, S, 6.0)
    assert np.max(np.abs(found[:, 0] - system.transfer(S)[:, 0, 0] / S)) > 1e-7


@given(transfer_functions())
@settings(max_examples=40)
def test_a_transfer_function_answers_as_its_closed_form(model: TransferFunction) -> None:
    times = np.linspace(0.0, 5.0, 37)
    found = step_response(to_state_space(model), times, input_name="input")
    exact = model.step_response(times)
    assert np.max(np.abs(found.values[:, 0] - exact)) <= 1e-11 * (1.0 + np.max(np.abs(exact)))


@given(systems(), systems())
@settings(max_examples=15)
def test_steps_add_as_the_systems_do(a: DelayStateSpace, b: DelayStateSpace) -> None:
    times = np.linspace(0.0, 3.0, 50) + 1e-4
    try:
        sides = [step_response(one, times, input_name="u0").values for one in (a, b, parallel(a, b))]
    except NotConvergedError as error:  # short lags that do not meet: refused by name, as it is to be
        if "jumps run through the channels" not in str(error):
            raise
        reject()
    assert sides[0] + sides[1] == pytest.approx(sides[2], abs=1e-10)


def test_two_lags_that_do_not_meet_agree_with_scipy(build: Build) -> None:
    """x1' = x2(t - 1), x2' = -x1(t - sqrt 2) - x2/2 + u, by scipy's order 8 on its own dense output, piece by piece."""
    lags, ends = (1.0, math.sqrt(2.0)), np.linspace(0.0, 6.0, 61)[1:]
    pieces: list[tuple[float, Callable[[float], np.ndarray]]] = []

    def old(time: float, index: int) -> float:
        if time <= 0.0:
            return 0.0
        return float(next(values for end, values in pieces if time <= end)(time)[index])

    state, start = np.zeros(2), 0.0
    corners = sorted({*ends.tolist(), *(a * lags[0] + b * lags[1] for a in range(7) for b in range(5))})
    for end in (c for c in corners if 0.0 < c <= 6.0):
        done = solve_ivp(
            lambda t, x: [old(t - lags[0], 1), -old(t - lags[1], 0) - 0.5 * x[1] + 1.0], (start, end), state, "DOP853", rtol=1e-12,
            atol=1e-14, dense_output=True,
        )  # fmt: skip
        pieces.append((end, done.sol))
        state, start = done.y[:, -1], end
    system = build(lags, A=[[0.0, 0.0], [0.0, -0.5]], Bu=[[0.0], [1.0]], Bz=np.eye(2), Cy=np.eye(2), Cz=[[0.0, 1.0], [-1.0, 0.0]])
    found = step_response(system, ends, input_name="u0").values
    other = np.array([[old(t, 0), old(t, 1)] for t in ends])
    assert np.max(np.abs(found - other)) < 1e-9


def test_channels_and_states_that_do_not_matter_cost_nothing(build: Build) -> None:
    """A lag of a microsecond that the input does not move, and one that no output feels."""
    system = build(
        [0.5, 1e-6, 1e-7], A=-np.eye(3), Bu=[[1.0], [0.0], [0.0]], Bz=[[0.0, 1.0, 0.0], [0.0] * 3, [0.0, 0.0, 1.0]], Cy=[[1.0, 0.0, 0.0]],
        Cz=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
    )  # fmt: skip
    found = step_response(system, [1.0, 10.0], input_name="u0")
    assert found.values[:, 0] == pytest.approx(1.0 - np.exp([-1.0, -10.0]), abs=1e-12)
    assert found.pieces < 20


def test_stiff_and_fast_systems_are_halved_where_they_need_it() -> None:
    fast = rational([1.0], np.convolve([1.0, 1.0], [1.0, 1e-4]).tolist(), 0.5)
    times = np.array([0.5001, 0.501, 0.6, 3.0])
    found = step_response(fast, times, input_name="input")
    t = times - 0.5
    assert found.values[:, 0] == pytest.approx(1.0 - (np.exp(-t) - 1e-4 * np.exp(-t / 1e-4)) / (1.0 - 1e-4), abs=1e-11)
    assert found.pieces < 600  # evenly short pieces would be thousands


def test_time_zero_alone() -> None:
    assert step_response(rational([1.0, 2.0], [1.0, 1.0]), [0.0, -1.0], input_name="input").values.tolist() == [[2.0], [0.0]]
    assert step_response(rational([1.0, 2.0], [1.0, 1.0]), [-1.0], input_name="input").jumps == ((0.0, (0.0,), (2.0,)),)


@pytest.mark.parametrize(
    ("times", "options", "message"),
    [
        ([1.0], {"input_name": "throttle"}, "there is no signal throttle; there are input"),
        ([], {}, r"times of shape \(0,\) cannot be used"),
        ([1.0, math.nan], {}, "give a list of finite times in s"),
        ([1.0], {"tolerance": 0.0}, r"tolerance = 0 \(relative\) is outside 0 to 1"),
    ],
)
def test_what_is_refused(times: list[float], options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        step_response(rational([1.0], [1.0, 1.0]), times, **({"input_name": "input"} | options))  # type: ignore[arg-type]  # wrong on purpose


@pytest.mark.parametrize("until", [0.0, -1.0, math.inf, math.nan])
def test_records_without_length_are_refused(until: float) -> None:
    with pytest.raises(InvalidInputError, match=r"end of the record = .* s is outside 0 to infinity"):
        time_response.sample_times(until, 10)


def test_answers_out_of_bounds_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidInputError, match=r"the response exceeds the range of numbers after 7\d\d\.?\d* s; ask for earlier times"):
        step_response(rational([1.0], [-1.0, 1.0]), [1000.0], input_name="input")
    with pytest.raises(InvalidInputError, match=r"a record of 1\.0001 s needs more than 100000 pieces, lags being as short as 1e-06 s"):
        step_response(feedback(rational([1.0], [0.0, 1.0]), rational([1.0], delay=1e-6)), [1.0], input_name="input")
    monkeypatch.setattr(time_response, "ROUGH", Scheme(degree=3, longest=0.5))
    with pytest.raises(NotConvergedError, match=r"two computations of output differ by 0\.\d+ \(limit 9.*e-11\) within 1 s"):
        step_response(rational([1.0], [1.0, 0.3]), [1.0], input_name="input")
