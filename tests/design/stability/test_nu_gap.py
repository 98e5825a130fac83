"""The nu-gap against published values, closed forms, its own axioms and other counts, and what it guarantees against random loops."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.stability import nu_gap as nu_gap_module
from revline.design.stability.compared_plant import ComparedPlant, constant_weight, controller_weight, plant_of_model, plant_of_system
from revline.design.stability.nu_gap import Guarantee, find_nu_gap, judge_controller
from revline.engine.catalogue import build_engine
from revline.errors import NotConvergedError
from revline.io.value_files import read_value, write_value
from revline.lti.transfer_function import TransferFunction

Rational = tuple[tuple[float, ...], tuple[float, ...], float]

PLANTS = (((100.0,), (1.0, 2.0)), ((-100.0,), (1.0, -2.0)), ((100.0,), (1.0, 2.0, 1.0)))
G1 = ((12.2163,), (1.0, 0.57938), 0.0)
G2 = ((12.0066,), (1.0, 0.55159, 0.034396), 0.0)
G2D = (*G2[:2], 0.0213)
C1, C2, C2D = (2.153, 16.85, 0.0), (20.0, 110.0, 0.4), (1.2, 2.0, 0.1)


def model(numerator: tuple[float, ...], denominator: tuple[float, ...], delay: float = 0.0) -> TransferFunction:
    return TransferFunction(numerator=numerator, denominator=denominator, delay=delay, input_unit="deg", output_unit="rad/s")


def plant(numerator: tuple[float, ...], denominator: tuple[float, ...], delay: float = 0.0) -> ComparedPlant:
    return plant_of_model(model(numerator, denominator, delay))


def pid(kp: float, ki: float = 0.0, kd: float = 0.0) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a test")


def value(one: ComparedPlant, two: ComparedPlant) -> float:
    return find_nu_gap(one, two).value


def engine_at(angle: float) -> ComparedPlant:
    system = build_engine("lee1995")
    return plant_of_system(linearize(system, find_trim(system, inputs={"throttle": angle, "load_torque": 0.0})).model, name="engine")


@st.composite
def rational(draw: st.DrawFn, *, delayed: bool = False) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """A strictly proper plant of first or second order, stable or not, sometimes an integrator, its poles away from the axis or at 0."""
    gain = draw(st.sampled_from((-1.0, 1.0))) * draw(st.floats(0.1, 20.0))
    first = draw(st.sampled_from((-1.0, 1.0))) * draw(st.floats(0.05, 2.0))
    poles = [(1.0, first), (0.0, 1.0)]
    if draw(st.booleans()):
        poles.append((1.0, draw(st.sampled_from((-1.0, 1.0))) * draw(st.floats(0.05, 2.0))))
    used = poles[:1] + poles[2:] if draw(st.booleans()) else poles[:2]
    denominator = np.array([1.0])
    for pole in used:
        denominator = polynomial.polymul(denominator, pole)
    delay = draw(st.floats(0.01, 0.3)) if delayed and draw(st.booleans()) else 0.0
    return (gain,), tuple(float(c) for c in denominator), delay


@pytest.mark.reference
@pytest.mark.parametrize(("one", "two", "gap"), [(0, 1, 0.02), (0, 2, 0.8988), (1, 2, 0.8941)])
def test_published_gaps(one: int, two: int, gap: float) -> None:
    """100/(2 s + 1), 100/(2 s - 1), 100/(s + 1)^2. Source: Zhou and Doyle (1998), Essentials of Robust Control, chapter 17."""
    first, second = plant(*PLANTS[one]), plant(*PLANTS[two])
    assert value(first, second) == pytest.approx(gap, abs=5e-5)
    assert value(second, first) == pytest.approx(gap, abs=5e-5)


@pytest.mark.reference
def test_published_values_of_nearly_integrating_plants() -> None:
    """1/(s - 0.001), 1/(s + 0.001), and margins of 4/(s - 0.001) under gains 1 and 10, to a relative 0.001.

    Source: The MathWorks, Robust Control Toolbox, pages of gapmetric and ncfmargin.
    """
    assert value(plant((-1000.0,), (1.0, -1000.0)), plant((1000.0,), (1.0, 1000.0))) == pytest.approx(0.0020, abs=5e-5)
    p = plant((-4000.0,), (1.0, -1000.0))
    for gain, margin in ((1.0, 0.7069), (10.0, 0.0995)):
        found = judge_controller(p, p, pid(gain), weight=constant_weight(1.0))
        assert found.margin == pytest.approx(margin, rel=1e-3)


@given(one=st.floats(0.01, 50.0), two=st.floats(0.01, 50.0), delay=st.floats(0.0, 0.2))
def test_lags_with_the_same_delay_have_a_closed_form(one: float, two: float, delay: float) -> None:
    """k1/(s + 1), k2/(s + 1): the chord |k1 - k2| x/sqrt((x^2 + k1^2)(x^2 + k2^2)), x^2 = 1 + w^2, is longest at x^2 = max(k1 k2, 1)."""
    x2 = max(one * two, 1.0)
    chord = abs(one - two) * math.sqrt(x2 / ((x2 + one**2) * (x2 + two**2)))
    assert value(plant((one,), (1.0, 1.0), delay), plant((two,), (1.0, 1.0), delay)) == pytest.approx(chord, abs=1e-9)


@pytest.mark.parametrize(("one", "two"), [(1.0, 2.0), (0.5, -0.5), (3.0, -0.2), (-2.0, -3.0)])
def test_constant_gains_have_a_closed_form(one: float, two: float) -> None:
    """Constants k1, k2: |k1 - k2|/sqrt((1 + k1^2)(1 + k2^2)), at all frequencies alike."""
    chord = abs(one - two) / math.hypot(1.0, one) / math.hypot(1.0, two)
    assert value(plant((one,), (1.0,)), plant((two,), (1.0,))) == pytest.approx(chord, rel=1e-12)


def test_constants_at_opposite_ends_of_the_sphere_are_as_far_apart_as_can_be() -> None:
    assert value(plant((2.0,), (1.0,)), plant((-0.5,), (1.0,))) == 1.0


def test_a_delay_alone_has_a_closed_form() -> None:
    """1/s and exp(-s tau)/s: chord 2 sin(w tau/2) w/(1 + w^2)."""
    tau = 0.1
    w = np.geomspace(1e-3, 1e3, 2_000_001)
    chord = np.max(2.0 * np.abs(np.sin(0.5 * w * tau)) * w / (1.0 + w**2))
    found = find_nu_gap(plant((1.0,), (0.0, 1.0)), plant((1.0,), (0.0, 1.0), tau))
    assert found.value == pytest.approx(float(chord), abs=1e-9)
    assert found.winding == 0


def test_chords_may_be_short_where_the_winding_number_says_one() -> None:
    """k/(s + 1) and k/(s - 1), k = 0.4: 1 + P2(-s) P1(s) = 1 - k^2/(s + 1)^2 has no zero on the right, and a pole is missing."""
    found = find_nu_gap(plant((0.4,), (1.0, 1.0)), plant((-0.4,), (1.0, -1.0)))
    assert found.longest < 0.7
    assert found.winding != 0
    assert found.value == found.bound == 1.0
    assert find_nu_gap(plant((4.0,), (1.0, 1.0)), plant((-4.0,), (1.0, -1.0))).value < 0.5


def reference_gap(one: TransferFunction, two: TransferFunction) -> float:
    """The nu-gap of rational plants from roots: the zeros of d1(s) d2(-s) + n1(s) n2(-s) right of the axis must be as many as deg d2."""
    mirrored = [tuple(c * (-1.0) ** k for k, c in enumerate(side)) for side in (two.numerator, two.denominator)]
    zeros = polynomial.polyroots(
        polynomial.polyadd(polynomial.polymul(one.denominator, mirrored[1]), polynomial.polymul(one.numerator, mirrored[0]))
    )
    if np.min(np.abs(zeros.real)) < 1e-4:
        reject()
    w = np.geomspace(1e-6, 1e5, 200_001)
    a, b = one(1j * w), two(1j * w)
    chords = np.abs(a - b) / np.sqrt((1.0 + np.abs(a) ** 2) * (1.0 + np.abs(b) ** 2))
    return float(np.max(chords)) if int(np.sum(zeros.real > 0.0)) == two.order else 1.0


@settings(max_examples=60)
@given(one=rational(), two=rational())
def test_rational_plants_agree_with_a_count_of_roots(one: Rational, two: Rational) -> None:
    first, second = model(*one), model(*two)
    expected = reference_gap(first, second)
    assert value(plant_of_model(first), plant_of_model(second)) == pytest.approx(expected, abs=1e-6)


@settings(max_examples=25)
@given(plants=st.tuples(rational(delayed=True), rational(delayed=True), rational(delayed=True)))
def test_it_is_a_metric(plants: tuple[Rational, ...]) -> None:
    one, two, three = (plant(*p) for p in plants)
    ab, bc, ac = value(one, two), value(two, three), value(one, three)
    assert all(0.0 <= gap <= 1.0 for gap in (ab, bc, ac))
    assert value(two, one) == pytest.approx(ab, abs=1e-9)
    assert value(one, one) == 0.0
    assert ac <= ab + bc + 1e-9


@settings(max_examples=60)
@given(
    one=rational(delayed=True),
    two=rational(delayed=True),
    kp=st.floats(-3.0, 3.0),
    ki=st.sampled_from((0.0, 0.3, -0.3)),
    weighed=st.booleans(),
)
def test_no_guarantee_is_ever_broken(one: Rational, two: Rational, kp: float, ki: float, *, weighed: bool) -> None:
    """A guaranteed loop is stable by a count of its own characteristic equation, with a margin not below the floor."""
    assume(abs(kp) > 0.05)
    gains = pid(kp, ki)
    try:
        found = judge_controller(plant(*one), plant(*two), gains, weight=None if weighed else constant_weight(1.0))
    except NotConvergedError as error:
        assert "on the imaginary axis" in str(error)  # noqa: PT017 - such loops are drawn by chance
        reject()
    assert 0.0 <= found.margin <= 1.0
    assert found.floor <= found.pointwise_floor + 1e-9
    if found.guaranteed or found.guaranteed_pointwise:
        assert max(found.unstable_poles) == 0
        assert found.other_margin >= found.pointwise_floor - 1e-9


def test_guarantees_are_given_at_all_among_near_plants() -> None:
    """Were none given, the test above would prove nothing; and their share of stable loops is no accident of one controller."""
    generator = np.random.default_rng(5)
    given_, stable = 0, 0
    for _ in range(40):
        gain, lag, delay = generator.uniform(0.7, 1.4, 3)
        found = judge_controller(plant((2.0,), (1.0, 0.8), 0.1), plant((2.0 * gain,), (1.0, 0.8 * lag), 0.1 * delay), pid(2.0, 1.5))
        given_ += found.guaranteed
        stable += found.stable
        assert found.stable or not found.guaranteed
    assert 20 <= given_ <= stable


def test_a_winding_number_that_is_not_counted_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stable and unstable plants of a small gain are 1 apart by the count of roots, whatever the chords are."""
    monkeypatch.setattr(nu_gap_module, "_winding", lambda *_: 0)
    one, two = model((0.4,), (1.0, 1.0)), model((-0.4,), (1.0, -1.0))
    assert reference_gap(one, two) == 1.0
    assert value(plant_of_model(one), plant_of_model(two)) < 0.7


