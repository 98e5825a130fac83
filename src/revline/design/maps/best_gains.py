"""The gains with the largest ki that one peak of the sensitivity allows at an operating point."""

from dataclasses import dataclass

import numpy as np

from revline.design.maps.gain_columns import Ellipses, GainColumns, peak_columns
from revline.design.regions.gain_region import GainRegion
from revline.design.regions.sensitivity_contour import find_peaks

ZOOMS, ZOOM_COLUMNS = 2, 9
"""How often the neighbourhood of the column with the largest ki is divided, and into how many columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BestGains:
    """Gains with the largest ki that the peak of the sensitivity allows; 1/ki is the integrated error after a step of load.

    Attributes:
        kp, ki: with the map's kd.
        peak: of the sensitivity that a search over all frequencies finds there.
    """

    kp: float
    ki: float
    peak: float


def best_gains(region: GainRegion, ellipses: Ellipses, allowed: GainColumns, peak: float) -> BestGains:
    """Find the gains with the largest ki, dividing the neighbourhood of the best column again.

    Args:
        region: of one plant and kd.
        ellipses: of the region.
        allowed: gains that keep the peak, not empty.
        peak: Ms.
    """
    width = float(allowed.kp[1] - allowed.kp[0])
    kp, ki = allowed.highest
    for _ in range(ZOOMS):
        low, high = max(kp - width, -region.reach[0]), min(kp + width, region.reach[0])
        found = peak_columns(region, np.linspace(low, high, ZOOM_COLUMNS), peak, ellipses)
        kp, ki = max((kp, ki), found.highest, key=lambda gains: gains[1])
        width *= 2.0 / (ZOOM_COLUMNS - 1)
    return BestGains(kp=kp, ki=ki, peak=float(find_peaks(region, kp, ki)))
