import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.design.fitting import output_error
from revline.design.fitting.fit import DelayRule, ModelFit, Weight, fit_phase_line, fit_transfer_function
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError
from revline.lti.response import FrequencyResponse
from revline.lti.transfer_function import TransferFunction
from revline.values import fingerprint

OMEGA = np.geomspace(0.05, 60.0, 30)
G2D = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034), delay=0.02, input_unit="deg", output_unit="rad/s")


def noisy(model: TransferFunction, seed: int = 1, size: float = 1e-3, omega: np.ndarray = OMEGA) -> FrequencyResponse:
    generator = np.random.default_rng(seed)
    noise = size * (generator.standard_normal(omega.size) + 1j * generator.standard_normal(omega.size))
    return FrequencyResponse(omega=omega, values=model(1j * omega) + noise)


def coefficients(fit: ModelFit) -> list[float]:
    return [*fit.model.numerator, *fit.model.denominator]


@st.composite
def stable_models(draw: st.DrawFn) -> TransferFunction:
    """Up to four poles between 0.2 and 30 rad/s, a third apart or more; zeros away from the poles."""
    count = draw(st.integers(1, 4))
    grid = draw(st.lists(st.integers(0, 12), min_size=count, max_size=count, unique=True))
    poles: list[complex] = [-0.2 * 1.5**k for k in sorted(grid)]
    if count >= 2 and draw(st.booleans()):
        poles[-2:] = [poles[-1] * (1.0 + 0.7j), poles[-1] * (1.0 - 0.7j)]
    zeros = [draw(st.sampled_from([-37.0, 41.0, 3.1, 90.0]))] if count >= 2 and draw(st.booleans()) else []
    bottom = np.polynomial.polynomial.polyfromroots(poles).real
    top = np.polynomial.polynomial.polyfromroots(zeros).real if zeros else np.ones(1)
    gain = draw(st.sampled_from([-3.0, 0.001, 12.0, 4e5]))
    return TransferFunction(numerator=tuple(gain / top[0] * top), denominator=tuple(bottom / bottom[0]))


@given(stable_models())
@settings(deadline=None, max_examples=40)
def test_exact_data_give_the_model_back(model: TransferFunction) -> None:
    fit = fit_transfer_function(model.response(OMEGA), zeros=len(model.numerator) - 1, poles=model.order)
    assert fit.model.numerator == pytest.approx(model.numerator, rel=1e-6)
    assert fit.model.denominator == pytest.approx(model.denominator, rel=1e-6)
    assert fit.optimum.starts_agreeing >= 2
    assert fit.max_magnitude_error_db < 1e-6
    assert fit.max_phase_error_deg < 1e-6


@given(st.floats(0.001, 0.3), st.sampled_from([(0, 1), (0, 2), (1, 2)]))
@settings(deadline=None, max_examples=15)
def test_a_free_delay_is_recovered(delay: float, degrees: tuple[int, int]) -> None:
    model = TransferFunction(numerator=(12.0, 0.9)[: degrees[0] + 1], denominator=(1.0, 0.55, 0.034)[: degrees[1] + 1], delay=delay)
    fit = fit_transfer_function(model.response(OMEGA), zeros=degrees[0], poles=degrees[1], delay=DelayRule.FREE)
    assert fit.model.delay == pytest.approx(delay, rel=1e-6)
    assert coefficients(fit) == pytest.approx([*model.numerator, *model.denominator], rel=1e-6)


@pytest.mark.parametrize("lag", [0.3, 3.0])
@pytest.mark.parametrize("weight", Weight)
@pytest.mark.parametrize("turned", [10.0, 40.0])
def test_a_delay_of_many_turns_is_recovered_far_from_rest(lag: float, weight: Weight, turned: float) -> None:
    """Over one decade, far from 0: the first phase is not the one at rest, and a delay sought from it was none or another."""
    omega = np.linspace(1.0, 10.0, 80)
    model = TransferFunction(numerator=(2.0,), denominator=(1.0, lag), delay=turned / omega[-1])
    fit = fit_transfer_function(model.response(omega), zeros=0, poles=1, delay=DelayRule.FREE, weight=weight)
    assert [fit.model.delay, *coefficients(fit)] == pytest.approx([model.delay, 2.0, 1.0, lag], rel=1e-6)


@given(st.floats(0.0, 0.05), st.floats(0.0, 0.04))
@settings(deadline=None, max_examples=20)
def test_a_delay_added_to_the_data_moves_the_phase_line_by_exactly_that(first: float, added: float) -> None:
    model = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034))
    data = noisy(model.with_delay(first))
    later = FrequencyResponse(omega=OMEGA, values=data.values * np.exp(-1j * OMEGA * added))
    assert fit_phase_line(later, model).delay - fit_phase_line(data, model).delay == pytest.approx(added, abs=1e-12)


