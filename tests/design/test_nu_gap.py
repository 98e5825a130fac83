"""The nu-gap against published values; more is wanted here before it is relied on."""

import pytest

from revline.design.compared_plant import plant_of_model
from revline.design.nu_gap import find_nu_gap
from revline.lti.transfer_function import TransferFunction

PLANTS = (((100.0,), (1.0, 2.0)), ((-100.0,), (1.0, -2.0)), ((100.0,), (1.0, 2.0, 1.0)))


@pytest.mark.reference
@pytest.mark.parametrize(("one", "two", "gap"), [(0, 1, 0.02), (0, 2, 0.8988), (1, 2, 0.8941)])
def test_published_gaps(one: int, two: int, gap: float) -> None:
    """100/(2 s + 1), 100/(2 s - 1), 100/(s + 1)^2. Source: Zhou and Doyle (1998), Essentials of Robust Control, chapter 17."""
    first, second = (plant_of_model(TransferFunction(numerator=n, denominator=d)) for n, d in (PLANTS[one], PLANTS[two]))
    assert find_nu_gap(first, second).value == pytest.approx(gap, abs=5e-5)
    assert find_nu_gap(second, first).value == pytest.approx(gap, abs=5e-5)
