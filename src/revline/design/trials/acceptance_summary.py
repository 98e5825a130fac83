"""What the acceptance battery measured at each operating point, as arrays for tables and figures."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.scheduled_pid import law_of
from revline.design.trials.acceptance import Acceptance, AcceptanceRun, Kind
from revline.values import make_read_only

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaceSummary:
    """The runs at one operating point.

    Attributes:
        place: inputs at the trim, by name.
        kinds: of the runs that came to their end, in their order, shape (n,).
        overshoot: of these, as fractions of the command's step, shape (n,).
        settling: the longer of both settling times of each, in s, infinite where it does not settle; shape (n,).
        droop: largest deviation after the load's step, in the measurement's unit, shape (n,).
        travel: of the drive, in its unit, shape (n,).
        saturated: shares of the samples at which the output was at a limit, shape (n,).
        ended: runs that ended before their time.
        unstable: unstable roots of the linear loop as the samples see it; 0 where it is stable.
        ms: maximum sensitivity of the linear loop, if it is stable: one number or none.
        reserve_db: measured distance of the gains from hunting, if it was measured: one number or none.
    """

    place: tuple[tuple[str, float], ...]
    kinds: tuple[Kind, ...]
    overshoot: Floats
    settling: Floats
    droop: Floats
    travel: Floats
    saturated: Floats
    ended: int
    unstable: int
    ms: tuple[float, ...]
    reserve_db: tuple[float, ...]

    def __post_init__(self) -> None:
        make_read_only(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AcceptanceSummary:
    """A verdict in short.

    Attributes:
        controller: the rule that its gains are from.
        passed: the verdict.
        runs: how many were made.
        kept: how many of these kept everything.
        places: the operating points, in their order.
        limits: largest overshoot, settling time and droop allowed, and least reserve in dB; infinite for any.
        reasons: what was not kept, in words.
    """

    controller: str
    passed: bool
    runs: int
    kept: int
    places: tuple[PlaceSummary, ...]
    limits: tuple[float, float, float, float]
    reasons: tuple[str, ...]


def summarise_acceptance(found: Acceptance) -> AcceptanceSummary:
    """Give a verdict in short, with the measures of all runs at each place.

    Args:
        found: the verdict.
    """
    wish = found.battery.requirements
    return AcceptanceSummary(
        controller=law_of(found.controller).gains.rule,
        passed=found.passed,
        runs=len(found.runs),
        kept=sum(run.passed for run in found.runs),
        places=tuple(_summarise(found, k) for k in range(len(found.linear))),
        limits=(wish.overshoot, wish.settling_time, wish.droop, wish.gain_reserve_db),
        reasons=found.reasons,
    )


def _summarise(found: Acceptance, position: int) -> PlaceSummary:
    linear = found.linear[position]
    runs = [run for run in found.runs if run.case.place == linear.place]
    whole = [(run.case.kind, run.measures) for run in runs if run.measures is not None]
    margins = linear.margins.margins

    def measured(name: str) -> Floats:
        return np.array([float(getattr(measures, name)) for _, measures in whole])

    return PlaceSummary(
        place=tuple((name, float(value)) for name, value in linear.place.items()),
        kinds=tuple(kind for kind, _ in whole),
        overshoot=measured("overshoot"),
        settling=np.maximum(measured("command_settling_time"), measured("load_settling_time")),
        droop=measured("droop"),
        travel=measured("travel"),
        saturated=measured("saturated_share"),
        ended=_count_ended(runs),
        unstable=0 if margins.stable else round(margins.unstable_poles),
        ms=(float(margins.sensitivity.value),) if margins.stable else (),
        reserve_db=tuple(r.decibels for r in found.reserves if r.place == linear.place and math.isfinite(r.decibels)),
    )


def _count_ended(runs: list[AcceptanceRun]) -> int:
    return sum(run.measures is None for run in runs)
