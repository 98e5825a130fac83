"""What entered the delay channels, kept as nodes in segments, and read with a cubic that spans no breakpoint.

Plain functions over a run's state `s`, compiled into the kernels. Between two breakpoints lies one segment;
each channel knows the segment that it reads from, so both sides of a jump are kept and a reading never mixes them.
Segment 0 is the constant past.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapters 3 and 4.
"""

from typing import Any

import numpy as np

from revline.dde.memory import nodes_of, segments_of
from revline.dde.run import INSIDE, NODE_TIME, NODE_UNIFORM, NODE_VALUES, SEGMENT_ORDERS, SEGMENT_START, SEGMENT_TIME, Record

SMOOTH = 4
"""A breakpoint of this order or higher costs a cubic and a fourth-order step nothing: the mesh need not meet it."""

CUBIC = 4
"""Nodes that a cubic needs."""

NEAREST = 1e-3
"""Nodes closer than this part of the step are not both kept: their difference would amplify rounding."""

ALIGNED = 1e-9
"""Nodes are one step apart when their distance is the step within this part of it."""

FAR = float("inf")


def read_cubic(s: Record, channel: int, time: float) -> float:
    """Value that entered a channel at a time, by a cubic; most readings fall into the cell of the one before."""
    if not s.cell_start[channel] <= time < s.cell_end[channel]:
        first, count = find_stencil(s, channel, time)
        if count < CUBIC or nodes_of(s)[first + 3, NODE_UNIFORM] < 3.0:
            return lagrange(s, channel, first, count, time)
        s.cell_stencil[channel] = first
    nodes = nodes_of(s)
    first, column = s.cell_stencil[channel], NODE_VALUES + channel
    r = (time - nodes[first, NODE_TIME]) / s.step
    ends = (r - 1.0) * (r - 2.0) * (r * nodes[first + 3, column] - (r - 3.0) * nodes[first, column]) * (1.0 / 6.0)
    middle = 0.5 * r * (r - 3.0) * ((r - 2.0) * nodes[first + 1, column] - (r - 1.0) * nodes[first + 2, column])
    return ends + middle


def read_linear(s: Record, channel: int, time: float) -> float:
    """Value that entered a channel at a time, by a straight line: the negative control of the order tests."""
    nodes = nodes_of(s)
    first, count = find_stencil(s, channel, time)
    left = first
    while left < first + count - 2 and nodes[left + 1, NODE_TIME] <= time:
        left += 1
    return lagrange(s, channel, left, count if count < 2 else 2, time)


def find_stencil(s: Record, channel: int, time: float) -> tuple[Any, Any]:
    """First node and number of nodes around a time in the segment that a channel reads from; no nodes in the constant past."""
    nodes, segments = nodes_of(s), segments_of(s)
    segment = skip_smooth(s, channel, s.segment[channel], time)
    if segment == 0:
        return 0, 0
    first = np.int64(segments[segment, SEGMENT_START])
    last = (np.int64(segments[segment + 1, SEGMENT_START]) if segment < s.newest_segment else s.node_count) - 1
    node = s.node[channel]
    if node < first or node > last:
        node = first
    while node > first and nodes[node, NODE_TIME] > time:
        node -= 1
    while node < last and nodes[node + 1, NODE_TIME] <= time:
        node += 1
    s.node[channel] = node
    count = CUBIC if last - first >= CUBIC - 1 else last - first + 1
    stencil = node - 1 if node > first else first
    stencil = stencil if stencil + count <= last + 1 else last + 1 - count
    s.cell_end[channel] = s.cell_start[channel]
    # Where a node follows the cell, new nodes leave the stencil as it is, and further readings need not search for it.
    if node + 2 <= last and nodes[stencil + 3, NODE_UNIFORM] >= 3.0:
        s.cell_start[channel], s.cell_end[channel] = nodes[node, NODE_TIME], nodes[node + 1, NODE_TIME]
    return stencil, count


def skip_smooth(s: Record, channel: int, segment: int, time: float) -> int:
    """Segment in which a time lies, from a given one on, if all starts between are smooth for the channel; else the last before."""
    segments = segments_of(s)
    while (
        segment < s.newest_segment
        and segments[segment + 1, SEGMENT_ORDERS + channel] >= SMOOTH
        and time >= segments[segment + 1, SEGMENT_TIME]
    ):
        segment += 1
    return segment


def lagrange(s: Record, channel: int, first: int, count: int, time: float) -> float:
    """Polynomial through `count` nodes at any distance (Lagrange form); without nodes, the constant past."""
    nodes = nodes_of(s)
    total = 0.0 if count > 0 else s.initial[channel]
    for k in range(first, first + count):
        weight = nodes[k, NODE_VALUES + channel]
        for j in range(first, first + count):
            if j != k:
                weight *= (time - nodes[j, NODE_TIME]) / (nodes[k, NODE_TIME] - nodes[j, NODE_TIME])
        total += weight
    return total


def push_node(s: Record) -> None:
    """Add the present as a node, or replace or skip one that stands too near; that at a break is always kept."""
    nodes = nodes_of(s)
    count = s.node_count
    first = np.int64(segments_of(s)[s.newest_segment, SEGMENT_START])
    near = s.time - nodes[count - 1, NODE_TIME] < NEAREST * s.step
    if near and (s.place == INSIDE or s.time <= nodes[first, NODE_TIME]):
        return
    if near and count - 1 > first:
        count -= 1
    previous = count - 1
    is_next = previous >= first and abs(s.time - nodes[previous, NODE_TIME] - s.step) < ALIGNED * s.step
    write_node(s, count, nodes[previous, NODE_UNIFORM] + 1.0 if is_next else 0.0)


def begin_segment(s: Record, channels: int) -> None:
    """Open a segment at the present: its first node holds what enters the channels after the break, which all channels get to know."""
    segments = segments_of(s)
    segment = s.newest_segment + 1
    s.newest_segment = segment
    segments[segment, SEGMENT_START] = s.node_count
    segments[segment, SEGMENT_TIME] = s.time
    for channel in range(channels):
        # At the start what enters a channel jumps where it is not what the channel held before; else it bends.
        order = s.emitted_orders[channel] if segment > 1 else np.int64(s.z[channel] == s.initial[channel])
        segments[segment, SEGMENT_ORDERS + channel] = order
    write_node(s, s.node_count, 0.0)
    for channel in range(channels):
        move_to_segment(s, channel, s.segment[channel])


def write_node(s: Record, position: int, uniform: float) -> None:
    """Write the present as the newest node."""
    nodes = nodes_of(s)
    nodes[position, NODE_TIME], nodes[position, NODE_UNIFORM] = s.time, uniform
    for column in range(NODE_VALUES, nodes.shape[1]):
        nodes[position, column] = s.z[column - NODE_VALUES]
    s.node_count = position + 1


def move_to_segment(s: Record, channel: int, segment: int) -> None:
    """Let a channel read from a segment, and note which segment starts it meets next."""
    segments = segments_of(s)
    s.segment[channel] = segment
    s.cell_end[channel] = s.cell_start[channel]
    following = segment + 1
    while following <= s.newest_segment and segments[following, SEGMENT_ORDERS + channel] >= SMOOTH:
        following += 1
    s.boundary[channel] = following
    s.boundary_time[channel] = segments[following, SEGMENT_TIME] if following <= s.newest_segment else FAR
    s.passing_time[channel] = segments[segment + 1, SEGMENT_TIME] if following > segment + 1 else FAR
