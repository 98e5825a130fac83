"""Three independent routes to a frequency response, each checked against the next: derivatives, harmonic balance, and simulation.

The exact small-signal response comes from derivatives of the equations at the operating point, with the delays as exp(-s lag). Harmonic
balance solves the nonlinear equations on whole orbits; at vanishing amplitude it must give the same. At the amplitude asked for it must
give what simulated sinusoids settle at. The linear model is where harmonic balance starts, but an orbit counts only once it fulfils the
nonlinear equations, so that a wrong linear model shows here instead of carrying over.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.balance_attempts import PartialBalance, attempt_balance
from revline.analysis.harmonic_balance import BalanceSettings, HarmonicBalance
from revline.analysis.linearize import linearize
from revline.analysis.periodic import Excitation, RunSettings
from revline.analysis.routes import BALANCE, EXACT, SIMULATION, VANISHING, ResponseDifference, RouteComparison, Unchecked
from revline.analysis.sinestream import MissingAnswer, Sinestream, find_sinestream
from revline.analysis.threads import Progress
from revline.analysis.trim import Trim
from revline.analysis.vanishing_amplitude import VanishingAmplitude, extrapolate_to_rest
from revline.errors import AnalysisError, InvalidInputError, out_of_range
from revline.lti.response import Complexes, FrequencyResponse, check_frequencies
from revline.system import DelaySystem, Floats, Variable

FLOOR = 1e-8
"""Relative difference that is always allowed: what error estimates do not count, such as rounding in the equations."""

SAFETY = 3.0
"""By this the estimated errors of harmonic balance and simulation are multiplied: each rests on one doubling or halving, and may be low by
chance where an orbit meets a limit."""

LOOSEST = 0.01
"""A tolerance above this proves nothing: the frequency counts as not checked."""

WORST_SHARE = 4.0 / np.pi
"""Largest error of a fundamental by an error of 1 of a waveform: that of a square wave."""

CLEAR = 30.0
"""By this many tolerances a difference must stand out for the power by which it falls to be told."""

SMALL_SIGNAL = (EXACT, VANISHING)
LARGE_SIGNAL = (BALANCE, SIMULATION)

PROBES = (0.3819660112501051, 0.6180339887498949)
"""Parts of the lowest frequency at which the small-signal routes are compared too: a lag of whole periods at one frequency shows there."""

SETTINGS = BalanceSettings(most_harmonics=64)
"""Of the harmonic balance that a simulation is compared with; twice as many would take eight times as long where an orbit meets a limit."""

NOT_GIVEN = "there is no harmonic balance at this frequency"

SMALL_MEANING = (
    "a derivative, a delay or a channel of the linear model is not what the equations say: an equation uses what complex steps do not "
    "differentiate, the operating point lies at a kink, or this package is at fault"
)
LARGE_MEANING = (
    "the system may have several periodic answers under this sinusoid; else one of the two routes is at fault, or their error estimates are"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CrossCheck:
    """What the routes to one frequency response say of each other.

    Attributes:
        system: its name.
        excitation: what is moved, how far, and what is watched.
        moved, watched: the input and the output.
        vanishing: harmonic balance extrapolated to vanishing amplitude.
        comparisons: all pairs of routes that were compared.
        unchecked: what could not be compared.
    """

    system: str
    excitation: Excitation
    moved: Variable
    watched: Variable
    vanishing: VanishingAmplitude
    comparisons: tuple[RouteComparison, ...]
    unchecked: tuple[Unchecked, ...]

    @property
    def agreed(self) -> bool:
        """Whether all routes that were compared agree."""
        return all(comparison.agreed for comparison in self.comparisons)

    def comparison(self, routes: tuple[str, str]) -> RouteComparison:
        """Give the comparison of two routes.

        Raises:
            InvalidInputError: they were not compared.
        """
        for comparison in self.comparisons:
            if comparison.difference.routes == routes:
                return comparison
        message = f"{routes[0]} and {routes[1]} were not compared; ask for their check, and see what was left unchecked"
        raise InvalidInputError(message)

    @property
    def falls_by(self) -> Floats:
        """Power of the amplitude by which the distance of harmonic balance from the exact response falls: two for a smooth system.

        One value for each frequency compared at which the distance at the smallest amplitude is at least thirty times the tolerance.
        """
        found = [c for c in self.comparisons if c.difference.routes == SMALL_SIGNAL]
        if not found:
            return np.empty(0)
        kept = np.isin(self.vanishing.omega, found[0].difference.omega)
        large, _, small = np.abs(self.vanishing.balanced[:, kept] / found[0].difference.first - 1.0)
        clear = small > CLEAR * found[0].tolerance
        power: Floats = 0.5 * np.log2(large[clear] / small[clear])
        return power

    def require_agreement(self) -> None:
        """Raise where routes disagree.

        Raises:
            AnalysisError: names the routes, the worst frequency, both values, the difference and the tolerance, and what it may mean.
        """
        for comparison in self.comparisons:
            if not comparison.agreed:
                raise describe_disagreement(comparison, self)


def cross_check(
    system: DelaySystem,
    trim: Trim,
    excitation: Excitation,
    frequencies: ArrayLike,
    *,
    settings: RunSettings | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> CrossCheck:
    """Find a frequency response by all three routes, and see that they agree.

    Args:
        system: any system with delay channels.
        trim: a stable steady state.
        excitation: what is moved, how far, and what is watched.
        frequencies: in rad/s, above 0, strictly rising.
        settings: of the simulation.
        workers: threads of the simulation.
        progress: told which part of the simulated frequencies is done.

    Returns:
        All differences with their tolerances, and what could not be compared.

    Raises:
        AnalysisError: two routes disagree; or the simulation could not be completed.
        InvalidInputError: a name or a frequency cannot be used.
    """
    omega = _usable(frequencies)
    stream = find_sinestream(system, trim, excitation, omega, settings=settings, workers=workers, progress=progress)
    exact = linearize(system, trim).model.response(omega, excitation.input_name, excitation.output_name)
    found = compare_routes(system, trim, excitation, exact, stream=stream)
    found.require_agreement()
    return found


def compare_routes(
    system: DelaySystem,
    trim: Trim,
    excitation: Excitation,
    exact: FrequencyResponse,
    *,
    balance: HarmonicBalance | None = None,
    stream: Sinestream | None = None,
    progress: Progress | None = None,
) -> CrossCheck:
    """Compare routes to a frequency response, without raising where they disagree.

    Args:
        system: any system with delay channels.
        trim: a steady state.
        excitation: what is moved, how far, and what is watched.
        exact: the small-signal response, compared with harmonic balance at vanishing amplitude.
        balance: harmonic balance at the excitation's amplitude; computed where it is not given and a simulation is.
        stream: a simulated response, compared with harmonic balance at the excitation's amplitude; without it that is left out.
        progress: told which part of the harmonic balance is done.

    Returns:
        All differences with their tolerances, and what could not be compared.

    Raises:
        InvalidInputError: a name or a frequency cannot be used.
    """
    omega = _usable(exact.omega)
    probes = np.array([part * omega[0] for part in PROBES])
    names = (excitation.input_name, excitation.output_name)
    more = linearize(system, trim).model.response(probes, *names)
    vanishing, left = _extrapolated(system, trim, excitation, np.concatenate((probes, omega)))
    compared, doubtful = _compare_small(vanishing, np.concatenate((more.values, exact.values)), np.concatenate((probes, omega)))
    comparisons, unchecked = [*compared], [*left, *doubtful]
    if stream is not None:
        missing: tuple[MissingAnswer, ...] = ()
        if balance is None:
            balance, missing = _balance_at(system, trim, stream, progress)
        compared, doubtful = _compare_large(stream, balance, missing)
        comparisons += compared
        unchecked += doubtful
    return CrossCheck(
        system=system.name,
        excitation=excitation,
        moved=_named(system.inputs, names[0]),
        watched=_named(system.outputs, names[1]),
        vanishing=vanishing,
        comparisons=tuple(comparisons),
        unchecked=tuple(unchecked),
    )


def describe_disagreement(comparison: RouteComparison, check: CrossCheck) -> AnalysisError:
    """Build the error of two routes that disagree.

    Args:
        comparison: of the routes.
        check: to which it belongs.
    """
    difference, k = comparison.difference, comparison.worst
    count, total = int(np.sum(comparison.disagreeing)), difference.omega.size
    unit = f"{check.watched.unit} per {check.moved.unit}"
    values = [f"{abs(v[k]):.9g} {unit} at {np.degrees(np.angle(v[k])):.6f} deg" for v in (difference.first, difference.second)]
    magnitude, phase = float(difference.magnitude[k]), float(difference.phase_deg[k])
    tolerance, tolerance_deg = float(comparison.tolerance[k]), float(comparison.tolerance_deg[k])
    message = (
        f"cross-check failed at {count} of {total} frequencies: {check.watched.name} of {check.system} answers {check.moved.name} at "
        f"{difference.omega[k]:.6g} rad/s with {values[0]} by {difference.routes[0]}, but {values[1]} by {difference.routes[1]}: "
        f"{magnitude:.3g} of the magnitude and {phase:.3g} deg apart, where {tolerance:.3g} and {tolerance_deg:.3g} deg are allowed; "
        f"{SMALL_MEANING if difference.routes == SMALL_SIGNAL else LARGE_MEANING}"
    )
    return AnalysisError(
        message,
        routes=" / ".join(difference.routes),
        frequency=float(difference.omega[k]),
        first_magnitude=float(abs(difference.first[k])),
        second_magnitude=float(abs(difference.second[k])),
        first_phase_deg=float(np.degrees(np.angle(difference.first[k]))),
        second_phase_deg=float(np.degrees(np.angle(difference.second[k]))),
        magnitude_difference=magnitude,
        phase_difference_deg=phase,
        tolerance=tolerance,
        disagreeing=float(count),
    )


def _usable(frequencies: ArrayLike) -> Floats:
    omega = check_frequencies(frequencies)
    if omega[0] == 0.0:
        raise out_of_range("frequency", 0.0, "rad/s", "values above 0", "no sinusoid can be compared there")
    return omega


def _named(variables: Iterable[Variable], name: str) -> Variable:
    return next(variable for variable in variables if variable.name == name)


def _extrapolated(
    system: DelaySystem, trim: Trim, excitation: Excitation, omega: Floats
) -> tuple[VanishingAmplitude, tuple[Unchecked, ...]]:
    try:
        found = extrapolate_to_rest(system, trim, excitation, omega)
    except AnalysisError as error:
        none = VanishingAmplitude(
            omega=np.empty(0),
            amplitudes=np.empty((3, 0)),
            balanced=np.empty((3, 0), dtype=complex),
            values=np.empty(0, dtype=complex),
            error=np.empty(0),
            missing=tuple(MissingAnswer(float(w), str(error)) for w in omega),
        )
        return none, _group(SMALL_SIGNAL, none.missing)
    return found, _group(SMALL_SIGNAL, found.missing)


def _compare_small(
    vanishing: VanishingAmplitude, exact: Complexes, omega: Floats
) -> tuple[tuple[RouteComparison, ...], tuple[Unchecked, ...]]:
    """Compare the exact response where there is an extrapolation."""
    if not vanishing.omega.size:
        return (), ()
    comparison = RouteComparison(
        difference=ResponseDifference(
            routes=SMALL_SIGNAL, omega=vanishing.omega, first=exact[np.isin(omega, vanishing.omega)], second=vanishing.values
        ),
        tolerance=vanishing.error + FLOOR,
        amplitude=vanishing.amplitudes[0],
    )
    return _split(comparison)


def _balance_at(
    system: DelaySystem, trim: Trim, stream: Sinestream, progress: Progress | None
) -> tuple[HarmonicBalance | None, tuple[MissingAnswer, ...]]:
    """Balance harmonics at a simulation's frequencies, as far as that can be done."""
    try:
        found = attempt_balance(system, trim, stream.excitation, stream.omega, settings=SETTINGS, progress=progress)
    except AnalysisError as error:
        return None, tuple(MissingAnswer(float(w), str(error)) for w in stream.omega)
    return (found.finished, found.missing) if isinstance(found, PartialBalance) else (found, ())


