"""A closed loop under a sampled controller after a step of its command: how it ends, judged as a continuous one is.

The loop is run as far as it goes, without noise and jitter, and judged by that; with noise and jitter it is run again, and told how
far they move it. What the controller's resolution leaves of motion counts as rest, and is told.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline import signals
from revline.design.controllers.pid_controller import Continuous, PidController
from revline.design.controllers.scheduled_pid import AnyController, ScheduledController
from revline.design.loops.controller_samples import DisturbedRun, Samples
from revline.design.loops.loop_run import Limits, LoopFrame, LoopRun, LoopTask, describe_form, judge_loop, refuse_creep
from revline.design.loops.loop_simulation import LoopRecord, LoopTrace, Mesh, check_steps, keep_finite, run_as_far_as_it_goes
from revline.design.loops.outcome import LimitCycle
from revline.design.loops.sampled_loop import Disturbance, SampledRun, SampledTask, run_sampled_loop, with_command
from revline.design.plants.linear_plant import held_plant, step_limit
from revline.design.plants.loop_signals import OF_LINEAR_MODEL, SPEED_BY_THROTTLE, LoopSignals, OperatingPoint
from revline.errors import InvalidInputError, NotSettledError, SimulationError, out_of_range
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem
from revline.units import Seconds

Floats = NDArray[np.float64]

REPEATS = (0.02, 0.09)
"""How unlike cycles may be in turn, as a fraction, where samples fall differently into each."""

LARGEST_REST = 0.49
"""The resolution may leave motion up to this part of the command."""

MOST_SAMPLES = 1e6
"""More samples than this would run for minutes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledStep:
    """A sampled loop after a step of its command.

    Attributes:
        run: without noise and jitter, with the judgement; its terms are those of the last sample. Where noise or jitter end the loop
            before its time, the run with them.
        samples: of that run.
        controller: what was sampled; of a scheduled one the controller with the gains of the place where it starts.
        disturbed: the run with noise and jitter; none where there are none, or the loop ends before its time.
        period: between samples at rest, in s.
        notes: what a reader should know.
    """

    run: LoopRun
    samples: Samples
    controller: PidController
    disturbed: DisturbedRun | None
    period: Seconds
    notes: tuple[str, ...]

    @property
    def equivalent_delay(self) -> Seconds:
        """Half a period and the computation delay, in s: what a continuous loop needs more to be like this one."""
        sampling = self.controller.sampling
        return self.period / 2.0 + (0.0 if isinstance(sampling, Continuous) else sampling.computation_delay)


class _Loop(NamedTuple):
    """What is run."""

    plant: DelaySystem
    point: OperatingPoint
    controller: AnyController
    wires: LoopSignals

    @property
    def law(self) -> PidController:
        """The controller, with the gains of the place where it starts."""
        return local_law(self.controller, self.point)


class _Outcome(NamedTuple):
    """A run as far as it went, and where it left its gain schedule, if it did."""

    record: LoopRecord
    samples: Samples
    outside: str


def local_law(controller: AnyController, point: OperatingPoint) -> PidController:
    """Take a controller as it is about a point of rest: of a schedule the gains there.

    Args:
        controller: with fixed or with scheduled gains.
        point: of rest; its inputs hold the schedule's second signal.
    """
    if not isinstance(controller, ScheduledController):
        return controller
    return controller.frozen_at(point.measurement, point.inputs[controller.schedule.names[1]])


def run_sampled_step(
    plant: DelaySystem,
    point: OperatingPoint,
    controller: AnyController,
    task: LoopTask,
    *,
    disturbance: Disturbance | None = None,
    wires: LoopSignals = SPEED_BY_THROTTLE,
) -> SampledStep:
    """Close a loop around a system at rest with a sampled controller, step its command, and tell how it ends.

    Args:
        plant: nonlinear, with its delays.
        point: of rest, for example a trim.
        controller: fixed-rate or crank-synchronous; a scheduled one reads its second signal from the plant's input of that name.
        task: what is asked.
        disturbance: noise and jitter of a second run; none by default.
        wires: which signals close the loop.

    Raises:
        InvalidInputError: as for `run_sampled_loop`, or there would be too many samples.
        NotSettledError: the record is too short to tell how the loop ends.
        SimulationError: the run fails otherwise than by a stall or by leaving all bounds.
    """
    criteria = replace(task.criteria, bound=max(task.criteria.bound, abs(point.measurement / task.command)))
    wide = replace(task, criteria=criteria)
    return _run_step(_Loop(plant, point, controller, wires), wide, Mesh(task.until, task.step), disturbance or Disturbance(), plant.name)


