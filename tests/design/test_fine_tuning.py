"""Fine tuning keeps its limit, is best within it, and says what it minimised."""

import pytest

from revline.design.closed_loop import LoopTask, trace_linear_loop
from revline.design.controller import PidGains
from revline.design.fine_tuning import Objective, fine_tune
from revline.design.step_measures import measure_overshoot
from revline.errors import InvalidInputError, NotConvergedError
from revline.lti.transfer_function import TransferFunction

G2 = TransferFunction(numerator=(12.0066,), denominator=(1.0, 0.55159, 0.034396), input_unit="deg", output_unit="rad/s")
START = PidGains(kp=20.0, ki=250.0, kd=0.4, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="g2")


def overshoot(gains: PidGains) -> float:
    trace = trace_linear_loop(G2, gains, LoopTask(command=1.0, until=4.0, step=5e-4))
    return measure_overshoot(trace.times, trace.output, start=0.0, target=1.0, command=1.0)


def test_the_largest_integral_gain_within_the_limit_is_found() -> None:
    """The start is outside of the limit; just above the result the limit is passed, seen by a record seven times as fine."""
    tuned = fine_tune(G2, START, overshoot_limit=0.1, objective=Objective.LOAD_ERROR)
    assert overshoot(START) > 0.15
    assert overshoot(tuned.gains) == pytest.approx(0.1, abs=2e-4)
    assert overshoot(tuned.gains) <= 0.1 + 1e-6
    assert overshoot(tuned.gains.scaled(ki=1.01)) > 0.1
    assert (tuned.gains.kp, tuned.gains.kd) == (20.0, 0.4)
    assert tuned.value == pytest.approx(1.0 / tuned.gains.ki, rel=1e-12)
    assert tuned.start_value == pytest.approx(1.0 / 250.0, rel=1e-12)
    assert "(1/ki) over ki with overshoot at most 10 %" in tuned.text


def test_more_free_gains_are_never_worse() -> None:
    start = START.scaled(ki=0.2)
    one = fine_tune(G2, start, overshoot_limit=0.05)
    two = fine_tune(G2, start, overshoot_limit=0.05, free=("kp", "ki"))
    assert two.value < one.value <= one.start_value
    assert max(one.overshoot, two.overshoot) <= 0.05


@pytest.mark.parametrize("limit", [0.0, 1.0, float("nan")])
def test_a_limit_out_of_range_is_refused(limit: float) -> None:
    with pytest.raises(InvalidInputError, match="overshoot limit"):
        fine_tune(G2, START, overshoot_limit=limit)


@pytest.mark.parametrize("name", ["kq", "kd"])
def test_a_gain_that_cannot_move_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=f"gain {name} cannot be tuned"):
        fine_tune(G2, START.scaled(kd=0.0), overshoot_limit=0.1, free=(name,))


def test_a_limit_that_no_gain_keeps_is_an_error() -> None:
    """A double integrator under proportional and integral action is unstable at any gains."""
    double = TransferFunction(numerator=(1.0,), denominator=(0.0, 0.0, 1.0), input_unit="deg", output_unit="rad/s")
    with pytest.raises(NotConvergedError, match=r"no gains between a hundredth .* below 10 %"):
        fine_tune(double, START.scaled(kd=0.0), overshoot_limit=0.1)
