"""Input signals of a run as tables that compiled code reads."""

from collections.abc import Mapping

import numpy as np

from revline.dde.run import Floats
from revline.signals import NEVER, Signal, TermKind
from revline.system import DelaySystem, check_range, index_of


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
        for bound in signal.range():
            check_range(system.inputs[owner], float(base[owner]) + bound)
        rows = signal.rows()
        rows[rows[:, 0] == TermKind.RECORDED, 3] += sum(len(samples) for samples in record)
        terms.append(np.column_stack([np.full(len(rows), owner), rows]))
        record.append(signal.record)
        for point in signal.breakpoints(*span):
            breaks.setdefault(point.time, [NEVER] * len(base))[owner] = point.order
    table = np.array([[time, *breaks[time]] for time in sorted(breaks)], dtype=float).reshape(len(breaks), 1 + len(base))
    return {"terms": np.concatenate(terms), "record": np.concatenate(record), "breaks": table}
