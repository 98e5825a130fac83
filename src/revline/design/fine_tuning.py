"""Fine tuning: gains that answer a step of the command best under a limit on overshoot, found on a linear model.

What is minimised is stated by the objective, over the gains that are set free. Source of the aim: Lee (1995), section 5.3, which
tuned by hand; of the method: Powell (1994), constrained optimisation without derivatives.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from revline.design.closed_loop import LoopTask, trace_linear_loop
from revline.design.controller import PidGains
from revline.design.loop_stability import judge_loop_stability
from revline.design.step_measures import measure_overshoot
from revline.errors import InvalidInputError, NotConvergedError, out_of_range
from revline.lti.transfer_function import TransferFunction

Floats = NDArray[np.float64]


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

UNSTABLE_COST = 1e3
"""IAE that counts for an unstable loop, in multiples of the horizon: finite, so that the search can leave it."""

SAMPLES = 1200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineTuning:
    """Tuned gains and what made them best.

    Attributes:
        gains: the result.
        start: the gains that the search began from.
        free: which gains were free.
        objective: what was minimised, in words.
        value: of the objective.
        start_value: of the objective at the start.
        overshoot: of the result, as a fraction of the command.
        overshoot_limit: what it had to stay below.
        evaluations: closed loops computed.
    """

    gains: PidGains
    start: PidGains
    free: tuple[str, ...]
    objective: str
    value: float
    start_value: float
    overshoot: float
    overshoot_limit: float
    evaluations: int

    @property
    def text(self) -> str:
        """What was done, in a sentence."""
        freed = ", ".join(self.free)
        return (
            f"minimised {self.objective} over {freed} with overshoot at most {100 * self.overshoot_limit:g} %: "
            f"{self.value:.4g} at overshoot {100 * self.overshoot:.2f} %, from {self.start_value:.4g} at the start"
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

    Args:
        plant: strictly proper, with or without delay.
        start: gains to begin from; those not free stay.
        overshoot_limit: as a fraction of the command.
        free: which of kp, ki, kd are free; each must not be 0 at the start.
        objective: what is minimised.
        until: horizon of the closed loops, in s.

    Raises:
        InvalidInputError: a limit or a name is unusable, or a free gain is 0.
        NotConvergedError: no gains in the range keep the overshoot below its limit.
    """
    if not 0.0 < overshoot_limit < 1.0:
        raise out_of_range("overshoot limit", overshoot_limit, "of the command", "0 to 1", "give for example 0.1 for 10 %")
    names = tuple(free)
    for name in names:
        if name not in GAINS or getattr(start, name, 0.0) == 0.0:
            message = f"gain {name} cannot be tuned: it must be one of kp, ki, kd and differ from 0 at the start"
            raise InvalidInputError(message, gain=name)
    search = _Search(plant=plant, start=start, free=names, until=until, objective=objective)
    result = minimize(
        search.cost,
        np.zeros(len(names)),
        method="COBYLA",
        constraints=[
            {"type": "ineq", "fun": lambda x: overshoot_limit - search.overshoot(x)},
            {"type": "ineq", "fun": lambda x: math.log(WIDEST) - np.abs(x)},
        ],
        options={"rhobeg": 0.3, "tol": 1e-5, "maxiter": 400},
    )
    point = _into_limit(search, np.asarray(result.x), overshoot_limit)
    gains = search.gains(point)
    return FineTuning(
        gains=replace(
            gains, rule="fine-tuning", details={"overshoot_limit": overshoot_limit, "horizon_s": until, "free": ", ".join(names)}
        ),
        start=start,
        free=names,
        objective=WORDS[objective],
        value=search.cost(point),
        start_value=search.cost(np.zeros(len(names))),
        overshoot=search.overshoot(point),
        overshoot_limit=overshoot_limit,
        evaluations=int(result.nfev),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Search:
    """The loop over the logarithms of the free gains, relative to the start."""

    plant: TransferFunction
    start: PidGains
    free: tuple[str, ...]
    until: float
    objective: Objective

    def gains(self, point: Floats) -> PidGains:
        return replace(
            self.start, **{name: getattr(self.start, name) * math.exp(shift) for name, shift in zip(self.free, point, strict=True)}
        )

    def answer(self, point: Floats) -> tuple[Floats, Floats]:
        trace = trace_linear_loop(self.plant, self.gains(point), LoopTask(command=1.0, until=self.until, step=self.until / SAMPLES))
        return trace.times, trace.output

    def is_stable(self, point: Floats) -> bool:
        return judge_loop_stability(self.plant, self.gains(point)).stable

    def cost(self, point: Floats) -> float:
        if not self.is_stable(point):
            return UNSTABLE_COST * self.until
        if self.objective is Objective.LOAD_ERROR:
            return 1.0 / self.gains(point).ki
        times, output = self.answer(point)
        return float(np.trapezoid(np.abs(1.0 - output), times))

    def overshoot(self, point: Floats) -> float:
        if not self.is_stable(point):
            return UNSTABLE_COST
        times, output = self.answer(point)
        return measure_overshoot(times, output, start=0.0, target=1.0, command=1.0)


def _into_limit(search: _Search, point: Floats, limit: float) -> Floats:
    """Pull a point that the search left just outside of the limit back inside, towards smaller gains."""
    for _ in range(60):
        if search.overshoot(point) <= limit:
            return point
        point = point - 1e-3
    message = f"no gains between a hundredth and a hundred times the start keep the overshoot below {100 * limit:g} % on this model"
    raise NotConvergedError(message, overshoot_limit=limit)
