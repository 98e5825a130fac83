"""What single questions are about: engines at a trim, and models and controllers that come in the request."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim, find_trim
from revline.errors import InvalidInputError
from revline.io.controller_files import ControllerFile, parse_controller
from revline.io.csv_table import CsvTable, parse_csv_table
from revline.io.json_files import JsonRecord
from revline.io.model_files import ModelFile, parse_model
from revline.lti.state_space import DelayStateSpace
from revline.system import DelaySystem
from revline.web.parameters import changed_engine
from revline.web.questions import AnyPlant, OnEngine

WANTING = "neither a model nor throttle_deg is given; give the content of a model file as model, or the throttle angle of the engine's trim"

OF_ROWS: Final = MappingProxyType({"input_name": "throttle", "input_unit": "deg", "output_name": "engine_speed", "output_unit": "rad/s"})
"""Rows of a response are of the engine's speed to its throttle."""


class EngineAtTrim(NamedTuple):
    """An engine, its trim, and how messages call both."""

    engine: DelaySystem
    trim: Trim
    name: str

    @property
    def linear(self) -> DelayStateSpace:
        """The exact linear model."""
        return linearize(self.engine, self.trim).model


def engine_of(asked: OnEngine) -> DelaySystem:
    """Build the engine that is asked about.

    Raises:
        InvalidInputError: there is none of that name, or a parameter is none or out of range.
    """
    return changed_engine(asked.engine, tuple(sorted(asked.parameters.items())))


def at_trim(asked: OnEngine, throttle: float | None) -> EngineAtTrim:
    """Find the trim that is asked about.

    Raises:
        InvalidInputError: there is no throttle angle, or the engine is none.
        NoTrimError: the engine has no trim there.
    """
    if throttle is None:
        raise InvalidInputError(WANTING, control="throttle_deg")
    engine = engine_of(asked)
    trim = find_trim(engine, inputs={"throttle": throttle, "load_torque": asked.load_n_m})
    return EngineAtTrim(engine, trim, f"{engine.name} at {throttle:g} deg, {asked.load_n_m:g} N m")


def model_of(asked: AnyPlant) -> ModelFile | None:
    """Take the model out of a question, if there is one.

    Raises:
        InvalidInputError: the content is none of a model file.
    """
    return None if asked.model is None else parse_model(JsonRecord(where="model", entries=asked.model), name="model")


def refuse_engine(asked: AnyPlant) -> None:
    """Refuse an engine beside what has its own operating point, lest it be ignored.

    Raises:
        InvalidInputError: there is one.
    """
    if asked.throttle_deg is not None or asked.load_n_m != 0.0 or asked.parameters or asked.engine != "lee1995":
        message = "engine, parameters, throttle_deg and load_n_m place an engine's trim; a model has its own, leave them out"
        raise InvalidInputError(message, control="model")


def content_of(entries: Mapping[str, Any], name: str = "controller") -> JsonRecord:
    """Take the content of a file out of a question."""
    return JsonRecord(where=name, entries=entries)


def controller_of(entries: Mapping[str, Any], name: str = "controller") -> ControllerFile:
    """Take a controller out of a question.

    Raises:
        InvalidInputError: the content is none of a controller file.
    """
    return parse_controller(content_of(entries, name))


def table_of(csv: str | None, rows: Sequence[Mapping[str, Any]] | None, name: str) -> CsvTable:
    """Take a response's table out of a question: the text of a CSV file, or rows.

    Raises:
        InvalidInputError: there are both or neither, or they are no table.
    """
    if (csv is None) == (rows is None):
        message = "give a response either as csv, the text of a file, or as frequency_response, a list of rows"
        raise InvalidInputError(message, control="csv")
    if csv is not None:
        return parse_csv_table(csv, Path(name))
    listed = list(rows or ())
    header = tuple(key for key, value in listed[0].items() if _is_number(value)) if listed else ()
    if not header:
        message = f"{name}: frequency_response has no row with numbers; give rows such as those that the question response answers with"
        raise InvalidInputError(message, control="frequency_response")
    cells = []
    for position, row in enumerate(listed, start=1):
        if not all(_is_number(row.get(key)) for key in header):
            message = f"{name}, row {position}: {', '.join(header)} are not all numbers as in the first row; give the same keys in each"
            raise InvalidInputError(message, control="frequency_response")
        cells.append(tuple(repr(float(row[key])) for key in header))
    return CsvTable(
        path=Path(name), header=header, rows=tuple(cells), lines=tuple(range(1, len(cells) + 1)), header_line=0, metadata=OF_ROWS
    )


def _is_number(value: object) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


class Unwatched:
    """Nobody is told how far a computation is."""

    def progress(self, text: str) -> AbstractContextManager[Callable[[float], None]]:  # noqa: ARG002 - the form of all that are told
        """Give what is told, and tells nobody."""
        return nullcontext(_ignore)


def _ignore(_: float) -> None:
    """Where nobody looks."""