def run_sampled_linear_step(
    model: TransferFunction,
    controller: PidController,
    task: LoopTask,
    *,
    name: str,
    base: tuple[float, float] = (0.0, 0.0),
    disturbance: Disturbance | None = None,
) -> SampledStep:
    """Close a loop around a linear model, its delay exact, with a sampled controller; see `run_sampled_step`.

    Args:
        model: strictly proper, with or without delay, of at most eight poles.
        controller: fixed-rate or crank-synchronous; its limits are those of the input itself, so that the base must be the trim's.
        task: what is asked.
        name: of the model, for people.
        base: input and output at the trim that the model belongs to.
        disturbance: noise and jitter of a second run; none by default.

    Raises:
        InvalidInputError, NotSettledError, SimulationError: as for `run_sampled_step`, or the model is not strictly proper.
    """
    if task.loads:
        message = f"a linear model has no input but {model.input_name}; a load is stepped on an engine"
        raise InvalidInputError(message)
    plant = held_plant(model, base_input=base[0], base_output=base[1])
    point = OperatingPoint(states=np.zeros(len(plant.states)), inputs={OF_LINEAR_MODEL.drive: base[0]}, measurement=base[1])
    mesh = Mesh(task.until, task.step, math.ceil(task.step / min(step_limit(model), task.step)))
    return _run_step(_Loop(plant, point, controller, OF_LINEAR_MODEL), task, mesh, disturbance or Disturbance(), name)


def _run_step(loop: _Loop, task: LoopTask, mesh: Mesh, disturbance: Disturbance, name: str) -> SampledStep:
    period = _check_samples(loop, task)
    check_steps(mesh)
    quiet = _run_as_far_as_it_goes(loop, task, mesh, Disturbance())
    frame = _frame(loop, name)
    run, notes = _judge(loop, frame, task, quiet)
    whole = SampledStep(
        run=run,
        samples=quiet.samples.until(run.times[-1]),
        controller=loop.law,
        disturbed=None,
        period=period,
        notes=notes,
    )
    if disturbance.noise == disturbance.jitter == 0.0:
        return whole
    if quiet.record.failure is not None:
        return replace(whole, notes=(*notes, "the loop ends before its time even without noise and jitter, which were left out"))
    noisy = _run_as_far_as_it_goes(loop, task, mesh, disturbance)
    if noisy.record.failure is not None:
        failed, _ = _judge(loop, frame, task, noisy)
        note = f"without noise and jitter the loop does not end before its time: {run.outcome.name}"
        return replace(whole, run=failed, samples=noisy.samples.until(failed.times[-1]), notes=(note,))
    return replace(whole, disturbed=_compare(run, whole.samples, noisy, disturbance))


def _check_samples(loop: _Loop, task: LoopTask) -> float:
    """Refuse a continuous controller and more samples than can be waited for; give the period at rest."""
    sampling = loop.law.sampling
    if isinstance(sampling, Continuous):
        message = "a continuous controller is not sampled; give it a sampling, or run it with run_loop()"
        raise InvalidInputError(message)
    period = sampling.period_at(loop.point.measurement)
    if task.until / period > MOST_SAMPLES:
        limit = f"{task.until / MOST_SAMPLES:.3g} s and above for runs of {task.until:g} s"
        raise out_of_range("sampling period", period, "s", limit, "sample more slowly, or run it shorter")
    return period


def _frame(loop: _Loop, name: str) -> LoopFrame:
    law = loop.law
    rest = float(loop.point.inputs[loop.wires.drive])
    return LoopFrame(name, law.gains, describe_form(law), Limits(law.low, law.high), start=loop.point.measurement, rest=rest)


def _run_as_far_as_it_goes(loop: _Loop, task: LoopTask, mesh: Mesh, disturbance: Disturbance) -> _Outcome:
    def run(mesh: Mesh) -> SampledRun:
        asked = SampledTask(
            command=signals.step(task.command),
            until=mesh.until,
            step=mesh.spacing / mesh.pieces,
            disturbance=disturbance,
            loads=dict(task.loads),
            every=mesh.pieces,
        )
        return run_sampled_loop(loop.plant, loop.point, loop.controller, asked, wires=loop.wires)

    return _outcome(*run_as_far_as_it_goes(run, mesh))


