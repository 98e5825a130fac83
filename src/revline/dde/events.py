"""Breakpoints met by the mesh: their orders, which of them come next, and how they travel. Compiled into the kernels.

An input that jumps (order 0) bends the states (order 1); what enters a channel inherits the lowest order of all that its
equation reads, and is met again when that channel's reading gets there. `s` is a run's state.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, section 2.2.
"""

from typing import Any

from revline.dde.history import SMOOTH, move_to_segment, pending_boundary
from revline.dde.run import SEGMENT_ORDERS, SEGMENT_TIME, Record
from revline.dde.tables import breaks_of, record_of, segments_of, terms_of
from revline.signals import NEVER, evaluate_term

TOLERANCE = 1e-9
"""Times closer than this part of the step are the same."""

LANDED = 1e-6
"""A reading this close, in parts of the step, to a breakpoint has reached it once the mesh has landed on a break."""


def set_inputs(s: Record, time: float, reference: float) -> None:
    """Evaluate all inputs at a time, each by the piece in which the reference time lies."""
    terms = terms_of(s)
    record = record_of(s)
    for k in range(s.u.shape[0]):
        s.u[k] = s.base[k]
    for k in range(terms.shape[0]):
        s.u[int(terms[k, 0])] += evaluate_term(terms[k, 1:], record, time, reference)


def next_break(s: Record) -> float:
    """Time of the next input break, or infinity."""
    breaks = breaks_of(s)
    return breaks[s.next_break, 0] if s.next_break < breaks.shape[0] else float("inf")


def grid_end(s: Record) -> float:
    """End of the present grid interval."""
    return s.origin + (s.grid_index + 1) * s.step


def next_stop(s: Record) -> float:
    """Where the next step must end at the latest: the grid's next point or an input break before it."""
    stop = grid_end(s)
    following = next_break(s)
    return following if following < stop - TOLERANCE * s.step else stop


def is_input_break(s: Record, time: float) -> bool:
    """Whether an input break lies at a time."""
    return next_break(s) <= time + TOLERANCE * s.step


def crossing_ahead(s: Record, count: int) -> bool:
    """Whether a channel's reading at the end of the tried step reaches a breakpoint that the mesh must meet."""
    segments = segments_of(s)
    for channel in range(count):
        boundary = pending_boundary(s, channel)
        if boundary > 0 and s.read_time_new[channel] >= segments[boundary, SEGMENT_TIME] - TOLERANCE * s.step:
            return True
    return False


def excess(s: Record, channel: int, read_time: float) -> float:
    """How far a channel's reading lies beyond its next breakpoint; minus infinity where there is none."""
    segments = segments_of(s)
    boundary = pending_boundary(s, channel)
    return read_time - segments[boundary, SEGMENT_TIME] if boundary > 0 else -float("inf")


def next_estimate(low: float, low_excess: float, high: float, high_excess: float) -> float:
    """Secant estimate of a root between two bounds, kept inside them."""
    estimate = high - high_excess * (high - low) / (high_excess - low_excess)
    return estimate if low < estimate < high else 0.5 * (low + high)


def take_input_orders(s: Record) -> None:
    """Pass all input breaks at the present time; the state gets the lowest order per input."""
    breaks = breaks_of(s)
    for k in range(s.input_orders.shape[0]):
        s.input_orders[k] = NEVER
    while is_input_break(s, s.time):
        for k in range(breaks.shape[1] - 1):
            s.input_orders[k] = min(s.input_orders[k], int(breaks[s.next_break, 1 + k]))
        s.next_break += 1


def take_reading_orders(s: Record, count: int) -> None:
    """Pass all breakpoints that the channels' readings have reached; the state gets the lowest order per channel."""
    segments = segments_of(s)
    for channel in range(s.reading_orders.shape[0]):
        s.reading_orders[channel] = NEVER
    for channel in range(count):
        boundary = pending_boundary(s, channel)
        while boundary > 0 and s.read_time[channel] >= segments[boundary, SEGMENT_TIME] - LANDED * s.step:
            s.reading_orders[channel] = min(s.reading_orders[channel], int(segments[boundary, SEGMENT_ORDERS + channel]))
            move_to_segment(s, channel, boundary)
            boundary = pending_boundary(s, channel)


def lowest(orders: Any, reads: Any) -> int:
    """Lowest order among those that are read."""
    found = NEVER
    for k in range(orders.shape[0]):
        if reads[k] > 0:
            found = min(found, orders[k])
    return found


def state_order(s: Record) -> int:
    """Order of the states' break: one above the lowest of what their rates read."""
    return 1 + min(lowest(s.input_orders, s.rate_reads_input), lowest(s.reading_orders, s.rate_reads_channel))


def spread_orders(s: Record, count: int) -> None:
    """Find the order of the break in what enters each channel, from those of the inputs and of the readings."""
    for _ in range(2):
        bend = state_order(s)
        for channel in range(count):
            order = min(lowest(s.input_orders, s.lag_reads_input[channel]), lowest(s.reading_orders, s.lag_reads_channel[channel]))
            if s.lag_reads_state[channel] > 0:
                order = min(order, bend)
            s.reading_orders[channel] = min(s.reading_orders[channel], order)
    bend = state_order(s)
    for channel in range(count):
        order = min(lowest(s.input_orders, s.emit_reads_input[channel]), lowest(s.reading_orders, s.emit_reads_channel[channel]))
        s.emitted_orders[channel] = min(order, bend) if s.emit_reads_state[channel] > 0 else order


def must_be_met(s: Record, count: int) -> bool:
    """Whether the present break is rough enough for a segment of its own."""
    for channel in range(count):
        if s.emitted_orders[channel] < SMOOTH:
            return True
    return False
