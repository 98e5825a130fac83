"""Steps on a fine mesh by the linearised equations of a coarse one: they lead to the same orbits, or are given up."""

from dataclasses import replace

import numpy as np
import pytest

from revline.analysis.collocation import collocation
from revline.analysis.jacobians import find_jacobians
from revline.analysis.linearize import build_model
from revline.analysis.orbit_equations import OrbitEquations, Orbits
from revline.analysis.orbit_levels import LevelSolver, approach, make_level_solver, transfer_between
from revline.analysis.orbit_newton import Drive, linear_orbits, solve_orbits
from revline.analysis.trim import find_trim
from revline.system import DelaySystem, Floats

OMEGA = np.array([0.1, 2.0, 30.0])


def test_low_harmonics_pass_down_and_up_exactly_and_high_ones_are_kept_apart() -> None:
    transfer, coarse, fine = transfer_between(3, 7), collocation(3), collocation(7)
    low = 0.3 + np.cos(3 * fine.phases) - 0.5 * np.sin(fine.phases)
    both = low + 0.2 * np.sin(5 * fine.phases)
    assert transfer.restrict @ both == pytest.approx(0.3 + np.cos(3 * coarse.phases) - 0.5 * np.sin(coarse.phases), abs=1e-14)
    assert transfer.prolong @ (transfer.restrict @ both) == pytest.approx(low, abs=1e-14)
    assert (transfer.waves @ (transfer.analysis @ both)).real == pytest.approx(both - low, abs=1e-14)


def prepare(engine: DelaySystem, amplitude: Floats) -> tuple[OrbitEquations, Orbits, LevelSolver]:
    trim = find_trim(engine, inputs={"throttle": 25.0})
    model = build_model(engine, find_jacobians(engine, trim.states, trim.inputs, trim.channels), trim.lags)
    drive = Drive(trim=trim, position=0, amplitude=amplitude, omega=OMEGA)
    coarse, fine = collocation(4), collocation(8)
    solver = OrbitEquations(system=engine, mesh=coarse).linearise(linear_orbits(drive, model, coarse)).solver()
    return (
        OrbitEquations(system=engine, mesh=fine),
        linear_orbits(drive, model, fine),
        make_level_solver(solver, model, OMEGA, (coarse, fine)),
    )


def test_the_orbits_are_those_of_newtons_method_and_the_error_left_is_covered(engine: DelaySystem) -> None:
    equations, start, solver = prepare(engine, np.full(3, 5.0))
    exact = solve_orbits(equations, start, tolerance=1e-12)
    for tolerance in (1e-4, 1e-8):
        near = approach(equations, start, solver, tolerance=tolerance)
        assert near.found.all()
        assert near.steps.min() >= 2
        error = np.max(np.abs(near.orbits.states - exact.orbits.states) / equations.scales(start)[:, None, :], axis=(1, 2))
        assert np.all(error <= tolerance)
        readings = np.abs(near.orbits.readings - exact.orbits.readings) / np.ptp(exact.orbits.readings[..., :1], axis=1, keepdims=True)
        assert np.max(readings[..., 0]) <= 10.0 * tolerance


def test_steps_that_do_not_shrink_are_given_up(engine: DelaySystem) -> None:
    """Negative control: with a solver of the wrong sign nothing may count as found."""
    equations, start, solver = prepare(engine, np.full(3, 5.0))
    wrong = replace(solver, coarse=replace(solver.coarse, inverse=-solver.coarse.inverse))
    near = approach(equations, start, wrong, tolerance=1e-8)
    assert not near.found.any()
    assert np.all(near.steps < 5)


def test_numbers_that_are_none_are_given_up(engine: DelaySystem) -> None:
    equations, start, solver = prepare(engine, np.full(3, 5.0))
    broken = replace(solver, coarse=replace(solver.coarse, inverse=np.full_like(solver.coarse.inverse, np.nan)))
    near = approach(equations, start, broken, tolerance=1e-8)
    assert not near.found.any()
    assert np.all(near.steps == 1)
    assert np.all(np.isfinite(near.orbits.states))
