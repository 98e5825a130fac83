"""Steady states over a range of one input, with stability, and where they end."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.analysis.steady_equations import SteadyEquations
from revline.analysis.trim import Rests, Trim
from revline.analysis.trim_branches import find_rests_along, follow_each
from revline.errors import InvalidInputError, NoTrimError, RevlineError, out_of_range
from revline.system import DelaySystem, Floats, Variable, check_range, index_of
from revline.values import make_read_only

BISECTIONS = 60
PARTS = 16
"""Parts into which a range that holds an end of the steady states is cut each time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Missing:
    """A value of the swept input without a steady state in the search range.

    Attributes:
        value: of the swept input.
        reason: the message of the search, which names steady states left out.
    """

    value: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Undecided(Missing):
    """A value of the swept input with a steady state of which a lag, a derivative, an output or the stability could not be told.

    It is no end of the steady states. The reason is the message of the error that `find_trim` raises there.
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boundary:
    """Where steady states end, enclosed to the tolerance asked for.

    Attributes:
        value: of the swept input, the last with a steady state.
        trim: that steady state.
        without: the nearest value tried that has none, and why.
        undecided: why the end is not enclosed more closely; empty where it is to the tolerance.
    """

    value: float
    trim: Trim
    without: Missing
    undecided: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SteadyMap:
    """How a system rests, over one input.

    Attributes:
        system: name of the system.
        sweep: the input that was swept.
        output: the output that is looked at.
        values: of the swept input that have a steady state, rising.
        trims: the steady state at each.
        missing: values that have none, and those that are `Undecided`.
        boundaries: between values with and without; none where every value has a steady state.
    """

    system: str
    sweep: Variable
    output: Variable
    values: Floats
    trims: tuple[Trim, ...]
    missing: tuple[Missing, ...]
    boundaries: tuple[Boundary, ...]

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.trims),) or np.any(np.diff(self.values) <= 0.0):
            message = f"{self.values.size} values for {len(self.trims)} steady states; give one rising value for each"
            raise InvalidInputError(message)
        make_read_only(self)

    @property
    def states(self) -> Floats:
        """States at rest: one row for each value."""
        return np.array([trim.states for trim in self.trims])

    @property
    def outputs(self) -> Floats:
        """All outputs at rest: one row for each value."""
        return np.array([trim.outputs for trim in self.trims])

    @property
    def output_values(self) -> Floats:
        """The output that is looked at, for each value."""
        return np.array([trim.output(self.output.name) for trim in self.trims])

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each steady state is stable."""
        return np.array([trim.stable for trim in self.trims], dtype=bool)

    @property
    def lowest(self) -> float:
        """The lowest value of the swept input known to have a steady state, boundaries included."""
        return float(min((*self.values, *(boundary.value for boundary in self.boundaries))))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader of the map should know: values without a steady state, boundaries, states left out, other trims."""
        sweep = self.sweep
        found = [
            f"at {sweep.name} = {entry.value:g} {sweep.unit}, undecided: {entry.reason}" if isinstance(entry, Undecided) else entry.reason
            for entry in self.missing
        ]
        for boundary in self.boundaries:
            side = "below" if boundary.without.value < boundary.value else "above"
            resting = f"{self.output.name} = {boundary.trim.output(self.output.name):.4g} {self.output.unit}"
            place = f"{side} {sweep.name} = {boundary.value:.6g} {sweep.unit}, where {resting}"
            if boundary.undecided:
                limit = f"{boundary.without.value:.6g} {sweep.unit}"
                found.append(f"steady states end {place}, and before {limit}; undecided where between them: {boundary.undecided}")
            else:
                found.append(f"no steady state {place}, inside the search range")
        for value, trim in zip(self.values, self.trims, strict=True):
            place = f"at {sweep.name} = {value:g} {sweep.unit}"
            found += [f"{place}, {entry}" for entry in trim.left_out]
            for other in trim.alternatives:
                resting = f"{self.output.name} = {other.output(self.output.name):.4g} {self.output.unit}"
                kind = "a stable" if other.stable else "an unstable"
                found.append(f"{place}, {kind} steady state besides: {resting}")
        return tuple(found)


def find_steady_map(
    system: DelaySystem,
    *,
    sweep_input: str,
    values: ArrayLike,
    output: str,
    inputs: Mapping[str, float] | None = None,
    tolerance: float = 1e-6,
) -> SteadyMap:
    """Find the steady states over a range of one input, following the branch that the first one lies on.

    Args:
        system: any system with delay channels.
        sweep_input: the input to sweep.
        values: of that input, strictly rising, for example `numpy.linspace(0.0, 90.0, 91)`.
        output: the output to look at.
        inputs: the other inputs; those not named have their nominal values.
        tolerance: how closely an end of the steady states is enclosed, in units of the swept input.

    Returns:
        The map; values without a steady state, or with an undecided one, are listed in it with the reason, and each end is found by
        bisection.

    Raises:
        InvalidInputError: a name is unknown, values do not rise or are out of range, or the tolerance is not positive; or at no value a
            trim, and at some an equation without a finite derivative or value, or a lag that is not positive.
        NoTrimError: no value has a steady state.
        NotConvergedError: at no value a trim, and at some a steady state whose stability could not be decided.
    """
    sweep = system.inputs[index_of(system.inputs, sweep_input)]
    shown = system.outputs[index_of(system.outputs, output)]
    grid = _checked_values(sweep, values)
    if not tolerance > 0.0:
        raise out_of_range("tolerance", tolerance, sweep.unit, "0 to infinity, without 0", "give a positive one")
    others = dict(inputs or {})
    if sweep_input in others:
        message = f"{sweep_input} is both swept and given as {others[sweep_input]:g}; leave one out"
        raise InvalidInputError(message, name=sweep_input)
    rests = find_rests_along(system, [{**others, sweep_input: float(value)} for value in grid])
    results = _chosen(grid, rests)
    if not any(isinstance(result, Trim) for result in results):
        for rest in rests:
            for reason in rest.undecided:
                raise reason
        message = f"no steady state at any {sweep_input} of {grid[0]:g} to {grid[-1]:g} {sweep.unit}; the first: {_reason(results)}"
        raise NoTrimError(message, low=float(grid[0]), high=float(grid[-1]))
    places = [_Place(float(value), result, rest) for value, result, rest in zip(grid, results, rests, strict=True)]
    return SteadyMap(
        system=system.name,
        sweep=sweep,
        output=shown,
        values=np.array([value for value, result in zip(grid, results, strict=True) if isinstance(result, Trim)]),
        trims=tuple(result for result in results if isinstance(result, Trim)),
        missing=tuple(result for result in results if isinstance(result, Missing)),
        boundaries=tuple(_find_boundaries(places, sweep_input, tolerance)),
    )


def _checked_values(sweep: Variable, values: ArrayLike) -> Floats:
    grid = np.array(values, dtype=float)
    if grid.ndim != 1 or grid.size < 2:
        message = f"values of {sweep.name} have shape {grid.shape}; give a list of at least two"
        raise InvalidInputError(message)
    if not np.isfinite(grid).all():
        message = f"values of {sweep.name} hold {grid[~np.isfinite(grid)][0]:g}; give finite ones"
        raise InvalidInputError(message)
    if not np.all(np.diff(grid) > 0.0):
        message = f"values of {sweep.name} do not rise strictly; sort them and give each once"
        raise InvalidInputError(message)
    for end in (grid[0], grid[-1]):
        check_range(sweep, float(end))
    return grid


@dataclass(frozen=True, slots=True)
class _Place:
    """What is known at one value of the swept input."""

    value: float
    result: Trim | Missing
    rests: Rests


def _chosen(values: Sequence[float] | Floats, rests: Sequence[Rests], near: Mapping[str, float] | None = None) -> list[Trim | Missing]:
    """Choose at each value the trim nearest to the one before."""
    results: list[Trim | Missing] = []
    last = dict(near or {})
    for value, rest in zip(values, rests, strict=True):
        try:
            trim = rest.choose(last)
        except NoTrimError as error:
            results.append(Missing(value=float(value), reason=str(error)))
        except RevlineError as error:
            results.append(Undecided(value=float(value), reason=str(error)))
        else:
            last = _named_states(trim)
            results.append(trim)
    return results


def _reason(results: list[Trim | Missing]) -> str:
    return next(result.reason for result in results if isinstance(result, Missing))


def _named_states(trim: Trim) -> dict[str, float]:
    return {variable.name: float(value) for variable, value in zip(trim.state_variables, trim.states, strict=True)}


def _find_boundaries(places: Sequence[_Place], sweep_input: str, tolerance: float) -> list[Boundary]:
    """Enclose an end between each pair of neighbours, of those decided, of which one has a steady state and the other none."""
    boundaries = []
    for pair in itertools.pairwise(place for place in places if not isinstance(place.result, Undecided)):
        for inside, outside in (pair, pair[::-1]):
            if isinstance(inside.result, Trim) and isinstance(outside.result, Missing):
                start = Boundary(value=inside.value, trim=inside.result, without=outside.result)
                known = np.concatenate([place.rests.search.solutions for place in (inside, outside)])
                boundaries.append(_enclose(inside.rests.equations, start, known, (sweep_input, tolerance)))
    return boundaries


def _enclose(equations: SteadyEquations, start: Boundary, known: Floats, asked: tuple[str, float]) -> Boundary:
    """Find where steady states end: first by following those known, then by a full search on both sides of where that leads.

    What the full search says counts; where it contradicts, the rest is bisected with full searches. Where the middle is undecided,
    other values between are tried; where none of them helps, the end stays as wide as it is then known.
    """
    system, (sweep_input, tolerance), boundary = equations.system, asked, start
    others = {variable.name: float(value) for variable, value in zip(system.inputs, equations.known, strict=True)}

    def narrowed(boundary: Boundary, values: Sequence[float]) -> Boundary:
        rests = find_rests_along(system, [{**others, sweep_input: value} for value in values])
        for value, rest in zip(values, rests, strict=True):
            if not min(boundary.value, boundary.without.value) < value < max(boundary.value, boundary.without.value):
                continue
            (result,) = _chosen([value], [rest], _named_states(boundary.trim))
            if isinstance(result, Trim):
                boundary = replace(boundary, value=value, trim=result)
            elif isinstance(result, Undecided):
                boundary = replace(boundary, undecided=result.reason)
            else:
                boundary = replace(boundary, without=result)
        return boundary

    values = _follow_to_the_end(system, (boundary.value, boundary.without.value), known, (others, *asked))
    boundary = narrowed(boundary, values)
    for _ in range(BISECTIONS):
        ends = (boundary.value, boundary.without.value)
        if abs(ends[0] - ends[1]) <= tolerance:
            break
        boundary = narrowed(boundary, [0.5 * (ends[0] + ends[1])])
        if (boundary.value, boundary.without.value) == ends:
            boundary = narrowed(boundary, np.linspace(*ends, PARTS + 1)[1:-1].tolist())
        if (boundary.value, boundary.without.value) == ends:
            return boundary
    return replace(boundary, undecided="")


def _follow_to_the_end(
    system: DelaySystem, ends: tuple[float, float], known: Floats, asked: tuple[Mapping[str, float], str, float]
) -> tuple[float, float]:
    """Two values between which the steady states known leave the search range or end, as near as asked for."""
    inside, outside = ends
    others, sweep_input, tolerance = asked
    for _ in range(BISECTIONS):
        if abs(inside - outside) <= tolerance:
            break
        values = np.linspace(inside, outside, PARTS + 1)
        reached = follow_each(system, [{**others, sweep_input: float(value)} for value in values[1:-1]], known)
        first = next((k for k, (found, _) in enumerate(reached) if not found), PARTS - 1)
        inside, outside = float(values[first]), float(values[first + 1])
        known = np.concatenate([known[:0], *(solutions for _, solutions in reached[max(first - 1, 0) : first + 1])])
        if not len(known):
            break
    return inside, outside
