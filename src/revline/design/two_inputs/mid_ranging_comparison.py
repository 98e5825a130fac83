"""Mid-ranging beside the slow input alone after a step of the load, on the plant that both were designed on and on others.

Both controllers are made for the same bound on Ms from the same exact model, and run on the same nonlinear plant.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from revline.analysis.trim import Trim
from revline.design.two_inputs.load_steps import LoadStep, LoadStepRun, LoopCase, StalledRun, fast_limits, run_load_step
from revline.design.two_inputs.mid_ranging import MidRangingDesign
from revline.design.two_inputs.mid_ranging_margins import (
    MidRangingMargins,
    confirm_design,
    find_mid_ranging_margins,
    law_of,
    law_of_slow_alone,
)
from revline.design.two_inputs.two_output_system import OutputRange
from revline.errors import InvalidInputError
from revline.system import DelaySystem

Progress = Callable[[float], None]


class PlantCase(NamedTuple):
    """A plant that the design is tried on: its name, itself, and its trim, which is that of the design."""

    name: str
    system: DelaySystem
    trim: Trim


class OutputLimits(NamedTuple):
    """Limits of both inputs; none given for the fast one: as far back from its set-point as it is to the best value."""

    fast_low: float | None = None
    fast_high: float | None = None
    slow_low: float = -float("inf")
    slow_high: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantComparison:
    """Both controllers on one plant.

    Attributes:
        name: of the plant.
        margins: of both controllers, with the plant's delays exact.
        both: what mid-ranging did.
        alone: what the slow input alone did.
    """

    name: str
    margins: MidRangingMargins
    both: LoadStepRun | StalledRun
    alone: LoadStepRun | StalledRun

    @property
    def runs(self) -> tuple[LoadStepRun | StalledRun, LoadStepRun | StalledRun]:
        """What both controllers did."""
        return self.both, self.alone


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MidRangingComparison:
    """A design, and what it does after a step of the load on one or more plants, the first being its own.

    Attributes:
        design: both controllers.
        task: the step of the load.
        fast_range, slow_range: values at rest and limits of both inputs.
        plants: one entry for each.
    """

    design: MidRangingDesign
    task: LoadStep
    fast_range: OutputRange
    slow_range: OutputRange
    plants: tuple[PlantComparison, ...]

    @property
    def own(self) -> PlantComparison:
        """What happened on the plant of the design."""
        return self.plants[0]

    def all_warnings(self) -> tuple[str, ...]:
        """Say what limits the linear model, limits near by among it, and then `warnings`."""
        linear = self.design.linear
        return (*linear.warnings(linear.find_limits()), *self.warnings())

    def warnings(self) -> tuple[str, ...]:
        """Say what limits the result: limits that were touched, loops that are unstable, stalled, or not at rest by the end."""
        found = []
        for plant in self.plants:
            if not plant.margins.stable:
                found.append(f"{plant.name}: the linear loop is unstable, with both inputs or with {self.design.signals.fast} at its limit")
            if not plant.margins.loops["slow alone"].stable:
                found.append(f"{plant.name}: the linear loop of {self.design.signals.slow} alone is unstable")
            for run in plant.runs:
                found += [f"{plant.name}, {run.name}: {text}" for text in _remarks(run, self.design)]
        return tuple(found)


def _remarks(run: LoadStepRun | StalledRun, design: MidRangingDesign) -> list[str]:
    if isinstance(run, StalledRun):
        return [f"stalls at {run.stalled.time:.4g} s"]
    fast, slow = design.signals.fast, design.signals.slow
    found = [
        f"{name} stands at its limit for {100.0 * share:.2g} % of the record"
        for name, share in ((fast, run.fast_saturated), (slow, run.slow_saturated))
        if share > 0.0
    ]
    if run.settling_time is None:
        found.append(f"{design.signals.measurement} is not settled within {run.task.until:g} s; give a later stop time")
    if run.return_time is None:
        found.append(f"{fast} is not back at its set-point within {run.task.until:g} s; give a later stop time")
    return found


def compare_mid_ranging(
    design: MidRangingDesign,
    plants: Sequence[PlantCase],
    task: LoadStep,
    *,
    limits: OutputLimits = OutputLimits(),  # noqa: B008 - an immutable tuple
    progress: Progress | None = None,
) -> MidRangingComparison:
    """Run both controllers of a design after a step of the load.

    Args:
        design: both controllers.
        plants: the design's own first; others have its trim.
        task: the step of the load.
        limits: of both inputs.
        progress: told which part is done, 0 to 1.

    Raises:
        InvalidInputError: there is no plant, or limits exclude the trim or the range in which the fast input acts with one sign.
        NotConvergedError: the design does not keep its bounds on its own plant, or a margin or a simulation did not converge.
    """
    if not plants:
        message = "no plant to compare the controllers on; give the design's own first"
        raise InvalidInputError(message)
    signals, reserve = design.signals, design.reserve
    ranges = (
        fast_limits(reserve, limits.fast_low, limits.fast_high),
        OutputRange(plants[0].trim.input(signals.slow), limits.slow_low, limits.slow_high),
    )
    laws = (
        (f"{signals.fast} and {signals.slow}", law_of(design.gains, reserve.sign)),
        (f"{signals.slow} alone", law_of_slow_alone(design)),
    )
    compared = []
    for k, (name, system, trim) in enumerate(plants):
        margins = find_mid_ranging_margins(design, system, trim, name=name) if k else confirm_design(design, system, trim)
        both, alone = (
            run_load_step(LoopCase(text, system, law, trim), task, reserve=reserve, ranges=ranges, signals=signals) for text, law in laws
        )
        compared.append(PlantComparison(name=name, margins=margins, both=both, alone=alone))
        if progress is not None:
            progress((k + 1) / len(plants))
    return MidRangingComparison(design=design, task=task, fast_range=ranges[0], slow_range=ranges[1], plants=tuple(compared))
