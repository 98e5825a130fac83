"""Parts of the kernel that know no equations: what makes a tried step's end the present. `s` is a run's state."""

from revline.dde.events import LANDED, ROUNDING, TOLERANCE, next_break, set_inputs, spread_orders, take_orders
from revline.dde.history import move_to_segment, push_node, skip_smooth
from revline.dde.run import ROOM_NODES, ROOM_SEGMENTS, ROOM_UPDATES, UNSAMPLED, Record

MONOTONE = 1e-6
"""Steps shorter than this part of the grid's step are not asked whether the delayed time advanced: rounding would answer."""


def lacks_room(s: Record) -> bool:
    """Whether the tables could overflow in the next step."""
    full = s.sampling != UNSAMPLED and (
        s.updates_rows - s.updates_stored < ROOM_UPDATES or s.disturbances_rows - s.sample_index < ROOM_UPDATES
    )
    return full or s.nodes_rows - s.node_count < ROOM_NODES or s.segments_rows - s.newest_segment < ROOM_SEGMENTS


def adopt_step(s: Record, states: int, channels: int) -> bool:
    """Make the tried step's end the present and say yes; or refuse it: a state out of its range, or a lag that means nothing.

    Ranges are finite here, so that infinity and what is no number lie outside. Lags are positive, not below the step, and
    grow slower than time.
    """
    sound = True
    for k in range(states):
        sound = sound and s.low[k] <= s.x_next[k] <= s.high[k]
    for k in range(channels):
        sound = sound and s.end - s.read_time_next[k] >= s.step - s.tolerance
        sound = sound and (s.read_time_next[k] > s.read_time[k] or s.end - s.time <= MONOTONE * s.step)
    if sound:
        for k in range(states):
            s.x[k] = s.x_next[k]
        for k in range(channels):
            s.zd[k] = s.zd_next[k]
            s.read_time[k] = s.read_time_next[k]
        s.time = s.end
        s.inputs_known = 1
    return sound


def keep_emitted(s: Record, channels: int) -> None:
    """Write what now enters the channels into history, and let readings pass the segment starts that are smooth for them."""
    if s.newest_segment > 0:
        push_node(s)
    for channel in range(channels):
        if s.read_time[channel] >= s.passing_time[channel]:
            move_to_segment(s, channel, skip_smooth(s, channel, s.segment[channel], s.read_time[channel]))


def pass_breakpoints(s: Record, states: int, channels: int, smooth: int) -> bool:
    """Take the inputs as they are after the breakpoints at the present, and say whether history needs a new segment.

    It does at the start, and where a break of an order below `smooth` enters a channel.
    """
    take_orders(s, channels)
    rough = spread_orders(s, channels, smooth) or s.newest_segment == 0
    following = next_break(s)
    set_inputs(s, s.time, 0.5 * (s.time + following) if following < s.time + s.step else s.time + 0.5 * s.step)
    s.inputs_known = 1
    s.end = s.time
    for k in range(states):
        s.x_next[k] = s.x[k]
    return rough


def adopt_readings(s: Record, channels: int) -> bool:
    """Make the readings after a breakpoint the present ones and say yes; or refuse lags that jump below the step, or back in history.

    Where a lag falls, a reading may land beyond its own next breakpoint: then the present is a landing once more.
    """
    sound = True
    for k in range(channels):
        sound = sound and s.time - s.read_time_next[k] >= s.step - s.tolerance
        sound = sound and (s.newest_segment == 0 or s.read_time_next[k] >= s.read_time[k] - LANDED * s.tolerance)
    if sound:
        for k in range(channels):
            s.zd[k] = s.zd_next[k]
            s.read_time[k] = s.read_time_next[k]
            s.landing = s.time if s.read_time[k] >= s.boundary_time[k] - LANDED * s.tolerance else s.landing
    return sound


def pass_grid_point(s: Record) -> None:
    """Aim at the grid's next point."""
    s.grid_index += 1
    s.grid_time = s.origin + s.grid_index * s.step
    s.tolerance = TOLERANCE * s.step + ROUNDING * abs(s.time)
