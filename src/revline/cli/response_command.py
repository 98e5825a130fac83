"""The command response: how an engine's speed answers small movements of the throttle."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption
from revline.cli.shell import Grid, Shell, is_stdout
from revline.errors import InvalidInputError, PartialResultError, out_of_range

if TYPE_CHECKING:
    from revline.lti.response import Floats, FrequencyResponse

MethodChoice = Literal["peaks", "fourier", "exact"]


def response(
    *,
    throttle: ThrottleOption,
    load: LoadOption = 0.0,
    amplitude: Annotated[float, typer.Option("--amplitude", metavar="DEG", help="Amplitude of the throttle's sinusoid [deg].")] = 5.0,
    frequencies: Annotated[
        str | None, typer.Option("--frequencies", metavar="W1,W2,..", help="Frequencies [rad/s], rising, separated by commas.")
    ] = None,
    frequencies_file: Annotated[
        Path | None, typer.Option("--frequencies-file", metavar="FILE.csv", help="Take the frequencies from a column frequency_rad_s.")
    ] = None,
    method: Annotated[
        MethodChoice,
        typer.Option(
            "--method",
            help="peaks: maxima and minima of simulated sinusoids; fourier: their fundamental; "
            "exact: linearised with the delays kept, for a vanishing amplitude.",
        ),
    ] = "peaks",
    time_step: Annotated[float, typer.Option("--time-step", metavar="S", help="Longest step of the simulations [s].")] = 1e-3,
    workers: Annotated[int, typer.Option("--workers", min=1, max=64, help="Threads; results do not depend on their number.")] = 2,
    distortion_limit: Annotated[
        float, typer.Option("--distortion-limit", metavar="PART", help="Largest distortion of an answer that counts as linear.")
    ] = 0.05,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the frequency response from throttle to speed: amplitude, phase and distortion, each frequency run until it has settled.

    Says in which range of frequencies the speed follows the throttle's frequency as a linear system would. Where a frequency fails, or on
    Ctrl-C, what is finished is written and says that it is partial. The file is what `revline fit` reads. Phases are negative for lag and
    unwrapped from 0 at low frequency.
    """
    from revline.io.response_files import format_response, response_rows

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "frequency response")
    omega = _read_frequencies(frequencies, frequencies_file)
    place = _Place(engine, throttle, load)
    sines = _Sines(amplitude, method, time_step, workers, distortion_limit)
    found = _exact(place, omega, amplitude) if method == "exact" else _simulated(shell, place, omega, sines)
    text = format_response(found.response, amplitude=amplitude, distortion=found.distortion, partial=found.partial)
    shell.write(out, text, "frequency response")
    shell.warn(*found.notes)
    rows = response_rows(found.response, amplitude=amplitude, distortion=found.distortion)
    record = {"engine": engine, "throttle_deg": throttle, "load_n_m": load, "amplitude_deg": amplitude, "method": method}
    header = ("frequency [rad/s]", "amplitude [rad/s]", "phase [deg]", "distortion")[: len(rows[0])]
    grid = Grid(f"{engine} at {throttle:g} +- {amplitude:g} deg, {method}", header, [tuple(row.values()) for row in rows])
    shell.show({**record, "frequency_response": rows, **found.more, "warnings": list(found.notes)}, grid, *found.verdict, text_on=out)
    if found.partial:
        kept = "" if out is None or is_stdout(out) else f"; {out} holds the finished part"
        message = f"the response is partial: {found.partial}{kept}"
        raise PartialResultError(message)


class _Place(NamedTuple):
    engine: str
    throttle: float
    load: float


class _Sines(NamedTuple):
    amplitude: float
    method: str
    time_step: float
    workers: int
    distortion_limit: float


class _Found(NamedTuple):
    response: "FrequencyResponse"
    distortion: "Floats | None"
    notes: tuple[str, ...]
    verdict: tuple[str, ...] = ()
    more: Mapping[str, object] = MappingProxyType({})
    partial: str = ""


def _read_frequencies(text: str | None, path: Path | None) -> "Floats":
    import numpy as np

    from revline.io.csv_table import read_csv_table
    from revline.io.number_lists import parse_numbers

    if text is not None and path is None:
        return np.array(parse_numbers(text, "--frequencies"))
    if path is not None and text is None:
        return read_csv_table(path).numbers("frequency_rad_s")
    message = "give either --frequencies, for example 0.1,1,10, or --frequencies-file"
    raise InvalidInputError(message)


def _exact(place: _Place, omega: "Floats", amplitude: float) -> _Found:
    from revline.analysis.exact_response import find_exact_response
    from revline.analysis.linearize import linearize
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine

    system = load_engine(place.engine)
    trim = find_trim(system, inputs={"throttle": place.throttle, "load_torque": place.load})
    response = find_exact_response(system, trim, omega, input_name="throttle", output_name="engine_speed")
    notes = [str(kink) for kink in linearize(system, trim).kinks if kink.argument == "throttle"]
    if not trim.stable:
        notes.append("the engine is open-loop unstable here: no experiment shows this response")
    throttle = next(variable for variable in system.inputs if variable.name == "throttle")
    if not throttle.low <= place.throttle - amplitude <= place.throttle + amplitude <= throttle.high:
        ends = f"{throttle.low:g} to {throttle.high:g} deg"
        notes.append(f"the amplitude of {amplitude:g} deg only scales this response: so large a sinusoid would leave {ends}")
    return _Found(response, None, tuple(notes))


def _simulated(shell: Shell, place: _Place, omega: "Floats", sines: _Sines) -> _Found:
    from revline.analysis.cycle_readings import ReadingMethod
    from revline.analysis.linearity import check_distortion_limit, judge_linearity
    from revline.analysis.periodic import Excitation, RunSettings
    from revline.analysis.sinestream import PartialSinestream, attempt_sinestream
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine
    from revline.io.linearity_records import linearity_record

    check_distortion_limit(sines.distortion_limit)
    if not sines.time_step > 0.0:
        raise out_of_range("--time-step", sines.time_step, "s", "values above 0", "give a time in seconds")
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=sines.amplitude)
    settings = RunSettings(max_step=sines.time_step)
    system = load_engine(place.engine)
    trim = find_trim(system, inputs={"throttle": place.throttle, "load_torque": place.load})
    with shell.progress("sinusoids") as progress:
        outcome = attempt_sinestream(system, trim, excitation, omega, settings=settings, workers=sines.workers, progress=progress)
    stream = outcome.finished if isinstance(outcome, PartialSinestream) else outcome
    reading = ReadingMethod(sines.method)
    response, notes = stream.response(reading), stream.reading(reading).notes
    if isinstance(outcome, PartialSinestream):
        missing = [{"frequency_rad_s": entry.omega, "reason": entry.reason} for entry in outcome.missing]
        return _Found(response, stream.distortion, notes, more={"partial": True, "missing": missing}, partial=str(outcome))
    verdict = judge_linearity((stream,), distortion_limit=sines.distortion_limit)
    return _Found(response, stream.distortion, notes, (f"the speed {verdict.text}",), {"linearity": linearity_record(verdict)})
