"""Running a study into a folder: numbers, tables, figures, report, results.json. Interrupted, it says so and goes on later."""

import importlib.util
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from revline.analysis.steady_map import Undecided
from revline.errors import InvalidInputError, PartialResultError, RevlineError
from revline.io.engine_files import read_engine, write_engine
from revline.io.json_files import write_json
from revline.io.value_files import read_value, write_value
from revline.report.figure_files import FigureTask, figure_task, write_figures
from revline.report.html import write_html
from revline.report.pdf import write_pdf
from revline.report.tables import Table, write_tables
from revline.studies.captions import caption, figure_ids, figure_title
from revline.studies.chain import FOLDER, Report, Stopwatch, code_digest
from revline.studies.checks import Check, check_study
from revline.studies.config import StudyConfig
from revline.studies.content import make_document
from revline.studies.figures import figure_calls
from revline.studies.folder import Written, is_finished, keep_written, read_written, remove_files, study_folder
from revline.studies.made import Made, check_making, describe_making
from revline.studies.material import Material
from revline.studies.partial import write_partial_report
from revline.studies.parts import Parts
from revline.studies.record import partial_record, study_record
from revline.studies.results import NoRange
from revline.studies.routes import route_warnings
from revline.studies.study import NUMBERS_SHARE, compute_study
from revline.studies.study_results import StudyResults
from revline.studies.tables import study_tables
from revline.system import DelaySystem
from revline.values import fingerprint

RESULTS = "results.json"
QUESTIONS = "questions.json"
BUNDLE = "study.json"
MADE = "made.json"
ENGINE = "engine.toml"
PAGE = "report.html"
PAPER = "report.pdf"
NO_PAPER = "there is no report.pdf: typst, which sets it, is not installed; pip install revline[report]"

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

    Until it is finished, results.json and report.html say after each step that they are partial, and hold what is found. A study that
    lies there finished already stays so.

    Args:
        config: the questions.
        folder: made if it is missing.
        report: told the step under way and the part done.

    Returns:
        The study, all files written.

    Raises:
        InvalidInputError: the folder cannot be written or another study is at work there, or a question is unusable.
        AnalysisError: a figure or the report could not be made.
        PartialResultError: it was interrupted, or some steps could not be completed; what does not need these is computed.
    """
    place, watch = Path(folder), Stopwatch()
    engine = config.load_engine()
    questions = fingerprint(config, engine.content_digest)
    with study_folder(place) as steps:
        ledger = _open_ledger(config, place, questions)
        try:
            results = compute_study(config, place, report, ledger.keep)
            write_value(steps / BUNDLE, results)
            write_engine(engine, steps / ENGINE)
            made = describe_making(config, engine, results, watch.seconds)
            write_value(steps / MADE, made)
            written = _write_all(_material(config, engine, results, made, place), report, ledger.written)
            timed = replace(made, seconds=watch.seconds)
            write_value(steps / MADE, timed)
            return _write_record(config, results, timed, report, written)
        except KeyboardInterrupt as error:
            ledger.say_partial()
            message = f"interrupted: {ledger.state}; run the same command again and it goes on from there"
            raise PartialResultError(message) from error
        except RevlineError:
            ledger.say_partial()
            raise


@dataclass(slots=True, kw_only=True, eq=False)
class _Ledger:
    """What the folder of a study under way says of it.

    Attributes:
        place: the folder.
        config: the questions.
        written: what is or will be written there; whole where the very study lies there finished.
        parts: what is found so far.
    """

    place: Path
    config: StudyConfig
    written: Written
    parts: Parts = field(default_factory=Parts)

    def keep(self, parts: Parts) -> None:
        """Take what is found, and say it in results.json."""
        self.parts = parts
        if not self.written.is_whole:
            write_json(self.place / RESULTS, partial_record(self.config, parts), "results")

    def say_partial(self) -> None:
        """Say in results.json and on the report's page that the study is partial, and hold what is found."""
        if not self.written.is_whole:
            self.keep(self.parts)
            write_partial_report(self.config, self.parts, self.place / PAGE)

    @property
    def state(self) -> str:
        """How the folder is left, in words."""
        if self.written.is_whole:
            return f"{self.place} holds the study as it was finished before"
        return f"{self.place} is partial (finished: {', '.join(self.parts.finished) or 'nothing'})"