@given(st.sampled_from([1e-6, 7.0, 1e5]), st.sampled_from([1e-4, 30.0, 1e4]))
@settings(deadline=None, max_examples=9)
def test_units_of_time_and_of_the_output_do_not_matter(gain: float, unit: float) -> None:
    data = noisy(G2D)
    scaled = FrequencyResponse(omega=OMEGA / unit, values=data.values * gain)
    fit = fit_transfer_function(data, zeros=1, poles=2, delay=DelayRule.FREE)
    other = fit_transfer_function(scaled, zeros=1, poles=2, delay=DelayRule.FREE)
    powers = unit ** np.arange(3.0)
    assert other.model.numerator == pytest.approx(gain * powers[:2] * fit.model.numerator, rel=1e-7)
    assert other.model.denominator == pytest.approx(powers * fit.model.denominator, rel=1e-7)
    assert other.model.delay == pytest.approx(unit * fit.model.delay, rel=1e-7)
    assert other.residual_sum == pytest.approx(gain**2 * fit.residual_sum, rel=1e-9)
    assert other.optimum.condition == pytest.approx(fit.optimum.condition, rel=1e-6)


def test_the_optimum_is_lower_than_all_around_it() -> None:
    """The minimum is that of the sum as it is written down, recomputed here without the fit's own scaling and Jacobian."""
    data = noisy(G2D, size=0.05)
    fit = fit_transfer_function(data, zeros=0, poles=2, delay=DelayRule.FREE)
    best = np.array([*fit.model.numerator, *fit.model.denominator[1:], fit.model.delay])

    def cost(x: np.ndarray) -> float:
        s = 1j * data.omega
        return float(np.sum(np.abs(x[0] / (1.0 + x[1] * s + x[2] * s**2) * np.exp(-s * x[3]) - data.values) ** 2))

    assert cost(best) == pytest.approx(fit.residual_sum, rel=1e-12)
    for k in range(4):
        for sign in (-1.0, 1.0):
            moved = best.copy()
            moved[k] *= 1.0 + sign * 1e-4
            assert cost(moved) > fit.residual_sum
    assert fit.optimum.gradient < 1e-12


def test_relative_weight_minimises_the_relative_error() -> None:
    data = noisy(G2D, size=0.01)
    plain = fit_transfer_function(data, zeros=0, poles=1)
    relative = fit_transfer_function(data, zeros=0, poles=1, weight=Weight.RELATIVE)

    def relative_sum(fit: ModelFit) -> float:
        return float(np.sum(np.abs(fit.values / data.values - 1.0) ** 2))

    assert relative_sum(relative) == pytest.approx(relative.residual_sum)
    assert relative_sum(relative) < 0.9 * relative_sum(plain)
    assert plain.residual_sum < float(np.sum(np.abs(relative.values - data.values) ** 2))


def test_standard_deviations_are_those_of_repeated_experiments() -> None:
    """60 fits to data with fresh noise of a known size: the spread is what each fit says, within sampling error."""
    model = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55), delay=0.05)
    fits = [fit_transfer_function(noisy(model, seed, 0.05), zeros=0, poles=1, delay=DelayRule.FREE) for seed in range(60)]
    spread = np.std([[f.model.numerator[0], f.model.denominator[1], f.model.delay] for f in fits], axis=0)
    said = np.mean([[f.numerator_deviation[0], f.denominator_deviation[1], f.delay_deviation] for f in fits], axis=0)
    assert said == pytest.approx(spread, rel=0.25)
    assert fits[0].denominator_deviation[0] == 0.0


def test_a_free_delay_does_not_go_below_zero() -> None:
    """A lead in the data would be met best by a negative delay; the fit stays at 0 and is the fit without delay."""
    lead = FrequencyResponse(omega=OMEGA, values=np.asarray(G2D.with_delay(0.0)(1j * OMEGA) * np.exp(0.01j * OMEGA)))
    free = fit_transfer_function(lead, zeros=0, poles=2, delay=DelayRule.FREE)
    none = fit_transfer_function(lead, zeros=0, poles=2)
    assert (free.model.delay, free.delay_deviation) == (0.0, 0.0)
    assert coefficients(free) == pytest.approx(coefficients(none), rel=1e-9)


def test_the_starts_are_in_the_report() -> None:
    fit = fit_transfer_function(noisy(G2D), zeros=0, poles=2)
    names = [start.name for start in fit.optimum.starts]
    assert {"Levy", "Sanathanan-Koerner"} < set(names)
    assert fit.optimum.starts_agreeing == len(names)
    assert min(start.residual_sum for start in fit.optimum.starts) == pytest.approx(fit.residual_sum)