def _outcome(run: SampledRun, step: float, failure: SimulationError | None) -> _Outcome:
    found = run.sampled
    terms = np.column_stack([run.of_controller(name) for name in ("proportional", "integral", "derivative")])
    wanted = run.of_controller("control_wanted")
    allowed = found.states[:, [v.name for v in run.code.states].index("output_before")]
    samples = Samples(
        times=found.times,
        measurement=found.measurements[:, 0],
        command=found.commands[:, 0],
        control=run.of_controller("control"),
        wanted=wanted,
        terms=terms,
        windup=wanted - allowed,
        gains=_gains(run),
        overruns=found.overruns,
    )
    last = np.maximum(np.searchsorted(found.times, run.times + 1e-9, side="right") - 1, 0)
    trace = LoopTrace(times=run.times, output=run.output, control=run.control, terms=terms[last], step=step)
    return _Outcome(LoopRecord(keep_finite(trace), failure), samples, _outside(run))


def _outside(run: SampledRun) -> str:
    """Say where a run left the table of its gains."""
    if not isinstance(run.controller, ScheduledController):
        return ""
    return run.controller.schedule.outside(run.sampled.measurements[:, 0], run.sampled.commands[:, 1])


def _gains(run: SampledRun) -> Floats:
    if not isinstance(run.controller, ScheduledController):
        return np.empty((0, 3))
    return np.column_stack([run.of_controller(name) for name in ("kp_used", "ki_used", "kd_used")])


def _judge(loop: _Loop, frame: LoopFrame, task: LoopTask, found: _Outcome) -> tuple[LoopRun, tuple[str, ...]]:
    """Judge a run; cycles into which samples fall differently may be somewhat unlike each other."""
    law, system = loop.law, with_command(loop.plant, loop.wires.measurement)
    left = _left_by_resolution(law, task, found.record.trace)
    notes: list[str] = []
    if left > task.criteria.rest * abs(task.command):
        task = replace(task, criteria=replace(task.criteria, rest=left / abs(task.command)))
        notes.append(f"at rest the output still moves by {left:.3g} {law.gains.input_unit}: the controller's resolution leaves that")
    run = _judge_cycles(frame, task, found.record, system)
    notes += [*_notes_of(run, found.samples), *([found.outside] if found.outside else [])]
    at_limit = float(run.control[-1]) in run.limits
    if law.gains.ki != 0.0 and not at_limit:
        spare = law.dead_zone + law.measurement_step + left
        run = refuse_creep(run, run.target, task.criteria, spare=spare)
    return run, tuple(notes)


def _notes_of(run: LoopRun, samples: Samples) -> list[str]:
    """Say how unlike cycles are, and whether outputs came too late."""
    notes, found = [], run.outcome
    if isinstance(found, LimitCycle):
        spread = max((found.low_spread + found.high_spread) / (found.high - found.low), found.period_spread / found.period)
        if spread > REPEATS[0]:
            notes.append(f"cycles differ from one another by up to {100.0 * spread:.2g} %: samples fall differently into each")
    if samples.overruns:
        notes.append(f"{samples.overruns} outputs were not ready before the next sample; compute faster or sample more slowly")
    return notes


def _judge_cycles(frame: LoopFrame, task: LoopTask, record: LoopRecord, system: DelaySystem) -> LoopRun:
    try:
        return judge_loop(frame, task, record, system)
    except NotSettledError as undecided:
        for repeat in REPEATS:
            wider = replace(task, criteria=replace(task.criteria, repeat=max(repeat, task.criteria.repeat)))
            try:
                return judge_loop(frame, wider, record, system)
            except NotSettledError:
                continue
        raise undecided from None


def _left_by_resolution(law: PidController, task: LoopTask, trace: LoopTrace) -> float:
    """Motion at the end that the controller cannot take away, for it does not see or cannot make smaller ones; 0 where it can."""
    tail = trace.times >= (1.0 - task.criteria.tail) * trace.times[-1]
    output, control = float(np.ptp(trace.output[tail])), float(np.ptp(trace.control[tail]))
    unseen = output <= 2.0 * law.measurement_step
    coarse = law.output_step > 0.0 and control <= 2.0 * law.output_step * (1.0 + 1e-9)
    return output if (unseen or coarse) and output < LARGEST_REST * abs(task.command) else 0.0


def _compare(run: LoopRun, samples: Samples, noisy: _Outcome, disturbance: Disturbance) -> DisturbedRun:
    count = min(run.times.size, noisy.record.trace.times.size)
    trace = noisy.record.trace.first(count)
    return DisturbedRun(
        disturbance=disturbance,
        trace=trace,
        samples=noisy.samples.until(trace.times[-1]),
        deviation=trace.output - run.output[:count],
        travel=noisy.samples.travel,
        quiet_travel=samples.travel,
    )
