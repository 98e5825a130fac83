"""Figures that the study has beside those of Lee (1995): their rows and captions. Their numbers begin with 7, as none of his do."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from revline.studies.results import title
from revline.studies.stability_results import RegionRow
from revline.studies.study_results import StudyResults
from revline.studies.words import listed, plant_name

Caption = Callable[[StudyResults], str]

REGION_FIGURES = MappingProxyType({"7.1": "c1", "7.2": "c2", "7.3": "c2d"})
"""Figures of the stabilising gains, each at the kd of one controller."""

OWN_ROWS = tuple(
    MappingProxyType(
        {
            "id": number,
            "title": f"Gains that stabilise with the derivative gain of {title(controller)}",
            "x": "kp (deg/(rad/s))",
            "y": "ki (deg/rad)",
        }
    )
    for number, controller in REGION_FIGURES.items()
)
"""As rows of the thesis's list of figures."""


def _region(controller: str) -> Caption:
    def write(results: StudyResults) -> str:
        kd = results.controllers.gains[controller].kd
        rows = results.stability.of_kd(kd)
        text = f"kd = {kd:.3g} deg s²/rad. Inside its line a loop is stable; on it a pair of roots oscillates."
        endless = [title(row.plant) for row in rows if not row.bounded]
        none = [plant_name(row.plant) for row in rows if row.is_empty]
        if endless:
            text += f" {listed(endless)} {'have' if len(endless) > 1 else 'has'} no end to the right."
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


OWN_CAPTIONS: Mapping[str, Caption] = MappingProxyType({number: _region(name) for number, name in REGION_FIGURES.items()})
"""By their number."""
