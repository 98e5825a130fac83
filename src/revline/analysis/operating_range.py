"""How far a straight line through the steady states holds: the range that a linear model may serve."""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.interpolate import PchipInterpolator

from revline.analysis.steady_map import SteadyMap, Undecided
from revline.errors import AnalysisError, InvalidInputError, out_of_range
from revline.system import Floats, Variable
from revline.values import make_read_only

SAMPLES = 301
"""Points of a range, evenly spaced, at which line and steady states are compared."""

WIDTHS = 200
"""Widths tried from the centre outwards before the last is refined."""

BISECTIONS = 30
FEWEST_INSIDE = 3
"""Values of the map that a range must hold: between two of them the interpolation alone would be judged."""


class ErrorMeasure(Enum):
    """What a tolerance limits: the largest error in output units, or that error as a fraction of the output's span in the range."""

    OUTPUT = "output"
    FRACTION = "fraction"


class LimitedBy(Enum):
    """What keeps an operating range from being wider."""

    TOLERANCE = "tolerance"
    MAP = "map"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineFit:
    """A straight line through the steady states of a range, by least squares over evenly spaced points.

    Attributes:
        sweep, output: input and output of the line.
        slope: output units per input unit.
        intercept: the line at input 0, in output units.
        values: inputs at which the line was compared, rising from one end of the range to the other.
        errors: line less steady output at each, in output units.
        span: change of the steady output over the range.
    """

    sweep: Variable
    output: Variable
    slope: float
    intercept: float
    values: Floats
    errors: Floats
    span: float

    def __post_init__(self) -> None:
        if self.values.shape != self.errors.shape or self.values.size < 2:
            message = f"{self.values.size} values with {self.errors.size} errors; give as many of both, at least two"
            raise InvalidInputError(message)
        make_read_only(self)

    @property
    def low(self) -> float:
        """Lower end of the range."""
        return float(self.values[0])

    @property
    def high(self) -> float:
        """Upper end of the range."""
        return float(self.values[-1])

    @property
    def max_error(self) -> float:
        """Largest error, without its sign, in output units."""
        return float(np.max(np.abs(self.errors)))

    @property
    def max_error_at(self) -> float:
        """Input at which the error is largest."""
        return float(self.values[int(np.argmax(np.abs(self.errors)))])

    @property
    def max_error_fraction(self) -> float:
        """Largest error as a fraction of the output's span."""
        return self.max_error / abs(self.span) if self.span else math.inf

    def predict(self, value: float) -> float:
        """Evaluate the line at an input."""
        return self.slope * value + self.intercept


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OperatingRange:
    """The widest range around a centre in which a straight line holds within a tolerance.

    Attributes:
        line: the line, its range and its errors.
        centre: of the range.
        tolerance: the largest error allowed, in the measure's unit.
        measure: what the tolerance limits.
        limited_by: what keeps the range from being wider.
    """

    line: LineFit
    centre: float
    tolerance: float
    measure: ErrorMeasure
    limited_by: LimitedBy

    def __post_init__(self) -> None:
        if not _error(self.line, self.measure) <= self.tolerance:
            message = f"the line's error {_error(self.line, self.measure):g} exceeds the tolerance {self.tolerance:g}; narrow the range"
            raise InvalidInputError(message, error=_error(self.line, self.measure), tolerance=self.tolerance)

    @property
    def half_width(self) -> float:
        """From the centre to either end."""
        return 0.5 * (self.line.high - self.line.low)


def fit_line(steady_map: SteadyMap, *, low: float, high: float) -> LineFit:
    """Lay a straight line through the steady outputs of a range, by least squares.

    Args:
        steady_map: from `find_steady_map`; between its values a monotone cubic stands in.
        low: lower end of the range.
        high: upper end.

    Returns:
        The line and its errors.

    Raises:
        InvalidInputError: the range is empty or reaches beyond the map, or the map has a gap in it.

    Source:
        Lee (1995), Fig. 4.2. Interpolation: Fritsch and Carlson (1980), SIAM Journal on Numerical Analysis 17(2), 238-246.
    """
    first, last = float(steady_map.values[0]), float(steady_map.values[-1])
    if not first <= low < high <= last:
        unit = steady_map.sweep.unit
        message = f"range {low:g} to {high:g} {unit} is empty or reaches beyond the map, {first:g} to {last:g} {unit}; choose it inside"
        raise InvalidInputError(message, low=low, high=high)
    for gap in steady_map.missing:
        if low < gap.value < high:
            place = f"{steady_map.sweep.name} = {gap.value:g} {steady_map.sweep.unit}"
            if isinstance(gap, Undecided):
                message = f"the steady state at {place} inside the range is undecided ({gap.reason}); narrow the range"
            else:
                message = f"there is no steady state at {place} inside the range; narrow it"
            raise InvalidInputError(message, value=gap.value)
    return _fit(steady_map, PchipInterpolator(steady_map.values, steady_map.output_values), low, high)


