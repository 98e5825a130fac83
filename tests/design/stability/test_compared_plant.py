"""What cannot be compared in the nu-gap is refused, with the remedy."""

from dataclasses import replace

import numpy as np
import pytest

from revline.design.controllers.controller import PidGains
from revline.design.plants.loop_signals import OF_LINEAR_MODEL
from revline.design.stability.compared_plant import ComparedPlant, constant_weight, controller_weight, plant_of_model, plant_of_system
from revline.design.stability.nu_gap import find_nu_gap, judge_controller
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError
from revline.lti.interconnection import to_state_space
from revline.lti.transfer_function import TransferFunction


def plant(numerator: tuple[float, ...], denominator: tuple[float, ...], delay: float = 0.0, *, output_unit: str = "rad/s") -> ComparedPlant:
    return plant_of_model(
        TransferFunction(numerator=numerator, denominator=denominator, delay=delay, input_unit="deg", output_unit=output_unit), name="it"
    )


def pid(kp: float, ki: float = 0.0, kd: float = 0.0) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a test")


LAG = plant((2.0,), (1.0, 0.8))


@pytest.mark.parametrize("value", [0.0, -1.0, float("inf")])
def test_a_weight_is_above_zero(value: float) -> None:
    with pytest.raises(InvalidInputError, match=r"weight = .* give 1, or the inverse of the gain at rest"):
        constant_weight(value)


def test_a_controller_without_gains_is_no_weight() -> None:
    with pytest.raises(InvalidInputError, match="all gains of the controller are 0"):
        controller_weight(pid(0.0))


@pytest.mark.parametrize(
    ("numerator", "denominator", "words"),
    [
        ((0.0,), (1.0, 1.0), "it is zero at all frequencies"),
        ((0.0, 1.0), (0.0, 1.0, 1.0), "poles and zeros at s = 0 that cancel; divide both"),
        ((1.0,), (1.0, 0.0, 0.25), "a pole on the imaginary axis at 2 rad/s.*give it a little damping"),
    ],
)
def test_models_that_are_refused(numerator: tuple[float, ...], denominator: tuple[float, ...], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        plant(numerator, denominator)


def system(numerator: tuple[float, ...], denominator: tuple[float, ...], delay: float = 0.0) -> ComparedPlant:
    model = TransferFunction(numerator=numerator, denominator=denominator, delay=delay, input_unit="deg", output_unit="rad/s")
    return plant_of_system(to_state_space(model), wires=OF_LINEAR_MODEL)


def test_systems_that_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="does not answer input at rest"):
        system((0.0, 1.0), (1.0, 1.0))
    with pytest.raises(InvalidInputError, match=r"a pole on the imaginary axis at 2 rad/s"):
        system((1.0,), (1.0, 0.0, 0.25))


def test_units_must_be_alike() -> None:
    other = plant((2.0,), (1.0, 0.8), output_unit="rpm")
    with pytest.raises(InvalidInputError, match="from deg to rad/s, it from deg to rpm; convert one"):
        find_nu_gap(LAG, other)
    with pytest.raises(InvalidInputError, match="from deg to rpm, the controller from rad/s to deg; convert one"):
        judge_controller(other, other, pid(1.0))


def test_what_is_improper_is_refused_and_a_filter_named() -> None:
    with pytest.raises(InvalidInputError, match=r"it weighed by the constant 1 is improper.*filter the derivative"):
        find_nu_gap(plant((1.0, 1.0, 1.0), (1.0, 1.0)), LAG)
    with pytest.raises(InvalidInputError, match=r"without a filter: under a constant weight .* weigh by the controller instead"):
        judge_controller(LAG, LAG, pid(1.0, 0.0, 0.1), weight=constant_weight(1.0))
    slow = plant((1e10,), (1.0, 0.01))
    with pytest.raises(InvalidInputError, match=r"does not fall up to .* improper, or nearly so"):
        find_nu_gap(slow, slow)


def test_delayed_feedthrough_of_both_has_no_distance() -> None:
    through = plant((1.0, 0.5), (1.0, 1.0))
    with pytest.raises(InvalidInputError, match="pass their input straight through, and one with a delay"):
        find_nu_gap(through, plant((1.0, 0.5), (1.0, 1.0), 0.1))
    with pytest.raises(InvalidInputError, match=r"passes its input straight through.*add the lag"):
        judge_controller(through, through, pid(1.0))
    assert find_nu_gap(through, plant((1.0, 0.6), (1.0, 1.0))).value < 0.1


def test_integral_action_on_a_zero_at_rest_is_refused() -> None:
    washout = plant((0.0, 1.0), (1.0, 1.0, 1.0))
    with pytest.raises(InvalidInputError, match="cancels a zero of it at s = 0, and would never settle"):
        judge_controller(washout, washout, pid(1.0, 1.0))
    assert judge_controller(washout, washout, pid(1.0)).margin > 0.1


def test_a_plant_with_no_leading_power_is_an_error() -> None:
    slow = plant((1e-14, 1.0), (1.0, 1.0, 1.0))
    with pytest.raises(NotConvergedError, match="no leading power of s rules down to"):
        find_nu_gap(slow, LAG)


def test_a_zero_on_the_axis_is_an_error() -> None:
    """The response is 0 where the grid stands: no phase there."""
    silent = replace(LAG, transfer=lambda s: np.where(np.abs(s) > 0.1, 0.0, 2.0).astype(complex))
    with pytest.raises(NotConvergedError, match="has a pole or a zero on the imaginary axis"):
        find_nu_gap(silent, LAG)


def test_counts_that_differ_are_an_error() -> None:
    """A hidden unstable part: the loop's own poles are one more than the Nyquist curve turns."""
    hidden = replace(LAG, unstable_closed=lambda _: 1.0)
    with pytest.raises(AnalysisError, match="has 1 unstable poles, but by its Nyquist curve 0: the plant hides an unstable part"):
        judge_controller(LAG, hidden, pid(1.0))


def test_poles_that_are_not_counted_would_be_seen() -> None:
    unstable = plant((-4.0,), (1.0, -1.0))
    wrong = replace(unstable, unstable_poles=0)
    assert find_nu_gap(plant((4.0,), (1.0, 1.0)), unstable).value < 0.5
    assert find_nu_gap(plant((4.0,), (1.0, 1.0)), wrong).value == 1.0
    with pytest.raises(AnalysisError, match="hides an unstable part"):
        judge_controller(unstable, wrong, pid(2.0))


def test_a_system_and_its_transfer_function_are_no_distance_apart() -> None:
    assert find_nu_gap(system((1.5,), (1.0, 0.5), 0.1), plant((1.5,), (1.0, 0.5), 0.1)).value < 1e-12
