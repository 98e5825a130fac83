"""Scheduled controllers in JSON: the gain schedule under "schedule", as `revline gain-map --schedule` writes it.

Beside it may stand the keys of a controller file for what an engine computer puts around its gains: "setpoint_weight", "sampling", ...
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.controller import PidGains
from revline.design.controllers.gain_schedule import GainSchedule, Scaling
from revline.design.controllers.scheduled_pid import ScheduledController
from revline.errors import InvalidInputError
from revline.io.controller_surroundings import law_words, parse_surroundings, surroundings_record
from revline.io.json_files import JsonRecord

KEY: Final = "schedule"
SCHEMA: Final = "revline.scheduled-controller/1"
RULE: Final = "schedule"


def is_schedule(record: JsonRecord) -> bool:
    """Whether a file's content is a gain schedule, or holds one."""
    return isinstance(record.entries.get(KEY), dict)


def table_record(schedule: GainSchedule) -> Mapping[str, object]:
    """Give a schedule's axes and tables as they stand under "schedule".

    Args:
        schedule: to be written.
    """
    axes = zip(schedule.names, schedule.units, (schedule.first, schedule.second), strict=True)
    return {
        "axes": [{"name": name, "unit": unit, "values": axis.tolist()} for name, unit, axis in axes],
        "kp": schedule.kp.tolist(),
        "ki": schedule.ki.tolist(),
        "kd": schedule.kd.tolist(),
        "powers_of_first_axis": schedule.scaling._asdict(),
        "interpolation": "bilinear in the gains divided by these powers; held at the ends",
    }


def scheduled_record(controller: ScheduledController, *, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give a scheduled controller as the content of a file that reads back as it.

    Args:
        controller: with what surrounds its gains.
        provenance: what writes it, from what.
    """
    units = controller.controller.gains.gain_units
    return {
        "schema": SCHEMA,
        **{f"{name}_unit": unit for name, unit in units.items()},
        "law": law_words(controller.controller),
        **surroundings_record(controller.controller),
        KEY: table_record(controller.schedule),
        "provenance": provenance,
    }


def parse_scheduled(record: JsonRecord, *, designed_on: str) -> ScheduledController:
    """Take a scheduled controller from the content of a file.

    Args:
        record: with a schedule.
        designed_on: what its gains are said to be designed on.

    Raises:
        InvalidInputError: see `parse_schedule` and `parse_surroundings`.
    """
    schedule = parse_schedule(record)
    unit = schedule.gain_unit.removesuffix(f"/({schedule.units[0]})")
    gains = PidGains(kp=0.0, ki=0.0, kd=0.0, input_unit=schedule.units[0], output_unit=unit, rule=RULE, designed_on=designed_on)
    return ScheduledController(controller=parse_surroundings(record, gains), schedule=schedule)


def parse_schedule(record: JsonRecord) -> GainSchedule:
    """Take the gain schedule from the content of a file.

    Args:
        record: of a gain map with a schedule.

    Raises:
        InvalidInputError: there is none, or a part of it is missing or of another form.
    """
    inner = JsonRecord(where=f'{record.where}, "{KEY}"', entries=record.entries[KEY])
    axes = inner.entries.get("axes")
    if not isinstance(axes, list) or len(axes) != 2 or not all(isinstance(axis, dict) for axis in axes):
        message = f'{inner.where}: "axes" is no list of two axes; give the file that `revline gain-map --schedule` wrote'
        raise InvalidInputError(message)
    parts = [JsonRecord(where=f"{inner.where}, axis {k + 1}", entries=axis) for k, axis in enumerate(axes)]
    values = [np.array(part.numbers("values")) for part in parts]
    powers = inner.entries.get("powers_of_first_axis", {})
    scaling = JsonRecord(where=f"{inner.where}, powers", entries=powers if isinstance(powers, dict) else {})
    kp, ki, kd = (_table(inner, name, (values[0].size, values[1].size)) for name in ("kp", "ki", "kd"))
    return GainSchedule(
        names=(parts[0].text("name", "engine_speed"), parts[1].text("name", "load_torque")),
        units=(parts[0].text("unit", "rad/s"), parts[1].text("unit", "N m")),
        gain_unit=record.text("kp_unit", "deg/(rad/s)"),
        first=values[0],
        second=values[1],
        kp=kp,
        ki=ki,
        kd=kd,
        scaling=Scaling(*(_power(scaling, name) for name in Scaling._fields)),
    )


def _power(record: JsonRecord, name: str) -> int:
    value = record.number(name)
    if value != int(value):
        message = f'{record.where}: "{name}" is {value:g}, and a whole power is wanted: 0, 1 or 2'
        raise InvalidInputError(message, key=name)
    return int(value)


def _table(record: JsonRecord, name: str, shape: tuple[int, int]) -> NDArray[np.float64]:
    rows = record.entries.get(name)
    try:
        table = np.array(rows, dtype=float)
    except (TypeError, ValueError):
        table = np.empty(0)
    if table.shape != shape or not np.all(np.isfinite(table)):
        message = f'{record.where}: "{name}" is no table of {shape[0]} rows of {shape[1]} finite numbers'
        raise InvalidInputError(message, key=name)
    return table