def test_a_delay_that_is_dropped_would_be_seen() -> None:
    exact, dropped = engine_at(25.0), plant(*G2)
    assert value(plant(*G2D), exact) < 0.7 * value(dropped, exact)


JUDGED = (
    (G1, C1, 25.0, 0.853, 0.633, 0.0, (0, 2)),
    (G1, C1, 30.0, 0.790, 0.633, 0.0, (0, 2)),
    (G2, C2, 25.0, 1.0, 0.592, 0.0, (0, 2)),
    (G2D, C2D, 25.0, 0.1707, 0.3089, 0.1755, (0, 0)),
    (G2D, C2D, 30.0, 0.3152, 0.3089, 0.1897, (0, 0)),
    (G2, C2D, 25.0, 0.6480, 0.7071, 0.1755, (0, 0)),
)


@pytest.mark.parametrize(("fitted", "gains", "angle", "gap", "margin", "other", "poles"), JUDGED)
def test_controllers_of_the_thesis_on_the_engine(
    fitted: Rational, gains: tuple[float, ...], angle: float, gap: float, margin: float, other: float, poles: tuple[int, int]
) -> None:
    """Values of converged computations."""
    found = judge_controller(plant(*fitted), engine_at(angle), pid(*gains))
    assert (found.gap.value, found.margin, found.other_margin) == pytest.approx((gap, margin, other), abs=5e-4)
    assert list(found.unstable_poles) == list(poles)
    assert found.guaranteed == (gap < margin)
    floors = [math.sin(max(math.asin(b) - math.asin(gap), 0.0)) for b in (margin - 0.0101, margin)]  # what lies beyond the grid counts
    assert floors[0] - 1e-3 <= found.floor <= floors[1] + 1e-3
    assert found.floor <= found.pointwise_floor <= found.other_margin


