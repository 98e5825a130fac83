"""Orders of convergence on problems with known solutions, two-sided, with negative controls that must fail.

Errors are the largest over all samples; orders are least-squares slopes over many step sizes, fine enough that the short steps
next to breakpoints, which make coarse meshes better than their step, no longer count.
"""

import numpy as np
import pytest

from revline import signals
from revline.dde.kernel import Interpolant, Method, Propagation
from revline.dde.tableau import HEUN
from tests.dde.probe import Floats, Probe, Problem, observed_order, solve_by_steps, solve_forced, truth

HEUN_METHOD = Method(tableau=HEUN)
LINEAR = Method(interpolant=Interpolant.LINEAR)
UNMET = Method(propagation=Propagation.NONE)

COUNTS = tuple(2 * round(count / 2) for count in np.geomspace(200, 2000, 16))
"""Numbers of steps, even ones so that the middle of the time is a grid point."""

VARYING = Probe(decay=3.0, feed=2.0, lag=0.9, lag_clock=0.8)
UNTIL = 4.1


def forced(parameters: Probe, **given: signals.Signal) -> Problem:
    return Problem(parameters, UNTIL, solve_forced(parameters, UNTIL, **given), signals=given)


def delayed_twice(parameters: Probe, frequency: float) -> Problem:
    """A sine through two channels in a row, the second with a lag that reads a third; x follows the truth."""

    def solution(times: Floats) -> Floats:
        def back(t: Floats) -> Floats:
            return t - parameters.lag - parameters.lag_state * truth(t)

        once = times - parameters.second_lag - parameters.second_lag_read * truth(back(times))
        twice = back(once)
        return np.where((once > 0.0) & (twice > 0.0), np.sin(frequency * twice), 0.0)

    return Problem(parameters, 6.3, solution, x0=1.0, signals={"u": signals.sine(1.0, frequency)}, output="u_older")


SMOOTH_PROBLEMS = {
    "constant lag": Problem(Probe(feedback=-1.0, lag=1.0), 7.3, solve_by_steps(-1.0, 1.0), x0=1.0),
    "another constant lag": Problem(Probe(feedback=-1.5, lag=0.37), UNTIL, solve_by_steps(-1.5, 0.37), x0=1.0),
    "lag of the state": Problem(
        Probe(feedback=-0.8, decay=0.3, source=1.0, lag=0.5, lag_state=0.3),
        6.3,
        truth,
        x0=1.0,
    ),
    "delay after a delay, its lag read from a third": delayed_twice(
        Probe(feedback=-0.8, decay=0.3, source=1.0, lag=0.5, lag_state=0.3, second_lag=0.6, second_lag_read=0.2), 2.0
    ),
}
JUMPS = {
    "jump": forced(VARYING, u=signals.step(1.0, start=0.3137)),
    "jump on a grid point": forced(VARYING, u=signals.step(1.0, start=0.5 * UNTIL)),
    "jumps, some closer than a step": forced(
        VARYING,
        u=signals.step(1.0, start=0.3137)
        + signals.step(-2.0, start=0.7411)
        + signals.step(1.5, start=0.7423)
        + signals.step(0.3, start=1.9),
    ),
    "jumps much closer than a step": forced(VARYING, u=signals.step(1.0, start=0.3137) + signals.step(-2.0, start=0.31370002)),
    "pulses": forced(VARYING, u=signals.pulse_cycle(1.0, 0.9)),
}
PROBLEMS = {
    **SMOOTH_PROBLEMS,
    **JUMPS,
    "jump at the start": forced(VARYING, u=signals.step(1.0)),
    "ramp": forced(VARYING, u=signals.step(1.0, start=0.3137, rise=0.4567)),
    "trapezoids": forced(VARYING, u=signals.trapezoid_cycle(1.0, 0.41)),
    "recording": forced(
        VARYING, u=signals.recorded(np.array([0.11, 0.4, 0.55, 1.3, 1.77, 2.9]), np.array([0.0, 1.0, -0.4, 0.3, 2.0, 0.1]))
    ),
    "two inputs that jump at once": forced(
        VARYING._replace(direct=1.0), u=signals.step(1.0, start=0.3137), shift=signals.step(-0.5, start=0.3137)
    ),
    "a jump when an earlier one arrives": forced(
        Probe(decay=3.0, feed=2.0, direct=1.0, lag=0.7), u=signals.step(1.0, start=0.3137) + signals.step(1.0, start=0.3137 + 0.7)
    ),
    "a jump just after an earlier one arrives": forced(
        Probe(decay=3.0, feed=2.0, direct=1.0, lag=0.7), u=signals.step(1.0, start=0.3137) + signals.step(1.0, start=0.3137 + 0.7 + 1e-9)
    ),
}


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS.keys())
def test_the_standard_method_has_order_four(problem: Problem) -> None:
    assert observed_order(problem, COUNTS) == pytest.approx(4.0, abs=0.15)


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS.keys())
def test_heuns_method_has_order_two(problem: Problem) -> None:
    assert observed_order(problem, COUNTS, HEUN_METHOD) == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("problem", SMOOTH_PROBLEMS.values(), ids=SMOOTH_PROBLEMS.keys())
def test_linear_history_loses_the_order(problem: Problem) -> None:
    """Negative control: were this of order 4, the test above would prove nothing about how history is read."""
    assert observed_order(problem, COUNTS, LINEAR) < 2.5


@pytest.mark.parametrize("problem", JUMPS.values(), ids=JUMPS.keys())
def test_breakpoints_that_are_not_met_lose_the_order(problem: Problem) -> None:
    """Negative control: were this of order 4, the test above would prove nothing about breakpoints."""
    assert observed_order(problem, COUNTS, UNMET) < 2.5
