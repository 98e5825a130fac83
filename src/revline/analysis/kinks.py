"""Periodic motions on elements, when equations switch along them, and when channels deliver such an instant.

Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, for breakpoints that delays pass on.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from revline.analysis.jacobians import evaluate
from revline.analysis.pieces import SAME, Pieces
from revline.analysis.switching import switching_values
from revline.system import DelaySystem, Floats

LOOKS = 12
"""Places in each element at which it is looked whether the equations have switched."""

CLOSE = 2e-15
"""To how much a place is enclosed, as a part of the period: some units of rounding."""

MOST_NARROWINGS = 250
"""Enough to halve an enclosure to that even where only every fifth step does; curves that are smooth take about ten."""

REFINEMENTS = 8
"""How many times the neighbourhood of an extreme is narrowed, eightfold each time."""


@dataclass(frozen=True, slots=True)
class PiecewiseCycle:
    """A cycle on elements: its period in s, and at the nodes its states and what the channels deliver."""

    pieces: Pieces
    period: float
    states: Floats
    readings: Floats

    def points(self, system: DelaySystem, inputs: Floats, times: Floats) -> tuple[Floats, Floats]:
        """States and readings at any times, in parts of the period."""
        x, zd = self.pieces.read(self.states, times), self.pieces.read(self.readings, times)
        if not system.channels:
            return x, zd
        u, all_u = np.tile(inputs, (times.size, 1)), np.tile(inputs, (self.states.shape[0], 1))
        entering = evaluate(system, system.emit, self.states, all_u, self.readings)
        for _ in system.channels:  # a lag may read an earlier channel
            lags = evaluate(system, system.lags, x, u, zd)
            zd = self.pieces.read(entering, times[:, None] - lags / self.period)
        return x, zd

    def on(self, pieces: Pieces) -> "PiecewiseCycle":
        """Read the cycle at the nodes of other elements."""
        times = pieces.times
        return PiecewiseCycle(pieces, self.period, self.pieces.read(self.states, times), self.pieces.read(self.readings, times))


def find_kinks(system: DelaySystem, inputs: Floats, solved: PiecewiseCycle, generations: int) -> tuple[Floats, Floats]:
    """Find when the equations switch along a cycle, and when channels deliver these instants.

    Args:
        system: whose cycle it is.
        inputs: constant, shape (n_inputs,).
        solved: the cycle.
        generations: how many times in a row instants are followed through the channels; below 0 nothing is looked for.

    Returns:
        The switches, and all kinks, both in parts of the period, rising.
    """
    if generations < 0:
        return np.empty(0), np.empty(0)

    def switching(times: Floats) -> Floats:
        x, zd = solved.points(system, inputs, times)
        return switching_values(system, x, np.tile(inputs, (times.size, 1)), zd)

    def delivered(times: Floats) -> Floats:
        x, zd = solved.points(system, inputs, times)
        return times[:, None] - evaluate(system, system.lags, x, np.tile(inputs, (times.size, 1)), zd) / solved.period

    looks = _looks(solved.pieces)
    switches = _distinct(_crossings(switching, looks, np.zeros(1)))
    last, every = switches, [switches]
    reach = delivered(looks) if system.channels and switches.size else np.empty((0, 0))
    for _ in range(generations if reach.size else 0):
        turns = np.arange(np.floor(np.min(reach)) - 1.0, np.ceil(np.max(reach)) + 1.0)
        last = _distinct(_crossings(delivered, looks, (last + turns[:, None]).ravel()))
        every.append(last)
    return switches, _distinct(np.concatenate(every))


def _distinct(times: Floats) -> Floats:
    """Sort parts of the period, and take those as one that are."""
    ordered = np.sort(times % 1.0)
    return ordered[np.diff(ordered, prepend=-1.0) > SAME]


def _looks(pieces: Pieces) -> Floats:
    """Places at which to look, from 0 to 1."""
    inner = np.arange(LOOKS) / LOOKS
    return np.append((pieces.ends[:-1, None] + pieces.lengths[:, None] * inner).ravel(), 1.0)


def _crossings(function: Callable[[Floats], Floats], looks: Floats, levels: Floats) -> Floats:
    """Where columns of a function of time pass levels."""
    values = function(looks)
    above = values[:, :, None] > levels
    at, column, which = np.nonzero(above[1:] != above[:-1])
    if not at.size:
        return np.empty(0)
    own, level = np.arange(at.size), levels[which]
    ends = (values[at, column] - level, values[at + 1, column] - level)
    return enclose(lambda times: function(times)[own, column] - level, (looks[at], looks[at + 1]), ends)


def enclose(function: Callable[[Floats], Floats], places: tuple[Floats, Floats], values: tuple[Floats, Floats]) -> Floats:
    """Narrow enclosures of a change between values above 0 and others: by interpolation, and by halving where four steps did not do so.

    Args:
        function: takes a place of each enclosure, shape (n,), to its value.
        places: two ends of each enclosure, shape (n,).
        values: at the ends.

    Returns:
        A place of each enclosure at most twice `CLOSE` from the change.

    Source: Chandrupatla (1997), Advances in Engineering Software 28(3), 145-149.
    """
    (new, other), (f_new, f_other) = places, values
    share = np.full(new.size, 0.5)
    widths = [np.abs(other - new)]
    while np.any(widths[-1] > 2.0 * CLOSE) and len(widths) <= MOST_NARROWINGS:
        tried = new + share * (other - new)
        f_tried = function(tried)
        same = (f_tried > 0.0) == (f_new > 0.0)
        old, f_old = np.where(same, new, other), np.where(same, f_new, f_other)  # on the same side as what is tried
        other, f_other = np.where(same, other, new), np.where(same, f_other, f_new)
        new, f_new = tried, f_tried
        widths.append(np.abs(other - new))
        with np.errstate(all="ignore"):
            inner = _share((new, other, old), (f_new, f_other, f_old), widths[-1] / widths[0])
            least = np.minimum(CLOSE / widths[-1], 0.5)
        falls = widths[-1] <= 0.5 * widths[max(len(widths) - 5, 0)]
        share = np.clip(np.where(falls & np.isfinite(inner), inner, 0.5), least, 1.0 - least)
    found: Floats = np.where(np.abs(f_new) <= np.abs(f_other), new, other)
    return found


def _share(places: tuple[Floats, Floats, Floats], values: tuple[Floats, Floats, Floats], narrowed: Floats) -> Floats:
    """At which part of the way from the newest end to the other to try next; where a limit holds, all values beyond it are exactly 0."""
    (new, other, old), (f_new, f_other, f_old) = places, values
    part, height = (new - other) / (old - other), (f_new - f_other) / (f_old - f_other)
    sure = (height**2 < part) & ((1.0 - height) ** 2 < 1.0 - part)  # then the inverse parabola rises or falls throughout
    parabola = f_new / (f_other - f_new) * f_old / (f_other - f_old)
    parabola += (old - new) / (other - new) * f_new / (f_old - f_new) * f_other / (f_old - f_other)
    line = f_new * (old - new) / (f_new - f_old) / (other - new)  # through the two of one side, to where it meets 0
    curved = np.where(sure, parabola, 0.5)
    beyond = np.where(f_old == 0.0, 0.5, np.minimum(narrowed, 0.5))  # the line fell just beyond, or else the way is far
    return np.where(f_new == 0.0, beyond, np.where((f_other == 0.0) & (line > 0.0) & (line < 1.0), line, curved))


def find_extremes(function: Callable[[Floats], Floats], pieces: Pieces) -> tuple[float, float]:
    """Lowest and highest value of a function of time, sought between the best of many places and its neighbours."""
    looks = _looks(pieces)
    values = function(looks)
    return _lowest(function, looks, values), -_lowest(lambda times: -function(times), looks, -values)


def _lowest(function: Callable[[Floats], Floats], looks: Floats, values: Floats) -> float:
    """Narrow the neighbourhood of the lowest of some places eightfold at a time."""
    best = int(np.argmin(values))
    low, high = looks[max(best - 1, 0)], looks[min(best + 1, looks.size - 1)]
    lowest = float(values[best])
    for _ in range(REFINEMENTS):
        places = np.linspace(low, high, 17)
        values = function(places)
        best = int(np.argmin(values))
        lowest = min(lowest, float(values[best]))
        low, high = places[max(best - 1, 0)], places[min(best + 1, 16)]
    return lowest
