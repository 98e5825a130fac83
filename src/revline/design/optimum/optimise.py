"""Gains that cost least under bounds on the peaks, on the exact plant, for one operating point or the worst of several.

Source: Astrom, Panagopoulos and Hagglund (1998), Automatica 34(5), 585-601, for the problem; Kraft (1988), DFVLR-FB 88-28, for the method.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls

from revline.design.controllers.controller import PidGains
from revline.design.optimum.loop_cost import GAINS, Accuracy, Cost, LoopGrid, Terms, find_accuracy, find_cost, fit_horizon
from revline.design.optimum.optimum_problem import LARGEST, Bounds, Candidate, Objective, Problem, Scale, constraint_values
from revline.errors import InvalidInputError, NotConvergedError
from revline.values import make_read_only

Floats = NDArray[np.float64]

STARTS = ((0.3, 0.3, 0.1, 1.0), (0.6, 0.6, 0.6, 1.0), (0.2, 0.1, 0.3, 0.5))
"""Where searches begin, in the plant's own scale of gains."""

FEASIBLE = 1e-6
"""Bounds may be passed by this part: the search's own accuracy."""

AGREE = 1e-3
"""Searches whose costs differ by less than this part count as one."""

SAME = 1e-4
"""Bounds that are nearer than this part are active, and points whose costs differ by less cost the same."""

HEAVY = 1e3
"""Weight of the condition that weights of points add up to 1."""

ROUGH, STEPS = 40, 60
"""Steps of each search, and of the last one from the best of them."""


ASIDE = (0.7, 1.4)
"""From the best place the search goes on with ki by these factors aside: an integral of absolute values has many small valleys."""

ROUNDS = 6
"""Searches at most until the horizons suit the best gains and these are inside what is looked at."""

WIDER = 10.0
"""By this factor the largest gain that is looked at rises where the best ones lie there."""


class Measure(Enum):
    """What a bound is on."""

    MS = "ms"
    MT = "mt"
    EFFORT = "effort"
    LOAD_IAE = "load_iae"
    SETPOINT_IAE = "setpoint_iae"


@dataclass(frozen=True, slots=True, kw_only=True)
class ActiveBound:
    """A bound that the optimum lies on.

    Attributes:
        measure: what is bounded.
        point: at which operating point, by position.
        bound: its value.
        sensitivity: how the cost changes per unit of the bound; negative: a looser bound costs less.
    """

    measure: Measure
    point: int
    bound: float
    sensitivity: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optimum:
    """The best gains that were found, with what says so.

    Attributes:
        terms: kp, ki, kd and the set-point weight.
        cost: what was minimised.
        costs: of each operating point.
        grids: on which they were computed, of each point; their horizons may be others than those that were given.
        accuracies: what the costs are worth, of each point.
        active: bounds that it lies on, with what each costs.
        residual: of the conditions of optimality, as a part of the cost or of its gradient in the plant's scale, whichever is larger: 0
            at an exact optimum.
        agreement: part of the searches that ended at the same cost.
        searches: how many were made.
        evaluations: of the cost of a loop.
    """

    terms: Terms
    cost: float
    costs: tuple[Cost, ...]
    grids: tuple[LoopGrid, ...]
    accuracies: tuple[Accuracy, ...]
    active: tuple[ActiveBound, ...]
    residual: float
    agreement: float
    searches: int
    evaluations: int

    def __post_init__(self) -> None:
        make_read_only(self)

    def gains(self, like: PidGains, *, rule: str = "optimised") -> PidGains:
        """Give the gains with the units of others; the set-point weight stands in the details."""
        terms = self.terms
        details: dict[str, float | str] = {"setpoint_weight": terms.b, "cost": self.cost}
        return replace(like, kp=terms.kp, ki=terms.ki, kd=terms.kd, rule=rule, details=details)


