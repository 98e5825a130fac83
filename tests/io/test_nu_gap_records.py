import math
from dataclasses import replace

import pytest

from revline.design.controllers.controller import PidGains
from revline.design.stability.compared_plant import plant_of_model
from revline.design.stability.nu_gap import Guarantee, judge_controller
from revline.io.nu_gap_records import describe_guarantee, guarantee_record, summarise
from revline.lti.transfer_function import TransferFunction

GAINS = PidGains(kp=1.0, ki=1.0, kd=0.0, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a test")


@pytest.fixture(scope="module")
def verdict() -> Guarantee:
    first, second = (
        plant_of_model(TransferFunction(numerator=(k,), denominator=(1.0, 1.0), delay=0.1, input_unit="deg", output_unit="rad/s"), name=n)
        for k, n in ((2.0, "one"), (2.2, "two"))
    )
    return judge_controller(first, second, GAINS)


def test_each_case_has_its_own_words(verdict: Guarantee) -> None:
    said = summarise(verdict, "c")
    assert f"is below c's margin {verdict.margin:.3g} on one: it is sure to stabilise two, with a margin of at least" in said
    wide = replace(verdict, gap=replace(verdict.gap, value=0.9))
    assert "not below c's margin" in summarise(wide, "c")
    assert "but at each frequency the chord is below the loop's own: it is sure to stabilise two" in summarise(wide, "c")
    far = replace(wide, reserve=-0.1, other_margin=0.0, unstable_poles=(0.0, math.inf))
    assert summarise(far, "c").endswith(
        "one says nothing about this loop on two; by its own count the loop there is unstable, with infinitely many poles right of the axis"
    )
    near = replace(verdict, reserve=-0.1, gap=replace(verdict.gap, value=0.0, beyond=0.99))
    assert "that what lies beyond" in summarise(near, "c")
    turned = replace(verdict, reserve=-0.1, gap=replace(verdict.gap, value=1.0, winding=-2))
    assert "do not turn alike" in summarise(turned, "c")
    assert summarise(replace(verdict, unstable_poles=(2.0, 0.0), margin=0.0), "c").startswith("c does not stabilise one itself")


def test_a_record_leaves_out_what_does_not_exist(verdict: Guarantee) -> None:
    whole = guarantee_record(verdict, "c")
    assert whole["controller"] == {"name": "c", "kp": 1.0, "ki": 1.0, "kd": 0.0, "rule": "by hand"}
    assert whole["second_margin"] == verdict.other_margin
    far = replace(verdict, reserve=-0.1, gap=replace(verdict.gap, value=0.9), other_margin=0.0, unstable_poles=(0.0, math.inf))
    record = guarantee_record(far, "c")
    assert whole.keys() - record.keys() == {
        "second_unstable_poles",
        "margin_floor",
        "margin_floor_by_frequency",
        "closest_frequency_rad_s",
        "second_margin",
    }
    assert ("guaranteed", "no", "") in describe_guarantee(far)
