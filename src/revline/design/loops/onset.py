"""How hunting begins as all gains of a controller rise together: at which factor, and whether softly or hard.

The factor and the frequency at which the loop loses stability are exact, from the linear model with its delays; the family of limit cycles
that begins there is followed on the nonlinear loop. If the factor rises along it, cycles exist above the onset only and grow from nothing:
the onset is soft. If it falls, cycles, unstable ones, exist below the onset, and the loop jumps to a large one: the onset is hard.

Source: Kuznetsov (2004), Elements of Applied Bifurcation Theory, chapter 3; Stepan (1989), Retarded Dynamical Systems.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from revline.analysis.cycle_branches import BranchAxes, BranchPoint, Onset, follow_cycles
from revline.analysis.kinked_cycles import KinkedCycle, find_kinked_cycle
from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits
from revline.design.loops.hunting import loop_inputs
from revline.design.loops.ray_loop import close_ray
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, OperatingPoint, operating_point
from revline.design.stability.margins import PhaseCrossover, find_margins
from revline.design.stability.open_loop import open_loop_of_system
from revline.errors import AnalysisError, NotConvergedError, out_of_range
from revline.system import DelaySystem, Floats, index_of
from revline.values import make_read_only

POINTS = 10
"""Cycles of the family that are found, at equal distances of amplitude."""

FEWEST = 5
"""With fewer of them the family is followed anew in smaller steps: its first cycles must be small enough to tell how it begins."""

SMALLER = 5
"""How many times it is."""

FURTHER = 1.2
"""A family that falls at its end is followed on, each cycle larger by this factor, until it turns."""

COARSE = 1e-3
"""Largest last harmonic, as a part of the fundamental, of a cycle that still counts: the family is followed by harmonics."""

MOST_FURTHER = 20
"""How many cycles more at most, which is 38 times the amplitude asked for."""

FLAT = 1e-7
"""A change of the factor along the first cycles below this part of it says nothing of the kind of onset."""

STABILITY = 1e-4
"""Largest error of the multipliers of the family's cycles; larger, and stated, where it would take too many elements."""