def _compare_large(
    stream: Sinestream, balance: HarmonicBalance | None, missing: tuple[MissingAnswer, ...]
) -> tuple[tuple[RouteComparison, ...], tuple[Unchecked, ...]]:
    """Compare a simulated response with harmonic balance at its frequencies."""
    reasons = {entry.omega: entry.reason for entry in missing}
    places = {} if balance is None else {float(w): k for k, w in enumerate(balance.omega)}
    left = [MissingAnswer(w, reasons.get(w, NOT_GIVEN)) for w in stream.omega.tolist() if w not in places]
    both = [(k, places[w]) for k, w in enumerate(stream.omega.tolist()) if w in places]
    if balance is None or not both:
        return (), _group(LARGE_SIGNAL, left)
    here, there = (np.array(positions) for positions in zip(*both, strict=True))
    estimated = balance.error[there] + balance.last_step[there] + simulation_error(stream)[here]
    comparison = RouteComparison(
        difference=ResponseDifference(
            routes=LARGE_SIGNAL,
            omega=stream.omega[here],
            first=balance.fundamental.values[there],
            second=stream.fourier.values[here],
        ),
        tolerance=SAFETY * estimated + FLOOR,
        amplitude=np.full(here.size, stream.excitation.amplitude),
    )
    compared, doubtful = _split(comparison)
    return compared, (*_group(LARGE_SIGNAL, left), *doubtful)


