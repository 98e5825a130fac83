"""The report says what the numbers say, and sets the thesis's numbers beside only where they belong."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from revline.design.loops.outcome import Settled
from revline.engine.catalogue import build_engine
from revline.lti.response import FrequencyResponse
from revline.report.blocks import TableBlock
from revline.report.document import Document
from revline.report.inline import plain
from revline.studies import content, content_models, steps
from revline.studies.captions import caption, figure_description, figure_title
from revline.studies.checks import check_study
from revline.studies.config import StudyConfig
from revline.studies.figures import figure_calls
from revline.studies.guidelines import write_guidelines
from revline.studies.made import Made, describe_making
from revline.studies.material import Material
from revline.studies.results import LoopRow
from revline.studies.study_results import StudyResults
from revline.studies.tables import study_tables
from revline.studies.writing import find_warnings

pytestmark = pytest.mark.slow


def material_of(config: StudyConfig, results: StudyResults, made: Made | None = None) -> Material:
    return Material(
        config=config,
        engine=config.load_engine(),
        results=results,
        checks=check_study(config, results),
        warnings=tuple(find_warnings(config, results)),
        figures=Path("figures"),
        made=made or describe_making(config, config.load_engine(), results, 1.0),
    )


def tables_of(document: Document) -> dict[str, TableBlock]:
    blocks = [block for entry in document.entries() for block in entry.section.blocks]
    return {plain(block.caption): block for block in blocks if isinstance(block, TableBlock)}


def words_of(document: Document) -> str:
    return " ".join(plain(text) for text in document.abstract)


def test_each_table_has_the_thesis_s_numbers_beside_ours(config: StudyConfig, results: StudyResults) -> None:
    tables = tables_of(content.make_document(material_of(config, results)))
    gains = {row[0]: row for row in tables["Gains"].rows}
    assert gains["C1"][3:] == ("2.154", "16.85", "0", "2.153", "16.85", "0")
    assert gains["C2, tuned"][6:] == ("20", "illegible", "0.4")
    assert gains["C2, first (with gain)"][6:] == ("\N{EN DASH}", "\N{EN DASH}", "\N{EN DASH}")
    assert [row[3:] for row in tables["Tangents to the step responses"].rows] == [("0.04", "0.66"), ("0.07", "0.65")]
    loops = {row[:2]: row[-1] for row in tables["Closed loops"].rows}
    assert loops["C1", "engine"] == "limit cycle"
    assert loops["C1", "G1"] == "overshoot below 8 %, bandwidth 50.77 rad/s read from a plot"
    response = tables["Frequency response from throttle to speed"]
    at_six = next(row for row in response.rows if row[0] == "6")
    assert at_six[-4:] == ("18.38", "\N{MINUS SIGN}93.3", "+1.26", "\N{MINUS SIGN}1.72")


def test_another_study_has_no_thesis_s_numbers_beside(results: StudyResults) -> None:
    other = StudyConfig(throttle_deg=26.0)
    alone = dataclasses.replace(results, table_models=())
    tables = tables_of(content.make_document(material_of(other, alone)))
    for table in tables.values():
        heads = {column.group for column in table.columns} | {plain(column.heading) for column in table.columns}
        assert not any("Lee" in head or "1995" in head or "Table 4.1" in head for head in heads), table.caption
        assert not any("illegible" in plain(cell) or plain(cell) == "print, 1995" for row in table.rows for cell in row)


def test_other_questions_at_the_thesis_s_point_have_no_outcomes_of_its_controllers_beside(results: StudyResults) -> None:
    """Lee's C1 was placed elsewhere and asked for +60 rad/s: beside others it would compare what was never compared."""
    for other in (StudyConfig(command_rad_s=-30.0), StudyConfig(natural_frequency_rad_s=10.0)):
        material = material_of(other, results)
        document = content.make_document(material)
        tables = tables_of(document)
        for name in ("Gains", "Tangents to the step responses", "Closed loops"):
            assert not any("Lee" in column.group or "Lee" in plain(column.heading) for column in tables[name].columns)
        assert plain(document.subtitle).startswith("A study after Lee (1995)")
        assert any("not every question is the thesis's" in warning for warning in material.warnings)


