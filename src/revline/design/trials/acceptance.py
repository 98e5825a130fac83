"""Acceptance of a controller on the nonlinear, sampled, saturated, noisy plant: a battery of runs, a verdict with reasons.

At each operating point the loop is run through a step of its command and then of the load: as it is, with noise and shifted samples, and
with plants whose parameters differ. Then all gains are raised together until the loop hunts: the reserve is measured, not computed.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

from revline.analysis.threads import run_all
from revline.analysis.trim import Trim, find_trim
from revline.design.controllers.pid_controller import Continuous, PidController
from revline.design.controllers.pid_update import sampled_pid
from revline.design.controllers.scheduled_pid import AnyController, law_of
from revline.design.loops.sampled_loop import Disturbance, SampledTask, check_schedule, run_sampled_loop
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, OperatingPoint, operating_point
from revline.design.trials.acceptance_runs import Measures, Probe, measure_run, refuse_probe
from revline.design.trials.gain_reserve import GainReserve, ReserveSearch, find_gain_reserve
from revline.design.trials.linear_place import LinearLoop, find_linear_loop
from revline.errors import InvalidInputError, SimulationError, StepError, out_of_range
from revline.system import DelaySystem
from revline.values import make_read_only

MOST_SAMPLES = 1e6
"""A run with more samples than this would take minutes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirements:
    """What a run must keep to pass.

    Attributes:
        overshoot: largest, as a fraction of the command's step.
        settling_time: longest, after either step, in s.
        band: half width of the settling band: for the command as a fraction of its step, for the load of that or of the deviation that
            it causes, whichever is larger.
        steady_error: largest at the end of each step, as a fraction of the command's step.
        droop: largest deviation after the step of the load, in the measurement's unit.
        gain_reserve_db: least factor to the onset of hunting, in dB.

    Raises:
        InvalidInputError: a requirement is no positive number, or the gain reserve no finite one.
    """

    overshoot: float = 0.3
    settling_time: float = 3.0
    band: float = 0.05
    steady_error: float = 0.02
    droop: float = math.inf
    gain_reserve_db: float = 3.0

    def __post_init__(self) -> None:
        for name, unit in (
            ("overshoot", "of the command"),
            ("settling_time", "s"),
            ("band", ""),
            ("steady_error", "of the command"),
            ("droop", ""),
        ):
            value = getattr(self, name)
            if not value > 0.0:
                raise out_of_range(f"required {name.replace('_', ' ')}", value, unit, "the positive numbers", "give one")
        if not (math.isfinite(self.gain_reserve_db) and self.gain_reserve_db >= 0.0):
            raise out_of_range("required gain reserve", self.gain_reserve_db, "dB", "0 and above", "give one, 0 for none")


class OfUnstable(Enum):
    """What happens at a place where the exact linear loop, as the samples see it, is unstable."""

    SKIP = "skip"
    """It fails with the margin that it lacks, and is not run."""
    RUN = "run"


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """What a controller goes through at each operating point.

    Attributes:
        command: size of the command's step, in the measurement's unit; it is run up and down.
        load: size of the load's step, in the load's unit; likewise.
        load_input: name of the input that the load acts on.
        until: length of each run, in s; the load steps at half of it.
        step: of the simulation, in s.
        disturbance: noise and jitter of the disturbed runs; each run has a seed of its own, counted from this one's.
        requirements: what each run must keep.
        of_unstable: what happens where the linear loop is unstable.
    """

    command: float = 10.0
    load: float = 5.0
    load_input: str = "load_torque"
    until: float = 10.0
    step: float = 1e-3
    disturbance: Disturbance = field(default_factory=lambda: Disturbance(noise=0.3, jitter=1e-4))
    requirements: Requirements = field(default_factory=Requirements)
    of_unstable: OfUnstable = OfUnstable.SKIP

    def __post_init__(self) -> None:
        refuse_probe(self.command, self.load, self.until)