def _open_ledger(config: StudyConfig, place: Path, questions: str) -> _Ledger:
    """Say that the study is partial and remove what answered other questions, unless the very study lies there finished."""
    steps = place / FOLDER
    earlier = read_written(steps)
    if is_finished(place, earlier, questions, code_digest()) and earlier is not None:
        return _Ledger(place=place, config=config, written=earlier)
    same = earlier is not None and earlier.questions == questions
    if earlier is not None and not same:
        remove_files(place, earlier.files)
    remove_files(place, (PAPER,))  # it cannot say that it is partial
    for name in (BUNDLE, MADE):
        (steps / name).unlink(missing_ok=True)  # answers to other questions may lie there
    files = earlier.files if earlier is not None and same else ()
    written = Written(questions=questions, code=code_digest(), is_whole=False, files=files)
    ledger = _Ledger(place=place, config=config, written=written)
    ledger.say_partial()
    keep_written(steps, written)
    write_value(steps / QUESTIONS, config)
    return ledger


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
    with study_folder(place):
        found = read_written(steps)
        earlier = Written(questions=made.questions, code=made.code, is_whole=False, files=()) if found is None else found
        written = _write_all(_material(config, engine, results, made, place), report, earlier)
        return _write_record(config, results, made, report, written)


def find_warnings(config: StudyConfig, results: StudyResults) -> Iterator[str]:
    """What the reader of the results must know."""
    yield from _map_warnings(results)
    trim = results.point.trim
    if not trim.stable:
        yield f"the operating point is unstable without control ({trim.unstable_count} roots in the right half-plane)"
    yield from (str(left) for left in trim.left_out)
    yield from results.response.notes
    yield from route_warnings(results.routes)
    yield from results.delay_models.missing
    yield from (f"{row.controller}: {row.reason}" for row in (*results.hunting.without_cycle, *results.hunting.without_onset))
    lacking = (results.rivals, results.operating_map, results.trials, results.two_inputs)
    yield from (f"{one.what}: {one.reason}" for found in lacking for one in found.missing)
    yield from results.two_inputs.warnings
    if isinstance(results.range.widest, NoRange):
        yield f"no range chosen automatically: {results.range.widest.reason}"
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
    below = [missing for missing in steady.missing if missing.value < steady.lowest and not isinstance(missing, Undecided)]
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
    return tuple(
        figure_task(f"figure_{number}", calls[number].function, *calls[number].arguments, **calls[number].options)
        for number in figure_ids(results)
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


class _Files(NamedTuple):
    """Where a study is written, what was there, and what is there now."""

    folder: Path
    before: tuple[str, ...]
    written: Written


def _write_all(material: Material, report: Report, earlier: Written) -> _Files:
    """Write tables, figures and both reports; on paper only where typst is installed, else there is a warning."""
    config, results, folder = material.config, material.results, material.figures.parent
    tables, tasks = study_tables(config, results), figure_tasks(config, material.engine, results)
    pages = (RESULTS, PAGE, PAPER) if _has_paper() else (RESULTS, PAGE)
    written = _will_write(earlier, pages, tables, tasks)
    if not earlier.is_whole:
        keep_written(folder / FOLDER, replace(written, is_whole=False, files=tuple(sorted({*earlier.files, *written.files}))))
    report("tables", NUMBERS_SHARE)
    write_tables(folder / "tables", tables)
    write_figures(tasks, material.figures, progress=_figure_progress(report))
    report("report", FIGURES_SHARE)
    document = make_document(material)
    write_html(document, folder / PAGE)
    if PAPER in pages:
        report("report on paper", 0.95)
        write_pdf(document, folder / PAPER)
    return _Files(folder, earlier.files, written)


def _will_write(earlier: Written, files: tuple[str, ...], tables: Iterable[Table], tasks: Iterable[FigureTask]) -> Written:
    """All files of a finished study."""
    files += tuple(f"tables/{table.name}.csv" for table in tables)
    files += tuple(f"figures/{task.name}.{ending}" for task in tasks for ending in ("png", "svg"))
    return replace(earlier, is_whole=True, files=tuple(sorted(files)))


def _has_paper() -> bool:
    return importlib.util.find_spec("typst") is not None


def _all_warnings(config: StudyConfig, results: StudyResults) -> tuple[str, ...]:
    return (*dict.fromkeys(find_warnings(config, results)), *(() if _has_paper() else (NO_PAPER,)))


def _write_record(config: StudyConfig, results: StudyResults, made: Made, report: Report, files: _Files) -> Study:
    """Write results.json, last of all: while it says that the study is partial, it is."""
    checks, warnings = check_study(config, results), _all_warnings(config, results)
    record = study_record(config, results, checks, warnings, made.seconds)
    record["figures"] = [
        {
            "id": number,
            "title": figure_title(number, results),
            "file": f"figures/figure_{number}.png",
            "caption": caption(number, results),
        }
        for number in figure_ids(results)
    ]
    write_json(files.folder / RESULTS, record, "results")
    remove_files(files.folder, sorted(set(files.before) - set(files.written.files)))
    keep_written(files.folder / FOLDER, files.written)
    report("done", 1.0)
    return Study(folder=files.folder, config=config, results=results, checks=checks, warnings=warnings, record=record)


def _figure_progress(report: Report) -> Callable[[int, int, str], None]:
    def told(done: int, count: int, name: str) -> None:
        report(f"drawing {name}", NUMBERS_SHARE + (FIGURES_SHARE - NUMBERS_SHARE) * done / count)

    return told
