"""Two plants in series with one weight, and what feeds both back: what is followed along the imaginary axis to compare them.

Source: Vinnicombe (1993), IEEE Transactions on Automatic Control 38(9), 1371-1383.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.design.controllers.controller import PidGains
from revline.design.stability.compared_plant import ComparedPlant, Weight
from revline.errors import InvalidInputError, NotConvergedError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

FLOOR = 1e-2
"""The grid ends where both weighed plants, and their loops, stay this near to their values at infinite frequency, relative to the largest
distance from these where that is below 1. Nearer would make long delays dear and change nothing: beyond the grid all is bounded."""

LOW = 1e-3
"""Frequency at which the grid begins, unless it must be lowered, in rad/s."""

LOWEST = 1e-12
"""Lowest beginning, in rad/s."""

HIGHEST = 1e9
"""A plant that has not reached its value at infinite frequency here, in rad/s, has none."""

AT_REST = 0.02
"""The grid begins where the leading powers of s rule within this."""

FILTER = "filter the derivative, kd s/(1 + s kd/(N kp)) with N of 5 to 20, or add the actuator's lag"


def chord(one: Complexes, two: Complexes) -> Floats:
    """Chord between complex numbers on the Riemann sphere of diameter 1."""
    length: Floats = np.minimum(np.abs(one - two) / (np.hypot(1.0, np.abs(one)) * np.hypot(1.0, np.abs(two))), 1.0)
    return length


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantPair:
    """Two weighed plants P W, and what feeds them back: C/W, or nothing.

    Attributes:
        plants: the plants without weight.
        weight: in series with both.
        gains: of the controller C; none where plants are compared without one.
        ends: of the weighed plants at infinite frequency, without their delay.
    """

    plants: tuple[ComparedPlant, ComparedPlant]
    weight: Weight
    gains: PidGains | None
    ends: tuple[float, float]

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.plants[0].name} or {self.plants[1].name} weighed by {self.weight.text}"

    @property
    def delay(self) -> float:
        """The longest delay, in s."""
        return max(plant.delay for plant in self.plants)

    @property
    def orders(self) -> tuple[int, int]:
        """Poles less zeros at s = 0 of the weighed plants."""
        one, two = (plant.order_at_rest + self.weight.poles_at_rest for plant in self.plants)
        return one, two

    @property
    def loop_orders(self) -> tuple[int, int]:
        """Poles less zeros at s = 0 of the loops P C."""
        integral = int(self.gains is not None and self.gains.ki != 0.0)
        one, two = (plant.order_at_rest + integral for plant in self.plants)
        return one, two

    def weighed(self, w: Floats) -> Complexes:
        """Give P W of both plants, shape (2, n), at frequencies in rad/s, shape (n,)."""
        s = 1j * w
        return np.array([plant.transfer(s) for plant in self.plants]) * self.weight.transfer(s)

    def back(self, w: Floats) -> Complexes:
        """Give C/W, shape (n,)."""
        if self.gains is None or self.weight.gains is not None:
            return np.ones(w.shape, dtype=complex)
        return np.asarray(self.gains.feedback_transfer(1j * w) / self.weight.transfer(1j * w))

    def followed(self, w: Floats) -> Complexes:
        """Give both weighed plants, then 1 + P C of both where there is a controller, shape (2 or 4, n)."""
        values = self.weighed(w)
        return values if self.gains is None else np.concatenate((values, 1.0 + values * self.back(w)))

    def psi(self, w: Floats) -> Floats:
        """Give the chord between both weighed plants, shape (n,)."""
        return chord(*self.weighed(w))

    def opposite(self, w: Floats) -> Complexes:
        """Give 1 + P2* P1 of the weighed plants, which is 0 where they lie at opposite ends of the sphere, shape (n,)."""
        one, two = self.weighed(w)
        return np.asarray(1.0 + two.conj() * one)

    def chords(self, w: Floats) -> Floats:
        """Give the chords of both weighed plants to -W/C, where the loop oscillates, shape (2, n)."""
        return self.chords_of(self.weighed(w), w)

    def chords_of(self, values: Complexes, w: Floats) -> Floats:
        """Give the same from values of both weighed plants, shape (2, n)."""
        back = self.back(w)
        sizes = np.hypot(1.0, np.abs(values)) * np.hypot(1.0, np.abs(back))
        return np.asarray(np.minimum(np.abs(1.0 + values * back) / sizes, 1.0))

    def back_end(self) -> float:
        """Give C/W at infinite frequency, the derivative left out, which no constant weight meets."""
        return self.gains.kp / self.weight.leading if self.gains is not None and self.weight.gains is None else 1.0

    def end_chords(self) -> tuple[float, float]:
        """Give the least chords to oscillation at infinite frequency."""
        back = self.back_end()
        one, two = (
            abs(1.0 + (-abs(end * back) if plant.delay else end * back)) / (math.hypot(1.0, end) * math.hypot(1.0, back))
            for plant, end in zip(self.plants, self.ends, strict=True)
        )
        return one, two

    def drift(self, w: float) -> float:
        """Give by how much the first plant's chord to oscillation may still fall below its least value at infinite frequency."""
        at = np.array([w])
        return float(self.distances_from_end(at)[0, 0] + abs(self.back(at)[0] - self.back_end()))

    def loop_ends(self) -> tuple[float, float]:
        """Give what 1 + P C goes to at infinite frequency, or the middle of where it stays."""
        back = self.back_end()
        one, two = (1.0 + (0.0 if plant.delay else end * back) for plant, end in zip(self.plants, self.ends, strict=True))
        return one, two

    def at_rest(self, w: float) -> tuple[Complexes, Complexes]:
        """Give weighed plants and loops over their leading powers of s, each of shape (2,): real, and constant towards s = 0."""
        grid = np.array([w])
        values = self.weighed(grid)[:, 0]
        loops = values * self.back(grid)[0]
        return values * (1j * w) ** np.array(self.orders), loops * (1j * w) ** np.array(self.loop_orders)

    def low(self) -> float:
        """Find a frequency below which the leading powers of s rule, in rad/s.

        Raises:
            NotConvergedError: none rules down to the lowest frequency.
        """
        low = LOW
        while low >= LOWEST:
            here, below = (np.concatenate(self.at_rest(w)) for w in (low, 0.1 * low))
            near = np.all(np.abs(here - below) <= AT_REST * np.abs(below)) and np.all(np.abs(below.imag) <= AT_REST * np.abs(below))
            if near and self._outweighs(here, low):
                return low
            low *= 0.1
        message = (
            f"{self.name}: no leading power of s rules down to {LOWEST:g} rad/s; leave out poles and zeros so slow, or so small a gain"
        )
        raise NotConvergedError(message, frequency=LOWEST)

    def _outweighs(self, leading: Complexes, w: float) -> bool:
        """Whether what has poles at 0 is far above 1 at a frequency, and what has zeros there far below: both loops, and P2* P1."""
        sizes = np.abs(np.array([leading[0] * leading[1], *leading[2:]]))
        orders = (sum(self.orders),) if self.gains is None else (sum(self.orders), *self.loop_orders)
        return all((n == 0) or (n > 0) == (size * w**-n > 1.0) for n, size in zip(orders, sizes, strict=False)) and all(
            n == 0 or abs(math.log(size * w**-n)) > -math.log(AT_REST) for n, size in zip(orders, sizes, strict=False)
        )

    def distances_from_end(self, w: Floats) -> Floats:
        """Give how far the weighed plants are from their values at infinite frequency, their delays turning, shape (2, n)."""
        turns = np.array([np.exp(-1j * w * plant.delay) for plant in self.plants])
        return np.asarray(np.abs(self.weighed(w) - np.array(self.ends)[:, None] * turns))

    def high(self) -> float:
        """Find a frequency beyond which both weighed plants stay near their values at infinite frequency, in rad/s.

        Raises:
            InvalidInputError: there is none: improper, or nearly so.
        """
        grid = np.geomspace(LOW, HIGHEST, 60 * round(math.log10(HIGHEST / LOW)))
        distances = self.distances_from_end(grid) * np.maximum(np.abs(self.back(grid)), 1.0)
        above = np.flatnonzero(~np.all(distances < FLOOR * float(np.clip(np.max(distances), 1e-4, 1.0)), axis=0))
        if above.size and above[-1] == grid.size - 1:
            message = (
                f"{self.name} does not fall up to {HIGHEST:g} rad/s and is improper, or nearly so: distances there mean nothing; {FILTER}"
            )
            raise InvalidInputError(message)
        return float(grid[above[-1] + 1]) if above.size else float(grid[1])


