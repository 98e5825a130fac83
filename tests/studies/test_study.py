"""The whole study's numbers: they hold, they are kept, and planted errors are seen."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from revline import signals
from revline.analysis.trim import find_trim
from revline.design.fitting.model_choice import Verdict
from revline.design.loops.outcome import Diverged, LimitCycle, Settled
from revline.engine.catalogue import build_engine
from revline.engine.lee1995 import lee1995_parameters
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError, PartialResultError, StepError
from revline.io.engine_files import format_engine, write_engine
from revline.io.value_files import write_value
from revline.report.html import render_html
from revline.studies import loop_steps, made, steps, writing
from revline.studies.captions import CAPTIONS, SPECTRUM_FIGURES, caption, figure_rows
from revline.studies.chain import FOLDER
from revline.studies.checks import check_study
from revline.studies.config import StudyConfig
from revline.studies.figures import figure_calls
from revline.studies.guidelines import find_limits
from revline.studies.made import describe_making
from revline.studies.own_figures import OWN_ROWS
from revline.studies.partial import partial_document
from revline.studies.parts import Parts
from revline.studies.record import partial_record, study_record
from revline.studies.results import LoopRow, NoRange
from revline.studies.study import STEPS, compute_study
from revline.studies.study_results import StudyResults
from revline.studies.tables import study_tables

pytestmark = pytest.mark.slow


@pytest.mark.reference
def test_all_checks_hold(config: StudyConfig, results: StudyResults) -> None:
    """Against Lee (1995) and converged values; each check names what it compares with."""
    checks = check_study(config, results)
    assert len({check.name for check in checks}) == len(checks) >= 80
    assert [check for check in checks if not check.passed] == []


def test_a_wrong_number_fails_its_check(config: StudyConfig, results: StudyResults) -> None:
    """Negative control: a response off by 1 % at one frequency, and a gain off by 0.1 %, must be seen."""
    stream = results.response
    values = np.array(stream.fourier.values)
    values[9] *= 1.01  # 0.1 rad/s
    wrong = dataclasses.replace(stream, fourier=dataclasses.replace(stream.fourier, values=values))
    failed = {c.name for c in check_study(config, dataclasses.replace(results, response=wrong)) if not c.passed}
    assert failed == {"fourier at 0.1 rad/s over the converged amplitude"}
    point = dataclasses.replace(results.point, gain=1.001 * results.point.gain)
    failed = {c.name for c in check_study(config, dataclasses.replace(results, point=point)) if not c.passed}
    assert failed == {"static gain at 25 deg"}


def test_a_loop_that_ends_otherwise_fails_its_check(config: StudyConfig, results: StudyResults) -> None:
    """C1 diverging on the engine is as unstable as hunting, and must not pass for it."""

    def ended(row: LoopRow) -> LoopRow:
        if (row.controller, row.plant) != ("c1", "engine"):
            return row
        return row._replace(run=dataclasses.replace(row.run, outcome=Diverged(time=1.0, value=1e3, bound=600.0)))

    loops = dataclasses.replace(results.loops, rows=tuple(ended(row) for row in results.loops.rows))
    failed = {c.name for c in check_study(config, dataclasses.replace(results, loops=loops)) if not c.passed}
    assert failed == {"C1 on the engine: ends in a limit cycle (1) or not (0)"}


def test_other_frequencies_than_the_thesis_s_are_not_checked_against_its_table(results: StudyResults) -> None:
    other = StudyConfig(frequencies=StudyConfig().frequencies[1:])
    assert not any("Table 4.1" in check.name for check in check_study(other, results))


def test_a_spectrum_s_caption_names_the_frequency_that_its_figure_shows(config: StudyConfig, results: StudyResults) -> None:
    """Figures go by rising frequency, whatever the frequencies are."""
    calls = figure_calls(config, config.load_engine(), results)
    for number, frequency in zip(SPECTRUM_FIGURES, (0.01, 0.05, 0.5, 5.0, 20.0, 50.0), strict=True):
        assert calls[number].options["input_frequency"] == frequency
        assert caption(number, results).startswith(f"Spectrum at {frequency:g} rad/s. ")
    moved = dataclasses.replace(results, spectra=tuple(dataclasses.replace(c, omega=2.0 * c.omega) for c in results.spectra))
    assert caption("4.4", moved).startswith("Spectrum at 1 rad/s. ")


def test_an_unstable_operating_point_gets_no_gain_limit_of_its_own(config: StudyConfig, results: StudyResults) -> None:
    engine = config.load_engine()
    unstable = dataclasses.replace(results.point, trim=find_trim(engine, inputs={"throttle": 4.0}))
    assert not unstable.trim.stable
    assert [row[0] for row in find_limits(engine, results)] == ["g1", "g2", "g2d", "engine, exact"]
    assert [row[0] for row in find_limits(engine, dataclasses.replace(results, point=unstable))] == ["g1", "g2", "g2d"]


def test_another_engine_gets_its_own_checks_only(results: StudyResults) -> None:
    other = StudyConfig(throttle_deg=26.0)
    assert not other.is_the_thesis
    names = {check.name for check in check_study(other, results)}
    assert "residual of the trim" in names
    assert not any("Table 4.1" in name for name in names)


def test_the_record_is_plain_json(config: StudyConfig, results: StudyResults) -> None:
    record = study_record(config, results, check_study(config, results), ["a warning"], 1.5)
    text = json.dumps(record, allow_nan=False)
    assert json.loads(text) == record
    methods = {row["method"] for row in record["frequency_response"]}
    assert methods == {"peaks", "fourier", "harmonic-balance", "exact"}
    assert all("limit_cycle" in row or row["stable"] or "diverged_at_s" in row for row in record["closed_loops"])
    assert None not in record.values()


def test_every_figure_has_a_call_and_a_caption(config: StudyConfig, results: StudyResults) -> None:
    ids = {row["id"] for row in figure_rows()}
    assert len(ids) == 46 + len(OWN_ROWS)  # those of the thesis, that of the cross-check, and other own ones
    assert set(figure_calls(config, config.load_engine(), results)) == ids == set(CAPTIONS)
    assert all(len(caption(figure, results)) > 20 for figure in ids)


def test_every_table_column_names_its_unit(config: StudyConfig, results: StudyResults) -> None:
    words = {"model", "verdict", "controller", "plant", "rule", "designed_on", "outcome", "text", "stable"}
    units = ("_s", "_deg", "_rad_s", "_kpa", "_1", "_db", "_n_m", "_rad_s_deg", "_rad_deg", "_s0", "_s1", "_s2", "_s3", "_s4")
    for table in study_tables(config, results):
        for column in table.columns:
            assert column.header in words or column.header.endswith((*units, "_deg_s_rad", "_deg_rad", "_deg_s2_rad")), column.header


def test_the_story_of_the_thesis_comes_out(results: StudyResults) -> None:
    loops = results.loops
    for controller, model in (("c1", "g1"), ("c2", "g2")):
        assert isinstance(loops.row(controller, model).run.outcome, Settled)
        assert isinstance(loops.row(controller, "engine").run.outcome, LimitCycle)
    assert isinstance(loops.row("c2d", "engine").run.outcome, Settled)
    assert any("did not tell" in line for line in results.guidelines)


def test_kept_steps_give_the_same_study(
    config: StudyConfig, results: StudyResults, study_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_: object) -> None:
        pytest.fail("a kept step was computed again")

    for name in ("find_point", "find_range", "run_steps", "run_sine", "find_response", "fit_models", "design_controllers"):
        monkeypatch.setattr(steps, name, forbidden)
    for name in ("run_loops", "find_errors"):
        monkeypatch.setattr(loop_steps, name, forbidden)
    again = compute_study(config, study_folder, lambda _, __: None)
    assert np.array_equal(again.response.fourier.values, results.response.fourier.values)
    assert again.guidelines == results.guidelines


def test_a_step_that_fails_keeps_no_other_from_being_computed(
    config: StudyConfig, results: StudyResults, study_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The models fail: what they need and what needs nothing of them is kept and shown, and the message says what is wanting."""

    def fail(*_: object) -> None:
        message = "no model fits"
        raise NotConvergedError(message)

    assert results.point.trim.stable  # the steps are kept by now
    shutil.copytree(study_folder / FOLDER, tmp_path / FOLDER)
    for path in (tmp_path / FOLDER).glob("models-*.json"):
        path.unlink()
    monkeypatch.setattr(steps, "fit_models", fail)
    with pytest.raises(
        PartialResultError,
        match=r"models: no model fits; .*begun for want of that: controllers, closed-loops, stability, model-distance, hunting, model-err",
    ):
        writing.run_study(config, tmp_path)
    partial = json.loads((tmp_path / "results.json").read_text())
    assert partial["partial"] is True
    assert [step["step"] for step in partial["failed_steps"]] == ["models", "models-of-table"]
    assert partial["skipped_steps"][0] == {"step": "controllers", "wants": ["models"]}
    whole = study_record(config, results, (), (), 0.0)
    for key in ("operating_point", "steady_map", "operating_range", "spectra", "frequency_response"):
        assert partial[key] == whole[key]
    assert not {"models", "controllers", "closed_loops", "figures"} & set(partial)
    page = (tmp_path / "report.html").read_text()
    for words in ("This report is partial", "no model fits", "240.8", "not begun"):
        assert words in page