def test_phase_line_of_exact_data() -> None:
    fit = fit_transfer_function(G2D.response(OMEGA), zeros=0, poles=2, delay=DelayRule.PHASE_LINE)
    line = fit.phase_line
    assert fit.model.delay == line.delay == -line.slope
    assert line.residuals_deg == pytest.approx(line.difference_deg - line.line_deg)
    exact = fit_phase_line(G2D.response(OMEGA), G2D.with_delay(0.0))
    assert exact.delay == pytest.approx(0.02, rel=1e-12)
    assert exact.intercept_deg == pytest.approx(0.0, abs=1e-10)
    assert exact.slope_deviation < 1e-12
    two = FrequencyResponse(omega=np.array([1.0, 2.0]), values=np.exp(-0.5j * np.array([1.0, 2.0])))
    assert fit_phase_line(two, TransferFunction(numerator=(1.0,), denominator=(1.0,))).slope_deviation == 0.0


def test_errors_have_the_sign_of_model_less_data() -> None:
    data = FrequencyResponse(omega=OMEGA, values=np.asarray(G2D.with_delay(0.0)(1j * OMEGA) * np.exp(-0.1j)))
    fit = fit_transfer_function(data, zeros=0, poles=2)
    assert fit.phase_error_deg[0] > 0.0
    assert fit.max_phase_error_deg == np.max(np.abs(fit.phase_error_deg))
    assert fit.magnitude_error_db == pytest.approx(20.0 * np.log10(np.abs(fit.values) / data.magnitude))
    assert fit.delay_deviation == 0.0


def test_provenance_names_units_and_data() -> None:
    data = G2D.response(OMEGA)
    fit = fit_transfer_function(data, zeros=0, poles=2)
    assert (fit.model.input_unit, fit.model.output_unit) == ("deg", "rad/s")
    assert fit.data_fingerprint == fingerprint(data)
    assert fit.data_fingerprint != fit_transfer_function(noisy(G2D), zeros=0, poles=2).data_fingerprint


def test_a_zero_frequency_and_a_constant_gain() -> None:
    omega = np.array([0.0, 1.0, 3.0])
    lag = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.3))
    assert coefficients(fit_transfer_function(lag.response(omega), zeros=0, poles=1)) == pytest.approx([2.0, 1.0, 0.3])
    gain = TransferFunction(numerator=(2.0,), denominator=(1.0,), delay=0.1)
    fit = fit_transfer_function(gain.response(omega), zeros=0, poles=0, delay=DelayRule.FREE)
    assert (fit.model.numerator[0], fit.model.delay) == pytest.approx((2.0, 0.1))


def test_an_unstable_model_is_fitted_as_it_is() -> None:
    unstable = TransferFunction(numerator=(2.0,), denominator=(1.0, -0.5, 0.02))
    fit = fit_transfer_function(unstable.response(OMEGA), zeros=0, poles=2)
    assert coefficients(fit) == pytest.approx([2.0, 1.0, -0.5, 0.02], rel=1e-6)


@pytest.mark.parametrize(("zeros", "poles"), [(2, 1), (-1, 1), (0, -1)])
def test_degrees_of_no_proper_transfer_function_are_refused(zeros: int, poles: int) -> None:
    with pytest.raises(InvalidInputError, match=f"{zeros} zeros and {poles} poles make no proper transfer function"):
        fit_transfer_function(noisy(G2D), zeros=zeros, poles=poles)


def test_data_that_cannot_be_fitted_are_refused() -> None:
    few = FrequencyResponse(omega=np.array([1.0, 2.0]), values=np.array([1.0, 0.5]))
    with pytest.raises(InvalidInputError, match="2 frequencies give 4 numbers for 4 parameters; give at least 3 frequencies"):
        fit_transfer_function(few, zeros=0, poles=2, delay=DelayRule.FREE)
    with pytest.raises(InvalidInputError, match="zero at all frequencies"):
        fit_transfer_function(FrequencyResponse(omega=OMEGA, values=np.zeros(30, dtype=complex)), zeros=0, poles=1)
    fading = np.asarray(np.append(np.ones(29), 0.0), dtype=complex)
    with pytest.raises(InvalidInputError, match="response at 60 rad/s is 0 and has no phase"):
        fit_transfer_function(FrequencyResponse(omega=OMEGA, values=fading), zeros=0, poles=1)
    with pytest.raises(InvalidInputError, match="a phase line needs at least 2 frequencies, not 1"):
        fit_phase_line(FrequencyResponse(omega=np.ones(1), values=np.ones(1, dtype=complex)), G2D)


