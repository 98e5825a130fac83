"""The commands study and report: the whole chain into a folder, and its report again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import JsonOption, QuietOption
from revline.cli.shell import Facts, Grid, Shell

if TYPE_CHECKING:
    from revline.studies.writing import Study


def study(
    *,
    questions: Annotated[
        Path | None,
        typer.Argument(metavar="[STUDY.toml]", help="Study file; without one, the study of Lee (1995) at 25 deg with 5 deg amplitude."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for results, tables, figures and report; made if missing.")],
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run the whole study: steady states, linearity, frequency response, models, controllers, closed loops, report.

    Writes results.json, report.html, report.pdf, figures/ and tables/ into the folder. Interrupted, it keeps what is finished; the same
    command goes on from there.
    """
    from revline.studies.config import StudyConfig, read_config
    from revline.studies.writing import run_study

    shell = Shell(json=json, quiet=quiet)
    config = StudyConfig() if questions is None else read_config(questions)
    with shell.stages("study") as told:
        _show(shell, run_study(config, out, told))


def report(
    *,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that `revline study` wrote.")],
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make tables, figures and report again from the results in a study's folder, without computing them anew."""
    from revline.studies.writing import rebuild_report

    shell = Shell(json=json, quiet=quiet)
    with shell.stages("report") as told:
        _show(shell, rebuild_report(folder, told))


def _show(shell: Shell, done: "Study") -> None:
    results, failed = done.results, done.failed
    shell.warn(*done.warnings)
    shell.warn(*(f"check fails: {c.name}: {c.measured:g}, expected {c.expected:g} within {c.tolerance:g}" for c in failed))
    from revline.design.loops.closed_loop import describe_outcome

    trim = results.point.trim
    facts = (
        ("throttle", trim.input("throttle"), "deg"),
        ("engine speed", trim.output("engine_speed"), "rad/s"),
        ("manifold pressure", trim.state("manifold_pressure"), "kPa"),
        ("static gain", results.point.gain, "rad/s per deg"),
        ("delay of G2d", 1e3 * results.models.fit("g2d").fit.model.delay, "ms"),
    )
    loops = [(row.controller, row.plant, describe_outcome(row.run)) for row in results.loops.rows]
    shell.show(
        done.record,
        Facts("Operating point", facts),
        Grid("Closed loops", ("controller", "plant", "how it ends"), loops),
        f"checks: {len(done.checks) - len(failed)} of {len(done.checks)} hold",
        f"report: {done.folder / 'report.html'}",
    )
