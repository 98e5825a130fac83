"""Simulation of any delay system under a sinusoid until its answer repeats itself.

Each sample is compared with the one a period earlier. What still differs, and how fast that shrinks, gives the error that is left;
the run goes on block by block until this is below a tolerance, instead of for a fixed number of cycles.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.threads import Progress
from revline.analysis.trim import Trim
from revline.dde.simulate import Checkpoint, Options, Start, Trajectory, resume, simulate
from revline.errors import AnalysisError, InvalidInputError, NotSettledError, SimulationError, out_of_range
from revline.signals import Signal, sine
from revline.system import DelaySystem, Floats, Variable, check_range, index_of
from revline.values import make_read_only

LAG_SHARE = 0.35
"""Longest step as a part of the shortest lag at rest: the lags shrink during the run, and the step check doubles the step."""

FEWEST_SAMPLES = 128
"""Fewest samples per period; the run of twice the step that checks the step has half as many."""

ENOUGH_SAMPLES = 256
"""Samples per period that are kept at first; more steps are made where a lag asks for them, but not kept."""

FINEST_BLOCK = 32
"""Most blocks into which a period is cut."""

MOST_CYCLES = 16
"""Most periods over which an answer is read."""

MOST_STEPS = 100_000_000
"""Most steps that one frequency may take, about a minute."""

FIRST_STEPS = 0.1 * MOST_STEPS
"""Most steps that a period and the transients together may take."""

TOLERANCE = 1e-6
"""Part of the output's amplitude by which a settled waveform may still change, where none other is asked for."""

ROUNDING = 1e-14
"""What rounding leaves of the difference between two periods, relative to the largest value of the output."""

