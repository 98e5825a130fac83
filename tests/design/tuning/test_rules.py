import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.design.controllers.controller import PidGains
from revline.design.tuning.rule_making import RuleValue
from revline.design.tuning.rules import (
    TUNING_RULES,
    find_tuning_rule,
    tune_by_rule,
)
from revline.design.tuning.rules_step import tune_pi_pole_placement, tune_pid_ziegler_nichols, tune_pid_ziegler_nichols_without_gain
from revline.design.tuning.step_tangent import TangentReading, measure_step_tangent
from revline.errors import InvalidInputError
from revline.lti.polynomial import polynomial_roots
from revline.lti.transfer_function import TransferFunction

G1 = TransferFunction(numerator=(12.21634,), denominator=(1.0, 0.579381), input_unit="deg", output_unit="rad/s")
G2 = TransferFunction(numerator=(12.006617,), denominator=(1.0, 0.551588, 0.0343956), input_unit="deg", output_unit="rad/s")
G2D = G2.with_delay(0.0213)


def plant(numerator: tuple[float, ...], denominator: tuple[float, ...]) -> TransferFunction:
    return TransferFunction(numerator=numerator, denominator=denominator)


@pytest.mark.reference
def test_pole_placement_gives_the_published_controller() -> None:
    """C1 of Lee (1995), section 5.1: kp = 2.153, ki = 16.85 for wn = 18.85 rad/s and zeta = 1.25."""
    gains = tune_pi_pole_placement(G1, natural_frequency=18.85, damping=1.25, designed_on="g1")
    assert gains.kp == pytest.approx(2.153, abs=5e-4)
    assert gains.ki == pytest.approx(16.85, abs=5e-3)
    assert gains.kd == 0.0
    assert (gains.input_unit, gains.output_unit, gains.rule, gains.designed_on) == ("rad/s", "deg", "pole-placement", "g1")
    assert dict(gains.details) == {"natural_frequency_rad_s": 18.85, "damping_ratio": 1.25}


@given(
    gain=st.floats(0.1, 50.0),
    sign=st.sampled_from([1.0, -1.0]),
    lag=st.one_of(st.floats(0.05, 5.0), st.floats(-5.0, -0.05)),
    natural_frequency=st.floats(12.0, 50.0),
    damping=st.floats(0.9, 3.0),
)
def test_poles_are_placed_for_stable_and_unstable_lags(
    gain: float, sign: float, lag: float, natural_frequency: float, damping: float
) -> None:
    gain *= sign
    gains = tune_pi_pole_placement(plant((gain,), (1.0, lag)), natural_frequency=natural_frequency, damping=damping)
    closed = np.array([gain * gains.ki, 1.0 + gain * gains.kp, lag])
    np.testing.assert_allclose(closed / lag, [natural_frequency**2, 2.0 * damping * natural_frequency, 1.0], rtol=1e-9)
    assert np.all(polynomial_roots(closed).real < 0.0)


