"""Controller files: the gains of a PID controller in JSON, with units, law and origin.

    {"schema": "revline.controller/1", "kp": 1.2, "ki": 2.0, "kd": 0.1, "input_unit": "rad/s", "output_unit": "deg",
     "rule": "fine-tuned", "designed_on": "g2d", ...}

The three gains must be there; units are those above where a file names none. More keys may stand in the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from revline.design.controller import LAW, PidGains
from revline.errors import InvalidInputError
from revline.io.json_files import JsonRecord, read_json, write_json

SCHEMA: Final = "revline.controller/1"
WHAT: Final = "controller file"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControllerFile:
    """What a controller file holds.

    Attributes:
        gains: of the controller.
        provenance: what wrote the file, from what.
    """

    gains: PidGains
    provenance: Mapping[str, float | str]


def read_controller(path: str | Path) -> ControllerFile:
    """Read a controller file.

    Args:
        path: the file.

    Raises:
        InvalidInputError: the file cannot be read, is no controller file, lacks a gain, or holds one that is no finite number; or its
            derivative acts on something else than the measurement.
    """
    return parse_controller(read_json(path, WHAT))


def parse_controller(record: JsonRecord) -> ControllerFile:
    """Take the gains from the content of a controller file.

    Raises:
        InvalidInputError: see `read_controller`.
    """
    record.require_schema(SCHEMA)
    acts_on = record.text("derivative_acts_on", PidGains.derivative_acts_on)
    if acts_on != PidGains.derivative_acts_on:
        message = (
            f'{record.where}: "derivative_acts_on" is "{acts_on}", and all methods here have the derivative on the '
            f'"{PidGains.derivative_acts_on}"; design gains for that law: {LAW}'
        )
        raise InvalidInputError(message, key="derivative_acts_on")
    gains = PidGains(
        kp=record.number("kp"),
        ki=record.number("ki"),
        kd=record.number("kd"),
        input_unit=record.text("input_unit", "rad/s"),
        output_unit=record.text("output_unit", "deg"),
        rule=record.text("rule", "by hand"),
        designed_on=record.text("designed_on", "not stated"),
        details=record.notes("details"),
    )
    return ControllerFile(gains=gains, provenance=MappingProxyType(record.notes("provenance")))


def write_controller(path: str | Path, gains: PidGains, *, provenance: Mapping[str, float | str]) -> None:
    """Write a controller file; it reads back to the last bit.

    Args:
        path: the file; replaced if it is there.
        gains: of the controller.
        provenance: what writes it, from what: program, version, files.

    Raises:
        InvalidInputError: a detail has no JSON form, or the file cannot be written.
    """
    write_json(path, controller_record(gains, provenance=provenance), WHAT)


def controller_record(gains: PidGains, *, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give the content of a controller file, for writing or showing.

    Args:
        gains: of the controller.
        provenance: what writes it, from what: program, version, files.
    """
    return {
        "schema": SCHEMA,
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "units": gains.gain_units,
        "input_unit": gains.input_unit,
        "output_unit": gains.output_unit,
        "law": LAW,
        "derivative_acts_on": gains.derivative_acts_on,
        "rule": gains.rule,
        "designed_on": gains.designed_on,
        "details": gains.details,
        "provenance": provenance,
    }
