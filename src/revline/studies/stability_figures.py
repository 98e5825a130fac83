"""Figures of the gains that stabilise: every plant's region over one another, and the controllers in it."""

from collections.abc import Iterator
from types import MappingProxyType
from typing import Final

from revline.design.gain_region import Window
from revline.report.curves import WHOLE, View
from revline.report.gain_overlay import Outline, plot_gain_overlay
from revline.report.notes import Note
from revline.report.style import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILION, Look, Quantity
from revline.studies.figure_call import FigureCall, to_draw
from revline.studies.own_figures import REGION_FIGURES
from revline.studies.results import title
from revline.studies.stability_results import AT_START, AT_TARGET, RegionRow
from revline.studies.stability_steps import controllers_with
from revline.studies.study_results import StudyResults

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

LABELS: Final = MappingProxyType({AT_START: "engine, start", AT_TARGET: "engine, target"})


def region_figures(results: StudyResults) -> dict[str, FigureCall]:
    """The figures of the stabilising gains by their number."""
    return {number: _figure(results, controller) for number, controller in REGION_FIGURES.items()}


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
