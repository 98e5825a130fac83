"""Gain schedules in JSON, as `revline gain-map --schedule` writes them: alone, or under "schedule" in a gain map."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from revline.design.gain_schedule import GainSchedule, Scaling
from revline.errors import InvalidInputError
from revline.io.json_files import JsonRecord

KEY: Final = "schedule"


def is_schedule(record: JsonRecord) -> bool:
    """Whether a file's content is a gain schedule, or holds one."""
    return isinstance(record.entries.get(KEY), dict)


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
        scaling=Scaling(*(int(scaling.number(name)) for name in Scaling._fields)),
    )


def schedule_tables(schedule: GainSchedule) -> dict[str, object]:
    """Give a schedule in the form that `parse_schedule` takes, but for its unit.

    Args:
        schedule: of gains.
    """
    axes = zip(schedule.names, schedule.units, (schedule.first, schedule.second), strict=True)
    return {
        "axes": [{"name": name, "unit": unit, "values": axis.tolist()} for name, unit, axis in axes],
        "kp": schedule.kp.tolist(),
        "ki": schedule.ki.tolist(),
        "kd": schedule.kd.tolist(),
        "powers_of_first_axis": schedule.scaling._asdict(),
    }


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
