"""A state as a study file that `revline study` runs."""

import json

from revline.errors import InvalidInputError
from revline.studies.config import BUILT_IN
from revline.web.plants import find_point, place_of
from revline.web.state import State

ENGINE_FILE = "engine.toml"
"""Name of the file that a changed engine is saved as, beside the study file."""


def format_study(state: State) -> str:
    """Write a state as the text of a study file.

    The study has its own controllers, steps and times; what the state has of these is noted as comments. A changed engine is named as a
    file beside it.

    Raises:
        InvalidInputError: the operating point has no room for the study's amplitude or range.
        NoTrimError: the state has no operating point.
    """
    point = find_point(place_of(state))
    angle = point.trim.input("throttle")
    room = min(angle, 90.0 - angle)
    if state.amplitude_deg > room:
        message = f"amplitude_deg = {state.amplitude_deg:g} deg leaves 0 to 90 deg from {angle:.4g} deg; give {room:.4g} deg or less"
        raise InvalidInputError(message, control="amplitude_deg")
    engine = ENGINE_FILE if state.changed else state.engine
    lines = [
        'schema = "revline.study-file/1"',
        "",
        "[study]",
        f'engine = "{engine}"' + ("  # save the changed engine under this name beside this file" if engine == ENGINE_FILE else ""),
        f"throttle_deg = {angle!r}",
        f"load_n_m = {state.load_n_m!r}",
        f"amplitude_deg = {state.amplitude_deg!r}",
    ]
    if state.step == "command" and state.command_rad_s != 0.0:
        lines.append(f"command_rad_s = {state.command_rad_s!r}")
    if (engine, angle) != (BUILT_IN, 25.0):
        half = min(15.0, room)
        steps = [step for step in (5.0, 10.0) if angle + step <= 90.0] or [-5.0]
        lines += [f"half_range_deg = {half!r}", f"steps_deg = {steps!r}"]
    lines += ["", "# Also on the page, and no part of a study, which has controllers, steps and times of its own:", *_notes(state)]
    return "\n".join(lines) + "\n"


def _notes(state: State) -> list[str]:
    """What a study does not take, each line a comment."""
    entries: dict[str, object] = {"kp": state.kp, "ki": state.ki, "kd": state.kd, "low_deg": state.low_deg, "high_deg": state.high_deg}
    entries |= {"step": state.step, "until_s": state.until_s}
    if state.step == "load":
        entries["load_step_n_m"] = state.load_step_n_m
    if state.step == "throttle":
        entries["throttle_step_deg"] = state.throttle_step_deg
    if state.speed_rad_s is not None:
        entries["speed_rad_s"] = state.speed_rad_s
    return [f"# {name} = {json.dumps(value)}" for name, value in entries.items() if value is not None]
