"""Periodic orbits followed from rest while their amplitude grows, many at once: each foretold by the two before."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from revline.analysis.collocation import Collocation
from revline.analysis.orbit_equations import OrbitEquations, Orbits
from revline.analysis.orbit_newton import solve_orbits
from revline.analysis.orbit_refusals import ForcedCase, Refusals, not_found, refuse_orbits, with_limit
from revline.system import Floats

FIRST_RISE = 0.25
"""First rise of the amplitude, as a part of it."""

SHORTEST_RISE = 2.0**-9
"""Smallest rise of the amplitude, as a part of it."""

SURE = 0.98
"""Part of the amplitude reached that is told: with more harmonics than here an orbit ends a little earlier, 0.2 % where it was tried."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Followed:
    """Orbits at the largest amplitudes that were reached.

    Attributes:
        orbits: their samples.
        last_step: size of Newton's last step, as a part of the states' swing, shape (n,).
        missing: why an orbit did not reach its whole amplitude, by its position.
    """

    orbits: Orbits
    last_step: Floats
    missing: Refusals


def follow_amplitudes(case: ForcedCase, mesh: Collocation) -> Followed:
    """Let the amplitude of each sinusoid of a case grow from nothing.

    Where the case seeks limits, an orbit that means nothing counts as none, so that the largest amplitude with one that does is found.
    """
    equations, drive = OrbitEquations(system=case.system, mesh=mesh), case.drive
    count = drive.omega.size
    rest = Orbits(
        omega=drive.omega,
        inputs=drive.inputs(mesh, np.zeros(count)),
        states=np.tile(drive.trim.states, (count, mesh.count, 1)),
        readings=np.tile(drive.trim.channels, (count, mesh.count, 1)),
    )
    solved = solve_orbits(equations, rest, tolerance=case.step_tolerance)
    before = last = solved.orbits
    last_step, refused = solved.last_step.copy(), Refusals()
    reached, rise, span = np.zeros(count), np.full(count, FIRST_RISE), np.ones(count)
    while (rows := np.flatnonzero((reached < 1.0) & (rise >= SHORTEST_RISE))).size:
        wanted = np.minimum(1.0, reached[rows] + rise[rows])
        guess = _foretell(case, mesh, (before.take(rows), last.take(rows)), (wanted, (wanted - reached[rows]) / span[rows], rows))
        trial = solve_orbits(equations, guess, tolerance=case.step_tolerance)
        good = trial.found & _meant(case, mesh, trial.orbits, (rows, wanted, trial.found), refused)
        won = rows[good]
        before, last = before.with_part(won, last.take(won)), last.with_part(won, trial.orbits.take(good))
        last_step[won], span[won], reached[won] = trial.last_step[good], wanted[good] - reached[won], wanted[good]
        rise[rows] *= np.where(good, 2.0, 0.5)
    missing: Refusals = {}
    for row in np.flatnonzero(reached < 1.0).tolist():
        part = float(reached[row]) * (SURE if case.seek_limits else 1.0)
        missing[row] = with_limit(case, row, part, refused[row]) if row in refused else not_found(case, row, part)
    return Followed(orbits=last, last_step=last_step, missing=missing)


def _foretell(
    case: ForcedCase, mesh: Collocation, known: tuple[Orbits, Orbits], wanted: tuple[Floats, Floats, NDArray[np.int64]]
) -> Orbits:
    """Extrapolate from two orbits of each to a larger part of the amplitude."""
    (before, last), (parts, ahead, rows) = known, wanted
    share = ahead[:, None, None]
    return Orbits(
        omega=last.omega,
        inputs=case.drive.take(rows).inputs(mesh, parts),
        states=last.states + share * (last.states - before.states),
        readings=last.readings + share * (last.readings - before.readings),
    )


def _meant(
    case: ForcedCase, mesh: Collocation, orbits: Orbits, tried: tuple[NDArray[np.int64], Floats, NDArray[np.bool_]], refused: Refusals
) -> NDArray[np.bool_]:
    """Tell which orbits mean something, and keep why others do not; all do where no limit is sought."""
    rows, parts, found = tried
    meant = np.ones(rows.size, dtype=bool)
    if not case.seek_limits:
        return meant
    drive = case.drive.take(rows)
    reasons = refuse_orbits(replace(case, drive=replace(drive, amplitude=parts * drive.amplitude)), mesh, orbits)
    for position, row in enumerate(rows.tolist()):
        if not found[position]:
            refused.pop(row, None)  # beyond here no orbit is found at all
        elif position in reasons:
            meant[position], refused[row] = False, reasons[position]
    return meant
