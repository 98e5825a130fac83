"""Where the answer of a linear delay system is not smooth: jumps of an input, carried on by the lags.

A jump of the k-th derivative that enters a channel leaves it a lag later as a jump of the k-th derivative of what is read. Integrated
by a state it becomes one of the derivative k + 1; passed straight on into a channel it keeps its order. An impulse is order -1.
"""

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.errors import NotConvergedError
from revline.lti.response import Floats
from revline.lti.state_space import DelayStateSpace
from revline.values import make_read_only

Counts = tuple[int, ...]

MOST_BREAKPOINTS = 20_000
"""More jumps than these within a record are not followed."""

SAME_TIME = 64.0 * float(np.finfo(float).eps)
"""Times nearer to one another, relative to the record's length, are one time: sums of lags differ by rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Breakpoints:
    """Times at which what drives the states jumps, and the impulses that come out of the channels there.

    Attributes:
        times: in s, rising, each once.
        orders: lowest derivative that jumps at each.
        kicks: impulses read from each channel at each time, of shape (times, channels); zero where none arrives.
    """

    times: Floats
    orders: NDArray[np.int64]
    kicks: Floats

    def __post_init__(self) -> None:
        make_read_only(self)


def find_breakpoints(system: DelayStateSpace, entering: Floats, *, impulse: Floats, until: float, smoothest: int) -> Breakpoints:
    """Carry the jumps at time 0 through the lags, as often as they come round.

    Args:
        system: linear system with delay channels.
        entering: order of the jump that enters each channel at time 0; infinite where none does.
        impulse: what enters each channel as an impulse at time 0; zero where none does.
        until: end of the record, in s.
        smoothest: jumps of higher derivatives are left out.

    Returns:
        All jumps of that order or lower after time 0.

    Raises:
        NotConvergedError: there are more than can be followed; the shortest lag and the record's length are named.

    Source:
        Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapter 2.
    """
    count = system.lags.size
    integrated = np.any(system.Cz != 0.0, axis=1)[:, None] & np.any(system.Bz != 0.0, axis=0)[None, :]
    passed = np.where(system.Dzz != 0.0, 0.0, np.where(integrated, 1.0, math.inf))
    orders: dict[Counts, Floats] = {(0,) * count: entering}
    masses: dict[Counts, Floats] = {(0,) * count: impulse}
    arrived: dict[Counts, tuple[float, Floats]] = {}
    waiting = [(0.0, (0,) * count)]
    while waiting:
        _, counts = heapq.heappop(waiting)
        leaving, mass = orders.pop(counts), masses.pop(counts)
        for k in np.flatnonzero(leaving <= smoothest):
            later = (*counts[:k], counts[k] + 1, *counts[k + 1 :])
            time = math.fsum(n * lag for n, lag in zip(later, system.lags, strict=True))
            if time > until:
                continue
            if later not in orders:
                orders[later], masses[later] = np.full(count, math.inf), np.zeros(count)
                arrived[later] = math.inf, np.zeros(count)
                heapq.heappush(waiting, (time, later))
            orders[later] = np.minimum(orders[later], leaving[k] + passed[:, k])
            masses[later] = masses[later] + system.Dzz[:, k] * mass[k]
            kick = arrived[later][1] + np.where(np.arange(count) == k, mass[k], 0.0)
            arrived[later] = min(arrived[later][0], float(leaving[k])), kick
            if len(arrived) > MOST_BREAKPOINTS:
                message = (
                    f"more than {MOST_BREAKPOINTS} jumps run through the channels within {until:g} s, the shortest lag being "
                    f"{np.min(system.lags):g} s; ask for earlier times"
                )
                raise NotConvergedError(message, until=until, shortest_lag=float(np.min(system.lags)))
    return _merged(arrived, system.lags, until)


def _merged(arrived: dict[Counts, tuple[float, Floats]], lags: Floats, until: float) -> Breakpoints:
    """Sort by time, what meets at one time taken together."""
    listed = sorted(
        ((math.fsum(n * lag for n, lag in zip(c, lags, strict=True)), *entry) for c, entry in arrived.items()), key=lambda item: item[0]
    )
    times: list[float] = []
    orders: list[int] = []
    kicks: list[Floats] = []
    for time, order, kick in listed:
        if times and time - times[-1] <= SAME_TIME * until:
            orders[-1], kicks[-1] = min(orders[-1], int(order)), kicks[-1] + kick
        else:
            times.append(time)
            orders.append(int(order))
            kicks.append(kick)
    return Breakpoints(times=np.array(times), orders=np.array(orders, dtype=np.int64), kicks=np.array(kicks).reshape(len(times), lags.size))
