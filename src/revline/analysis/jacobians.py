"""Values and exact first derivatives of a system's equations, at many points at once.

Equations are made of numpy's functions, so they take arrays in place of scalars: all points, and all perturbed arguments, go through
each equation in one call.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from revline.equations import Equation
from revline.lti.batches import solve_each
from revline.system import DelaySystem, Floats

COMPLEX_STEP = 1e-30
"""Imaginary step; so small that the real part, and the derivative, are exact to rounding. Source: Squire and Trapp (1998)."""

Matrix = NDArray[Any]

BLOCKS = ("A", "Bu", "Bz", "Cy", "Dyu", "Dyz", "Cz", "Dzu", "Dzz")
"""Names of all derivatives: of rates, outputs and what enters channels, by states, inputs and readings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Jacobians:
    """Derivatives of rate, output and emit with respect to states, inputs and channel readings; points along the first axis."""

    A: Floats
    Bu: Floats
    Bz: Floats
    Cy: Floats
    Dyu: Floats
    Dyz: Floats
    Cz: Floats
    Dzu: Floats
    Dzz: Floats

    def at(self, point: int) -> "Jacobians":
        """Give those at one of the points."""
        return Jacobians(**{name: getattr(self, name)[point] for name in BLOCKS})


def evaluate(system: DelaySystem, function: Equation, x: Matrix, u: Matrix, zd: Matrix) -> Matrix:
    """Evaluate one of a system's equations at many points.

    Args:
        system: gives the parameters.
        function: its emit, lags, rate or output.
        x: states, real or complex; the last axis counts them.
        u: inputs, in the same way.
        zd: channel readings, in the same way.

    Returns:
        Results along the last axis. Where an equation divides by zero or overflows they are not finite, without a warning.
    """
    shape = _shape_of_points(x, u, zd)
    with np.errstate(all="ignore"):
        results = function(system.parameters, *(tuple(v[..., k] for k in range(v.shape[-1])) for v in (x, u, zd)))
    values = np.empty((*shape, len(results)), dtype=np.result_type(x, u, zd))
    for k, result in enumerate(results):
        values[..., k] = result
    return values


def differentiate(system: DelaySystem, function: Equation, x: Floats, u: Floats, zd: Floats) -> tuple[Floats, Floats, Floats]:
    """Differentiate one of a system's equations by complex step.

    Args:
        system: gives the parameters.
        function: its emit, lags, rate or output.
        x: states; the last axis counts them.
        u: inputs, in the same way.
        zd: channel readings, in the same way.

    Returns:
        Derivatives with respect to x, u and zd: the points' axes, then results, then arguments.

    Source:
        Squire and Trapp (1998), SIAM Review 40(1), 110-112.
    """
    by_x, by_u, by_zd = differentiate_by(system, function, ("x", "u", "zd"), x, u, zd)
    return by_x, by_u, by_zd


def differentiate_by(
    system: DelaySystem, function: Equation, letters: tuple[str, ...], x: Floats, u: Floats, zd: Floats
) -> tuple[Floats, ...]:
    """Differentiate one of a system's equations by some kinds of arguments.

    Only what the equation is made of by its structure is moved, and only what is moved is complex: the rest is computed with real numbers.

    Args:
        system: gives the parameters.
        function: its emit, lags, rate or output.
        letters: which kinds: "x", "u", "zd".
        x: states; the last axis counts them.
        u: inputs, in the same way.
        zd: channel readings, in the same way.

    Returns:
        For each letter the derivatives: the points' axes, then results, then arguments.
    """
    arguments = {name: [values[..., k] for k in range(values.shape[-1])] for name, values in (("x", x), ("u", u), ("zd", zd))}
    sources = _sources(system, function)
    moved = [(letter, k) for letter in letters for k in range(len(arguments[letter])) if f"{letter}{k}" in sources]
    shape = _shape_of_points(x, u, zd)
    steps = 1j * COMPLEX_STEP * np.eye(len(moved)).reshape(len(moved), len(moved), *(1 for _ in shape))
    for row, (letter, k) in enumerate(moved):
        arguments[letter][k] = arguments[letter][k] + steps[row]
    with np.errstate(all="ignore"):
        results = function(system.parameters, *(tuple(values) for values in arguments.values()))
    slopes = {letter: np.zeros((*shape, len(results), len(arguments[letter]))) for letter in letters}
    for k, result in enumerate(results):
        ends = np.broadcast_to(np.imag(result), (len(moved), *shape))
        for row, (letter, column) in enumerate(moved):
            slopes[letter][..., k, column] = ends[row] / COMPLEX_STEP
    return tuple(slopes[letter] for letter in letters)