class Kind(Enum):
    """What a run of the battery is like."""

    CLEAN = "clean"
    NOISY = "noisy"
    SPREAD = "spread"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One run of the battery.

    Attributes:
        place: inputs at the trim, by name.
        kind: as it is, disturbed, or disturbed on a plant with other parameters.
        plant: name of the plant.
        command: size of the command's step.
        load: size of the load's step.
        seed: of the noise.
    """

    place: Mapping[str, float]
    kind: Kind
    plant: str
    command: float
    load: float
    seed: int

    @property
    def text(self) -> str:
        """The case in words."""
        place = ", ".join(f"{name} {value:g}" for name, value in self.place.items())
        return f"{place}: {self.kind.value}, {self.plant}, command {self.command:+g}, load {self.load:+g}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AcceptanceRun:
    """How one run of the battery went.

    Attributes:
        case: which one.
        measures: what was measured; none where the run ended before its time.
        ended: why it ended before its time; empty where it did not.
        reasons: what it did not keep, in words; nothing where it passes.
    """

    case: Case
    measures: Measures | None
    ended: str
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether it kept all that is required."""
        return not self.reasons


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Acceptance:
    """The verdict on a controller, with all runs and reserves that it rests on.

    Attributes:
        controller: what was judged.
        battery: what it went through.
        runs: in the order of places, kinds and signs.
        reserves: of each place that was run, in their order.
        linear: the linear loop at each place, in their order.
        reasons: all that was not kept, each with its case; nothing where the controller passes.
    """

    controller: AnyController
    battery: Battery
    runs: tuple[AcceptanceRun, ...]
    reserves: tuple[GainReserve, ...]
    linear: tuple[LinearLoop, ...]
    reasons: tuple[str, ...]

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def passed(self) -> bool:
        """Whether every run and every reserve is as required."""
        return not self.reasons

    @property
    def gain_reserve_db(self) -> float:
        """Least reserve of all places that were run, in dB: a lower bound where no hunting was found.

        Raises:
            InvalidInputError: no place was run: the linear loop is unstable at all.
        """
        if not self.reserves:
            message = "no place was run, for the linear loop is unstable at all; have unstable loops run to measure their reserve"
            raise InvalidInputError(message)
        return min(reserve.decibels for reserve in self.reserves)


def accept(
    plants: Mapping[str, DelaySystem],
    controller: AnyController,
    places: Sequence[Mapping[str, float]],
    battery: Battery | None = None,
    *,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    workers: int = 2,
    progress: Callable[[float], None] | None = None,
) -> Acceptance:
    """Put a controller through a battery of runs at some operating points, and judge it.

    Args:
        plants: nonlinear, with their delays, by a name for people: first the plant itself, then the same with other parameters.
        controller: fixed-rate or crank-synchronous.
        places: inputs at each trim, by name, for example {"throttle": 25.0, "load_torque": 10.0}.
        battery: what it goes through.
        wires: which signals close the loop.
        workers: threads.
        progress: told which part of the runs is done.

    Raises:
        InvalidInputError: there is no place, or one twice, the controller is continuous, its limits exclude a trim, or it is scheduled
            over signals that it does not read from the plant.
        NoTrimError: there is no trim at a place.
        NotConvergedError: a loop moves so slowly that no run tells its reserve.
        StepError: the battery's step is longer than a lag that a run comes to.
    """
    battery = battery or Battery()
    if not places or not plants:
        message = "a controller is accepted on one plant and at one operating point at least; give the plant and the inputs of a trim"
        raise InvalidInputError(message)
    twice = next((place for k, place in enumerate(places) if place in places[:k]), None)
    if twice is not None:
        words = ", ".join(f"{name} = {value:g}" for name, value in twice.items())
        message = f"operating point {words} is given twice, and would count twice in the verdict; give each once"
        raise InvalidInputError(message)
    (nominal, plant), names = next(iter(plants.items())), tuple(plants)
    check_schedule(plant, controller, wires)
    trims = {(name, k): find_trim(each, inputs=dict(place)) for name, each in plants.items() for k, place in enumerate(places)}
    points = {key: operating_point(trim, wires) for key, trim in trims.items()}
    for trim in trims.values():  # what the controller cannot do at all is refused before anything is computed
        _check_controller(law_of(controller), trim, battery, wires)
    linear = tuple(find_linear_loop(plant, trims[nominal, k], controller, place, wires) for k, place in enumerate(places))
    skipped = {k for k, loop in enumerate(linear) if loop.verdict and battery.of_unstable is OfUnstable.SKIP}
    tasks: list[tuple[int, Case | None]] = []
    for k, place in enumerate(places):
        if k not in skipped:
            tasks += [(k, case) for case in _cases(place, battery, names, seed=battery.disturbance.seed + 1000 * k)]
            tasks.append((k, None))

    def work(task: tuple[int, Case | None], go_on: Callable[[float], None]) -> AcceptanceRun | GainReserve:
        k, case = task
        if case is None:
            search = ReserveSearch(command=battery.command, until=battery.until, step=battery.step, near=linear[k].gain_margin)
            return find_gain_reserve(plant, points[nominal, k], controller, search, place=places[k], wires=wires, progress=go_on)
        return _run(plants[case.plant], points[case.plant, k], controller, case, battery, wires)

    found = run_all(work, tasks, lambda task: 10.0 if task[1] is None else 1.0, workers=workers, progress=progress)
    runs = tuple(one for one in found if isinstance(one, AcceptanceRun))
    reserves = tuple(one for one in found if isinstance(one, GainReserve))
    reasons = [loop.verdict for loop in linear if loop.verdict]
    reasons += [f"{run.case.text}: {reason}" for run in runs for reason in run.reasons]
    reasons += [text for reserve in reserves for text in _judge_reserve(reserve, battery.requirements)]
    return Acceptance(controller=controller, battery=battery, runs=runs, reserves=reserves, linear=linear, reasons=tuple(reasons))


