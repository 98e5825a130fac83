from typing import NamedTuple

import numpy as np
import pytest

from revline.analysis.exact_response import find_exact_response
from revline.analysis.trim import find_trim
from revline.engine.lee1995 import lee1995
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Variable
from revline.units import DEGREE

Vector = tuple[float, ...]
SIGNALS = {"input_name": "throttle", "output_name": "engine_speed"}


def test_a_coarse_grid_has_the_turns_of_a_fine_one() -> None:
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    fine = find_exact_response(engine, trim, np.geomspace(0.01, 200.0, 400), **SIGNALS)
    unwrapped = np.unwrap(np.angle(fine.values)) / DEGREE
    assert unwrapped[-1] < -360.0
    coarse = find_exact_response(engine, trim, fine.omega[[0, 300, 399]], **SIGNALS)
    assert fine.phase_deg == pytest.approx(unwrapped, abs=1e-9)
    assert coarse.phase_deg == pytest.approx(unwrapped[[0, 300, 399]], abs=1e-9)
    assert coarse.method == "exact"


def test_frequencies_that_cannot_be_used_are_refused() -> None:
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    with pytest.raises(InvalidInputError, match="frequency = 0 rad/s is outside values above 0; ask for the gain at rest instead"):
        find_exact_response(engine, trim, [0.0, 1.0], **SIGNALS)


class Chain(NamedTuple):
    """Four lags of 1 s, one after the other, and a short delay."""

    delay: float


@equation
def emit(p: Chain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 * x[3],)


@equation
def lags(p: Chain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.delay,)


@equation
def rate(p: Chain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return u[0] - x[0], x[0] - x[1], x[1] - x[2], x[2] - x[3]


@equation
def output(p: Chain, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (1.0 * zd[0],)


def test_a_phase_that_its_own_values_cannot_tell_has_its_turns() -> None:
    states = tuple(Variable(name=f"x{k}", unit="1") for k in range(4))
    one = (Variable(name="u", unit="1"),)
    chain = DelaySystem(
        name="chain",
        parameters=Chain(0.001),
        states=states,
        inputs=one,
        channels=one,
        outputs=one,
        emit=emit,
        lags=lags,
        rate=rate,
        output=output,
    )
    trim = find_trim(chain)
    fine = find_exact_response(chain, trim, [0.1, 1, 3, 10, 100], input_name="u", output_name="u")
    assert fine.phase_deg[-1] == pytest.approx(-4.0 * np.arctan(100.0) / DEGREE - 0.1 / DEGREE, abs=1e-9)
    coarse = find_exact_response(chain, trim, [0.01, 100.0], input_name="u", output_name="u")
    assert coarse.phase_deg[-1] == pytest.approx(fine.phase_deg[-1], abs=1e-9)


@pytest.mark.parametrize("omega", [[500.0], [0.1, 500.0], [0.001, 0.1, 1.0, 10.0, 500.0]])
def test_an_unstable_engine_has_all_its_turns_wherever_the_grid_begins(omega: list[float]) -> None:
    """At 5 deg a pair of unstable roots adds a turn of lead to what the lags take."""
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 5.0})
    fine = find_exact_response(engine, trim, np.geomspace(1e-3, 500.0, 4000), **SIGNALS)
    found = find_exact_response(engine, trim, omega, **SIGNALS)
    assert found.phase_deg[-1] == pytest.approx(np.unwrap(np.angle(fine.values))[-1] / DEGREE, abs=1e-6)