NO_ANSWER = 1e-12
"""An amplitude below this part of the largest value of the output is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """What is moved, how far, and what is watched.

    Attributes:
        input_name: the input that carries the sinusoid.
        output_name: the output that is read.
        amplitude: of the sinusoid, in the input's unit.

    Raises:
        InvalidInputError: the amplitude is not above 0.
    """

    input_name: str
    output_name: str
    amplitude: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.amplitude) and self.amplitude > 0.0):
            raise out_of_range("sine amplitude", self.amplitude, "in the input's unit", "values above 0", "give how far the input moves")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """How finely and how long to simulate.

    Attributes:
        max_step: longest step in s; shorter ones are taken where a lag or the frequency asks for them.
        tolerance: largest estimated part of the output's amplitude by which its waveform may still change.
        step_tolerance: largest estimated relative error of the fundamental by the step.
        longest: most simulated time in s; without it, 20 periods, 200 times the slowest time constant and 200 times all lags.
        cycles: periods recorded for a spectrum after the answer has settled.

    Raises:
        InvalidInputError: a value is out of range.
    """

    max_step: float = 2e-3
    tolerance: float = TOLERANCE
    step_tolerance: float = 1e-6
    longest: float = math.inf
    cycles: int = 8

    def __post_init__(self) -> None:
        if self.cycles < 1:
            raise out_of_range("cycles", self.cycles, "periods", "1 and above", "give the number of periods in a record")
        for name, value in (("max_step", self.max_step), ("longest", self.longest)):
            if not value > 0.0:
                raise out_of_range(name, value, "s", "values above 0", "give a time in seconds")
        for name, value in (("tolerance", self.tolerance), ("step_tolerance", self.step_tolerance)):
            if not 1e-10 <= value < 1.0:
                raise out_of_range(name, value, "(a part of the amplitude)", "1e-10 to 1", "give a value such as 1e-6")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mesh:
    """Steps of one run: all whole parts of the period.

    Attributes:
        omega: frequency in rad/s.
        count: steps per period.
        every: steps per kept sample.
        block: steps between two looks at what has settled.
        first: steps before the first look, a period or more.
        most: steps after which the run is given up.
        decay: factor by which the slowest mode of the linear model shrinks per period.
    """

    omega: float
    count: int
    every: int
    block: int
    first: int
    most: int
    decay: float

    @property
    def step(self) -> float:
        """Length of a step in s."""
        return 2.0 * math.pi / self.omega / self.count

    @property
    def samples(self) -> int:
        """Kept samples per period."""
        return self.count // self.every

    def coarser(self) -> "Mesh":
        """Twice the step over the same times, half as many samples."""
        halves = {name: getattr(self, name) // 2 for name in ("count", "block", "first", "most")}
        return replace(self, **halves)

    def finer(self) -> "Mesh":
        """Half the step over the same times, twice as many samples."""
        doubled = {name: 2 * getattr(self, name) for name in ("count", "block", "first", "most")}
        return replace(self, **doubled)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodicAnswer:
    """An answer that repeats itself, over the last whole periods simulated.

    Attributes:
        mesh: its steps.
        moved: the input, shape (n_cycles, n_samples), in its unit.
        answered: the output, shape (n_cycles, n_samples), in its unit.
        cycles: periods simulated, those before the last included.
        remaining: estimated part of the output's amplitude by which the waveform would still change.
        checkpoint: from which the run goes on.
    """

    mesh: Mesh
    moved: Floats
    answered: Floats
    cycles: float
    remaining: float
    checkpoint: Checkpoint

    def __post_init__(self) -> None:
        make_read_only(self)


def check_excitation(system: DelaySystem, trim: Trim, excitation: Excitation) -> tuple[Variable, Variable]:
    """Find the input and the output, or refuse them, the amplitude, or the trim.

    Args:
        system: what is simulated.
        trim: where it starts.
        excitation: what is moved and watched.

    Returns:
        The input and the output.

    Raises:
        InvalidInputError: there is no such signal, or the sinusoid leaves the input's range.
        AnalysisError: the trim is unstable, so that no small answer lasts.
    """
    moved = system.inputs[index_of(system.inputs, excitation.input_name)]
    watched = system.outputs[index_of(system.outputs, excitation.output_name)]
    base = trim.input(moved.name)
    for value in (base - excitation.amplitude, base + excitation.amplitude):
        try:
            check_range(moved, value)
        except InvalidInputError as error:
            message = f"a sinusoid of amplitude {excitation.amplitude:g} {moved.unit} about {base:g} {moved.unit} goes too far: {error}"
            raise InvalidInputError(message, amplitude=excitation.amplitude, base=base) from error
    if not trim.stable:
        abscissa = trim.roots.spectral_abscissa
        message = (
            f"{system.name} is not open-loop stable at {moved.name} = {base:g} {moved.unit}: {trim.unstable_count} roots lie right of the "
            f"imaginary axis, the right-most at {abscissa:g} rad/s, so that no sinusoidal answer lasts; choose a stable trim, or simulate "
            "in closed loop"
        )
        raise AnalysisError(message, unstable=trim.unstable_count, abscissa=abscissa)
    return moved, watched


def plan_mesh(omega: float, trim: Trim, settings: RunSettings) -> Mesh:
    """Choose steps that are whole parts of a period, and blocks about as long as the slowest time constant and all lags together.

    Args:
        omega: frequency in rad/s.
        trim: its lags limit the step, its right-most root tells how long transients last.
        settings: longest step and longest run.

    Raises:
        InvalidInputError: the frequency is not above 0, or it needs more steps than can be made.
    """
    if not (math.isfinite(omega) and omega > 0.0):
        raise out_of_range("frequency", omega, "rad/s", "values above 0", "give the frequency in rad/s")
    # Before the lags have passed, an answer may look settled because nothing has arrived yet.
    period, slowest = 2.0 * math.pi / omega, float(np.sum(trim.lags)) - 1.0 / trim.roots.spectral_abscissa
    longest_step = min(settings.max_step, LAG_SHARE * float(np.min(trim.lags, initial=math.inf)))
    if (period + slowest) / min(longest_step, period / FEWEST_SAMPLES) > FIRST_STEPS:
        lowest = 2.0 * math.pi / max(FIRST_STEPS * longest_step - slowest, longest_step)
        highest = 2.0 * math.pi / slowest * (FIRST_STEPS / FEWEST_SAMPLES - 1.0)
        limit = f"{lowest:.3g} to {highest:.3g} rad/s, which steps of at most {longest_step:.3g} s can resolve"
        raise out_of_range("frequency", omega, "rad/s", limit, "choose another, allow a longer step, or take the exact response there")
    needed = period / longest_step
    unit = FEWEST_SAMPLES if needed <= ENOUGH_SAMPLES else ENOUGH_SAMPLES
    count = unit * math.ceil(needed / unit - 1e-9)
    every = 1 if count <= ENOUGH_SAMPLES else count // ENOUGH_SAMPLES
    if period >= slowest:
        parts = 2 ** int(math.log2(period / max(slowest, period / FINEST_BLOCK)))
        block = count // parts
    else:
        block = count * math.ceil(slowest / period)
    first = block * math.ceil(max(1.0, 8.0 * slowest / period) * count / block)
    longest = min(settings.longest, 20.0 * period + 200.0 * slowest)
    most = min(MOST_STEPS, int(longest / period * count))
    decay = math.exp(trim.roots.spectral_abscissa * period)
    return Mesh(omega=omega, count=count, every=every, block=block, first=first, most=most, decay=decay)


@dataclass(frozen=True, slots=True, kw_only=True)
class SettlingWatch:
    """What looks at an output so far have shown, relative to its amplitude.

    Where transients shrink by the factor r per period, a waveform that changes by d per period is off by d / (1 - r) at most. The factor
    is read from two successive looks, and is at least that of the slowest mode known. Because the earlier look may still see a faster
    transient than those left, two estimates in a row must pass.

    Attributes:
        period: samples per period.
        block: samples between two looks.
        tolerance: largest error left of a settled output.
        decay: least factor per period.
        change: largest change per period in the last block.
        remaining: estimated largest error left, by the last look.
        before: the same by the look before.
    """

    period: int
    block: int
    tolerance: float
    decay: float
    change: float = math.inf
    remaining: float = math.inf
    before: float = math.inf

    @property
    def settled(self) -> bool:
        """Whether the last two looks passed."""
        return self.remaining < self.tolerance and self.before < self.tolerance

    def look(self, outputs: Floats) -> "SettlingWatch":
        """Compare the last block with the one a period earlier.

        Args:
            outputs: samples so far, more than a period of them, and as many more as a block has if this is not the first look.
        """
        amplitude = find_amplitude(outputs, self.period)
        compared = min(self.block, outputs.size - self.period)
        change = float(np.max(np.abs(outputs[-compared:] - outputs[-compared - self.period : -self.period]))) / amplitude
        noise = ROUNDING * float(np.max(np.abs(outputs))) / amplitude
        if change <= noise:
            remaining = noise
        elif math.isinf(self.change) or change >= self.change:
            remaining = math.inf
        else:
            remaining = change / (1.0 - max(self.decay, (change / self.change) ** (self.period / self.block)))
        return replace(self, change=change, remaining=remaining, before=self.remaining)


def find_amplitude(outputs: Floats, period: int) -> float:
    """Half of maximum minus minimum of the last period of some samples."""
    return 0.5 * float(np.ptp(outputs[-period:]))


def run_until_periodic(
    system: DelaySystem, trim: Trim, excitation: Excitation, mesh: Mesh, *, tolerance: float = TOLERANCE, progress: Progress | None = None
) -> PeriodicAnswer:
    """Simulate from the trim under a sinusoid until the output repeats itself.

    What is settled is judged block by block by a `SettlingWatch`.

    Args:
        system: what to simulate.
        trim: where to start.
        excitation: what is moved and watched.
        mesh: from `plan_mesh`.
        tolerance: largest error left, as a part of the output's amplitude.
        progress: told from time to time that the run goes on, with the part of its present block that is done; what it raises ends the run.

    Returns:
        The last whole periods, and how far they are settled.

    Raises:
        NotSettledError: the output still changes at the longest time.
        AnalysisError: the output does not answer the input.
        StalledError, LagError, DivergedError: the run ended; the message names the frequency.
    """
    signals = {excitation.input_name: sine(excitation.amplitude, mesh.omega)}
    watch = SettlingWatch(period=mesh.samples, block=mesh.block // mesh.every, tolerance=tolerance, decay=mesh.decay)
    done = mesh.first
    run = _go_on(system, trim, signals, mesh, done, progress)
    outputs, inputs = run.output(excitation.output_name), run.input(excitation.input_name)
    while True:
        if find_amplitude(outputs, mesh.samples) <= NO_ANSWER * float(np.max(np.abs(outputs))):
            raise _no_answer(system, excitation, mesh)
        if done > mesh.count:
            watch = watch.look(outputs)
        if watch.settled:
            break
        if done + mesh.block > mesh.most:
            raise _not_settled(excitation, watch, mesh, done)
        done += mesh.block
        run = _go_on(system, run.checkpoint, signals, mesh, done, progress)
        keep = mesh.samples + max(mesh.samples, mesh.block // mesh.every)
        outputs = np.concatenate([outputs[-keep:], run.output(excitation.output_name)])
        inputs = np.concatenate([inputs[-keep:], run.input(excitation.input_name)])
    cycles = min(MOST_CYCLES, max(1, mesh.block // mesh.count))
    used = cycles * mesh.samples
    return PeriodicAnswer(
        mesh=mesh,
        moved=inputs[-used:].reshape(cycles, mesh.samples),
        answered=outputs[-used:].reshape(cycles, mesh.samples),
        cycles=done / mesh.count,
        remaining=watch.remaining,
        checkpoint=run.checkpoint,
    )


def continue_periodic(
    system: DelaySystem, excitation: Excitation, answer: PeriodicAnswer, *, cycles: int, progress: Progress | None = None
) -> Trajectory:
    """Simulate some periods more after an answer has settled; see `run_until_periodic`.

    Raises:
        StalledError, LagError, DivergedError: the run ended; the message names the frequency.
    """
    signals = {excitation.input_name: sine(excitation.amplitude, answer.mesh.omega)}
    done = round(answer.cycles * answer.mesh.count) + cycles * answer.mesh.count
    return _go_on(system, answer.checkpoint, signals, answer.mesh, done, progress)


def _go_on(
    system: DelaySystem, source: Trim | Checkpoint, signals: dict[str, Signal], mesh: Mesh, done: int, progress: Progress | None
) -> Trajectory:
    # A quarter step short: the run stops at the next grid point, whatever rounding does to the product.
    until = (done - 0.25) * mesh.step
    try:
        if isinstance(source, Checkpoint):
            options = Options(every=source.every, method=source.method, progress=progress)
            return resume(system, signals, source, until=until, options=options)
        start = Start(states=source.states, inputs=source.inputs, channels=source.channels)
        return simulate(system, start, signals, until=until, step=mesh.step, options=Options(every=mesh.every, progress=progress))
    except SimulationError as error:
        message = f"under a sinusoid at {mesh.omega:g} rad/s: {error}"
        raise type(error)(message, **{**error.details, "frequency": mesh.omega}) from error


def _no_answer(system: DelaySystem, excitation: Excitation, mesh: Mesh) -> AnalysisError:
    message = (
        f"output {excitation.output_name} of {system.name} does not answer input {excitation.input_name} at {mesh.omega:g} rad/s; "
        "choose another output, or a larger amplitude"
    )
    return AnalysisError(message, frequency=mesh.omega)


def _not_settled(excitation: Excitation, watch: SettlingWatch, mesh: Mesh, done: int) -> NotSettledError:
    time = done * mesh.step
    message = (
        f"{excitation.output_name} does not repeat itself at {mesh.omega:g} rad/s after {time:g} s ({done / mesh.count:.3g} cycles): "
        f"estimated remaining error {watch.remaining:.3g} of its amplitude (limit {watch.tolerance:g}), change per cycle "
        f"{watch.change:.3g}; allow a longer time, a larger tolerance or a smaller amplitude"
    )
    return NotSettledError(message, frequency=mesh.omega, remaining=watch.remaining, change=watch.change, time=time)
