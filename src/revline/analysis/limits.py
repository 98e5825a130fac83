"""Limits in a system's equations, and how far a point is from them: every numpy.minimum and numpy.maximum that the equations call.

The equations are evaluated on numbers that report each comparison made. So no limit is missed between samples, and which results depend
on it is known; how far it is follows from where, as one argument moves over its range, the other of the two becomes the larger.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from revline.analysis.jacobians import COMPLEX_STEP, Matrix
from revline.analysis.switching import compare
from revline.equations import Equation
from revline.system import DelaySystem, Floats, Variable

SAMPLES = 65
"""Values of an argument on each side of the point at which comparisons are made; a limit met twice between two is met by none."""

REFINEMENTS = 9
"""Brackets shrink by the number of samples each time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """A limit of an equation, and the argument that would meet it first if it alone changed.

    Attributes:
        results: what depends on the limit, for example "rate of manifold_pressure".
        argument: what would have to change, for example "throttle".
        change: by how much, in its unit, with its sign; 0 at a kink.
        at: value of the argument there.
        unit: of the argument.
        share: the change as a part of the argument's range.
    """

    results: tuple[str, ...]
    argument: str
    change: float
    at: float
    unit: str
    share: float

    def __str__(self) -> str:
        """Say where the limit is, for a warning."""
        where = (
            f"{self.argument} = {self.at:.6g} {self.unit}, {abs(self.change):.3g} {self.unit} {'above' if self.change > 0.0 else 'below'}"
        )
        return f"a limit of {self.results[0]} begins near by, at {where} this point"


def find_limits(system: DelaySystem, arguments: Floats, spans: Floats) -> tuple[Limit, ...]:
    """Find all limits that one argument can meet inside its range, the nearest first; the ends of its range are none.

    Args:
        system: any.
        arguments: states, inputs and channel readings at the point.
        spans: ranges that changes are related to, one for each argument.

    Returns:
        One entry for each place at which a limit begins.
    """
    variables = (*system.states, *system.inputs, *system.channels)
    names = [v.name for v in (*system.states, *system.inputs)] + [f"reading of {v.name}" for v in system.channels]
    found: dict[tuple[str, float], Limit] = {}
    ends = np.array([_ends(v, float(value), float(span)) for v, value, span in zip(variables, arguments, spans, strict=True)])
    for function, results in _equations(system):
        gaps, reached = _compare(system, function, _moved(arguments))
        steps = _scan(system, function, arguments, ends)
        for k, gap in enumerate(gaps):
            dependent = tuple(name for name, limits in zip(results, reached, strict=True) if k in limits)
            options = np.where(gap.imag != 0.0, 0.0, np.nan) if gap.real[0] == 0.0 else steps[k]
            if not dependent or np.all(np.isnan(options)):
                continue
            j = int(np.nanargmin(np.abs(options) / spans))
            change = _refined(system, function, (arguments, j, k), float(options[j])) if options[j] != 0.0 else 0.0
            key = (names[j], round(change / float(spans[j]), 9))
            before = found[key].results if key in found else ()
            found[key] = Limit(
                results=tuple(dict.fromkeys((*before, *dependent))),
                argument=names[j],
                change=change,
                at=float(arguments[j]) + change,
                unit=variables[j].unit,
                share=abs(change) / float(spans[j]),
            )
    return tuple(sorted(found.values(), key=lambda limit: limit.share))


def _equations(system: DelaySystem) -> Sequence[tuple[Equation, list[str]]]:
    return (
        (system.rate, [f"rate of {v.name}" for v in system.states]),
        (system.output, [f"output {v.name}" for v in system.outputs]),
        (system.emit, [f"channel {v.name}" for v in system.channels]),
        (system.lags, [f"lag of {v.name}" for v in system.channels]),
    )


def _moved(arguments: Floats) -> Matrix:
    """The arguments once for each of them, that one with an imaginary step."""
    return np.asarray(arguments + 1j * COMPLEX_STEP * np.eye(arguments.size))


def _compare(system: DelaySystem, function: Equation, points: Matrix) -> tuple[list[Matrix], list[frozenset[int]]]:
    """All differences compared in an equation at some points, and those on which each result depends."""
    return compare(system, function, np.split(points, np.cumsum((len(system.states), len(system.inputs))), axis=1))


def _ends(variable: Variable, value: float, span: float) -> tuple[float, float]:
    """How far an argument may go, down and up: its range, else past its search range."""
    lows, highs = (variable.low, variable.search_low - span, value - span), (variable.high, variable.search_high + span, value + span)
    return next(low for low in lows if np.isfinite(low)), next(high for high in highs if np.isfinite(high))


def _scan(system: DelaySystem, function: Equation, arguments: Floats, ends: Floats) -> Floats:
    """Smallest change of each argument, by samples from the point to the ends, at which each comparison has another winner.

    Returns:
        Of shape (comparisons, arguments); the change is that of the first sample beyond. NaN where there is none.
    """
    count = arguments.size
    steps = np.linspace(0.0, 1.0, SAMPLES) * (ends - arguments[:, None])[:, :, None]
    points = np.tile(arguments, (count, 2, SAMPLES, 1))
    for j in range(count):
        points[j, :, :, j] += steps[j]
    gaps = _compare(system, function, points.reshape(-1, count).astype(complex))[0]
    signs = np.array([gap.real > 0.0 for gap in gaps]).reshape(len(gaps), count, 2, SAMPLES)
    crossed = signs != signs[..., :1]
    first = np.where(np.any(crossed, axis=-1), np.argmax(crossed, axis=-1), -1)
    changes = np.where(first >= 0, np.take_along_axis(np.broadcast_to(steps, signs.shape), first[..., None], axis=-1)[..., 0], np.nan)
    down, up = changes[..., 0], changes[..., 1]
    return np.where(np.isnan(down) | (np.abs(up) <= np.abs(down)), up, down)


def _refined(system: DelaySystem, function: Equation, which: tuple[Floats, int, int], beyond: float) -> float:
    """Change of one argument at which a comparison is even, to rounding, from the sample beyond."""
    arguments, j, k = which
    low, high = 0.0, beyond
    points = np.tile(arguments.astype(complex), (SAMPLES, 1))
    for _ in range(REFINEMENTS):
        changes = np.linspace(low, high, SAMPLES)
        points[:, j] = arguments[j] + changes
        signs = _compare(system, function, points)[0][k].real > 0.0
        first = int(np.argmax(signs != signs[0]))
        if first == 0:
            break
        low, high = float(changes[first - 1]), float(changes[first])
    return high