def test_a_wrong_question_found_under_way_names_its_step_and_ends_the_study(
    config: StudyConfig, results: StudyResults, tmp_path: Path
) -> None:
    assert results.point.trim.stable  # the kernels are compiled by now
    wide = dataclasses.replace(config, half_range_deg=24.0)
    with pytest.raises(InvalidInputError, match=r"step steady-map of the study: study\.half_range_deg: range 1 to 49 deg"):
        compute_study(wide, tmp_path, lambda _, __: None)


def test_each_partial_record_holds_what_the_whole_one_does(config: StudyConfig, results: StudyResults) -> None:
    parts = Parts()
    for step in STEPS:
        parts = parts.with_result(step.name, step.field, getattr(results, step.field))
    record = partial_record(config, parts.with_result("guidelines", "guidelines", results.guidelines))
    whole = study_record(config, results, check_study(config, results), (), 0.0)
    assert {key: whole[key] for key in record if key in whole} == {key: value for key, value in record.items() if key in whole}
    assert set(whole) - set(record) == {"seconds", "step_responses", "linearity", "checks", "warnings"}
    text = render_html(partial_document(config, parts))
    assert "c2d_reduced" in text


def test_short_lags_get_short_steps_and_the_samples_stay(config: StudyConfig, results: StudyResults) -> None:
    """Lags of a fifth of the usual step, and one that shrinks below it only during the run."""
    engine = config.load_engine()
    parameters = lee1995_parameters(engine)
    quick = engine.with_parameters(parameters._replace(delays=parameters.delays._replace(spark_to_torque=0.05)))
    run = steps.throttle_run(quick, find_trim(quick, inputs={"throttle": 25.0}), signals.step(5.0, start=0.1), 0.5)
    assert np.allclose(np.diff(run.times), steps.STEP)
    assert run.output("engine_speed")[-1] > results.point.trim.output("engine_speed")
    tried: list[int] = []

    def shrinking(pieces: int) -> int:
        tried.append(pieces)
        if pieces < 8:
            message = "a lag fell below the step"
            raise StepError(message)
        return pieces

    assert steps.in_short_steps(shrinking, 1e-3, (1.0, 1e-3)) == 8
    assert tried == [2, 4, 8]
    with pytest.raises(AnalysisError, match=r"a lag of the engine is shorter than .* s, too short for a study"):
        steps.in_short_steps(shrinking, 1e-3, (1e-9,))


