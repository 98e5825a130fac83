"""The gains at which a loop around a nonlinear plant stops settling after a step of its command, by simulation along rays.

On each ray (kp, ki) = f (kp1, ki1), factor 1 being the linear boundary at the target's equilibrium, a factor at which the loop settles and
one at which it does not are found, and the bracket is halved. Both ends were simulated and judged; nothing is extrapolated.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.analysis.linearize import linearize
from revline.analysis.threads import Failure, Progress, run_each
from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits, LoopTask, run_loop
from revline.design.loops.outcome import LimitCycle, Outcome, Settled
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, operating_point
from revline.design.regions.gain_rays import place_gains
from revline.design.regions.gain_region import GainRegion, find_gain_region
from revline.design.regions.loop_family import family_of_system
from revline.errors import NotConvergedError, NotSettledError, out_of_range
from revline.system import DelaySystem, index_of

Floats = NDArray[np.float64]

DOWN = (0.9, 0.7, 0.45, 0.2, 0.05)
"""Factors tried for one at which the loop settles."""

UP = (1.1, 1.4, 2.0, 4.0)
"""Factors tried for one at which it does not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundarySearch:
    """How the boundary is searched for.

    Attributes:
        rays: how many, evenly spread in angle over positive kp and ki, each scaled by the linear boundary's largest.
        tolerance: a bracket is halved until its ends differ by this fraction.
        until: how long a loop is simulated at first, in s.
        longest: how long it is simulated at most where that does not decide, in s.
        step: of the simulation, in s.
    """

    rays: int = 16
    tolerance: float = 0.01
    until: float = 20.0
    longest: float = 160.0
    step: float = 1e-3

    def __post_init__(self) -> None:
        if not 1 <= self.rays <= 1000:
            raise out_of_range("rays", self.rays, "", "1 to 1000", "give the number of points wanted")
        if not 1e-6 <= self.tolerance < 0.5:
            raise out_of_range("tolerance", self.tolerance, "", "1e-6 to 0.5", "0.01 brackets the boundary within a hundredth")
        if not 0.0 < self.until <= self.longest < math.inf:
            raise out_of_range(
                "longest run", self.longest, "s", f"{self.until:g} s and above", "give times in seconds, the first run's below"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class StepCase:
    """What the loop is asked to settle after.

    Attributes:
        command: size of the step of its command, in the measurement's unit.
        kd: derivative gain.
        limits: of what the controller drives.
    """

    command: float
    kd: float = 0.0
    limits: Limits = Limits()  # noqa: RUF009 - an immutable tuple


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryPoint:
    """Where one ray leaves the gains that settle; factors are those of the gains on the linear boundary.

    Attributes:
        kp, ki: of the linear boundary on this ray.
        frequency: of the linear oscillation there, in rad/s.
        settled: largest factor found at which the loop settles.
        unsettled: smallest factor found above it at which it does not.
        outcome: how it ends there.
        undecided: factors between at which the longest record did not decide.
        runs: loops simulated.
    """

    kp: float
    ki: float
    frequency: float
    settled: float
    unsettled: float
    outcome: Outcome
    undecided: tuple[float, ...]
    runs: int

    @property
    def factor(self) -> float:
        """Middle of the bracket."""
        return math.sqrt(self.settled * self.unsettled)

    @property
    def observed_frequency(self) -> float | None:
        """Of the limit cycle just beyond the boundary, in rad/s; none where the loop ends otherwise."""
        return 2.0 * math.pi / self.outcome.period if isinstance(self.outcome, LimitCycle) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class LostRay:
    """A ray without a boundary point, and why.

    Attributes:
        kp, ki: of the linear boundary on this ray, or the ray's direction where it does not meet that.
        reason: in words.
    """

    kp: float
    ki: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NonlinearBoundary:
    """The boundary by simulation beside the linear one.

    Attributes:
        plant: its name.
        case: command, kd and limits.
        start, target: of what the controller drives, at rest before the step and at rest at the commanded value.
        linear: stabilising gains of the exact linear model at the target's equilibrium.
        points: by rising angle from the axis of kp.
        lost: rays without a point.
        search: how it was searched for.
    """

    plant: str
    case: StepCase
    start: float
    target: float
    linear: GainRegion
    points: tuple[BoundaryPoint, ...]
    lost: tuple[LostRay, ...]
    search: BoundarySearch

    @property
    def largest_difference(self) -> float:
        """Largest distance of a bracket's middle from the linear boundary, as a fraction of the gains; the brackets add their own width."""
        return max((abs(point.factor - 1.0) for point in self.points), default=0.0)


@dataclass(frozen=True, slots=True)
class _Ray:
    kp: float
    ki: float
    frequency: float


def find_nonlinear_boundary(
    plant: DelaySystem,
    trim: Trim,
    case: StepCase,
    *,
    search: BoundarySearch | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> NonlinearBoundary:
    """Find the gains at which a speed loop around a nonlinear plant stops settling after a step of its command.

    Args:
        plant: with a throttle, a speed and its acceleration.
        trim: where the loop rests before the step.
        case: command, kd and the throttle's limits.
        search: how many rays, how finely, how long.
        workers: threads; the result does not depend on their number.
        progress: told which part of the rays is done.

    Raises:
        InvalidInputError: the command moves nothing, or the limits exclude the trim.
        NoTrimError: the commanded speed cannot be held.
        NotConvergedError: the linear boundary at the target is not there, so that rays have no scale, or no ray has a boundary point.
    """
    wires, search = SPEED_BY_THROTTLE, search or BoundarySearch()
    speed = trim.output(wires.measurement)
    task = LoopTask(command=case.command, until=search.until, step=search.step)
    held = {v.name: trim.input(v.name) for v in trim.input_variables if v.name != wires.drive}
    target = find_trim(plant, inputs=held, outputs={wires.measurement: speed + case.command}, free=(wires.drive,))
    name = f"{plant.name} at {target.input(wires.drive):.4g} {_unit(trim, wires)}"
    linear = find_gain_region(family_of_system(linearize(plant, target).model, kd=case.kd, name=name))
    rays, lost = _rays(linear, search.rays)

    def settle(gains: PidGains, until: float) -> Outcome:
        longer = LoopTask(command=task.command, until=until, step=task.step)
        return run_loop(plant, operating_point(trim), gains, longer, limits=case.limits).outcome

    def follow(ray: _Ray, tell: Progress) -> BoundaryPoint:
        return _Bisection(ray, _gains(trim, wires, case.kd), settle, search, tell).find()

    outcomes = run_each(follow, rays, lambda _: 1.0, workers=workers, progress=progress)
    points = []
    for ray, outcome in zip(rays, outcomes, strict=True):
        if not isinstance(outcome, Failure):
            points.append(outcome)
        elif isinstance(outcome.error, KeyboardInterrupt):
            raise outcome.error
        else:
            lost.append(LostRay(kp=ray.kp, ki=ray.ki, reason=str(outcome.error)))
    if not points:
        message = f"no ray of {search.rays} met a boundary of {plant.name}; the first: {lost[0].reason}"
        raise NotConvergedError(message)
    return NonlinearBoundary(
        plant=plant.name,
        case=case,
        start=trim.input(wires.drive),
        target=target.input(wires.drive),
        linear=linear,
        points=tuple(points),
        lost=tuple(lost),
        search=search,
    )


def _unit(trim: Trim, wires: LoopSignals) -> str:
    return trim.input_variables[index_of(trim.input_variables, wires.drive)].unit


def _gains(trim: Trim, wires: LoopSignals, kd: float) -> Callable[[float, float], PidGains]:
    measured = trim.output_variables[index_of(trim.output_variables, wires.measurement)].unit

    def make(kp: float, ki: float) -> PidGains:
        return PidGains(
            kp=kp, ki=ki, kd=kd, input_unit=measured, output_unit=_unit(trim, wires), rule="on a ray", designed_on="the plant itself"
        )

    return make


def _rays(linear: GainRegion, count: int) -> tuple[list[_Ray], list[LostRay]]:
    """Directions over positive gains, each taken to the linear boundary; those that do not meet it are lost."""
    rim = linear.rim & (linear.kp > 0.0)
    if not np.any(rim):
        message = (
            f"no positive gains stabilise {linear.family.name} with kd = {linear.family.kd:g}, so that there is no boundary to begin from; "
            "lower kd, or command another speed"
        )
        raise NotConvergedError(message)
    kp, ki = float(np.max(linear.kp[rim])), float(np.max(linear.ki[rim]))
    rays: list[_Ray] = []
    lost: list[LostRay] = []
    for angle in (np.arange(count) + 0.5) * (0.5 * math.pi / count):
        p, i = kp * math.cos(angle), ki * math.sin(angle)
        crossings = place_gains(linear, p, i).crossings
        if crossings:
            first = crossings[0]
            rays.append(_Ray(first.factor * p, first.factor * i, first.frequency))
        else:
            lost.append(LostRay(kp=p, ki=i, reason="it does not meet the linear boundary, which gives a ray its scale"))
    return rays, lost


@dataclass(slots=True)
class _Bisection:
    """The search on one ray."""

    ray: _Ray
    gains: Callable[[float, float], PidGains]
    settle: Callable[[PidGains, float], Outcome]
    search: BoundarySearch
    tell: Progress
    runs: int = 0

    def find(self) -> BoundaryPoint:
        low, high, above = self.bracket()
        low, high, above, undecided = self.narrow(low, high, above)
        ray = self.ray
        return BoundaryPoint(
            kp=ray.kp,
            ki=ray.ki,
            frequency=ray.frequency,
            settled=low,
            unsettled=high,
            outcome=above,
            undecided=tuple(undecided),
            runs=self.runs,
        )

    def bracket(self) -> tuple[float, float, Outcome]:
        """A factor at which the loop settles, and a larger one at which it does not, with how it ends there."""
        high, above = math.inf, None
        for factor in DOWN:
            outcome = self.outcome(factor)
            if isinstance(outcome, Settled):
                low = factor
                break
            if outcome is not None:
                high, above = factor, outcome
        else:
            message = f"the loop does not settle at {DOWN[-1]:g} of the linear boundary's gains either"
            raise NotConvergedError(message)
        for factor in UP:
            if above is not None:
                return low, high, above
            outcome = self.outcome(factor)
            if isinstance(outcome, Settled):
                low = factor
            elif outcome is not None:
                high, above = factor, outcome
        if above is None:
            message = f"the loop still settles, or does not tell, at {UP[-1]:g} times the linear boundary's gains"
            raise NotConvergedError(message)
        return low, high, above

    def narrow(self, low: float, high: float, above: Outcome) -> tuple[float, float, Outcome, list[float]]:
        """Halve a bracket; where records do not decide, both ends are moved up to the factors that are not decided."""
        undecided: list[float] = []
        while high / low - 1.0 > self.search.tolerance:
            inner = (undecided[0], undecided[-1]) if undecided else (high, low)
            below, beyond = inner[0] / low, high / inner[1]
            if undecided and max(below, beyond) - 1.0 <= 0.5 * self.search.tolerance:
                break
            middle = math.sqrt(low * inner[0] if below >= beyond else inner[1] * high)
            outcome = self.outcome(middle)
            if outcome is None:
                undecided = sorted((*undecided, middle))
            elif isinstance(outcome, Settled):
                low, undecided = middle, [f for f in undecided if f > middle]
            else:
                high, above, undecided = middle, outcome, [f for f in undecided if f < middle]
        return low, high, above, undecided

    def outcome(self, factor: float) -> Outcome | None:
        """How the loop ends at a factor; none where the longest record does not tell."""
        self.tell(0.0)
        gains, until = self.gains(factor * self.ray.kp, factor * self.ray.ki), self.search.until
        while True:
            self.runs += 1
            try:
                return self.settle(gains, until)
            except NotSettledError as error:
                if until >= self.search.longest:
                    return None
                needed = error.details.get("needed")
                wanted = max(2.0 * until, 1.1 * needed) if isinstance(needed, float) else self.search.longest
                until = min(wanted, self.search.longest)
