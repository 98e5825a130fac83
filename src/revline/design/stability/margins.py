"""Margins of a loop with its delay exact: every crossover, and how far gain, phase, delay and a disk about them may change.

The loop is evaluated on a grid that is refined until neither its phase, delay included, nor its magnitude changes much between
neighbours; each crossing is then found by root finding and each peak by minimisation.

Source: Astrom and Hagglund (2006), Advanced PID Control, section 4.6; disk margins: Seiler, Packard and Gahinet (2020), IEEE Control
Systems Magazine 40(5), 78-95.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.design.stability.axis_grid import Features, Sought, find_features, follow
from revline.design.stability.open_loop import OpenLoop
from revline.errors import InvalidInputError, RevlineError, out_of_range

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

FLOOR = 1e-3
"""Where the magnitude stays below this, crossings of the phase are not looked for: the gain may rise 1000 times."""

LARGE = 1e3
"""A loop gain from which the loop follows its command: the complementary sensitivity is 1 there to a thousandth."""

LOWEST = 1e-12
"""Lowest frequency to which the search is extended, in rad/s."""

LEAST = 1e-100
"""Lowest frequency that may be asked for, in rad/s: far below, products of frequencies leave the range of numbers."""

HIGHEST = 1e9
"""A loop that has not fallen below the floor at this frequency, in rad/s, does not fall."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GainCrossover:
    """A frequency at which the loop gain is 1.

    Attributes:
        frequency: in rad/s.
        phase_margin_deg: phase above -180 degrees there, -180 to 180.
        delay_margin: further delay that makes the loop oscillate there, in s.
    """

    frequency: float
    phase_margin_deg: float
    delay_margin: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseCrossover:
    """A frequency at which the loop's phase is -180 degrees, up to whole turns.

    Attributes:
        frequency: in rad/s.
        gain_margin: factor of the gain that makes the loop oscillate there.
    """

    frequency: float
    gain_margin: float

    @property
    def gain_margin_db(self) -> float:
        """The factor in decibels."""
        return 20.0 * math.log10(self.gain_margin)


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """A largest magnitude over frequency."""

    value: float
    frequency: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Margins:
    """Margins of a loop. Of an unstable loop they say how far it is from stability, if a change of that kind gives any.

    Attributes:
        loop: its name.
        stable: whether the closed loop is stable.
        unstable_poles: of the closed loop; infinite where the delay makes them so.
        gain_crossovers: all, by rising frequency.
        phase_crossovers: all between the ends of the grid, by rising frequency.
        sensitivity: peak of 1/|1 + L|, Ms.
        complementary: peak of |L/(1 + L)|, Mt.
        disk: peak of |(1 - L)/(1 + L)|/2; its inverse is the disk margin.
        searched: lowest and highest frequency of the grid, in rad/s.
        points: on the grid.
    """

    loop: str
    stable: bool
    unstable_poles: float
    gain_crossovers: tuple[GainCrossover, ...]
    phase_crossovers: tuple[PhaseCrossover, ...]
    sensitivity: Peak
    complementary: Peak
    disk: Peak
    searched: tuple[float, float]
    points: int

    @property
    def gain_rise(self) -> PhaseCrossover | None:
        """The crossing that limits a rise of the gain; none where the gain may rise without end, up to the grid's highest frequency."""
        return min((c for c in self.phase_crossovers if c.gain_margin > 1.0), key=lambda c: c.gain_margin, default=None)

    @property
    def gain_fall(self) -> PhaseCrossover | None:
        """The crossing that limits a fall of the gain; none where the gain may fall to nothing."""
        return max((c for c in self.phase_crossovers if c.gain_margin < 1.0), key=lambda c: c.gain_margin, default=None)

    @property
    def phase(self) -> GainCrossover | None:
        """The crossover with the smallest phase margin; none where the loop gain never is 1."""
        return min(self.gain_crossovers, key=lambda c: abs(c.phase_margin_deg), default=None)

    @property
    def delay(self) -> GainCrossover | None:
        """The crossover with the smallest delay margin; none where the loop gain never is 1."""
        return min(self.gain_crossovers, key=lambda c: c.delay_margin, default=None)

    @property
    def disk_margin(self) -> float:
        """Disk margin alpha: gain may change by factors from (2 - alpha)/(2 + alpha) to its inverse, phase by 2 atan(alpha/2), at once."""
        return 1.0 / self.disk.value


def _above_one(values: Complexes) -> Floats:
    return np.asarray(np.abs(values) - 1.0)


MEASURES: Final[tuple[Callable[[Complexes], Floats], ...]] = (
    lambda v: np.asarray(np.abs(1.0 / (1.0 + v))),
    lambda v: np.asarray(np.abs(1.0 - 1.0 / (1.0 + v))),
    lambda v: np.asarray(np.abs(1.0 / (1.0 + v) - 0.5)),
)
"""Of the loop's value: the sensitivity, its complement, and that about which a disk lies."""


def find_margins(loop: OpenLoop, *, low: float = 1e-3) -> Margins:
    """Find all crossovers and margins of a loop.

    Args:
        loop: from `open_loop_of_model` or `open_loop_of_system`.
        low: lowest frequency looked at, in rad/s; lowered where the loop gain is not large there and still rises towards lower ones.

    Raises:
        InvalidInputError: the frequency lies outside 1e-100 to 1e9 rad/s, or the loop is none, or improper: its gain does not fall high up.
        NotConvergedError: the loop turns too fast for the grid, or has a pole on the imaginary axis within it.
    """
    followed = _follow(loop, low)
    return _gather(followed, find_features([followed.sought])[0])


