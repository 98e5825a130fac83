"""Optimised controllers and comparisons with them as records for JSON."""

from collections.abc import Mapping, Sequence
from typing import Final

from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, PidController
from revline.design.optimum.competitors import Comparison, Competitor
from revline.design.optimum.loop_cost import Cost
from revline.design.optimum.optimise import Optimum
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import OpenLoop
from revline.design.tuning.tuning_plant import TuningPlant
from revline.errors import NotConvergedError
from revline.io.controller_files import controller_record

SCHEMA: Final = "revline.optimum-comparison/1"


def optimum_record(
    best: Optimum, plants: Sequence[TuningPlant], *, filter_time: float, objective: str, provenance: Mapping[str, float | str]
) -> Mapping[str, object]:
    """Give an optimised controller as the content of a controller file, with what it rests on.

    Args:
        best: what was found.
        plants: it was found for.
        filter_time: of the derivative, in s.
        objective: what was minimised.
        provenance: what writes it, from what.
    """
    names = ", ".join(plant.name for plant in plants)
    blank = PidGains(
        kp=0.0, ki=0.0, kd=0.0, input_unit=plants[0].output_unit, output_unit=plants[0].input_unit, rule="optimised", designed_on=names
    )
    gains = best.gains(blank)
    controller = PidController(gains=gains, setpoint_weight=best.terms.b, filter_time=filter_time, anti_windup=AntiWindup.NONE)
    points = []
    for k, plant in enumerate(plants):
        evidence = {"horizon_s": best.grids[k].horizon, "change_by_half_the_frequencies": best.accuracies[k].change}
        points.append({"point": plant.name, **_cost(best.costs[k]), **evidence, **_exact(plant.loop(gains, filter_time=filter_time))})
    return {
        **controller_record(controller, provenance=provenance),
        "objective": objective,
        "cost": best.cost,
        "points": points,
        "active_bounds": _active(best),
        "residual": best.residual,
        "agreement": best.agreement,
        "searches": best.searches,
        "evaluations": best.evaluations,
    }


def _exact(loop: OpenLoop) -> Mapping[str, object]:
    """Stability and peak by another way than the optimisation's."""
    try:
        return {"ms_exact": find_margins(loop).sensitivity.value, "stable": loop.stable}
    except NotConvergedError as error:  # a long delay and a hardly filtered derivative: too many turns to follow each
        return {"stable": loop.stable, "no_exact_margins": str(error)}


def comparison_record(found: Comparison, *, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give controllers held against the optimum as a record.

    Args:
        found: the comparison.
        provenance: what writes it, from what.
    """
    return {
        "schema": SCHEMA,
        "plant": found.plant,
        "competitors": [_competitor(one) for one in found.competitors],
        "left_out": [one._asdict() for one in found.left_out],
        "provenance": provenance,
    }


def _competitor(one: Competitor) -> Mapping[str, object]:
    best = one.optimum
    return {
        "name": one.name,
        "kp": one.gains.kp,
        "ki": one.gains.ki,
        "kd": one.gains.kd,
        **_cost(one.cost),
        "optimum": {
            "kp": best.terms.kp,
            "ki": best.terms.ki,
            "kd": best.terms.kd,
            **_cost(best.costs[0]),
            "ms_exact": one.margins.sensitivity.value,
            "stable": one.margins.stable,
            "active_bounds": _active(best),
            "residual": best.residual,
            "agreement": best.agreement,
        },
        "ratio": one.ratio,
    }


def _cost(cost: Cost) -> dict[str, object]:
    return {
        "load_iae": cost.load,
        "setpoint_iae": cost.setpoint,
        "ms": float(cost.sensitivity.max()),
        "mt": float(cost.complementary.max()),
        "tail": cost.tail,
    }


def _active(best: Optimum) -> list[Mapping[str, object]]:
    return [
        {"measure": bound.measure.value, "point": bound.point + 1, "bound": bound.bound, "cost_per_unit": bound.sensitivity}
        for bound in best.active
    ]
