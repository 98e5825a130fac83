"""Controller files: a PID controller in JSON, its gains with units, law and origin, and what an engine computer puts around them.

    {"schema": "revline.controller/1", "kp": 1.2, "ki": 2.0, "kd": 0.1, "input_unit": "rad/s", "output_unit": "deg",
     "rule": "fine-tuned", "designed_on": "g2d", ...}

The three gains must be there; units are those above where a file names none. What else a controller has stands in further keys,
each of which may be left out:

    "setpoint_weight": 0.6, "derivative_weight": 0, "filter_time_s": 0.01, "output_low": 0, "output_high": 79.46, "rate_limit_per_s": 200,
    "anti_windup": "none" | "clamping" | "back-calculation", "tracking_time_s": 0.5, "dead_zone": 0, "measurement_step": 0.1,
    "output_step": 0.05, "hold_samples": 5, "safe_output": 10,
    "sampling": {"kind": "fixed-rate", "period_s": 0.01, "computation_delay_s": 0} | {"kind": "crank-synchronous", "angle_rad": 3.14159}

More keys may stand in the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

from revline.design.controllers.controller import LAW, PidGains
from revline.design.controllers.pid_controller import PidController
from revline.errors import InvalidInputError
from revline.io.controller_surroundings import law_words, parse_surroundings, surroundings_record
from revline.io.json_files import JsonRecord, read_json, write_json

SCHEMA: Final = "revline.controller/1"
WHAT: Final = "controller file"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControllerFile:
    """What a controller file holds.

    Attributes:
        where: the file, for messages.
        controller: all that the file says of it.
        provenance: what wrote the file, from what.
    """

    where: str
    controller: PidController
    provenance: Mapping[str, float | str]

    @property
    def gains(self) -> PidGains:
        """The gains, for what knows nothing but the law of `revline.design.controllers.pid_system`.

        Raises:
            InvalidInputError: the controller is more than that, and what is more would be dropped.
        """
        return self._only_gains(self.controller)

    @property
    def feedback_gains(self) -> PidGains:
        """The gains, for what asks for the loop alone, on which a set-point weight has no influence.

        Raises:
            InvalidInputError: the controller is more than that, and what is more would be dropped.
        """
        return self._only_gains(replace(self.controller, setpoint_weight=1.0, derivative_weight=0.0))

    def _only_gains(self, controller: PidController) -> PidGains:
        extras = controller.extras
        if extras:
            message = (
                f"{self.where}: the controller has {', '.join(extras)}, which would be dropped here: this knows the law {LAW} alone; "
                "leave those keys out, or use what takes a controller as it is: `loop`, `margins`, `accept` and `export`"
            )
            raise InvalidInputError(message)
        return controller.gains


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
    _check_units(record, gains)
    controller = parse_surroundings(record, gains)
    return ControllerFile(where=record.where, controller=controller, provenance=MappingProxyType(record.notes("provenance")))


def _check_units(record: JsonRecord, gains: PidGains) -> None:
    """The units that a file states beside its gains must be those that they are taken in."""
    stated = record.notes("units")
    for name, unit in gains.gain_units.items():
        if stated.get(name, unit) != unit:
            message = (
                f'{record.where}: "units" has {name} in {stated[name]}, and with "input_unit" {gains.input_unit} and "output_unit" '
                f"{gains.output_unit} it is in {unit}; convert the gain, or mend these keys"
            )
            raise InvalidInputError(message, key="units")


def write_controller(path: str | Path, controller: PidGains | PidController, *, provenance: Mapping[str, float | str]) -> None:
    """Write a controller file; it reads back to the last bit.

    Args:
        path: the file; replaced if it is there.
        controller: its gains, or all of it.
        provenance: what writes it, from what: program, version, files.

    Raises:
        InvalidInputError: a detail has no JSON form, or the file cannot be written.
    """
    write_json(path, controller_record(controller, provenance=provenance), WHAT)


def controller_record(controller: PidGains | PidController, *, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give the content of a controller file, for writing or showing.

    Args:
        controller: its gains, or all of it.
        provenance: what writes it, from what: program, version, files.
    """
    gains = controller.gains if isinstance(controller, PidController) else controller
    return {
        "schema": SCHEMA,
        "kp": gains.kp,
        "ki": gains.ki,
        "kd": gains.kd,
        "units": gains.gain_units,
        "input_unit": gains.input_unit,
        "output_unit": gains.output_unit,
        "law": law_words(controller) if isinstance(controller, PidController) else LAW,
        "derivative_acts_on": gains.derivative_acts_on,
        "rule": gains.rule,
        "designed_on": gains.designed_on,
        **(surroundings_record(controller) if isinstance(controller, PidController) else {}),
        "details": gains.details,
        "provenance": provenance,
    }
