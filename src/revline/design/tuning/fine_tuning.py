"""Fine tuning: gains that answer a step of the command best under a limit on overshoot, found on a linear model.

What is minimised is stated by the objective, over the gains that are set free. Source of the aim: Lee (1995), section 5.3, which
tuned by hand; of the method: Nelder and Mead (1965), The Computer Journal 7(4), 308-313, started again from where it stops
(Kelley (1999), SIAM Journal on Optimization 10(1), 43-55), with the limit as a penalty.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import LoopTask, trace_linear_loop
from revline.design.loops.loop_simulation import LoopTrace
from revline.design.loops.step_measures import measure_overshoot
from revline.design.stability.loop_equation import form_loop
from revline.design.stability.loop_stability import judge_loop_stability
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.lti.transfer_function import TransferFunction

Floats = NDArray[np.float64]
Point = tuple[float, ...]
"""Logarithms of the free gains, relative to the start."""


class Objective(Enum):
    """What fine tuning minimises."""

    SETPOINT_ERROR = "setpoint-error"
    """Integral of the absolute error after a unit step of the command."""
    LOAD_ERROR = "load-error"
    """Integrated error after a unit step of a load at the plant's input, 1/ki. Source: Astrom and Hagglund (2006), section 4.4."""


WORDS = MappingProxyType(
    {
        Objective.SETPOINT_ERROR: "the integral of the absolute error after a unit step of the command",
        Objective.LOAD_ERROR: "the integrated error after a unit step of a load at the plant's input (1/ki)",
    }
)

GAINS = ("kp", "ki", "kd")
WIDEST = 100.0
"""Gains are sought between the start divided by this and the start times this."""

EDGE = 1e-3
"""A gain within this part of the end of its range counts as being there."""

SAMPLES = 1200
"""Samples within the horizon asked for."""

REST = 0.02
"""A loop that is further than this part of the command from its end over the last tenth of the horizon has not come to rest."""

DOUBLINGS = 4
"""How many times the horizon is doubled for a loop that has not come to rest."""

PENALTY = 100.0
"""What overshoot beyond the limit costs, in multiples of the objective at the start: more than it can ever gain."""

SPREAD = 0.3
"""First moves of a search, in logarithms of gains."""

ROUNDS = 8
"""How many times a search is started again at most."""

