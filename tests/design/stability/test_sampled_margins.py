"""Margins of sampled responses: against exact margins and closed forms, within the error they state, and what they must not claim."""

import math
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.stability.margins import Margins, find_margins
from revline.design.stability.open_loop import open_loop_of_model, open_loop_of_system
from revline.design.stability.sampled_margins import SampledMargins, find_sampled_margins
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.io.margin_records import margin_fields
from revline.io.response_files import read_response
from revline.lti.response import FrequencyResponse, count_turns
from revline.lti.state_space import position
from revline.lti.transfer_function import TransferFunction

TABLE = read_response(Path(__file__).parents[2] / "reference" / "table_4_1.csv").response.omega
"""The frequencies of the thesis's Table 4.1."""

LAG = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.8), delay=0.1)
G2D = TransferFunction(numerator=(12.0149,), denominator=(1.0, 0.55104, 0.035517), delay=0.0214)
FACTOR = 1.5
"""The stated error is an estimate, no bound: this much more is allowed."""


def pid(kp: float, ki: float = 0.0, kd: float = 0.0, units: tuple[str, str] = ("1", "1")) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit=units[0], output_unit=units[1], rule="by hand", designed_on="test")


def sample(plant: TransferFunction, omega: np.ndarray, known_delay: float = 0.0) -> FrequencyResponse:
    return FrequencyResponse(omega=omega, values=plant(1j * omega), known_delay=known_delay)


def agrees(sampled: SampledMargins, exact: Margins) -> None:
    fields = margin_fields(exact)
    assert {"phase_margin_deg", "ms", "disk_margin"} <= sampled.errors.keys()
    for key, error in sampled.errors.items():
        wanted = fields[key]
        assert isinstance(wanted, float)
        assert sampled.values[key] == pytest.approx(wanted, abs=FACTOR * error + 2e-5 * abs(wanted)), key


@pytest.mark.parametrize("gains", [(1.0, 0.0, 0.0), (2.153, 16.85, 0.0), (1.2, 2.0, 0.1)], ids=["p", "c1", "c2d"])
def test_the_engine_at_the_tables_frequencies_has_its_exact_margins(gains: tuple[float, float, float]) -> None:
    engine = lee1995()
    model = linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model
    plant = model.transfer(1j * TABLE)[:, position(model.outputs, "engine_speed"), position(model.inputs, "throttle")]
    response = FrequencyResponse(omega=TABLE, values=plant, input_unit="deg", output_unit="rad/s")
    controller = pid(*gains, ("rad/s", "deg"))
    exact = find_margins(open_loop_of_system(model, controller))
    found = find_sampled_margins(response, controller)
    agrees(found, exact)
    assert found.unstable_poles == (round(exact.unstable_poles),)


@pytest.mark.parametrize("known_delay", [0.0, 0.0214])
def test_the_tables_model_has_its_exact_margins(known_delay: float) -> None:
    for gains in (pid(0.5), pid(1.2, 2.0, 0.1), pid(2.153, 16.85)):
        exact = find_margins(open_loop_of_model(G2D, gains))
        found = find_sampled_margins(sample(G2D, TABLE, known_delay), gains)
        agrees(found, exact)
        assert found.unstable_poles == (round(exact.unstable_poles),)


def test_first_order_and_dead_time_have_their_closed_form() -> None:
    """The root w of 0.1 w = pi - arctan(0.8 w) is 16.465665382937, where the gain may rise to sqrt(1 + (0.8 w)^2)/2."""
    found = find_sampled_margins(sample(LAG, np.geomspace(0.1, 40.0, 60), 0.1), pid(1.0))
    assert found.phase_crossovers[0].frequency == pytest.approx(16.465665382937, rel=1e-5)
    assert found.values["gain_margin"] == pytest.approx(6.605217773885, abs=FACTOR * found.errors["gain_margin"] + 1e-6)
    frequency = math.sqrt(3.0) / 0.8
    assert found.gain_crossovers[0].frequency == pytest.approx(frequency, rel=1e-5)
    margin = 180.0 - math.degrees(math.atan(0.8 * frequency) + 0.1 * frequency)
    assert found.values["phase_margin_deg"] == pytest.approx(margin, abs=FACTOR * found.errors["phase_margin_deg"] + 1e-5)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.1, 2.0), st.floats(0.02, 1.0), st.floats(0.0, 0.3), st.floats(2.0, 8.0), st.floats(0.05, 2.0))
def test_random_plants_have_their_exact_margins(first: float, second: float, delay: float, gain: float, integral: float) -> None:
    plant = TransferFunction(numerator=(gain,), denominator=(1.0, first + second, first * second), delay=delay)
    gains = pid(1.0, integral)
    omega = np.geomspace(0.01, 100.0, 60)
    exact = find_margins(open_loop_of_model(plant, gains))
    found = find_sampled_margins(sample(plant, omega, delay), gains)
    for key in ("phase_margin_deg", "delay_margin_s", "ms"):
        wanted = margin_fields(exact)[key]
        assert isinstance(wanted, float)
        assert found.values[key] == pytest.approx(wanted, rel=2e-3, abs=FACTOR * found.errors[key])
    assert found.unstable_poles == (round(exact.unstable_poles),)


def test_python_control_finds_the_same_on_the_samples() -> None:
    omega = np.geomspace(0.1, 100.0, 200)
    gains = pid(1.2, 2.0, 0.1)
    found = find_sampled_margins(sample(G2D, omega), gains)
    loop = G2D(1j * omega) * (1.2 + 2.0 / (1j * omega) + 0.1j * omega)
    gain, phase, *_ = control.stability_margins(control.FRD(loop, omega, smooth=True))
    assert found.values["gain_margin"] == pytest.approx(gain, rel=1e-3)
    assert found.values["phase_margin_deg"] == pytest.approx(phase, abs=0.02)


