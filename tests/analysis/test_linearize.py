"""Exact linearisation: derivatives, lags by their value alone, kinks, and the engine's published small-signal numbers."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.analysis.jacobians import evaluate, settle_channels
from revline.analysis.linearize import Kink, linearize, linearize_each, rate_unit, search_scale
from revline.analysis.trim import find_trim
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Floats, Variable


@dataclass(frozen=True)
class Point:
    states: Floats
    inputs: Floats
    channels: Floats


def at(*values: tuple[float, ...]) -> Point:
    return Point(*(np.array(v) for v in values))


def test_linear_system_gives_back_its_coefficients(linear: DelaySystem) -> None:
    found = linearize(linear, at((0.0,), (0.0,), (0.0,)))
    model = found.model
    blocks = (model.A, model.Bu, model.Bz, model.Cy, model.Dyu, model.Dyz, model.Cz, model.Dzu, model.Dzz)
    assert [float(block[0, 0]) for block in blocks] == [-0.5, 1.0, -1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    assert model.lags == 1.0
    assert found.kinks == ()
    assert [s.name for s in model.states + model.inputs + model.outputs + model.channels] == ["position", "force", "position", "echo"]
    assert model.states[0].unit == "m"


@pytest.mark.parametrize("rate", [0.3, -0.7])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.3, -0.8)])
def test_lags_contribute_their_value_alone(engine: DelaySystem, rate: float, direction: tuple[float, float]) -> None:
    """Put a history x0 + eps v exp(rate t) into the nonlinear equations, lags moving with it: the derivative is the linear model's."""
    trim = find_trim(engine, inputs={"throttle": 25.0})
    model = linearize(engine, trim).model
    v = np.array(direction)

    def exact(eps: complex) -> Floats:
        now = trim.states + eps * v
        lags = evaluate(engine, engine.lags, now, trim.inputs, trim.channels)
        old = trim.states + eps * v * np.exp(-rate * lags[..., None])
        readings = np.diagonal(evaluate(engine, engine.emit, old, trim.inputs, trim.channels))
        return evaluate(engine, engine.rate, now, trim.inputs, readings)

    linear_rates = model.A @ v + model.Bz @ (np.exp(-rate * model.lags) * (model.Cz @ v))
    assert exact(1e-30j).imag / 1e-30 == pytest.approx(linear_rates, rel=1e-12)


def test_lag_value_matters(engine: DelaySystem) -> None:
    """Negative control of the test above: another lag is another model."""
    trim = find_trim(engine, inputs={"throttle": 25.0})
    model = linearize(engine, trim).model
    other = replace(model, lags=1.01 * model.lags)
    assert abs(other.transfer(20j)[0, 0] - model.transfer(20j)[0, 0]) > 1e-3 * abs(model.transfer(20j)[0, 0])


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
@settings(max_examples=30)
def test_derivatives_are_exact_to_rounding(position: float, gain: float) -> None:
    class Gain(NamedTuple):
        gain: float

    def rate(p: Gain, x: tuple[float], u: tuple[float], zd: tuple[()]) -> tuple[float]:  # noqa: ARG001 - the form of all equations
        return (np.exp(p.gain * np.sin(x[0])) - u[0],)

    def none(p: Gain, x: tuple[float], u: tuple[float], zd: tuple[()]) -> tuple[()]:  # noqa: ARG001 - the form of all equations
        return ()

    state, force = Variable(name="a", unit="m"), Variable(name="b", unit="m/s")
    system = DelaySystem(
        name="s",
        parameters=Gain(gain),
        states=(state,),
        inputs=(force,),
        channels=(),
        outputs=(),
        emit=none,
        lags=none,
        rate=rate,
        output=none,
    )
    value = float(np.exp(gain * np.sin(position)))
    model = linearize(system, at((position,), (value,), ())).model
    assert model.A[0, 0] == pytest.approx(gain * np.cos(position) * value, rel=1e-14, abs=1e-250)
    assert model.Bu[0, 0] == -1.0


def test_chained_channels_linearise(chain: DelaySystem) -> None:
    model = linearize(chain, find_trim(chain)).model
    assert model.Cz.tolist() == [[2.0], [0.0]]
    assert model.Dzz.tolist() == [[0.0, 0.0], [2.0, 0.0]]
    assert model.lags == pytest.approx([1.1, 0.5])