def test_a_phase_that_leads_gives_no_delay() -> None:
    values = np.asarray(G2D.with_delay(0.0)(1j * OMEGA) * np.exp(0.01j * OMEGA))
    with pytest.raises(AnalysisError, match=r"the phase line rises by .* the data lead the model of 0 zeros and 2 poles"):
        fit_transfer_function(FrequencyResponse(omega=OMEGA, values=values), zeros=0, poles=2, delay=DelayRule.PHASE_LINE)


def test_a_zero_and_a_pole_that_cancel_are_refused() -> None:
    lag = TransferFunction(numerator=(2.0,), denominator=(1.0, 0.3))
    with pytest.raises(AnalysisError, match="cannot tell the 4 parameters of 1 zeros and 2 poles apart"):
        fit_transfer_function(lag.response(OMEGA), zeros=1, poles=2)


def test_a_search_that_stops_early_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output_error, "_TOLERANCE", 0.5)
    monkeypatch.setattr(output_error, "_POLISH_STEPS", 0)
    rough = noisy(G2D, size=1.0)
    with pytest.raises(NotConvergedError, match=r"0 zeros and 2 poles did not converge: the gradient is"):
        fit_transfer_function(rough, zeros=0, poles=2)


@pytest.mark.parametrize("weight", Weight)
@pytest.mark.parametrize("delay", [DelayRule.NONE, DelayRule.FREE])
@pytest.mark.parametrize("poles", [1, 2, 3])
def test_data_that_only_an_infinite_coefficient_would_meet_end_in_an_error(poles: int, delay: DelayRule, weight: Weight) -> None:
    """An integrator has no constant of 1 in its denominator: the coefficients run away, overflow on the way, and nothing breaks."""
    integrator = TransferFunction(numerator=(3.0,), denominator=(0.0, 1.0)).response(np.geomspace(1e-3, 1e3, 20))
    with pytest.raises(AnalysisError, match=r"cannot tell the .* parameters|did not converge"):
        fit_transfer_function(integrator, zeros=0, poles=poles, delay=delay, weight=weight)


def test_a_model_that_is_best_at_zero_is_refused() -> None:
    quadrature = FrequencyResponse(omega=OMEGA, values=np.full(OMEGA.size, -2.0j))
    with pytest.raises(AnalysisError, match="no model of 0 zeros and 0 poles is better than zero; fit more poles"):
        fit_transfer_function(quadrature, zeros=0, poles=0)


def test_extreme_weights_do_not_overflow() -> None:
    data = FrequencyResponse(omega=OMEGA, values=np.asarray(G2D(1j * OMEGA) * 1e-200, dtype=complex))
    fit = fit_transfer_function(data, zeros=0, poles=2, delay=DelayRule.FREE, weight=Weight.RELATIVE)
    assert fit.model.denominator == pytest.approx(G2D.denominator, rel=1e-6)
    assert fit.model.numerator[0] == pytest.approx(12e-200, rel=1e-6)


@pytest.mark.parametrize("weight", Weight)
def test_a_known_delay_is_kept_and_the_rest_recovered(weight: Weight) -> None:
    fit = fit_transfer_function(G2D.response(OMEGA), zeros=0, poles=2, delay=G2D.delay, weight=weight)
    assert (fit.delay_rule, fit.model.delay, fit.delay_deviation) == (DelayRule.FIXED, G2D.delay, 0.0)
    assert coefficients(fit) == pytest.approx([*G2D.numerator, *G2D.denominator], rel=1e-6)


def test_a_free_delay_fits_no_worse_than_any_known_one() -> None:
    data = noisy(G2D, size=1e-2)
    free = fit_transfer_function(data, zeros=0, poles=2, delay=DelayRule.FREE)
    at_it, beside, wrong = (
        fit_transfer_function(data, zeros=0, poles=2, delay=delay).residual_sum
        for delay in (free.model.delay, 1.01 * free.model.delay, 2.0 * free.model.delay)
    )
    assert at_it == pytest.approx(free.residual_sum, rel=1e-9)
    assert free.residual_sum < beside < wrong


@pytest.mark.parametrize("delay", [-0.01, float("nan"), float("inf")])
def test_a_known_delay_that_is_none_is_refused(delay: float) -> None:
    with pytest.raises(InvalidInputError, match=r"known delay = .* s is no delay; give a number of at least 0 s"):
        fit_transfer_function(G2D.response(OMEGA), zeros=0, poles=2, delay=delay)


def test_a_fixed_delay_needs_its_value() -> None:
    with pytest.raises(InvalidInputError, match="a fixed delay has no value; give the delay itself in s"):
        fit_transfer_function(G2D.response(OMEGA), zeros=0, poles=2, delay=DelayRule.FIXED)
