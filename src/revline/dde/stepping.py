"""Parts of the kernel that know no equations: checks, room, bookkeeping. Compiled into the kernels; `s` is a run's state."""

import math

from revline.dde.events import TOLERANCE
from revline.dde.history import CUBIC, nodes_in_segment
from revline.dde.run import (
    BACKWARD,
    BAD_LAG,
    DONE,
    NOT_FINITE,
    OUT_OF_RANGE,
    ROOM_NODES,
    ROOM_SEGMENTS,
    SHORT_LAG,
    Record,
)

MONOTONE = 1e-6
"""Steps shorter than this part of the grid's step are not asked whether the delayed time advanced: rounding would answer."""


def lacks_room(s: Record) -> bool:
    """Whether the tables could overflow in the next step."""
    return s.nodes_rows - s.node_count < ROOM_NODES or s.segments_rows - s.newest_segment < ROOM_SEGMENTS


def pieces_to(s: Record) -> int:
    """Into how many steps the way to the next stop is cut, so that each segment has the nodes of a cubic."""
    return max(1, CUBIC - nodes_in_segment(s))


def piece_end(time: float, stop: float, pieces: int) -> float:
    """End of the first of some equal steps; exactly the stop for the last."""
    return stop if pieces <= 1 else time + (stop - time) / pieces


def check_states(s: Record, count: int) -> int:
    """Whether the tried step's states mean anything."""
    for k in range(count):
        if not math.isfinite(s.x_new[k]):
            return NOT_FINITE
        if s.x_new[k] < s.low[k] or s.x_new[k] > s.high[k]:
            return OUT_OF_RANGE
    return DONE


def check_lags(s: Record, end: float, count: int) -> int:
    """Whether the tried step's lags are positive, not below the step, and let the delayed time advance."""
    for k in range(count):
        lag = end - s.read_time_new[k]
        if not (math.isfinite(lag) and lag > 0.0):
            return BAD_LAG
        if lag < s.step * (1.0 - TOLERANCE):
            return SHORT_LAG
        if end - s.time > MONOTONE * s.step and s.read_time_new[k] <= s.read_time[k]:
            return BACKWARD
    return DONE


def adopt_step(s: Record, end: float) -> None:
    """Make the tried step's end the present."""
    for k in range(s.x.shape[0]):
        s.x[k] = s.x_new[k]
    for k in range(s.zd.shape[0]):
        s.zd[k] = s.zd_new[k]
        s.read_time[k] = s.read_time_new[k]
    s.time = end
    s.inputs_known = 1
