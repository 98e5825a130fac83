"""Orbits under many sinusoids at once, each with as many harmonics as it needs; those without an orbit are kept with the reason.

A few harmonics foretell the orbit; from there on their number is doubled until the last of them no longer matter.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from revline.analysis.collocation import Collocation, collocation
from revline.analysis.jacobians import evaluate
from revline.analysis.orbit_equations import OrbitEquations, Orbits, Positions
from revline.analysis.orbit_following import follow_amplitudes
from revline.analysis.orbit_levels import LevelSolver, approach, make_level_solver, transfer_between
from revline.analysis.orbit_newton import linear_orbits, solve_orbits
from revline.analysis.orbit_refusals import ForcedCase, Refusals, no_fundamental, refuse_orbits
from revline.lti.response import Complexes
from revline.system import Floats, index_of
from revline.values import make_read_only

FORETELLING_HARMONICS = 4
"""Highest harmonic of the orbits from which the first try starts."""

FORETELLING_STEP = 3e-3
"""Last step of those: what their missing harmonics do is larger."""

FIRST_HARMONICS = 8
"""Highest harmonic of the first try."""

LISTED_HARMONICS = FIRST_HARMONICS
"""Highest harmonic that a result lists; the distortion counts all of them."""

NO_ANSWER = 1e-12
"""A fundamental below this part of the largest value of the output is none."""

Start = Callable[[Collocation], Orbits]
"""Gives approximate orbits on a mesh."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitBatch:
    """Orbits with equally many harmonics.

    Attributes:
        rows: their positions among all orbits, shape (n,).
        phases: of the samples, in rad, shape (N,).
        omega: frequencies in rad/s, shape (n,).
        inputs, states, readings, outputs: samples, shape (n, N, number of them).
    """

    rows: NDArray[np.int64]
    phases: Floats
    omega: Floats
    inputs: Floats
    states: Floats
    readings: Floats
    outputs: Floats

    def __post_init__(self) -> None:
        make_read_only(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForcedOrbits:
    """Answers of all orbits, the finest of each; without meaning where one was refused.

    Attributes:
        values: fundamental of the watched output over the input, shape (n,), as all arrays without another shape.
        listed: amplitudes of the output's harmonics 1 to 8, shape (n, 8).
        distortion: root of the summed squares of the harmonics from the second on, over the fundamental.
        mean: of the output.
        error: estimated relative error of the fundamental by the harmonics left out.
        last_step: size of Newton's last step, or what cheaper steps leave by the rate at which they shrink, as a part of the states' swing.
        highest: number of the highest harmonic.
        batches: the orbits themselves.
        refusals: why an orbit was refused, by its position.
    """

    values: Complexes
    listed: Floats
    distortion: Floats
    mean: Floats
    error: Floats
    last_step: Floats
    highest: NDArray[np.int64]
    batches: list[OrbitBatch] = field(default_factory=list)
    refusals: Refusals = field(default_factory=dict)

    @staticmethod
    def none(count: int) -> "ForcedOrbits":
        """Hold no answer yet."""
        values, error = np.full(count, np.inf, dtype=complex), np.full(count, np.inf)
        distortion, mean, last = np.empty((3, count))
        listed, highest = np.empty((count, LISTED_HARMONICS)), np.zeros(count, dtype=int)
        return ForcedOrbits(values=values, listed=listed, distortion=distortion, mean=mean, error=error, last_step=last, highest=highest)

    def refuse(self, rows: NDArray[np.int64], refusals: Refusals) -> NDArray[np.bool_]:
        """Keep why some of the orbits at some rows are refused, and tell which of them are not."""
        self.refusals.update({int(rows[position]): error for position, error in refusals.items()})
        return np.array([position not in refusals for position in range(rows.size)], dtype=bool)


def find_orbits(case: ForcedCase, start: Start | None = None) -> ForcedOrbits:
    """Find all orbits of a case, with more harmonics those that need them.

    Args:
        case: what is asked.
        start: gives approximate orbits; without it the small-signal model does.

    Returns:
        Answers, and the reasons where there is none.
    """
    found = ForcedOrbits.none(case.drive.omega.size)
    mesh, rows = collocation(FIRST_HARMONICS), np.arange(case.drive.omega.size)
    ahead = _foretell(case, mesh, start or (lambda coarse: linear_orbits(case.drive, case.model, coarse)))
    while rows.size:
        part = _take(case, rows)
        orbits, last_step, missing = _find(part, mesh, ahead)
        kept = found.refuse(rows, missing | refuse_orbits(part, mesh, orbits))
        rows, part, orbits, last_step = rows[kept], _take(part, kept), orbits.take(kept), last_step[kept]
        answers, silent = _read(part, mesh, orbits)
        kept = found.refuse(rows, silent)
        rows, orbits, answers = rows[kept], orbits.take(kept), answers.take(kept)
        found.last_step[rows], found.highest[rows] = last_step[kept], mesh.harmonics
        rough = _keep(found, rows, answers, case.tolerance) & (2 * mesh.harmonics <= case.most_harmonics)
        found.batches.append(_batch(mesh, orbits.take(~rough), answers.outputs[~rough], rows[~rough]))
        rows, orbits = rows[rough], orbits.take(rough)
        if rows.size:
            ahead, mesh = _double(_take(case, rows), mesh, orbits), collocation(2 * mesh.harmonics)
    return found


@dataclass(frozen=True, slots=True)
class _Ahead:
    """Approximate orbits, and what improves them cheaply, if anything does."""

    start: Orbits
    solver: LevelSolver | None


@dataclass(frozen=True, slots=True)
class _Answers:
    """What the watched output of orbits on one mesh does.

    Attributes:
        value: fundamental over the input.
        sizes: its mean, and amplitudes of its harmonics from the first on, shape (n, H + 1).
        tail: largest of the last two harmonics of states and output, by their fundamentals.
        outputs: samples of all outputs, shape (n, N, n_outputs).
    """

    value: Complexes
    sizes: Floats
    tail: Floats
    outputs: Floats

    def take(self, which: Positions) -> "_Answers":
        return _Answers(self.value[which], self.sizes[which], self.tail[which], self.outputs[which])


def _take(case: ForcedCase, which: Positions) -> ForcedCase:
    return replace(case, drive=case.drive.take(which))


def _foretell(case: ForcedCase, mesh: Collocation, start: Start) -> _Ahead:
    """Solve with few harmonics."""
    coarse = collocation(FORETELLING_HARMONICS)
    equations = OrbitEquations(system=case.system, mesh=coarse)
    if not equations.direct:
        return _Ahead(start(mesh), None)
    first = start(coarse)
    solver = equations.linearise(first).solver()
    solved = approach(equations, first, solver, tolerance=FORETELLING_STEP)
    foretold = _refined(case, coarse, mesh, solved.orbits)
    if not np.all(solved.found):
        foretold = foretold.with_part(~solved.found, start(mesh).take(~solved.found))
    return _Ahead(foretold, make_level_solver(solver, case.model, case.drive.omega, (coarse, mesh)))


def _double(case: ForcedCase, mesh: Collocation, orbits: Orbits) -> _Ahead:
    """Double the harmonics of some orbits."""
    fine, equations = collocation(2 * mesh.harmonics), OrbitEquations(system=case.system, mesh=mesh)
    start = _refined(case, mesh, fine, orbits)
    if not equations.direct:
        return _Ahead(start, None)
    return _Ahead(start, make_level_solver(equations.linearise(orbits).solver(), case.model, case.drive.omega, (mesh, fine)))


def _refined(case: ForcedCase, coarse: Collocation, fine: Collocation, orbits: Orbits) -> Orbits:
    prolong = transfer_between(coarse.harmonics, fine.harmonics).prolong
    return Orbits(omega=orbits.omega, inputs=case.drive.inputs(fine), states=prolong @ orbits.states, readings=prolong @ orbits.readings)


def _find(case: ForcedCase, mesh: Collocation, ahead: _Ahead) -> tuple[Orbits, Floats, Refusals]:
    """Solve for orbits: by cheap steps, by Newton's method, or where that fails or leaves the states' ranges by raising the amplitude."""
    equations, tolerance = OrbitEquations(system=case.system, mesh=mesh), case.step_tolerance
    orbits, rest, last_step = ahead.start, np.arange(case.drive.omega.size), np.full(case.drive.omega.size, np.inf)
    if ahead.solver is not None:
        near = approach(equations, orbits, ahead.solver, tolerance=tolerance)
        orbits, rest, last_step = near.orbits, np.flatnonzero(~near.found), near.last_step.copy()
    failed = np.zeros(last_step.size, dtype=bool)
    if rest.size:
        solved = solve_orbits(equations, orbits.take(rest), tolerance=tolerance)
        orbits, last_step[rest], failed[rest] = orbits.with_part(rest, solved.orbits), solved.last_step, ~solved.found
    failed |= ~equations.inside(orbits)
    if case.seek_limits:
        failed[list(refuse_orbits(case, mesh, orbits))] = True
    rows = np.flatnonzero(failed)
    if not rows.size:
        return orbits, last_step, {}
    followed = follow_amplitudes(_take(case, rows), mesh)
    last_step[rows] = followed.last_step
    return orbits.with_part(rows, followed.orbits), last_step, {int(rows[k]): error for k, error in followed.missing.items()}


def _read(case: ForcedCase, mesh: Collocation, orbits: Orbits) -> tuple[_Answers, Refusals]:
    """Read the watched output of orbits, and judge their resolution."""
    outputs = evaluate(case.system, case.system.output, orbits.states, orbits.inputs, orbits.readings)
    watched = outputs[..., [index_of(case.system.outputs, case.excitation.output_name)]]
    harmonics = mesh.coefficients(np.concatenate((watched, orbits.states), axis=2))
    sizes = np.abs(harmonics)
    silent = sizes[:, 1] <= NO_ANSWER * np.max(sizes, axis=1)
    last = np.max(sizes[:, -2:], axis=1)
    tail = np.max(np.where(silent, 0.0, last / np.where(silent, 1.0, sizes[:, 1])), axis=1)
    sizes[:, 0] = harmonics[:, 0].real
    refusals = {int(row): no_fundamental(case, int(row)) for row in np.flatnonzero(silent[:, 0])}
    return _Answers(1j * harmonics[:, 1, 0] / case.drive.amplitude, sizes[..., 0], tail, outputs), refusals


def _keep(found: ForcedOrbits, rows: NDArray[np.int64], answers: _Answers, limit: float) -> NDArray[np.bool_]:
    """Enter answers, with their errors, and tell which of them need more harmonics."""
    with np.errstate(invalid="ignore"):
        change = np.abs(answers.value - found.values[rows]) / np.abs(answers.value)
    known_by_change = (answers.tail > limit) & np.isfinite(change)
    found.error[rows] = np.where(known_by_change, change, answers.tail)
    found.values[rows], found.mean[rows] = answers.value, answers.sizes[:, 0]
    found.listed[rows] = answers.sizes[:, 1 : LISTED_HARMONICS + 1]
    found.distortion[rows] = np.linalg.norm(answers.sizes[:, 2:], axis=1) / answers.sizes[:, 1]
    return (answers.tail > limit) & ~(known_by_change & (change <= 0.1 * limit))


def _batch(mesh: Collocation, orbits: Orbits, outputs: Floats, rows: NDArray[np.int64]) -> OrbitBatch:
    return OrbitBatch(
        rows=rows,
        phases=mesh.phases,
        omega=orbits.omega,
        inputs=orbits.inputs,
        states=orbits.states,
        readings=orbits.readings,
        outputs=outputs,
    )
