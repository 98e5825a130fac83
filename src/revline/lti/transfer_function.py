"""Transfer functions with a delay that stays exact: numerator / denominator * exp(-s delay)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError
from revline.lti.inverse_laplace import inverse_laplace, inverse_laplace_each
from revline.lti.polynomial import Coefficients, polynomial_roots, polynomial_values, trim_coefficients
from revline.lti.response import Complexes, Floats, FrequencyResponse, check_delay, check_frequencies, to_decibels
from revline.units import DEGREE, Seconds


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferFunction:
    """A linear model of one input and one output: numerator(s) / denominator(s) * exp(-s delay).

    Coefficients stand in ascending powers of s. They are normalised so that the lowest coefficient of the denominator that is not
    zero is 1; zeros at the highest powers are dropped.

    Attributes:
        numerator, denominator: coefficients; any sequence is taken.
        delay: in s.
        input_name, input_unit, output_name, output_unit: the signals.

    Raises:
        InvalidInputError: a coefficient is not finite, the denominator is zero, or the delay is negative or not finite.

    Example:
        >>> TransferFunction(numerator=(24.0,), denominator=(2.0, 1.0), delay=0.02).static_gain
        12.0
    """

    numerator: Coefficients
    denominator: Coefficients
    delay: Seconds = 0.0
    input_name: str = "input"
    input_unit: str = "1"
    output_name: str = "output"
    output_unit: str = "1"

    def __post_init__(self) -> None:
        numerator = trim_coefficients(self.numerator, "numerator")
        denominator = trim_coefficients(self.denominator, "denominator")
        check_delay(self.delay)
        lowest = next((c for c in denominator if c != 0.0), None)
        if lowest is None:
            message = "the denominator is zero; give at least one coefficient that is not"
            raise InvalidInputError(message)
        object.__setattr__(self, "numerator", trim_coefficients([c / lowest for c in numerator], "normalised numerator"))
        object.__setattr__(self, "denominator", trim_coefficients([c / lowest for c in denominator], "normalised denominator"))
        object.__setattr__(self, "delay", float(self.delay))

    def __call__(self, s: ArrayLike) -> Complexes:
        """Evaluate at complex numbers.

        Args:
            s: complex numbers of any shape, in rad/s.

        Raises:
            InvalidInputError: one of them is a pole, or the value there is beyond the range of numbers.
        """
        points = np.asarray(s, dtype=complex)
        with np.errstate(all="ignore"):
            values = polynomial_values(self.numerator, points) / polynomial_values(self.denominator, points) * np.exp(-points * self.delay)
        if not np.all(np.isfinite(values)):
            bad = complex(np.atleast_1d(points)[~np.isfinite(np.atleast_1d(values))][0])
            message = f"the transfer function has no finite value at s = {bad:g} rad/s: a pole, or too far out; leave that point out"
            raise InvalidInputError(message, real=bad.real, imaginary=bad.imag)
        return np.asarray(values)

    @property
    def poles(self) -> Complexes:
        """Roots of the denominator in rad/s, by rising magnitude."""
        return _roots_of(self.denominator).copy()

    @property
    def zeros(self) -> Complexes:
        """Roots of the numerator in rad/s, by rising magnitude; none for a numerator that is zero."""
        return _roots_of(self.numerator).copy() if self.numerator != (0.0,) else np.zeros(0, dtype=complex)

    @property
    def order(self) -> int:
        """Degree of the denominator."""
        return len(self.denominator) - 1

    @property
    def relative_degree(self) -> int:
        """Degree of the denominator less that of the numerator."""
        return len(self.denominator) - len(self.numerator)

    @property
    def is_proper(self) -> bool:
        """Whether the numerator's degree is not above the denominator's."""
        return self.relative_degree >= 0

    @property
    def is_strictly_proper(self) -> bool:
        """Whether the response vanishes at infinite frequency."""
        return self.relative_degree > 0 or self.numerator == (0.0,)

    @property
    def is_stable(self) -> bool:
        """Whether all poles have a negative real part; the delay of an open chain does not change that."""
        return bool(np.all(self.poles.real < 0.0))

    @property
    def static_gain(self) -> float:
        """Value at s = 0.

        Raises:
            InvalidInputError: there is a pole at s = 0.
        """
        if self.denominator[0] == 0.0:
            message = "the transfer function integrates (pole at s = 0) and has no static gain; ask for its step response instead"
            raise InvalidInputError(message)
        return self.numerator[0] / self.denominator[0]

    @property
    def high_frequency_gain(self) -> float:
        """Value at infinite frequency without the delay: what passes straight through.

        Raises:
            InvalidInputError: the numerator's degree is above the denominator's.
        """
        self._require_proper()
        return self.numerator[-1] / self.denominator[-1] if not self.is_strictly_proper else 0.0

    def response(self, omega: ArrayLike) -> FrequencyResponse:
        """Evaluate on the imaginary axis.

        Args:
            omega: frequencies in rad/s, strictly rising.

        Raises:
            InvalidInputError: see `FrequencyResponse`; or a frequency is that of an undamped pole.
        """
        grid = check_frequencies(omega)
        return FrequencyResponse(
            omega=grid,
            values=self(1j * grid),
            input_name=self.input_name,
            input_unit=self.input_unit,
            output_name=self.output_name,
            output_unit=self.output_unit,
            method="transfer function",
            known_delay=self.delay,
        )

    def magnitude_db(self, omega: ArrayLike) -> Floats:
        """Magnitude in decibels at frequencies in any order.

        Raises:
            InvalidInputError: the magnitude at one of them is zero or not finite.
        """
        grid = np.asarray(omega, dtype=float)
        return to_decibels(np.abs(self(1j * grid)), grid)

    def phase_deg(self, omega: ArrayLike) -> Floats:
        """Phase in degrees, continuous in frequency from 0+ on, whatever the grid: summed over zeros, poles and the delay.

        The argument of each factor 1 - j omega / root never crosses the negative real axis, so no unwrapping is needed.

        Args:
            omega: positive frequencies in rad/s, in any order.

        Raises:
            InvalidInputError: the transfer function is zero and has no phase.
        """
        if self.numerator == (0.0,):
            message = "a transfer function that is zero has no phase"
            raise InvalidInputError(message)
        grid = np.asarray(omega, dtype=float)
        lowest = next(c for c in self.numerator if c != 0.0)
        total = np.full(grid.shape, 0.0 if lowest > 0.0 else math.pi) - grid * self.delay
        for roots, sign in ((self.zeros, 1.0), (self.poles, -1.0)):
            for root in roots:
                total = total + sign * (math.pi / 2.0 if root == 0.0 else np.angle(1.0 - 1j * grid / root))
        phase: Floats = np.asarray(total / DEGREE)
        return phase

    def step_response(self, times: ArrayLike) -> Floats:
        """Answer to a unit step at t = 0, exact at every time, the delay a pure shift.

        Args:
            times: in s, in any order; before the delay has passed the answer is 0, at a jump it is the value just after.

        Returns:
            Output at each time.

        Raises:
            InvalidInputError: the transfer function is not proper, a time is not finite, or the answer grew beyond the range of numbers.
        """
        return step_responses((self,), times)[0]

    def impulse_response(self, times: ArrayLike) -> Floats:
        """Answer to a unit impulse at t = 0: the slope of the step response, exact at every time.

        Args:
            times: in s, in any order; before the delay has passed the answer is 0, at a jump it is the value just after.

        Returns:
            Output per second at each time.

        Raises:
            InvalidInputError: the transfer function is not strictly proper, a time is not finite, or the answer grew beyond the range
                of numbers.
        """
        if not self.is_strictly_proper:
            message = f"numerator of degree {len(self.numerator) - 1} over denominator of degree {self.order}: its answer holds an impulse"
            message += "; use step_response, or add a pole"
            raise InvalidInputError(message)
        shifted = _check_times(times) - self.delay
        return np.where(shifted >= 0.0, inverse_laplace(self._remainder(0.0), self.poles, np.maximum(shifted, 0.0)), 0.0)

    def series(self, after: "TransferFunction") -> "TransferFunction":
        """Connect another transfer function to the output: the product, the delays added.

        Raises:
            InvalidInputError: its input has another unit than this output.
        """
        if after.input_unit != self.output_unit:
            message = f"output in {self.output_unit} feeds an input in {after.input_unit}; convert one of them first"
            raise InvalidInputError(message)
        return replace(
            self,
            numerator=tuple(np.convolve(self.numerator, after.numerator).tolist()),
            denominator=tuple(np.convolve(self.denominator, after.denominator).tolist()),
            delay=self.delay + after.delay,
            output_name=after.output_name,
            output_unit=after.output_unit,
        )

    def scaled(self, factor: float) -> "TransferFunction":
        """Multiply the gain by a finite factor."""
        return replace(self, numerator=tuple(factor * c for c in self.numerator))

    def with_delay(self, delay: Seconds) -> "TransferFunction":
        """Make the same transfer function with another delay in place of its own."""
        return replace(self, delay=delay)

    def _require_proper(self) -> None:
        if not self.is_proper:
            message = f"numerator of degree {len(self.numerator) - 1} over denominator of degree {self.order} is not proper"
            message += ": it differentiates; add a filter pole"
            raise InvalidInputError(message)

    def _remainder(self, gain: float) -> list[float]:
        """Numerator of what does not pass straight through, over the product of (s - pole)."""
        top = self.denominator[-1]
        straight = [gain * c for c in self.denominator]
        padded = [*self.numerator, *([0.0] * (self.order + 1 - len(self.numerator)))]
        return [(n - d) / top for n, d in zip(padded, straight, strict=True)][: self.order]


def step_responses(models: Sequence[TransferFunction], times: ArrayLike) -> list[Floats]:
    """Answers of some transfer functions to a unit step; see `TransferFunction.step_response`. Those of one denominator share the work.

    Args:
        models: the transfer functions.
        times: in s, in any order.

    Raises:
        InvalidInputError: one of them is not proper, a time is not finite, or an answer grew beyond the range of numbers.
    """
    grid = _check_times(times)
    alike: dict[tuple[Coefficients, float], list[int]] = {}
    for k, model in enumerate(models):
        alike.setdefault((model.denominator, model.delay), []).append(k)
    found = [np.zeros(0)] * len(models)
    for which in alike.values():
        shifted = grid - models[which[0]].delay
        poles = np.concatenate([np.zeros(1, dtype=complex), models[which[0]].poles])
        gains = [models[k].high_frequency_gain for k in which]
        numerators = [models[k]._remainder(gain) for k, gain in zip(which, gains, strict=True)]  # noqa: SLF001 - of this module
        answers = inverse_laplace_each(numerators, poles, np.maximum(shifted, 0.0))
        for k, gain, answer in zip(which, gains, answers, strict=True):
            found[k] = np.where(shifted >= 0.0, gain + answer, 0.0)
    return found


@lru_cache(maxsize=256)
def _roots_of(coefficients: Coefficients) -> Complexes:
    """Roots are asked for again and again, by each property that rests on them."""
    return polynomial_roots(coefficients)


def _check_times(times: ArrayLike) -> Floats:
    grid = np.asarray(times, dtype=float)
    if not np.all(np.isfinite(grid)):
        message = "a time is not finite; give times in s"
        raise InvalidInputError(message)
    return grid
