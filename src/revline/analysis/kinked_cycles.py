"""Limit cycles that cross limits: collocation on elements that end where the equations switch, and where channels deliver such an instant.

A trigonometric series converges slowly at a kink. Here a cycle found by harmonic balance, or a simulated one, is the start of another
computation: polynomials on elements, collocated at Radau points. Where the arguments of a minimum or maximum cross along the cycle is
found by narrowing; so is where each channel delivers what entered it then, up to twice in a row. The elements are laid anew with ends
there, until these places stay. On the same elements the Floquet multipliers are computed, each coefficient taken from its own side of a
kink.

Source: Engelborghs, Luzyanina, in 't Hout and Roose (2000), SIAM Journal on Scientific Computing 22(5), 1593-1609, for collocation of
periodic solutions; Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, for breakpoints that delays pass on.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.jacobians import differentiate, evaluate
from revline.analysis.kinks import PiecewiseCycle, find_extremes, find_kinks
from revline.analysis.limit_cycles import NO_SWING, CycleGuess
from revline.analysis.monodromy import Monodromy, linearise_along
from revline.analysis.orbit_equations import swing_scales
from revline.analysis.pieces import DEGREE, Pieces
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.lti.batches import solve_each
from revline.lti.response import Complexes
from revline.system import DelaySystem, Floats
from revline.values import make_read_only

FIRST_ELEMENTS = 12
"""Elements per period of the first try, those that kinks add not counted."""

MOST_UNKNOWNS = 2500
"""Size of the largest linear system that is solved."""

SPARE = 2.0
"""A linear system may be so many times as large where kinks add elements that were not foreseen, 200 MB; more is never built."""

ROUGH = 1e-3
"""Where the tolerance is not met with that, a cycle known to this is given all the same, its error stated, if its stability is certain."""

GENERATIONS = 2
"""How many times in a row a kink is followed through the channels; each time it is smoother by one derivative."""

MOST_STEPS = 25
"""Newton steps after which a cycle counts as not found on its elements."""

STEP_TOLERANCE = 1e-10
"""Largest last step, as a part of the states' swing."""

ROUNDING = 1e-5
"""Below this a step that no longer falls is rounding's, as of a small cycle about large values; the error told is by comparison."""

MOST_LAYOUTS = 12
"""How many times the elements are laid anew at most."""

PATIENCE = 5
"""Layouts after which it is enough that the switches stay: a delayed image may come and go where it barely passes an end."""

MOVED = 1e-10
"""Kinks that move by less than this part of the period stay."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KinkedCycle:
    """A limit cycle on elements that end at its kinks, with its Floquet multipliers.

    Attributes:
        system: whose cycle it is.
        pieces: the elements; their times are parts of the period.
        period: in s.
        inputs: constant, shape (n_inputs,).
        states: at the nodes, shape (n_nodes, n_states).
        readings: of the channels, shape (n_nodes, n_channels).
        measures: logarithm of the period, then lowest and highest value of each state.
        switches: when the equations switch, in parts of the period.
        kinks: these, and when channels deliver them.
        multipliers: the largest, by falling magnitude, that of a shift along the cycle left out.
        trivial_error: how far that one is from 1, as it should be: a check of the whole computation.
        error: estimated relative error of the period and of the states' extremes, by comparison with fewer elements, and not below what the
            switches still move from one laying of the elements to the next.
        multiplier_error: estimated error of the largest multiplier, in the same way and not below `trivial_error`.
    """

    system: DelaySystem
    pieces: Pieces
    period: float
    inputs: Floats
    states: Floats
    readings: Floats
    measures: Floats
    switches: Floats
    kinks: Floats
    multipliers: Complexes
    trivial_error: float
    error: float
    multiplier_error: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def largest(self) -> float:
        """Magnitude of the largest multiplier: the factor by which deviations shrink or grow per period in the long run."""
        return float(np.abs(self.multipliers[0]))

    @property
    def stable(self) -> bool:
        """Whether neighbouring motions come to it."""
        return self.largest < 1.0

    @property
    def certain(self) -> bool:
        """Whether the largest multiplier is further from 1 than its estimated error."""
        return abs(self.largest - 1.0) > self.multiplier_error

    def output(self, position: int, times: Floats) -> Floats:
        """One of the system's outputs at parts of the period."""
        solved = PiecewiseCycle(self.pieces, self.period, self.states, self.readings)
        x, zd = solved.points(self.system, self.inputs, times)
        found: Floats = evaluate(self.system, self.system.output, x, np.tile(self.inputs, (times.size, 1)), zd)[:, position]
        return found

    def residual(self) -> float:
        """By how much the states' rates miss the equations between the nodes, as a part of the largest rate; the worst of all states."""
        middles = np.sort(np.concatenate([self.pieces.ends[:-1] + share * self.pieces.lengths for share in (0.1, 0.4, 0.75)]))
        x, zd = PiecewiseCycle(self.pieces, self.period, self.states, self.readings).points(self.system, self.inputs, middles)
        rates = evaluate(self.system, self.system.rate, x, np.tile(self.inputs, (middles.size, 1)), zd)
        missed = self.pieces.slope_reading(middles) @ self.states / self.period - rates
        floor = swing_scales(self.system, self.states) / self.period  # of states that rest
        return float(np.max(np.max(np.abs(missed), axis=0) / np.maximum(np.max(np.abs(rates), axis=0), floor)))

    def extremes(self, position: int) -> tuple[float, float]:
        """Lowest and highest value of an output over the cycle, between the nodes too."""
        return find_extremes(lambda times: self.output(position, times), self.pieces)


