import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.fitting.model_choice import fit_all_models
from revline.design.regions.gain_curve import Contour, LoopFamily
from revline.design.regions.gain_rays import GainLimit, NoGainLimit, RayPlace, find_gain_limit, place_gains
from revline.design.regions.gain_region import find_gain_region
from revline.design.regions.loop_family import family_of_model, family_of_system
from revline.design.stability.loop_stability import count_unstable_poles, judge_loop_stability
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.lti.response import FrequencyResponse
from revline.lti.transfer_function import TransferFunction

C1_RATIO = 16.85 / 2.153
G2D = TransferFunction(numerator=(12.0066,), denominator=(1.0, 0.55159, 0.034396), delay=0.0213)
TABLE = Path(__file__).parents[3] / "src" / "revline" / "studies" / "reference" / "table_4_1.csv"


def limit_of(plant: TransferFunction | LoopFamily, ratio: float = 0.0) -> GainLimit:
    family = plant if isinstance(plant, LoopFamily) else family_of_model(plant)
    found = find_gain_limit(family, integral_ratio=ratio)
    assert isinstance(found, GainLimit)
    return found


@given(gain=st.floats(0.1, 20.0), lag=st.floats(0.05, 5.0), delay=st.floats(0.02, 2.0))
def test_a_lag_with_delay_has_its_closed_form(gain: float, lag: float, delay: float) -> None:
    """w tau + arctan(w T) = pi, kp = sqrt(1 + (w T)^2) / K."""
    frequency = float(brentq(lambda w: w * delay + math.atan(w * lag) - math.pi, 0.0, math.pi / delay, xtol=1e-15, rtol=1e-14))
    found = limit_of(TransferFunction(numerator=(gain,), denominator=(1.0, lag), delay=delay))
    assert found.frequency == pytest.approx(frequency, rel=1e-11)
    assert found.kp == pytest.approx(math.hypot(1.0, frequency * lag) / gain, rel=1e-11)


@given(gain=st.floats(0.1, 20.0), lag=st.floats(0.05, 5.0))
def test_three_equal_lags_stand_a_gain_of_eight(gain: float, lag: float) -> None:
    found = limit_of(TransferFunction(numerator=(gain,), denominator=tuple(np.poly([-1.0 / lag] * 3)[::-1] * lag**3)))
    assert (found.kp * gain, found.frequency * lag) == pytest.approx((8.0, math.sqrt(3.0)), rel=1e-9)


@given(delay=st.floats(0.01, 5.0))
def test_an_integrator_with_delay_stands_a_quarter_turn(delay: float) -> None:
    found = limit_of(TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=delay))
    assert (found.kp * delay, found.frequency * delay) == pytest.approx((math.pi / 2.0, math.pi / 2.0), rel=1e-11)


@given(ratio=st.floats(0.05, 0.9), delay=st.floats(0.05, 1.0))
def test_integral_action_before_an_integrator_has_its_closed_form(ratio: float, delay: float) -> None:
    """w tau = arctan(w / r), as long as r tau < 1; kp = w / sqrt(1 + (r / w)^2)."""
    rate = ratio / delay
    frequency = float(brentq(lambda w: math.atan(w / rate) - w * delay, 1e-3 * rate, math.pi / 2.0 / delay, xtol=1e-15, rtol=1e-14))
    found = limit_of(TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=delay), rate)
    assert found.frequency == pytest.approx(frequency, rel=1e-9)
    assert found.kp == pytest.approx(frequency / math.hypot(1.0, rate / frequency), rel=1e-9)


@given(ratio=st.just(0.0) | st.floats(0.01, 10.0), delay=st.floats(0.01, 0.5), lag=st.floats(0.1, 2.0))
def test_stability_changes_at_the_limit(ratio: float, delay: float, lag: float) -> None:
    """The unstable poles of the closed loop, counted by other means."""
    plant = TransferFunction(numerator=(2.0,), denominator=(1.0, lag, 0.02), delay=delay)
    found = limit_of(plant, ratio)
    below, above = (
        PidGains(kp=k, ki=ratio * k, kd=0.0, input_unit="1", output_unit="1", rule="r", designed_on="p")
        for k in (0.999 * found.kp, 1.001 * found.kp)
    )
    assert judge_loop_stability(plant, below).stable
    assert not judge_loop_stability(plant, above).stable