def test_table_4_1_stands_beside_its_own_frequencies_only(config: StudyConfig, results: StudyResults) -> None:
    """As many frequencies are not the same frequencies: each line would be compared with another's."""
    shifted = StudyConfig(frequencies=tuple(1.01 * w for w in config.frequencies))
    assert not any("Lee" in column.group for column in content_models.response_table(shifted, results).columns)
    assert any("Lee" in column.group for column in content_models.response_table(config, results).columns)
    headers = {table.name: [column.header for column in table.columns] for table in study_tables(shifted, results)}
    assert not any("table_4_1" in header for header in headers["frequency_response"])


def test_the_engine_s_section_has_the_parameters_of_its_engine(config: StudyConfig, results: StudyResults) -> None:
    rows = tables_of(content.make_document(material_of(config, results)))["Parameters of the engine"].rows
    values = {plain(row[0]): row[2:4] for row in rows}
    assert len(values) == len(rows) == 26
    assert values["theta_1"] == ("5.48", "rad")
    assert values["a_2"] == ("\N{MINUS SIGN}31000", "1/kg²")
    assert values["f_0"] == ("15.1", "N\N{NO-BREAK SPACE}m")
    generic = dataclasses.replace(config, engine="lee1995-generic")
    rows = tables_of(content.make_document(material_of(generic, results)))["Parameters of the engine"].rows
    assert {"b_0", "omega_1"} <= {plain(row[0]) for row in rows}
    assert build_engine("lee1995-generic").parameters != build_engine("lee1995").parameters


def test_the_abstract_follows_the_outcomes(config: StudyConfig, results: StudyResults) -> None:
    told = words_of(content.make_document(material_of(config, results)))
    assert "C1 and C2, which settle on models without delay, do not on the engine: C1 hunts" in told
    assert "tells beforehand which of them settle" in told

    def tame(row: LoopRow) -> LoopRow:
        if (row.controller, row.plant) != ("c1", "engine"):
            return row
        outcome = Settled(value=row.run.target, steady_error=0.0, residual=0.0)
        return row._replace(run=dataclasses.replace(row.run, outcome=outcome))

    loops = dataclasses.replace(results.loops, rows=tuple(tame(row) for row in results.loops.rows))
    told = words_of(content.make_document(material_of(config, dataclasses.replace(results, loops=loops))))
    assert "C2, which settles on a model without delay, does not on the engine: C2 hunts" in told
    assert "does not tell beforehand" in told


def test_guidelines_follow_the_outcomes(config: StudyConfig, results: StudyResults) -> None:
    """A loop that hunts has no overshoot to compare, and a reduced gain that overshoots less does not swing slowly."""
    told = write_guidelines(config.load_engine(), results)
    assert any("the overshoot differs by 0.2 percentage points" in line for line in told)
    assert any(line.startswith("Too little proportional gain swings slowly") for line in told)
    hunting, calm = (results.loops.row(name, "engine").run for name in ("c1", "c2d"))

    def other(row: LoopRow) -> LoopRow:
        if row.plant != "engine":
            return row
        return {"c2d": row._replace(run=hunting), "c2d_reduced": row._replace(run=calm)}.get(row.controller, row)

    loops = dataclasses.replace(results.loops, rows=tuple(other(row) for row in results.loops.rows))
    told = write_guidelines(config.load_engine(), dataclasses.replace(results, loops=loops))
    assert not any("percentage points" in line for line in told)
    loops = dataclasses.replace(loops, rows=tuple(row if row.controller != "c2d" else row._replace(run=calm) for row in loops.rows))
    told = write_guidelines(config.load_engine(), dataclasses.replace(results, loops=loops))
    assert any(line.startswith("With a tenth of C2d's proportional gain") for line in told)