def _shape_of_points(x: Matrix, u: Matrix, zd: Matrix) -> tuple[int, ...]:
    shapes = (x.shape[:-1], u.shape[:-1], zd.shape[:-1])
    return shapes[0] if shapes[0] == shapes[1] == shapes[2] else np.broadcast_shapes(*shapes)


def _sources(system: DelaySystem, function: Equation) -> frozenset[str]:
    """Tell which arguments one of a system's equations is made of, such as "x0"."""
    structure = system.structure
    named = (
        (system.emit, structure.emit),
        (system.lags, structure.lags),
        (system.rate, structure.rate),
        (system.output, structure.output),
    )
    return frozenset[str]().union(*next(sources for equation, sources in named if equation is function))


def find_jacobians(system: DelaySystem, x: Floats, u: Floats, zd: Floats) -> Jacobians:
    """Differentiate rate, output and emit; see `differentiate`."""
    A, Bu, Bz = differentiate(system, system.rate, x, u, zd)
    Cy, Dyu, Dyz = differentiate(system, system.output, x, u, zd)
    Cz, Dzu, Dzz = differentiate(system, system.emit, x, u, zd)
    return Jacobians(A=A, Bu=Bu, Bz=Bz, Cy=Cy, Dyu=Dyu, Dyz=Dyz, Cz=Cz, Dzu=Dzu, Dzz=Dzz)


def settle_channels(system: DelaySystem, x: Floats, u: Floats, passes: int = 40) -> Floats:
    """Find what channels carry at rest, where each reading equals what enters: zd = emit(p, x, u, zd).

    Channels that follow one another settle after as many passes as there are channels; a loop of channels is solved by Newton.

    Args:
        system: any system.
        x: states; the last axis counts them.
        u: inputs, in the same way.
        passes: most Newton steps for a loop of channels.

    Returns:
        Readings along the last axis; not finite where a loop has no solution that Newton reaches.
    """
    count = len(system.channels)
    shape = np.broadcast_shapes(x.shape[:-1], u.shape[:-1])
    readings = np.zeros((*shape, count))
    for _ in range(count):
        readings = evaluate(system, system.emit, x, u, readings)
        if not reads_channels(system):
            return readings
    settled = evaluate(system, system.emit, x, u, readings)
    if np.array_equal(settled, readings, equal_nan=True):
        return readings
    return _settle_loop(system, x, u, readings, passes)


def reads_channels(system: DelaySystem) -> bool:
    """Tell whether what enters a channel depends on what is read from one."""
    return any(source.startswith("zd") for sources in system.structure.emit for source in sources)


def _settle_loop(system: DelaySystem, x: Floats, u: Floats, readings: Floats, passes: int) -> Floats:
    wide_x = np.broadcast_to(x, (*readings.shape[:-1], x.shape[-1]))
    wide_u = np.broadcast_to(u, (*readings.shape[:-1], u.shape[-1]))
    for _ in range(passes):
        miss = evaluate(system, system.emit, wide_x, wide_u, readings) - readings
        slope = np.eye(readings.shape[-1]) - differentiate(system, system.emit, wide_x, wide_u, readings)[2]
        step = solve_each(slope, miss)
        readings = readings + step
        if np.all(np.abs(step) <= 1e-14 * np.abs(readings)):
            break
    entering = evaluate(system, system.emit, wide_x, wide_u, readings)
    settled = np.abs(entering - readings) <= 1e-9 * (np.abs(entering) + np.abs(readings))
    return np.where(np.all(settled, axis=-1, keepdims=True), readings, np.nan)
