"""What a closed loop did after a step of its command, and the judgement how it ended, whatever ran it."""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import AntiWindup, Continuous, PidController
from revline.design.loops.classify import Criteria, classify_outcome
from revline.design.loops.loop_simulation import LoopRecord, describe_stall
from revline.design.loops.outcome import Diverged, LimitCycle, Outcome, Settled
from revline.design.loops.step_measures import StepMeasures, measure_overshoot, measure_step
from revline.design.loops.time_series import MIN_SAMPLES
from revline.errors import DivergedError, InvalidInputError, NotSettledError, out_of_range
from revline.sampled import FixedRate
from revline.signals import Signal
from revline.system import DelaySystem
from revline.values import make_read_only

Floats = NDArray[np.float64]

FORM = (
    "u = trim + kp e + ki integral of e - kd dy/dt; derivative on the measurement only, integral from 0, true step command, no anti-windup"
)
"""The form of every closed loop with gains alone; other forms give other numbers."""

KEPT = " but that the integral stays where the output can follow it"
"""What a sampled controller does with limits in any case."""


def describe_form(controller: PidController) -> str:
    """Say in words which law a loop ran."""
    if not controller.extras:
        return FORM
    b, c, tf, unit = controller.setpoint_weight, controller.derivative_weight, controller.filter_time, controller.gains.input_unit
    weighted = "-y" if c == 0.0 else f"{c:g} r - y"
    derivative = f"kd s/({tf:g} s + 1) ({weighted})" if tf > 0.0 else f"kd d({weighted})/dt"
    proportional = "kp e" if b == 1.0 else f"kp ({b:g} r - y)"
    followed = f" over {controller.tracking_time:g} s" if controller.tracking_time is not None else ""
    windup = f"anti-windup by {controller.anti_windup.value}{followed}"
    if controller.anti_windup is AntiWindup.NONE:
        free = isinstance(controller.sampling, Continuous) or (math.isinf(controller.low) and math.isinf(controller.high))
        windup = "no anti-windup" if free else f"no anti-windup{KEPT}"
    parts = [f"u = trim + {proportional} + ki integral of e + {derivative}", *_describe_sampling(controller)]
    parts += ["integral from 0", "true step command", windup]
    parts += [f"errors within {controller.dead_zone:g} {unit} count as none"] if controller.dead_zone > 0.0 else []
    return "; ".join(parts)


def _describe_sampling(controller: PidController) -> list[str]:
    """Say in words when a controller samples, and what it does at its samples alone."""
    sampling, drive, unit = controller.sampling, controller.gains.output_unit, controller.gains.input_unit
    if isinstance(sampling, Continuous):
        return []
    when = f"each {sampling.period:g} s" if isinstance(sampling, FixedRate) else f"each {sampling.angle:g} rad of the crank"
    delay = f" {sampling.computation_delay:g} s after the sample" if sampling.computation_delay > 0.0 else ""
    parts = [f"sampled {when}, the output held from{delay or ' the sample'} on", "backward sums and differences"]
    parts += [f"rate at most {controller.rate_limit:g} {drive}/s"] if math.isfinite(controller.rate_limit) else []
    parts += [f"measured to {controller.measurement_step:g} {unit}"] if controller.measurement_step > 0.0 else []
    parts += [f"output in steps of {controller.output_step:g} {drive}"] if controller.output_step > 0.0 else []
    return parts


