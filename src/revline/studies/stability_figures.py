"""Figures of the gains that stabilise with the controllers in them, of hunting, of the linear model's range, and of gains that hold."""

from collections.abc import Iterator
from types import MappingProxyType
from typing import Final

import numpy as np

from revline.design.regions.gain_region import Window
from revline.report.curves import WHOLE, View
from revline.report.cycles import Plane, plot_branch, plot_orbit
from revline.report.gain_overlay import Outline, plot_gain_overlay
from revline.report.linear_range import ErrorMap, plot_linear_error
from revline.report.notes import Note
from revline.report.style import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILION, Look, Quantity
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.hunting_results import CycleRow
from revline.studies.model_distance import FIGURE as DISTANCE_FIGURE
from revline.studies.model_distance import distance_figure
from revline.studies.operating_map import map_figures
from revline.studies.own_figures import HUNTER, ONSET_FIGURE, ORBIT_FIGURE, RANGE_FIGURE, REGION_FIGURES
from revline.studies.results import title
from revline.studies.rivals import FIGURE as RIVALS_FIGURE
from revline.studies.rivals import rivals_figure
from revline.studies.stability_results import AT_START, AT_TARGET, RegionRow
from revline.studies.stability_steps import controllers_with
from revline.studies.study_results import StudyResults
from revline.studies.trials import trials_figures
from revline.studies.two_inputs import two_inputs_figures

LOOKS: Final = MappingProxyType(
    {
        "g1": Look(BLUE, ":"),
        "g2": Look(PURPLE, "-."),
        "g2d": Look(VERMILION, "--"),
        AT_START: Look(GREEN, "--", width=1.1),
        AT_TARGET: Look(BLACK, "-"),
    }
)
"""Lines of the plants."""

CONTOURS: Final = (Look(GREY, ":", width=1.1), Look(GREY, "-", width=0.8), Look(GREY, "-.", width=0.8))
"""Lines of the contours."""

ORBIT_POINTS: Final = 40
"""So many points of a simulation are drawn on its orbit."""

SPEED: Final = Quantity("engine speed", "rad/s")
THROTTLE: Final = Quantity("throttle angle", "deg")

LABELS: Final = MappingProxyType({AT_START: "engine, start", AT_TARGET: "engine, target"})


def region_figures(results: StudyResults) -> dict[str, FigureCall]:
    """The figures of the stabilising gains by their number."""
    return {number: _figure(results, controller) for number, controller in REGION_FIGURES.items()}


def hunting_figures(results: StudyResults) -> dict[str, FigureCall]:
    """The figures of hunting and of the linear model's range by their number; those that exist."""
    calls = {}
    row = results.hunting.cycle(HUNTER)
    if row is not None:
        few = slice(None, None, max(1, row.simulated_speed.size // ORBIT_POINTS))
        simulated = (row.simulated_speed[few], row.simulated_control[few])
        calls[ORBIT_FIGURE] = to_draw(plot_orbit, row.speed, row.control, Plane(SPEED, THROTTLE), simulated=simulated)
    for onset in results.hunting.onsets:
        columns = ([float(getattr(p, name)) for p in onset.points] for name in ("factor", "amplitude", "stable"))
        plane = Plane(Quantity("factor of all gains", "1"), Quantity("amplitude of the speed", "rad/s"))
        calls[ONSET_FIGURE] = to_draw(plot_branch, *map(np.array, columns), plane, onset=onset.factor, simulated=_at_its_own_gains(row))
    if results.distance.drawn():
        calls[DISTANCE_FIGURE] = distance_figure(results.distance)
    grid = results.linear_range.grid
    errors = ErrorMap(grid.omega, grid.amplitudes, grid.linear_error, grid.found)
    calls[RANGE_FIGURE] = to_draw(plot_linear_error, errors, Quantity("throttle amplitude", "deg"))
    return calls


def design_figures(results: StudyResults) -> dict[str, FigureCall]:
    """The figures of the controllers that hold by their number; those that exist."""
    rivals = {RIVALS_FIGURE: rivals_figure(results.rivals)} if results.rivals.compared.competitors else {}
    return {
        **rivals,
        **map_figures(results.operating_map),
        **trials_figures(results.trials),
        **two_inputs_figures(results.two_inputs),
    }


def _at_its_own_gains(row: CycleRow | None) -> tuple[list[float], list[float]] | None:
    """The controller's own cycle, as it was simulated, at the factor 1."""
    if row is None:
        return None
    return [1.0], [0.5 * float(np.ptp(row.simulated_speed))]


def _figure(results: StudyResults, controller: str) -> FigureCall:
    kd = results.controllers.gains[controller].kd
    rows = results.stability.of_kd(kd)
    units = results.controllers.gains[controller].gain_units
    notes = [Note(gains.kp, gains.ki, title(name).replace("_", ", ")) for name, gains in controllers_with(results.controllers, kd).items()]
    view = _view(rows[0].window) if rows else WHOLE
    return to_draw(
        plot_gain_overlay,
        [outline for row in rows for outline in _outlines(row)],
        notes,
        Quantity("kp", units["kp"]),
        Quantity("ki", units["ki"]),
        view=view,
    )


def _view(window: Window) -> View:
    return View(x=(max(window.kp_low, -0.1 * window.kp_high), window.kp_high), y=(0.0, window.ki_high))


def _outlines(row: RegionRow) -> Iterator[Outline]:
    name = LABELS.get(row.plant, title(row.plant))
    if row.omega.size:
        yield Outline(label=name, kp=row.kp, ki=row.ki, run=row.run, look=LOOKS[row.plant], shaded=row.plant == AT_TARGET)
    for contour, look in zip(row.contours, CONTOURS, strict=False):
        if contour.kp.size:
            yield Outline(label=f"Ms = {contour.peak:g}", kp=contour.kp, ki=contour.ki, run=contour.piece, look=look)
