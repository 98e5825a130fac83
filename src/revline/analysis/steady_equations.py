"""The equations that hold at rest, and Newton on them from many starts at once."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from revline.analysis.halton import halton
from revline.analysis.jacobians import COMPLEX_STEP, Matrix, differentiate, reads_channels, settle_channels
from revline.analysis.linearize import DRIFT_LIMIT, rate_unit, search_scale
from revline.equations import Equation
from revline.errors import InvalidInputError
from revline.lti.batches import solve_each
from revline.system import DelaySystem, Floats, Variable

MOST_STEPS = 25
ROUNDING = 1e-15
"""Misses this small are rounding."""

SAME = 1e-6
"""Two solutions nearer than this, in search ranges, are one."""

SINGULAR = 1e-12
"""A smallest singular value below this fraction of the largest: the solution is not isolated."""

FRACTIONS = (1.0, 0.5, 0.25, 0.0625, 0.015625)
"""Parts of Newton's step; the first that brings the misses down is taken."""

DIFFERENCE = 6e-6
"""Steps of differences, in search ranges: a cube root of the rounding of numbers."""

FEW = 16
"""So many points cost as little as one: all parts of their steps are tried at once."""

NEARLY = 0.99
"""A step that would cross a limit goes this part of the way to it. Source: Nocedal and Wright (2006), chapter 19."""

AT_ONCE = 512
"""So many searches go on together at most, which bounds the memory that they take."""

DECREASE = 1e-4
"""A step counts when it takes this part of itself off the misses."""

