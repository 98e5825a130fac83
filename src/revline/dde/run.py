"""The state of a simulation as one record: what a compiled kernel works on and a checkpoint keeps.

A record, not an object of arrays, because compiled code then counts no references in its inner loop.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from revline.signals import NEVER
from revline.system import DelaySystem

Floats = NDArray[np.float64]
Record = Any
"""A scalar of the structured type that `state_type` gives; attributes in compiled code, fields in numpy."""


TABLES = ("nodes", "segments", "terms", "record", "breaks", "samples")
"""What a run reads and writes beside its state, see `revline.dde.tables`."""

NODE_TIME, NODE_UNIFORM, NODE_VALUES = 0, 1, 2
SEGMENT_START, SEGMENT_TIME, SEGMENT_ORDERS = 0, 1, 2

DONE = 0
NEEDS_ROOM = 1
OUT_OF_RANGE = 2
NOT_FINITE = 3
BAD_LAG = 4
SHORT_LAG = 5
BACKWARD = 6

ROOM_NODES = 64
ROOM_SEGMENTS = 8

MOST_STAGES = 8


SMALLEST_WIDTH = 8
"""Width of the state's vectors: systems of like size share one layout, and with it the compiled parts that know no equations."""


def width_for(count: int) -> int:
    """Width of the vectors for a number of signals: the smallest, doubled until it holds them."""
    width = SMALLEST_WIDTH
    while width < count:
        width *= 2
    return width


def state_type(system: DelaySystem) -> np.dtype[np.void]:
    """Layout of a run's state; the vectors are as wide as `width_for` says and zero beyond the system's signals."""
    n, m, c = (width_for(len(signals)) for signals in (system.states, system.inputs, system.channels))
    floats, integers = "f8", "i8"
    return np.dtype(
        [
            *((name, floats) for name in ("time", "origin", "step")),
            *((name, integers) for name in ("grid_index", "grid_target", "store_every", "next_break", "stored", "inputs_known")),
            *((name, integers) for name in ("node_count", "newest_segment")),
            *((f"{name}_{what}", integers) for name in TABLES for what in ("at", "rows", "columns")),
            *((name, floats, (n,)) for name in ("x", "x_stage", "x_new", "low", "high")),
            ("rates", floats, (MOST_STAGES, n)),
            *((name, floats, (m,)) for name in ("base", "u")),
            *((name, floats, (c,)) for name in ("initial", "z", "zd", "zd_stage", "zd_new")),
            *((name, floats, (c,)) for name in ("read_time", "read_time_stage", "read_time_new", "cell_start", "cell_end")),
            *((name, integers, (c,)) for name in ("segment", "node", "cell_stencil")),
            *((name, integers, (m,)) for name in ("input_orders", "rate_reads_input")),
            *((name, integers, (c,)) for name in ("reading_orders", "emitted_orders")),
            *((name, integers, (c,)) for name in ("rate_reads_channel", "emit_reads_state", "lag_reads_state")),
            *((name, integers, (c, m)) for name in ("emit_reads_input", "lag_reads_input")),
            *((name, integers, (c, c)) for name in ("emit_reads_channel", "lag_reads_channel")),
        ]
    )  # fmt: skip


def write_structure(system: DelaySystem, state: Record) -> None:
    """Write what each equation reads (1) or not (0) into a state: how breakpoints travel."""
    structure = system.structure

    def mark(field: str, found: tuple[frozenset[str], ...], letter: str, size: int) -> None:
        for row, sources in enumerate(found):
            for column in range(size):
                state[field][row, column] = f"{letter}{column}" in sources

    m, c = len(system.inputs), len(system.channels)
    mark("emit_reads_input", structure.emit, "u", m)
    mark("lag_reads_input", structure.lags, "u", m)
    mark("emit_reads_channel", structure.emit, "zd", c)
    mark("lag_reads_channel", structure.lags, "zd", c)
    for k in range(c):
        state["emit_reads_state"][k] = any(name[0] == "x" for name in structure.emit[k])
        state["lag_reads_state"][k] = any(name[0] == "x" for name in structure.lags[k])
        state["rate_reads_channel"][k] = any(f"zd{k}" in sources for sources in structure.rate)
    for k in range(m):
        state["rate_reads_input"][k] = any(f"u{k}" in sources for sources in structure.rate)
    for field in ("input_orders", "reading_orders", "emitted_orders"):
        state[field][:] = NEVER