def test_chord_and_margin_are_those_of_a_fine_grid() -> None:
    """The engine and G2d under C2d, each formula written out again."""
    found = judge_controller(plant(*G2D), engine_at(25.0), pid(*C2D))
    w = np.geomspace(0.01, 3000.0, 100_001)
    c = 1.2 + 2.0 / (1j * w) + 0.1j * w
    one, two = model(*G2D)(1j * w) * c, engine_at(25.0).transfer(1j * w) * c
    size = [np.sqrt(1.0 + np.abs(loop) ** 2) for loop in (one, two)]
    assert found.gap.longest == pytest.approx(float(np.max(np.abs(one - two) / size[0] / size[1])), rel=1e-6)
    assert found.margin == pytest.approx(float(np.min(np.abs(1.0 + one) / size[0])) / math.sqrt(2.0), rel=1e-6)
    assert found.other_margin == pytest.approx(float(np.min(np.abs(1.0 + two) / size[1])) / math.sqrt(2.0), rel=1e-6)


def test_a_margin_is_that_of_the_four_closed_loop_responses() -> None:
    """1/b is the largest singular value of [P; 1] (1 + C P)^-1 [C, 1], here by the sum of squares of that matrix of rank 1."""
    p, gains = plant((2.0,), (1.0, 0.8), 0.1), pid(1.5, 1.0)
    found = judge_controller(p, p, gains, weight=constant_weight(1.0))
    w = np.geomspace(1e-4, 1e3, 200_001)
    g, c = p.transfer(1j * w), gains.feedback_transfer(1j * w)
    matrix = np.moveaxis(np.array([[g * c, g], [c, np.ones_like(g)]]) / (1.0 + g * c), 2, 0)
    assert found.margin == pytest.approx(1.0 / float(np.max(np.linalg.norm(matrix, ord=2, axis=(1, 2)))), rel=1e-6)