def test_fewer_samples_have_a_larger_stated_error() -> None:
    omega = np.geomspace(0.1, 100.0, 40)
    kept = omega[np.arange(omega.size) % 3 != 1]
    whole, thinned = (find_sampled_margins(sample(G2D, grid), pid(1.2, 2.0, 0.1)) for grid in (omega, kept))
    assert thinned.errors["gain_margin"] > 2.0 * whole.errors["gain_margin"]


def test_a_wrong_scale_is_not_within_the_stated_error_and_a_note_says_so() -> None:
    response = sample(G2D, np.geomspace(0.1, 100.0, 80))
    right, wrong = (find_sampled_margins(replace(response, values=f * response.values), pid(1.2, 2.0, 0.1)) for f in (1.0, 1.01))
    shift = abs(right.values["gain_margin"] - wrong.values["gain_margin"])
    assert shift == pytest.approx(0.01 * right.values["gain_margin"], rel=0.02)
    assert shift > 10.0 * wrong.errors["gain_margin"]
    assert any("error of the samples themselves" in note for note in wrong.notes)


def test_what_lies_outside_the_band_is_not_known() -> None:
    found = find_sampled_margins(sample(G2D, np.geomspace(0.01, 1.0, 30)), pid(1.0))
    assert not {"gain_margin", "phase_margin_deg", "delay_margin_s"} & found.values.keys()
    assert found.unstable_poles == ()
    said = " ".join(found.notes)
    for words in ("no gain crossover in the band", "gain margin is not known", "crossovers above the band", "not counted", "band's end"):
        assert words in said


def test_an_unstable_plant_needs_its_number_of_poles() -> None:
    """2/(s - 1) under kp = 1 is stable: one encirclement; said to have no unstable pole, the count is impossible."""
    plant = TransferFunction(numerator=(-2.0,), denominator=(1.0, -1.0))
    response = sample(plant, np.geomspace(0.01, 100.0, 60))
    assert find_sampled_margins(response, pid(1.0), unstable_poles=1).unstable_poles == (0,)
    assert find_sampled_margins(response, pid(0.4), unstable_poles=1).unstable_poles == (1,)
    with pytest.raises(InvalidInputError, match=r"unstable poles = 0 of the open loop is too few.*give at least 1"):
        find_sampled_margins(response, pid(1.0))


def test_samples_too_coarse_to_unwrap_are_refused_with_a_number_that_does() -> None:
    coarse = np.geomspace(0.1, 100.0, 10)
    slow = replace(LAG, delay=1.0)
    with pytest.raises(
        InvalidInputError, match=r"too coarse to unwrap and interpolate: from .* rad/s its phase steps by .* deg \(limit 100\)"
    ):
        find_sampled_margins(sample(slow, coarse), pid(1.0))
    assert find_sampled_margins(sample(slow, coarse, 1.0), pid(1.0)).samples == 10


def test_what_is_refused() -> None:
    whole = sample(LAG, np.geomspace(0.1, 40.0, 60), 0.1)
    with pytest.raises(InvalidInputError, match="2 samples are too few for margins"):
        find_sampled_margins(sample(LAG, np.array([1.0, 2.0])), pid(1.0))
    with pytest.raises(InvalidInputError, match="sample at 0 rad/s has a frequency or a magnitude of 0"):
        find_sampled_margins(sample(LAG, np.linspace(0.0, 10.0, 30)), pid(1.0))
    with pytest.raises(InvalidInputError, match="unstable poles = -1 of the open loop is negative"):
        find_sampled_margins(whole, pid(1.0), unstable_poles=-1)
    with pytest.raises(InvalidInputError, match="kp, ki and kd are all 0"):
        find_sampled_margins(whole, pid(0.0))
    with pytest.raises(InvalidInputError, match="response's output is in rpm and the controller's gains are for rad/s"):
        find_sampled_margins(replace(whole, output_unit="rpm"), pid(1.0, units=("rad/s", "deg")))
    values = np.exp(-1j * whole.omega * 1e6)
    turning = replace(whole, values=values, turns=count_turns(values, np.degrees(-whole.omega * 1e6)))
    with pytest.raises(InvalidInputError, match="turns the loop too fast to be followed"):
        find_sampled_margins(turning, pid(1.0), delay=1e6)


def test_a_resonance_that_only_just_passes_1_has_both_its_crossovers() -> None:
    """As in the exact margins: L = k w0^2/(s^2 + 2 z w0 s + w0^2) passes 1 by 1e-8, where the interpolation is better than that."""
    z, excess = 0.2, 1e-8
    top = 2.0 * z * math.sqrt(1.0 - z**2)
    spread = top * math.sqrt((1.0 + excess) ** 2 - 1.0)
    for resonance in (3.0, 3.0175, 3.03):  # the last two have both between neighbours of the grid
        plant = TransferFunction(numerator=(top * (1.0 + excess),), denominator=(1.0, 2.0 * z / resonance, 1.0 / resonance**2))
        found = find_sampled_margins(sample(plant, np.geomspace(0.1, 40.0, 2400)), pid(1.0)).gain_crossovers
        wanted = [resonance * math.sqrt(1.0 - 2.0 * z**2 + side * spread) for side in (-1.0, 1.0)]
        assert [crossover.frequency for crossover in found] == pytest.approx(wanted, rel=1e-6)