def test_no_accepted_model_and_no_straight_range_end_no_study(
    config: StudyConfig, results: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = Verdict(accepted=False, objections=("poor",), text="rejected: poor", numbers={})
    monkeypatch.setattr(steps, "judge_model", lambda _: refused)
    models = steps.fit_models(results.models.response)
    assert models.chosen == ""
    none = NoRange(tolerance=0.01, reason="bent")
    bent = dataclasses.replace(results, models=models, range=dataclasses.replace(results.range, widest=none))
    assert "widest" not in study_record(config, bent, (), (), 0.0)["operating_range"]
    warnings = list(writing.find_warnings(config, bent))
    assert any(text.startswith("no fitted model passes every test") for text in warnings)
    assert "no range chosen automatically: bent" in warnings


def test_a_command_needs_a_throttle_that_moves_the_speed() -> None:
    assert loop_steps.round_to_two(-60.147) == -60.0
    with pytest.raises(AnalysisError, match="does not move the speed at this operating point"):
        loop_steps.round_to_two(0.0)


def test_an_interrupted_study_says_so_and_goes_on(
    config: StudyConfig, results: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert results.point.trim.stable  # the kernels are compiled by now
    calls = []
    whole = steps.find_range

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(steps, "find_range", interrupted)
    with pytest.raises(PartialResultError, match=r"partial.*operating-point.*run the same command again"):
        writing.run_study(config, tmp_path)
    partial = json.loads((tmp_path / "results.json").read_text())
    assert partial["partial"] is True
    assert partial["finished_steps"] == ["operating-point"]
    page = (tmp_path / "report.html").read_text()
    assert "This study is not finished. Finished and kept: operating-point." in page
    assert not (tmp_path / "report.pdf").exists()

    def counted(*arguments: object) -> object:
        calls.append("point")
        return arguments

    monkeypatch.setattr(steps, "find_point", counted)
    monkeypatch.setattr(steps, "find_range", whole)
    monkeypatch.setattr(steps, "run_steps", interrupted)
    with pytest.raises(PartialResultError, match="steady-map"):
        writing.run_study(config, tmp_path)
    assert calls == []


def test_answers_to_other_questions_do_not_stay(
    config: StudyConfig, results: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A finished study whose folder is then used for other questions: no report may set the old answers under the new questions."""
    (tmp_path / FOLDER).mkdir()
    write_value(tmp_path / FOLDER / writing.QUESTIONS, config)
    write_value(tmp_path / FOLDER / writing.BUNDLE, results)
    write_value(tmp_path / FOLDER / writing.MADE, describe_making(config, config.load_engine(), results, 1.0))
    (tmp_path / "report.pdf").write_bytes(b"of the old answers")

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(writing, "compute_study", interrupted)
    with pytest.raises(PartialResultError, match="partial"):
        writing.run_study(StudyConfig(throttle_deg=26.0), tmp_path)
    assert not (tmp_path / "report.pdf").exists()
    with pytest.raises(InvalidInputError, match="holds no finished study"):
        writing.rebuild_report(tmp_path)


def test_a_report_made_again_is_the_same_to_the_byte(
    config: StudyConfig, results: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The date and the time that it took are those of the results, not of the report."""
    monkeypatch.setattr(writing, "compute_study", lambda *_: results)
    study = writing.run_study(config, tmp_path)
    files = ("report.html", "report.pdf", "results.json", "figures/figure_4.10.png", "figures/figure_4.10.svg", "tables/closed_loops.csv")
    first = {name: (tmp_path / name).read_bytes() for name in files}
    assert study.record["seconds"] > 0.0
    monkeypatch.setattr(made, "dt", None)  # no clock is asked for
    writing.rebuild_report(tmp_path)
    assert {name: (tmp_path / name).read_bytes() for name in files} == first


@pytest.mark.parametrize("name", [writing.QUESTIONS, writing.BUNDLE, writing.MADE])
def test_damaged_results_are_refused(config: StudyConfig, results: StudyResults, tmp_path: Path, name: str) -> None:
    (tmp_path / FOLDER).mkdir()
    write_engine(config.load_engine(), tmp_path / FOLDER / writing.ENGINE)
    for file, value in (
        (writing.QUESTIONS, config),
        (writing.BUNDLE, results),
        (writing.MADE, describe_making(config, config.load_engine(), results, 1.0)),
    ):
        write_value(tmp_path / FOLDER / file, value)
    path = tmp_path / FOLDER / name
    path.write_text(path.read_text()[: path.stat().st_size // 2])
    with pytest.raises(InvalidInputError, match=name):
        writing.rebuild_report(tmp_path)
    write_value(path, ("another value",))
    with pytest.raises(InvalidInputError, match="other values than a study's"):
        writing.rebuild_report(tmp_path)


def test_results_that_were_changed_are_refused(config: StudyConfig, results: StudyResults, tmp_path: Path) -> None:
    """A number changed in a file that still reads: the report may not show it as computed."""
    (tmp_path / FOLDER).mkdir()
    write_engine(config.load_engine(), tmp_path / FOLDER / writing.ENGINE)
    changed = dataclasses.replace(results, point=dataclasses.replace(results.point, gain=1.001 * results.point.gain))
    for file, value in (
        (writing.QUESTIONS, config),
        (writing.BUNDLE, changed),
        (writing.MADE, describe_making(config, config.load_engine(), results, 1.0)),
    ):
        write_value(tmp_path / FOLDER / file, value)
    with pytest.raises(InvalidInputError, match="results were changed since they were made"):
        writing.rebuild_report(tmp_path)


def test_a_report_is_made_again_of_the_engine_that_was_studied(
    results: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It shows the engine's parameters: the study keeps them, whatever became of the file, from wherever it is asked."""
    monkeypatch.chdir(tmp_path)
    text = format_engine(build_engine("lee1995"))
    Path("mine.toml").write_text(text)
    monkeypatch.setattr(writing, "compute_study", lambda *_: results)
    writing.run_study(StudyConfig(engine="mine.toml"), "out")
    first = Path("out/report.html").read_bytes()
    Path("mine.toml").unlink()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    writing.rebuild_report(tmp_path / "out")
    assert (tmp_path / "out/report.html").read_bytes() == first
    kept = tmp_path / "out" / FOLDER / writing.ENGINE
    kept.write_text(kept.read_text().replace("0.1454", "0.2"))
    with pytest.raises(InvalidInputError, match="not those that the results were made from"):
        writing.rebuild_report(tmp_path / "out")
