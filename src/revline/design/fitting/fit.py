"""Fit transfer functions with delay to frequency responses by output error."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from revline.design.fitting.fit_problem import make_problem
from revline.design.fitting.output_error import Optimum, minimise
from revline.errors import AnalysisError, InvalidInputError
from revline.lti.response import Complexes, Floats, FrequencyResponse, to_decibels
from revline.lti.transfer_function import TransferFunction
from revline.units import DEGREE, Seconds
from revline.values import fingerprint, make_read_only


class DelayRule(Enum):
    """How a fit finds the delay."""

    NONE = "none"
    """There is none."""
    PHASE_LINE = "phase-line"
    """From a straight line through the phase that a fit without delay leaves, as Lee (1995), section 4.4, does."""
    FREE = "free"
    """As one more parameter of the least squares."""
    FIXED = "fixed"
    """It is known, and given: the rational part is fitted to the response with the delay taken out."""


class Weight(Enum):
    """How much each frequency's error counts."""

    NONE = "none"
    """All alike: the fit is best where the response is large."""
    RELATIVE = "relative"
    """Relative to the magnitude there: the fit is equally good in decibels."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhaseLine:
    """A straight line with intercept through the phase difference between data and a model without delay.

    Attributes:
        omega: frequencies in rad/s.
        difference_deg: phase of the data less that of the model, unwrapped.
        slope: of the line, in rad per rad/s, that is s.
        slope_deviation: standard deviation of the slope, in s; 0 for a line through two points.
        intercept_deg: of the line, at zero frequency.
    """

    omega: Floats
    difference_deg: Floats
    slope: Seconds
    slope_deviation: Seconds
    intercept_deg: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def delay(self) -> Seconds:
        """Minus the slope; negative where the data lead the model."""
        return -self.slope

    @property
    def line_deg(self) -> Floats:
        """The line at the frequencies."""
        return self.intercept_deg + self.slope / DEGREE * self.omega

    @property
    def residuals_deg(self) -> Floats:
        """Difference less line."""
        return self.difference_deg - self.line_deg


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelFit:
    """A fitted model with its errors, its uncertainty and what it was made from.

    Attributes:
        model: the transfer function.
        data: the response it was fitted to.
        delay_rule, weight: how.
        optimum: the least squares optimum behind the model: uncertainty, condition, starts. Under the phase-line rule it is that of
            the model without delay.
        phase_line: through the phase difference between the data and the model without its delay.
    """

    model: TransferFunction
    data: FrequencyResponse
    delay_rule: DelayRule
    weight: Weight
    optimum: Optimum
    phase_line: PhaseLine

    @property
    def values(self) -> Complexes:
        """The model's response at the frequencies of the data."""
        return self.model(1j * self.data.omega)

    @property
    def residual_sum(self) -> float:
        """Sum of weighted squared errors of the model, its delay included."""
        return float(np.sum((_weights(self.data, self.weight) * np.abs(self.values - self.data.values)) ** 2))

    @property
    def magnitude_error_db(self) -> Floats:
        """Magnitude of the model less that of the data, in decibels."""
        return to_decibels(np.abs(self.values), self.data.omega) - self.data.magnitude_db

    @property
    def phase_error_deg(self) -> Floats:
        """Phase of the model less that of the data in degrees, unwrapped; positive where the data lag more."""
        return _phase_difference(self.values, self.data.values)

    @property
    def max_magnitude_error_db(self) -> float:
        """Largest magnitude error, without sign."""
        return float(np.max(np.abs(self.magnitude_error_db)))

    @property
    def max_phase_error_deg(self) -> float:
        """Largest phase error, without sign."""
        return float(np.max(np.abs(self.phase_error_deg)))

    @property
    def numerator_deviation(self) -> tuple[float, ...]:
        """Standard deviations of the numerator's coefficients."""
        return self._deviations()[: len(self.optimum.numerator)]

    @property
    def denominator_deviation(self) -> tuple[float, ...]:
        """Standard deviations of the denominator's coefficients; 0 for the first, which is 1."""
        first = len(self.optimum.numerator)
        return (0.0, *self._deviations()[first : first + len(self.optimum.denominator) - 1])

    @property
    def delay_deviation(self) -> Seconds:
        """Standard deviation of the delay in s; 0 where the model has none by rule, or where it is held at 0."""
        if self.delay_rule is DelayRule.FREE:
            known = len(self.optimum.numerator) + len(self.optimum.denominator) - 1
            return next(iter(self._deviations()[known:]), 0.0)
        return self.phase_line.slope_deviation if self.delay_rule is DelayRule.PHASE_LINE else 0.0

    @property
    def data_fingerprint(self) -> str:
        """Digest of the data that the model was fitted to."""
        return fingerprint(self.data)

    def _deviations(self) -> tuple[float, ...]:
        return tuple(np.sqrt(np.diag(self.optimum.covariance)).tolist())


