"""The limit cycle that a closed loop ends in, computed as an orbit and held against the simulation that led there.

The last period of the simulation starts harmonic balance with unknown frequency; the cycle is then found again on elements that meet its
kinks, with its Floquet multipliers. A simulation cannot end in an unstable cycle, and must show the same extremes and period.
"""

from dataclasses import dataclass, replace

import numpy as np

from revline import signals
from revline.analysis.harmonic_balance import BalanceSettings
from revline.analysis.kinked_cycles import KinkedCycle, find_kinked_cycle
from revline.analysis.limit_cycles import CycleGuess, find_cycle
from revline.dde.simulate import Options, Start, simulate
from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits, LoopRun, LoopTask, close_loop, run_loop
from revline.design.loops.outcome import LimitCycle
from revline.design.loops.ray_loop import close_ray
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals, OperatingPoint
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError, NotSettledError, out_of_range
from revline.system import DelaySystem, Floats, index_of
from revline.values import make_read_only

AGREEMENT = 2e-3
"""Largest disagreement with the simulation, as a part of the swing and of the period: cycles that repeat within half of it are one."""

LONGER = 16.0
"""A record that does not decide how a loop ends is made up to this many times as long."""

LISTED_HARMONICS = 8
"""Highest harmonic that a result lists."""

BALANCE = "harmonic balance with unknown frequency"
SIMULATION = "the simulation's last period"
"""What a cycle on elements was found from."""

