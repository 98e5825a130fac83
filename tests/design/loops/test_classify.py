import functools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from revline.design.loops.classify import Criteria, classify_outcome
from revline.design.loops.outcome import Diverged, LimitCycle, Settled
from revline.errors import InvalidInputError, NotSettledError

TIMES = np.arange(0.0, 20.0, 0.002)


def van_der_pol_rate(_: float, x: np.ndarray, stiffness: float) -> list[float]:
    return [x[1], stiffness * (1.0 - x[0] ** 2) * x[1] - x[0]]


@functools.cache
def van_der_pol(stiffness: float, until: float, samples: int, start: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    times = np.linspace(0.0, until, samples)

    rate = functools.partial(van_der_pol_rate, stiffness=stiffness)
    solution = solve_ivp(rate, (0.0, until), [start, 0.0], method="DOP853", rtol=1e-11, atol=1e-12, t_eval=times)
    return times, solution.y[0]


def exact_cycle(stiffness: float) -> tuple[float, float]:
    """Period and amplitude from the solver's own event search, after the transient."""

    def turning(_: float, x: np.ndarray) -> float:
        return float(x[1])

    turning.direction = -1  # type: ignore[attr-defined] # how solve_ivp is told which turning points count
    rate = functools.partial(van_der_pol_rate, stiffness=stiffness)
    solution = solve_ivp(rate, (0.0, 200.0), [2.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12, events=turning)
    return float(np.diff(solution.t_events[0])[-1]), float(solution.y_events[0][-1][0])


@pytest.mark.parametrize("stiffness", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("samples", [8001, 16000])
def test_van_der_pol_ends_in_its_limit_cycle(stiffness: float, samples: int) -> None:
    cycle = classify_outcome(*van_der_pol(stiffness, 200.0, samples), target=0.0, command=1.0)
    period, amplitude = exact_cycle(stiffness)
    assert isinstance(cycle, LimitCycle)
    assert cycle.period == pytest.approx(period, rel=1e-6)
    assert cycle.high == pytest.approx(amplitude, rel=1e-6)
    assert cycle.low == pytest.approx(-amplitude, rel=1e-6)
    assert cycle.amplitude == pytest.approx(amplitude, rel=1e-6)
    assert cycle.swings == 1
    assert cycle.cycles >= 5
    assert max(cycle.low_spread, cycle.high_spread, cycle.period_spread) < 1e-4
    assert abs(cycle.drift) < 1e-5


@pytest.mark.reference
def test_van_der_pol_has_its_published_period() -> None:
    """At mu = 1: 6.6633. Andersen and Geer (1982), SIAM Journal on Applied Mathematics 42(3), 678-693."""
    cycle = classify_outcome(*van_der_pol(1.0, 200.0, 8001), target=0.0, command=1.0)
    assert isinstance(cycle, LimitCycle)
    assert cycle.period == pytest.approx(6.6633, abs=5e-5)
    assert cycle.amplitude == pytest.approx(2.0086, abs=5e-5)


def test_a_cycle_that_is_being_approached_slowly_is_not_called_reached() -> None:
    """Van der Pol with mu = 0.01 grows towards amplitude 2 as 2 / sqrt(1 + c exp(-mu t)): far from it after 200 s."""
    with pytest.raises(NotSettledError, match=r"still grows|tends to"):
        classify_outcome(*van_der_pol(0.01, 200.0, 8001), target=0.0, command=1.0)


def test_a_cycle_being_approached_from_outside_is_named_with_its_limit() -> None:
    times, values = van_der_pol(0.05, 70.0, 7001, start=4.0)
    with pytest.raises(NotSettledError, match=r"tends to 4\.0.*a limit cycle that is not reached yet"):
        classify_outcome(times, values, target=0.0, command=1.0)


@given(
    frequency=st.floats(5.0, 60.0),
    phase=st.floats(0.0, 2.0 * math.pi),
    amplitude=st.floats(0.01, 100.0),
    mean=st.floats(-300.0, 300.0),
)
def test_a_pure_sine_is_a_limit_cycle(frequency: float, phase: float, amplitude: float, mean: float) -> None:
    values = mean + amplitude * np.sin(frequency * TIMES + phase)
    cycle = classify_outcome(TIMES, values, target=mean, command=amplitude)
    assert isinstance(cycle, LimitCycle)
    assert cycle.period == pytest.approx(2.0 * math.pi / frequency, rel=1e-6)
    assert cycle.high == pytest.approx(mean + amplitude, abs=1e-6 * amplitude + 1e-9)
    assert cycle.low == pytest.approx(mean - amplitude, abs=1e-6 * amplitude + 1e-9)


@given(frequency=st.floats(10.0, 60.0), decay=st.sampled_from([1e-5, 1e-4, 1e-3, 1e-2, 5e-2]), sign=st.sampled_from([-1.0, 1.0]))
def test_a_slow_decay_or_growth_is_never_a_limit_cycle(frequency: float, decay: float, sign: float) -> None:
    """The decay per cycle lies far below the criterion of equal cycles (1e-3), so only the trend tells."""
    rate = sign * decay * frequency / (2.0 * math.pi)
    values = np.exp(-rate * TIMES) * np.sin(frequency * TIMES)
    with pytest.raises(NotSettledError, match="decays by" if sign > 0.0 else "still grows by") as caught:
        classify_outcome(TIMES, values, target=0.0, command=1.0, criteria=Criteria(bound=1e9))
    assert caught.value.details["growth_per_cycle"] == pytest.approx(-sign * decay, rel=0.02)


def test_time_to_rest_of_a_decaying_oscillation_is_extrapolated() -> None:
    values = np.exp(-0.1 * TIMES) * np.cos(10.0 * TIMES)
    with pytest.raises(NotSettledError, match="comes to rest about 69") as caught:
        classify_outcome(TIMES, values, target=0.0, command=1.0)
    needed = float(caught.value.details["needed"])
    assert needed == pytest.approx(1.5 * math.log(1e3) / 0.1, rel=0.03)
    longer = np.arange(0.0, needed, 0.01)
    assert isinstance(classify_outcome(longer, np.exp(-0.1 * longer) * np.cos(10.0 * longer), target=0.0, command=1.0), Settled)


def test_a_growing_oscillation_diverges_when_it_passes_the_bound() -> None:
    values = 60.0 * (1.0 - np.exp(0.5 * TIMES) * np.cos(12.0 * TIMES))
    outcome = classify_outcome(TIMES, values, target=60.0, command=60.0)
    assert isinstance(outcome, Diverged)
    assert outcome.bound == 600.0
    first = np.argmax(np.abs(values - 60.0) > 600.0)
    assert (outcome.time, outcome.value) == (TIMES[first], values[first])


@pytest.mark.parametrize("value", [0.0, 300.0])
def test_a_constant_is_settled(value: float) -> None:
    outcome = classify_outcome(TIMES, np.full_like(TIMES, value), target=value + 0.5, command=60.0)
    assert isinstance(outcome, Settled)
    assert (outcome.value, outcome.steady_error, outcome.residual) == (value, 0.5, 0.0)


def test_a_damped_response_is_settled() -> None:
    values = 60.0 * (1.0 - np.exp(-3.0 * TIMES) * np.cos(8.0 * TIMES))
    outcome = classify_outcome(TIMES, values, target=60.0, command=60.0)
    assert isinstance(outcome, Settled)
    assert outcome.steady_error == pytest.approx(0.0, abs=1e-6)


def test_a_subharmonic_cycle_is_found_whole() -> None:
    """Every second swing is smaller: the period is two swings long."""
    values = np.sin(20.0 * TIMES) + 0.2 * np.sin(10.0 * TIMES)
    cycle = classify_outcome(TIMES, values, target=0.0, command=1.0)
    assert isinstance(cycle, LimitCycle)
    assert cycle.swings == 2
    assert cycle.period == pytest.approx(2.0 * math.pi / 10.0, rel=1e-6)


def test_incommensurate_oscillations_do_not_repeat() -> None:
    values = np.sin(20.0 * TIMES) + 0.3 * np.sin(20.0 * math.sqrt(0.3) * TIMES)
    with pytest.raises(NotSettledError, match=r"cycles do not repeat within the criterion; simulate longer than 19.998 s"):
        classify_outcome(TIMES, values, target=0.0, command=1.0)


def test_coarse_sampling_is_no_decay() -> None:
    """Negative control of the trend: 20.013 samples per cycle let the reading drift, the sine does not."""
    times = np.arange(4000) * 0.05
    cycle = classify_outcome(times, np.sin(2.0 * math.pi / (20.013 * 0.05) * times), target=0.0, command=1.0)
    assert isinstance(cycle, LimitCycle)
    assert cycle.high == pytest.approx(1.0, abs=1e-5)


def test_a_record_with_few_cycles_decides_nothing() -> None:
    times = np.linspace(0.0, 4.0, 2001)
    with pytest.raises(
        NotSettledError, match=r"record of 4 s is neither at rest .* nor holds 5 cycles \(it has 3\).*simulate about 18"
    ) as caught:
        classify_outcome(times, np.sin(2.0 * math.pi * times - 0.3), target=0.0, command=1.0)
    longer = np.linspace(0.0, float(caught.value.details["needed"]), 9001)
    assert isinstance(classify_outcome(longer, np.sin(2.0 * math.pi * longer - 0.3), target=0.0, command=1.0), LimitCycle)


def test_a_creeping_record_decides_nothing() -> None:
    with pytest.raises(NotSettledError, match=r"neither at rest at its end nor holds 5 cycles \(it has 0\)"):
        classify_outcome(TIMES, -np.expm1(-TIMES / 50.0), target=1.0, command=1.0)


@pytest.mark.parametrize(("target", "command"), [(math.nan, 1.0), (1.0, math.inf), (1.0, 0.0)])
def test_an_unusable_command_is_refused(target: float, command: float) -> None:
    with pytest.raises(InvalidInputError, match="an outcome cannot be judged against target"):
        classify_outcome(TIMES, TIMES, target=target, command=command)


@pytest.mark.parametrize(
    ("criterion", "message"),
    [
        ({"rest": 0.0}, "criterion rest = 0 is not between 0 and 0.5; the default is 0.001"),
        ({"repeat": 0.2}, "criterion repeat = 0.2 is not between 0 and 0.1"),
        ({"bound": 1.0}, "criterion bound = 1 is not between 1 and inf"),
        ({"tail": 1.0}, "criterion tail = 1 is not between 0 and 1"),
        ({"min_cycles": 2}, "criterion min_cycles = 2 is not between 2 and 61"),
    ],
)
def test_a_criterion_out_of_range_is_refused(criterion: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Criteria(**criterion)