def test_active_limit_is_named(kinked: DelaySystem) -> None:
    found = linearize(kinked, at((0.5,), (2.0,), (0.5,)))
    assert [str(kink) for kink in found.kinks] == ["rate of position does not answer to force here: a limit is active"]
    assert found.model.Bu[0, 0] == 0.0


def test_kink_is_named_with_both_slopes(kinked: DelaySystem) -> None:
    (kink,) = linearize(kinked, at((0.0,), (0.0,), (0.0,))).kinks
    assert (kink.result, kink.argument) == ("rate of position", "reading of echo")
    assert (kink.below, kink.above) == pytest.approx((-1.0, -2.0), rel=1e-4)
    assert str(kink).startswith("rate of position has a kink in reading of echo here: slope -0.99999")
    assert kink.used in (-1.0, -2.0)


def test_limit_just_reached_is_a_kink(kinked: DelaySystem) -> None:
    kinks = linearize(kinked, at((0.5,), (1.0,), (0.5,))).kinks
    assert [(k.argument, round(k.below, 6), k.above) for k in kinks] == [("force", 1.0, 0.0)]


def test_smooth_extremum_is_no_kink(engine: DelaySystem) -> None:
    """At best-torque spark the spark influence is flat, by its smooth shape and not by a limit."""
    trim = find_trim(engine, inputs={"throttle": 25.0, "spark": 0.0})
    assert linearize(engine, trim).kinks == ()


def test_wide_open_throttle_is_an_active_limit(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 85.0})
    kinks = linearize(engine, trim).kinks
    assert {(k.result, k.argument) for k in kinks} == {("rate of manifold_pressure", "throttle"), ("output throttle_air_rate", "throttle")}


def test_many_points_at_once_give_what_each_gives(engine: DelaySystem) -> None:
    trims = [find_trim(engine, inputs={"throttle": angle}) for angle in (12.0, 25.0, 85.0)]
    together = linearize_each(engine, trims)
    assert linearize_each(engine, ()) == ()
    for found, alone in zip(together, (linearize(engine, trim) for trim in trims), strict=True):
        for block in ("A", "Bu", "Bz", "Cy", "Dyu", "Dyz", "Cz", "Dzu", "Dzz", "lags"):
            assert np.array_equal(getattr(found.model, block), getattr(alone.model, block))
        assert found.kinks == alone.kinks
    assert [len(found.kinks) for found in together] == [0, 0, 2]


def test_one_of_many_points_that_drifts_is_refused(linear: DelaySystem) -> None:
    rest, drifting = at((0.0,), (0.0,), (0.0,)), at((1.0,), (0.0,), (1.0,))
    with pytest.raises(InvalidInputError, match="position drifts"):
        linearize_each(linear, (rest, drifting))


def test_kink_is_a_value() -> None:
    first = Kink(result="a", argument="b", below=0.0, above=1.0, used=1.0)
    assert first == replace(first)


def test_point_that_drifts_is_refused(linear: DelaySystem) -> None:
    with pytest.raises(
        InvalidInputError, match=r"no steady state: position drifts by -1.5 m/s \(limit 2e-07 m/s\); find one with find_trim"
    ):
        linearize(linear, at((1.0,), (0.0,), (1.0,)))


def test_point_with_a_channel_not_at_rest_is_refused(chain: DelaySystem) -> None:
    with pytest.raises(InvalidInputError, match=r"channel first reads 2 m where 1 m enters"):
        linearize(chain, at((1.0,), (0.0,), (2.0, 2.0)))


def test_point_of_another_system_is_refused(linear: DelaySystem) -> None:
    with pytest.raises(InvalidInputError, match=r"the point has 2 states where linear has 1"):
        linearize(linear, at((1.0, 2.0), (0.0,), (1.0,)))


def test_point_without_derivative_is_refused(linear: DelaySystem) -> None:
    def vast(p: object, x: tuple[float], u: tuple[float], zd: tuple[float]) -> tuple[float]:  # noqa: ARG001 - the form of all equations
        return (np.exp(1000.0 + x[0]),)

    with pytest.raises(InvalidInputError, match=r"the output position has no finite derivative by position at .*\((nan|inf)\)"):
        linearize(replace(linear, output=vast), at((0.0,), (0.0,), (0.0,)))