def optimise(
    grids: Sequence[LoopGrid],
    scale: Scale,
    bounds: Bounds,
    objective: Objective,
    *,
    free: tuple[str, ...] = ("kp", "ki", "kd"),
    starts: Sequence[Terms] = (),
) -> Optimum:
    """Find the gains of least cost under bounds, at one operating point or for the worst of several.

    Args:
        grids: the plant at each operating point, from `make_grid`; horizons are fitted to the best gains that are found.
        scale: the plant's own size of each gain, from `find_scale`.
        bounds: on the peaks and errors, at each point.
        objective: what is minimised; of several points the largest counts.
        free: names of what may be chosen, of "kp", "ki", "kd", "b"; the others stay as in the first start, by default 0 and b = 1.
        starts: further gains to search from, for example a competitor's.

    Raises:
        InvalidInputError: a name is unknown, or there is no point.
        NotConvergedError: no gains that keep the bounds were found; the message says by how much the nearest ones miss them; or the costs
            of the best are not worth anything on any horizon, see `fit_horizon`.
    """
    largest = LARGEST
    for _ in range(ROUNDS):
        problem = Problem.make(grids, scale, bounds, objective, free=free, base=starts[0] if starts else Terms(0.0, 0.0, 0.0, 1.0))
        problem.largest = largest
        best = _optimise(problem, starts)
        fitted = tuple(fit_horizon(grid, best.terms) for grid in grids)
        edge = any(value > 0.999 * largest for k, value in zip(problem.free, problem.pack(best.terms), strict=True) if GAINS[k] != "b")
        if not edge and all(new is old for new, old in zip(fitted, grids, strict=True)):
            return best
        grids, largest = fitted, largest * WIDER if edge else largest
    message = (
        f"in {ROUNDS} searches the best gains always needed another horizon, or were at {largest / WIDER:g} times the plant's own scale: "
        "bound the peaks closer, or filter the derivative"
    )
    raise NotConvergedError(message)


def _optimise(problem: Problem, starts: Sequence[Terms]) -> Optimum:
    """The same on horizons and within a largest gain that are as they are."""
    grids = problem.grids
    begins = [
        *(problem.pack(terms) for terms in starts),
        *(np.array([start[k] for k in problem.free]) for start in STARTS),
    ]
    ends = [end for begin in begins for end in _search(problem, begin, steps=ROUGH, accuracy=1e-6)]
    kept = [end for end in ends if end.violation <= FEASIBLE]
    if not kept:
        raise _infeasible(problem, ends)
    best = min(kept, key=lambda end: end.cost)
    asides = [best.place * np.where(np.array(problem.free) == GAINS.index("ki"), factor, 1.0) for factor in ASIDE]
    kept += [end for begin in asides for end in _search(problem, begin, steps=ROUGH, accuracy=1e-6) if end.violation <= FEASIBLE]
    best = min(kept, key=lambda end: end.cost)
    alike = sum(end.cost <= (1.0 + AGREE) * best.cost for end in kept)
    best = min([best, *_search(problem, best.place, steps=STEPS, accuracy=1e-10)], key=lambda end: (end.violation > FEASIBLE, end.cost))
    active, residual = _conditions(problem, best)
    searches = len(begins) + len(asides)
    return Optimum(
        terms=problem.unpack(best.place),
        cost=best.cost,
        costs=best.costs,
        grids=tuple(grids),
        accuracies=tuple(find_accuracy(grid, problem.unpack(best.place)) for grid in grids),
        active=active,
        residual=residual,
        agreement=alike / searches,
        searches=searches,
        evaluations=problem.evaluations,
    )


def _search(problem: Problem, begin: Floats, *, steps: int, accuracy: float) -> list[Candidate]:
    """Search from a place; the best that was seen on the way, none where no loop on it was stable."""
    problem.forget()
    minimize(
        problem.value,
        begin,
        jac=problem.slope,
        method="SLSQP",
        bounds=problem.box,
        constraints=({"type": "ineq", "fun": problem.constraints, "jac": problem.constraint_slopes},),
        options={"maxiter": steps, "ftol": accuracy},
    )
    return problem.seen()


