"""The study's controllers on trial: sampled, limited, with noise and on other engines, each with a verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from revline.analysis.threads import Progress
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import PidController
from revline.design.controllers.scheduled_pid import AnyController, ScheduledController, law_of
from revline.design.optimum.optimise import Optimum, optimise
from revline.design.optimum.optimum_problem import Bounds, Objective, find_scale, make_grid
from revline.design.trials.acceptance import Battery, Requirements, accept
from revline.design.trials.acceptance_summary import AcceptanceSummary, PlaceSummary, summarise_acceptance
from revline.engine.lee1995 import lee1995_parameters
from revline.engine.spread import spread_engine
from revline.report.acceptance import plot_acceptance
from revline.sampled import FixedRate
from revline.studies.config import StudyConfig
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.operating_map import MapResult
from revline.studies.results import ControllersResult, NotFound, PointResult, attempt
from revline.studies.rivals import plant_at
from revline.system import DelaySystem

FIGURE = "7.11"

PERIOD = 5e-3
"""Sampling period in s."""

SPREAD = 0.1
"""Inertia, delays, manifold and torque are changed by this part, one by one."""

MS = 2.0
"""Bound of the optimum that is tried beside C2d. Source of the value: Astrom and Hagglund (2006), section 4.6."""

MAP_WEIGHT = 0.3
"""Set-point weight of the controllers of the map: their integral gain is the largest that the sensitivity allows."""

AT_POINT = Battery()
"""What is tried at the operating point: steps of 10 rad/s and 5 N m."""

OVER_MAP = Battery(command=2.0, load=2.0, until=16.0, requirements=Requirements(settling_time=6.0))
"""What is tried over the map: smaller steps, which its weakest points can still follow, and more time."""

FIXED, SCHEDULE = "fixed", "schedule"
"""One set of gains, in the box of the map that it holds, and the schedule over the map."""


class Trial(NamedTuple):
    """A controller on trial: its name, how it may rise to the command, and the verdict."""

    name: str
    setpoint_weight: float
    summary: AcceptanceSummary


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialsResult:
    """All trials.

    Attributes:
        optimum: gains of least error with Ms at most 2; nothing where they were not found.
        trials: each controller's; the schedule's over the map last.
        missing: controllers that could not be tried.
    """

    optimum: tuple[Optimum, ...]
    trials: tuple[Trial, ...]
    missing: tuple[NotFound, ...]

    def trial(self, name: str) -> Trial | None:
        """The trial of a controller; nothing where there is none."""
        return next((one for one in self.trials if one.name == name), None)


def try_controllers(
    engine: DelaySystem, point: PointResult, controllers: ControllersResult, found: MapResult, *, config: StudyConfig, progress: Progress
) -> TrialsResult:
    """Try C2d and an optimum at the operating point, fixed gains at the corners of their box, and the schedule over the map."""
    plants = {engine.name: engine, **spread_engine(engine, SPREAD)}
    optimum, missing = attempt("optimum", lambda: _find_optimum(engine, point))
    here = [{"throttle": config.throttle_deg, "load_torque": config.load_n_m}]
    tasks: list[tuple[str, AnyController, Sequence[Mapping[str, float]], Battery]] = [
        ("c2d", _sampled(engine, controllers.gains["c2d"]), here, AT_POINT)
    ]
    tasks += [("optimum", _of_optimum(engine, best, controllers.gains["c2d"]), here, AT_POINT) for best in optimum]
    none = replace(controllers.gains["c2d"], kp=0.0, ki=0.0, kd=0.0, designed_on=engine.name)
    over_map: list[tuple[str, AnyController, Sequence[tuple[float, float]]]] = [
        (FIXED, _for_map(engine, replace(none, kp=box.kp, ki=box.ki, kd=box.kd, rule=FIXED)), box.box.corners) for box in found.box
    ]
    law = _for_map(engine, replace(none, rule=SCHEDULE))
    over_map += [(SCHEDULE, ScheduledController(schedule=one.schedule, controller=law), map_points(config)) for one in found.schedule]
    for kind, law_over_map, points in over_map:
        at_rest, lost = rest_places(plants, kind, points)
        tasks += [(kind, law_over_map, at_rest, OVER_MAP)] if at_rest else []
        missing += lost
    trials: list[Trial] = []
    for k, (name, controller, places, battery) in enumerate(tasks):
        progress(k / len(tasks))
        summary, reasons = attempt(name, lambda c=controller, p=places, b=battery: _try(plants, c, p, b))  # type: ignore[misc]  # loop's values
        missing += reasons
        trials += [Trial(name, law_of(controller).setpoint_weight, one) for one in summary]
    kept = tuple(replace(best, grids=()) for best in optimum)
    return TrialsResult(optimum=kept, trials=tuple(trials), missing=missing)


def _try(
    plants: Mapping[str, DelaySystem], controller: AnyController, places: Sequence[Mapping[str, float]], battery: Battery
) -> AcceptanceSummary:
    return summarise_acceptance(accept(plants, controller, places, battery))


def _find_optimum(engine: DelaySystem, point: PointResult) -> Optimum:
    plant = plant_at(engine, point.trim)
    return optimise((make_grid(plant.plant),), find_scale(plant), Bounds(ms=MS), Objective.BOTH, free=("kp", "ki", "b"))


def _sampled(engine: DelaySystem, gains: PidGains) -> PidController:
    """Gains as an engine computer runs them, within what the throttle can do."""
    high = lee1995_parameters(engine).throttle.saturation_angle
    return PidController(gains=gains, low=0.0, high=high, sampling=FixedRate(period=PERIOD))


def _of_optimum(engine: DelaySystem, best: Optimum, like: PidGains) -> PidController:
    gains = replace(best.gains(like), rule=f"optimised, Ms at most {MS:g}")
    return replace(_sampled(engine, gains), setpoint_weight=best.terms.b)


def _for_map(engine: DelaySystem, gains: PidGains) -> PidController:
    return replace(_sampled(engine, gains), setpoint_weight=MAP_WEIGHT)


def map_points(config: StudyConfig) -> list[tuple[float, float]]:
    """Throttle and load between the lines of the map and at its end, at the smallest and the largest load."""
    angles, loads = config.map_throttle_deg, config.map_load_n_m
    chosen = (0.5 * (angles[0] + angles[1]), 0.5 * (angles[len(angles) // 2 - 1] + angles[len(angles) // 2]), angles[-1])
    return [(angle, load) for load in (loads[0], loads[-1]) for angle in dict.fromkeys(chosen)]


def rest_places(
    plants: Mapping[str, DelaySystem], trial: str, points: Sequence[tuple[float, float]]
) -> tuple[list[dict[str, float]], tuple[NotFound, ...]]:
    """Find at which points all engines rest.

    Args:
        plants: all engines that are tried, by name.
        trial: name, for what is told.
        points: throttle in deg and load in N m.

    Returns:
        Points at which every engine has a steady state, and those at which one has none, with the reason.
    """
    places: list[dict[str, float]] = []
    lost: tuple[NotFound, ...] = ()
    for angle, load in points:
        place = {"throttle": angle, "load_torque": load}
        at = f"{trial} at {angle:g} deg, {load:g} N m"
        none = tuple(reason for name in plants for reason in _why_none(f"{at}, {name}", plants[name], place))
        lost += none[:1]
        places += [] if none else [place]
    return places, lost


def _why_none(what: str, plant: DelaySystem, place: Mapping[str, float]) -> tuple[NotFound, ...]:
    """Why an engine has no steady state at a point; nothing where it has one."""
    return attempt(what, lambda: find_trim(plant, inputs=dict(place)))[1]


def trials_fields(found: TrialsResult) -> dict[str, Any]:
    """The field `acceptance` of results.json."""
    rows = [
        {
            "controller": name,
            "setpoint_weight": weight,
            "passed": short.passed,
            "runs": short.runs,
            "runs_that_kept_everything": short.kept,
            "places": [_place_fields(place) for place in short.places],
            "reasons": list(short.reasons),
        }
        for name, weight, short in found.trials
    ]
    record: dict[str, Any] = {"sampling_period_s": PERIOD, "spread": SPREAD, "trials": rows}
    for best in found.optimum:
        terms = best.terms
        record["optimum"] = {"kp": terms.kp, "ki": terms.ki, "kd": terms.kd, "setpoint_weight": terms.b, "ms_bound": MS, "cost": best.cost}
    if found.missing:
        record["not_tried"] = [one._asdict() for one in found.missing]
    return {"acceptance": record}


def _place_fields(place: PlaceSummary) -> dict[str, Any]:
    names = {"throttle": "throttle_deg", "load_torque": "load_n_m"}
    record: dict[str, Any] = {names.get(name, name): value for name, value in place.place}
    record |= {"ms": place.ms[0]} if place.ms else {"unstable_roots": place.unstable}
    record |= {"gain_reserve_db": place.reserve_db[0]} if place.reserve_db else {}
    if place.kinds:
        record |= {"largest_overshoot": float(place.overshoot.max()), "largest_droop_rad_s": float(place.droop.max())}
        settling = place.settling[place.settling < float("inf")]
        record["runs_not_settled"] = int(place.settling.size - settling.size)
        record |= {"longest_settling_time_s": float(settling.max())} if settling.size else {}
    return record | {"runs_that_ended_early": place.ended}


def drawn_trial(found: TrialsResult) -> Trial | None:
    """The trial that is drawn: that over the map, else the last; nothing where no trial ran."""
    ran = [one for one in found.trials if any(place.kinds for place in one.summary.places)]
    return ran[-1] if ran else None


def trials_figures(found: TrialsResult) -> dict[str, FigureCall]:
    """The figure of a trial, where there is one."""
    shown = drawn_trial(found)
    return {} if shown is None else {FIGURE: to_draw(plot_acceptance, shown.summary)}


def trial_words(trial: Trial) -> str:
    """A verdict in a sentence."""
    short = trial.summary
    names = {
        "c2d": "C2d",
        "optimum": "The optimum",
        FIXED: "One set of gains, in its box of the map,",
        SCHEDULE: "The schedule, over the map,",
    }
    reserves = [place.reserve_db[0] for place in short.places if place.reserve_db]
    verdict = "passes" if short.passed else "fails"
    text = f"{names[trial.name]} {verdict}: {short.kept} of {short.runs} runs keep everything"
    if reserves:
        text += f", and its gains lie {min(reserves):.1f} dB from hunting at least"
    unstable = sum(place.unstable > 0 for place in short.places)
    return f"{text}; at {unstable} of {len(short.places)} points its linear loop is unstable." if unstable else f"{text}."
