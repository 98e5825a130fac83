import math

import numpy as np
import pytest

from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import LoopTask, run_linear_loop, trace_linear_loop
from revline.design.loops.step_measures import measure_overshoot
from revline.design.stability.loop_stability import judge_loop_stability
from revline.design.tuning.fine_tuning import FineTuning, Objective, fine_tune
from revline.errors import InvalidInputError, NotConvergedError
from revline.lti.transfer_function import TransferFunction

G2 = TransferFunction(numerator=(12.0149,), denominator=(1.0, 0.55104, 0.035517), input_unit="deg", output_unit="rad/s")
G2D = G2.with_delay(0.0214)


def gains(kp: float, ki: float, kd: float) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="test")


def judge(model: TransferFunction, law: PidGains, until: float = 4.0) -> tuple[float, float]:
    """Integral of the absolute error, and overshoot, found apart from the search."""
    trace = trace_linear_loop(model, law, LoopTask(command=1.0, until=until, step=until / 1200))
    overshoot = measure_overshoot(trace.times, trace.output, start=0.0, target=1.0, command=1.0)
    return float(np.trapezoid(np.abs(1.0 - trace.output), trace.times)), overshoot


@pytest.fixture(scope="module")
def three() -> FineTuning:
    """All three gains on G2d, from the Ziegler-Nichols rule."""
    return fine_tune(G2D, gains(1.06, 8.0, 0.0315), overshoot_limit=0.09, free=("kp", "ki", "kd"))


@pytest.mark.parametrize(("model", "start"), [(G2D, gains(1.2, 2.4, 0.1)), (G2, gains(20.0, 247.5, 0.4))], ids=["g2d", "g2"])
def test_the_integral_gain_is_the_largest_within_the_limit(model: TransferFunction, start: PidGains) -> None:
    """The error under load is 1/ki, and overshoot rises with ki: the result lies on the limit, and a grid finds nothing better."""
    tuned = fine_tune(model, start, overshoot_limit=0.09, objective=Objective.LOAD_ERROR)
    assert (tuned.gains.kp, tuned.gains.kd) == (start.kp, start.kd)
    assert tuned.overshoot <= 0.09
    assert tuned.overshoot == pytest.approx(0.09, abs=2e-6)
    assert judge(model, tuned.gains)[1] == pytest.approx(tuned.overshoot, abs=1e-12)
    assert tuned.value == 1.0 / tuned.gains.ki
    assert tuned.start_value == 1.0 / start.ki
    for factor in np.geomspace(1.0005, 2.0, 12):
        assert judge(model, gains(start.kp, tuned.gains.ki * factor, start.kd))[1] > 0.09
    assert tuned.text == (
        "minimised the integrated error after a unit step of a load at the plant's input (1/ki) over ki with overshoot at most 9 %: "
        f"{tuned.value:.4g} at overshoot 9.00 %, from {tuned.start_value:.4g} at the start"
    )
    assert (tuned.gains.rule, tuned.gains.designed_on) == ("fine-tuning", "test")
    assert dict(tuned.gains.details) == {"overshoot_limit": 0.09, "horizon_s": 4.0, "free": "ki"}


@pytest.mark.reference
def test_c2d_gets_the_integral_gain_between_the_two_known() -> None:
    """Lee (1995), section 5.4, recomputed: ki 2.0 overshoots 8.1 %, 2.5 10.7 %; 9 % lies between."""
    tuned = fine_tune(G2D, gains(1.2, 2.0, 0.1), overshoot_limit=0.09, objective=Objective.LOAD_ERROR)
    assert 2.1 < tuned.gains.ki < 2.25


def test_no_grid_point_about_the_optimum_is_better(three: FineTuning) -> None:
    assert three.overshoot <= 0.09
    cost, overshoot = judge(G2D, three.gains)
    assert (cost, overshoot) == pytest.approx((three.value, three.overshoot), rel=1e-9)
    shifts = (0.8, 0.95, 0.99, 1.0, 1.01, 1.05, 1.25)
    for law in (gains(three.gains.kp * a, three.gains.ki * b, three.gains.kd * c) for a in shifts for b in shifts for c in shifts):
        if judge_loop_stability(G2D, law).stable:
            other, beyond = judge(G2D, law)
            assert other >= three.value * (1.0 - 1e-4) or beyond > 0.09


def test_other_starts_lead_to_the_same_optimum(three: FineTuning) -> None:
    """An unstable start is one too: the search begins where all free gains together are small enough."""
    other = fine_tune(G2D, gains(10.0, 60.0, 0.4), overshoot_limit=0.09, free=("kd", "kp", "ki"))
    assert three.start_is_stable
    assert not other.start_is_stable
    assert other.text.endswith("where the loop first is stable, the start being unstable")
    assert other.value == pytest.approx(three.value, rel=1e-3)
    assert (other.gains.kp, other.gains.ki, other.gains.kd) == pytest.approx((three.gains.kp, three.gains.ki, three.gains.kd), rel=0.02)
    assert three.text.startswith("minimised the integral of the absolute error after a unit step of the command over kp, ki, kd with")
    assert 100 < three.evaluations < 2000


