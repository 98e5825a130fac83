"""Orbits with more harmonics from orbits with fewer: the linearised equations of few harmonics serve as those of many.

Low harmonics are mended by the exact Jacobian on the coarse mesh, high ones each by the small-signal model at its own frequency. Such
steps shrink the error by a factor instead of squaring it, but cost little: the misses are those of the fine mesh, so that only the way
to the orbit is approximate. Where they do not shrink fast, Newton's method on the fine mesh takes over.

Source: the two-level idea is that of the multigrid correction, Hackbusch (1985), Multi-Grid Methods and Applications, chapter 2.
"""

import functools
from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.collocation import Collocation, collocation
from revline.analysis.orbit_equations import Misses, NewtonSolver, OrbitEquations, Orbits, Positions
from revline.analysis.orbit_newton import MOST_STEPS, Change, Solved, smallest_step
from revline.lti.batches import invert_each
from revline.lti.response import Complexes
from revline.lti.state_space import DelayStateSpace
from revline.system import Floats
from revline.values import make_read_only

SHRINKING = 0.5
"""Steps that are larger than this part of the one before are given up."""

ROUNDED = 0.01
"""A step below this part of the tolerance ends the search whatever the one before was: at rounding, steps no longer shrink."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Transfer:
    """How samples pass between a coarse and a fine mesh.

    Attributes:
        restrict: fine samples to the coarse samples of their low harmonics, shape (N coarse, N fine).
        prolong: coarse samples to fine ones, shape (N fine, N coarse).
        numbers: of the harmonics that only the fine mesh has, shape (M,).
        analysis: fine samples to their coefficients, shape (M, N fine).
        waves: their values at the fine phases, shape (N fine, M).
    """

    restrict: Floats
    prolong: Floats
    numbers: Floats
    analysis: Complexes
    waves: Complexes

    def __post_init__(self) -> None:
        make_read_only(self)


@functools.lru_cache(maxsize=16)
def transfer_between(coarse_harmonics: int, fine_harmonics: int) -> Transfer:
    """Lay out how samples pass between two meshes."""
    coarse, fine = collocation(coarse_harmonics), collocation(fine_harmonics)
    low = coarse.harmonics + 1
    numbers = np.arange(low, fine.harmonics + 1)
    return Transfer(
        restrict=(coarse.waves(coarse.phases) @ fine.analysis[:, :low].T).real,
        prolong=coarse.weights(coarse.waves(fine.phases)),
        numbers=numbers.astype(float),
        analysis=fine.analysis[:, low:].T,
        waves=fine.waves(fine.phases)[:, low:],
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelSolver:
    """Finds approximate steps on a fine mesh.

    Attributes:
        coarse: solver of the linearised equations on the coarse mesh.
        transfer: between the meshes.
        answers: of states and readings to misses of the states' equations, at each high harmonic, from the small-signal model,
            shape (n, M, n_states + n_channels, n_states).
    """

    coarse: NewtonSolver
    transfer: Transfer
    answers: Complexes

    def take(self, which: Positions) -> "LevelSolver":
        """Give the solver of some of the orbits."""
        return LevelSolver(coarse=self.coarse.take(which), transfer=self.transfer, answers=self.answers[which])

    def step(self, misses: Misses) -> tuple[Floats, Floats]:
        """Find changes that mend the misses of the states' equations approximately, those of the readings being none."""
        low = self.transfer.restrict @ misses.states
        states, readings = self.coarse.step(
            Misses(states=low, readings=np.zeros((*low.shape[:2], misses.readings.shape[2])), lags=misses.lags)
        )
        high = self.answers @ (self.transfer.analysis @ misses.states)[..., None]
        added = (self.transfer.waves @ high[..., 0]).real
        n_states = states.shape[2]
        return self.transfer.prolong @ states - added[..., :n_states], self.transfer.prolong @ readings - added[..., n_states:]


def make_level_solver(coarse: NewtonSolver, model: DelayStateSpace, omega: Floats, meshes: tuple[Collocation, Collocation]) -> LevelSolver:
    """Use a solver on a coarse mesh on a fine one, for orbits at some frequencies in rad/s about the point of a small-signal model."""
    transfer = transfer_between(meshes[0].harmonics, meshes[1].harmonics)
    n_states = model.A.shape[0]
    characteristic = model.characteristic(1j * omega[:, None] * transfer.numbers)
    return LevelSolver(coarse=coarse, transfer=transfer, answers=invert_each(characteristic)[..., :n_states])


def approach(equations: OrbitEquations, start: Orbits, solver: LevelSolver | NewtonSolver, *, tolerance: float) -> Solved:
    """Improve orbits as long as each step is much smaller than the one before.

    At least two steps are made, so that it is known how fast they shrink, and with it how large the error is that is left.

    Args:
        equations: on the mesh of the orbits, of a system whose readings follow from states and inputs alone.
        start: approximate orbits.
        solver: for its steps; it is kept.
        tolerance: largest error left of an orbit that is found, as a part of a state's swing, judged by the last two steps.

    Returns:
        Orbits, with what their last step leaves by estimate; those that were not found are as the last step that shrank left them.
    """
    n = start.omega.size
    found, last_step, steps = np.zeros(n, dtype=bool), np.full(n, np.inf), np.zeros(n, dtype=int)
    orbits = replace(start, states=start.states.copy(), readings=start.readings.copy())
    scales = equations.scales(start)
    largest, rounded = smallest_step(start, scales, tolerance), smallest_step(start, scales, ROUNDED * tolerance)
    rows, part, made, before = np.arange(n), start, 0, last_step
    while rows.size:
        settled, misses = equations.settle(part)
        change = Change(*solver.step(misses))
        size = change.size(scales)
        made += 1
        with np.errstate(invalid="ignore"):
            ratio = size / before
            left = np.where(ratio < 1.0, size * ratio / (1.0 - ratio), np.inf)
        done = ((size <= rounded) | (left <= largest)) & (made > 1)
        shrinks = done | (np.isfinite(size) & ~(ratio > SHRINKING))
        stay = shrinks & ~done & (made < MOST_STEPS)
        moved = replace(settled, states=settled.states + change.states, readings=settled.readings + change.readings)
        if not np.all(stay):
            for kept, samples in ((~stay & shrinks, moved), (~shrinks, part)):
                orbits.states[rows[kept]], orbits.readings[rows[kept]] = samples.states[kept], samples.readings[kept]
            found[rows], last_step[rows], steps[rows] = done, np.minimum(size, left), made
            rows, moved, solver, size = rows[stay], moved.take(stay), solver.take(stay), size[stay]
            scales, largest, rounded = scales[stay], largest[stay], rounded[stay]
        part, before = moved, size
    return Solved(orbits=orbits, found=found, last_step=last_step, steps=steps)
