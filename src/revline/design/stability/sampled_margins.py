"""Margins of a loop whose plant is known by samples of its frequency response alone: within their band, with an error estimate.

The plant's magnitude and phase, a known delay taken out, are interpolated by cubic splines over the logarithm of the frequency; the
controller and the delay are exact. Half the samples, twice, tell how far the interpolation may be wrong; an error that the samples
themselves have, noise or a wrong scale, no such comparison can see.

Source: Astrom and Hagglund (2006), Advanced PID Control, section 4.6; interpolation: de Boor (1978), A Practical Guide to Splines,
chapter IV; encirclements: Nyquist (1932), Bell System Technical Journal 11, 126-147.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from revline.design.controllers.controller import PidGains
from revline.design.stability.axis_grid import highest, roots_between
from revline.design.stability.margins import GainCrossover, Peak, PhaseCrossover, gain_crossover, phase_sine
from revline.errors import InvalidInputError
from revline.lti.response import FrequencyResponse
from revline.units import DEGREE

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

FEWEST = 8
"""Fewest samples: half of them must still carry a cubic."""

PHASE_STEP_DEG = 100.0
"""Largest step of the phase between neighbours, the known delay taken out, in degrees; near 180 the direction is a guess."""

SIZE_STEP = 10.0
"""Largest factor between the magnitudes of neighbours."""

STATIC_PHASE_DEG = 30.0
"""Largest distance of the plant's phase at the lowest sample from 0 or 180 degrees for which the count of encirclements is closed there."""

MOST_POINTS = 400_000
"""Most frequencies on the grid between the samples."""

