"""Figures that the study has beside those of Lee (1995): their rows and captions. Their numbers begin with 7, as none of his do."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from revline.analysis.linear_range import HoldsUpTo
from revline.studies.hunting_results import OnsetRow
from revline.studies.model_distance import FIGURE as DISTANCE_FIGURE
from revline.studies.operating_map import MAP_FIGURE, SCHEDULE_FIGURE
from revline.studies.results import title
from revline.studies.rivals import FIGURE as RIVALS_FIGURE
from revline.studies.stability_results import RegionRow
from revline.studies.study_results import StudyResults
from revline.studies.trials import FIGURE as TRIALS_FIGURE
from revline.studies.trials import PERIOD, drawn_trial, trial_words
from revline.studies.two_inputs import FIGURE as TWO_INPUTS_FIGURE
from revline.studies.two_inputs import two_inputs_words
from revline.studies.words import listed, plant_name

Caption = Callable[[StudyResults], str]

REGION_FIGURES = MappingProxyType({"7.1": "c1", "7.2": "c2", "7.3": "c2d"})
"""Figures of the stabilising gains, each at the kd of one controller."""

ORBIT_FIGURE, ONSET_FIGURE, RANGE_FIGURE = "7.4", "7.5", "7.6"
HUNTER = "c1"
"""The controller whose hunting is drawn."""


def _row(number: str, title: str, x: str, y: str) -> Mapping[str, str]:
    return MappingProxyType({"id": number, "title": title, "x": x, "y": y})


OWN_ROWS = (
    *(
        _row(number, f"Gains that stabilise with the derivative gain of {title(name)}", "kp (deg/(rad/s))", "ki (deg/rad)")
        for number, name in REGION_FIGURES.items()
    ),
    _row(ORBIT_FIGURE, f"Limit cycle of {title(HUNTER)} on the engine", "engine speed (rad/s)", "throttle (deg)"),
    _row(ONSET_FIGURE, f"How hunting begins as the gains of {title(HUNTER)} rise", "factor of all gains", "amplitude (rad/s)"),
    _row(DISTANCE_FIGURE, "How far models are from the engine, as feedback sees it", "frequency (rad/s)", "chord (1)"),
    _row(RANGE_FIGURE, "Error of the exact linear model over amplitude", "frequency (rad/s)", "throttle amplitude (deg)"),
    _row(RIVALS_FIGURE, "Controllers and rules beside the optimum of their form", "maximum sensitivity (1)", "load error (rad per N m)"),
    _row(MAP_FIGURE, "Gains over the operating map", "throttle (deg)", "load torque (N m)"),
    _row(SCHEDULE_FIGURE, "Gain schedule over speed and load", "engine speed (rad/s)", "load torque (N m)"),
    _row(TRIALS_FIGURE, "Runs of the acceptance", "operating point", "measure"),
    _row(TWO_INPUTS_FIGURE, "A load step under spark and throttle", "time (s)", "speed (rad/s), spark and throttle (deg)"),
)
"""As rows of the thesis's list of figures."""


def is_drawn(figure: str, results: StudyResults) -> bool:
    """Whether there is anything to draw: a controller that does not hunt has no limit cycle."""
    if figure == ORBIT_FIGURE:
        return results.hunting.cycle(HUNTER) is not None
    needs = {
        DISTANCE_FIGURE: lambda: bool(results.distance.drawn()),
        ONSET_FIGURE: lambda: bool(results.hunting.onsets),
        RIVALS_FIGURE: lambda: bool(results.rivals.compared.competitors),
        MAP_FIGURE: lambda: results.operating_map.is_drawn,
        SCHEDULE_FIGURE: lambda: bool(results.operating_map.schedule),
        TRIALS_FIGURE: lambda: drawn_trial(results.trials) is not None,
        TWO_INPUTS_FIGURE: lambda: results.two_inputs.is_drawn,
    }
    return needs[figure]() if figure in needs else True


def _region(controller: str) -> Caption:
    def write(results: StudyResults) -> str:
        kd = results.controllers.gains[controller].kd
        rows = results.stability.of_kd(kd)
        text = f"kd = {kd:.3g} deg s²/rad. Inside its line a loop is stable; on it a pair of roots oscillates."
        endless = [plant_name(row.plant) for row in rows if not row.bounded and not row.is_empty]
        none = [plant_name(row.plant) for row in rows if row.is_empty]
        if endless:
            text += f" Gains that stabilise {listed(endless)} go on beyond what is drawn."
        if none:
            text += f" Nothing stabilises {listed(none)}."
        return f"{text}{_peaks(rows)}"

    return write


