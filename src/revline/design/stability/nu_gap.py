"""The nu-gap: how far two plants are apart as feedback sees them, and what a controller for one is sure to do on the other.

psi(w) = |P1 - P2| / sqrt((1 + |P1|^2)(1 + |P2|^2)) at jw is the chord between both values on the Riemann sphere. The nu-gap is its largest
value, or 1 where the plants' Nyquist curves, seen along that chord, do not turn alike: where

    wno(1 + P2(-s) P1(s)) + eta(P1) - eta(P2) - eta0(P2)

is not 0, with wno the zeros less the poles right of the axis, counted by the principle of the argument, eta a plant's poles there and
eta0 those at 0. Delays stay exact: on the axis exp(-jw tau) is a number like any other.

The plants are weighed first, P W against C/W. With W = C the loops P C are compared under unit feedback, which has no units.

Source: Vinnicombe (1993), IEEE Transactions on Automatic Control 38(9), 1371-1383; frequency by frequency: Vinnicombe (2000),
Uncertainty and Feedback; plants that are not rational, as with delays: Ball and Sasane (2012), arXiv 1003.0108.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.controller import PidGains
from revline.design.stability.axis_grid import Followed, follow, highest
from revline.design.stability.compared_plant import ComparedPlant, Weight, constant_weight, controller_weight
from revline.design.stability.plant_pair import PlantPair, chord, make_pair
from revline.errors import AnalysisError, InvalidInputError
from revline.units import RadiansPerSecond
from revline.values import make_read_only

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

OPPOSITE = 1e-9
"""Where psi is this near to 1 the curves cannot be told to turn alike, and the gap is 1."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NuGap:
    """How far two plants are apart.

    Attributes:
        first, second: names of the plants.
        weight: what stood in series with both, in words.
        value: the nu-gap, 0 to 1.
        frequency: where the chord is longest, in rad/s; its value there is `longest`.
        longest: largest chord on the axis.
        winding: the sum that must be 0; where it is not, the gap is 1 whatever the chords are.
        omega, psi: chord over frequency, on the grid.
        beyond: above the grid the chord stays below this.
    """

    first: str
    second: str
    weight: str
    value: float
    frequency: RadiansPerSecond
    longest: float
    winding: int
    omega: Floats
    psi: Floats
    beyond: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def bound(self) -> float:
        """What the gap is not above, what lies beyond the grid included."""
        return max(self.value, self.beyond)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Guarantee:
    """What a controller that was designed on a first plant is sure to do on a second.

    Attributes:
        gap: between both plants, weighed.
        gains: of the controller.
        margin: of the controller on the first plant, b: the least chord to what would make the loop oscillate; 0 where it is unstable.
        margin_frequency: where it is, in rad/s.
        chords: to what would make the loop oscillate, first plant, on the gap's grid.
        beyond: above the grid those chords stay above this.
        reserve: least over frequency of arcsin(chord) - arcsin(psi), in rad; above 0 is enough at each frequency by itself.
        reserve_frequency: where it is, in rad/s.
        other_margin: of the controller on the second plant, computed from that plant itself; 0 where it is unstable.
        unstable_poles: of the closed loops with the first and with the second plant, counted from each plant itself.
    """

    gap: NuGap
    gains: PidGains
    margin: float
    margin_frequency: RadiansPerSecond
    chords: Floats
    beyond: float
    reserve: float
    reserve_frequency: RadiansPerSecond
    other_margin: float
    unstable_poles: tuple[float, float]

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def guaranteed(self) -> bool:
        """Whether the gap is below the margin, so that the controller stabilises every plant so near."""
        return self.gap.bound < self.assured

    @property
    def assured(self) -> float:
        """What the margin is not below, what lies beyond the grid included."""
        return min(self.margin, self.beyond)

    @property
    def stable(self) -> bool:
        """Whether the loop with the second plant is stable, counted from that plant itself."""
        return self.unstable_poles[1] == 0

    @property
    def guaranteed_pointwise(self) -> bool:
        """Whether the chord is below the margin's at each frequency, which is enough where the plants turn alike."""
        return self.unstable_poles[0] == 0 and self.gap.bound < 1.0 and self.reserve > 0.0 and self.gap.beyond < self.beyond

    @property
    def floor(self) -> float:
        """What the margin on the second plant is not below: sin(arcsin b - arcsin gap), or 0."""
        return math.sin(max(math.asin(self.assured) - math.asin(self.gap.bound), 0.0))

    @property
    def pointwise_floor(self) -> float:
        """The same from the reserve at each frequency, which is never less."""
        if not self.guaranteed_pointwise:
            return 0.0
        return max(math.sin(min(self.reserve, math.asin(self.beyond) - math.asin(self.gap.beyond))), self.floor)


