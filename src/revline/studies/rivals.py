"""The study's controllers and every tuning rule beside the optimum of their form, and the ultimate gain by every way."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim
from revline.design.optimum.competitors import Comparison, Competitor, compare_with_competitors
from revline.design.optimum.optimum_problem import find_scale, make_grid
from revline.design.tuning.relay import RelayTask
from revline.design.tuning.rule_comparison import RefusedRule, compare_rules
from revline.design.tuning.tuning_plant import TuningPlant, tuning_plant
from revline.design.tuning.ultimate_comparison import UltimateComparison, compare_ultimate_points
from revline.io.optimum_records import comparison_record
from revline.io.ultimate_records import ultimate_record
from revline.report.optimum import plot_comparison
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.results import ControllersResult, NotFound, PointResult, attempt, title
from revline.system import DelaySystem

FIGURE = "7.8"
CONTROLLERS = ("c1", "c2", "c2d")

RELAY = RelayTask(amplitude=1.0, until=8.0)
"""The relay moves the throttle by 1 deg."""

SMALL_STEP = 0.1
"""Step of the command in rad/s at which the bisection looks for hunting: so small that the engine is nearly linear."""

CLOSE = 1.001
"""An optimum that does not fall short of a controller by more than this part counts as no worse: the costs' own accuracy."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RivalsResult:
    """Controllers beside their optima on the engine's exact linear model at the operating point, and its ultimate gain.

    Attributes:
        compared: controllers of the study, then rules.
        refused: rules that are not for this engine.
        ultimate: the ultimate gain by every way; nothing where it was not found.
        missing: what was not found.
    """

    compared: Comparison
    refused: tuple[RefusedRule, ...]
    ultimate: tuple[UltimateComparison, ...]
    missing: tuple[NotFound, ...]

    @property
    def beaten(self) -> tuple[Competitor, ...]:
        """Controllers whose optimum has the lower load error."""
        return tuple(one for one in self.compared.competitors if one.ratio * CLOSE < 1.0)


def find_rivals(engine: DelaySystem, point: PointResult, controllers: ControllersResult) -> RivalsResult:
    """Hold every controller and every rule against the optimum with its maximum sensitivity and set-point error as bounds.

    Raises:
        AnalysisError: no loop about this engine has a cost.
    """
    plant = plant_at(engine, point.trim)
    grid, rules = make_grid(plant.plant), compare_rules(plant)
    rivals = {title(name): controllers.gains[name] for name in CONTROLLERS} | {one.rule: one.gains for one in rules.tuned}
    compared = compare_with_competitors(plant, grid, find_scale(plant), MappingProxyType(rivals))
    kept = replace(compared, competitors=tuple(replace(one, optimum=replace(one.optimum, grids=())) for one in compared.competitors))
    ultimate, missing = attempt("ultimate gain", lambda: compare_ultimate_points(engine, point.trim, RELAY, command=SMALL_STEP))
    return RivalsResult(compared=kept, refused=rules.refused, ultimate=ultimate, missing=missing)


def plant_at(engine: DelaySystem, trim: Trim) -> TuningPlant:
    """The engine's exact linear model at a trim as a plant that controllers are tuned for."""
    return tuning_plant(linearize(engine, trim).model, name="the engine's exact linear model")


def rivals_fields(found: RivalsResult, *, engine: str, place: tuple[float, float]) -> dict[str, Any]:
    """The fields `optimum_comparison` and `ultimate_gain` of results.json."""
    compared = {
        key: value for key, value in comparison_record(found.compared, provenance={}).items() if key not in {"schema", "provenance"}
    }
    record: dict[str, Any] = {
        "optimum_comparison": compared | {"refused_rules": [{"rule": one.rule, "reason": one.reason} for one in found.refused]}
    }
    for ultimate in found.ultimate:
        fields = ultimate_record(ultimate, engine=engine, place=place, provenance={})
        record["ultimate_gain"] = {key: value for key, value in fields.items() if key not in {"schema", "provenance", "engine"}}
    return record


def rivals_figure(found: RivalsResult) -> FigureCall:
    """The figure of controllers beside their optima."""
    return to_draw(plot_comparison, found.compared)


def rivals_words(found: RivalsResult) -> str:
    """What the optimum gains over the controllers, in sentences."""
    return " ".join(_sentences(found))


def _sentences(found: RivalsResult) -> Iterator[str]:
    rows, beaten = found.compared.competitors, found.beaten
    if not rows:
        yield "No controller of the study and no rule keeps this engine stable, so that there is nothing to compare."
    elif not beaten:
        yield f"Each of the {len(rows)} controllers and rules that keep the loop stable is the best of its form."
    else:
        most = min(beaten, key=lambda one: one.ratio)
        yield (
            f"Of {len(rows)} controllers and rules that keep the loop stable, {len(beaten)} leave something to gain at no cost in "
            f"robustness: most of all {most.name}, whose error after a load falls to {100.0 * most.ratio:.0f} %."
        )