def test_the_errors_of_the_line_are_called_what_they_are(config: StudyConfig, results: StudyResults) -> None:
    """At 10 deg the line lies below the speed of 64.467 rad/s: line less speed is negative there."""
    call = figure_calls(config, config.load_engine(), results)["4.2b"]
    (curve,) = call.arguments[0]
    line = results.range.line
    assert curve.y[0] == pytest.approx(line.slope * 10.0 + line.intercept - 64.467, abs=1e-3)
    assert curve.y[0] < 0.0
    assert call.arguments[2].name == "straight line less speed"
    assert call.options["notes"][0].text == "\N{MINUS SIGN}2.23 rad/s at 10 deg"


def test_titles_hold_the_study_s_own_numbers(results: StudyResults) -> None:
    """The thesis's list of figures says 5 deg; a study of 3 deg may not."""
    excitation = dataclasses.replace(results.response.excitation, amplitude=3.0)
    other = dataclasses.replace(results, response=dataclasses.replace(results.response, excitation=excitation))
    assert figure_title("6.2", other) == "Speed errors of G1, G2 and G2d after a 3 deg step"
    assert figure_title("6.2", results) == "Speed errors of G1, G2 and G2d after a 5 deg step"


def test_descriptions_name_the_axes_and_no_number_of_another_study(results: StudyResults) -> None:
    """The thesis's list says "5 and 10 deg steps from 25 deg" and "limit cycle", which another study may not have."""
    assert figure_description("3.7", results) == "Throttle steps: throttle (deg) over time (s)"
    assert figure_description("5.9", results) == "Engine with C1: speed (rad/s) over time (s)"


def test_a_spectrum_s_caption_does_not_call_its_peak_the_highest_line_of_all(results: StudyResults) -> None:
    """At 50 rad/s the line at zero, by which the mean speed moved, is three times as high as that of the input."""
    fast = results.spectra[-1].spectrum
    assert fast.zero_line > fast.peak_amplitude
    assert "But for the mean, the highest line is at the input's frequency" in caption("4.9", results)


def test_a_study_whose_models_are_all_rejected_goes_on_and_says_so(config: StudyConfig, results: StudyResults) -> None:
    omega = np.geomspace(0.05, 60.0, 30)
    s = 1j * omega
    values = 12.0 * (1.0 + 0.001 * s + 0.01 * s**2) / (1.0 + 0.6 * s + 0.07 * s**2 + 0.01 * s**3 + 0.001 * s**4) * np.exp(-0.02 * s)
    response = FrequencyResponse(
        omega=omega, values=values, input_name="throttle", input_unit="deg", output_name="engine_speed", output_unit="rad/s"
    )
    models = steps.fit_models(response)
    assert models.chosen == ""
    assert not any(verdict.accepted for verdict in models.verdicts)
    rejected = dataclasses.replace(results, models=models)
    assert any("no fitted model passes every test" in warning for warning in find_warnings(config, rejected))
    section = content_models.models_section(material_of(config, rejected))
    assert any("No model passes every test" in plain(getattr(block, "title", "")) for block in section.blocks)


def test_the_report_says_with_what_it_was_made(config: StudyConfig, results: StudyResults) -> None:
    made = dataclasses.replace(describe_making(config, config.load_engine(), results, 12.3), version="0.0.9", on="2001-02-03 04:05 UTC")
    lines = dict(content.make_document(material_of(config, results, made)).provenance)
    assert lines["results by"].startswith("revline 0.0.9, code ")
    assert "report by" in lines  # another version's results say whose report this is
    assert lines["made on"] == "2001-02-03 04:05 UTC"
    assert all(name in lines["with"] for name in ("Python", "numpy", "scipy", "numba", "matplotlib"))
    assert lines["numbers in"].startswith("12.3 s")
    again = dict(content.make_document(material_of(config, results)).provenance)
    assert "report by" not in again


def test_an_unfinished_study_is_told_as_such(config: StudyConfig) -> None:
    document = content.make_partial_document(config, ["operating-point", "steady-map"])
    assert "Finished and kept: operating-point, steady-map." in plain(document.partial)
    assert "No step is finished." in plain(content.make_partial_document(config, []).partial)
