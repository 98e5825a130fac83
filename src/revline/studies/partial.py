"""The report of a study that is not finished: that it is partial, what is missing and why, and the numbers that are there."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from revline.report.blocks import Align, Column, DefinitionList, ItemList, Paragraph, TableBlock
from revline.report.document import Document, Section
from revline.report.html import write_html
from revline.report.inline import plain
from revline.report.numbers import format_number
from revline.studies.config import StudyConfig
from revline.studies.content import make_partial_document
from revline.studies.parts import Parts
from revline.studies.record import partial_record

DIGITS = 5

TABLES = (
    ("steady_map", "Steady states", ("throttle_deg", "speed_rad_s", "pressure_kpa", "stable")),
    ("spectra", "Spectral check", ("frequency_rad_s", "peak_rad_s", "resolution_rad_s", "distortion")),
    ("frequency_response", "Frequency response", ("method", "frequency_rad_s", "amplitude_rad_s", "phase_deg")),
    ("closed_loops", "Closed loops", ("controller", "plant", "outcome", "overshoot")),
    ("model_errors", "Errors of the models in time", ("input", "frequency_rad_s", "model", "max_abs_error_rad_s", "rms_error_rad_s")),
)
"""Lists of results.json that are shown: key, caption, columns."""

NAMED = (
    ("models", "Models", ("numerator", "denominator", "delay_s", "verdict")),
    ("controllers", "Controllers", ("kp", "ki", "kd", "rule", "designed_on")),
)
"""Mappings of results.json that are shown as tables, their keys in the first column."""


def write_partial_report(config: StudyConfig, parts: Parts, path: Path) -> None:
    """Write the page of a study that is not finished.

    Raises:
        InvalidInputError: the file cannot be written.
    """
    write_html(partial_document(config, parts), path)


def partial_document(config: StudyConfig, parts: Parts) -> Document:
    """What there is of a study, as a document that says that it is partial."""
    record, head = partial_record(config, parts), make_partial_document(config, parts.finished)
    return replace(
        head,
        partial=f"This report is partial. The study {parts.text}." if parts.failed else f"This report is partial. {plain(head.partial)}",
        sections=(
            Section(title="What there is", anchor="steps", blocks=(ItemList(items=tuple(_states(parts))),)),
            Section(title="Results so far", anchor="results", blocks=tuple(_results(record))),
        ),
    )


def _states(parts: Parts) -> Iterator[str]:
    yield f"finished: {', '.join(parts.finished) or 'nothing yet'}"
    yield from (f"failed: {step.name}: {step.reason}" for step in parts.failed)
    yield from (f"not begun: {step.name}, which needs {', '.join(step.wants)}" for step in parts.skipped)


def _results(record: Mapping[str, Any]) -> Iterator[Any]:
    if "operating_point" not in record:
        yield Paragraph("There are none yet.")
        return
    for key in ("operating_point", "operating_range"):
        entries = [(name, value) for name, value in record.get(key, {}).items() if not isinstance(value, dict)]
        if entries:
            yield DefinitionList(items=tuple((name, _cell(value)) for name, value in entries))
    for key, caption, columns in TABLES:
        if record.get(key):
            yield _table(caption, columns, record[key])
    for key, caption, columns in NAMED:
        if record.get(key):
            yield _table(caption, ("name", *columns), [{"name": name, **row} for name, row in record[key].items()])


def _table(caption: str, columns: tuple[str, ...], rows: list[dict[str, Any]]) -> TableBlock:
    return TableBlock(
        caption=caption,
        columns=tuple(Column(heading=name, align=Align.LEFT) for name in columns),
        rows=tuple(tuple(_cell(row[name]) if name in row else "" for name in columns) for row in rows),
    )


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(_cell(entry) for entry in value)
    return value if isinstance(value, str) else format_number(value, DIGITS)
