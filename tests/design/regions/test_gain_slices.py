"""Slices over kd, controllers in them, and the largest kd."""

import math

import pytest

from revline.design.controllers.controller import PidGains
from revline.design.regions.gain_curve import Contour, LoopFamily
from revline.design.regions.gain_slices import Question, find_largest_kd, find_slices, mark_controller
from revline.design.regions.loop_family import family_of_model
from revline.design.stability.loop_stability import judge_loop_stability
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import open_loop_of_model
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction

G2 = TransferFunction(numerator=(12.0066,), denominator=(1.0, 0.55159, 0.034396), input_unit="deg", output_unit="rad/s")
G2D = G2.with_delay(0.0213)


def make(kd: float, contour: Contour) -> LoopFamily:
    return family_of_model(G2D, kd=kd, name="g2d", contour=contour)


def pid(kp: float, ki: float, kd: float, unit: str = "deg") -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit=unit, rule="r", designed_on="d")


C1, C2D, C2D_TENTH = pid(2.153, 16.85, 0.0), pid(1.2, 2.0, 0.1), pid(0.12, 2.0, 0.1)


@pytest.mark.reference
def test_the_thesis_controllers_lie_where_they_should() -> None:
    """C1 outside at kd = 0, at 1/2.098 of its gains on the edge (kp = 1.027 there); C2d inside; a tenth of its kp swings slowly."""
    question = Question(kds=(0.05,), peaks=(2.0,), damping=0.3, up_to=20.0)
    marks = tuple(mark_controller(n, g) for n, g in (("c1", C1), ("c2d", C2D), ("tenth", C2D_TENTH)))
    slices = find_slices(make, question, marks=marks, delayed=True)
    assert [entry.region.family.kd for entry in slices] == [0.05, 0.0, 0.1]
    assert slices[0].placed == ()
    (c1,) = slices[1].placed
    assert c1.place.unstable == 2
    assert c1.peak == 0.0
    assert not c1.damped
    assert c1.place.fall is not None
    assert c1.place.fall.factor * 2.153 == pytest.approx(1.027, abs=1e-3)
    c2d, tenth = slices[2].placed
    assert c2d.place.inside
    assert tenth.place.inside
    assert c2d.damped
    assert not tenth.damped
    assert c2d.peak == pytest.approx(find_margins(open_loop_of_model(G2D, C2D)).sensitivity.value, rel=1e-6)


def test_a_controller_far_outside_widens_the_window() -> None:
    gains = pid(40.0, 9000.0, 0.0)
    hot = mark_controller("hot", gains)
    (entry,) = find_slices(make, Question(kds=()), marks=(hot,), delayed=True)
    assert entry.region.window.kp_high >= 44.0
    assert entry.region.window.ki_high >= 9900.0
    verdict = judge_loop_stability(G2D, gains)
    assert not verdict.stable
    assert entry.placed[0].place.unstable == getattr(verdict, "unstable_poles", None)


def test_a_window_may_be_asked_for() -> None:
    (entry,) = find_slices(make, Question(kp_max=1.0, ki_max=2.0), delayed=True)
    assert (entry.region.window.kp_high, entry.region.window.ki_high) == (1.0, 2.0)
    assert not entry.region.bounded


def test_a_plant_without_delay_is_damped_at_all_frequencies() -> None:
    (entry,) = find_slices(lambda kd, contour: family_of_model(G2, kd=kd, contour=contour), Question(damping=0.3), delayed=False)
    assert math.isinf(entry.damped[0].family.contour.up_to)
    (delayed,) = find_slices(make, Question(damping=0.3), delayed=True)
    assert delayed.damped[0].family.contour.up_to == pytest.approx(delayed.region.omega[delayed.region.ki == 0.0][0])


def test_the_largest_kd_is_where_the_region_vanishes() -> None:
    found = find_largest_kd(make)
    assert found.lost == pytest.approx(found.stabilised, rel=2e-3)
    assert found.reason == "no kp and ki stabilise"
    (last,) = find_slices(make, Question(kds=(found.stabilised,)), delayed=True)
    (none,) = find_slices(make, Question(kds=(found.lost,), damping=0.1), delayed=True)
    assert not last.region.empty
    assert last.region.area.value < 0.05 * find_slices(make, Question(kds=(0.1,)), delayed=True)[0].region.area.value
    assert none.region.empty
    assert none.damped == ()


def test_a_lag_behind_a_delay_takes_kd_up_to_lag_over_gain() -> None:
    """K kd/T = 1 is the loop gain at infinite frequency: beyond it infinitely many roots are unstable."""
    lag = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.5), delay=0.1)
    found = find_largest_kd(lambda kd, contour: family_of_model(lag, kd=kd, contour=contour))
    assert 0.2495 < found.stabilised < 0.25
    assert found.lost == pytest.approx(0.25, rel=1e-3)
    assert found.reason


def test_two_lags_without_delay_take_any_kd() -> None:
    found = find_largest_kd(lambda kd, contour: family_of_model(G2, kd=kd, contour=contour))
    assert math.isinf(found.lost)
    assert found.stabilised > 1000.0


def test_unfit_questions_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="2 derivative gains are given, some of them alike"):
        Question(kds=(0.1, 0.1))
    with pytest.raises(InvalidInputError, match="asked for up to 20 rad/s but no ratio"):
        Question(up_to=20.0)
    with pytest.raises(InvalidInputError, match="no derivative gain is given"):
        find_slices(make, Question(kds=()), delayed=True)
    with pytest.raises(InvalidInputError, match=r"controller c has gains in V/\(rad/s\) and g2d takes deg/\(rad/s\)"):
        find_slices(make, Question(), marks=(mark_controller("c", pid(1.0, 1.0, 0.0, "V")),), delayed=True)
    with pytest.raises(InvalidInputError, match=r"ki of c = -1 deg/\(rad/s\)/s is outside 0 and above"):
        find_slices(make, Question(), marks=(mark_controller("c", pid(1.0, -1.0, 0.0)),), delayed=True)
    with pytest.raises(InvalidInputError, match="have no boundary in the window"):
        find_slices(make, Question(kp_max=1e-6, ki_max=1e-9, damping=0.1), delayed=True)
    unstable = TransferFunction(numerator=(1.0,), denominator=(1.0, -0.2, 1.0), delay=0.1)
    with pytest.raises(InvalidInputError, match="no kp and ki stabilise u with kd = 0, so that there is no largest kd"):
        find_largest_kd(lambda kd, contour: family_of_model(unstable, kd=kd, contour=contour, name="u"))
