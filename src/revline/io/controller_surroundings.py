"""What an engine computer puts around the gains of a PID controller, as keys of a controller file."""

import difflib
import math
from collections.abc import Mapping
from typing import Final

from revline.design.controllers.controller import LAW, PidGains
from revline.design.controllers.pid_controller import AntiWindup, Continuous, PidController, Timing
from revline.errors import InvalidInputError
from revline.io.json_files import JsonRecord
from revline.sampled import CrankSynchronous, FixedRate

NUMBERS: Final = (
    ("setpoint_weight", "setpoint_weight", 1.0),
    ("derivative_weight", "derivative_weight", 0.0),
    ("filter_time_s", "filter_time", 0.0),
    ("output_low", "low", -math.inf),
    ("output_high", "high", math.inf),
    ("rate_limit_per_s", "rate_limit", math.inf),
    ("dead_zone", "dead_zone", 0.0),
    ("measurement_step", "measurement_step", 0.0),
    ("output_step", "output_step", 0.0),
)
"""Keys that hold numbers, the attributes they stand for, and what holds where they are absent."""

OTHERS: Final = frozenset({"anti_windup", "tracking_time_s", "safe_output", "hold_samples", "sampling"})
OF_GAINS: Final = frozenset({"kp", "ki", "kd", "input_unit", "output_unit", "derivative_acts_on", "rule", "designed_on", "schema", "units"})
OF_SAMPLING: Final = frozenset({"kind", "period_s", "angle_rad", "computation_delay_s"})
NEAR: Final = 0.76
"""How alike a key must be to one that is read, 1 being the same, to be taken for it, misspelt: a forgotten unit is."""

FIXED_RATE, CRANK = "fixed-rate", "crank-synchronous"


def law_words(controller: PidController) -> str:
    """Say which law a controller's gains are meant for, its weights of the command and its filter in it.

    Args:
        controller: the controller.
    """
    if controller.setpoint_weight == 1.0 and controller.derivative_weight == controller.filter_time == 0.0:
        return LAW
    return (
        f"{LAW}; with weights {controller.setpoint_weight:g} and {controller.derivative_weight:g} of the command, "
        f"the derivative filtered with {controller.filter_time:g} s"
    )


def surroundings_record(controller: PidController) -> Mapping[str, object]:
    """Give what a controller has beside its gains as keys of a file; what is not there is left out.

    Args:
        controller: whose gains stand elsewhere.
    """
    found: dict[str, object] = {}
    for key, name, default in NUMBERS:
        value = getattr(controller, name)
        if value != default:
            found[key] = value
    found["anti_windup"] = controller.anti_windup.value
    if controller.tracking_time is not None:
        found["tracking_time_s"] = controller.tracking_time
    if controller.safe_output is not None:
        found["safe_output"] = controller.safe_output
    sampling = controller.sampling
    if isinstance(sampling, Continuous):
        return found
    found["hold_samples"] = controller.hold_samples
    kind: dict[str, object] = (
        {"kind": FIXED_RATE, "period_s": sampling.period}
        if isinstance(sampling, FixedRate)
        else {"kind": CRANK, "angle_rad": sampling.angle}
    )
    found["sampling"] = {**kind, "computation_delay_s": sampling.computation_delay}
    return found


def parse_surroundings(record: JsonRecord, gains: PidGains) -> PidController:
    """Read what a controller file says beside the gains.

    A sampled controller has anti-windup by clamping where the file says nothing of it, a continuous one none.

    Args:
        record: content of the file.
        gains: read from it.

    Raises:
        InvalidInputError: a key holds something else than it should, or a value is outside its range.
    """
    entries = record.entries
    _refuse_misspelt(record)
    values = {name: record.number(key) for key, name, _ in NUMBERS if key in entries}
    sampling = _sampling(record)
    default = AntiWindup.NONE if isinstance(sampling, Continuous) else AntiWindup.CLAMPING
    wish = record.text("anti_windup", default.value)
    if wish not in {kind.value for kind in AntiWindup}:
        message = f'{record.where}: "anti_windup" is "{wish}"; it is one of {", ".join(kind.value for kind in AntiWindup)}'
        raise InvalidInputError(message, key="anti_windup")
    return PidController(
        gains=gains,
        anti_windup=AntiWindup(wish),
        tracking_time=record.number("tracking_time_s") if "tracking_time_s" in entries else None,
        safe_output=record.number("safe_output") if "safe_output" in entries else None,
        hold_samples=_whole(record, "hold_samples", 5),
        sampling=sampling,
        **values,
    )


def _refuse_misspelt(record: JsonRecord) -> None:
    """A file may have any other keys, but not one that was hardly meant as another: it would be dropped."""
    known = {key for key, _, _ in NUMBERS} | OTHERS
    for key in record.entries.keys() - known - OF_GAINS:
        meant = difflib.get_close_matches(key.lower(), known, n=1, cutoff=NEAR)
        if meant:
            message = f'{record.where}: "{key}" is no key of a controller, and "{meant[0]}" is one; write that, or rename yours'
            raise InvalidInputError(message, key=key)


def _sampling(record: JsonRecord) -> Timing:
    found = record.entries.get("sampling")
    if found is None:
        return Continuous()
    if not isinstance(found, dict):
        message = f'{record.where}: "sampling" is {found!r}; write an object, for example {{"kind": "fixed-rate", "period_s": 0.01}}'
        raise InvalidInputError(message, key="sampling")
    inner = JsonRecord(where=f'{record.where}, "sampling"', entries=found)
    unknown = sorted(found.keys() - OF_SAMPLING)
    if unknown:
        message = f'{inner.where}: "{unknown[0]}" is unknown; there are {", ".join(sorted(OF_SAMPLING))}'
        raise InvalidInputError(message, key=unknown[0])
    kind = inner.text("kind", FIXED_RATE)
    delay = inner.number("computation_delay_s") if "computation_delay_s" in found else 0.0
    if kind == FIXED_RATE:
        return FixedRate(period=inner.number("period_s"), computation_delay=delay)
    if kind == CRANK:
        return CrankSynchronous(angle=inner.number("angle_rad"), computation_delay=delay)
    message = f'{inner.where}: "kind" is "{kind}"; it is {FIXED_RATE} or {CRANK}, and a continuous controller has no "sampling"'
    raise InvalidInputError(message, key="kind")


def _whole(record: JsonRecord, key: str, default: int) -> int:
    value = record.number(key) if key in record.entries else float(default)
    if value != int(value):
        message = f'{record.where}: "{key}" is {value:g}, and a whole number is wanted'
        raise InvalidInputError(message, key=key)
    return int(value)
