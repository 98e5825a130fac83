"""Input signals of a run as tables that compiled code reads."""

import math
from collections.abc import Mapping

import numpy as np

from revline.dde.run import Floats
from revline.errors import out_of_range
from revline.signals import NEVER, Signal, TermKind
from revline.system import DelaySystem, Variable, check_range, index_of

LARGEST_TURN = 1.0
"""Angle in radians that a sinusoid may turn by in one step: six steps to a period, which a fourth-order method follows."""


def tabulate_signals(system: DelaySystem, base: Floats, signals: Mapping[str, Signal], span: tuple[float, float]) -> dict[str, Floats]:
    """Collect all terms of all signals in one table, their recordings in another, and their breaks in a span of time in a third.

    Args:
        system: whose inputs the signals drive.
        base: shape (n_inputs,), to which the signals are added.
        signals: by input name.
        span: start and end of the time in which breaks are listed, both excluded.

    Returns:
        Tables "terms", "record" and "breaks".

    Raises:
        InvalidInputError: there is no such input, or the signal leaves the input's range.
    """
    terms, record = [np.empty((0, 6))], [np.empty((0, 2))]
    breaks: dict[float, list[int]] = {}
    for name, signal in signals.items():
        owner = index_of(system.inputs, name)
        _check_signal(system.inputs[owner], float(base[owner]), signal, span)
        rows = signal.rows()
        rows[rows[:, 0] == TermKind.RECORDED, 3] += sum(len(samples) for samples in record)
        terms.append(np.column_stack([np.full(len(rows), owner), rows]))
        record.append(signal.record)
        for point in signal.breakpoints(*span):
            breaks.setdefault(point.time, [NEVER] * len(base))[owner] = point.order
    table = np.array([[time, *breaks[time]] for time in sorted(breaks)], dtype=float).reshape(len(breaks), 1 + len(base))
    return {"terms": np.concatenate(terms), "record": np.concatenate(record), "breaks": table}


def _check_signal(variable: Variable, base: float, signal: Signal, span: tuple[float, float]) -> None:
    """Refuse a signal that leaves its input's range in a span of time; where its bounds do, its extremes decide."""
    low, high = signal.range()
    if variable.low <= base + low and base + high <= variable.high:
        return
    for bound in signal.extremes(*span):
        check_range(variable, base + bound)


def check_resolved(signals: Mapping[str, Signal], step: float) -> None:
    """Refuse a step that is none, and sinusoids too fast for it: sampled so coarsely, they would pass for slower ones.

    Raises:
        InvalidInputError: the step is not above 0, or a sinusoid turns by more than `LARGEST_TURN` in it; the message says which would do.
    """
    if not (math.isfinite(step) and step > 0.0):
        raise out_of_range("step", step, "s", "values above 0", "give a step such as 0.001")
    for name, signal in signals.items():
        for term in signal.terms:
            if term.kind is TermKind.SINE and term.first * step > LARGEST_TURN:
                limit = f"what a step of {step:g} s resolves, up to {LARGEST_TURN / step:g} rad/s"
                remedy = f"give a step of at most {LARGEST_TURN / term.first:.3g} s, or a lower frequency"
                raise out_of_range(f"sine frequency of {name}", term.first, "rad/s", limit, remedy)