def test_a_slow_plant_is_judged_until_it_rests() -> None:
    """Within the 4 s asked for, no overshoot could be seen."""
    slow = TransferFunction(numerator=(2.0,), denominator=(1.0, 7.5, 12.5), delay=0.3, input_unit="deg", output_unit="rad/s")
    tuned = fine_tune(slow, gains(1.0, 0.08, 0.0), overshoot_limit=0.1, objective=Objective.LOAD_ERROR)
    assert tuned.horizon in (16.0, 32.0, 64.0)
    run = run_linear_loop(slow, tuned.gains, LoopTask(command=1.0, until=300.0, step=0.05), name="slow")
    assert run.is_stable
    assert run.overshoot == pytest.approx(0.1, abs=1e-3)


def test_a_plant_of_negative_gain_keeps_negative_gains() -> None:
    turned, law = G2D.scaled(-1.0), gains(-1.2, -2.4, -0.1)
    tuned = fine_tune(turned, law, overshoot_limit=0.09, objective=Objective.LOAD_ERROR)
    same = fine_tune(G2D, gains(1.2, 2.4, 0.1), overshoot_limit=0.09, objective=Objective.LOAD_ERROR)
    assert tuned.gains.ki == -same.gains.ki
    assert tuned.value == same.value


def test_what_cannot_be_tuned_says_why() -> None:
    double = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0, 0.02), input_unit="deg", output_unit="rad/s")
    with pytest.raises(NotConvergedError, match=r"that keep the overshoot below 0.1 % on this model: the least was .* set more gains free"):
        fine_tune(double, gains(200.0, 1.0, 0.0), overshoot_limit=0.001, free=("ki",))
    hopeless = TransferFunction(numerator=(1.0,), denominator=(1.0, -0.1), delay=1.0, input_unit="deg", output_unit="rad/s")
    with pytest.raises(NotConvergedError, match=r"unstable with the start and with all multiples of its free gains between a hundredth"):
        fine_tune(hopeless, gains(1.0, 1.0, 0.1), overshoot_limit=0.09, free=("kp", "ki", "kd"))
    glacial = TransferFunction(numerator=(1e-3,), denominator=(1.0, 1e5), delay=0.5, input_unit="deg", output_unit="rad/s")
    with pytest.raises(NotConvergedError, match=r"the best loop has not come to rest within 16 s; give gains nearer"):
        fine_tune(glacial, gains(1.0, 1e-3, 0.0), overshoot_limit=0.09, objective=Objective.LOAD_ERROR, until=1.0)


def test_a_pole_on_the_imaginary_axis_counts_as_unstable() -> None:
    """The very start is at the limit of stability; the search goes on from smaller gains."""
    oscillating = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=1.0, input_unit="deg", output_unit="rad/s")
    tuned = fine_tune(oscillating, gains(math.pi / 2.0, 0.0, 0.0), overshoot_limit=0.05, free=("kp",), until=40.0)
    assert not tuned.start_is_stable
    assert judge(oscillating, tuned.gains, 40.0)[1] <= 0.05


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"overshoot_limit": 0.0}, "overshoot limit = 0 of the command is outside 0 to 1"),
        ({"overshoot_limit": 1.0}, "overshoot limit = 1 of the command is outside 0 to 1"),
        ({"overshoot_limit": math.nan}, "overshoot limit = nan of the command is outside 0 to 1"),
        ({"until": 0.0}, "horizon = 0 s is outside values above 0"),
        ({"until": math.inf}, "horizon = inf s is outside values above 0"),
        ({"free": ("kx",)}, "gain kx cannot be tuned"),
        ({"free": ("ki", "ki")}, "gain ki cannot be tuned: it must be one of kp, ki, kd, named once"),
        ({"free": ("kd",)}, "gain kd cannot be tuned: .* differ from 0 at the start"),
        ({"free": ()}, r"absolute error after a unit step of the command does not depend on what is free \(nothing\)"),
        ({"free": ("kp",), "objective": Objective.LOAD_ERROR}, r"\(1/ki\) does not depend on what is free \(kp\); set ki free"),
    ],
)
def test_arguments_are_checked(options: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"overshoot_limit": 0.09, **options}
    with pytest.raises(InvalidInputError, match=message):
        fine_tune(G2D, gains(1.2, 2.4, 0.0), **arguments)  # type: ignore[arg-type] # what is wrong is the test


def test_a_gain_at_the_edge_of_its_range_is_named() -> None:
    """On G2, which has no delay, proportional and derivative gain together know no bound: the search ends at its edge and says so."""
    tuned = fine_tune(G2, gains(1.6, 19.0, 0.033), overshoot_limit=0.1, free=("kp", "kd"))
    assert tuned.at_edge == ("kp",)
    assert tuned.gains.kp == pytest.approx(160.0, rel=1e-3)
    assert "kp = 160: at the edge of the range sought, 100 times the start" in tuned.text
    assert "this is no optimum" in tuned.text


def test_an_optimum_inside_has_no_gain_at_the_edge(three: FineTuning) -> None:
    assert three.at_edge == ()
    assert "edge" not in three.text