class Limits(NamedTuple):
    """Lower and upper limit of what the controller drives."""

    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopRun:
    """A closed loop after a step of its command, how it ended, and what its controller did.

    Attributes:
        plant: name of the plant.
        gains: of the controller.
        form: control law and conventions, in words.
        limits: of the control.
        command: size of the step, in the measurement's unit.
        start: measurement before the step.
        rest: the control before the step.
        times: shape (n,), in seconds from the step; to where it passed its bound for a loop that diverges, to the last step for one that
            stalls.
        output: the measurement, shape (n,).
        control: what the controller drives, after its limits, shape (n,).
        terms: proportional, integral and derivative term, shape (n, 3); without rows where they are not known.
        outcome: how it ended.
        overshoot: as a fraction of the command, of whatever was recorded; it says nothing of a loop that diverged or stalled.
        step: of the simulation, in seconds; 0 where the response is an exact formula.
    """

    plant: str
    gains: PidGains
    form: str
    limits: Limits
    command: float
    start: float
    rest: float
    times: Floats
    output: Floats
    control: Floats
    terms: Floats
    outcome: Outcome
    overshoot: float
    step: float

    def __post_init__(self) -> None:
        if not len(self.times) == len(self.output) == len(self.control):
            message = f"times, output and control have {len(self.times)}, {len(self.output)} and {len(self.control)} samples"
            raise InvalidInputError(message)
        if len(self.terms) not in (0, len(self.times)):
            message = f"there are {len(self.terms)} samples of the controller's terms and {len(self.times)} of the output"
            raise InvalidInputError(message)
        if not all(np.isfinite(values).all() for values in (self.times, self.output, self.control, self.terms)):
            message = "a closed loop's record holds numbers that are not finite; end it before them"
            raise InvalidInputError(message)
        make_read_only(self)

    @property
    def target(self) -> float:
        """Value commanded after the step."""
        return self.start + self.command

    @property
    def is_stable(self) -> bool:
        """Whether the loop came to rest."""
        return isinstance(self.outcome, Settled)

    @property
    def saturated_share(self) -> float:
        """Part of the samples in which the control is at a limit."""
        return float(np.mean((self.control <= self.limits.low) | (self.control >= self.limits.high)))

    @property
    def wanted(self) -> Floats:
        """The control before its limits: that at rest and the sum of the terms, shape (n,)."""
        return self.rest + self.terms.sum(axis=1) if len(self.terms) else self.control

    @property
    def windup(self) -> Floats:
        """How far the control wanted is beyond its limits, with its sign, shape (n,): what the loop must take back before it answers."""
        wanted = self.wanted
        return np.asarray(wanted - np.clip(wanted, *self.limits))

    def first_part(self, end: float) -> "LoopRun":
        """The record up to a time, with its own overshoot; the judgement stays that of the whole.

        Args:
            end: in s, after the first samples.
        """
        k = max(int(np.searchsorted(self.times, end)), MIN_SAMPLES)
        times, output = self.times[:k], self.output[:k]
        overshoot = measure_overshoot(times, output, start=0.0, target=self.target, command=self.command)
        return replace(self, times=times, output=output, control=self.control[:k], terms=self.terms[:k], overshoot=overshoot)

    def measures(self) -> StepMeasures:
        """Overshoot, rise and settling time.

        Raises:
            NotSettledError: the loop has not settled within the record.
        """
        return measure_step(self.times, self.output, start=0.0, target=self.target, command=self.command)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopTask:
    """What is asked of a closed loop: the step of its command, how long and how finely it is run, and signals of other inputs by name."""

    command: float
    until: float
    step: float = 1e-3
    criteria: Criteria = field(default_factory=Criteria)
    loads: tuple[tuple[str, Signal], ...] = ()

    def __post_init__(self) -> None:
        if not math.isfinite(self.command) or self.command == 0.0:
            message = f"command step = {self.command:g} moves nothing; give a size other than 0"
            raise InvalidInputError(message, command=self.command)
        for name, value in (("stop time", self.until), ("time step", self.step)):
            if not (math.isfinite(value) and value > 0.0):
                raise out_of_range(name, value, "s", "values above 0", "give a time in seconds")
        if self.until < (MIN_SAMPLES - 1) * self.step:
            raise out_of_range(
                "stop time", self.until, "s", f"{MIN_SAMPLES - 1} time steps of {self.step:g} s", "run longer, or take shorter time steps"
            )


class LoopFrame(NamedTuple):
    """What a run is told with: names, law and limits, and the measurement and the control before the step."""

    plant: str
    gains: PidGains
    form: str
    limits: Limits
    start: float
    rest: float