@pytest.mark.parametrize(
    ("refused", "message"),
    [
        (G2, "needs a plant K/.T s . 1.; this one has 2 poles and 0 zeros"),
        (plant((1.0, 0.1), (1.0, 1.0)), "1 poles and 1 zeros"),
        (plant((1.0,), (0.0, 1.0)), "or a pole at s = 0"),
        (plant((0.0,), (1.0, 1.0)), "needs a plant K"),
        (G1.with_delay(0.02), "needs a plant without delay; this one has 0.02 s"),
    ],
)
def test_pole_placement_refuses_other_plants(refused: TransferFunction, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        tune_pi_pole_placement(refused, natural_frequency=18.85, damping=1.25)


def test_pole_placement_refuses_what_the_plant_exceeds_alone() -> None:
    with pytest.raises(InvalidInputError, match=r"2 zeta wn = 1.4 rad/s is not above the plant's own 1/T = 1.72"):
        tune_pi_pole_placement(G1, natural_frequency=1.0, damping=0.7)
    with pytest.raises(InvalidInputError, match=r"ki = inf .* is not finite; give a finite gain"):
        tune_pi_pole_placement(G1, natural_frequency=1e300, damping=0.7)


@pytest.mark.parametrize("wish", [(0.0, 1.0), (1.0, -1.0), (float("nan"), 1.0), (float("inf"), 1.0)])
def test_pole_placement_refuses_impossible_wishes(wish: tuple[float, float]) -> None:
    with pytest.raises(InvalidInputError, match=r"(natural frequency|damping ratio) = .* is outside the positive numbers"):
        tune_pi_pole_placement(G1, natural_frequency=wish[0], damping=wish[1])


@pytest.mark.reference
@pytest.mark.parametrize(("model", "kp"), [(G2, 1.61), (G2D, 1.06)])
def test_ziegler_nichols_counts_the_gain(model: TransferFunction, kp: float) -> None:
    """kp = 1.2 T/(K L) of Ziegler and Nichols (1942) with the exact tangents of G2 and G2d of Lee (1995)."""
    tangent = measure_step_tangent(model)
    gains = tune_pid_ziegler_nichols(tangent)
    assert gains.kp == pytest.approx(kp, abs=5e-3)
    assert gains.ki == pytest.approx(gains.kp / (2.0 * tangent.dead_time), rel=1e-14)
    assert gains.kd == pytest.approx(gains.kp * tangent.dead_time / 2.0, rel=1e-14)
    assert (gains.input_unit, gains.output_unit) == ("rad/s", "deg")
    assert gains.details["static_gain"] == 12.006617


@pytest.mark.reference
@pytest.mark.parametrize(
    ("dead_time", "rise_time", "kp", "ki", "kd"), [(0.04, 0.66, 19.8, 247.5, 0.396), (0.07, 0.65, 11.143, 79.593, 0.39)]
)
def test_rule_without_gain_gives_the_published_controllers(dead_time: float, rise_time: float, kp: float, ki: float, kd: float) -> None:
    """The controllers for G2 and G2d of Lee (1995), chapter 5, from the tangents read there."""
    gains = tune_pid_ziegler_nichols_without_gain(TangentReading(dead_time=dead_time, rise_time=rise_time, final_value=12.0))
    assert gains.kp == pytest.approx(kp, abs=5e-4)
    assert gains.ki == pytest.approx(ki, abs=2e-3)
    assert gains.kd == pytest.approx(kd, abs=5e-4)
    assert gains.rule == "ziegler-nichols-without-gain"


@given(dead_time=st.floats(0.001, 10.0), rise_time=st.floats(0.001, 10.0), gain=st.floats(0.1, 100.0), factor=st.floats(0.1, 10.0))
def test_ziegler_nichols_scales_as_it_must(dead_time: float, rise_time: float, gain: float, factor: float) -> None:
    """A plant with k times the gain wants 1/k of every gain; the rule that forgets the gain is K times too hot."""
    tangent = TangentReading(dead_time=dead_time, rise_time=rise_time, final_value=gain)
    scaled = TangentReading(dead_time=dead_time, rise_time=rise_time, final_value=gain * factor)
    right, rescaled, hot = (
        tune_pid_ziegler_nichols(tangent),
        tune_pid_ziegler_nichols(scaled),
        tune_pid_ziegler_nichols_without_gain(tangent),
    )
    for name in ("kp", "ki", "kd"):
        assert getattr(rescaled, name) * factor == pytest.approx(getattr(right, name), rel=1e-12)
        assert getattr(hot, name) == pytest.approx(gain * getattr(right, name), rel=1e-12)


def test_ziegler_nichols_refuses_a_plant_without_dead_time() -> None:
    tangent = measure_step_tangent(G1)
    with pytest.raises(InvalidInputError, match=r"ziegler-nichols needs a dead time; the tangent crosses zero at 0 s"):
        tune_pid_ziegler_nichols(tangent)
    with pytest.raises(InvalidInputError, match=r"ziegler-nichols-without-gain needs a dead time"):
        tune_pid_ziegler_nichols_without_gain(tangent)


def test_table_of_rules_tunes_like_the_functions() -> None:
    names = [rule.name for rule in TUNING_RULES]
    assert len(set(names)) == len(names)
    assert all(rule.summary and rule.source for rule in TUNING_RULES)
    placed = tune_by_rule("pole-placement", G1, options={"natural_frequency": 18.85, "damping": 1.25}, designed_on="g1")
    assert placed.kp == tune_pi_pole_placement(G1, natural_frequency=18.85, damping=1.25).kp
    for name in ("ziegler-nichols", "ziegler-nichols-without-gain"):
        gains = tune_by_rule(name, G2D, options={}, designed_on="g2d")
        assert (gains.rule, gains.designed_on) == (name, "g2d")
    hot = tune_by_rule("ziegler-nichols-without-gain", G2D, options={}, designed_on="g2d")
    assert hot.kp == tune_pid_ziegler_nichols_without_gain(measure_step_tangent(G2D)).kp


def test_unknown_rules_and_options_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"no tuning rule 'magic'; there are pole-placement, ziegler-nichols"):
        find_tuning_rule("magic")
    with pytest.raises(InvalidInputError, match=r"pole-placement needs damping \[1\] \(damping ratio of the closed loop\)"):
        tune_by_rule("pole-placement", G1, options={"natural_frequency": 18.85}, designed_on="g1")
    with pytest.raises(InvalidInputError, match=r"ziegler-nichols knows no option damping; it takes none"):
        tune_by_rule("ziegler-nichols", G2, options={"damping": 1.0}, designed_on="g2")