@pytest.mark.parametrize(("kp", "kd"), [(1.0, 0.3), (1.0, -0.6), (-1.0, -0.6), (-1.0, 0.3)])
def test_loops_that_do_not_fall_off(kp: float, kd: float) -> None:
    """2/(0.8 s + 1) under kp + kd s ends at 1 + 2.5 kd, left of 0 too; its pole is -(1 + 2 kp)/(0.8 + 2 kd)."""
    p, stable = plant((2.0,), (1.0, 0.8)), (1.0 + 2.0 * kp) / (0.8 + 2.0 * kd) > 0.0
    found = judge_controller(p, p, pid(kp, 0.0, kd))
    w = 1j * np.geomspace(1e-5, 1e6, 20_001)
    loop = 2.0 * (kp + kd * w) / (1.0 + 0.8 * w)
    chord = float(np.min(np.abs(1.0 + loop) / np.sqrt(2.0 * (1.0 + np.abs(loop) ** 2))))
    assert found.stable == stable
    assert found.margin == pytest.approx(chord if stable else 0.0, rel=1e-5)
    assert found.gap.value == 0.0


def test_an_unstable_first_loop_has_no_margin_and_guarantees_nothing() -> None:
    found = judge_controller(plant(*G2D), engine_at(25.0), pid(*C1))
    assert (found.margin, found.guaranteed, found.guaranteed_pointwise, found.floor, found.pointwise_floor) == (0.0, False, False, 0.0, 0.0)


def test_a_verdict_can_be_kept(tmp_path: Path) -> None:
    found = judge_controller(plant(*G2D), engine_at(25.0), pid(*C2D))
    write_value(tmp_path / "verdict.json", found)
    kept = read_value(tmp_path / "verdict.json")
    assert isinstance(kept, Guarantee)
    assert kept.guaranteed == found.guaranteed
    assert kept.gap.value == found.gap.value
    np.testing.assert_array_equal(kept.gap.psi, found.gap.psi)
    with pytest.raises(ValueError, match="read-only"):
        found.gap.psi[0] = 0.0


def test_the_weight_matters_and_says_what_it_is() -> None:
    """A gap is no property of two plants alone: in other units it is another."""
    one, two = plant(*G1), plant(*G2D)
    gaps = [find_nu_gap(one, two, weight=constant_weight(k)) for k in (0.01, 1.0)]
    assert abs(gaps[0].value - gaps[1].value) > 0.05
    assert [gap.weight for gap in gaps] == ["the constant 0.01", "the constant 1"]
    assert controller_weight(pid(*C1)).text == "the controller (by hand)"
