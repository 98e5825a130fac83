"""The problem that an optimisation solves, in the plant's own scale of gains: cost, bounds, and their gradients."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.optimum.loop_cost import GAINS, Complexes, Cost, LoopGrid, Source, Terms, find_cost
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.tuning.tuning_plant import TuningPlant
from revline.errors import InvalidInputError, out_of_range
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace, position
from revline.lti.transfer_function import TransferFunction
from revline.units import Seconds

Floats = NDArray[np.float64]

PENALTY = 1e3
"""Cost of an unstable loop: far above any that is stable."""

LARGEST = 50.0
"""No gain is larger than this multiple of the plant's own scale in a first search."""

LEAST_INTEGRAL = 1e-4
"""Without integral action a load leaves an error for ever: it never is less than this in the plant's scale."""

TIME_CONSTANTS = 14.0
"""Horizon in the plant's slowest lag, or its delay where that is longer."""


class Objective(Enum):
    """What is minimised."""

    LOAD = "load"
    SETPOINT = "setpoint"
    BOTH = "both"
    """The sum of both, each in its own unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Upper bounds at each operating point; infinity for none.

    Attributes:
        ms, mt: peaks of |S| and |T|.
        effort: peak of |C S|, in the control's unit per the measurement's: what noise does to the control at worst.
        load_iae, setpoint_iae: integrated absolute errors after unit steps.

    Raises:
        InvalidInputError: a bound allows nothing.
    """

    ms: float = math.inf
    mt: float = math.inf
    effort: float = math.inf
    load_iae: float = math.inf
    setpoint_iae: float = math.inf

    def __post_init__(self) -> None:
        for name, value, least in (
            ("Ms", self.ms, 1.0),
            ("Mt", self.mt, 0.0),
            ("effort", self.effort, 0.0),
            ("load IAE", self.load_iae, 0.0),
            ("set-point IAE", self.setpoint_iae, 0.0),
        ):
            if not value > least:
                raise out_of_range(f"bound of {name}", value, "", f"values above {least:g}", "no loop can keep it; give a larger one")


class Scale(NamedTuple):
    """The plant's own size of each gain: half the ultimate gain, that over half the period, that times an eighth of it; b is 1."""

    kp: float
    ki: float
    kd: float
    b: float = 1.0


class Candidate(NamedTuple):
    """A place that was tried: its cost, by how much it passes its bounds (as a part), and the costs of each point."""

    place: Floats
    cost: float
    violation: float
    costs: tuple[Cost, ...]


class Constraint(NamedTuple):
    """One bound at one point and bin: the logarithm of bound over value (negative where it is passed), and its slope."""

    measure: str
    point: int
    bound: float
    value: float
    slope: Floats