START_SETTINGS = BalanceSettings(tolerance=1e-7, most_harmonics=64)
"""Harmonic balance is the start of a finer computation: an orbit with kinks would need many more harmonics."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HuntingOrbit:
    """The cycle that a closed loop hunts in, with its evidence.

    Attributes:
        plant: name of the plant.
        gains: of the controller.
        command: size of the step, in the measurement's unit.
        low, high: of the measurement over the cycle.
        control_low, control_high: of what the controller drives.
        harmonics: amplitudes of the measurement's harmonics 1 to 8.
        mean: of the measurement.
        start: what the cycle was found from, in words.
        cycle: as it is found on elements that meet its kinks, with multipliers and estimated errors.
        residual: by how much it misses its equations between its nodes, as a part of the largest rate.
        at_low, at_high: whether the controller's lower and upper limits are touched.
        simulated: what the simulation showed.
        gap: largest disagreement of the two, as a part of the swing or of the period.
        tolerance: largest one that is accepted.
    """

    plant: str
    gains: PidGains
    command: float
    low: float
    high: float
    control_low: float
    control_high: float
    harmonics: Floats
    mean: float
    start: str
    cycle: KinkedCycle
    residual: float
    at_low: bool
    at_high: bool
    simulated: LimitCycle
    gap: float
    tolerance: float = AGREEMENT

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def period(self) -> float:
        """In s."""
        return self.cycle.period

    def wave(self, output: str, samples: int = 256) -> Floats:
        """One of the loop's outputs over the period, at equal distances from its start.

        Raises:
            InvalidInputError: the loop has no such output.
        """
        return self.cycle.output(index_of(self.cycle.system.outputs, output), np.arange(samples) / samples)

    @property
    def amplitude(self) -> float:
        """Half of the distance from low to high."""
        return (self.high - self.low) / 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnrefinedCycle:
    """A limit cycle that is known from the simulation only: its multipliers are not known.

    Attributes:
        simulated: what the simulation showed, with the spread of its cycles.
        reason: why the orbit could not be computed.
    """

    simulated: LimitCycle
    reason: str


def refine_cycle(
    plant: DelaySystem, point: OperatingPoint, run: LoopRun, *, wires: LoopSignals = SPEED_BY_THROTTLE, tolerance: float = 1e-6
) -> HuntingOrbit | UnrefinedCycle:
    """Compute the limit cycle that a run ends in as `confirm_cycle` does; where none is found, give the simulated one with the reason.

    That the simulation repeats itself for many cycles shows that they attract what is near them; how fast is not known then.

    Raises:
        InvalidInputError: as for `confirm_cycle`.
        AnalysisError: as for `confirm_cycle`: an orbit was found, and it is not the simulated one.
    """
    try:
        return confirm_cycle(plant, point, run, wires=wires, tolerance=tolerance)
    except NotConvergedError as error:
        return UnrefinedCycle(simulated=_outcome(run), reason=str(error))


def run_to_its_end(
    plant: DelaySystem,
    point: OperatingPoint,
    gains: PidGains,
    task: LoopTask,
    *,
    wires: LoopSignals = SPEED_BY_THROTTLE,
    limits: Limits = Limits(),  # noqa: B008 - an immutable tuple
) -> LoopRun:
    """Run a closed loop as `run_loop` does, longer where the record does not decide how it ends.

    Raises:
        InvalidInputError: as for `run_loop`.
        NotSettledError: a record 16 times as long does not decide either.
        SimulationError: as for `run_loop`.
    """
    until, most = task.until, LONGER * task.until
    while True:
        try:
            return run_loop(plant, point, gains, replace(task, until=until), wires=wires, limits=limits)
        except NotSettledError as error:
            if until >= most:
                raise
            until = min(most, max(2.0 * until, float(error.details.get("needed", 0.0))))


def confirm_cycle(
    plant: DelaySystem, point: OperatingPoint, run: LoopRun, *, wires: LoopSignals = SPEED_BY_THROTTLE, tolerance: float = 1e-6
) -> HuntingOrbit:
    """Compute the limit cycle that a run of a closed loop ends in, judge its stability, and hold it against the run.

    Args:
        plant: around which the loop was closed.
        point: of rest that it started from.
        run: from `run_loop`; it hunts.
        wires: which signals close the loop.
        tolerance: largest estimated error of period, extremes and leading multiplier.

    Raises:
        InvalidInputError: the run does not hunt, or the tolerance is out of range.
        NotConvergedError: no cycle is found from the run, or it is not resolved.
        AnalysisError: cycle and run disagree: in extremes, period, or in that the cycle repels what is near it.
    """
    _outcome(run)
    if not 1e-10 <= tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "", "1e-10 to 1", "give a value such as 1e-6")
    loop = close_ray(plant, point, run.gains, wires=wires, limits=run.limits)
    inputs = loop_inputs(plant, point, wires, command=run.target, factor=1.0)
    guess, start = _guess(plant, point, run, wires), SIMULATION
    try:
        guess, start = find_cycle(loop, inputs, guess, settings=START_SETTINGS).as_guess(), BALANCE
    except NotConvergedError:  # a cycle of jumps and slow parts has too many harmonics; its simulation is a start for elements too
        guess = _guess(plant, point, run, wires, samples=1025)
    cycle = find_kinked_cycle(loop, inputs, guess, tolerance=tolerance)
    return _agree(_describe(run, loop, cycle, wires, start))


def loop_inputs(plant: DelaySystem, point: OperatingPoint, wires: LoopSignals, *, command: float, factor: float) -> Floats:
    """Constant inputs of a loop from `close_ray`: those of the plant that the controller does not drive, the command and the factor."""
    held = [point.inputs[v.name] for v in plant.inputs if v.name != wires.drive]
    return np.array([*held, command, factor])


def _guess(plant: DelaySystem, point: OperatingPoint, run: LoopRun, wires: LoopSignals, *, samples: int = 65) -> CycleGuess:
    """Simulate the run again, and take all states of its last period."""
    loop = close_loop(plant, point, run.gains, wires=wires, limits=run.limits)
    held = {name: value for name, value in point.inputs.items() if name != wires.drive}
    start = Start(states=np.append(point.states, 0.0), inputs=loop.input_vector({**held, loop.inputs[-1].name: point.measurement}))
    drive = {loop.inputs[-1].name: signals.step(run.command)}
    every = max(1, round(float(run.times[1] - run.times[0]) / run.step))
    again = simulate(loop, start, drive, until=float(run.times[-1]), step=run.step, options=Options(every=every))
    states = again.states if run.gains.ki else again.states[:, :-1]
    return CycleGuess.from_run(again.times, states, _outcome(run).period, samples)


def _outcome(run: LoopRun) -> LimitCycle:
    if not isinstance(run.outcome, LimitCycle):
        message = f"the run ends {run.outcome.name}: there is no limit cycle to confirm; give a run that hunts"
        raise InvalidInputError(message, outcome=run.outcome.name)
    return run.outcome


def _describe(run: LoopRun, loop: DelaySystem, cycle: KinkedCycle, wires: LoopSignals, start: str) -> HuntingOrbit:
    measured, control = index_of(loop.outputs, wires.measurement), index_of(loop.outputs, "control")
    (low, high), (control_low, control_high) = cycle.extremes(measured), cycle.extremes(control)
    samples = cycle.output(measured, np.arange(1024) / 1024)
    waves = np.fft.rfft(samples) / 1024
    simulated = _outcome(run)
    swing = high - low
    gaps = (abs(low - simulated.low) / swing, abs(high - simulated.high) / swing, abs(cycle.period / simulated.period - 1.0))
    return HuntingOrbit(
        plant=run.plant,
        gains=run.gains,
        command=run.command,
        low=low,
        high=high,
        control_low=control_low,
        control_high=control_high,
        harmonics=2.0 * np.abs(waves[1 : LISTED_HARMONICS + 1]),
        mean=float(waves[0].real),
        start=start,
        cycle=cycle,
        residual=cycle.residual(),
        at_low=control_low <= run.limits.low,
        at_high=control_high >= run.limits.high,
        simulated=simulated,
        gap=max(gaps),
    )


def _agree(orbit: HuntingOrbit) -> HuntingOrbit:
    """Refuse an orbit that is not what the simulation ends in.

    Raises:
        AnalysisError: it is not; with the numbers of both.
    """
    unit, seen, cycle = orbit.gains.input_unit, orbit.simulated, orbit.cycle
    if orbit.gap > orbit.tolerance:
        message = (
            f"the limit cycle computed, {orbit.low:.6g} to {orbit.high:.6g} {unit} in {orbit.period:.6g} s, and the simulated one, "
            f"{seen.low:.6g} to {seen.high:.6g} {unit} in {seen.period:.6g} s, disagree by {orbit.gap:.2g} (limit {orbit.tolerance:g}); "
            "simulate longer and with a smaller step"
        )
        raise AnalysisError(message, gap=orbit.gap)
    if cycle.certain and not cycle.stable:
        message = (
            f"the simulation ends in a cycle of {orbit.period:.6g} s that repels what is near it: its largest multiplier is "
            f"{cycle.largest:.6g} +- {cycle.multiplier_error:.1g}; simulate much longer, it will leave it"
        )
        raise AnalysisError(message, multiplier=cycle.largest)
    return orbit
