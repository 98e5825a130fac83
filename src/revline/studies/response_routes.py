"""Routes to an engine's frequency response as one question asks for it: found by one route, checked against the others, and told."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol, cast

from revline.errors import AnalysisError, PartialResultError

if TYPE_CHECKING:
    from revline.analysis.balance_attempts import PartialBalance
    from revline.analysis.cross_check import CrossCheck
    from revline.analysis.harmonic_balance import HarmonicBalance
    from revline.analysis.periodic import Excitation
    from revline.analysis.routes import ResponseDifference
    from revline.analysis.sinestream import PartialSinestream, Sinestream
    from revline.analysis.trim import Trim
    from revline.lti.response import Floats, FrequencyResponse
    from revline.system import DelaySystem

MethodChoice = Literal["peaks", "fourier", "harmonic-balance", "exact"]
CheckChoice = Literal["full", "quick", "none"]

SIMULATING = ("peaks", "fourier")
"""Methods whose answers harmonic balance is compared with by default."""


class Shell(Protocol):
    """Who is told how far a long computation is."""

    def progress(self, text: str) -> AbstractContextManager[Callable[[float], None]]:
        """Give what is told which part is done, 0 to 1."""


class Place(NamedTuple):
    """An engine at a trim, and what is moved there."""

    system: "DelaySystem"
    trim: "Trim"
    excitation: "Excitation"
    omega: "Floats"


class Sines(NamedTuple):
    """How sinusoids are simulated and judged."""

    time_step: float
    workers: int
    distortion_limit: float


class Found(NamedTuple):
    """A response by one route, and what is known of it besides."""

    response: "FrequencyResponse"
    answers: "HarmonicBalance | Sinestream | None" = None
    notes: tuple[str, ...] = ()
    verdict: tuple[str, ...] = ()
    more: Mapping[str, object] = MappingProxyType({})
    partial: str = ""

    @property
    def distortion(self) -> "Floats | None":
        """Of the answers, where the route has it."""
        return None if self.answers is None else self.answers.distortion


class Checked(NamedTuple):
    """What the routes say of each other; nothing where no check was asked for."""

    lines: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    more: Mapping[str, object] = MappingProxyType({})
    disagreement: str = ""


def place_of(system: "DelaySystem", throttle: float, load: float, amplitude: float, omega: "Floats") -> Place:
    """Find the trim, and what is moved there."""
    from revline.analysis.periodic import Excitation
    from revline.analysis.trim import find_trim

    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=amplitude)
    return Place(system, find_trim(system, inputs={"throttle": throttle, "load_torque": load}), excitation, omega)


def find_response(shell: Shell, place: Place, method: MethodChoice, sines: Sines) -> Found:
    """Find the response by the method asked for."""
    if method == "exact":
        return _exact(place)
    if method == "harmonic-balance":
        return _balanced(shell, place, sines)
    return _simulated(shell, place, method, sines)


def usual_check(method: MethodChoice) -> CheckChoice:
    """How deep a response is checked where nothing else is asked for."""
    return "full" if method in SIMULATING else "quick"


def response_record(asked: Mapping[str, object], amplitude: float, found: Found, checked: Checked) -> Mapping[str, object]:
    """Give a response as a record.

    Args:
        asked: what was asked for, which begins the record.
        amplitude: of the throttle, in deg.
        found: the response.
        checked: what other routes say of it.
    """
    from revline.io.response_files import response_rows
    from revline.io.sine_records import sine_fields

    rows = response_rows(found.response, amplitude=amplitude, distortion=found.distortion)
    extra = [{}] * len(rows) if found.answers is None else sine_fields(found.answers)
    listed = {"frequency_response": [{**row, **more} for row, more in zip(rows, extra, strict=True)]}
    return {**asked, **listed, **found.more, **checked.more, "warnings": [*found.notes, *checked.warnings]}


def require_whole(found: Found, checked: Checked, kept: str = "") -> None:
    """Refuse a response that another route contradicts, or of which frequencies are missing.

    Args:
        found: the response.
        checked: what other routes say of it.
        kept: the file that holds what there is, if any.

    Raises:
        AnalysisError: another route contradicts it.
        PartialResultError: frequencies are missing.
    """
    if checked.disagreement:
        held = f"; {kept} holds the response and says so" if kept else ""
        message = f"{checked.disagreement}{held}; --check none leaves the check out"
        raise AnalysisError(message)
    if found.partial:
        held = f"; {kept} holds the finished part" if kept else ""
        message = f"the response is partial: {found.partial}{held}"
        raise PartialResultError(message)


def check_response(shell: Shell, place: Place, found: Found, depth: CheckChoice, sines: Sines) -> Checked:
    """Check the response against other routes: the exact one against harmonic balance, and with `full` that against simulation."""
    from revline.analysis.cross_check import compare_routes
    from revline.analysis.harmonic_balance import HarmonicBalance
    from revline.analysis.linearize import linearize
    from revline.analysis.sinestream import Sinestream

    if depth == "none":
        return Checked()
    here = place._replace(omega=found.response.omega)
    exact = linearize(place.system, place.trim).model.response(here.omega, "throttle", "engine_speed")
    stream = found.answers if isinstance(found.answers, Sinestream) else None
    warnings: tuple[str, ...] = ()
    if depth == "full" and stream is None:
        stream, warnings = _attempted(shell, here, sines)
    with shell.progress("cross-check") as progress:
        check = compare_routes(
            place.system,
            place.trim,
            place.excitation,
            exact,
            balance=found.answers if isinstance(found.answers, HarmonicBalance) else None,
            stream=stream if depth == "full" else None,
            progress=progress,
        )
    shown = _as_shown(check, _effect(exact, found), depth, warnings)
    return _with_turns(shown, here, found) if check.vanishing.omega.size else shown


def _with_turns(shown: Checked, place: Place, found: Found) -> Checked:
    """Add a check of the phases' whole turns; where it cannot be made, that is said."""
    from revline.analysis.turn_check import check_turns
    from revline.io.cross_check_records import describe_turns, turn_record

    try:
        turns = check_turns(place.system, place.trim, place.excitation, found.response)
    except AnalysisError as error:
        return shown._replace(warnings=(*shown.warnings, f"the whole turns of the phase were not checked: {error}"))
    disagreement = shown.disagreement
    try:
        turns.require_agreement()
    except AnalysisError as error:
        disagreement = disagreement or str(error)
    record = dict(cast("Mapping[str, object]", shown.more["cross_check"]))
    record["agreed"], record["turns"] = bool(record["agreed"]) and turns.agreed, turn_record(turns)
    return Checked((*shown.lines, describe_turns(turns)), shown.warnings, {"cross_check": record}, disagreement)