def find_kinked_cycle(
    system: DelaySystem,
    inputs: Floats,
    guess: CycleGuess,
    *,
    tolerance: float = 1e-6,
    meet_kinks: int = GENERATIONS,
    most_unknowns: int = MOST_UNKNOWNS,
) -> KinkedCycle:
    """Find a limit cycle again on elements that meet its kinks, and whether it is stable.

    The elements are doubled until period, extremes and largest multiplier stay within the tolerance. Where they cannot be doubled any
    more, a cycle known to 0.1 % is given with its larger error, if that leaves no doubt of its stability.

    Args:
        system: any system with delay channels.
        inputs: constant, shape (n_inputs,).
        guess: a rough cycle; from a simulation, or that of harmonic balance by `Cycle.as_guess`.
        tolerance: largest estimated error.
        meet_kinks: how many times in a row kinks are followed through the channels; -1 meets none at all.
        most_unknowns: size of the largest linear system that is solved.

    Raises:
        InvalidInputError: the tolerance or `meet_kinks` is out of range.
        NotConvergedError: Newton's method fails, the kinks do not stay, or more elements than can be used would be needed; the message has
            the numbers.
    """
    if not 1e-10 <= tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "", "1e-10 to 1", "give a value such as 1e-6")
    if meet_kinks < -1:
        raise InvalidInputError(f"kinks cannot be followed {meet_kinks} times through the channels; give -1, 0 or more")
    solved = _sampled(system, inputs, guess)
    best = None
    elements, extra, width = FIRST_ELEMENTS, 0, len(system.states) + len(system.channels)
    while (elements + extra) * DEGREE * width <= most_unknowns:
        try:
            found = _lay_until_still(system, inputs, solved, elements, meet_kinks)
            best = found.judged(best)
        except NotConvergedError:
            if best is None or best.error > ROUGH or not best.certain:
                raise
            return best
        if max(best.error, best.multiplier_error) <= tolerance:
            return best
        solved, extra = found.solved, found.pieces.lengths.size - elements
        elements *= 2
    if best is None or best.error > ROUGH or not best.certain:
        raise _unresolved(system, best, solved, tolerance)
    return best


def solve_on_elements(
    system: DelaySystem, inputs: Floats, guess: CycleGuess, *, elements: int, meet_kinks: int = GENERATIONS
) -> KinkedCycle:
    """Find a limit cycle on a given number of elements, those that kinks add not counted; its errors are not estimated: infinite.

    Raises:
        NotConvergedError: as for `find_kinked_cycle`.
    """
    return _lay_until_still(system, inputs, _sampled(system, inputs, guess), elements, meet_kinks).judged(None)


@dataclass(frozen=True, slots=True)
class _Found:
    """A cycle on elements that meet its kinks."""

    system: DelaySystem
    inputs: Floats
    solved: PiecewiseCycle
    switches: Floats
    kinks: Floats
    unrest: float = 0.0  # how far the switches still move, in parts of the period

    @property
    def pieces(self) -> Pieces:
        return self.solved.pieces

    @property
    def measures(self) -> tuple[Floats, Floats]:
        """Logarithm of the period, and lowest and highest value of each state; by what their changes are judged."""
        states = self.solved.states
        ends = np.array([find_extremes(self._reader(k), self.pieces) for k in range(states.shape[1])])
        swings = np.maximum(ends[:, 1] - ends[:, 0], swing_scales(self.system, states))
        return np.concatenate(([np.log(self.solved.period)], ends.ravel())), np.concatenate(([1.0], np.repeat(swings, 2)))

    def _reader(self, column: int) -> Callable[[Floats], Floats]:
        return lambda times: self.pieces.read(self.solved.states[:, [column]], times)[:, 0]

    def judged(self, before: KinkedCycle | None) -> KinkedCycle:
        """Find the multipliers, and the errors by comparison with the same cycle on fewer elements."""
        multipliers, off = _multipliers(self)
        measures, scales = self.measures
        change = moved = np.inf
        if before is not None:
            change = max(float(np.max(np.abs(measures - before.measures) / scales)), self.unrest)
            moved = max(abs(float(np.abs(multipliers[0])) - before.largest), off, self.unrest)
        return KinkedCycle(
            system=self.system,
            pieces=self.pieces,
            period=self.solved.period,
            inputs=self.inputs.copy(),
            states=self.solved.states,
            readings=self.solved.readings,
            measures=measures,
            switches=self.switches,
            kinks=self.kinks,
            multipliers=multipliers[:8].copy(),
            trivial_error=off,
            error=change,
            multiplier_error=moved,
        )


