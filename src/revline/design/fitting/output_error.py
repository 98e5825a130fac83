"""The numbers of an output-error fit: linear starts, the nonlinear least squares, and proof that the optimum is one.

Beside the scales of the problem each parameter is scaled by its column of the Jacobian.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import leastsq

from revline.design.fitting.fit_problem import Problem, stack_parts
from revline.errors import AnalysisError, NotConvergedError
from revline.lti.polynomial import polynomial_roots
from revline.lti.response import Complexes, Floats
from revline.units import Seconds
from revline.values import make_read_only

_LARGEST_GRADIENT = 1e-9
_LARGEST_CONDITION = 1e10
_SAME_COST = 1e-6
_LINEAR_ITERATIONS = (20, 4)
"""Without and with a free delay, where many delays are tried and the best are followed down anyway."""
_POLISH_STEPS = 60
_FRACTIONS = (1.0, 0.25, 0.0625)
_DELAY_STARTS = 100
_NEAR_STARTS, _TOP_POINTS = 5, 3
_STARTS_KEPT = 8
_RESONANCE_STARTS = 9
_TOLERANCE = 1e-15


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """One start of the search and where it led.

    Attributes:
        name: how the start was made.
        residual_sum: what it led to, in the fit's units.
        agrees: whether that is the optimum.
    """

    name: str
    residual_sum: float
    agrees: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optimum:
    """The least squares optimum, with what it takes to trust it.

    Attributes:
        numerator, denominator: ascending powers, the denominator's first is 1.
        delay: in s, 0 where it was not free.
        residual_sum: the minimum of the sum of weighted squared errors.
        covariance: of the numerator, the denominator from its second coefficient on, and the delay where it was free and not held at 0.
        condition: condition number of the Jacobian, its columns scaled to one length.
        gradient: largest cosine-like measure of the gradient: column times residual over lengths of column and data.
        starts: those that were followed down.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    delay: Seconds
    residual_sum: float
    covariance: Floats
    condition: float
    gradient: float
    starts: tuple[Start, ...]

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def starts_agreeing(self) -> int:
        """How many starts led to this optimum."""
        return sum(start.agrees for start in self.starts)


def minimise(problem: Problem) -> Optimum:
    """Find the least squares optimum from several starts and verify it.

    A free delay whose optimum would be negative is held at 0; the covariance is then that of the other parameters.

    Source:
        Levy (1959), IRE Trans. Automatic Control 4, 37-43, and Sanathanan and Koerner (1963), IEEE Trans. Automatic Control 8,
        56-58 (starts); More (1978), Lecture Notes in Mathematics 630, 105-116 (Levenberg-Marquardt, as MINPACK has it).

    Raises:
        NotConvergedError: the gradient at the best point is not zero to rounding.
        AnalysisError: the data cannot tell the parameters apart.
    """
    # Starts and trial steps may overflow; what is not finite is passed over, and the optimum is verified.
    with np.errstate(all="ignore"):
        starts = [(name, x) for name, x in _starts(problem) if math.isfinite(_cost(problem, x))]
        starts.sort(key=lambda entry: _cost(problem, entry[1]))
        found = _polished(problem, [(name, _descend(problem, start)) for name, start in starts[:_STARTS_KEPT]])
        best = min((x for _, x in found), key=lambda x: _cost(problem, x))
        # A second start, off the best point to all sides: it must lead back.
        away = best * (1.0 + 0.1 * (-1.0) ** np.arange(problem.size))
        found.append(("best point, each parameter moved by a tenth", _polish(problem, _descend(problem, away))))
        best = min((x for _, x in found), key=lambda x: _cost(problem, x))
    if problem.free_delay and best[-1] < 0.0:
        return minimise(replace(problem, free_delay=0))
    gradient = _gradient(problem, best)
    if gradient > _LARGEST_GRADIENT:
        message = (
            f"the fit of {problem.zeros} zeros and {problem.poles} poles did not converge: the gradient is {gradient:.1e} of the data"
            f" (limit {_LARGEST_GRADIENT:g}); use fewer poles, or frequencies closer together"
        )
        raise NotConvergedError(message, gradient=gradient)
    return _optimum(problem, best, gradient, found)


def _cost(problem: Problem, x: Floats) -> float:
    residuals = problem.residuals(x)
    return float(residuals @ residuals)


def _agrees(cost: float, least: float) -> bool:
    """Whether a sum of squares is the least one."""
    return cost <= least * (1.0 + _SAME_COST) + float(np.finfo(float).eps)


def _gradient(problem: Problem, x: Floats) -> float:
    """Largest share of the data that still lies along a column of the Jacobian."""
    residuals, jacobian = problem.both(x)
    return float(np.max(np.abs(jacobian.T @ residuals) / _lengths(jacobian)))


