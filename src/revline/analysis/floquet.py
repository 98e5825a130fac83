"""Stability of a periodic orbit of a delay system: Floquet multipliers of its monodromy operator, by collocation.

A small deviation from the orbit obeys the linearised equations, periodic in time. What it has become one period later depends on the
state and on what the channels still carry: the operator that takes these from one period to the next is discretised by polynomials on
equal elements, collocated at Radau points, and its eigenvalues are the multipliers. Delayed readings that depend on the state move
with it: d zd = dz(t - lag) - z'(t - lag) d lag.

Source: Luzyanina and Engelborghs (2002), International Journal of Bifurcation and Chaos 12(12), 2977-2989, for collocation of the
monodromy operator with state-dependent delays.
"""

from dataclasses import dataclass

import numpy as np

from revline.analysis.collocation import collocation
from revline.analysis.harmonic_balance import PeriodicOrbit
from revline.analysis.jacobians import evaluate
from revline.analysis.monodromy import Monodromy, linearise_along
from revline.analysis.pieces import DEGREE, Pieces
from revline.errors import NotConvergedError, out_of_range
from revline.lti.response import Complexes
from revline.system import DelaySystem
from revline.values import make_read_only

FIRST_ELEMENTS = 8
"""Elements per period of the first try."""

MOST_ELEMENTS = 256
"""Elements per period at most."""

MOST_UNKNOWNS = 6000
"""Size of the largest linear system that is solved."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloquetMultipliers:
    """How small deviations from a periodic orbit change from one period to the next.

    Attributes:
        values: the largest multipliers, by falling magnitude; with magnitudes below 1 all deviations die out.
        error: estimated error of the first, absolute.
        elements: per period, of the finest mesh.
    """

    values: Complexes
    error: float
    elements: int

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def largest(self) -> float:
        """Magnitude of the largest multiplier: factor by which deviations shrink or grow per period in the long run."""
        return float(np.abs(self.values[0]))

    @property
    def stable(self) -> bool:
        """Whether small deviations from the orbit die out."""
        return self.largest < 1.0

    @property
    def certain(self) -> bool:
        """Whether the largest multiplier is further from 1 than its estimated error."""
        return abs(self.largest - 1.0) > self.error


def find_floquet_multipliers(system: DelaySystem, orbit: PeriodicOrbit, *, tolerance: float = 1e-6, count: int = 6) -> FloquetMultipliers:
    """Find the largest Floquet multipliers of a periodic orbit.

    The elements are doubled until the largest multiplier changes by less than the tolerance.

    Args:
        system: any system with delay channels.
        orbit: from `balance_harmonics`, for example.
        tolerance: largest estimated error of the largest multiplier, relative to 1 or to its magnitude if that is larger.
        count: how many to give at most.

    Raises:
        InvalidInputError: the tolerance or the count is out of range.
        NotConvergedError: more elements than can be used would be needed; the message has the last values.
    """
    if not 1e-12 <= tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "", "1e-12 to 1", "give a value such as 1e-6")
    if count < 1:
        raise out_of_range("count", count, "multipliers", "1 and above", "ask for at least one")
    before, change, elements = np.inf, np.inf, FIRST_ELEMENTS
    while elements <= MOST_ELEMENTS:
        if elements * DEGREE * (len(system.states) + len(system.channels)) > MOST_UNKNOWNS:
            break
        values = _problem(system, orbit, elements).multipliers()
        largest = float(np.abs(values[0]))
        change = abs(largest - before)
        if change <= tolerance * max(1.0, largest):
            return FloquetMultipliers(values=values[:count], error=change, elements=elements)
        before, elements = largest, 2 * elements
    message = (
        f"the stability of the orbit of {system.name} at {orbit.omega:g} rad/s is not resolved with {elements // 2} elements per period: "
        f"the largest multiplier, {before:.6g}, still changes by {change:.2g} (limit {tolerance:g}); give a larger tolerance"
    )
    raise NotConvergedError(message, frequency=orbit.omega, multiplier=before, change=change)


def _problem(system: DelaySystem, orbit: PeriodicOrbit, elements: int) -> Monodromy:
    """Form the operator of an orbit on equal elements."""
    pieces, period = Pieces.lay(elements, np.empty(0)), 2.0 * np.pi / orbit.omega
    mesh = collocation(orbit.harmonics)
    phases = 2.0 * np.pi * pieces.times
    waves = mesh.waves(phases)
    states, inputs, readings = ((waves @ mesh.coefficients(samples)).real for samples in (orbit.states, orbit.inputs, orbit.readings))
    lags = evaluate(system, system.lags, states, inputs, readings)
    entering = mesh.coefficients(evaluate(system, system.emit, orbit.states, orbit.inputs, orbit.readings))
    late = mesh.waves(phases[:, None] - orbit.omega * lags) * (1j * orbit.omega * np.arange(mesh.harmonics + 1))
    drift = np.einsum("jam,ma->ja", late, entering).real  # z' at the delayed time
    return Monodromy(pieces, period, linearise_along(system, (states, inputs, readings), drift))
