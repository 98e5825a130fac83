"""Speed held against a load by spark at once and throttle for good, beside the throttle alone, at the study's operating point."""

from dataclasses import dataclass
from typing import Any

from revline.analysis.trim import find_trim
from revline.design.two_inputs.load_steps import LoadStep, LoadStepRun
from revline.design.two_inputs.mid_ranging import MidRangingBounds, design_mid_ranging
from revline.design.two_inputs.mid_ranging_comparison import (
    MidRangingComparison,
    OutputLimits,
    PlantCase,
    PlantComparison,
    compare_mid_ranging,
)
from revline.engine.lee1995 import lee1995_parameters
from revline.io.mid_ranging_records import plant_fields
from revline.report.mid_ranging import plot_load_steps
from revline.studies.config import StudyConfig
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.results import NotFound, attempt
from revline.system import DelaySystem

FIGURE = "7.12"

SPARK = -20.0
"""Set-point of the spark in deg from that of best torque: it must hold torque back to have some in reserve."""

LOAD_STEP = 10.0
"""Step of the load in N m."""

MS = 2.0
"""Bound of the maximum sensitivity of every loop."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TwoInputsResult:
    """Mid-ranging beside the throttle alone.

    Attributes:
        plants: margins and runs on the engine; nothing where there is no design.
        spark: its set-point, in deg.
        limited_by: what a quicker slow loop would break, in words.
        warnings: what limits the result.
        missing: why there is no design.
    """

    plants: tuple[PlantComparison, ...]
    spark: float
    limited_by: str
    warnings: tuple[str, ...]
    missing: tuple[NotFound, ...]

    @property
    def is_drawn(self) -> bool:
        """Whether a run came to its end."""
        return any(isinstance(run, LoadStepRun) for plant in self.plants for run in plant.runs)


def find_two_inputs(engine: DelaySystem, config: StudyConfig) -> TwoInputsResult:
    """Design mid-ranging at the operating point with the spark held back, and run it after a step of the load."""
    found, missing = attempt("mid-ranging", lambda: _compare(engine, config))
    return TwoInputsResult(
        plants=tuple(one.own for one in found),
        spark=SPARK,
        limited_by=found[0].design.limiting if found else "",
        warnings=tuple(text for one in found for text in one.all_warnings()),
        missing=missing,
    )


def _compare(engine: DelaySystem, config: StudyConfig) -> MidRangingComparison:
    trim = find_trim(engine, inputs={"throttle": config.throttle_deg, "load_torque": config.load_n_m, "spark": SPARK})
    design = design_mid_ranging(engine, trim, bounds=MidRangingBounds(ms=MS))
    limits = OutputLimits(slow_low=0.0, slow_high=lee1995_parameters(engine).throttle.saturation_angle)
    return compare_mid_ranging(design, [PlantCase("nominal", engine, trim)], LoadStep(size=LOAD_STEP), limits=limits)


def two_inputs_fields(found: TwoInputsResult) -> dict[str, Any]:
    """The field `two_inputs` of results.json."""
    record: dict[str, Any] = {"spark_deg": found.spark, "load_step_n_m": LOAD_STEP, "ms_bound": MS}
    if found.missing:
        return {"two_inputs": record | {"not_found": [one._asdict() for one in found.missing]}}
    plants = [plant_fields(plant) for plant in found.plants]
    return {"two_inputs": record | {"limited_by": found.limited_by, "plants": plants, "warnings": list(found.warnings)}}


def two_inputs_figures(found: TwoInputsResult) -> dict[str, FigureCall]:
    """The figure of the load steps, where there is one."""
    return {FIGURE: to_draw(plot_load_steps, found.plants[0].runs)} if found.is_drawn else {}


def two_inputs_words(found: TwoInputsResult) -> str:
    """What the spark gains, in a sentence."""
    for plant in found.plants:
        both, alone = plant.runs
        if isinstance(both, LoadStepRun) and isinstance(alone, LoadStepRun):
            return (
                f"After a load of {LOAD_STEP:g} N m the speed falls by {both.droop:.2f} rad/s with spark and throttle, by "
                f"{alone.droop:.2f} with the throttle alone; the integrated error is {both.integrated_error:.3g} against "
                f"{alone.integrated_error:.3g} rad."
            )
        stalled = " and ".join(run.name for run in plant.runs if not isinstance(run, LoadStepRun))
        return f"After a load of {LOAD_STEP:g} N m the engine stalls with {stalled}."
    return "".join(f"No design was found: {one.reason}" for one in found.missing)