def _sampled(system: DelaySystem, inputs: Floats, guess: CycleGuess) -> PiecewiseCycle:
    """Take a rough cycle on equal elements."""
    pieces = Pieces.lay(4 * FIRST_ELEMENTS, np.empty(0))
    around, count = np.concatenate((guess.states, guess.states[:1])), guess.states.shape[0]
    states = np.stack([np.interp(pieces.times * count, np.arange(count + 1), column) for column in around.T], axis=1)
    solved = PiecewiseCycle(pieces, guess.period, states, np.zeros((pieces.count, len(system.channels))))
    for _ in system.channels:  # what enters a channel may be read from an earlier one
        solved = replace(solved, readings=solved.points(system, inputs, pieces.times)[1])
    return solved


def _lay_until_still(system: DelaySystem, inputs: Floats, start: PiecewiseCycle, elements: int, generations: int) -> _Found:
    """Solve on elements that end at the kinks, find the kinks anew, and so on until they stay."""
    switches, kinks = find_kinks(system, inputs, start, generations)
    switches_before = switches
    for layout in range(MOST_LAYOUTS):
        pieces = Pieces.lay(elements, kinks)
        _check_size(system, pieces, start.period, kinks)
        solved = _solve(system, inputs, start.on(pieces))
        if generations < 0:
            return _Found(system, inputs, solved, switches, kinks)
        again, later = find_kinks(system, inputs, solved, generations)
        if _still(kinks, later) or (layout >= PATIENCE and _still(switches, again)):
            return _Found(system, inputs, solved, again, kinks)
        start, switches, kinks, switches_before = solved, again, later, switches
    moved = _moved(switches_before, switches)
    if moved <= ROUGH:
        return _Found(system, inputs, start, switches, kinks, unrest=moved)
    message = (
        f"the kinks of the cycle of {system.name} near {2.0 * np.pi / start.period:g} rad/s do not stay where they are found "
        f"({kinks.size} of them at last), as where an orbit touches a limit without crossing it; change the gains or the command a little"
    )
    raise NotConvergedError(message, kinks=kinks.size)


def _check_size(system: DelaySystem, pieces: Pieces, period: float, kinks: Floats) -> None:
    """Refuse elements whose equations take too much memory: an orbit that crosses limits again and again within a period."""
    unknowns, most = pieces.count * (len(system.states) + len(system.channels)), SPARE * MOST_UNKNOWNS
    if unknowns > most:
        message = (
            f"the cycle of {system.name} near {2.0 * np.pi / period:g} rad/s has {kinks.size} kinks in a period, and elements that meet "
            f"them have {unknowns} unknowns (limit {most:g}); simulate it, or change the gains or the command a little"
        )
        raise NotConvergedError(message, kinks=kinks.size, unknowns=unknowns)


def _still(before: Floats, after: Floats) -> bool:
    return _moved(before, after) <= MOVED


def _moved(before: Floats, after: Floats) -> float:
    """How far kinks have moved, in parts of the period; infinite where some are new or gone."""
    return float(np.max(np.abs(after - before), initial=0.0)) if before.size == after.size else np.inf


