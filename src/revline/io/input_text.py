"""Input signals as text, as `revline simulate --input` takes them.

    step:5@0.5              5 deg up at 0.5 s, at once
    step:5@0.5/0.01         the same, rising over 0.01 s
    ramp:5@0.5/0.2          to 5 deg, from 0.5 s on, over 0.2 s
    sine:5@10               amplitude 5 deg at 10 rad/s, from 0 s on
    sine:5@10/0.5           the same, from 0.5 s on
    trapezoids:5/2          test cycle 1: 5 deg up and down, ramps of 2 s, from 0.1 s on
    sinecycle:5/2           test cycle 2: a sinusoid of period 2 s, from 0.1 s on
    pulses:5/2              test cycle 3: up in the first tenth of each 2 s, from 0.1 s on
    file:drive.csv          recorded: columns time_s and throttle_deg, absolute values
    step:5@0.5+sine:1@20    sums
    load_torque=step:10@1   another input than the throttle, by its name

Sizes are in the input's unit and add to the value that the input has otherwise; a recording takes that value's place.
"""

import re
from collections.abc import Mapping
from pathlib import Path

from revline.errors import InvalidInputError, suggestion
from revline.io.recorded_files import read_recording
from revline.signals import Signal, pulse_cycle, sine, sine_cycle, step, trapezoid_cycle
from revline.system import DelaySystem, Variable

KINDS = ("step", "ramp", "sine", "trapezoids", "sinecycle", "pulses", "file")
FORMS = (
    "step:SIZE@START[/RISE], ramp:SIZE@START/DURATION, sine:AMPLITUDE@FREQUENCY[/START], "
    "trapezoids|sinecycle|pulses:SIZE/DURATION, file:PATH"
)
TERM = re.compile(r"(?:(?P<input>[a-z_]+)=)?(?P<kind>[a-z]+):(?P<rest>.*)", re.DOTALL)
BETWEEN = re.compile(r"\+(?=(?:[a-z_]+=)?[a-z]+:)")
DEFAULT_INPUT = "throttle"


def parse_input(text: str, system: DelaySystem, base: Mapping[str, float], *, folder: Path = Path()) -> dict[str, Signal]:
    """Read input signals from a text.

    Args:
        text: as in the module's examples.
        system: whose inputs are driven.
        base: value that each input has otherwise, by name; a recording is taken relative to it.
        folder: where the names of recordings begin.

    Returns:
        Signals by input.

    Raises:
        InvalidInputError: a term has another form, names no input, or its file cannot be used; the message shows the term and the forms.
    """
    found: dict[str, Signal] = {}
    for term in BETWEEN.split(text.strip()):
        match = TERM.fullmatch(term.strip())
        if match is None:
            message = f"input {text!r}: {term!r} is no signal; write {FORMS}, sums with +, another input as NAME=..."
            raise InvalidInputError(message, term=term)
        name = match["input"] or DEFAULT_INPUT
        variable = _find_input(text, system, name)
        if match["kind"] == "file":
            signal = read_recording(folder / match["rest"], variable).signal(base[name])
        else:
            signal = _signal(text, term, match["kind"], match["rest"])
        found[name] = found[name] + signal if name in found else signal
    return found


def _find_input(text: str, system: DelaySystem, name: str) -> Variable:
    for variable in system.inputs:
        if variable.name == name:
            return variable
    names = [variable.name for variable in system.inputs]
    message = f"input {text!r}: there is no signal {name}{suggestion(name, names)}; there are {', '.join(names)}"
    raise InvalidInputError(message, name=name)


def _signal(text: str, term: str, kind: str, rest: str) -> Signal:
    if kind not in KINDS:
        message = f"input {text!r}: {kind!r} is no kind of signal{suggestion(kind, KINDS)}; write {FORMS}"
        raise InvalidInputError(message, term=term)
    at = "@" if kind in {"step", "ramp", "sine"} else "/"
    size, separator, others = rest.partition(at)
    numbers = [size, *others.split("/")] if separator else [rest]
    most = 3 if at == "@" else 2
    least = 3 if kind == "ramp" else 2
    try:
        values = [float(number) for number in numbers]
    except ValueError:
        values = []
    if not least <= len(values) <= most:
        message = f"input {text!r}: {term!r} has not the numbers that {kind} needs; write {FORMS}"
        raise InvalidInputError(message, term=term)
    return _make(kind, values)


def _make(kind: str, values: list[float]) -> Signal:
    if kind in {"step", "ramp"}:
        return step(values[0], start=values[1], rise=values[2] if len(values) > 2 else 0.0)
    if kind == "sine":
        return sine(values[0], values[1], start=values[2] if len(values) > 2 else 0.0)
    cycles = {"trapezoids": trapezoid_cycle, "sinecycle": sine_cycle, "pulses": pulse_cycle}
    return cycles[kind](values[0], values[1])
