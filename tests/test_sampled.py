import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from revline.design.controllers.pid_controller import PidController
from revline.design.controllers.pid_update import sampled_pid
from revline.errors import InvalidInputError
from revline.sampled import CrankSynchronous, FixedRate, SampledController
from tests.design.examples import C2D


def decides(_: Any, xd: Any, y: Any, *__: Any) -> Any:
    return xd if y[0] > 0.0 else y


def calls_exp(_: Any, __: Any, y: Any, *___: Any) -> Any:
    return (np.exp(y[0]),)


def squares(_: Any, __: Any, y: Any, *___: Any) -> Any:
    return (y[0] ** 2.0,)


def controller() -> SampledController:
    return sampled_pid(PidController(gains=C2D, sampling=FixedRate(period=0.01)), output=25.0, measurement=240.0)


def test_a_sampling_period_is_that_of_the_timer_or_of_the_crank() -> None:
    assert FixedRate(period=0.01).period_at(100.0) == FixedRate(period=0.01).period_at(500.0) == 0.01
    assert CrankSynchronous(angle=math.pi).period_at(200.0) == pytest.approx(math.pi / 200.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FixedRate(period=0.0), r"sampling period = 0 s is outside the positive numbers; give one such as 0.01"),
        (lambda: FixedRate(period=math.nan), r"sampling period = nan s"),
        (
            lambda: FixedRate(period=0.01, computation_delay=0.01),
            r"computation delay = 0.01 s is outside 0 to below the sampling period of 0.01",
        ),
        (lambda: FixedRate(period=0.01, computation_delay=-1.0), r"computation delay = -1 s is outside 0 and above"),
        (lambda: CrankSynchronous(angle=-1.0), r"sampling angle = -1 rad is outside the positive numbers"),
        (lambda: CrankSynchronous(angle=1.0).period_at(0.0), r"speed = 0 rad/s is outside the positive numbers; an engine at rest"),
        (lambda: CrankSynchronous(angle=1.0, computation_delay=0.1).period_at(20.0), r"0.05 s at 20 rad/s; sample at a larger angle"),
    ],
)
def test_sampling_that_cannot_be_is_refused(make: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        make()


def test_equal_controllers_have_equal_digests_and_others_do_not() -> None:
    first, second = controller(), controller()
    assert first.content_digest == second.content_digest
    other = replace(first, parameters=first.parameters._replace(kp=2.0))
    assert other.content_digest != first.content_digest
    assert other.equation_digest == first.equation_digest


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drives": 0}, "pid: 0 of 6 outputs drive a system and 1 signals are measured; a controller needs at least one of each"),
        ({"states": ()}, "pid: update returns 13 results where 6 signals are named|fails with its parameters"),
        ({"outputs": controller().outputs[:2]}, "pid: update returns 13 results where 9 signals are named"),
        ({"update": decides}, "decides on a value"),
        (
            {"update": calls_exp},
            r"numpy\.exp, which not every computer rounds alike; use one of add, .* subtract",
        ),
        ({"update": squares}, "raises to a power, which not every computer rounds alike; write the product"),
    ],
)
def test_a_controller_that_does_not_fit_its_signals_is_refused(changes: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        replace(controller(), **changes)


def test_other_parameters_make_another_controller_of_the_same_equations() -> None:
    first = controller()
    assert first.content_digest
    other = first.with_parameters(first.parameters._replace(kp=2.0))
    assert (other.parameters.kp, first.parameters.kp) == (2.0, 1.2)
    assert other.equation_digest == first.equation_digest
    assert other.content_digest != first.content_digest
    with pytest.raises(InvalidInputError, match="pid has PidCode, not tuple, for parameters; give those"):
        first.with_parameters((1.0,))