def test_the_first_of_several_crossings_counts() -> None:
    """A resonance above the first crossing of the phase turns the loop unstable earlier than that crossing does."""
    resonance = np.convolve([1.0, 2.0 * 0.01 / 20.0, 1.0 / 400.0], np.poly([-1.0] * 3)[::-1])
    plant = TransferFunction(numerator=(1.0,), denominator=tuple(resonance))
    found = limit_of(plant)
    law = PidGains(kp=found.kp, ki=0.0, kd=0.0, input_unit="1", output_unit="1", rule="r", designed_on="p")
    assert judge_loop_stability(plant, law.scaled(kp=0.999)).stable
    assert not judge_loop_stability(plant, law.scaled(kp=1.001)).stable


@pytest.mark.parametrize("denominator", [(1.0, 0.58), (1.0, 0.551, 0.0355), (0.0, 1.0, 0.1)])
@pytest.mark.parametrize("ratio", [0.0, 1.0])
def test_one_and_two_lags_have_no_limit(denominator: tuple[float, ...], ratio: float) -> None:
    plant = TransferFunction(numerator=(12.0,), denominator=denominator)
    assert find_gain_limit(family_of_model(plant), integral_ratio=ratio, high=500.0) == NoGainLimit(searched_to=500.0)


@pytest.mark.reference
@pytest.mark.parametrize(
    ("angle", "ratio", "kp", "frequency"),
    [(25.0, 0.0, 2.106, 29.8), (30.0, 0.0, 2.794, 38.0), (25.0, C1_RATIO, 1.240, None), (30.0, C1_RATIO, 1.927, None)],
)
def test_the_engine_loses_stability_at_the_known_gains(angle: float, ratio: float, kp: float, frequency: float | None) -> None:
    """Recomputed from the engine of Lee (1995), linearised with its delay exact: 2.106 deg per rad/s at 25 deg, 2.794 at 30 deg.

    There it oscillates at 29.8 and 38.0 rad/s; with C1's ratio of ki to kp the gains are 1.240 and 1.927.
    """
    engine = lee1995()
    model = linearize(engine, find_trim(engine, inputs={"throttle": angle})).model
    found = limit_of(family_of_system(model), ratio)
    assert found.kp == pytest.approx(kp, abs=5e-4)
    if frequency is not None:
        assert found.frequency == pytest.approx(frequency, abs=0.05)


@pytest.mark.reference
def test_the_delayed_model_of_the_table_loses_stability_at_the_known_gain() -> None:
    """G2d fitted to Table 4.1 of Lee (1995), delay 0.0213 s: 1.026 deg per rad/s with C1's ratio of ki to kp."""
    rows = list(csv.DictReader(TABLE.read_text().splitlines()))
    omega, amplitude, lag = (np.array([float(r[k]) for r in rows]) for k in ("frequency_rad_s", "speed_amplitude_rad_s", "phase_lag_deg"))
    response = FrequencyResponse(
        omega=omega,
        values=amplitude / 5.0 * np.exp(-1j * np.deg2rad(lag)),
        input_name="throttle",
        input_unit="deg",
        output_name="engine_speed",
        output_unit="rad/s",
        method="Table 4.1",
    )
    found = limit_of(fit_g2d(response), C1_RATIO)
    assert found.kp == pytest.approx(1.026, abs=5e-4)


def fit_g2d(response: FrequencyResponse) -> TransferFunction:
    return next(named.fit.model for named in fit_all_models(response) if named.name == "g2d")


