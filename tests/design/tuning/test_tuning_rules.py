"""Tuning rules from a lag with delay and from the ultimate point: published formulas at chosen numbers, scaling, ranges, exact margins."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.tuning import rules_lag as lags
from revline.design.tuning import rules_ultimate as ultimates
from revline.design.tuning.rule_comparison import compare_rules
from revline.design.tuning.rules import TUNING_RULES, tune_by_rule
from revline.design.tuning.tuning_plant import LagReading, TuningPlant, reduce_by_half_rule, tuning_plant
from revline.design.tuning.ultimate import UltimatePoint, UltimateSource
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.lti.interconnection import to_state_space
from revline.lti.transfer_function import TransferFunction

LAG = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.5), delay=0.1, input_unit="deg", output_unit="rad/s")
POINT = UltimatePoint(gain=2.0, period=0.5, source=UltimateSource.GIVEN)
UNIT = lags.Lag(gain=1.0, lag=1.0, delay=1.0)


def engine(throttle: float = 25.0) -> TuningPlant:
    system = lee1995()
    return tuning_plant(linearize(system, find_trim(system, inputs={"throttle": throttle})).model, name="engine")


@pytest.mark.reference
@pytest.mark.parametrize(
    ("form", "wanted"),
    [
        (lags.tune_p_ziegler_nichols(UNIT), (1.0, 0.0, 0.0)),
        (lags.tune_pi_ziegler_nichols(UNIT), (0.9, 0.27, 0.0)),
        (lags.tune_pi_cohen_coon(UNIT), (0.9 + 1 / 12, (0.9 + 1 / 12) * 29 / 33, 0.0)),
        (lags.tune_pid_cohen_coon(UNIT), (19 / 12, 19 / 12 * 21 / 38, 19 / 12 * 4 / 13)),
        (lags.tune_pi_simc(UNIT, closed_loop_lag=1.0), (0.5, 0.5, 0.0)),
        (lags.tune_pi_simc(lags.Lag(1.0, 20.0, 1.0), closed_loop_lag=1.0), (10.0, 1.25, 0.0)),
        (lags.tune_pid_simc(UNIT, 0.5, closed_loop_lag=1.0), (0.75, 0.5, 0.25)),
        (lags.tune_pi_amigo(UNIT).gains, (0.25, 0.25 / (0.35 + 0.65), 0.0)),
        (lags.tune_pid_amigo(UNIT).gains, (0.65, 0.65 * 1.1 / 1.2, 0.65 * 0.5 / 1.3)),
        (lags.tune_pi_lambda(UNIT, closed_loop_lag=3.0), (0.25, 0.25, 0.0)),
        (ultimates.tune_p_ultimate(POINT), (1.0, 0.0, 0.0)),
        (ultimates.tune_pi_ultimate(POINT), (0.9, 0.9 * 1.2 / 0.5, 0.0)),
        (ultimates.tune_pid_ultimate(POINT), (1.2, 4.8, 0.075)),
        (ultimates.tune_pi_tyreus_luyben(POINT), (0.625, 0.625 / 1.1, 0.0)),
        (ultimates.tune_pid_tyreus_luyben(POINT), (2.0 / 2.2, 2.0 / 2.2 / 1.1, 2.0 / 2.2 * 0.5 / 6.3)),
    ],
)
def test_each_rule_is_the_published_one(form: Any, wanted: tuple[float, float, float]) -> None:
    """Formulas of the sources that each rule names, by hand at gain, lag and delay of 1, or an ultimate point of 2 and 0.5 s."""
    assert tuple(form) == pytest.approx(wanted, rel=1e-12)


@settings(max_examples=25)
@given(gain=st.floats(0.1, 20.0), time=st.floats(0.1, 10.0))
@pytest.mark.parametrize("rule", [r.name for r in TUNING_RULES if r.name not in {"pole-placement", "fine-tuning", "simc", "lambda"}])
def test_gains_scale_with_the_plants_gain_and_its_time(rule: str, gain: float, time: float) -> None:
    """Twice the plant's gain is half the controller's; a plant twice as slow has half the integral and twice the derivative gain."""
    other = replace(LAG, numerator=(2.0 * gain,), denominator=(1.0, 0.5 * time), delay=0.1 * time)
    first, second = (tune_by_rule(rule, plant, options={}, designed_on="a lag") for plant in (LAG, other))
    by_gain = 1.0 if rule == "ziegler-nichols-without-gain" else gain
    assert (second.kp * by_gain, second.ki * by_gain * time, second.kd * by_gain / time) == pytest.approx(
        (first.kp, first.ki, first.kd), rel=1e-6, abs=1e-12
    )


@pytest.mark.parametrize("reading", LagReading)
def test_a_lag_with_delay_is_read_as_itself(reading: LagReading) -> None:
    """Exactly from a transfer function; from the same plant as a system with delay channels through its step response."""
    as_system = tuning_plant(to_state_space(LAG, input_name="throttle", output_name="engine_speed"), name="the same")
    for plant, accuracy in ((tuning_plant(LAG, name="a lag"), 1e-4), (as_system, 2e-3)):
        found = plant.lag(reading)
        assert (found.gain, found.lag, found.delay) == pytest.approx((2.0, 0.5, 0.1), rel=accuracy)
        assert found.largest_difference < 5e-3
        assert found.normalised_delay == pytest.approx(1.0 / 6.0, rel=2e-3)


def test_the_half_rule_is_skogestads_example() -> None:
    """E1 of Skogestad (2003): 1/((s + 1)(0.2 s + 1)) is 1/(1.1 s + 1) exp(-0.1 s); with more lags the smaller go to the delay."""
    two = TransferFunction(numerator=(1.0,), denominator=tuple(np.polynomial.polynomial.polymul((1.0, 1.0), (1.0, 0.2))))
    assert reduce_by_half_rule(two, order=1) == pytest.approx((1.0, 1.1, 0.0, 0.1))
    three = replace(two, denominator=tuple(np.polynomial.polynomial.polymul(two.denominator, (1.0, 0.04))), delay=0.01)
    assert reduce_by_half_rule(three, order=1) == pytest.approx((1.0, 1.1, 0.0, 0.01 + 0.1 + 0.04))
    assert reduce_by_half_rule(three, order=2) == pytest.approx((1.0, 1.0, 0.22, 0.01 + 0.02))
    inverse = replace(two, numerator=(1.0, -0.05))
    assert reduce_by_half_rule(inverse, order=1)[3] == pytest.approx(0.15)


@pytest.mark.reference
def test_amigo_is_the_published_example_on_four_equal_lags() -> None:
    """1/(s + 1)^4 is read as T = 2.9 s (at 63 %) and L = 1.42 s; PI: 0.414, 2.66 s; PID: 1.12, 2.40 s, 0.619 s.

    Source: Astrom and Hagglund (2004), Journal of Process Control 14(6), 635-650; the tangent would give T = 4.46 s and 0.67, 1.61.
    """
    four = TransferFunction(numerator=(1.0,), denominator=(1.0, 4.0, 6.0, 4.0, 1.0))
    pi, pid = (tune_by_rule(rule, four, options={}, designed_on="four lags") for rule in ("amigo-pi", "amigo"))
    assert (pi.kp, pi.kp / pi.ki) == pytest.approx((0.414, 2.66), rel=1e-2)
    assert (pid.kp, pid.kp / pid.ki, pid.kd / pid.kp) == pytest.approx((1.12, 2.40, 0.619), rel=1e-2)


def test_equal_lags_are_real_for_the_half_rule() -> None:
    """Roots of a polynomial that are four times the same are computed with imaginary parts of 1e-4."""
    four = TransferFunction(numerator=(1.0,), denominator=(1.0, 4.0, 6.0, 4.0, 1.0), delay=0.1)
    assert reduce_by_half_rule(four, order=2) == pytest.approx((1.0, 1.0, 1.5, 1.6), rel=1e-3)


@pytest.mark.reference
def test_rules_made_for_robustness_have_the_margins_that_their_authors_state() -> None:
    """SIMC with a closed-loop lag of the delay: Ms 1.59, gain margin 3.14, phase margin 61.4 deg for a lag of less than 8 delays.

    Source: Skogestad (2003), table 1.
    """
    compared = compare_rules(tuning_plant(LAG, name="a lag"))
    found = {one.rule: one.margins for one in compared.tuned}
    assert "improper" in {one.rule: one.reason for one in compared.refused}["ziegler-nichols"]
    simc = found["simc-pi"]
    assert simc.sensitivity.value == pytest.approx(1.59, abs=0.005)
    assert simc.gain_rise is not None
    assert simc.gain_rise.gain_margin == pytest.approx(math.pi, abs=0.005)
    assert simc.phase is not None
    assert simc.phase.phase_margin_deg == pytest.approx(61.4, abs=0.05)
    assert found["ziegler-nichols-ultimate-p"].gain_rise.gain_margin == pytest.approx(2.0, rel=1e-6)  # type: ignore[union-attr] # it has one


def test_the_engine_is_tuned_by_every_rule_or_says_why_not() -> None:
    found = compare_rules(engine())
    names = {one.rule for one in found.tuned} | {one.rule for one in found.refused}
    assert names == {rule.name for rule in TUNING_RULES} - {"fine-tuning", "ziegler-nichols-without-gain"}
    assert {one.rule for one in found.refused} == {"pole-placement", "simc"}
    assert all(one.margins.stable for one in found.tuned)
    assert found.plant == "engine"
    peaks = {one.rule: one.margins.sensitivity.value for one in found.tuned}
    assert peaks["amigo-pi"] == pytest.approx(1.4, abs=0.1)  # what both aim at
    assert peaks["amigo"] == pytest.approx(1.4, abs=0.1)
    by_name = {one.rule: one.gains for one in found.tuned}
    assert by_name["ziegler-nichols-ultimate-p"].kp == pytest.approx(2.1064 / 2.0, abs=1e-4)
    assert by_name["amigo"].details["setpoint_weight"] == 0.0


def test_a_measured_ultimate_point_is_taken_in_place_of_the_exact_one() -> None:
    measured = tune_by_rule("ziegler-nichols-ultimate", engine(), options={"ultimate_gain": 1.9636, "ultimate_period": 0.2186})
    assert measured.kp == pytest.approx(0.6 * 1.9636)
    assert measured.details["ultimate_source"] == "given"


@pytest.mark.parametrize(
    ("rule", "plant", "options", "message"),
    [
        (
            "cohen-coon",
            replace(LAG, delay=0.9),
            {},
            r"delay over lag = 1.8 is outside 0 to 1; cohen-coon was made for delays up to the lag",
        ),
        ("ziegler-nichols", replace(LAG, delay=0.9), {}, r"delay over lag = 1.8 is outside 0 to 1; ziegler-nichols was made for"),
        ("amigo", replace(LAG, delay=0.0), {}, "amigo needs a delay; the plant's is 0 s"),
        ("simc-pi", LAG, {"closed_loop_lag": 0.0}, "closed-loop lag = 0 s is outside the positive numbers; the delay, 0.1 s, is usual"),
        ("simc-pi", replace(LAG, delay=0.0), {}, "closed-loop lag = 0 s is outside the positive numbers; this plant has no delay"),
        ("pole-placement", replace(LAG, delay=0.0), {"natural_frequency": 1e200, "damping": 1.0}, "ki = inf .* is not finite"),
        ("simc", LAG, {}, "second lag = 0 s is outside above 0 to the first lag, 0.5 s; use simc-pi"),
        ("simc-pi", replace(LAG, denominator=(1.0, 0.1, 0.5)), {}, "the half rule needs real stable poles"),
        ("simc-pi", replace(LAG, denominator=(1.0,)), {}, "the half rule needs real stable poles; this model has others or none"),
        ("simc-pi", replace(LAG, numerator=(0.0, 1.0), denominator=(1.0, 2.0, 1.0)), {}, "the model's gain at rest is 0"),
        ("simc-pi", replace(LAG, numerator=(1.0, 0.1), denominator=(1.0, 0.5, 0.01)), {}, "zeros in the right half plane only"),
        ("lambda", LAG, {"reading": "guess"}, "there is no reading 'guess' of a step response; there are tangent, 63"),
        ("tyreus-luyben", LAG, {"ultimate_gain": 2.0}, "ultimate_gain alone is half an ultimate point"),
        ("tyreus-luyben", replace(LAG, numerator=(-2.0,)), {}, "a lag answers against its input"),
        ("cohen-coon", replace(LAG, denominator=(1.0, -0.5)), {}, "the plant's step response settles nowhere"),
    ],
)
def test_a_plant_outside_a_rules_range_is_refused(rule: str, plant: TransferFunction, options: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        tune_by_rule(rule, plant, options=options, designed_on="a lag")


@pytest.mark.parametrize("rule", ["amigo", "tyreus-luyben"])
def test_a_throttle_that_is_open_already_is_refused(rule: str) -> None:
    with pytest.raises(
        InvalidInputError, match=r"does not answer its input at rest \(gain 0 rad/s per deg\); choose another operating point"
    ):
        tune_by_rule(rule, engine(85.0), options={})


def test_a_system_is_refused_where_a_transfer_function_is_needed_and_where_it_is_unstable() -> None:
    with pytest.raises(InvalidInputError, match="this rule needs a transfer function, and engine is a system with delays inside"):
        tune_by_rule("pole-placement", engine(), options={"natural_frequency": 1.0, "damping": 1.0})
    unstable = replace(LAG, denominator=(-1.0, 0.5))
    system = to_state_space(unstable, input_name="throttle", output_name="engine_speed")
    with pytest.raises(InvalidInputError, match="it is unstable, with 1 roots right of the imaginary axis; no rule from a step suits it"):
        tune_by_rule("cohen-coon", tuning_plant(system, name="it"), options={})
