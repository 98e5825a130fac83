"""Breakpoints met by the mesh: where the next ones are, their orders, and how they travel. Compiled into the kernels.

An input that jumps (order 0) bends the states (order 1); what enters a channel inherits the lowest order of all that its
equation reads, and is met again when that channel's reading gets there. `s` is a run's state.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, section 2.2.
"""

from typing import Any

import numpy as np

from revline.dde.history import CUBIC, FAR, NEAREST, move_to_segment
from revline.dde.memory import breaks_of, record_of, segments_of, terms_of
from revline.dde.run import AT_BREAK, INSIDE, SEGMENT_ORDERS, SEGMENT_START, Record
from revline.signals import NEVER, evaluate_term

TOLERANCE = 1e-9
"""Times closer than this part of the step, and what rounding adds, are the same; the state's `tolerance` is both."""

ROUNDING = 1e-15
"""Times closer than this part of themselves are the same: some units in the last place."""

LANDED = 10.0
"""A reading this close, in tolerances, to a breakpoint has reached it once the mesh has landed on a break."""

EXACT = 1e-4
"""A breakpoint is located to this part of the tolerance."""


def set_inputs(s: Record, time: float, reference: float) -> None:
    """Evaluate all inputs at a time, each by the piece in which the reference time lies."""
    terms, record = terms_of(s), record_of(s)
    for k in range(s.u.shape[0]):
        s.u[k] = s.base[k]
    for k in range(terms.shape[0]):
        s.u[np.int64(terms[k, 0])] += evaluate_term(terms[k, 1:], record, time, reference)


def next_break(s: Record) -> float:
    """Time of the next input break or of a sampled controller's next event, or infinity."""
    known = breaks_of(s)[s.next_break, 0] if s.next_break < s.breaks_rows else FAR
    return s.event if s.event < known else known


def choose_step(s: Record) -> None:
    """Choose the step's end: the grid's next point or a breakpoint before it, or a part of the way to it.

    The way is cut into equal parts so that each segment gets the nodes of a cubic, unless they would stand too near.
    """
    stop, s.place = s.grid_time, INSIDE
    following = next_break(s)
    following = s.landing if s.landing < following else following
    if following <= stop + s.tolerance:
        s.place = AT_BREAK
        stop = following if following < stop - s.tolerance else stop
    lacking = CUBIC - s.node_count + np.int64(segments_of(s)[s.newest_segment, SEGMENT_START])
    s.end = stop
    if lacking > 1 and stop - s.time > lacking * NEAREST * s.step:
        s.end = s.time + (stop - s.time) / lacking
        s.place = INSIDE


def seek_breakpoint(s: Record, channels: int) -> bool:
    """Say whether the step must be tried anew, to another end, because a reading meets a breakpoint before or at its end.

    Called after each trial of a step until it says no. It closes in on the first time at which a reading reaches its boundary;
    then that time is the `landing`, at which the next steps end.
    """
    if s.search_channel >= 0:
        narrow_search(s)
        return True
    if s.landing <= s.time or (s.landing < FAR and s.place == INSIDE):  # at a landing, as the start is, or on the way to one
        return False
    reached = False
    for channel in range(channels):
        excess = s.read_time_next[channel] - s.boundary_time[channel]
        reached = reached or excess >= -s.tolerance
        if excess > s.tolerance:
            s.landing, s.search_channel, s.search_count = FAR, channel, 0
            s.low_time, s.low_excess = s.time, s.read_time[channel] - s.boundary_time[channel]
            s.high_time, s.high_excess = s.end, excess
            choose_end(s)
            return True
    return correct_landing(s, reached)


def correct_landing(s: Record, reached: bool) -> bool:  # noqa: FBT001 - compiled: no keywords
    """Take the tried end for the landing where a reading reaches a breakpoint there; say whether the way to it must be tried anew.

    On the way to a landing, steps are shorter than the one that found it, and the reading may come out short of the breakpoint:
    then the landing is none, and the next step finds it.
    """
    if reached and s.landing != s.end:
        s.landing = s.end
        choose_step(s)
        return True
    if not reached and s.landing < FAR:
        s.landing = FAR
        if next_break(s) > s.end + s.tolerance:
            s.place = INSIDE
    return False


