"""Whether data determine a model: told where they do not, and not told where they do."""

from dataclasses import replace

import numpy as np
import pytest

from revline.design.fitting.determination import COLLINEAR, find_undetermined
from revline.design.fitting.fit import DelayRule, ModelFit, fit_transfer_function
from revline.lti.response import FrequencyResponse
from revline.lti.transfer_function import TransferFunction

TWO_LAGS = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034), delay=0.02)
ONE_LAG = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55))
OMEGA = np.geomspace(0.1, 100.0, 30)


def disturbed(model: TransferFunction, omega: np.ndarray, seed: int, size: float = 0.05) -> FrequencyResponse:
    """The response with random errors of the same size everywhere."""
    draw = np.random.default_rng(seed).normal(size=(2, omega.size))
    exact = model.response(omega)
    return replace(exact, values=exact.values + size * (draw[0] + 1j * draw[1]))


def fitted(response: FrequencyResponse, zeros: int, poles: int, delay: DelayRule = DelayRule.NONE) -> ModelFit:
    return fit_transfer_function(response, zeros=zeros, poles=poles, delay=delay)


@pytest.mark.parametrize("delay", [DelayRule.NONE, DelayRule.PHASE_LINE, DelayRule.FREE])
def test_a_model_that_the_data_show_is_determined(delay: DelayRule) -> None:
    assert find_undetermined(fitted(disturbed(TWO_LAGS, OMEGA, 1, size=1e-3), 0, 2, delay)) == ()


def test_a_pole_that_the_data_do_not_have_is_told_as_often_as_the_interval_says() -> None:
    """Of many draws the true value, 0, lies in the interval of 95 %: binomial, so that fewer than 34 of 40 have a chance of 0.3 %."""
    told = [find_undetermined(fitted(disturbed(ONE_LAG, OMEGA, seed), 0, 2)) for seed in range(40)]
    assert 34 <= sum("denominator's last coefficient may as well be 0" in " ".join(reasons) for reasons in told) <= 40


def test_two_frequencies_determine_little() -> None:
    """One number to spare: Student's t is 12.706 at 95 %, in any table."""
    fit = fitted(disturbed(TWO_LAGS, np.array([0.1, 100.0]), 2), 0, 2)
    (reason,) = find_undetermined(fit)
    half = 12.7062 * fit.denominator_deviation[-1]
    assert reason.endswith(f"({fit.model.denominator[-1]:.3g} +- {half:.2g} at 95 %; spare numbers: 1)")


def test_a_pole_and_a_zero_that_cancel_stand_for_each_other() -> None:
    low = np.linspace(0.01, 0.1, 10)
    fit = fitted(TWO_LAGS.response(low), 1, 2)
    assert fit.optimum.condition > COLLINEAR
    assert find_undetermined(fit)[0].startswith("its parameters stand for each other (condition number ")
    assert find_undetermined(fitted(TWO_LAGS.response(OMEGA), 1, 2)) == ()


def test_a_gain_that_lies_far_from_the_data_is_not_known() -> None:
    reasons = find_undetermined(fitted(disturbed(TWO_LAGS, np.array([70.0, 80.0, 90.0, 100.0]), 3, size=2e-3), 0, 1))
    assert any(reason.startswith("its gain may as well be 0") for reason in reasons)
