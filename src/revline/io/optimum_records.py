"""Optimised controllers and comparisons with them as records for JSON."""

from collections.abc import Mapping, Sequence
from typing import Final

from revline.design.competitors import Comparison, Competitor
from revline.design.controller import PidGains
from revline.design.loop_cost import Cost
from revline.design.margins import find_margins
from revline.design.optimise import Optimum
from revline.design.pid_controller import AntiWindup, PidController
from revline.design.tuning_plant import TuningPlant
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
    points = [{"point": plant.name, **_cost(cost)} for plant, cost in zip(plants, best.costs, strict=True)]
    exact = [find_margins(plant.loop(gains)) for plant in plants] if filter_time == 0.0 else []
    for point, margins in zip(points, exact, strict=False):
        point |= {"ms_exact": margins.sensitivity.value, "stable": margins.stable}
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