def _peaks(rows: tuple[RegionRow, ...]) -> str:
    parts = [
        f" Thin: peak sensitivity Ms of {listed([f'{contour.peak:g}' for contour in row.contours if contour.kp.size])} with "
        f"{plant_name(row.plant)}."
        for row in rows
        if any(contour.kp.size for contour in row.contours)
    ]
    return "".join(parts)


def _orbit(results: StudyResults) -> str:
    row = results.hunting.cycle(HUNTER)
    if row is None:
        return "There is none."
    verdict = "attracts" if row.stable else "repels"
    return (
        f"Line: the cycle computed as an orbit, {row.low:.2f} to {row.high:.2f} rad/s in {row.period:.4f} s; points: the simulation's last "
        f"period, {100.0 * row.gap:.1g} % of the swing or period off. It {verdict} what is near it: its largest multiplier is "
        f"{row.multiplier:.3f} per period."
    )


def _onset(results: StudyResults) -> str:
    return " ".join(onset_words(row) for row in results.hunting.onsets)


def onset_words(row: OnsetRow) -> str:
    """How hunting begins, in a sentence."""
    start = (
        f"At {row.factor:.3f} of its gains the loop at {row.speed:.4g} rad/s loses stability, oscillating at {row.frequency:.3g} rad/s; "
    )
    if row.kind == "soft":
        return f"{start}limit cycles are found beyond it only, and grow from nothing: the onset is soft."
    return f"{start}limit cycles are found down to {row.lowest_factor:.3f}: the onset is hard."


def _distance(results: StudyResults) -> str:
    parts = [
        f"{name}: nu-gap {verdict.gap.value:.3g}, margin on the model {verdict.margin:.3g}" for name, verdict in results.distance.drawn()
    ]
    return f"{'; '.join(parts)}. Shaded: where the model says nothing about the loop on the engine."


def _rivals(_: StudyResults) -> str:
    return (
        "Left: each controller and the optimum with its maximum sensitivity and set-point error as bounds; arrows lead from one to the "
        "other. Right: speed after a unit load of that which gains most."
    )


def _map(results: StudyResults) -> str:
    gains = results.operating_map.gains
    return f"Largest proportional gain at each point, and at its corners the gains that stabilise and that keep Ms at most {gains.peak:g}."


def _schedule(results: StudyResults) -> str:
    return " ".join(
        f"Its gains, and the maximum sensitivity at {len(found.tried)} points, between the nodes too: {found.worst:.3f} at the worst."
        for found in results.operating_map.schedule
    )


def _trials(results: StudyResults) -> str:
    shown = drawn_trial(results.trials)
    return "There is none." if shown is None else f"{trial_words(shown)} Each point is a run, sampled every {1e3 * PERIOD:g} ms."


def range_words(results: StudyResults) -> str:
    """Up to which amplitude the exact linear model holds."""
    found = results.linear_range
    limit = f"{100.0 * found.limits.error:g} %"
    narrowest = found.narrowest
    if isinstance(narrowest, HoldsUpTo):
        return (
            f"The exact linear model errs by less than {limit} of the engine's fundamental up to {narrowest.amplitude:.3g} deg at every "
            f"frequency; it is narrowest at {narrowest.omega:.3g} rad/s."
        )
    return (
        f"Up to {narrowest.amplitude:.3g} deg the exact linear model errs by less than {limit} wherever the engine has a periodic answer."
    )


OWN_CAPTIONS: Mapping[str, Caption] = MappingProxyType(
    {
        "7.1": _region("c1"),
        "7.2": _region("c2"),
        "7.3": _region("c2d"),
        ORBIT_FIGURE: _orbit,
        ONSET_FIGURE: _onset,
        RANGE_FIGURE: range_words,
        DISTANCE_FIGURE: _distance,
        RIVALS_FIGURE: _rivals,
        MAP_FIGURE: _map,
        SCHEDULE_FIGURE: _schedule,
        TRIALS_FIGURE: _trials,
        TWO_INPUTS_FIGURE: lambda results: two_inputs_words(results.two_inputs),
    }
)
"""By their number."""