@dataclass(kw_only=True)
class Problem:
    """Cost and bounds over the free gains, in the plant's scale; of several points the largest cost counts, as a last unknown."""

    grids: Sequence[LoopGrid]
    scale: Floats
    bounds: Bounds
    objective: Objective
    free: tuple[int, ...]
    base: Floats
    largest: float = LARGEST
    best: Candidate | None = None
    evaluations: int = 0
    _memory: dict[bytes, tuple[Cost, ...]] = field(default_factory=dict)

    @classmethod
    def make(
        cls, grids: Sequence[LoopGrid], scale: Scale, bounds: Bounds, objective: Objective, *, free: tuple[str, ...], base: Terms
    ) -> "Problem":
        """Check what is asked and state the problem.

        Raises:
            InvalidInputError: a name is unknown or there is none, there is no point, or the effort has no bound that means anything.
        """
        unknown = [name for name in free if name not in GAINS]
        if unknown or not free or len(set(free)) < len(free):
            message = f"what is free is {', '.join(free) or 'nothing'}; it is one or more of {', '.join(GAINS)}, each once"
            raise InvalidInputError(message)
        if not grids:
            message = "there is no operating point to optimise for; give one"
            raise InvalidInputError(message)
        if "ki" not in free and not base.ki > 0.0:
            message = "without integral action a load leaves an error for ever, so that nothing can be minimised; leave ki free or give it"
            raise InvalidInputError(message)
        derivative = "kd" in free or base.kd != 0.0
        if math.isfinite(bounds.effort) and derivative and any(grid.filter_time == 0.0 for grid in grids):
            message = "an ideal derivative makes the effort |C S| infinite at high frequency; give a filter time, or leave kd out"
            raise InvalidInputError(message)
        return cls(
            grids=grids,
            scale=np.array(scale, dtype=float),
            bounds=bounds,
            objective=objective,
            free=tuple(GAINS.index(name) for name in free),
            base=np.array(base, dtype=float),
        )

    @property
    def box(self) -> list[tuple[float, float]]:
        """Range of each unknown."""
        lowest = {GAINS.index("kp"): -self.largest, GAINS.index("ki"): LEAST_INTEGRAL}
        return [(lowest.get(k, 0.0), 1.0 if k == 3 else self.largest) for k in self.free]

    def pack(self, terms: Terms) -> Floats:
        """Unknowns of some gains."""
        return np.array([terms[k] / self.scale[k] for k in self.free])

    def unpack(self, place: Floats) -> Terms:
        """Gains of some unknowns."""
        values = self.base.copy()
        for k, value in zip(self.free, place, strict=True):
            values[k] = value * self.scale[k]
        return Terms(*values.tolist())

    def costs(self, place: Floats) -> tuple[Cost, ...]:
        """Costs at each point; what is asked twice is computed once."""
        key = place.tobytes()
        if key not in self._memory:
            self.evaluations += len(self.grids)
            terms = self.unpack(np.maximum(place, [low for low, _ in self.box]))
            self._memory.clear()
            self._memory[key] = tuple(find_cost(grid, terms) for grid in self.grids)
            self._keep(place, self._memory[key])
        return self._memory[key]

    def forget(self) -> None:
        """Forget the best place, before another search."""
        self.best = None

    def seen(self) -> list[Candidate]:
        """The best place since then; none where no loop was stable."""
        return [] if self.best is None else [self.best]

    def value(self, place: Floats) -> float:
        """The cost: the largest of all points."""
        found = self.costs(place)
        if not all(cost.stable for cost in found):
            return PENALTY * (1.0 + float(np.sum(np.abs(place))))
        return max(self._cost(cost) for cost in found)

    def slope(self, place: Floats) -> Floats:
        """Gradient of the cost over the unknowns."""
        found = self.costs(place)
        if not all(cost.stable for cost in found):
            return np.full(len(self.free), PENALTY)
        return self._slope(max(found, key=self._cost))

    def slopes_of_worst(self, place: Floats, part: float) -> list[Floats]:
        """Gradients of the costs of all points that cost the most, or less than that by a small part."""
        found = self.costs(place)
        most = max(self._cost(cost) for cost in found)
        return [self._slope(cost) for cost in found if self._cost(cost) >= (1.0 - part) * most]

    def _slope(self, cost: Cost) -> Floats:
        load, setpoint = cost.gradients[0], cost.gradients[1]
        whole = {Objective.LOAD: load, Objective.SETPOINT: setpoint, Objective.BOTH: load + setpoint}[self.objective]
        return self._free(whole)

    def constraints(self, place: Floats) -> Floats:
        """How far each bound is kept, as a logarithm."""
        return np.array([entry.value for entry in constraint_values(self, place)] or [1.0])

    def constraint_slopes(self, place: Floats) -> Floats:
        """Gradients of the constraints."""
        rows = [entry.slope for entry in constraint_values(self, place)]
        return np.stack(rows) if rows else np.zeros((1, len(self.free)))

    def _cost(self, cost: Cost) -> float:
        return {Objective.LOAD: cost.load, Objective.SETPOINT: cost.setpoint, Objective.BOTH: cost.load + cost.setpoint}[self.objective]

    def _free(self, gradient: Floats) -> Floats:
        return np.array([gradient[k] * self.scale[k] for k in self.free])

    def _keep(self, place: Floats, costs: tuple[Cost, ...]) -> None:
        """Remember the best place that keeps all bounds, else the one that passes them least."""
        if not all(cost.stable for cost in costs) or any(value < low for value, (low, _) in zip(place, self.box, strict=True)):
            return
        violation = max(0.0, -min((entry.value for entry in _entries(self, costs)), default=0.0))
        found = Candidate(place.copy(), max(self._cost(cost) for cost in costs), violation, costs)
        before = self.best
        if before is None or _rank(found) < _rank(before):
            self.best = found