def fit_transfer_function(
    response: FrequencyResponse, *, zeros: int, poles: int, delay: DelayRule | Seconds = DelayRule.NONE, weight: Weight = Weight.NONE
) -> ModelFit:
    """Fit a transfer function to a frequency response: the sum of |model - data|^2 over the frequencies is least.

    All coefficients are free but the denominator's first, which is 1. Poles are not held stable: whether they are is for
    `judge_model` to say.

    Args:
        response: the data.
        zeros: degree of the numerator, at most that of the denominator.
        poles: degree of the denominator.
        delay: how the delay is found, or a known delay in s, at least 0, which is kept (`DelayRule.FIXED`).
        weight: how much each frequency counts.

    Returns:
        The model with errors, uncertainty and provenance.

    Raises:
        InvalidInputError: degrees that make no proper transfer function, too few frequencies for the parameters, data that are all
            zero, or zero at one frequency where it cannot be, or a known delay that is negative or not finite.
        AnalysisError: the data cannot tell the parameters apart, the best model is zero, or the phase line gives a negative delay.
        NotConvergedError: no optimum was reached.

    Source:
        Lee (1995), sections 4.3 and 4.4; Ljung (1999), System Identification, 2nd ed., section 7.2 (output error in the frequency
        domain) and section 9.2 (covariance).
    """
    _check_degrees(zeros, poles)
    rule, known = (delay, 0.0) if isinstance(delay, DelayRule) else (DelayRule.FIXED, _checked_delay(delay))
    if delay is DelayRule.FIXED:
        message = "a fixed delay has no value; give the delay itself in s"
        raise InvalidInputError(message)
    _check_data(response, zeros + 1 + poles + (rule in {DelayRule.FREE, DelayRule.PHASE_LINE}))
    values = response.values * np.exp(1j * response.omega * known)
    optimum = minimise(make_problem(response.omega, values, _weights(response, weight), zeros, poles, int(rule is DelayRule.FREE)))
    model = TransferFunction(
        numerator=optimum.numerator,
        denominator=optimum.denominator,
        delay=optimum.delay + known,
        input_name=response.input_name,
        input_unit=response.input_unit,
        output_name=response.output_name,
        output_unit=response.output_unit,
    )
    if model.numerator == (0.0,):
        message = f"no model of {zeros} zeros and {poles} poles is better than zero; fit more poles"
        raise AnalysisError(message)
    line = fit_phase_line(response, model.with_delay(0.0))
    shown = DelayRule.NONE if rule is DelayRule.PHASE_LINE else rule
    fit = ModelFit(model=model, data=response, delay_rule=shown, weight=weight, optimum=optimum, phase_line=line)
    return add_phase_line(fit) if rule is DelayRule.PHASE_LINE else fit