Vector = tuple[Any, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """An output or a state that is held at a value."""

    variable: Variable
    index: int
    is_state: bool
    value: float
    scale: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyEquations:
    """Rates that vanish and targets that are met, in the unknown states and free inputs; all scaled by search ranges.

    Attributes:
        system: any system.
        known: all inputs; the entries of free ones do not matter.
        free: positions of the free inputs.
        targets: as many as free inputs.
    """

    system: DelaySystem
    known: Floats
    free: tuple[int, ...]
    targets: tuple[Target, ...]

    @cached_property
    def unknowns(self) -> tuple[Variable, ...]:
        """States, then free inputs."""
        return (*self.system.states, *(self.system.inputs[k] for k in self.free))

    @cached_property
    def scales(self) -> Floats:
        """Search ranges of the unknowns."""
        return np.array([search_scale(variable) for variable in self.unknowns])

    @cached_property
    def limits(self) -> tuple[Floats, Floats]:
        """Where the unknowns mean anything: their ranges, and where these have no end one search range more."""
        lows, highs = [], []
        for variable in self.unknowns:
            room = search_scale(variable)
            lows.append(variable.low if math.isfinite(variable.low) else variable.search_low - room)
            highs.append(variable.high if math.isfinite(variable.high) else variable.search_high + room)
        return np.array(lows), np.array(highs)

    def split(self, unknowns: Floats, known: Floats | None = None) -> tuple[Floats, Floats]:
        """Give states and all inputs; unknowns along the last axis, and known inputs for each point where they differ."""
        count = len(self.system.states)
        given = self.known if known is None else known
        inputs = np.broadcast_to(given, (*unknowns.shape[:-1], given.shape[-1])).copy()
        inputs[..., list(self.free)] = unknowns[..., count:]
        return unknowns[..., :count].copy(), inputs

    def channels(self, unknowns: Floats, known: Floats | None = None) -> Floats:
        """What the channels carry at rest."""
        return settle_channels(self.system, *self.split(unknowns, known))

    @cached_property
    def sizes(self) -> Floats:
        """What misses are related to: search ranges of the states, then of the targets."""
        return np.array([*self.scales[: len(self.system.states)], *(target.scale for target in self.targets)])

    def misses(self, unknowns: Floats, known: Floats | None = None) -> Floats:
        """Scaled rates, then scaled misses of the targets; unknowns along the last axis."""
        x, u = self.split(unknowns, known)
        zd = settle_channels(self.system, x, u)
        with np.errstate(all="ignore"):
            return self._missed(_parts(x), _parts(u), _parts(zd), np.empty((*unknowns.shape[:-1], self.sizes.size)))

    def _missed(self, x: Vector, u: Vector, zd: Vector, missed: Matrix) -> Matrix:
        """Fill in the misses, real or complex."""
        system = self.system
        results = list(system.rate(system.parameters, x, u, zd))
        outputs = system.output(system.parameters, x, u, zd) if any(not t.is_state for t in self.targets) else ()
        results += [(x if t.is_state else outputs)[t.index] - t.value for t in self.targets]
        for k, result in enumerate(results):
            missed[..., k] = result
        missed /= self.sizes
        return missed

    def misses_and_slopes(self, unknowns: Floats, known: Floats | None = None) -> tuple[Floats, Floats]:
        """Give `misses`, and their derivatives with respect to scaled unknowns, channels following.

        Args:
            unknowns: of shape (points, unknowns).
            known: inputs of each point, where they differ.

        Returns:
            Of shapes (points, equations) and (points, equations, unknowns).
        """
        if reads_channels(self.system) or not self.unknowns:
            return self.misses(unknowns, known), self._slopes_of_loops(unknowns, known)
        # Every unknown takes an imaginary step in turn, and the channels carry it on: one pass through each equation gives all.
        slopes = np.moveaxis(self._missed_in_one_pass(unknowns + self._imaginary_steps, known).imag, 0, -1) / COMPLEX_STEP
        # Misses are those of real numbers: a root of what is negative has a value among complex ones, and none here.
        return self._missed_in_one_pass(unknowns, known), self._mend(slopes, unknowns, known)

    def _missed_in_one_pass(self, unknowns: Matrix, known: Floats | None) -> Matrix:
        """Give `misses` where no channel reads another, of real or complex unknowns."""
        system, count = self.system, len(self.system.states)
        x, u = _parts(unknowns[..., :count]), list(self.known if known is None else known.T)
        for k, value in zip(self.free, _parts(unknowns[..., count:]), strict=True):
            u[k] = value
        with np.errstate(all="ignore"):
            zd = tuple(system.emit(system.parameters, x, tuple(u), (np.float64(0.0),) * len(system.channels)))
            return self._missed(x, tuple(u), zd, np.empty((*unknowns.shape[:-1], self.sizes.size), dtype=unknowns.dtype))

    def _mend(self, slopes: Matrix, unknowns: Floats, known: Floats | None) -> Floats:
        """Take differences where complex numbers go beyond their range before real ones do, as in 1/(1 + exp(500))."""
        lost = ~np.all(np.isfinite(slopes), axis=(-2, -1))
        if np.any(lost):
            centre, rows = unknowns[lost], None if known is None else known[lost]
            for k, step in enumerate(DIFFERENCE * np.diag(self.scales)):
                low, high = np.maximum(centre - step, self.limits[0]), np.minimum(centre + step, self.limits[1])
                with np.errstate(all="ignore"):
                    rise = (self.misses(high, rows) - self.misses(low, rows)) / (high - low)[:, k, None]
                slopes[lost, :, k] = rise * self.scales[k]
        return slopes

    @cached_property
    def _imaginary_steps(self) -> Matrix:
        return np.asarray(1j * COMPLEX_STEP * np.diag(self.scales)[:, None, :])

    def _slopes_of_loops(self, unknowns: Floats, known: Floats | None) -> Floats:
        """The derivatives where channels read channels."""
        x, u = self.split(unknowns, known)
        zd = settle_channels(self.system, x, u)
        free, count = list(self.free), len(self.system.states)

        def columns(function: Equation) -> tuple[Floats, Floats]:
            by_state, by_input, by_reading = differentiate(self.system, function, x, u, zd)
            return np.concatenate((by_state, by_input[..., free]), axis=-1), by_reading

        entering, looping = columns(self.system.emit)
        carried = solve_each(np.eye(zd.shape[-1]) - looping, entering)
        rates, rates_read = columns(self.system.rate)
        rows = [(rates + rates_read @ carried) / self.scales[:count, None]]
        if self.targets:
            direct, direct_read = columns(self.system.output)
            outputs = direct + direct_read @ carried
            states = np.broadcast_to(np.eye(count, len(self.unknowns)), (*x.shape[:-1], count, len(self.unknowns)))
            rows += [(states if t.is_state else outputs)[..., t.index, None, :] / t.scale for t in self.targets]
        return np.concatenate(rows, axis=-2) * self.scales

    def starts(self, count: int, wanted: Mapping[int, float]) -> Floats:
        """Spread starting points over the search ranges, and some beyond, where a range goes on.

        Args:
            count: how many inside the search range.
            wanted: values of some states, by position, for one more start.

        Raises:
            InvalidInputError: `count` is not positive.
        """
        if count < 1:
            message = f"{count} starts asked for; ask for at least 1"
            raise InvalidInputError(message, starts=count)
        inner = np.array([_inner_range(variable) for variable in self.unknowns]).reshape(-1, 2)
        boxes = [inner] * count
        for k, (low, high) in enumerate(zip(*self.limits, strict=True)):
            for margin in ((low, inner[k, 0]), (inner[k, 1], high)):
                if margin[0] < margin[1] and np.all(np.isfinite(margin)):
                    box = inner.copy()
                    box[k] = margin
                    boxes += [box] * (count // 4)
        shape = np.array(boxes)
        points = halton(len(boxes), len(inner))
        spread = shape[..., 0] + points * (shape[..., 1] - shape[..., 0])
        if wanted:
            named = np.mean(shape[:1], axis=-1)
            for k, value in wanted.items():
                named[0, k] = value
            spread = np.concatenate((named, spread))
        return spread

    def describe(self) -> str:
        """Say what was asked for: what is held, then the inputs that are not at their nominal values."""
        asked = [f"{t.variable.name} = {t.value:g} {t.variable.unit}" for t in self.targets]
        given = [
            f"{variable.name} = {value:g} {variable.unit}"
            for k, (variable, value) in enumerate(zip(self.system.inputs, self.known, strict=True))
            if k not in self.free and value != variable.nominal
        ]
        return ", ".join((*asked, *given)) or "nominal inputs"

    def worst(self, unknowns: Floats) -> tuple[float, float, str]:
        """Say which equation is missed most, by how much, and the limit."""
        misses = self.misses(unknowns)
        k = int(np.argmax(np.abs(misses)))
        count = len(self.system.states)
        if k < count:
            variable, scale = self.system.states[k], float(self.scales[k])
            verb, unit = "still drifts by", rate_unit(variable)
        else:
            target = self.targets[k - count]
            variable, scale = target.variable, target.scale
            verb, unit = "still misses its value by", variable.unit
        size, limit = abs(float(misses[k])) * scale, DRIFT_LIMIT * scale
        return size, limit, f"{variable.name} {verb} {size:.3g} {unit} (limit {limit:.1g} {unit})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """What Newton found from all starts.

    Attributes:
        solutions: distinct ones, one in each row.
        closest: the point that came nearest to being one.
        isolated: whether no start ended where solutions form a continuum.
    """

    solutions: Floats
    closest: Floats
    isolated: bool


def solve_steady(equations: SteadyEquations, starts: Floats) -> Search:
    """Run damped Newton from many starts at once, inside the unknowns' ranges.

    Args:
        equations: what holds at rest.
        starts: one in each row.

    Returns:
        All distinct solutions reached.

    Source:
        Newton with backtracking: Dennis and Schnabel (1983), Numerical Methods for Unconstrained Optimization, section 6.3.
    """
    (search,) = solve_steady_each(equations, equations.known[None], (starts,))
    return search


def solve_steady_each(equations: SteadyEquations, known: Floats, starts: Sequence[Floats]) -> tuple[Search, ...]:
    """Solve the same equations at many known inputs as `solve_steady` does at one, all at once.

    Args:
        equations: what holds at rest; its own known inputs are not used.
        known: all inputs, one row for each search.
        starts: of each search, one in each row; at least one.

    Returns:
        For each row of inputs all distinct solutions reached.
    """
    parts = [slice(first, first + AT_ONCE) for first in range(0, len(starts), AT_ONCE)]
    return tuple(search for part in parts for search in _solve_part(equations, known[part], starts[part]))


def _solve_part(equations: SteadyEquations, known: Floats, starts: Sequence[Floats]) -> list[Search]:
    ends = np.cumsum([len(rows) for rows in starts])
    owners = np.repeat(np.arange(len(starts)), np.diff(ends, prepend=0))
    begun, given = np.concatenate(starts), known[owners] if len(known) > 1 else None
    equations = replace(equations, known=known[0])
    points = _newton(equations, begun, given)
    missed = np.nan_to_num(equations.misses(points, given), nan=np.inf)
    misses = np.max(np.abs(missed), axis=-1, initial=0.0)
    solved = misses <= DRIFT_LIMIT
    isolated = solved.copy()
    if np.any(solved):
        sloped = equations.misses_and_slopes(points[solved], None if given is None else given[solved])[1]
        # Without a slope nothing is known of a continuum; the solution is kept, and what it lacks is named where it is used.
        usable = np.all(np.isfinite(sloped), axis=(-2, -1), keepdims=True)
        spread = np.linalg.svd(np.where(usable, sloped, np.eye(len(equations.unknowns))), compute_uv=False)
        isolated[solved] = np.min(spread, axis=-1, initial=np.inf) > SINGULAR * np.max(spread, axis=-1, initial=0.0)
    found = []
    for first, last in zip((0, *ends[:-1]), ends, strict=True):
        own, kept = points[first:last], isolated[first:last]
        solutions = _distinct(own[kept], equations.scales)
        whole = bool(np.array_equal(kept, solved[first:last]))
        found.append(Search(solutions=solutions, closest=own[int(np.argmin(misses[first:last]))].copy(), isolated=whole))
    return found


def _newton(equations: SteadyEquations, starts: Floats, known: Floats | None) -> Floats:
    """Newton from each start; `known` holds the inputs of each, where they differ."""
    points, scales = starts.copy(), equations.scales
    low, high = equations.limits
    active = np.arange(len(points) if scales.size else 0)
    found, slopes = equations.misses_and_slopes(points, known)
    sizes = _size(found)
    for _ in range(MOST_STEPS):
        if not active.size:
            break
        steps = solve_each(slopes[active], -found[active]) * scales
        gone = []
        # Few points are tried with all parts of their steps at once, many first with the whole step.
        for fractions in (FRACTIONS,) if active.size <= FEW else (FRACTIONS[:1], FRACTIONS[1:]):
            parts = np.array(fractions)[:, None]
            trials = _stepped(points[active], parts[..., None] * steps, (low, high)).reshape(-1, scales.size)
            inputs = None if known is None else known[np.broadcast_to(active, (len(parts), active.size)).ravel()]
            missed, sloped = equations.misses_and_slopes(trials, inputs)
            tried = _size(missed)
            better = tried.reshape(len(parts), -1) < (1.0 - DECREASE * parts) * sizes[active]
            chosen, columns = np.argmax(better, axis=0), np.arange(active.size)
            moves = better[chosen, columns]
            flat, rows = (chosen * active.size + columns)[moves], active[moves]
            points[rows], found[rows], slopes[rows], sizes[rows] = trials[flat], missed[flat], sloped[flat], tried[flat]
            gone.append(rows)
            active, steps = active[~moves], steps[~moves]
            if not active.size:
                break
        active = np.concatenate(gone)
        active = active[sizes[active] > ROUNDING]
    return points


def _stepped(points: Floats, steps: Floats, limits: tuple[Floats, Floats]) -> Floats:
    """Go on from each point, but never onto a limit where the step leads beyond: an equation may be infinitely steep there."""
    low, high = limits
    ends = points + steps
    inside = np.minimum(np.maximum(ends, low), high)
    return np.asarray(np.where(inside != ends, points + NEARLY * (inside - points), inside))


def _parts(values: Matrix) -> Vector:
    """One array for each entry of the last axis."""
    return tuple(values[..., k] for k in range(values.shape[-1]))


def _size(misses: Floats) -> Floats:
    """Euclidean size; infinite where an equation has no value."""
    squares = np.sum(misses * misses, axis=-1)
    return np.sqrt(np.where(np.isfinite(squares), squares, np.inf))


def merge_solutions(known: Floats, found: Floats, scales: Floats) -> Floats:
    """Add to known solutions, one in each row, those found that are not among them."""
    return _distinct(np.concatenate((known, found)), scales)


def _distinct(solutions: Floats, scales: Floats) -> Floats:
    kept: list[Floats] = []
    while len(solutions):
        kept.append(solutions[0])
        solutions = solutions[np.max(np.abs(solutions - solutions[0]) / scales, axis=-1, initial=0.0) > SAME]
    return np.array(kept).reshape(len(kept), scales.size)


def _inner_range(variable: Variable) -> tuple[float, float]:
    """The search range, or the range where there is none; without end on a side, the nominal value stands in."""
    for low, high in ((variable.search_low, variable.search_high), (variable.low, variable.high)):
        if math.isfinite(low) and math.isfinite(high):
            return low, high
    nominal = min(max(variable.nominal, variable.low), variable.high)
    return nominal, nominal
