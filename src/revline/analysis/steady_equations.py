"""The equations that hold at rest, and Newton on them from many starts at once."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from revline.analysis.jacobians import differentiate, evaluate, settle_channels
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

PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53)


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """An output or a state that is held at a value."""

    variable: Variable
    index: int
    is_state: bool
    value: float
    scale: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
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

    @property
    def unknowns(self) -> tuple[Variable, ...]:
        """States, then free inputs."""
        return (*self.system.states, *(self.system.inputs[k] for k in self.free))

    @property
    def scales(self) -> Floats:
        """Search ranges of the unknowns."""
        return np.array([search_scale(variable) for variable in self.unknowns])

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """Where the unknowns mean anything: their ranges, and where these have no end one search range more."""
        lows, highs = [], []
        for variable in self.unknowns:
            room = search_scale(variable)
            lows.append(variable.low if math.isfinite(variable.low) else variable.search_low - room)
            highs.append(variable.high if math.isfinite(variable.high) else variable.search_high + room)
        return np.array(lows), np.array(highs)

    def split(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Give states and all inputs; unknowns along the last axis."""
        count = len(self.system.states)
        inputs = np.broadcast_to(self.known, (*unknowns.shape[:-1], self.known.size)).copy()
        inputs[..., list(self.free)] = unknowns[..., count:]
        return unknowns[..., :count].copy(), inputs

    def channels(self, unknowns: Floats) -> Floats:
        """What the channels carry at rest."""
        return settle_channels(self.system, *self.split(unknowns))

    def misses(self, unknowns: Floats) -> Floats:
        """Scaled rates, then scaled misses of the targets; unknowns along the last axis."""
        x, u = self.split(unknowns)
        zd = settle_channels(self.system, x, u)
        count = len(self.system.states)
        rates = evaluate(self.system, self.system.rate, x, u, zd) / self.scales[:count]
        if not self.targets:
            return rates
        outputs = evaluate(self.system, self.system.output, x, u, zd)
        held = [((x if t.is_state else outputs)[..., t.index] - t.value) / t.scale for t in self.targets]
        return np.concatenate((rates, np.stack(held, axis=-1)), axis=-1)

    def slopes(self, unknowns: Floats) -> Floats:
        """Derivatives of `misses` with respect to scaled unknowns, channels following."""
        x, u = self.split(unknowns)
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
    points = _newton(equations, starts)
    misses = np.max(np.abs(np.nan_to_num(equations.misses(points), nan=np.inf)), axis=-1, initial=0.0)
    closest = points[int(np.argmin(misses))]
    solved = points[misses <= DRIFT_LIMIT]
    if not len(solved):
        return Search(solutions=solved, closest=closest, isolated=True)
    spread = np.linalg.svd(equations.slopes(solved), compute_uv=False)
    isolated = np.min(spread, axis=-1, initial=np.inf) > SINGULAR * np.max(spread, axis=-1, initial=0.0)
    return Search(solutions=_distinct(solved[isolated], equations.scales), closest=closest, isolated=bool(np.all(isolated)))


def _newton(equations: SteadyEquations, starts: Floats) -> Floats:
    points, scales = starts.copy(), equations.scales
    low, high = equations.limits
    active, found = np.arange(len(points)), equations.misses(points)
    fractions = np.array([1.0, 0.5, 0.25, 0.0625, 0.015625])
    for _ in range(MOST_STEPS):
        here, misses = points[active], found[active]
        steps = solve_each(equations.slopes(here), -misses) * scales
        trials = np.clip(here[:, None, :] + fractions[:, None] * steps[:, None, :], low, high)
        missed = equations.misses(trials)
        sizes = _size(missed)
        before = _size(misses)
        better = sizes < (1.0 - 1e-4 * fractions) * before[:, None]
        chosen = np.argmax(better, axis=1)
        rows = np.arange(active.size)
        moves = better[rows, chosen]
        points[active[moves]], found[active[moves]] = trials[rows, chosen][moves], missed[rows, chosen][moves]
        active = active[moves & (sizes[rows, chosen] > ROUNDING)]
        if not active.size:
            break
    return points


def _size(misses: Floats) -> Floats:
    """Euclidean size; infinite where an equation has no value."""
    return np.linalg.norm(np.nan_to_num(misses, nan=np.inf, posinf=np.inf, neginf=np.inf), axis=-1)


def _distinct(solutions: Floats, scales: Floats) -> Floats:
    kept: list[Floats] = []
    for solution in solutions:
        if all(np.max(np.abs(solution - other) / scales, initial=0.0) > SAME for other in kept):
            kept.append(solution)
    return np.array(kept).reshape(len(kept), scales.size)


def _inner_range(variable: Variable) -> tuple[float, float]:
    """The search range, or the range where there is none; without end on a side, the nominal value stands in."""
    for low, high in ((variable.search_low, variable.search_high), (variable.low, variable.high)):
        if math.isfinite(low) and math.isfinite(high):
            return low, high
    nominal = min(max(variable.nominal, variable.low), variable.high)
    return nominal, nominal


def halton(count: int, dimensions: int) -> Floats:
    """Spread points evenly over the unit cube.

    Args:
        count: how many.
        dimensions: of the cube; beyond 16 the sequences repeat, shifted.

    Returns:
        Array of shape (count, dimensions), values above 0 and below 1.

    Source:
        Halton (1960), Numerische Mathematik 2, 84-90.
    """
    points = np.empty((count, dimensions))
    for axis in range(dimensions):
        base = PRIMES[axis % len(PRIMES)]
        digits, fraction = np.arange(1, count + 1) + 7 * (axis // len(PRIMES)), 1.0
        values = np.zeros(count)
        while np.any(digits > 0):
            fraction /= base
            values += fraction * (digits % base)
            digits //= base
        points[:, axis] = values
    return points