def add_phase_line(fit: ModelFit) -> ModelFit:
    """Give a model that was fitted without delay the delay of its phase line, as `fit_transfer_function` does under that rule.

    Args:
        fit: without delay.

    Raises:
        InvalidInputError: the fit has a delay already, or the data are too few for one parameter more.
        AnalysisError: the line gives a negative delay.
    """
    if fit.delay_rule is not DelayRule.NONE:
        message = f"the fit has its delay already, by the rule {fit.delay_rule.value}; give one without delay"
        raise InvalidInputError(message)
    zeros, poles, line = len(fit.model.numerator) - 1, len(fit.model.denominator) - 1, fit.phase_line
    _check_data(fit.data, zeros + 1 + poles + 1)
    if line.delay < 0.0:
        message = (
            f"the phase line rises by {line.slope:.4g} s: the data lead the model of {zeros} zeros and {poles} poles, which no delay"
            " explains; fit without delay, or with more zeros"
        )
        raise AnalysisError(message, slope=line.slope)
    return replace(fit, model=fit.model.with_delay(line.delay), delay_rule=DelayRule.PHASE_LINE)


def fit_phase_line(response: FrequencyResponse, model: TransferFunction) -> PhaseLine:
    """Put a straight line with intercept through the phase difference between data and a model, over frequency.

    Args:
        response: the data; between neighbouring frequencies the difference must turn by less than 180 deg.
        model: the transfer function that the data are compared with.

    Raises:
        InvalidInputError: there are fewer than two frequencies, or the data or the model are zero at one.

    Source:
        Lee (1995), section 4.4 and Fig. 4.13.
    """
    omega = response.omega
    if omega.size < 2:
        message = f"a phase line needs at least 2 frequencies, not {omega.size}"
        raise InvalidInputError(message)
    difference = _phase_difference(response.values, model(1j * omega))
    middle = omega - omega.mean()
    spread = float(middle @ middle)
    slope = float(middle @ difference) / spread
    intercept = float(difference.mean() - slope * omega.mean())
    rest = difference - intercept - slope * omega
    variance = float(rest @ rest) / (omega.size - 2) / spread if omega.size > 2 else 0.0
    return PhaseLine(
        omega=omega,
        difference_deg=difference,
        slope=slope * DEGREE,
        slope_deviation=float(np.sqrt(variance)) * DEGREE,
        intercept_deg=intercept,
    )


def _phase_difference(values: Complexes, reference: Complexes) -> Floats:
    """Phase of values less that of a reference, in degrees, unwrapped from the first on."""
    return np.unwrap(np.angle(values * np.conj(reference))) / DEGREE


def _checked_delay(delay: Seconds) -> Seconds:
    if not (np.isfinite(delay) and delay >= 0.0):
        message = f"known delay = {delay:g} s is no delay; give a number of at least 0 s"
        raise InvalidInputError(message, delay=delay)
    return float(delay)


def _weights(response: FrequencyResponse, weight: Weight) -> Floats:
    return np.ones(response.omega.size) if weight is Weight.NONE else 1.0 / response.magnitude


def _check_degrees(zeros: int, poles: int) -> None:
    if zeros < 0 or poles < 0 or zeros > poles:
        message = f"{zeros} zeros and {poles} poles make no proper transfer function; give 0 to {max(poles, 0)} zeros and at least 0 poles"
        raise InvalidInputError(message, zeros=zeros, poles=poles)


def _check_data(response: FrequencyResponse, parameters: int) -> None:
    magnitude = response.magnitude
    measured = 2 * magnitude.size - int(response.omega[0] == 0.0)
    if measured <= parameters:
        message = (
            f"{magnitude.size} frequencies give {measured} numbers for {parameters} parameters; give at least"
            f" {parameters // 2 + 1} frequencies, or fit fewer zeros and poles"
        )
        raise InvalidInputError(message, measured=measured, parameters=parameters)
    if not np.any(magnitude > 0.0):
        message = "the response is zero at all frequencies: there is nothing to fit; check the output and the amplitude of the input"
        raise InvalidInputError(message)
    if not np.all(magnitude > 0.0):
        zero = float(response.omega[magnitude == 0.0][0])
        message = f"the response at {zero:g} rad/s is 0 and has no phase; leave that frequency out"
        raise InvalidInputError(message, frequency=zero)
