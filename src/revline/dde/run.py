"""The state of a simulation as one record: what a compiled kernel works on and a checkpoint keeps.

A record, not an object of arrays, because compiled code then counts no references in its inner loop.
"""

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from revline.signals import NEVER
from revline.system import DelaySystem

Floats = NDArray[np.float64]
Record = Any
"""A scalar of the structured type that `state_type` gives; attributes in compiled code, fields in numpy."""

TABLES = ("parameters", "nodes", "segments", "terms", "record", "breaks", "samples", "controller", "disturbances", "updates")
"""What a run reads and writes beside its state, see `revline.dde.memory`; the last three where a controller is sampled."""

NODE_TIME, NODE_UNIFORM, NODE_VALUES = 0, 1, 2
SEGMENT_START, SEGMENT_TIME, SEGMENT_ORDERS = 0, 1, 2

DONE = 0
NEEDS_ROOM = 1
REFUSED = 2
"""The tried step's states or lags mean nothing; the present is where the run still was sound."""

INSIDE = 0
AT_BREAK = 1
"""Where a step ends: within a smooth piece, or at a breakpoint."""

UNSAMPLED, BY_TIME, BY_STATE = 0, 1, 2
"""When a controller is sampled: never, at given times, or where a state passes given values."""

ROOM_UPDATES = 2

ROOM_NODES = 64
ROOM_SEGMENTS = 8

SMALLEST_WIDTH = 8
"""Width of the state's vectors: systems of like size share one layout, and with it the compiled parts that know no equations."""


WIDEST = 32
"""Width of the vectors of a sampled controller and of a system's outputs that it reads."""


def width_for(count: int) -> int:
    """Width of the vectors for a number of signals: the smallest, doubled until it holds them."""
    width = SMALLEST_WIDTH
    while width < count:
        width *= 2
    return width


def state_type(system: DelaySystem) -> np.dtype[np.void]:
    """Layout of a run's state; the vectors are as wide as `width_for` says and zero beyond the system's signals.

    What ends in `_next` belongs to the step being tried, which ends at `end`; `landing` is a breakpoint found that the mesh must meet.
    `grid_index` and `grid_time` are of the grid's next point, `grid_target` of that at which to stop. Per channel, `segment` and `node`
    are where it reads, `cell_*` is the span of the last cubic, `boundary` is the next segment start that the mesh must meet,
    `boundary_time` and `passing_time` are the times of that one and of a smooth one before it.
    Of a sampled controller, `event` is the next time at which it samples (`sample_time`) or its output takes effect (`act_time`).
    """
    return _state_type(*(width_for(len(signals)) for signals in (system.states, system.inputs, system.channels)))


@functools.cache
def _state_type(n: int, m: int, c: int) -> np.dtype[np.void]:
    floats, integers = "f8", "i8"
    return np.dtype(
        [
            *((name, floats) for name in ("time", "end", "landing", "grid_time", "origin", "step", "tolerance")),
            *((name, floats) for name in ("low_time", "low_excess", "high_time", "high_excess")),
            *((name, integers) for name in ("grid_index", "grid_target", "store_every", "next_break", "stored", "inputs_known", "place")),
            *((name, integers) for name in ("node_count", "newest_segment", "search_channel", "search_count")),
            *((f"{name}_{what}", integers) for name in TABLES for what in ("at", "rows", "columns")),
            *((name, floats) for name in ("event", "sample_time", "sample_before", "act_time", "period", "computation_delay")),
            *((name, floats) for name in ("state_origin", "state_target", "state_spacing")),
            *((name, integers) for name in ("sampling", "sampled_state", "sample_index", "updates_stored", "corrections", "overruns")),
            *((name, floats, (WIDEST,)) for name in ("outputs", "xd", "y", "r", "updated")),
            *((name, integers, (SMALLEST_WIDTH,)) for name in ("measured_output", "command_input", "driven_input")),
            *((name, floats, (n,)) for name in ("x", "x_next", "rates", "total", "low", "high")),
            *((name, floats, (m,)) for name in ("base", "u")),
            *((name, floats, (c,)) for name in ("initial", "z", "zd", "zd_next", "lag", "read_time", "read_time_next")),
            *((name, floats, (c,)) for name in ("cell_start", "cell_end", "boundary_time", "passing_time")),
            *((name, integers, (c,)) for name in ("segment", "node", "cell_stencil", "boundary")),
            *((name, integers, (m,)) for name in ("input_orders", "event_orders", "rate_reads_input")),
            *((name, integers, (c,)) for name in ("reading_orders", "emitted_orders")),
            *((name, integers, (c,)) for name in ("rate_reads_channel", "emit_reads_state", "lag_reads_state")),
            *((name, integers, (c, m)) for name in ("emit_reads_input", "lag_reads_input")),
            *((name, integers, (c, c)) for name in ("emit_reads_channel", "lag_reads_channel")),
        ],
        align=True,
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
    for field in ("input_orders", "event_orders", "reading_orders", "emitted_orders"):
        state[field][:] = NEVER
