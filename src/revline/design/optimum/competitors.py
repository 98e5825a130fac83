"""Controllers held against the optimum under their own bounds: is there anything better of the same form and robustness?"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.controller import PidGains
from revline.design.optimum.loop_cost import Cost, LoopGrid, Terms, find_errors, fit_horizon
from revline.design.optimum.optimise import Optimum, cost_of, optimise
from revline.design.optimum.optimum_problem import Bounds, Objective, Scale
from revline.design.stability.margins import Margins, find_margins
from revline.design.tuning.tuning_plant import TuningPlant
from revline.errors import RevlineError

Floats = NDArray[np.float64]


class LoadResponse(NamedTuple):
    """Deviation of the measurement after a unit step of the load: times in s and values, shape (n,)."""

    times: Floats
    values: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Competitor:
    """A controller, and the best of its form with its maximum sensitivity and its set-point error as bounds.

    Attributes:
        name: of the controller.
        gains: its own.
        cost: what it costs.
        optimum: the best of its form (PI where it has no derivative) under those bounds.
        response, best_response: after a unit step of the load, its own and the optimum's.
        margins: of the optimum's exact loop, by another way than the optimisation's.
    """

    name: str
    gains: PidGains
    cost: Cost
    optimum: Optimum
    response: LoadResponse
    best_response: LoadResponse
    margins: Margins

    @property
    def ratio(self) -> float:
        """Load error of the optimum over that of the controller."""
        return self.optimum.cost / self.cost.load


class Unmatched(NamedTuple):
    """A controller that no optimum could be held against, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Controllers held against the optimum.

    Attributes:
        plant: its name.
        competitors: those that could be.
        left_out: the others, each with its reason.
    """

    plant: str
    competitors: tuple[Competitor, ...]
    left_out: tuple[Unmatched, ...]


def compare_with_competitors(plant: TuningPlant, grid: LoopGrid, scale: Scale, rivals: Mapping[str, PidGains]) -> Comparison:
    """Minimise the load error under each controller's own maximum sensitivity and set-point error.

    The optimum has the form of the controller: its derivative acts on the measurement, its set-point weight is 1, and it has a derivative
    only where the controller has one.

    Args:
        plant: from `tuning_plant`.
        grid: of the same plant, from `make_grid`.
        scale: from `find_scale`.
        rivals: controllers by name.
    """
    found, left_out = [], []
    for name, gains in rivals.items():
        try:
            found.append(_compete(plant, grid, scale, name, gains))
        except RevlineError as error:
            left_out.append(Unmatched(name, str(error)))
    return Comparison(plant=plant.name, competitors=tuple(found), left_out=tuple(left_out))


def _compete(plant: TuningPlant, grid: LoopGrid, scale: Scale, name: str, gains: PidGains) -> Competitor:
    cost = cost_of(grid, gains)
    optimum = optimise(
        (grid,),
        scale,
        Bounds(ms=float(cost.sensitivity.max()), setpoint_iae=cost.setpoint),
        Objective.LOAD,
        free=("kp", "ki", "kd") if gains.kd != 0.0 else ("kp", "ki"),
        starts=(Terms(gains.kp, gains.ki, gains.kd, 1.0),),
    )
    margins = find_margins(plant.loop(optimum.gains(gains), filter_time=grid.filter_time))
    return Competitor(
        name=name,
        gains=gains,
        cost=cost,
        optimum=optimum,
        response=_respond(grid, Terms(gains.kp, gains.ki, gains.kd, 1.0)),
        best_response=_respond(grid, optimum.terms),
        margins=margins,
    )


def _respond(grid: LoopGrid, terms: Terms) -> LoadResponse:
    times, load, _ = find_errors(fit_horizon(grid, terms), terms)
    shown = times <= grid.horizon
    return LoadResponse(times[shown], load[shown])