def judge_loop(frame: LoopFrame, task: LoopTask, record: LoopRecord, loop: DelaySystem | None = None) -> LoopRun:
    """Tell how a loop ended that was run as far as it went.

    Args:
        frame: what it is told with.
        task: what was asked.
        record: what happened.
        loop: the system that was simulated, to name the state that stalled it; none where nothing can stall.

    Raises:
        NotSettledError: the record does not decide.
        SimulationError: the run failed otherwise than by a stall or by leaving all bounds.
    """
    target, trace = frame.start + task.command, record.trace
    outcome = _decide(task, record, target, loop)
    if isinstance(outcome, Diverged):
        trace = trace.first(max(int(np.searchsorted(trace.times, outcome.time, side="right")), MIN_SAMPLES))
    return LoopRun(
        plant=frame.plant,
        gains=frame.gains,
        form=frame.form,
        limits=frame.limits,
        command=task.command,
        start=frame.start,
        rest=frame.rest,
        times=trace.times,
        output=trace.output,
        control=trace.control,
        terms=trace.terms,
        outcome=outcome,
        overshoot=measure_overshoot(trace.times, trace.output, start=0.0, target=target, command=task.command),
        step=trace.step,
    )


def _decide(task: LoopTask, record: LoopRecord, target: float, loop: DelaySystem | None) -> Outcome:
    """Tell how a loop ended; numbers beyond the range of numbers are believed only if the measurement had left its bound before."""
    trace, failure = record
    if failure is not None and loop is not None and not isinstance(failure, DivergedError):
        return describe_stall(failure, loop)
    try:
        outcome = classify_outcome(trace.times, trace.output, target=target, command=task.command, criteria=task.criteria)
    except NotSettledError as undecided:
        raise (failure or undecided) from undecided
    if failure is not None and not isinstance(outcome, Diverged):
        raise failure
    return outcome


def refuse_creep(run: LoopRun, end: float, criteria: Criteria, *, spare: float = 0.0) -> LoopRun:
    """Refuse a run that looks at rest elsewhere than where the loop can rest: it still creeps there.

    Args:
        run: the run.
        end: where the loop can rest.
        criteria: of the run.
        spare: how far beside that it can rest too, in the measurement's unit: a dead zone.

    Raises:
        NotSettledError: the run is so; with where it goes.
    """
    outcome, unit = run.outcome, run.gains.input_unit
    if not isinstance(outcome, Settled) or abs(end - outcome.value) <= criteria.rest * abs(run.command) + outcome.residual + spare:
        return run
    message = (
        f"the record of {run.times[-1]:g} s ends near {outcome.value:.6g} {unit} but the loop can rest at {end:.6g} {unit} only: it still "
        "creeps there; simulate much longer, or raise the integral gain"
    )
    raise NotSettledError(message, value=outcome.value, end=end, ki=run.gains.ki)


MISSED = 0.01
"""A loop that comes to rest further from its target than this part of the command is said to miss it."""


def describe_outcome(run: LoopRun) -> str:
    """Say in a line how a loop ended, with its numbers."""
    outcome, unit = run.outcome, run.gains.input_unit
    if isinstance(outcome, Settled):
        off, side = abs(outcome.steady_error), "below" if outcome.steady_error > 0.0 else "above"
        missed = f", {off:.4g} {unit} {side} what is commanded" if off > MISSED * abs(run.command) else ""
        return f"settles at {outcome.value:.6g} {unit}, overshoot {100.0 * run.overshoot:.1f} % of the command{missed}"
    if isinstance(outcome, LimitCycle):
        return f"hunts between {outcome.low:.6g} and {outcome.high:.6g} {unit}, period {outcome.period:.4g} s"
    if isinstance(outcome, Diverged):
        return f"diverges: beyond {outcome.bound:g} {unit} from its target after {outcome.time:.3g} s"
    return str(outcome)
