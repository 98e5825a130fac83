"""The command spectra: at which frequencies an engine's speed moves when the throttle moves at one."""

from typing import Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption
from revline.cli.shell import Grid, Shell

MOST_PERIODS = 1000


def spectra(
    *,
    throttle: ThrottleOption,
    load: LoadOption = 0.0,
    amplitude: Annotated[float, typer.Option("--amplitude", metavar="DEG", help="Amplitude of the throttle's sinusoid [deg].")] = 5.0,
    frequencies: Annotated[
        str, typer.Option("--frequencies", metavar="W1,W2,..", help="Frequencies [rad/s], rising, separated by commas.")
    ] = "0.01,0.05,0.5,5,20,50",
    periods: Annotated[int, typer.Option("--periods", min=1, max=MOST_PERIODS, help="Periods in each record, after the transient.")] = 8,
    distortion_limit: Annotated[
        float, typer.Option("--distortion-limit", metavar="PART", help="Largest distortion of an answer that counts as linear.")
    ] = 0.05,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check by amplitude spectra whether the speed follows the throttle's frequency, and give the range in which it does as a verdict.

    Each spectrum is that of whole periods after the transient, the speed at rest taken off, zero-padded, without a window; its line at zero
    is the shift of the mean and no peak. The file has all lines of all spectra.
    """
    from revline.analysis.linearity import check_distortion_limit, judge_linearity
    from revline.analysis.periodic import Excitation, RunSettings
    from revline.analysis.spectrum import check_spectra
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine
    from revline.io.linearity_records import SCALING, format_spectra, linearity_record, spectra_rows
    from revline.io.number_lists import parse_numbers

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "spectra")
    check_distortion_limit(distortion_limit)
    omega = parse_numbers(frequencies, "--frequencies")
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=amplitude)
    system = load_engine(engine)
    trim = find_trim(system, inputs={"throttle": throttle, "load_torque": load})
    with shell.progress("spectra") as progress:
        checks = check_spectra(system, trim, excitation, omega, settings=RunSettings(cycles=periods), progress=progress)
    verdict = judge_linearity(checks=checks, distortion_limit=distortion_limit)
    record: dict[str, str | float] = {"engine": engine, "throttle_deg": throttle, "load_n_m": load, "amplitude_deg": amplitude}
    shell.write(out, format_spectra(checks, notes=record), "spectra")
    rows = [
        (s.omega, s.spectrum.peak_omega, s.spectrum.peak_amplitude, s.spectrum.zero_line, s.spectrum.resolution, s.distortion)
        for s in checks
    ]
    follows = ["yes" if check.follows else "no" for check in checks]
    header = ("input [rad/s]", "peak [rad/s]", "height [rad/s]", "line at zero [rad/s]", "resolution [rad/s]", "distortion", "follows")
    grid = Grid(
        f"Spectra of the speed of {engine} at {throttle:g} +- {amplitude:g} deg, {periods} periods each",
        header,
        [(*row, word) for row, word in zip(rows, follows, strict=True)],
    )
    more = {"spectra": spectra_rows(checks), "scaling": SCALING, "linearity": linearity_record(verdict)}
    shell.show({**record, **more}, grid, f"the speed {verdict.text}", text_on=out)