def find_margins_each(loops: Sequence[OpenLoop], *, low: float = 1e-3) -> tuple[Margins | RevlineError, ...]:
    """Find all crossovers and margins of some loops as `find_margins` does, their searches in the same rounds.

    Args:
        loops: as for `find_margins`.
        low: as for `find_margins`.

    Returns:
        Of each loop its margins, or why it has none.
    """
    found: list[Margins | RevlineError | _FollowedLoop] = []
    for loop in loops:
        try:
            found.append(_follow(loop, low))
        except RevlineError as error:
            found.append(error)
    followed = [one for one in found if isinstance(one, _FollowedLoop)]
    try:
        features = iter(find_features([one.sought for one in followed])) if followed else iter(())
        return tuple(_gather(one, next(features)) if isinstance(one, _FollowedLoop) else one for one in found)
    except RevlineError:  # of one of them: the others are not to suffer
        return tuple(_alone(one) if isinstance(one, _FollowedLoop) else one for one in found)


class _FollowedLoop(NamedTuple):
    """A loop with the grid on which it was followed, and what is sought there."""

    loop: OpenLoop
    sought: Sought


def _alone(followed: _FollowedLoop) -> Margins | RevlineError:
    try:
        return _gather(followed, find_features([followed.sought])[0])
    except RevlineError as error:
        return error


def _follow(loop: OpenLoop, low: float) -> _FollowedLoop:
    if not LEAST <= low < HIGHEST:
        raise out_of_range("lowest frequency", low, "rad/s", f"{LEAST:g} to {HIGHEST:g} rad/s", "give one well below the loop's bandwidth")
    low = _bottom(loop, low)
    start = np.geomspace(low, _top(loop, low), 200)
    grid, followed = follow(lambda w: _values(loop, w)[None], start, delay=loop.delay, name=f"the loop {loop.name}")
    crossings: tuple[Callable[[Complexes], Floats], ...] = (_above_one, phase_sine)
    sizes = [function(followed[0]) for function in (*crossings, *MEASURES)]
    return _FollowedLoop(loop, Sought(lambda w: _values(loop, w), crossings, MEASURES, grid, sizes))


def _gather(followed: _FollowedLoop, found: Features) -> Margins:
    loop, grid = followed.loop, followed.sought.grid
    (unity, turns), peaks = found.roots, [Peak(value=value, frequency=frequency) for value, frequency in found.peaks]
    return Margins(
        loop=loop.name,
        stable=loop.stable,
        unstable_poles=loop.unstable_poles,
        gain_crossovers=tuple(gain_crossover(float(w), complex(v)) for w, v in zip(unity, _values(loop, unity), strict=True)),
        phase_crossovers=tuple(
            PhaseCrossover(frequency=float(w), gain_margin=1.0 / abs(complex(v)))
            for w, v in zip(turns, _values(loop, turns), strict=True)
            if v.real < 0.0
        ),
        sensitivity=peaks[0],
        complementary=peaks[1],
        disk=peaks[2],
        searched=(float(grid[0]), float(grid[-1])),
        points=grid.size,
    )


def _values(loop: OpenLoop, omega: Floats) -> Complexes:
    return np.asarray(loop.transfer(1j * omega))


def phase_sine(values: Complexes) -> Floats:
    """Give the sine of the phase of values that are not 0, shape (n,): it changes its sign where they are real."""
    return np.asarray(values.imag / np.abs(values))


def _at(loop: OpenLoop, omega: float) -> complex:
    return complex(_values(loop, np.array([omega]))[0])


def _bottom(loop: OpenLoop, low: float) -> float:
    """Lower a frequency until the loop gain is large there, or rises no more towards it: a slow loop crosses 1, and follows, far below."""
    while low > LOWEST:
        here, below = abs(_at(loop, low)), abs(_at(loop, 0.1 * low))
        if here > LARGE or below < 2.0 * here:
            break
        low *= 0.1
    return low


def _top(loop: OpenLoop, low: float) -> float:
    """A frequency beyond which the loop gain stays below the floor."""
    grid = np.geomspace(low, HIGHEST, 60 * max(1, round(math.log10(HIGHEST / low))))
    sizes = np.abs(_values(loop, grid))
    if not np.any(sizes):
        message = f"the loop {loop.name} is 0 at every frequency, so that there are no margins; give the controller a gain"
        raise InvalidInputError(message)
    above = np.flatnonzero(~(sizes < FLOOR))
    if above.size and above[-1] == grid.size - 1:
        message = (
            f"the gain of the loop {loop.name} stays at {sizes[-1]:.3g} however high the frequency: it is improper, or nearly so, as a "
            "derivative on a single lag is, and its margins there mean nothing; filter the derivative, kd s/(1 + s kd/(N kp)) with N of 5 "
            "to 20, or add the actuator's lag"
        )
        raise InvalidInputError(message, gain=float(sizes[-1]))
    return float(grid[above[-1] + 1]) if above.size else float(grid[1])


def gain_crossover(omega: float, value: complex) -> GainCrossover:
    """Give the margins at a frequency in rad/s from the loop's value of magnitude 1 there."""
    above = math.atan2(-value.imag, -value.real)  # phase of -L: phase above -180 degrees
    return GainCrossover(frequency=omega, phase_margin_deg=math.degrees(above), delay_margin=(above % (2.0 * math.pi)) / omega)