@pytest.mark.parametrize(("lag", "words"), [(-1.0, "-1"), (0.0, "0"), (math.inf, "inf"), (math.nan, "nan")])
def test_a_lag_that_is_none_is_refused(linear: DelaySystem, lag: float, words: str) -> None:
    def lags(p: object, x: tuple[float], u: tuple[float], zd: tuple[float]) -> tuple[float]:  # noqa: ARG001 - the form of all equations
        return (lag + 0.0 * x[0],)

    with pytest.raises(
        InvalidInputError, match=rf"lag of echo = {words} s is outside 0 to infinity, without the ends; give a positive lag"
    ):
        linearize(replace(linear, lags=lags), at((0.0,), (0.0,), (0.0,)))


def test_units_of_rates_and_ranges() -> None:
    assert rate_unit(Variable(name="a", unit="rad/s")) == "rad/s2"
    assert rate_unit(Variable(name="a", unit="kPa")) == "kPa/s"
    assert search_scale(Variable(name="a", unit="1", search_low=1.0, search_high=4.0, low=0.0, high=9.0)) == 3.0
    assert search_scale(Variable(name="a", unit="1", low=0.0, high=9.0)) == 9.0
    assert search_scale(Variable(name="a", unit="1", nominal=-7.0)) == 7.0


def test_channel_loop_settles_at_its_solution(loop: DelaySystem) -> None:
    x = np.array([[0.3], [2.0], [-4.0]])
    z = settle_channels(loop, x, np.zeros((3, 1)))
    assert z == pytest.approx(x + 0.5 * np.sin(z), abs=1e-13)


def test_channel_loop_without_solution_gives_no_number(loop: DelaySystem) -> None:
    """z = x + z + u has no solution but at x = -u."""

    def emit(p: object, x: tuple[float], u: tuple[float], zd: tuple[float]) -> tuple[float]:  # noqa: ARG001 - the form of all equations
        return (x[0] + zd[0] + u[0],)

    z = settle_channels(replace(loop, emit=emit), np.array([[1.0]]), np.zeros((1, 1)))
    assert np.all(np.isnan(z))


@pytest.mark.reference
def test_small_signal_response_against_amplitude_five(engine: DelaySystem) -> None:
    """The 5 deg response by harmonic balance (Lee, 1995, chapter 4, recomputed): the exact one exceeds it by the stated percents."""
    model = linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model
    assert model.static_gain("throttle", "engine_speed") == pytest.approx(12.02944, abs=1e-5)
    omega = np.array([0.1, 1.0, 5.0, 10.0, 20.0, 50.0, 100.0])
    finite = np.array([60.0056, 54.0116, 22.0666, 10.8232, 4.4082, 0.9495, 0.2535])
    phase = np.array([-3.164, -29.874, -87.620, -116.793, -153.450, -218.974, -295.286])
    response = model.response(omega, "throttle", "engine_speed")
    excess = 100.0 * (5.0 * response.magnitude / finite - 1.0)
    assert excess[:3] == pytest.approx([0.12, 0.17, 1.4], abs=0.005 + 0.0)
    assert excess[4] == pytest.approx(0.94, abs=0.005)
    assert abs(excess[6]) < 0.1
    difference = response.phase_deg - phase
    assert np.all(np.abs(difference[:4]) < 0.345)
    assert difference[6] == pytest.approx(-1.71, abs=0.005)
    assert (response.input_unit, response.output_unit, response.method) == ("deg", "rad/s", "exact")


@pytest.mark.reference
def test_most_excess_lies_at_seven_to_eight(engine: DelaySystem) -> None:
    """Small-signal gain at 7 and 8 rad/s, 16.1635 and 14.0581 for 5 deg: recomputed from Lee (1995), chapter 2, at 25 deg."""
    model = linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model
    assert 5.0 * model.response([7.0, 8.0], "throttle", "engine_speed").magnitude == pytest.approx([16.1635, 14.0581], abs=1e-4)
