"""Running a study into a folder: numbers, tables, figures, report, results.json. Interrupted, it says so and goes on later."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from revline import __version__
from revline.errors import InvalidInputError, PartialResultError, RevlineError
from revline.io.engine_files import read_engine, write_engine
from revline.io.json_files import write_json
from revline.io.value_files import read_value, write_value
from revline.report.figure_files import FigureTask, figure_task, write_figures
from revline.report.html import write_html
from revline.report.pdf import write_pdf
from revline.report.tables import write_tables
from revline.studies.captions import caption, figure_rows, figure_title
from revline.studies.chain import FOLDER, Report, Stopwatch
from revline.studies.checks import Check, check_study
from revline.studies.config import StudyConfig
from revline.studies.content import make_document, make_partial_document
from revline.studies.figures import figure_calls
from revline.studies.made import Made, check_making, describe_making
from revline.studies.material import Material
from revline.studies.record import SCHEMA, study_record
from revline.studies.study import NUMBERS_SHARE, compute_study
from revline.studies.study_results import StudyResults
from revline.studies.tables import study_tables
from revline.system import DelaySystem

RESULTS = "results.json"
QUESTIONS = "questions.json"
BUNDLE = "study.json"
MADE = "made.json"
ENGINE = "engine.toml"
PAGE = "report.html"
PAPER = "report.pdf"

FIGURES_SHARE = 0.85
"""Part of a study that is done when its figures are drawn."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """A finished study.

    Attributes:
        folder: where everything was written.
        config: the questions.
        results: the answers.
        checks: of the study on itself.
        warnings: what the reader must know.
        record: fields of results.json.
    """

    folder: Path
    config: StudyConfig
    results: StudyResults
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    record: dict[str, Any]

    @property
    def failed(self) -> tuple[Check, ...]:
        """Checks that do not hold."""
        return tuple(check for check in self.checks if not check.passed)


def run_study(config: StudyConfig, folder: str | Path, report: Report = lambda _, __: None) -> Study:
    """Run a study into a folder; one that was interrupted there goes on from its finished steps.

    Args:
        config: the questions.
        folder: made if it is missing.
        report: told the step under way and the part done.

    Returns:
        The study, all files written.

    Raises:
        InvalidInputError: the folder cannot be written, or a question is unusable.
        AnalysisError: a step could not be completed; finished ones are kept and results.json says that it is partial.
        PartialResultError: it was interrupted; the same.
    """
    place, watch = Path(folder), Stopwatch()
    steps = _prepare(place)
    _write_partial(place, config)
    try:
        engine = config.load_engine()
        for name in (BUNDLE, MADE):
            (steps / name).unlink(missing_ok=True)  # answers to other questions may lie there
        write_value(steps / QUESTIONS, config)
        results = compute_study(config, place, report)
        write_value(steps / BUNDLE, results)
        write_engine(engine, steps / ENGINE)
        made = describe_making(config, engine, results, watch.seconds)
        write_value(steps / MADE, made)
        _write_all(_material(config, engine, results, made, place), report)
        timed = replace(made, seconds=watch.seconds)
        write_value(steps / MADE, timed)
        return _write_record(config, results, timed, place, report)
    except KeyboardInterrupt as error:
        record = _write_partial(place, config)
        done = ", ".join(record["finished_steps"]) or "nothing"
        message = f"interrupted: {place} is partial (finished: {done}); run the same command again and it goes on from there"
        raise PartialResultError(message) from error
    except RevlineError:
        _write_partial(place, config)
        raise


def rebuild_report(folder: str | Path, report: Report = lambda _, __: None) -> Study:
    """Make tables, figures, report and results.json again from the results that a study left in a folder.

    Raises:
        InvalidInputError: the folder holds no finished study, or one that was damaged or changed.
    """
    place = Path(folder)
    steps = place / FOLDER
    for name in (QUESTIONS, ENGINE, BUNDLE, MADE):
        if not (steps / name).is_file():
            message = f"{place} holds no finished study: {FOLDER}/{name} is missing; run `revline study --out {place}` first"
            raise InvalidInputError(message, path=str(place))
    config, results, made = (read_value(steps / name) for name in (QUESTIONS, BUNDLE, MADE))
    if not (isinstance(config, StudyConfig) and isinstance(results, StudyResults) and isinstance(made, Made)):
        message = f"{steps} holds other values than a study's; run `revline study --out {place}` again"
        raise InvalidInputError(message, path=str(place))
    engine = read_engine(steps / ENGINE)
    check_making(config, engine, results, made)
    _write_all(_material(config, engine, results, made, place), report)
    return _write_record(config, results, made, place, report)


def find_warnings(config: StudyConfig, results: StudyResults) -> Iterator[str]:
    """What the reader of the results must know."""
    yield from _map_warnings(results)
    trim = results.point.trim
    if not trim.stable:
        yield f"the operating point is unstable without control ({trim.unstable_count} roots in the right half-plane)"
    yield from (str(left) for left in trim.left_out)
    yield from results.response.notes
    if not results.models.chosen:
        yield "no fitted model passes every test (see its verdict); the controllers designed on them may not keep their promise"
    if not config.is_the_thesis:
        yield "engine or operating point are not the thesis's: its numbers are not set beside"
    elif not config.asks_what_the_thesis_asked:
        yield "not every question is the thesis's: its controllers and how they ended are not set beside"
    for row in results.loops.rows:
        if row.plant == "engine" and row.run.is_stable and row.run.saturated_share > 0.5:
            yield f"{row.controller} holds the throttle at a limit for {100 * row.run.saturated_share:.0f} % of its run"


def _map_warnings(results: StudyResults) -> Iterator[str]:
    """Where the steady map begins, and what rests below; other warnings of the map as they are."""
    steady = results.range.steady_map
    below = [missing for missing in steady.missing if missing.value < steady.lowest]
    if below:
        rests = "; ".join(f"{missing.value:g} deg: {_left_out(missing.reason)}" for missing in below)
        speed = min(trim.output("engine_speed") for trim in steady.trims)
        yield (
            f"the steady map begins at {steady.lowest:.3f} deg (lowest speed shown {speed:.4g} rad/s); "
            f"left out below, as no engine runs there: {rests}"
        )
    skipped = {missing.reason for missing in below}
    yield from (text for text in steady.warnings if text not in skipped and not text.startswith("no steady state below"))


def _left_out(reason: str) -> str:
    found = re.search(r"left out: (?:a steady state at )?(.*?), below", reason)
    return found.group(1).replace("engine_speed", "speed") if found else reason


def figure_tasks(config: StudyConfig, engine: DelaySystem, results: StudyResults) -> tuple[FigureTask, ...]:
    """All figures still to be drawn, in the order of their numbers."""
    calls = figure_calls(config, engine, results)
    numbers = [row["id"] for row in figure_rows() if row["id"] in calls]
    return tuple(
        figure_task(f"figure_{number}", calls[number].function, *calls[number].arguments, **calls[number].options) for number in numbers
    )


def _material(config: StudyConfig, engine: DelaySystem, results: StudyResults, made: Made, folder: Path) -> Material:
    return Material(
        config=config,
        engine=engine,
        results=results,
        checks=check_study(config, results),
        warnings=_all_warnings(config, results),
        figures=folder / "figures",
        made=made,
    )


def _write_all(material: Material, report: Report) -> None:
    """Write tables, figures and both reports."""
    config, results, folder = material.config, material.results, material.figures.parent
    report("tables", NUMBERS_SHARE)
    write_tables(folder / "tables", study_tables(config, results))
    tasks = figure_tasks(config, material.engine, results)
    write_figures(tasks, material.figures, progress=_figure_progress(report))
    report("report", FIGURES_SHARE)
    document = make_document(material)
    write_html(document, folder / PAGE)
    report("report on paper", 0.95)
    write_pdf(document, folder / PAPER)


def _all_warnings(config: StudyConfig, results: StudyResults) -> tuple[str, ...]:
    return tuple(dict.fromkeys(find_warnings(config, results)))


def _write_record(config: StudyConfig, results: StudyResults, made: Made, folder: Path, report: Report) -> Study:
    """Write results.json, last of all: while it says that the study is partial, it is."""
    checks, warnings = check_study(config, results), _all_warnings(config, results)
    record = study_record(config, results, checks, warnings, made.seconds)
    record["figures"] = [
        {
            "id": row["id"],
            "title": figure_title(row["id"], results),
            "file": f"figures/figure_{row['id']}.png",
            "caption": caption(row["id"], results),
        }
        for row in figure_rows()
    ]
    write_json(folder / RESULTS, record, "results")
    report("done", 1.0)
    return Study(folder=folder, config=config, results=results, checks=checks, warnings=warnings, record=record)


def _figure_progress(report: Report) -> Callable[[int, int, str], None]:
    def told(done: int, count: int, name: str) -> None:
        report(f"drawing {name}", NUMBERS_SHARE + (FIGURES_SHARE - NUMBERS_SHARE) * done / count)

    return told


def _prepare(folder: Path) -> Path:
    """Make the folder and see that it can be written, before anything long is begun."""
    steps = folder / FOLDER
    try:
        steps.mkdir(parents=True, exist_ok=True)
        probe = steps / ".probe"
        probe.write_text("")
        probe.unlink()
    except OSError as error:
        message = f"the folder {folder} cannot be written: {error.strerror}; name one that may be written with --out"
        raise InvalidInputError(message, path=str(folder)) from error
    return steps


def _write_partial(folder: Path, config: StudyConfig) -> dict[str, Any]:
    """Say in results.json and on the page that the study is not finished; a report of other questions does not stay beside."""
    record = _partial_record(folder, config)
    write_json(folder / RESULTS, record, "results")
    write_html(make_partial_document(config, record["finished_steps"]), folder / PAGE)
    (folder / PAPER).unlink(missing_ok=True)
    return record


def _partial_record(folder: Path, config: StudyConfig) -> dict[str, Any]:
    finished = sorted({path.name.rpartition("-")[0] for path in (folder / FOLDER).glob("*-*.json")})
    return {
        "schema": SCHEMA,
        "partial": True,
        "engine": config.engine,
        "version": __version__,
        "finished_steps": finished,
        "note": "this study is not finished; run the same command again and it goes on from its finished steps",
    }