def _as_shown(check: "CrossCheck", effect: "ResponseDifference | None", depth: str, warnings: tuple[str, ...]) -> Checked:
    from revline.io.cross_check_records import cross_check_record, describe_cross_check

    disagreement = ""
    try:
        check.require_agreement()
    except AnalysisError as error:
        disagreement = str(error)
    return Checked(
        describe_cross_check(check, effect),
        (*warnings, *(str(left) for left in check.unchecked)),
        {"cross_check": {"depth": depth, **cross_check_record(check, effect)}},
        disagreement,
    )


def _effect(exact: "FrequencyResponse", found: Found) -> "ResponseDifference | None":
    from revline.analysis.routes import EXACT, ResponseDifference

    if found.answers is None:
        return None
    return ResponseDifference(routes=(EXACT, found.response.method), omega=exact.omega, first=exact.values, second=found.response.values)


def _attempted(shell: Shell, place: Place, sines: Sines) -> tuple["Sinestream | None", tuple[str, ...]]:
    """Simulate for the check alone; where that fails it is said, and the check is left out."""
    try:
        outcome = _stream(shell, place, sines)
    except AnalysisError as error:
        return None, (f"the response was not checked by simulation: {error}",)
    stream = _finished(outcome)
    return stream, () if stream is outcome else (f"not all was checked by simulation: {outcome}",)


def _stream(shell: Shell, place: Place, sines: Sines) -> "Sinestream | PartialSinestream":
    from revline.analysis.periodic import RunSettings
    from revline.analysis.sinestream import attempt_sinestream

    settings = RunSettings(max_step=sines.time_step)
    with shell.progress("sinusoids") as progress:
        return attempt_sinestream(
            place.system, place.trim, place.excitation, place.omega, settings=settings, workers=sines.workers, progress=progress
        )


def _finished(outcome: "Sinestream | PartialSinestream") -> "Sinestream":
    from revline.analysis.sinestream import PartialSinestream

    return outcome.finished if isinstance(outcome, PartialSinestream) else outcome


def _exact(place: Place) -> Found:
    from revline.analysis.exact_response import find_exact_response
    from revline.analysis.linearize import linearize

    system, trim, amplitude = place.system, place.trim, place.excitation.amplitude
    response = find_exact_response(system, trim, place.omega, input_name="throttle", output_name="engine_speed")
    notes = [str(kink) for kink in linearize(system, trim).kinks if kink.argument == "throttle"]
    if not trim.stable:
        notes.append("the engine is open-loop unstable here: no experiment shows this response")
    throttle, angle = next(variable for variable in system.inputs if variable.name == "throttle"), trim.input("throttle")
    if not throttle.low <= angle - amplitude <= angle + amplitude <= throttle.high:
        ends = f"{throttle.low:g} to {throttle.high:g} deg"
        notes.append(f"the amplitude of {amplitude:g} deg only scales this response: so large a sinusoid would leave {ends}")
    return Found(response, notes=tuple(notes))


def _balanced(shell: Shell, place: Place, sines: Sines) -> Found:
    from revline.analysis.balance_attempts import PartialBalance, attempt_balance

    with shell.progress("harmonic balance") as progress:
        outcome = attempt_balance(place.system, place.trim, place.excitation, place.omega, progress=progress)
    balance = outcome.finished if isinstance(outcome, PartialBalance) else outcome
    found = Found(balance.response(), balance, balance.notes)
    return _as_partial(found, outcome) if isinstance(outcome, PartialBalance) else _judged(found, sines)


def _simulated(shell: Shell, place: Place, method: str, sines: Sines) -> Found:
    from revline.analysis.cycle_readings import ReadingMethod
    from revline.analysis.sinestream import PartialSinestream

    outcome, reading = _stream(shell, place, sines), ReadingMethod(method)
    stream = _finished(outcome)
    found = Found(stream.response(reading), stream, stream.reading(reading).notes)
    return _as_partial(found, outcome) if isinstance(outcome, PartialSinestream) else _judged(found, sines)


def _judged(found: Found, sines: Sines) -> Found:
    from revline.analysis.linearity import judge_linearity
    from revline.io.linearity_records import linearity_record

    if found.answers is None:
        return found
    verdict = judge_linearity((found.answers,), distortion_limit=sines.distortion_limit)
    return found._replace(verdict=(f"the speed {verdict.text}",), more={"linearity": linearity_record(verdict)})


def _as_partial(found: Found, outcome: "PartialBalance | PartialSinestream") -> Found:
    missing = [{"frequency_rad_s": entry.omega, "reason": entry.reason} for entry in outcome.missing]
    return found._replace(more={"partial": True, "missing": missing}, partial=str(outcome))