def _check_controller(controller: PidController, trim: Trim, battery: Battery, wires: LoopSignals) -> None:
    """Refuse a controller that is continuous, cannot rest at a trim, or samples too often to be run.

    Raises:
        InvalidInputError: it is so.
    """
    measurement = trim.output(wires.measurement)
    sampled_pid(controller, output=trim.input(wires.drive), measurement=measurement)
    sampling = controller.sampling
    if not isinstance(sampling, Continuous) and battery.until / sampling.period_at(measurement) > MOST_SAMPLES:
        limit = f"{battery.until / MOST_SAMPLES:.3g} s and above for runs of {battery.until:g} s"
        raise out_of_range("sampling period", sampling.period_at(measurement), "s", limit, "sample more slowly, or run it shorter")


def _cases(place: Mapping[str, float], battery: Battery, plants: Sequence[str], *, seed: int) -> list[Case]:
    """Up and down as it is, up and down with noise, and each variant with noise, up and down by turns."""
    signs = (1.0, -1.0)
    plan = [(kind, plants[0], sign) for kind in (Kind.CLEAN, Kind.NOISY) for sign in signs]
    plan += [(Kind.SPREAD, name, signs[k % 2]) for k, name in enumerate(plants[1:])]
    return [
        Case(place=place, kind=kind, plant=name, command=sign * battery.command, load=sign * battery.load, seed=seed + k)
        for k, (kind, name, sign) in enumerate(plan)
    ]


def _run(
    plant: DelaySystem, point: OperatingPoint, controller: AnyController, case: Case, battery: Battery, wires: LoopSignals
) -> AcceptanceRun:
    probe = Probe(command=case.command, load=case.load, until=battery.until)
    quiet = case.kind is Kind.CLEAN
    own = battery.disturbance
    disturbance = Disturbance() if quiet else Disturbance(noise=own.noise, jitter=own.jitter, seed=case.seed)
    task = SampledTask(
        command=probe.command_signal,
        until=battery.until,
        step=battery.step,
        disturbance=disturbance,
        loads={battery.load_input: probe.load_signal},
    )
    try:
        run = run_sampled_loop(plant, point, controller, task, wires=wires)
    except StepError:  # the battery's fault, not the controller's
        raise
    except SimulationError as error:
        return AcceptanceRun(case=case, measures=None, ended=str(error), reasons=(f"ends before its time: {error}",))
    wish = battery.requirements
    measures = measure_run(run, probe, band=wish.band, noise=disturbance.noise)
    return AcceptanceRun(case=case, measures=measures, ended="", reasons=_judge(measures, wish, case))


def _judge(measures: Measures, wish: Requirements, case: Case) -> tuple[str, ...]:
    """Say what a run did not keep."""
    step = abs(case.command)
    found = []
    if measures.overshoot > wish.overshoot:
        found.append(f"overshoot {measures.overshoot:.3g} of the command, above {wish.overshoot:g}")
    for name, value in (("command", measures.command_settling_time), ("load", measures.load_settling_time)):
        if not value <= wish.settling_time:
            after = f"only after {value:.3g} s" if math.isfinite(value) else "not within the run"
            found.append(f"settles {after} of the {name}'s step, and {wish.settling_time:g} s are allowed")
    for name, value in (("command", measures.command_error), ("load", measures.load_error)):
        if abs(value) > wish.steady_error * step + measures.uncertain:
            found.append(f"rests {value:+.3g} off its target after the {name}'s step, more than {wish.steady_error * step:.3g}")
    if measures.overruns:
        found.append(f"{measures.overruns} outputs were not ready before the next sample: compute faster, or sample at a larger angle")
    if measures.droop > wish.droop:
        found.append(f"the load's step moves it by {measures.droop:.3g}, more than {wish.droop:g}")
    return tuple(found)


def _judge_reserve(reserve: GainReserve, wish: Requirements) -> tuple[str, ...]:
    if reserve.decibels >= wish.gain_reserve_db:
        return ()
    place = ", ".join(f"{name} {value:g}" for name, value in reserve.place.items())
    rests = f"rests at {reserve.factor:.3g} times its gains" if reserve.factor > 0.0 else "rests at none of its gains' multiples tried"
    does = f"{reserve.ending.value} at {reserve.hunts:.3g} times" if math.isfinite(reserve.hunts) else "was not raised further"
    return (f"{place}: {rests} and {does}, a reserve of {reserve.decibels:.2f} dB, below {wish.gain_reserve_db:g}",)