MOST_UNKNOWNS = 1300
"""Size of the largest linear system for each of them: a family has a dozen cycles or more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RayPoint:
    """One limit cycle of the family.

    Attributes:
        factor: of all gains.
        amplitude: half of the distance from low to high of the measurement.
        low, high: of the measurement.
        period: in s.
        stable: whether it attracts what is near it.
        largest: magnitude of its largest multiplier, that of a shift left out.
        multiplier_error: estimated error of that.
        touches_limit: whether the control touches a limit along it.
    """

    factor: float
    amplitude: float
    low: float
    high: float
    period: float
    stable: bool
    largest: float
    multiplier_error: float
    touches_limit: bool

    @property
    def certain(self) -> bool:
        """Whether the multiplier is further from 1 than its error."""
        return abs(self.largest - 1.0) > self.multiplier_error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnjudgedPoint:
    """A limit cycle of the family that harmonics show, and that could not be found again on elements to judge it.

    Attributes:
        factor: of all gains.
        fundamental: amplitude of the measurement's first harmonic.
        reason: why it was not found again.
    """

    factor: float
    fundamental: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HuntingOnset:
    """Where and how hunting begins.

    Attributes:
        gains: at the onset.
        factor: by which the controller's gains are multiplied there.
        frequency: of the oscillation there, in rad/s.
        kind: "soft" or "hard".
        curvature: change of the factor per square of the fundamental's amplitude, at the onset.
        lowest_factor: lowest at which a cycle was found; the onset's own where the onset is soft and the family does not turn back.
        lowest_is_fold: whether the family turns there; if it does not and the onset is hard, larger cycles exist at lower factors still.
        rest: operating point at which the loop is judged: where the command leads.
        points: the family, by rising amplitude.
        unjudged: cycles of it whose stability is not known.
        limits: of the control.
    """

    gains: PidGains
    factor: float
    frequency: float
    kind: str
    curvature: float
    lowest_factor: float
    lowest_is_fold: bool
    rest: OperatingPoint
    points: tuple[RayPoint, ...]
    unjudged: tuple[UnjudgedPoint, ...]
    limits: Limits

    def __post_init__(self) -> None:
        make_read_only(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class RayTask:
    """What is asked: the size of the command's step, and up to which amplitude of the fundamental the family is followed.

    It is followed further where the factor still falls there, and less far where it ends, or is too steep to be followed, before.
    """

    command: float
    largest: float

    def __post_init__(self) -> None:
        if not math.isfinite(self.command):
            raise out_of_range("command step", self.command, "", "finite values", "give the size of the step")
        if not (math.isfinite(self.largest) and self.largest > 0.0):
            raise out_of_range("largest amplitude", self.largest, "", "values above 0", "give one in the measurement's unit")


def find_onset(
    plant: DelaySystem,
    trim: Trim,
    gains: PidGains,
    task: RayTask,
    *,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    limits: Limits = Limits(),  # noqa: B008 - an immutable tuple
) -> HuntingOnset:
    """Find where hunting begins as all gains are multiplied by one factor, and how.

    With integral action the loop is judged at the operating point where the command leads. Without it that point moves with the gains;
    then the loop is judged at the trim itself, where it rests at any gain if nothing is commanded.

    Args:
        plant: with its delays.
        trim: that the loop starts from; its control is the controller's output at no error.
        gains: of the controller; the factor 1 stands for them.
        task: what is asked.
        wires: which signals close the loop.
        limits: of what the controller drives.

    Raises:
        InvalidInputError: all gains are 0, or signals are missing.
        NoTrimError: the command leads to no steady state.
        AnalysisError: no factor changes the loop from stable to unstable, or where the command leads the control is beyond its limits.
        NotConvergedError: the family cannot be found, or its first cycles do not tell the kind of onset.
    """
    point = operating_point(trim, wires)
    loop = close_ray(plant, point, gains, wires=wires, limits=limits)
    rest = _where_it_rests(plant, point, task.command, wires) if gains.ki else trim
    there = operating_point(rest, wires)
    control = there.inputs[wires.drive]
    if not limits.low < control < limits.high:
        unit = gains.output_unit
        message = (
            f"the command leads to {wires.drive} = {control:.6g} {unit}, not within the limits {limits.low:g} to {limits.high:g} {unit}: "
            "the loop is open there and does not hunt; command less"
        )
        raise AnalysisError(message, control=control)
    crossing = _boundary(plant, rest, gains, wires)
    factor = crossing.gain_margin
    states = np.append(there.states, (control - point.inputs[wires.drive]) / (factor * gains.ki)) if gains.ki else there.states
    inputs = loop_inputs(plant, there, wires, command=there.measurement, factor=factor)
    onset = Onset(states=np.asarray(states), inputs=inputs, frequency=crossing.frequency)
    found = _follow(loop, onset, index_of(loop.outputs, wires.measurement), task.largest)
    curvature = _curvature(factor, found)
    points, unjudged = _judge_all(loop, found, wires, limits)
    return HuntingOnset(
        gains=gains.scaled(kp=factor, ki=factor, kd=factor),
        factor=factor,
        frequency=crossing.frequency,
        kind="soft" if curvature > 0.0 else "hard",
        curvature=curvature,
        lowest_factor=min(factor, _lowest(found)),
        lowest_is_fold=_turns(found) and _lowest(found) < factor,
        rest=there,
        points=points,
        unjudged=unjudged,
        limits=limits,
    )


def _follow(loop: DelaySystem, onset: Onset, watched: int, largest: float) -> tuple[BranchPoint, ...]:
    """Follow the family to an amplitude, or as far as it goes; beyond it where the factor still falls, until it turns."""
    axes, first = BranchAxes(parameter=onset.inputs.size - 1, watched=watched), np.arange(1, POINTS + 1) / POINTS
    further = FURTHER ** np.arange(1, MOST_FURTHER + 1)

    def enough(found: Sequence[BranchPoint]) -> bool:
        if found[-1].cycle.error > COARSE:
            return True
        if len(found) < POINTS:
            return False
        fallen = found[-1].parameter < onset.inputs[-1] and found[-1].parameter <= min(point.parameter for point in found)
        return not fallen

    found = tuple[BranchPoint, ...]()
    for attempt in range(SMALLER + 1):
        try:
            followed = follow_cycles(loop, onset, axes, largest * np.append(first, further), enough=enough)
            found = tuple(point for point in followed if point.cycle.error <= COARSE)
        except NotConvergedError:
            if attempt == SMALLER and not found:
                raise
        if len(found) >= FEWEST and (attempt == SMALLER or _agree(float(onset.inputs[-1]), found)):
            break
        largest *= min(len(found) + 1, FEWEST) / POINTS
    if not found:
        message = f"no cycle near the onset at {onset.frequency:g} rad/s is smooth enough to be followed by its harmonics; simulate"
        raise NotConvergedError(message)
    return found


def _where_it_rests(plant: DelaySystem, point: OperatingPoint, command: float, wires: LoopSignals) -> Trim:
    """The steady state at which the measurement is what is commanded."""
    held = {name: value for name, value in point.inputs.items() if name != wires.drive}
    return find_trim(plant, inputs=held, outputs={wires.measurement: point.measurement + command}, free=(wires.drive,))


def _boundary(plant: DelaySystem, rest: Trim, gains: PidGains, wires: LoopSignals) -> PhaseCrossover:
    """The factor, nearest to 1, at which rising gains end stability."""
    model = linearize(plant, rest).model
    crossings = sorted(find_margins(open_loop_of_system(model, gains, wires=wires)).phase_crossovers, key=lambda c: c.gain_margin)
    factors = [c.gain_margin for c in crossings]
    edges = [0.5 * factors[0], *factors, 2.0 * factors[-1]] if factors else []
    middles = [math.sqrt(a * b) for a, b in pairwise(edges)]
    stable = [open_loop_of_system(model, gains.scaled(kp=f, ki=f, kd=f), wires=wires).stable for f in middles]
    ends = [c for c, below, above in zip(crossings, stable[:-1], stable[1:], strict=True) if below and not above] if factors else []
    if not ends:
        message = (
            f"no factor of the gains kp = {gains.kp:g}, ki = {gains.ki:g}, kd = {gains.kd:g} changes the loop from stable to unstable at "
            f"{rest.output(wires.measurement):.6g} {gains.input_unit}: it is one or the other at any; change the ratio of the gains"
        )
        raise AnalysisError(message)
    return min(ends, key=lambda c: abs(math.log(c.gain_margin)))


def _agree(factor: float, found: tuple[BranchPoint, ...]) -> bool:
    """Whether the first two cycles tell the same kind of onset, extrapolated to nothing: those that touch a limit do not."""
    first, second = _slopes(factor, found)[:2]
    return _extrapolated(found, first, second) * first > 0.0


def _slopes(factor: float, found: tuple[BranchPoint, ...]) -> list[float]:
    """Change of the factor per square of the amplitude, of the first two cycles."""
    return [(point.parameter - factor) / point.amplitude**2 for point in found[:2]]


def _extrapolated(found: tuple[BranchPoint, ...], first: float, second: float) -> float:
    """That change as the amplitude vanishes."""
    ratio = (found[1].amplitude / found[0].amplitude) ** 2
    return (ratio * first - second) / (ratio - 1.0)


def _curvature(factor: float, found: tuple[BranchPoint, ...]) -> float:
    """Change of the factor per square of the amplitude as that vanishes, extrapolated from the first two cycles."""
    slopes = _slopes(factor, found)
    if abs(found[0].parameter / factor - 1.0) < FLAT:
        message = (
            f"the gains hardly change along the first cycles (by {found[0].parameter / factor - 1.0:.2g} of themselves): whether hunting "
            "begins softly or hard is not decided; follow larger cycles"
        )
        raise NotConvergedError(message)
    if len(slopes) == 1:
        return slopes[0]
    value = _extrapolated(found, slopes[0], slopes[1])
    if value * slopes[0] <= 0.0:
        message = f"the first cycles tell no kind of onset: the gains change by {slopes[0]:.3g} and {slopes[1]:.3g} per square of amplitude"
        raise NotConvergedError(message)
    return value


def _lowest(found: tuple[BranchPoint, ...]) -> float:
    """Lowest factor along the family, between its cycles by the parabola through the lowest and its neighbours."""
    factors, amplitudes = (np.array([getattr(point, name) for point in found]) for name in ("parameter", "amplitude"))
    best = int(np.argmin(factors))
    if 0 < best < factors.size - 1:
        near: Floats = np.polyfit(amplitudes[best - 1 : best + 2], factors[best - 1 : best + 2], 2)
        return float(near[2] - near[1] ** 2 / (4.0 * near[0]))
    return float(factors[best])


def _turns(found: tuple[BranchPoint, ...]) -> bool:
    """Whether the lowest factor lies within the family, not at its end."""
    factors = [point.parameter for point in found]
    return 0 < int(np.argmin(factors)) < len(factors) - 1


def _judge_all(
    loop: DelaySystem, found: tuple[BranchPoint, ...], wires: LoopSignals, limits: Limits
) -> tuple[tuple[RayPoint, ...], tuple[UnjudgedPoint, ...]]:
    """Find the stability of each cycle; one that cannot be resolved does not hide the others."""
    points, unjudged = list[RayPoint](), list[UnjudgedPoint]()
    for cycle in found:
        try:
            points.append(_judge(loop, cycle, wires, limits))
        except NotConvergedError as error:
            unjudged.append(UnjudgedPoint(factor=cycle.parameter, fundamental=cycle.amplitude, reason=str(error)))
    return tuple(points), tuple(unjudged)


def _judge(loop: DelaySystem, point: BranchPoint, wires: LoopSignals, limits: Limits) -> RayPoint:
    cycle = find_kinked_cycle(loop, point.cycle.orbit.inputs[0], point.cycle.as_guess(), tolerance=STABILITY, most_unknowns=MOST_UNKNOWNS)
    low, high = cycle.extremes(index_of(loop.outputs, wires.measurement))
    return RayPoint(
        factor=point.parameter,
        amplitude=(high - low) / 2.0,
        low=low,
        high=high,
        period=cycle.period,
        stable=cycle.stable,
        largest=cycle.largest,
        multiplier_error=cycle.multiplier_error,
        touches_limit=_touches(cycle, index_of(loop.outputs, "control"), limits),
    )


def _touches(cycle: KinkedCycle, control: int, limits: Limits) -> bool:
    low, high = cycle.extremes(control)
    return low <= limits.low or high >= limits.high