UNSTABLE = 1e3
"""Cost and overshoot of an unstable loop: finite, so that a search that steps into one finds back."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineTuning:
    """Tuned gains and what made them best.

    Attributes:
        gains: the result.
        start: the gains that the search began from.
        free: which gains were free.
        objective: what was minimised, in words.
        value: of the objective.
        start_value: of the objective at the start; of the first stable gains on the way from it where it is unstable.
        start_is_stable: whether the loop is stable at the start.
        overshoot: of the result, as a fraction of the command.
        overshoot_limit: what it had to stay below.
        horizon: time over which loops were judged, in s: the one asked for, doubled until the result comes to rest within it.
        evaluations: closed loops computed.
    """

    gains: PidGains
    start: PidGains
    free: tuple[str, ...]
    objective: str
    value: float
    start_value: float
    start_is_stable: bool
    overshoot: float
    overshoot_limit: float
    horizon: float
    evaluations: int

    @property
    def at_edge(self) -> tuple[str, ...]:
        """Free gains that ended at an edge of the range sought: there is no optimum inside it."""
        shifts = {name: abs(math.log(getattr(self.gains, name) / getattr(self.start, name))) for name in self.free}
        return tuple(name for name, shift in shifts.items() if shift > math.log(WIDEST) - EDGE)

    @property
    def text(self) -> str:
        """What was done, in a sentence; a second one where the range sought ended the search."""
        freed = ", ".join(self.free)
        origin = "at the start" if self.start_is_stable else "where the loop first is stable, the start being unstable"
        done = (
            f"minimised {self.objective} over {freed} with overshoot at most {100 * self.overshoot_limit:g} %: "
            f"{self.value:.4g} at overshoot {100 * self.overshoot:.2f} %, from {self.start_value:.4g} {origin}"
        )
        if not self.at_edge:
            return done
        edges = " and ".join(f"{name} = {getattr(self.gains, name):.4g}" for name in self.at_edge)
        return (
            f"{done}. {edges}: at the edge of the range sought, {WIDEST:g} times the start or the start over {WIDEST:g}, "
            "so this is no optimum; the model may lack the delay that bounds its gains"
        )


def fine_tune(
    plant: TransferFunction,
    start: PidGains,
    *,
    overshoot_limit: float,
    free: Sequence[str] = ("ki",),
    objective: Objective = Objective.SETPOINT_ERROR,
    until: float = 4.0,
) -> FineTuning:
    """Tune gains on a linear model, its delay exact, to the least of an objective under a limit on overshoot.

    The result is the best loop met by a search from the start; of several optima it is the one that the search leads to.

    Args:
        plant: strictly proper, with or without delay.
        start: gains to begin from; those not free stay, to the last bit.
        overshoot_limit: as a fraction of the command.
        free: which of kp, ki, kd are free; each must not be 0 at the start, and keeps its sign.
        objective: what is minimised.
        until: horizon of the closed loops, in s; longer where the result has not come to rest by then.

    Raises:
        InvalidInputError: a limit, the horizon or a name is unusable, a free gain is 0, or the objective does not depend on what is free.
        NotConvergedError: no gains in the range make a stable loop, or keep the overshoot below its limit, or come to rest.
    """
    names = _check(start, overshoot_limit, tuple(free), objective, until)
    evaluations = 0
    for doubling in range(DOUBLINGS + 1):
        search = _Search(plant=plant, start=start, free=names, until=until * 2**doubling, spacing=until / SAMPLES, objective=objective)
        judge = functools.cache(search.judge)
        seed = _find_stable_seed(judge, len(names))
        point = _find_best(judge, seed, overshoot_limit)
        evaluations += judge.cache_info().misses
        if search.comes_to_rest(point):
            notes: dict[str, float | str] = {
                "overshoot_limit": overshoot_limit,
                "horizon_s": search.until,
                "free": ", ".join(names),
            }
            return FineTuning(
                gains=replace(search.gains(point), rule="fine-tuning", details=notes),
                start=start,
                free=names,
                objective=WORDS[objective],
                value=judge(point).cost,
                start_value=judge(seed).cost,
                start_is_stable=not any(seed),
                overshoot=judge(point).overshoot,
                overshoot_limit=overshoot_limit,
                horizon=search.until,
                evaluations=evaluations,
            )
    longest = until * 2**DOUBLINGS
    message = f"the best loop has not come to rest within {longest:g} s; give gains nearer to what the model needs, or a longer horizon"
    raise NotConvergedError(message, horizon=longest)


def _check(start: PidGains, limit: float, free: tuple[str, ...], objective: Objective, until: float) -> tuple[str, ...]:
    if not 0.0 < limit < 1.0:
        raise out_of_range("overshoot limit", limit, "of the command", "0 to 1", "give for example 0.1 for 10 %")
    if not (math.isfinite(until) and until > 0.0):
        raise out_of_range("horizon", until, "s", "values above 0", "give a time in which the loop comes to rest")
    for name in free:
        if name not in GAINS or free.count(name) > 1 or getattr(start, name) == 0.0:
            message = f"gain {name} cannot be tuned: it must be one of kp, ki, kd, named once, and differ from 0 at the start"
            raise InvalidInputError(message, gain=name)
    if not free or (objective is Objective.LOAD_ERROR and "ki" not in free):
        message = f"{WORDS[objective]} does not depend on what is free ({', '.join(free) or 'nothing'}); set ki free"
        raise InvalidInputError(message)
    return free


class _Verdict(NamedTuple):
    """What a loop costs and how far it overshoots."""

    cost: float
    overshoot: float


Judge = Callable[[Point], _Verdict]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Search:
    """The loop over the logarithms of the free gains, relative to the start."""

    plant: TransferFunction
    start: PidGains
    free: tuple[str, ...]
    until: float
    spacing: float
    objective: Objective

    def gains(self, point: Point) -> PidGains:
        return replace(
            self.start, **{name: getattr(self.start, name) * math.exp(shift) for name, shift in zip(self.free, point, strict=True)}
        )

    def trace(self, point: Point) -> LoopTrace:
        return trace_linear_loop(self.plant, self.gains(point), LoopTask(command=1.0, until=self.until, step=self.spacing))

    def judge(self, point: Point) -> _Verdict:
        gains = self.gains(point)
        if not self._is_stable(gains):
            return _Verdict(UNSTABLE, UNSTABLE)
        trace = self.trace(point)
        overshoot = measure_overshoot(trace.times, trace.output, start=0.0, target=1.0, command=1.0)
        if self.objective is Objective.LOAD_ERROR:
            return _Verdict(1.0 / abs(gains.ki), overshoot)
        return _Verdict(float(np.trapezoid(np.abs(1.0 - trace.output), trace.times)), overshoot)

    def comes_to_rest(self, point: Point) -> bool:
        end = form_loop(self.plant, self.gains(point)).static_gain
        output = self.trace(point).output
        return bool(np.all(np.abs(output[-max(len(output) // 10, 1) :] - end) <= REST))

    def _is_stable(self, gains: PidGains) -> bool:
        try:
            return judge_loop_stability(self.plant, gains).stable
        except NotConvergedError:  # a pole on the imaginary axis, or too near to tell
            return False


def _find_stable_seed(judge: Judge, count: int) -> Point:
    """Scale all free gains together, down first, until the loop is stable."""
    widest = math.log(WIDEST)
    for shift in (0.0, *np.arange(-0.5, -widest, -0.5), *np.arange(0.5, widest, 0.5)):
        point = (float(shift),) * count
        if judge(point).overshoot < UNSTABLE:
            return point
    message = (
        "the loop is unstable with the start and with all multiples of its free gains between a hundredth and a hundred; give another start"
    )
    raise NotConvergedError(message)


def _find_best(judge: Judge, seed: Point, limit: float) -> Point:
    """Search from a stable point, again and again from where the search stopped; the best loop met within the limit is the result."""
    met: set[Point] = {seed}
    unit, widest = judge(seed).cost, math.log(WIDEST)

    def penalised(at: Floats) -> float:
        point: Point = tuple(float(np.clip(shift, -widest, widest)) for shift in at)
        met.add(point)
        verdict = judge(point)
        outside = float(np.sum(np.abs(at - np.array(point))))
        return verdict.cost / unit + PENALTY * (max(0.0, verdict.overshoot - limit) + outside)

    place, before = np.array(seed), math.inf
    for turn in range(ROUNDS):
        moves = SPREAD * np.eye(len(seed)) * (-1) ** turn
        options = {"initial_simplex": np.vstack([place, place + moves]), "xatol": 1e-5, "fatol": 1e-6, "maxiter": 300 * len(seed)}
        found = minimize(penalised, place, method="Nelder-Mead", options=options)
        place = np.asarray(found.x)
        if before - found.fun <= 1e-4 * abs(found.fun):
            break
        before = float(found.fun)
    within = [point for point in met if judge(point).overshoot <= limit]
    if not within:
        least = min(judge(point).overshoot for point in met)
        message = (
            f"no gains between a hundredth and a hundred times the start were met that keep the overshoot below {100 * limit:g} % on this "
            f"model: the least was {100 * least:.3g} %; allow more, or set more gains free"
        )
        raise NotConvergedError(message, overshoot_limit=limit, least=least)
    return min(within, key=lambda point: (judge(point).cost, point))
