"""The exact linear model's step, its delays exact, is the nonlinear engine's for a vanishing step."""

import numpy as np
import pytest

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.dde.simulate import Options, Start, simulate
from revline.engine.lee1995 import lee1995
from revline.lti.time_response import step_response
from revline.signals import step


def simulated(angle: float, size: float) -> np.ndarray:
    """Speed after a throttle step, half the difference of both directions: what is even in the step falls out."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": angle})
    start = Start(states=trim.states, inputs=trim.inputs)
    up, down = (
        simulate(engine, start, {"throttle": step(sign * size)}, until=2.0, step=5e-4, options=Options(every=200)) for sign in (1.0, -1.0)
    )
    return np.asarray((up.outputs[:, 0] - down.outputs[:, 0]) / (2.0 * size))


@pytest.mark.parametrize("angle", [12.0, 25.0])
def test_a_vanishing_step_is_the_linear_one(angle: float) -> None:
    engine = lee1995()
    model = linearize(engine, find_trim(engine, inputs={"throttle": angle})).model
    linear = step_response(model, np.linspace(0.0, 2.0, 21), input_name="throttle")
    exact = linear.output("engine_speed")
    fine, coarse = (float(np.max(np.abs(simulated(angle, size) - exact))) for size in (0.01, 0.1))
    assert fine < 2e-6 * np.max(exact)
    assert 50.0 < coarse / fine < 200.0