def constraint_values(problem: Problem, place: Floats) -> list[Constraint]:
    """All bounds at a place, of each point and bin."""
    return _entries(problem, problem.costs(place))


def _rank(candidate: Candidate) -> tuple[float, float]:
    """Those that keep the bounds come first, by cost; then the others, by how far they pass them."""
    return (0.0, candidate.cost) if candidate.violation <= 5e-7 else (candidate.violation, candidate.cost)


def _entries(problem: Problem, costs: tuple[Cost, ...]) -> list[Constraint]:
    bounds = problem.bounds
    found = []
    for point, cost in enumerate(costs):
        wholes = (("load_iae", bounds.load_iae, cost.load, 0), ("setpoint_iae", bounds.setpoint_iae, cost.setpoint, 1))
        for name, bound, value, row in wholes:
            if math.isfinite(bound):
                slope = problem._free(-cost.gradients[row] / value)  # noqa: SLF001 - the problem's own arithmetic
                found.append(Constraint(name, point, bound, math.log(bound / value), slope))
        peaks = (
            ("ms", bounds.ms, cost.sensitivity, 2),
            ("mt", bounds.mt, cost.complementary, 3),
            ("effort", bounds.effort, cost.effort, 4),
        )
        for name, bound, values, row in peaks:
            if math.isfinite(bound):
                for value, gradient in zip(values, cost.gradients[row], strict=True):
                    slope = problem._free(-gradient / value)  # noqa: SLF001 - the problem's own arithmetic
                    found.append(Constraint(name, point, bound, math.log(bound / value), slope))
    return found


def make_grid(
    plant: DelayStateSpace | TransferFunction,
    *,
    load: str = "load_torque",
    wires: LoopSignals = SPEED_BY_THROTTLE,
    filter_time: Seconds = 0.0,
    horizon: Seconds | None = None,
) -> LoopGrid:
    """Evaluate a plant exactly where costs are computed.

    Args:
        plant: linearised, with the load among its inputs; or a transfer function, at whose input the load acts.
        load: name of the load's input.
        wires: which signals close the loop.
        filter_time: of the derivative, in s.
        horizon: over which errors are integrated, in s; some of the plant's slowest time constants, or delays, by default.

    Raises:
        InvalidInputError: the plant has no such signals or integrates, or the horizon is none.
    """
    if isinstance(plant, TransferFunction):
        roots, delay = plant.poles, plant.delay
        unstable = int(np.count_nonzero(roots.real > 0.0))
    else:
        found = characteristic_roots(plant)
        roots, unstable, delay = found.roots, int(found.unstable_count), float(np.sum(plant.lags))
    if np.any(roots == 0.0):
        message = "the plant integrates (pole at s = 0), and costs are computed for plants that come to rest only; use a tuning rule"
        raise InvalidInputError(message)
    slowest = float(np.min(np.abs(roots.real), initial=math.inf, where=roots.real != 0.0))
    span = TIME_CONSTANTS * max(1.0 / slowest, delay) if horizon is None else horizon
    return LoopGrid.make(_source(plant, load, wires), span, filter_time=filter_time, unstable_poles=unstable, poles=roots)


def _source(plant: DelayStateSpace | TransferFunction, load: str, wires: LoopSignals) -> Source:
    """A plant's responses to control and load."""
    if isinstance(plant, TransferFunction):

        def alike(s: Complexes) -> tuple[Complexes, Complexes]:
            values = np.asarray(plant(s))
            return values, values

        return alike
    drive, acts = position(plant.inputs, wires.drive), position(plant.inputs, load)
    row = position(plant.outputs, wires.measurement)

    def apart(s: Complexes) -> tuple[Complexes, Complexes]:
        whole = plant.transfer(s)[:, row]
        return np.asarray(whole[:, drive]), np.asarray(whole[:, acts])

    return apart


def find_scale(plant: TuningPlant) -> Scale:
    """Find the plant's own size of each gain from its ultimate point.

    Raises:
        AnalysisError: it has none.
    """
    point = plant.ultimate
    half = 0.5 * point.gain
    return Scale(kp=half, ki=2.0 * half / point.period, kd=half * point.period / 8.0)
