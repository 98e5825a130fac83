"""Model files: a transfer function with exact delay in JSON, with units and origin.

    {"schema": "revline.model/1", "name": "g2d", "numerator": [12.0], "denominator": [1.0, 0.55, 0.034], "delay_s": 0.021,
     "input_name": "throttle", "input_unit": "deg", "output_name": "engine_speed", "output_unit": "rad/s", ...}

Coefficients stand in ascending powers of s. Numerator, denominator and delay must be there; units are those above where a file names
none. Poles and zeros are written for people and not read. More keys may stand in the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from revline.errors import InvalidInputError
from revline.io.json_files import JsonRecord, read_json, write_json
from revline.lti.response import Complexes
from revline.lti.transfer_function import TransferFunction

SCHEMA: Final = "revline.model/1"
WHAT: Final = "model file"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelFile:
    """What a model file holds.

    Attributes:
        name: of the model, for people and for the controllers designed on it.
        model: the transfer function.
        provenance: what wrote the file, from what.
    """

    name: str
    model: TransferFunction
    provenance: Mapping[str, float | str]


def read_model(path: str | Path) -> ModelFile:
    """Read a model file.

    Args:
        path: the file; its stem is the model's name where the file gives none.

    Raises:
        InvalidInputError: the file cannot be read, is no model file, lacks a part, or holds what makes no transfer function.
    """
    return parse_model(read_json(path, WHAT), name=Path(path).stem or "model")


def parse_model(record: JsonRecord, *, name: str) -> ModelFile:
    """Take the model from the content of a model file.

    Args:
        record: the content.
        name: of the model where the content gives none.

    Raises:
        InvalidInputError: see `read_model`.
    """
    record.require_schema(SCHEMA)
    numerator, denominator = record.numbers("numerator"), record.numbers("denominator")
    delay = record.number("delay_s")
    signals = {
        key: record.text(key, default)
        for key, default in (("input_name", "throttle"), ("input_unit", "deg"), ("output_name", "engine_speed"), ("output_unit", "rad/s"))
    }
    try:
        model = TransferFunction(numerator=numerator, denominator=denominator, delay=delay, **signals)
    except InvalidInputError as error:
        message = f"{record.where}: {error}"
        raise InvalidInputError(message, **error.details) from error
    return ModelFile(name=record.text("name", name), model=model, provenance=MappingProxyType(record.notes("provenance")))


def write_model(path: str | Path, model: TransferFunction, *, name: str, provenance: Mapping[str, float | str]) -> None:
    """Write a model file; it reads back to the last bit.

    Args:
        path: the file; replaced if it is there.
        model: the transfer function.
        name: of the model.
        provenance: what writes it, from what: program, version, files, how it was fitted.

    Raises:
        InvalidInputError: a note has no JSON form, or the file cannot be written.
    """
    write_json(path, model_record(model, name=name, provenance=provenance), WHAT)


def model_record(model: TransferFunction, *, name: str, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give the content of a model file, for writing or showing.

    Args:
        model: the transfer function.
        name: of the model.
        provenance: what writes it, from what.
    """
    return {
        "schema": SCHEMA,
        "name": name,
        "numerator": model.numerator,
        "denominator": model.denominator,
        "delay_s": model.delay,
        "input_name": model.input_name,
        "input_unit": model.input_unit,
        "output_name": model.output_name,
        "output_unit": model.output_unit,
        "poles": _pairs(model.poles),
        "zeros": _pairs(model.zeros),
        "provenance": provenance,
    }


def _pairs(numbers: Complexes) -> list[list[float]]:
    return [[float(z.real), float(z.imag)] for z in numbers]