def test_slow_plants_are_followed_to_their_rest() -> None:
    """A delay of an hour: the first crossing lies far below the frequency that a curve begins at elsewhere."""
    found = limit_of(TransferFunction(numerator=(1.0,), denominator=(1.0, 3600.0), delay=3600.0))
    quick = limit_of(TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0), delay=1.0))
    assert (found.kp, found.frequency * 3600.0) == pytest.approx((quick.kp, quick.frequency), rel=1e-9)


def test_an_unstable_plant_has_a_limit_above_its_least_gain() -> None:
    """(1 - s/10)^-2 needs derivative action; with kd = 1, kp from -1 on: (s/10)^2 + (kd - 0.2) s + 1 + kp has no upper limit."""
    plant = TransferFunction(numerator=(1.0,), denominator=(1.0, -0.2, 0.01))
    assert isinstance(find_gain_limit(family_of_model(plant, kd=1.0), high=200.0), NoGainLimit)


@pytest.mark.parametrize(
    ("plant", "ratio", "words"),
    [
        (TransferFunction(numerator=(-2.0,), denominator=(1.0, 1.0)), 0.0, "positive gain at rest"),
        (
            TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=2.0),
            0.6,
            r"no proportional gain up to 204\.8 stabilises model with ki/kp = 0\.6",
        ),
        (TransferFunction(numerator=(1.0,), denominator=(1.0, -0.1, 1.0)), 0.0, "stabilises model with ki/kp = 0 1/s"),
    ],
    ids=["negative-lag", "no-ratio-is-stable", "no-gain-is-stable"],
)
def test_plants_without_stabilising_gains_are_refused(plant: TransferFunction, ratio: float, words: str) -> None:
    """Else a loop that no gains stabilise would be called safe."""
    with pytest.raises(InvalidInputError, match=words):
        find_gain_limit(family_of_model(plant), integral_ratio=ratio)


def test_a_contour_of_damping_has_no_gain_limit() -> None:
    plant = TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0))
    with pytest.raises(InvalidInputError, match="give no damping"):
        find_gain_limit(family_of_model(plant, contour=Contour(damping=0.1)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"high": 0.0}, "highest frequency = 0 rad/s is outside values above 0"),
        ({"high": math.inf}, "highest frequency = inf rad/s is outside"),
        ({"integral_ratio": -1.0}, "ratio of ki to kp = -1 1/s is outside 0 and above"),
        ({"integral_ratio": math.nan}, "ratio of ki to kp = nan 1/s is outside 0 and above"),
    ],
)
def test_arguments_are_checked(options: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        find_gain_limit(family_of_model(TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0))), **options)


def place_on_g2d(kp: float, ki: float, kd: float) -> RayPlace:
    return place_gains(find_gain_region(family_of_model(G2D, kd=kd)), kp, ki)


@given(kp=st.floats(0.05, 3.0), ki=st.just(0.0) | st.floats(0.1, 40.0), kd=st.sampled_from([0.0, 0.05]))
@settings(max_examples=30, deadline=None)
def test_a_controller_scaled_to_a_crossing_is_on_the_edge(kp: float, ki: float, kd: float) -> None:
    """The count of roots by the principle of the argument, on both sides of the crossings next to the controller."""
    place = place_on_g2d(kp, ki, kd)
    beside = [c for c in (place.fall, place.rise) if c is not None]
    assert beside
    for crossing in beside:
        below, above = (
            count_unstable_poles(
                G2D,
                PidGains(kp=f * kp, ki=f * ki, kd=kd, input_unit="1", output_unit="1", rule="r", designed_on="p"),
            )
            for f in (crossing.factor * (1.0 - 1e-6), crossing.factor * (1.0 + 1e-6))
        )
        assert above - below == crossing.change
        assert place.unstable == (below if crossing.factor > 1.0 else above)


def test_gains_on_no_ray_are_refused() -> None:
    region = find_gain_region(family_of_model(G2D))
    for kp, ki in ((0.0, 0.0), (1.0, -1.0), (math.inf, 1.0)):
        with pytest.raises(InvalidInputError, match="with a kp or ki that is not 0"):
            place_gains(region, kp, ki)
