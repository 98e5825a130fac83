"""The command response: how an engine's speed answers small movements of the throttle."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption
from revline.cli.shell import Grid, Shell, is_stdout
from revline.errors import InvalidInputError, out_of_range
from revline.studies.response_routes import (
    CheckChoice,
    Checked,
    Found,
    MethodChoice,
    Sines,
    check_response,
    find_response,
    place_of,
    require_whole,
    response_record,
    usual_check,
)

if TYPE_CHECKING:
    from revline.lti.response import Floats


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
            "harmonic-balance: periodic answers computed without simulating; "
            "exact: linearised with the delays kept, for a vanishing amplitude.",
        ),
    ] = "peaks",
    check: Annotated[
        CheckChoice | None,
        typer.Option(
            "--check",
            help="quick: the exact response against harmonic balance at vanishing amplitude; full: also harmonic balance against simulated "
            "sinusoids; none. By default full where the method simulates, else quick.",
            show_default=False,
        ),
    ] = None,
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
    unwrapped from 0 at low frequency. Independent routes to the response are compared; where they disagree the exit status is 1.
    """
    from revline.io.engine_files import load_engine

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "frequency response")
    omega = _read_frequencies(frequencies, frequencies_file)
    sines = _read_sines(time_step, workers, distortion_limit)
    place = place_of(load_engine(engine), throttle, load, amplitude, omega)
    found = find_response(shell, place, method, sines)
    checked = check_response(shell, place, found, check or usual_check(method), sines)
    asked = {"engine": engine, "throttle_deg": throttle, "load_n_m": load, "amplitude_deg": amplitude, "method": method}
    _write_and_show(shell, asked, amplitude, (found, checked), out)
    require_whole(found, checked, "" if out is None or is_stdout(out) else str(out))


def _write_and_show(shell: Shell, asked: Mapping[str, object], amplitude: float, both: tuple[Found, Checked], out: Path | None) -> None:
    from revline.io.response_files import format_response, response_rows

    found, checked = both
    said = {"partial": found.partial, "disputed": checked.disagreement}
    text = format_response(found.response, amplitude=amplitude, distortion=found.distortion, **said)
    shell.write(out, text, "frequency response")
    shell.warn(*found.notes, *checked.warnings)
    rows = response_rows(found.response, amplitude=amplitude, distortion=found.distortion)
    header = ("frequency [rad/s]", "amplitude [rad/s]", "phase [deg]", "distortion")[: len(rows[0])]
    title = "{engine} at {throttle_deg:g} +- {amplitude_deg:g} deg, {method}".format_map(asked)
    grid = Grid(title, header, [tuple(row.values()) for row in rows])
    record = response_record(asked, amplitude, found, checked)
    shell.show(record, grid, *found.verdict, *checked.lines, text_on=out)


def _read_sines(time_step: float, workers: int, distortion_limit: float) -> Sines:
    from revline.analysis.linearity import check_distortion_limit

    check_distortion_limit(distortion_limit)
    if not time_step > 0.0:
        raise out_of_range("--time-step", time_step, "s", "values above 0", "give a time in seconds")
    return Sines(time_step, workers, distortion_limit)


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