def test_fine_tuning_is_a_rule_and_says_what_it_minimised() -> None:
    start = tune_by_rule("ziegler-nichols", G2D, options={}, designed_on="g2d")
    tuned = tune_by_rule("fine-tuning", G2D, options={}, designed_on="g2d")
    assert (tuned.rule, tuned.designed_on, tuned.kp, tuned.kd) == ("fine-tuning", "g2d", start.kp, start.kd)
    assert (tuned.details["start_rule"], tuned.details["start_ki"]) == ("ziegler-nichols", start.ki)
    assert str(tuned.details["summary"]).startswith("minimised the integral of the absolute error after a unit step of the command over ki")
    assert tuned.details["overshoot"] == pytest.approx(0.1, abs=1e-5)


@pytest.mark.reference
def test_fine_tuning_from_c2d_by_rule_lies_between_the_two_gains_known() -> None:
    """Lee (1995), section 5.4, recomputed: ki 2.0 overshoots 8.1 %, 2.5 10.7 %; 10 % lies between."""
    start = PidGains(kp=1.2, ki=2.0, kd=0.1, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="not stated")
    options: dict[str, RuleValue] = {"start": start, "objective": "load-error", "overshoot_limit": 0.1, "free": "ki", "horizon": 4.0}
    tuned = tune_by_rule("fine-tuning", G2D, options=options, designed_on="g2d")
    assert (tuned.kp, tuned.kd, tuned.designed_on) == (1.2, 0.1, "g2d")
    assert 2.3 < tuned.ki < 2.45


def test_what_fine_tuning_refuses_by_name() -> None:
    with pytest.raises(InvalidInputError, match=r"knows no objective 'speed'; it minimises setpoint-error or load-error"):
        tune_by_rule("fine-tuning", G2D, options={"objective": "speed"}, designed_on="g2d")
    with pytest.raises(InvalidInputError, match=r"option overshoot_limit = 'ten' is no number"):
        tune_by_rule("fine-tuning", G2D, options={"overshoot_limit": "ten"}, designed_on="g2d")
    with pytest.raises(InvalidInputError, match=r"gain kq cannot be tuned"):
        tune_by_rule("fine-tuning", G2D, options={"free": "kp, kq"}, designed_on="g2d")