def _solve(system: DelaySystem, inputs: Floats, solved: PiecewiseCycle) -> PiecewiseCycle:
    """Newton's method on states, readings and period, on given elements."""
    pieces, n_states = solved.pieces, solved.states.shape[1]
    derivative = pieces.derivative
    reference = derivative @ solved.states
    size = before = np.inf
    for _ in range(MOST_STEPS):
        matrix, right = _equations(system, inputs, solved, (derivative, reference))
        step = solve_each(matrix, -right)
        states = step[: pieces.count * n_states].reshape(pieces.count, n_states)
        readings = step[pieces.count * n_states : -1].reshape(solved.readings.shape)
        scales = swing_scales(system, solved.states)
        before, size = size, max(float(np.max(np.abs(states) / scales)), abs(float(step[-1])) / solved.period)
        resting = np.max(np.ptp(solved.states, axis=0) / np.maximum(np.max(np.abs(solved.states), axis=0), 1e-300)) <= NO_SWING
        if resting or not (np.isfinite(size) and solved.period + step[-1] > 0.0):
            break
        solved = PiecewiseCycle(pieces, solved.period + float(step[-1]), solved.states + states, solved.readings + readings)
        if size <= STEP_TOLERANCE or (size <= ROUNDING and size > 0.25 * before):
            return solved
    message = (
        f"the cycle of {system.name} near {2.0 * np.pi / solved.period:g} rad/s is not found on {pieces.lengths.size} elements: the last "
        f"step is still {size:.2g} of the swing (limit {STEP_TOLERANCE:g}); start from a finer cycle"
    )
    raise NotConvergedError(message, step=size)


def _equations(system: DelaySystem, inputs: Floats, solved: PiecewiseCycle, frame: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """The linearised equations of states, readings and period, and what they miss; the last is the condition on the phase."""
    derivative, reference = frame
    pieces, period, x, zd = solved.pieces, solved.period, solved.states, solved.readings
    count, n_states, n_channels = pieces.count, x.shape[1], zd.shape[1]
    points = (x, np.tile(inputs, (count, 1)), zd)
    rate_x, _, rate_z = differentiate(system, system.rate, *points)
    emit_x, _, emit_z = differentiate(system, system.emit, *points)
    lags_x, _, lags_z = differentiate(system, system.lags, *points)
    rates, entering, lags = (evaluate(system, f, *points) for f in (system.rate, system.emit, system.lags))
    at = pieces.times[:, None] - lags / period
    reading = pieces.reading(at)
    drift = np.einsum("jcn,nc->jc", pieces.slope_reading(at), entering) / period
    own = np.arange(count)
    upper_x = np.einsum("jn,ab->janb", derivative, np.eye(n_states))
    upper_x[own, :, own, :] -= period * rate_x
    upper_z = np.zeros((count, n_states, count, n_channels))
    upper_z[own, :, own, :] = -period * rate_z
    lower_x = -np.einsum("jcn,ncb->jcnb", reading, emit_x)
    lower_x[own, :, own, :] += drift[..., None] * lags_x
    lower_z = -np.einsum("jcn,ncb->jcnb", reading, emit_z)
    lower_z[own, :, own, :] += drift[..., None] * lags_z + np.eye(n_channels)
    scale = swing_scales(system, x) ** 2
    matrix = np.block(
        [
            [upper_x.reshape(count * n_states, -1), upper_z.reshape(count * n_states, -1), -rates.reshape(-1, 1)],
            [lower_x.reshape(count * n_channels, -1), lower_z.reshape(count * n_channels, -1), -(drift * lags / period).reshape(-1, 1)],
            [(reference / scale).reshape(1, -1), np.zeros((1, count * n_channels + 1))],
        ]
    )
    missed = derivative @ x - period * rates, zd - np.einsum("jcn,nc->jc", reading, entering)
    return matrix, np.concatenate((missed[0].ravel(), missed[1].ravel(), [0.0]))


def _multipliers(found: _Found) -> tuple[Complexes, float]:
    """Multipliers but that of a shift, and how far that one is from 1."""
    system, solved = found.system, found.solved
    pieces, inputs = solved.pieces, np.tile(found.inputs, (solved.pieces.count, 1))
    x, zd = solved.points(system, found.inputs, pieces.inner_times)
    lags = evaluate(system, system.lags, x, inputs, zd)
    entering = evaluate(system, system.emit, solved.states, inputs, solved.readings)
    at = pieces.inner_times[:, None] - lags / solved.period
    drift = np.einsum("jcn,nc->jc", pieces.slope_reading(at), entering) / solved.period
    values = Monodromy(pieces, solved.period, linearise_along(system, (x, inputs, zd), drift)).multipliers()
    trivial = int(np.argmin(np.abs(values - 1.0)))
    return np.delete(values, trivial), float(np.abs(values[trivial] - 1.0))


def _unresolved(system: DelaySystem, best: KinkedCycle | None, solved: PiecewiseCycle, tolerance: float) -> NotConvergedError:
    change, moved = (np.inf, np.inf) if best is None else (best.error, best.multiplier_error)
    message = (
        f"the limit cycle of {system.name} at {2.0 * np.pi / solved.period:g} rad/s is not resolved with {solved.pieces.lengths.size} "
        f"elements per period: period and extremes still change by {change:.2g} of themselves, the largest multiplier by {moved:.2g} "
        f"(limit {tolerance:g}); simulate it"
    )
    return NotConvergedError(message, change=change, multiplier_change=moved)