def find_nu_gap(first: ComparedPlant, second: ComparedPlant, *, weight: Weight | None = None) -> NuGap:
    """Find the nu-gap between two plants, every delay exact.

    Args:
        first: from `plant_of_model` or `plant_of_system`.
        second: another; the gap is the same when they are swapped.
        weight: in series with both; the constant 1 by default, which makes the gap depend on the plants' units.

    Raises:
        InvalidInputError: units differ, or a plant with its weight is improper, or passes a delayed part of its input straight through
            where the other passes any.
        NotConvergedError: a plant cannot be followed along the axis.
        AnalysisError: the turns of the curves make no whole number.

    Example:
        >>> from revline.design.stability.compared_plant import plant_of_model
        >>> from revline.lti.transfer_function import TransferFunction
        >>> one, two = (plant_of_model(TransferFunction(numerator=(k,), denominator=(1.0, 1.0))) for k in (1.0, 2.0))
        >>> round(find_nu_gap(one, two).value, 9)  # where |s + 1|^2 = 2, at 1 rad/s
        0.333333333
    """
    return _gap(make_pair(first, second, weight or constant_weight(1.0), None))[0]


def judge_controller(first: ComparedPlant, second: ComparedPlant, gains: PidGains, *, weight: Weight | None = None) -> Guarantee:
    """Judge what a controller for a first plant is sure to do on a second.

    If the gap is below the margin, the controller stabilises the second plant too, with a margin not below
    sin(arcsin margin - arcsin gap). The converse does not hold: a gap above the margin proves nothing for this one plant, but some plant
    as near as that is destabilised.

    Args:
        first: the plant that the controller was designed on.
        second: the plant that it is to serve.
        gains: of the controller.
        weight: in series with both plants; the controller itself by default.

    Raises:
        InvalidInputError: see `find_nu_gap`; or plant and controller do not meet, or an unfiltered derivative leaves no margin under a
            constant weight.
        NotConvergedError: a closed-loop pole lies on the imaginary axis, or a plant cannot be followed along it.
        AnalysisError: two counts of the closed loops' unstable poles differ: a plant hides an unstable part.

    Source:
        Vinnicombe (1993); frequency by frequency: Vinnicombe (2000), Uncertainty and Feedback.
    """
    weight = weight or controller_weight(gains)
    if weight.gains is None and gains.kd != 0.0:
        message = (
            f"kd = {gains.kd:g} without a filter: under a constant weight the controller answers noise at high frequency without end, "
            "which leaves a margin of 0; weigh by the controller instead"
        )
        raise InvalidInputError(message, kd=gains.kd)
    pair = make_pair(first, second, weight, gains)
    counts = (first.unstable_closed(gains), second.unstable_closed(gains))
    gap, followed = _gap(pair)
    _check_counts(pair, followed, counts)
    grid, (end, other_end) = followed.grid, pair.end_chords()
    end_psi = float(chord(np.array(pair.ends[0]), np.array(pair.ends[1])))
    chords, other_chords = pair.chords_of(followed.values[:2], grid)
    margin, at = _lowest(lambda w: pair.chords(w)[0], grid, chords, end)
    other, _ = _lowest(lambda w: pair.chords(w)[1], grid, other_chords, other_end)
    reserve, where = _lowest(
        lambda w: np.arcsin(pair.chords(w)[0]) - np.arcsin(pair.psi(w)),
        grid,
        np.arcsin(chords) - np.arcsin(gap.psi),
        math.asin(end) - math.asin(end_psi),
    )
    return Guarantee(
        gap=gap,
        gains=gains,
        margin=margin if counts[0] == 0 else 0.0,
        margin_frequency=at,
        chords=chords,
        beyond=max(end - pair.drift(float(grid[-1])), 0.0),
        reserve=reserve,
        reserve_frequency=where,
        other_margin=other if counts[1] == 0 else 0.0,
        unstable_poles=counts,
    )


