"""Covers that prove the absence of gains: right where the answer is known, and never for a box that holds gains."""

from functools import cache

import numpy as np
import pytest

from revline.design.maps.gain_columns import peak_columns
from revline.design.regions.gain_curve import LoopFamily
from revline.design.regions.gain_region import find_gain_region
from revline.design.regions.loop_family import family_of_model
from revline.design.regions.no_gains import GainBox, NoCommonGains, NoProof, Point, prove_no_gains
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction


def point(gain: float, *lags: float, delay: float) -> Point:
    plant = TransferFunction(numerator=(gain,), denominator=(1.0, *lags), delay=delay)

    @cache
    def family(kd: float) -> LoopFamily:
        return family_of_model(plant, kd=kd, name=f"{gain:g}")

    return Point(f"gain {gain:g}", family)


QUICK = point(2.0, 0.8, delay=0.1)
SLOW = point(10.0, 0.8, delay=0.3)
SECOND = point(10.0, 1.0, 0.16, delay=0.3)


def best(at: Point, peak: float = 2.0) -> float:
    region = find_gain_region(at.family(0.0))
    return peak_columns(region, np.linspace(-0.4, 8.0, 801), peak).highest[1]


def test_a_cover_is_found_just_above_the_best_ki_and_none_below() -> None:
    """The best ki by columns is the edge: 2 % above it the cover exists, 2 % below it must not."""
    top = best(SLOW)
    box = {"kp_low": -0.2, "kp_high": 2.0, "ki_high": 20.0}
    found = prove_no_gains([SLOW], GainBox(ki_low=1.02 * top, **box), 2.0)
    assert isinstance(found, NoCommonGains)
    assert found.by_peak > 0
    assert found.unstable > 0
    assert found.cells < 2000
    assert isinstance(prove_no_gains([SLOW], GainBox(ki_low=0.98 * top, **box), 2.0, most=4000), NoProof)


def test_two_points_that_each_have_gains_have_none_in_common() -> None:
    """A quick plant needs more ki for its share than the slow one bears; each alone has gains in the same box."""
    box = GainBox(kp_low=-0.4, kp_high=8.0, ki_low=0.5 * best(QUICK), ki_high=60.0)
    assert isinstance(prove_no_gains([SLOW, QUICK], box, 2.0), NoCommonGains)
    left = prove_no_gains([QUICK], box, 2.0, most=2000)
    assert isinstance(left, NoProof)
    assert "meet or nearly touch" in left.reason
    assert box.ki_low <= left.ki <= box.ki_high


def test_no_sample_of_a_covered_box_has_gains_at_any_kd() -> None:
    """Random gains of a box in all three directions, counted and peaked by other means."""
    box = GainBox(kp_low=-0.2, kp_high=3.0, ki_low=3.0 * best(SECOND), ki_high=20.0, kd_low=0.0, kd_high=0.05)
    assert isinstance(prove_no_gains([SECOND], box, 2.0), NoCommonGains)
    rng = np.random.default_rng(3)
    for kd in (0.0, 0.025, 0.05):
        region = find_gain_region(SECOND.family(kd))
        kp = rng.uniform(box.kp_low, min(box.kp_high, region.reach[0]), 200)
        allowed = peak_columns(region, np.sort(kp), 2.0)
        assert allowed.above(box.ki_low).empty


def test_a_planted_gap_is_noticed() -> None:
    """Negative control: with gains of a higher peak allowed the cover must fail where it held."""
    box = GainBox(kp_low=-0.2, kp_high=2.0, ki_low=1.1 * best(SLOW), ki_high=20.0)
    assert isinstance(prove_no_gains([SLOW], box, 2.0), NoCommonGains)
    assert isinstance(prove_no_gains([SLOW], box, 4.0, most=3000), NoProof)


def test_what_cannot_be_asked_is_refused() -> None:
    box = GainBox(kp_low=0.0, kp_high=1.0, ki_low=1.0, ki_high=2.0)
    with pytest.raises(InvalidInputError, match="no operating points are given"):
        prove_no_gains([], box, 2.0)
    with pytest.raises(InvalidInputError, match="peak of the sensitivity = 1"):
        prove_no_gains([SLOW], box, 1.0)
    with pytest.raises(InvalidInputError, match="upside down or endless"):
        GainBox(kp_low=1.0, kp_high=0.0, ki_low=1.0, ki_high=2.0)
    with pytest.raises(InvalidInputError, match="lowest ki = 0"):
        GainBox(kp_low=0.0, kp_high=1.0, ki_low=0.0, ki_high=2.0)
    with pytest.raises(InvalidInputError, match="lowest kd = -1"):
        GainBox(kp_low=0.0, kp_high=1.0, ki_low=1.0, ki_high=2.0, kd_low=-1.0)
    with pytest.raises(InvalidInputError, match="answers as fast as kd = 1 rises"):
        prove_no_gains([SLOW], GainBox(kp_low=0.0, kp_high=1.0, ki_low=1.0, ki_high=2.0, kd_high=1.0), 2.0)