_FINE, _TURN = 32, 0.1
_FAST, _PASSES = 0.5, 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledMargins:
    """Margins within the band of the samples. What is not found there is not known: it is neither 0 nor infinite.

    Attributes:
        loop: its name.
        band: lowest and highest sample, in rad/s.
        samples: how many.
        gain_crossovers: all within the band, by rising frequency.
        phase_crossovers: all within the band, by rising frequency.
        sensitivity: peak of 1/|1 + L| in the band, Ms; a lower bound of that over all frequencies.
        complementary: peak of |L/(1 + L)| in the band, Mt; a lower bound likewise.
        disk: peak of |(1 - L)/(1 + L)|/2 in the band; its inverse is an upper bound of the disk margin.
        errors: estimated error by interpolation of each margin that there is: "gain_margin", "gain_reduction_margin",
            "phase_margin_deg", "delay_margin_s", "ms", "mt", "disk_margin"; absent where half of the samples do not confirm the margin.
        assumed_unstable_poles: of the open loop, as the caller said.
        unstable_poles: of the closed loop under that, by the encirclements within the band; at most one, none where the curve cannot
            be closed outside the band.
        notes: what lies outside the band and what the numbers do not say.
    """

    loop: str
    band: tuple[float, float]
    samples: int
    gain_crossovers: tuple[GainCrossover, ...]
    phase_crossovers: tuple[PhaseCrossover, ...]
    sensitivity: Peak
    complementary: Peak
    disk: Peak
    errors: Mapping[str, float]
    assumed_unstable_poles: int
    unstable_poles: tuple[int, ...]
    notes: tuple[str, ...]

    @property
    def values(self) -> Mapping[str, float]:
        """The margins that there are, by the names of `errors`."""
        rise = [c.gain_margin for c in self.phase_crossovers if c.gain_margin > 1.0]
        fall = [c.gain_margin for c in self.phase_crossovers if c.gain_margin < 1.0]
        found = {"ms": self.sensitivity.value, "mt": self.complementary.value, "disk_margin": 1.0 / self.disk.value}
        found |= {"gain_margin": min(rise)} if rise else {}
        found |= {"gain_reduction_margin": max(fall)} if fall else {}
        if self.gain_crossovers:
            found["phase_margin_deg"] = min((c.phase_margin_deg for c in self.gain_crossovers), key=abs)
            found["delay_margin_s"] = min(c.delay_margin for c in self.gain_crossovers)
        return MappingProxyType(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Loop:
    """The loop between the samples: spline of the logarithm of the plant's magnitude and of its phase without the delay."""

    spline: CubicSpline
    delay: float
    gains: PidGains
    grid: Floats

    def __call__(self, omega: Floats) -> Complexes:
        size, phase = np.moveaxis(self.spline(np.log(omega)), -1, 0)
        s = 1j * omega
        plant = np.exp(size + 1j * (phase - omega * self.delay))
        return np.asarray(plant * (self.gains.setpoint_transfer(s) + self.gains.kd * s))


def find_sampled_margins(
    plant: FrequencyResponse, gains: PidGains, *, delay: float | None = None, unstable_poles: int = 0, name: str = "samples"
) -> SampledMargins:
    """Find crossovers and margins of a PID loop around a plant known by samples, within their band.

    Args:
        plant: its frequency response, above 0 rad/s, in the controller's units.
        gains: of the controller, with the derivative on the measurement.
        delay: in s, that the plant contains for certain: it is taken out before the interpolation and put back; by default the
            response's own known delay.
        unstable_poles: of the plant, right of the imaginary axis, for the count of encirclements; no samples tell them.
        name: of the plant, for people.

    Returns:
        The margins, their estimated errors, and what is not known.

    Raises:
        InvalidInputError: fewer than 8 samples, a frequency or a magnitude of 0, samples too coarse to unwrap or to interpolate, other
            units than the controller's, gains that are all 0, a delay that turns too fast or is negative, or a number of poles that is
            negative or that the encirclements contradict.
    """
    if unstable_poles < 0:
        message = f"unstable poles = {unstable_poles} of the open loop is negative; give 0 or more"
        raise InvalidInputError(message)
    if gains.kp == gains.ki == gains.kd == 0.0:
        message = "kp, ki and kd are all 0: there is no loop to have margins; give a gain"
        raise InvalidInputError(message)
    response = plant if delay is None else replace(plant, known_delay=delay)
    _check_units(response, gains)
    table = _tabulate(response)
    loop = _interpolate(response.omega, table, response.known_delay, gains)
    values = loop(loop.grid)
    gain, phase = _crossovers(loop, values)
    sensitivity, complementary, disk = _peaks(loop, values)
    found = SampledMargins(
        loop=f"{name} under {gains.rule}",
        band=(float(response.omega[0]), float(response.omega[-1])),
        samples=response.omega.size,
        gain_crossovers=gain,
        phase_crossovers=phase,
        sensitivity=sensitivity,
        complementary=complementary,
        disk=disk,
        errors=MappingProxyType({}),
        assumed_unstable_poles=unstable_poles,
        unstable_poles=_count(response, loop, values, unstable_poles),
        notes=(),
    )
    halves = [_half(found, response, table, gains, first) for first in (0, 1)]
    errors = {
        key: max(abs(half[key] - value) for half in halves) for key, value in found.values.items() if all(key in half for half in halves)
    }
    found = replace(found, errors=MappingProxyType(errors))
    return replace(found, notes=_notes(found, values))


def _check_units(response: FrequencyResponse, gains: PidGains) -> None:
    for what, unit, wanted in (
        ("input", response.input_unit, gains.output_unit),
        ("output", response.output_unit, gains.input_unit),
    ):
        if unit not in ("1", wanted):
            message = f"the response's {what} is in {unit} and the controller's gains are for {wanted}; convert one of them"
            raise InvalidInputError(message, unit=unit, wanted=wanted)


def _tabulate(response: FrequencyResponse) -> Floats:
    """Logarithm of the magnitude and phase in rad without the known delay, one row per sample; refused where they are too coarse."""
    omega = response.omega
    if omega.size < FEWEST:
        message = f"{omega.size} samples are too few for margins: the error is told by half of them; give at least {FEWEST}"
        raise InvalidInputError(message, samples=omega.size)
    if omega[0] == 0.0 or np.any(response.magnitude == 0.0):
        bad = float(omega[(omega == 0.0) | (response.magnitude == 0.0)][0])
        message = f"the sample at {bad:g} rad/s has a frequency or a magnitude of 0, which has no logarithm; leave that sample out"
        raise InvalidInputError(message, frequency=bad)
    table = np.stack((np.log(response.magnitude), response.phase_deg * DEGREE + omega * response.known_delay), axis=-1)
    steps = np.abs(np.diff(table, axis=0))
    turning, jumping = steps[:, 1] / (PHASE_STEP_DEG * DEGREE), steps[:, 0] / math.log(SIZE_STEP)
    worst = int(np.argmax(np.maximum(turning, jumping)))
    if max(turning[worst], jumping[worst]) > 1.0:
        between = max(1, math.ceil(2.0 * max(turning[worst], jumping[worst])) - 1)
        message = (
            f"the response is too coarse to unwrap and interpolate: from {omega[worst]:g} to {omega[worst + 1]:g} rad/s its phase"
            f" steps by {steps[worst, 1] / DEGREE:.0f} deg (limit {PHASE_STEP_DEG:g}) and its magnitude by a factor of"
            f" {math.exp(steps[worst, 0]):.3g} (limit {SIZE_STEP:g}); put {between} or more samples between them, or give the known delay"
        )
        raise InvalidInputError(message, low=float(omega[worst]), high=float(omega[worst + 1]))
    return table


def _interpolate(omega: Floats, table: Floats, delay: float, gains: PidGains) -> _Loop:
    turns = np.abs(np.diff(table[:, 1] - omega * delay)) + np.diff(omega) * delay
    counts = np.maximum(_FINE, np.ceil(turns / _TURN))
    if np.sum(counts) > MOST_POINTS:
        message = f"delay = {delay:g} s turns the loop too fast to be followed with {MOST_POINTS} frequencies; check its unit, s"
        raise InvalidInputError(message, delay=delay)
    parts = [np.geomspace(a, b, int(n), endpoint=False) for a, b, n in zip(omega[:-1], omega[1:], counts, strict=True)]
    grid = np.concatenate((*parts, omega[-1:]))
    return _Loop(spline=CubicSpline(np.log(omega), table), delay=delay, gains=gains, grid=grid)


def _crossovers(loop: _Loop, values: Complexes) -> tuple[tuple[GainCrossover, ...], tuple[PhaseCrossover, ...]]:
    unity = roots_between(lambda w: np.abs(loop(w)) - 1.0, loop.grid, np.abs(values) - 1.0)
    turns = roots_between(lambda w: phase_sine(loop(w)), loop.grid, phase_sine(values))
    gain = tuple(gain_crossover(float(w), complex(v)) for w, v in zip(unity, loop(unity), strict=True))
    phase = tuple(
        PhaseCrossover(frequency=float(w), gain_margin=1.0 / abs(complex(v)))
        for w, v in zip(turns, loop(turns), strict=True)
        if v.real < 0.0
    )
    return gain, phase


def _peaks(loop: _Loop, values: Complexes) -> tuple[Peak, Peak, Peak]:
    """Peaks of the sensitivity, of the closed loop, and of the disk's measure."""
    return (
        _peak(loop, values, lambda v: 1.0 / (1.0 + v)),
        _peak(loop, values, lambda v: v / (1.0 + v)),
        _peak(loop, values, lambda v: 1.0 / (1.0 + v) - 0.5),
    )


def _peak(loop: _Loop, values: Complexes, measure: Callable[[Complexes], Complexes]) -> Peak:
    value, frequency = highest(lambda w: np.abs(measure(loop(w))), loop.grid, np.abs(measure(values)))
    return Peak(value=value, frequency=frequency)


def _half(found: SampledMargins, response: FrequencyResponse, table: Floats, gains: PidGains, first: int) -> Mapping[str, float]:
    """The margins by every second sample, the ends kept, with the phase as all samples unwrap it."""
    kept = np.unique(np.concatenate(([0], np.arange(first, response.omega.size, 2), [response.omega.size - 1])))
    loop = _interpolate(response.omega[kept], table[kept], response.known_delay, gains)
    values = loop(loop.grid)
    gain, phase = _crossovers(loop, values)
    sensitivity, complementary, disk = _peaks(loop, values)
    half = replace(
        found,
        gain_crossovers=gain,
        phase_crossovers=phase,
        sensitivity=sensitivity,
        complementary=complementary,
        disk=disk,
    )
    return half.values


def _count(response: FrequencyResponse, loop: _Loop, values: Complexes, assumed: int) -> tuple[int, ...]:
    """Unstable poles of the closed loop by the turn of 1 + L from 0 to infinite frequency, which is pi (open - closed unstable poles).

    Above the band the loop gain is taken to stay below 1, below the band the plant to keep its sign and the phase of its lowest sample
    to be that of a static gain; a pole at 0 of the controller is passed on the right.
    """
    away = float(np.angle(response.values[0])) / DEGREE
    near = abs(away - 180.0 * round(away / 180.0))
    if abs(values[-1]) >= 1.0 or near > STATIC_PHASE_DEG:
        return ()
    gains, arguments = loop.gains, np.angle(1.0 + _refine(loop, values))
    turned = np.unwrap(arguments)
    if np.max(np.abs(np.diff(turned))) > 0.5 * math.pi:
        return ()
    forward = response.values[0].real * gains.ki > 0.0 if gains.ki != 0.0 else values[0].real > -1.0
    start = 0.0 if forward else math.copysign(math.pi, arguments[0])
    total = (turned[-1] - turned[0]) + (arguments[0] - start) - arguments[-1]
    closed = assumed - round(total / math.pi)
    if closed < 0:
        message = (
            f"unstable poles = {assumed} of the open loop is too few: its curve encircles -1 so often that the closed loop would have"
            f" {closed}; give at least {assumed - closed}"
        )
        raise InvalidInputError(message, least=assumed - closed)
    return (closed,)


def _refine(loop: _Loop, values: Complexes) -> Complexes:
    """Values of the loop with more between neighbours where 1 + L turns fast, as it does near -1."""
    grid = loop.grid
    for _ in range(_PASSES):
        fast = np.abs(np.angle((1.0 + values[1:]) / (1.0 + values[:-1]))) > _FAST
        if not np.any(fast):
            break
        middle, places = np.sqrt(grid[:-1][fast] * grid[1:][fast]), np.flatnonzero(fast) + 1
        grid, values = np.insert(grid, places, middle), np.insert(values, places, loop(middle))
    return values


def _notes(found: SampledMargins, values: Complexes) -> tuple[str, ...]:
    low, high = found.band
    first, last = abs(complex(values[0])), abs(complex(values[-1]))
    notes = [f"known from {low:g} to {high:g} rad/s only: Ms and Mt are lower bounds, the disk margin is an upper bound"]
    notes.append("the errors are those of interpolation; an error of the samples themselves is not among them")
    if not found.gain_crossovers:
        notes.append(
            f"no gain crossover in the band (loop gain {first:.3g} to {last:.3g} at its ends): phase and delay margin are not known"
        )
    if "gain_margin" not in found.values:
        notes.append("no phase crossover in the band limits a rise of the gain: the gain margin is not known")
    if last >= 1.0:
        notes.append(f"the loop gain is still {last:.3g} at {high:g} rad/s: crossovers above the band are to be expected")
    elif last > 0.0:
        least = f"no gain margin above the band is below {1.0 / last:.3g}"
        notes.append(f"the loop gain is {last:.3g} at {high:g} rad/s: if it stays below that, {least}")
    if first < 1.0:
        notes.append(f"the loop gain is only {first:.3g} at {low:g} rad/s: crossovers below the band are not excluded")
    for what, peak in (("Ms", found.sensitivity), ("Mt", found.complementary)):
        if peak.frequency in found.band:
            notes.append(f"{what} is largest at the band's end, {peak.frequency:g} rad/s, and rises beyond it or may do so")
    lost = [key for key in found.values if key not in found.errors]
    if lost:
        notes.append(f"half of the samples do not confirm {', '.join(lost)}: no error is given there; take more samples")
    return (*notes, _say_count(found))


def _say_count(found: SampledMargins) -> str:
    if not found.unstable_poles:
        return (
            "encirclements are not counted: the loop gain is not below 1 at the highest sample, or the plant's phase at the lowest is not"
            f" within {STATIC_PHASE_DEG:g} deg of 0 or 180, or the curve passes -1 too closely"
        )
    return (
        f"samples prove no stability: {found.unstable_poles[0]} unstable poles of the closed loop hold if the plant has"
        f" {found.assumed_unstable_poles}, is near its static gain at the lowest sample, and the loop gain stays below 1 above the band"
    )