def simulation_error(stream: Sinestream) -> Floats:
    """Estimated relative error of simulated fundamentals: by what had not settled, and by the step.

    Args:
        stream: the simulated response.
    """
    peaks = stream.peak_amplitude / stream.amplitude
    error: Floats = WORST_SHARE * stream.remaining * peaks + stream.step_error
    return error


def _split(comparison: RouteComparison) -> tuple[tuple[RouteComparison, ...], tuple[Unchecked, ...]]:
    """Take out frequencies at which the tolerance is too wide to prove anything."""
    difference, wide = comparison.difference, comparison.tolerance > LOOSEST
    if not np.any(wide):
        return (comparison,), ()
    reason = (
        f"the routes are known no better than to {np.min(comparison.tolerance[wide]):.2g} of themselves there (limit {LOOSEST:g}), "
        "as where an orbit crosses a limit"
    )
    unchecked = Unchecked(routes=difference.routes, omega=difference.omega[wide], reason=reason)
    if np.all(wide):
        return (), (unchecked,)
    kept = RouteComparison(
        difference=ResponseDifference(
            routes=difference.routes, omega=difference.omega[~wide], first=difference.first[~wide], second=difference.second[~wide]
        ),
        tolerance=comparison.tolerance[~wide],
        amplitude=comparison.amplitude[~wide],
    )
    return (kept,), (unchecked,)


def _group(routes: tuple[str, str], missing: Sequence[MissingAnswer]) -> tuple[Unchecked, ...]:
    """One entry for each reason."""
    reasons = dict.fromkeys(entry.reason for entry in missing)
    return tuple(
        Unchecked(routes=routes, omega=np.array([entry.omega for entry in missing if entry.reason == reason]), reason=reason)
        for reason in reasons
    )
