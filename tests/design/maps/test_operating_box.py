"""Boxes that grow, against the exact largest ones of areas whose edges are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from revline.design.maps.operating_box import CORNERS, Box, grow_box

WHOLE = Box(0.0, 30.0, -10.0, 50.0)


@pytest.mark.parametrize("start", [Box(25.0, 26.0, 30.0, 31.0), Box(29.0, 30.0, -10.0, -9.0), Box(20.0, 30.0, 49.0, 50.0)])
def test_a_box_grows_to_the_whole_where_all_fits(start: Box) -> None:
    assert grow_box(start, WHOLE, lambda _: True) == WHOLE


@settings(max_examples=15, deadline=None)
@given(st.floats(0.3, 3.0), st.floats(10.0, 40.0), st.floats(0.0, 1.0))
def test_edges_are_traded_until_the_area_is_the_largest(slope: float, room: float, at: float) -> None:
    """The low edges win from each other: a box fits where first_low + ... is high enough, so that the best is known by one minimisation."""

    def fits(box: Box) -> bool:
        return (30.0 - box.first_low) ** 1.5 * slope + (50.0 - box.second_low) <= room

    def area(first_low: float) -> float:
        side = min(60.0, room - slope * (30.0 - first_low) ** 1.5)
        return (30.0 - first_low) * max(side, 0.0)

    lowest = max(0.0, 30.0 - (room / slope) ** (2.0 / 3.0))
    best = -minimize_scalar(lambda low: -area(low), bounds=(lowest, 30.0), method="bounded", options={"xatol": 1e-9}).fun
    first_low = 30.0 - (0.02 + 0.9 * at) * (30.0 - lowest)
    start = Box(first_low, 30.0, 50.0 - 0.99 * max(area(first_low), 1e-3) / (30.0 - first_low), 50.0)
    if not fits(start):
        return
    grown = grow_box(start, WHOLE, fits)
    assert fits(grown)
    assert start.area <= grown.area <= best * (1.0 + 1e-9)
    assert grown.area >= best * (1.0 - 2e-3)


def test_a_box_slides_along_an_axis() -> None:
    """A window of fixed width is widened in the other axis only where it lies: its two edges are traded for each other."""
    peak = 21.0

    def fits(box: Box) -> bool:
        middle = 0.5 * (box.first_low + box.first_high)
        return box.side(0) <= 4.0 and box.side(2) <= 40.0 - abs(middle - peak)

    grown = grow_box(Box(1.0, 2.0, 0.0, 1.0), WHOLE, fits)
    assert grown.area == pytest.approx(160.0, rel=0.03)


def test_what_no_trade_improves_is_kept() -> None:
    start = Box(10.0, 12.0, 0.0, 5.0)
    assert grow_box(start, WHOLE, lambda box: box == start) == start


def test_shares_and_places_are_each_other_s_inverse() -> None:
    box = Box(1.0, 3.0, 10.0, 20.0)
    assert tuple(box.at(share) for share in CORNERS) == box.corners
    assert box.share(box.at((0.3, 0.7))) == pytest.approx((0.3, 0.7))
    assert box.about_middle(0.5) == Box(1.5, 2.5, 12.5, 17.5)
    assert np.allclose([box.side(edge) for edge in range(4)], [2.0, 2.0, 10.0, 10.0])