def _gap(pair: PlantPair) -> tuple[NuGap, Followed]:
    """Give the gap, and the functions followed: those of `PlantPair.followed`, and last, unless the gap is 1 anyhow, 1 + P2* P1."""
    start = np.geomspace(0.01 * pair.low(), pair.high(), 200)
    followed = follow(pair.followed, start, delay=pair.delay, name=pair.name)
    longest, frequency = highest(pair.psi, followed.grid, chord(*followed.values[:2]))
    end = float(chord(np.array(pair.ends[0]), np.array(pair.ends[1])))
    if end > longest:
        longest, frequency = end, float(followed.grid[-1])
    opposite, winding = longest >= 1.0 - OPPOSITE, 0
    if not opposite:

        def evaluate(w: Floats) -> Complexes:
            return np.concatenate((pair.followed(w), pair.opposite(w)[None]))

        followed = follow(evaluate, followed.grid, delay=pair.delay, name=f"1 + P2* P1 of {pair.name}")
        winding = _winding(pair, followed)
    gap = NuGap(
        first=pair.plants[0].name,
        second=pair.plants[1].name,
        weight=pair.weight.text,
        value=1.0 if opposite or winding else longest,
        frequency=frequency,
        longest=longest,
        winding=winding,
        omega=followed.grid,
        psi=chord(*followed.values[:2]),
        beyond=min(end + float(np.sum(pair.distances_from_end(followed.grid[-1:]))), 1.0),
    )
    return gap, followed


def _lowest(function: Callable[[Floats], Floats], grid: Floats, sizes: Floats, end: float) -> tuple[float, float]:
    """Least value on the grid or at its end, infinity, and where."""
    value, frequency = highest(lambda w: -function(w), grid, -sizes)
    return (-value, frequency) if -value <= end else (end, float(grid[-1]))


def _winding(pair: PlantPair, followed: Followed) -> int:
    """The sum that must be 0."""
    (one, two), (first, second) = pair.orders, pair.plants
    leading = pair.at_rest(float(followed.grid[0]))[0].real
    product = float(leading[0] * leading[1]) * (-1.0) ** two
    wno = _zeros_less_poles(followed.values[-1], product, one + two, 1.0 + pair.ends[0] * pair.ends[1])
    return wno + first.unstable_poles - second.unstable_poles - max(two, 0)


def _zeros_less_poles(values: Complexes, leading: float, order: int, end: float) -> int:
    """Zeros less poles right of the axis of a function that was followed up the axis, its poles at 0 passed on the right.

    The function begins as 1 + leading/s^order and goes to `end`.
    """
    begin = complex(np.sign(leading)) * 1j**-order if order > 0 else complex(math.copysign(1.0, 1.0 + (leading if order == 0 else 0.0)))
    turned = float(np.sum(np.angle(values[1:] / values[:-1])) + np.angle(values[0] / begin) + np.angle(end / values[-1]))
    return round(0.5 * max(order, 0) - turned / math.pi)


def _check_counts(pair: PlantPair, followed: Followed, counted: tuple[float, float]) -> None:
    """Compare the unstable poles of the closed loops with the turns of 1 + P C, which know nothing of how they were counted."""
    leading = pair.at_rest(float(followed.grid[0]))[1].real
    for k, plant in enumerate(pair.plants):
        if not math.isfinite(counted[k]):
            continue
        turns = _zeros_less_poles(followed.values[2 + k], float(leading[k]), pair.loop_orders[k], pair.loop_ends()[k])
        if plant.unstable_poles + turns != round(counted[k]):
            message = (
                f"the closed loop with {plant.name} has {counted[k]:g} unstable poles, but by its Nyquist curve "
                f"{plant.unstable_poles + turns}: the plant hides an unstable part; leave out what the input does not reach"
            )
            raise AnalysisError(message, counted=counted[k], turned=plant.unstable_poles + turns)