def find_operating_range(
    steady_map: SteadyMap, *, centre: float, tolerance: float, measure: ErrorMeasure = ErrorMeasure.FRACTION
) -> OperatingRange:
    """Find the widest range around a centre in which a straight line through the steady states holds.

    The range grows evenly to both sides until the error passes the tolerance or the map ends.

    Args:
        steady_map: from `find_steady_map`.
        centre: of the range, in units of the swept input.
        tolerance: largest error allowed.
        measure: whether the tolerance is a fraction of the output's span in the range, or in output units.

    Returns:
        The range with its line, the error's place and size, and what limits it.

    Raises:
        InvalidInputError: the centre lies outside the map, or the tolerance is not positive.
        AnalysisError: no range that holds three values of the map meets the tolerance.
    """
    sweep = steady_map.sweep
    below, above = _part(steady_map, centre)
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise out_of_range("tolerance", tolerance, _unit(steady_map, measure), "0 to infinity, without the ends", "give a positive one")
    widest = min(centre - below, above - centre)
    curve = PchipInterpolator(steady_map.values, steady_map.output_values)

    def fitted(half_width: float) -> LineFit:
        return _fit(steady_map, curve, centre - half_width, centre + half_width)

    good, bad = 0.0, math.inf
    for half_width in widest * np.arange(1, WIDTHS + 1) / WIDTHS:
        if _error(fitted(half_width), measure) > tolerance:
            bad = float(half_width)
            break
        good = float(half_width)
    for _ in range(BISECTIONS if math.isfinite(bad) else 0):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if _error(fitted(middle), measure) <= tolerance else (good, middle)
    inside = np.sum(np.abs(steady_map.values - centre) <= good)
    if math.isfinite(bad) and inside < FEWEST_INSIDE:
        message = (
            f"no range around {sweep.name} = {centre:g} {sweep.unit} that holds {FEWEST_INSIDE} values of the map is linear within "
            f"{tolerance:g} {_unit(steady_map, measure)}; allow more, choose another centre, or map more finely"
        )
        raise AnalysisError(message, centre=centre, tolerance=tolerance)
    limited_by = LimitedBy.TOLERANCE if math.isfinite(bad) else LimitedBy.MAP
    return OperatingRange(line=fitted(good), centre=centre, tolerance=tolerance, measure=measure, limited_by=limited_by)


def _part(steady_map: SteadyMap, centre: float) -> tuple[float, float]:
    """Ends of the part of the map without gaps that holds the centre."""
    sweep, values = steady_map.sweep, steady_map.values
    gaps = np.array([entry.value for entry in steady_map.missing])
    below = values[values > np.max(gaps[gaps <= centre], initial=-math.inf)]
    inside = below[below < np.min(gaps[gaps > centre], initial=math.inf)]
    if not inside.size or not inside[0] < centre < inside[-1]:
        ends = f"{values[0]:g} to {values[-1]:g} {sweep.unit}"
        raise out_of_range("centre", centre, sweep.unit, f"the map's {ends} without ends and gaps", "choose it inside, or widen the map")
    return float(inside[0]), float(inside[-1])


def _fit(steady_map: SteadyMap, curve: PchipInterpolator, low: float, high: float) -> LineFit:
    values = np.linspace(low, high, SAMPLES)
    outputs = curve(values)
    middle = 0.5 * (low + high)
    slope = float(np.dot(values - middle, outputs) / np.dot(values - middle, values - middle))
    intercept = float(np.mean(outputs)) - slope * middle
    return LineFit(
        sweep=steady_map.sweep,
        output=steady_map.output,
        slope=slope,
        intercept=intercept,
        values=values,
        errors=slope * values + intercept - outputs,
        span=float(outputs[-1] - outputs[0]),
    )


def _error(line: LineFit, measure: ErrorMeasure) -> float:
    return line.max_error if measure is ErrorMeasure.OUTPUT else line.max_error_fraction


def _unit(steady_map: SteadyMap, measure: ErrorMeasure) -> str:
    return steady_map.output.unit if measure is ErrorMeasure.OUTPUT else "of the span"
