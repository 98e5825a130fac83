"""What entered the delay channels, kept as nodes in segments, and read with a cubic that spans no breakpoint.

Plain functions over a run's state `s`, compiled into the kernels. Between two breakpoints lies one segment;
each channel knows the segment that it reads from, so both sides of a jump are kept and a reading never mixes them.
Segment 0 is the constant past.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapters 3 and 4.
"""

from revline.dde.run import NODE_TIME, NODE_UNIFORM, NODE_VALUES, SEGMENT_ORDERS, SEGMENT_START, SEGMENT_TIME, Record
from revline.dde.tables import nodes_of, segments_of

SMOOTH = 4
"""A breakpoint of this order or higher costs a cubic and a fourth-order step nothing: the mesh need not meet it."""

CUBIC = 4
"""Nodes that a cubic needs."""

NEAREST = 1e-3
"""Nodes closer than this part of the step are not both kept: their difference would amplify rounding."""

ALIGNED = 1e-9
"""Nodes are one step apart when their distance is the step within this part of it."""


def find_stencil(s: Record, channel: int, time: float) -> tuple[int, int]:
    """First node and number of nodes around a time in the segment that a channel reads from; no nodes in the constant past."""
    nodes = nodes_of(s)
    segments = segments_of(s)
    segment = s.segment[channel]
    while (
        segment < s.newest_segment
        and segments[segment + 1, SEGMENT_ORDERS + channel] >= SMOOTH
        and time >= segments[segment + 1, SEGMENT_TIME]
    ):
        segment += 1
    if segment == 0:
        return 0, 0
    first = int(segments[segment, SEGMENT_START])
    last = int(segments[segment + 1, SEGMENT_START]) - 1 if segment < s.newest_segment else s.node_count - 1
    node = min(max(s.node[channel], first), last)
    while node > first and nodes[node, NODE_TIME] > time:
        node -= 1
    while node < last and nodes[node + 1, NODE_TIME] <= time:
        node += 1
    s.node[channel] = node
    count = min(CUBIC, last - first + 1)
    stencil = min(max(node - 1, first), last - count + 1)
    if node + 2 <= last and nodes[stencil + 3, NODE_UNIFORM] >= 3.0:
        s.cell_start[channel], s.cell_end[channel], s.cell_stencil[channel] = nodes[node, NODE_TIME], nodes[node + 1, NODE_TIME], stencil
    return stencil, count


def read_cubic(s: Record, channel: int, time: float) -> float:
    """Value that entered a channel at a time, by a cubic; most readings fall into the cell of the one before."""
    if s.cell_start[channel] <= time < s.cell_end[channel]:
        return uniform_cubic(s, channel, s.cell_stencil[channel], time)
    nodes = nodes_of(s)
    first, count = find_stencil(s, channel, time)
    if count == 0:
        return s.initial[channel]
    if count == CUBIC and nodes[first + 3, NODE_UNIFORM] >= 3.0:
        return uniform_cubic(s, channel, first, time)
    return lagrange(s, channel, first, count, time)


def read_linear(s: Record, channel: int, time: float) -> float:
    """Value that entered a channel at a time, by a straight line: the negative control of the order tests."""
    nodes = nodes_of(s)
    first, count = find_stencil(s, channel, time)
    if count == 0:
        return s.initial[channel]
    left = first
    while left < first + count - 2 and nodes[left + 1, NODE_TIME] <= time:
        left += 1
    return lagrange(s, channel, left, min(count, 2), time)


def uniform_cubic(s: Record, channel: int, first: int, time: float) -> float:
    """Cubic through four nodes one step apart (Lagrange form)."""
    nodes = nodes_of(s)
    column = NODE_VALUES + channel
    r = (time - nodes[first, NODE_TIME]) / s.step
    ends = (r - 1.0) * (r - 2.0) * (r * nodes[first + 3, column] - (r - 3.0) * nodes[first, column]) * (1.0 / 6.0)
    middle = 0.5 * r * (r - 3.0) * ((r - 2.0) * nodes[first + 1, column] - (r - 1.0) * nodes[first + 2, column])
    return ends + middle


def lagrange(s: Record, channel: int, first: int, count: int, time: float) -> float:
    """Polynomial through `count` nodes at any distance (Lagrange form)."""
    nodes = nodes_of(s)
    total = 0.0
    for k in range(first, first + count):
        weight = 1.0
        for j in range(first, first + count):
            if j != k:
                weight *= (time - nodes[j, NODE_TIME]) / (nodes[k, NODE_TIME] - nodes[j, NODE_TIME])
        total += weight * nodes[k, NODE_VALUES + channel]
    return total


def nodes_in_segment(s: Record) -> int:
    """How many nodes the newest segment has."""
    return s.node_count - int(segments_of(s)[s.newest_segment, SEGMENT_START])


def push_node(s: Record, ends_segment: bool) -> None:  # noqa: FBT001 - compiled: no keywords
    """Add the present as a node, or replace or skip one that stands too near; a segment's end is always kept."""
    nodes = nodes_of(s)
    count = s.node_count
    first = int(segments_of(s)[s.newest_segment, SEGMENT_START])
    near = s.time - nodes[count - 1, NODE_TIME] < NEAREST * s.step
    if near and not ends_segment:
        return
    if near and count - 1 > first:
        count -= 1
    write_node(s, count)
    previous = count - 1
    if previous >= first and abs(s.time - nodes[previous, NODE_TIME] - s.step) < ALIGNED * s.step:
        nodes[count, NODE_UNIFORM] = nodes[previous, NODE_UNIFORM] + 1.0


def write_node(s: Record, position: int) -> None:
    """Write the present as the newest node."""
    nodes = nodes_of(s)
    nodes[position, NODE_TIME] = s.time
    nodes[position, NODE_UNIFORM] = 0.0
    for column in range(NODE_VALUES, nodes.shape[1]):
        nodes[position, column] = s.z[column - NODE_VALUES]
    s.node_count = position + 1


def begin_segment(s: Record) -> None:
    """Open a segment at the present: its first node holds what enters the channels after the break."""
    segments = segments_of(s)
    segment = s.newest_segment + 1
    s.newest_segment = segment
    segments[segment, SEGMENT_START] = s.node_count
    segments[segment, SEGMENT_TIME] = s.time
    for column in range(SEGMENT_ORDERS, segments.shape[1]):
        segments[segment, column] = s.emitted_orders[column - SEGMENT_ORDERS]
    write_node(s, s.node_count)


def pending_boundary(s: Record, channel: int) -> int:
    """Index of the next segment whose start a channel's reading has not passed and the mesh must meet; 0 where there is none."""
    segments = segments_of(s)
    segment = s.segment[channel] + 1
    while segment <= s.newest_segment and segments[segment, SEGMENT_ORDERS + channel] >= SMOOTH:
        segment += 1
    return segment if segment <= s.newest_segment else 0


def pass_smooth_boundaries(s: Record, channel: int) -> None:
    """Let a channel move on through segment starts that are smooth for it."""
    segments = segments_of(s)
    segment = s.segment[channel]
    while (
        segment < s.newest_segment
        and segments[segment + 1, SEGMENT_ORDERS + channel] >= SMOOTH
        and s.read_time[channel] >= segments[segment + 1, SEGMENT_TIME]
    ):
        segment += 1
    move_to_segment(s, channel, segment)


def move_to_segment(s: Record, channel: int, segment: int) -> None:
    """Let a channel read from a segment."""
    if segment != s.segment[channel]:
        s.segment[channel] = segment
        s.cell_end[channel] = s.cell_start[channel]
