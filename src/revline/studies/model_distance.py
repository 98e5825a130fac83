"""How far the study's models are from the engine as feedback sees them, and whether their controllers are sure to stabilise it."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from revline.analysis.linearize import linearize
from revline.design.stability.compared_plant import plant_of_model, plant_of_system
from revline.design.stability.nu_gap import Guarantee, judge_controller
from revline.errors import RevlineError
from revline.io.nu_gap_records import summarise
from revline.report.nu_gap import plot_nu_gap
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.results import ControllersResult, ModelsResult, PointResult, title
from revline.studies.stability_results import AT_START, AT_TARGET, StabilityResult
from revline.studies.words import plant_name
from revline.system import DelaySystem

FIGURE = "7.7"
PAIRS = (("c1", "g1"), ("c2", "g2"), ("c2d", "g2d"), ("c2d", "g2"))
"""Controllers with models: those they were designed on, and C2d, designed with the delay, on the model without."""

DRAWN = PAIRS[:3]


class DistanceRow(NamedTuple):
    """A controller's model beside the engine's exact linear model, at one steady state."""

    controller: str
    model: str
    plant: str
    verdict: Guarantee


class NoDistance(NamedTuple):
    """A pair that could not be compared, and why."""

    controller: str
    model: str
    plant: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DistanceResult:
    """All pairs: those that were compared and those that could not be."""

    rows: tuple[DistanceRow, ...]
    missing: tuple[NoDistance, ...]

    def drawn(self) -> list[tuple[str, Guarantee]]:
        """What the figure shows: each controller on the model it was designed on, where the loops start."""
        return [
            (f"{title(row.controller)} on {title(row.model)}", row.verdict)
            for row in self.rows
            if (row.controller, row.model) in DRAWN and row.plant == AT_START
        ]


def find_distances(
    engine: DelaySystem, point: PointResult, models: ModelsResult, controllers: ControllersResult, stability: StabilityResult
) -> DistanceResult:
    """Judge each controller on its model against the engine's exact linear model, where the loops start and where they are led to."""
    places = ((AT_START, point.trim), *((AT_TARGET, trim) for trim in stability.target))
    rows: list[DistanceRow] = []
    missing: list[NoDistance] = []
    for place, trim in places:
        plant = plant_of_system(linearize(engine, trim).model, name=plant_name(place))
        for controller, name in PAIRS:
            try:
                model = plant_of_model(models.fit(name).fit.model, name=title(name))
                rows.append(DistanceRow(controller, name, place, judge_controller(model, plant, controllers.gains[controller])))
            except RevlineError as error:
                missing.append(NoDistance(controller, name, place, str(error)))
    return DistanceResult(rows=tuple(rows), missing=tuple(missing))


def distance_fields(found: DistanceResult) -> list[dict[str, Any]]:
    """The field `model_distances` of results.json; a pair that could not be compared has its reason instead of numbers."""
    rows = [
        {
            "controller": row.controller,
            "model": row.model,
            "plant": row.plant,
            "nu_gap": row.verdict.gap.value,
            "winding": row.verdict.gap.winding,
            "margin": row.verdict.margin,
            "guaranteed": row.verdict.guaranteed,
            "second_margin": row.verdict.other_margin,
            "stable": row.verdict.stable,
        }
        for row in found.rows
    ]
    return rows + [{"controller": m.controller, "model": m.model, "plant": m.plant, "reason": m.reason} for m in found.missing]


def distance_figure(found: DistanceResult) -> FigureCall:
    """The figure of the chords."""
    return to_draw(plot_nu_gap, found.drawn())


def distance_words(found: DistanceResult) -> str:
    """What the gaps say of each controller on the model it was designed on, where the loops start."""
    sentences = [
        summarise(row.verdict, title(row.controller))
        for row in found.rows
        if (row.controller, row.model) in DRAWN and row.plant == AT_START
    ]
    return " ".join(f"{sentence[0].upper()}{sentence[1:]}." for sentence in sentences)