def _descend(problem: Problem, start: Floats) -> Floats:
    # With the full output it neither warns nor raises where it stops early; what it found is verified.
    found = leastsq(
        problem.residuals,
        start,
        Dfun=lambda x: problem.jacobian(x).T,
        col_deriv=True,
        full_output=True,
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        maxfev=200 * problem.size,
    )
    return np.asarray(found[0], dtype=float)


def _polished(problem: Problem, found: list[tuple[str, Floats]]) -> list[tuple[str, Floats]]:
    """Polish the best point, and those that may be another; the others have led to the same one, to the root of rounding."""
    costs = [_cost(problem, x) for _, x in found]
    best = int(np.argmin(costs))
    polished = _polish(problem, found[best][1])
    least = _cost(problem, polished)
    return [
        (name, polished if k == best or _agrees(cost, least) else _polish(problem, x))
        for k, ((name, x), cost) in enumerate(zip(found, costs, strict=True))
    ]


def _polish(problem: Problem, x: Floats) -> Floats:
    """Gauss-Newton, then Newton steps, for as long as they shrink the gradient: the descent stops at the root of rounding."""
    gradient = _gradient(problem, x)
    for find_step in (_gauss_newton_step, _newton_step):
        for _ in range(_POLISH_STEPS):
            step = find_step(problem, x)
            tried = ((_gradient(problem, x + fraction * step), fraction) for fraction in _FRACTIONS)
            better, fraction = next((entry for entry in tried if entry[0] < gradient), (gradient, 0.0))
            if fraction == 0.0:
                break
            x, gradient = x + fraction * step, better
    return x


def _gauss_newton_step(problem: Problem, x: Floats) -> Floats:
    residuals, jacobian = problem.both(x)
    return _solve(jacobian, -residuals)


def _newton_step(problem: Problem, x: Floats) -> Floats:
    """With the curvature of the residuals, from differences of the exact gradient: needed where the residual is large."""

    def slopes(scaled: Floats) -> Floats:
        residuals, jacobian = problem.both(x + scaled / lengths)
        return np.asarray(jacobian.T @ residuals / lengths)

    lengths = _lengths(problem.jacobian(x))
    moves = np.eye(problem.size) * 1e-6
    curvature = np.stack([(slopes(move) - slopes(-move)) / (2.0 * move[k]) for k, move in enumerate(moves)], axis=1)
    return _solve(curvature, -slopes(np.zeros(problem.size))) / lengths


def _lengths(columns: Floats) -> Floats:
    return np.asarray(np.maximum(np.sqrt(np.sum(columns * columns, axis=0)), np.finfo(float).tiny))


def _starts(problem: Problem) -> Iterator[tuple[str, Floats]]:
    for delay in _delay_starts(problem):
        advanced = problem.values * np.exp(problem.s * delay)
        label = f", delay {delay / problem.frequency:.4g} s" if problem.free_delay else ""
        top, bottom = np.zeros(0), np.append(1.0, np.zeros(problem.poles))
        for iteration in range(_LINEAR_ITERATIONS[problem.free_delay]):
            top, bottom = _linear_fit(problem, advanced, bottom)
            if iteration == 0:
                yield f"Levy{label}", _join(problem, *_reflected(problem, advanced, top, bottom), delay)
        yield f"Sanathanan-Koerner{label}", _join(problem, top, bottom, delay)
        yield f"Sanathanan-Koerner, reflected{label}", _join(problem, *_reflected(problem, advanced, top, bottom), delay)
    for name, poles in _pole_starts(problem):
        bottom = np.polynomial.polynomial.polyfromroots(poles).real
        bottom = bottom / bottom[0]
        yield name, _join(problem, _numerator(problem, problem.values, bottom), bottom, 0.0)


def _pole_starts(problem: Problem) -> Iterator[tuple[str, Complexes]]:
    """Sets of stable poles over the range of the frequencies: real ones, and with one resonance at a time."""
    reach = float(np.abs(problem.s).max())
    real = -np.geomspace(reach**-0.5, reach**0.75, problem.poles + 1)[:-1].astype(complex)
    if problem.poles:
        yield "real poles over the frequencies", real
    if problem.poles >= 2:
        for size in np.geomspace(1.0 / reach, reach, _RESONANCE_STARTS):
            pair = size * np.array([-0.1 + 1j, -0.1 - 1j])
            yield f"resonance at {size * problem.frequency:.3g} rad/s", np.concatenate([real[2:], pair])