def make_pair(first: ComparedPlant, second: ComparedPlant, weight: Weight, gains: PidGains | None) -> PlantPair:
    """Put a weight in series with two plants.

    Args:
        first: a plant.
        second: a plant of the same units.
        weight: in series with both.
        gains: of the controller, where there is one.

    Raises:
        InvalidInputError: units differ, a plant with its weight is improper, both pass their inputs straight through and one of them
            late, or integral action meets a zero at s = 0.
    """
    if first.units != second.units:
        message = f"{first.name} goes from {' to '.join(first.units)}, {second.name} from {' to '.join(second.units)}; convert one of them"
        raise InvalidInputError(message)
    if gains is not None and first.units != (gains.output_unit, gains.input_unit):
        units = f"{gains.input_unit} to {gains.output_unit}"
        message = f"{first.name} goes from {' to '.join(first.units)}, the controller from {units}; convert one of them"
        raise InvalidInputError(message)
    one, two = _end(first, weight), _end(second, weight)
    if one and two and (first.delay or second.delay):
        message = (
            f"{first.name} and {second.name} weighed by {weight.text} pass their input straight through, and one with a delay: their "
            f"distance has no limit at high frequency; {FILTER}"
        )
        raise InvalidInputError(message)
    for plant in (first, second):
        if gains is not None and gains.ki != 0.0 and plant.order_at_rest < 0:
            message = f"the integral action cancels a zero of {plant.name} at s = 0, and would never settle; leave it out: ki = 0"
            raise InvalidInputError(message, name=plant.name)
    return PlantPair(plants=(first, second), weight=weight, gains=gains, ends=(one, two))


def _end(plant: ComparedPlant, weight: Weight) -> float:
    """Value of the weighed plant at infinite frequency, without its delay."""
    excess = plant.excess - weight.rise
    if excess < 0:
        message = (
            f"{plant.name} weighed by {weight.text} is improper: it rises at high frequency, so that distances there mean nothing; {FILTER}"
        )
        raise InvalidInputError(message, name=plant.name)
    return plant.leading * weight.leading if excess == 0 else 0.0