def _conditions(problem: Problem, best: Candidate) -> tuple[tuple[ActiveBound, ...], float]:
    """Weigh the active bounds so that their gradients make up the cost's; what is left over is the residual.

    Where several points cost the most, their gradients are weighed too, the weights adding up to 1.
    """
    gradients = np.stack(problem.slopes_of_worst(best.place, SAME), axis=1)
    size = max(float(np.max(np.linalg.norm(gradients, axis=0))), best.cost)
    near = [entry for entry in constraint_values(problem, best.place) if entry.value < SAME]
    inward = np.eye(best.place.size)
    edges = [inward[k] for k, (low, _) in enumerate(problem.box) if best.place[k] - low < 1e-9]
    edges += [-inward[k] for k, (_, high) in enumerate(problem.box) if high - best.place[k] < 1e-9]
    columns = np.stack([*(entry.slope for entry in near), *edges], axis=1) if near or edges else np.zeros((best.place.size, 0))
    share = np.concatenate((np.ones(gradients.shape[1]), np.zeros(columns.shape[1])))
    table = np.concatenate((np.concatenate((-gradients / size, columns / size), axis=1), HEAVY * share[None]))
    weights, _ = nnls(table, np.append(np.zeros(best.place.size), HEAVY))
    left = np.linalg.norm(table[:-1] @ weights)
    active: dict[tuple[Measure, int], ActiveBound] = {}
    for entry, weight in zip(near, weights[gradients.shape[1] :], strict=False):
        key = (Measure(entry.measure), entry.point)
        before = active[key].sensitivity if key in active else 0.0
        active[key] = ActiveBound(measure=key[0], point=entry.point, bound=entry.bound, sensitivity=before - float(weight) / entry.bound)
    return tuple(active.values()), float(left)


def _infeasible(problem: Problem, ends: Sequence[Candidate]) -> NotConvergedError:
    """Say which bound is missed, and by how much at best."""
    if not ends:
        message = "no gains that stabilise the loop were found; give gains to begin from that do"
        return NotConvergedError(message)
    nearest = min(ends, key=lambda end: end.violation)
    worst = min(constraint_values(problem, nearest.place), key=lambda entry: entry.value)
    reached = worst.bound * math.exp(-worst.value)
    message = (
        f"no gains keep all bounds: the nearest found have {worst.measure} = {reached:.4g} where at most {worst.bound:.4g} is allowed"
        f" (point {worst.point + 1}); raise that bound to {1.02 * reached:.3g}, or another that works against it"
    )
    return NotConvergedError(message, measure=worst.measure, bound=worst.bound, reached=reached)


def cost_of(grid: LoopGrid, gains: PidGains, setpoint_weight: float = 1.0) -> Cost:
    """Find what given gains cost.

    Args:
        grid: of the plant; its horizon is fitted to the loop.
        gains: of the controller.
        setpoint_weight: its b.

    Raises:
        InvalidInputError: there is no integral action, so that a load leaves an error for ever, or the loop is unstable.
        NotConvergedError: the loop settles too slowly for its errors to be integrated, see `fit_horizon`.
    """
    if gains.ki == 0.0:
        message = (
            f"{gains.rule} has no integral action: a load leaves an error for ever, and its integral is infinite; give an integral gain"
        )
        raise InvalidInputError(message)
    terms = Terms(gains.kp, gains.ki, gains.kd, setpoint_weight)
    found = find_cost(grid, terms)
    if not found.stable:
        message = f"the loop of {gains.rule} is unstable, so that its errors grow for ever; give gains that stabilise it"
        raise InvalidInputError(message)
    fitted = fit_horizon(grid, terms)
    return found if fitted is grid else find_cost(fitted, terms)