def _delay_starts(problem: Problem) -> Floats:
    if not problem.free_delay or problem.s.size < 2:
        return np.zeros(1)
    # No lag has more delay than its phase falls by over some frequencies; half a radian apart at the highest, no basin is missed. What
    # the phase at rest is, frequencies far from it do not tell: it is how the phase falls between them that counts, over an octave or all.
    omega, phase = problem.s.imag, np.unwrap(np.angle(problem.values))
    far = (omega >= 2.0 * omega[0]) & (omega > 0.0) | (np.arange(omega.size) == omega.size - 1)
    most = max(float(np.max((phase[0] - phase[far]) / (omega[far] - omega[0]), initial=0.0)), 0.0)
    apart = 0.5 / float(omega[-1])
    # Where the phase falls by many turns, most of it is the delay's: at the top, where lags have turned, it is little less than the slope.
    top = omega >= 0.5 * (omega[0] + omega[-1])
    steepness = -float(np.polyfit(omega[top], phase[top], 1)[0]) if np.count_nonzero(top) >= _TOP_POINTS else 0.0
    near = steepness - apart * np.arange(_NEAR_STARTS)
    count = min(_DELAY_STARTS, 2 + math.ceil(most / apart))
    return np.unique(np.concatenate((np.linspace(0.0, most, count), near[near > 0.0])))


def _linear_fit(problem: Problem, values: Complexes, previous: Floats) -> tuple[Floats, Floats]:
    """One Sanathanan-Koerner step: numerator - values * denominator, over the previous denominator, linear in both."""
    weights = problem.weights / np.abs(problem.polynomial(previous))
    powers = problem.powers
    rows = np.concatenate([powers[: problem.zeros + 1], -values * powers[1 : problem.poles + 1]])
    solution = _solve(stack_parts(weights * rows), stack_parts(weights * values))
    return solution[: problem.zeros + 1], np.append(1.0, solution[problem.zeros + 1 :])


def _numerator(problem: Problem, values: Complexes, bottom: Floats) -> Floats:
    """The best numerator for a given denominator: a linear problem."""
    factor = problem.weights / problem.polynomial(bottom)
    return _solve(stack_parts(factor * problem.powers[: problem.zeros + 1]), stack_parts(problem.weights * values))


def _solve(matrix: Floats, right: Floats) -> Floats:
    """Least squares with columns scaled to one length; not a number where the matrix is not, which LAPACK would not survive."""
    lengths = _lengths(matrix)
    scaled = matrix / lengths
    if not (np.all(np.isfinite(scaled)) and np.all(np.isfinite(right))):
        return np.full(lengths.size, np.nan)
    return np.asarray(np.linalg.lstsq(scaled, right, rcond=None)[0] / lengths)


def _reflected(problem: Problem, values: Complexes, top: Floats, bottom: Floats) -> tuple[Floats, Floats]:
    """Mirror poles of the right half plane into the left one: linear starts on noisy data are often unstable."""
    if bottom[-1] == 0.0 or not np.all(np.isfinite(bottom)):
        return top, bottom
    poles = polynomial_roots(bottom)
    if np.all(poles.real < 0.0):
        return top, bottom
    mirrored = np.polynomial.polynomial.polyfromroots(-np.abs(poles.real) + 1j * poles.imag).real
    stable = mirrored / mirrored[0]
    return _numerator(problem, values, stable), stable


def _join(problem: Problem, top: Floats, bottom: Floats, delay: float) -> Floats:
    return np.concatenate([top, bottom[1:], np.full(problem.free_delay, delay)])


def _optimum(problem: Problem, best: Floats, gradient: float, found: list[tuple[str, Floats]]) -> Optimum:
    jacobian = problem.jacobian(best)
    lengths = _lengths(jacobian)
    _, singular, right = np.linalg.svd(jacobian / lengths, full_matrices=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0.0 else math.inf
    if not condition < _LARGEST_CONDITION:
        message = (
            f"the data cannot tell the {problem.size} parameters of {problem.zeros} zeros and {problem.poles} poles apart"
            f" (condition number {condition:.1e}, limit {_LARGEST_CONDITION:g}); use fewer zeros or poles;"
            " a pole at s = 0 is none that can be fitted, as the denominator begins with 1"
        )
        raise AnalysisError(message, condition=condition)
    cost, scale = _cost(problem, best), problem.units / lengths
    measured = 2 * problem.s.size - int(problem.s[0] == 0.0)
    inverse = (right.T / singular**2) @ right
    units = problem.units
    top, bottom, delay = problem.split(best * units)
    starts = tuple(
        Start(
            name=name,
            residual_sum=_cost(problem, x) * problem.cost_unit,
            agrees=_agrees(_cost(problem, x), cost),
        )
        for name, x in found
    )
    return Optimum(
        numerator=tuple(top.tolist()),
        denominator=tuple(bottom.tolist()),
        delay=delay,
        residual_sum=cost * problem.cost_unit,
        covariance=inverse * np.outer(scale, scale) * cost / (measured - problem.size),
        condition=condition,
        gradient=gradient,
        starts=starts,
    )