def narrow_search(s: Record) -> None:
    """Take in where the reading is at the end tried, and choose the next end: one nearer to the breakpoint, or the breakpoint itself."""
    excess = s.read_time_next[s.search_channel] - s.boundary_time[s.search_channel]
    if excess < 0.0:
        s.low_time, s.low_excess = s.end, excess
    else:
        s.high_time, s.high_excess = s.end, excess
    choose_end(s)


def choose_end(s: Record) -> None:
    """Choose the next end to try between the bounds of a search: by the secant, every third time by halving, at last the upper bound."""
    s.search_count += 1
    end = s.high_time - s.high_excess * (s.high_time - s.low_time) / (s.high_excess - s.low_excess)
    if s.search_count % 3 == 0 or not s.low_time < end < s.high_time:
        end = 0.5 * (s.low_time + s.high_time)
    if s.high_excess <= EXACT * s.tolerance or s.high_time - s.low_time <= EXACT * s.tolerance or not s.low_time < end < s.high_time:
        end, s.search_channel = s.high_time, -1
    s.end = end


def take_orders(s: Record, channels: int) -> None:
    """Pass all breakpoints at the present time; the state gets the lowest order per input and per channel's reading."""
    breaks, segments = breaks_of(s), segments_of(s)
    s.landing = FAR
    for k in range(s.input_orders.shape[0]):
        s.input_orders[k] = s.event_orders[k]
        s.event_orders[k] = NEVER
    while s.next_break < s.breaks_rows and breaks[s.next_break, 0] <= s.time + s.tolerance:
        for k in range(breaks.shape[1] - 1):
            s.input_orders[k] = lower(s.input_orders[k], np.int64(breaks[s.next_break, 1 + k]))
        s.next_break += 1
    for channel in range(s.reading_orders.shape[0]):
        s.reading_orders[channel] = NEVER
    for channel in range(channels):
        while s.read_time[channel] >= s.boundary_time[channel] - LANDED * s.tolerance:
            order = np.int64(segments[s.boundary[channel], SEGMENT_ORDERS + channel])
            s.reading_orders[channel] = lower(s.reading_orders[channel], order)
            move_to_segment(s, channel, s.boundary[channel])


def lower(first: Any, second: Any) -> Any:
    """The lower of two orders."""
    return first if first < second else second


def lowest(s: Record, input_reads: Any, channel_reads: Any) -> Any:
    """Lowest order among the inputs and the readings that an equation reads."""
    found = NEVER
    for k in range(s.input_orders.shape[0]):
        if input_reads[k] > 0:
            found = lower(found, s.input_orders[k])
    for k in range(s.reading_orders.shape[0]):
        if channel_reads[k] > 0:
            found = lower(found, s.reading_orders[k])
    return found


def spread_orders(s: Record, channels: int, smooth: int) -> bool:
    """Find the order of the break in what enters each channel, and whether one is below a given order: it needs a segment of its own.

    The states' break is one order above the lowest of what their rates read; it acts on the lags, and these on the readings.
    """
    for _ in range(2):
        bend = 1 + lowest(s, s.rate_reads_input, s.rate_reads_channel)
        for channel in range(channels):
            order = lowest(s, s.lag_reads_input[channel], s.lag_reads_channel[channel])
            if s.lag_reads_state[channel] > 0:
                order = lower(order, bend)
            s.reading_orders[channel] = lower(s.reading_orders[channel], order)
    bend = 1 + lowest(s, s.rate_reads_input, s.rate_reads_channel)
    rough = False
    for channel in range(channels):
        order = lowest(s, s.emit_reads_input[channel], s.emit_reads_channel[channel])
        s.emitted_orders[channel] = lower(order, bend) if s.emit_reads_state[channel] > 0 else order
        rough = rough or s.emitted_orders[channel] < smooth
    return rough
