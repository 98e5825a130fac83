"""What a loop costs, exact in its delays and quick enough to optimise: integrated absolute errors, peaks, and their gradients.

Both step responses come from the exact closed loop on a grid of frequencies by one fast Fourier transform each: with
s(1 + L) = s + G (kp s + ki + kd s^2 F) =: Q the answers to unit steps of load and command are

    Y = Gd/Q,   E = (1 + G (kp (1 - b) + kd s F))/Q

for which no delay is approximated. E begins with a jump, which (s + 2a)/(s + a)^2 takes away. What is left out is what the transform's
period cuts off and what lies above its highest frequency; half the resolution tells how much that is.

Source: Astrom and Hagglund (2006), Advanced PID Control, sections 4.4 to 4.9; Dubner and Abate (1968), Journal of the ACM 15, 115-123.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from revline.errors import NotConvergedError, out_of_range
from revline.units import Seconds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Source = Callable[[Complexes], tuple[Complexes, Complexes]]

SAMPLES = 4096
"""Samples of the transform's period, to begin with; half of them are the horizon."""

GRID = 900
"""Frequencies on which peaks are sought; between them a parabola."""

BINS = 10
"""Parts of the frequency range whose peaks are constraints of their own, so that two peaks of one height do not hide one another."""

SHARP = 0.1
"""Poles that are so little damped have frequencies of their own on the grid of peaks, which else would miss how fast the phase turns."""

ABOUT = tuple(math.sinh(0.25 * k) for k in range(-16, 17))
"""Where these lie about the pole's, in its distance from the axis."""

LARGEST_TAIL = 1e-3
"""Part of the largest error that may be left in the last tenth of the horizon; the integral misses about half of that part."""

LARGEST_CHANGE = 1e-2
"""Part by which half the frequencies may change an integrated error: four times what is missing, or more."""

LARGEST_BEYOND = 0.5
"""Loop gain at the highest frequency of the peaks: a peak beyond it is below 2."""

SHORTER = 1e-7
"""Where less than this part is left, half the horizon would do: an exponential's tail is then below 1e-3."""

TRIES = 12
"""How often a grid is made anew."""

MOST_SAMPLES = 32_768
"""Most samples of the transform's period."""

GAINS = ("kp", "ki", "kd", "b")
"""What may be chosen; b is the set-point weight."""


class Terms(NamedTuple):
    """Proportional, integral and derivative gain, and the set-point weight."""

    kp: float
    ki: float
    kd: float
    b: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopGrid:
    """A plant's exact response where costs are computed.

    Attributes:
        s: of the transform, shape (samples/2 + 1,), from 0 up the imaginary axis.
        plant, load: from control and from load to the measurement there.
        omega: for peaks, shape (n,), rising.
        at_peaks: the plant there.
        horizon: time over which errors are integrated, in s.
        filter_time: of the derivative, in s.
        unstable_poles: of the plant.
        poles: of the plant, the rightmost at least.
        source: gives the plant's responses to control and load on complex s of shape (n,).
    """

    s: Complexes
    plant: Complexes
    load: Complexes
    omega: Floats
    at_peaks: Complexes
    horizon: Seconds
    filter_time: Seconds
    unstable_poles: int
    poles: Complexes
    source: Source

    @classmethod
    def make(
        cls, source: Source, horizon: Seconds, *, filter_time: Seconds, unstable_poles: int, poles: Complexes, samples: int = SAMPLES
    ) -> "LoopGrid":
        """Evaluate a plant for a horizon, its peaks also where poles near the axis are.

        Raises:
            InvalidInputError: the horizon is not positive, or the filter's time is none.
        """
        check_horizon(horizon)
        if not (math.isfinite(filter_time) and filter_time >= 0.0):
            raise out_of_range("filter time of the derivative", filter_time, "s", "0 and above", "give one, 0 for none")
        s = np.asarray(1j * math.pi / horizon * np.arange(samples // 2 + 1), dtype=np.complex128)
        low, high = 1e-2 / horizon, 0.5 * float(abs(s[-1]))
        sharp = poles[np.abs(poles.real) < SHARP * poles.imag]
        about = (sharp.imag[:, None] + np.abs(sharp.real[:, None]) * np.array(ABOUT)).ravel()
        omega = np.unique(np.concatenate((np.geomspace(low, high, GRID), about[(about > low) & (about < high)])))
        plant, load = source(s)
        return cls(
            s=s,
            plant=plant,
            load=load,
            omega=omega,
            at_peaks=source(np.asarray(1j * omega, dtype=np.complex128))[0],
            horizon=horizon,
            filter_time=filter_time,
            unstable_poles=unstable_poles,
            poles=poles,
            source=source,
        )

    @property
    def spacing(self) -> Seconds:
        """Time between samples of the responses."""
        return self.horizon / (self.s.size - 1)

    def other(self, horizon: Seconds, samples: int) -> "LoopGrid":
        """The same plant for another horizon, with as many samples of the transform's period."""
        return LoopGrid.make(
            self.source, horizon, filter_time=self.filter_time, unstable_poles=self.unstable_poles, poles=self.poles, samples=samples
        )

    def coarser(self) -> "LoopGrid":
        """The same with half the highest frequency, for an estimate of the error."""
        half = self.s.size // 2 + 1
        return replace(self, s=self.s[:half], plant=self.plant[:half], load=self.load[:half])


class Accuracy(NamedTuple):
    """What a cost's numbers are worth.

    `tail` is as in `Cost`; `change` the part by which half the frequencies change an integrated error; `beyond` the loop gain at the
    highest frequency at which peaks are sought.
    """

    tail: float
    change: float
    beyond: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cost:
    """Costs of a loop and their gradients with respect to kp, ki, kd, b.

    Attributes:
        load, setpoint: integrated absolute error after a unit step of load and of command.
        sensitivity, complementary, effort: peaks in each bin of |S|, |T| and |C S|, shape (bins,).
        gradients: of these five in this order, each of shape (.., 4).
        stable: whether the closed loop is.
        tail: largest error in the last tenth of the horizon, as a part of the largest, of both responses.
    """

    load: float
    setpoint: float
    sensitivity: Floats
    complementary: Floats
    effort: Floats
    gradients: tuple[Floats, Floats, Floats, Floats, Floats]
    stable: bool
    tail: float


def find_cost(grid: LoopGrid, terms: Terms) -> Cost:
    """Find what a loop costs.

    The numbers of an unstable loop mean nothing but that it is so.

    Args:
        grid: of the plant.
        terms: of the controller.
    """
    load, load_slope, setpoint, setpoint_slope, tail = _errors(grid, terms)
    peaks = _peaks(grid, terms)
    return Cost(
        load=load,
        setpoint=setpoint,
        sensitivity=peaks[0][0],
        complementary=peaks[1][0],
        effort=peaks[2][0],
        gradients=(load_slope, setpoint_slope, peaks[0][1], peaks[1][1], peaks[2][1]),
        stable=_is_stable(grid, terms),
        tail=tail,
    )


def find_accuracy(grid: LoopGrid, terms: Terms) -> Accuracy:
    """Tell what the costs of a stable loop are worth on a grid.

    Args:
        grid: of the plant.
        terms: of the controller.
    """
    fine, rough = find_cost(grid, terms), find_cost(grid.coarser(), terms)
    change = max(abs(rough.load / fine.load - 1.0), abs(rough.setpoint / fine.setpoint - 1.0))
    top = 1j * grid.omega[-1]
    law = terms.kp + terms.ki / top + terms.kd * top / (grid.filter_time * top + 1.0)
    return Accuracy(fine.tail, change, float(abs(grid.at_peaks[-1] * law)))


def fit_horizon(grid: LoopGrid, terms: Terms) -> LoopGrid:
    """Double or halve a grid's horizon, or take more samples, until the costs of a stable loop are worth something on it.

    Args:
        grid: of the plant; it comes back itself where it does.
        terms: of the controller.

    Raises:
        NotConvergedError: the loop settles too slowly for how fast it is.
    """
    found = find_accuracy(grid, terms)
    for _ in range(TRIES):
        samples = 2 * (grid.s.size - 1)
        if found.tail > LARGEST_TAIL:
            grid = grid.other(2.0 * grid.horizon, samples)
        elif found.change <= LARGEST_CHANGE and found.beyond <= LARGEST_BEYOND:
            return grid
        elif found.tail < SHORTER:
            grid = grid.other(0.5 * grid.horizon, samples)
        elif samples < MOST_SAMPLES:
            grid = grid.other(grid.horizon, 2 * samples)
        else:
            break
        found = find_accuracy(grid, terms)
    message = (
        f"errors over {grid.horizon:g} s at {grid.s.size} times: {found.tail:.2g} of the largest is left at the end (at most "
        f"{LARGEST_TAIL:g}), half the frequencies change the integrals by {found.change:.2g} (at most {LARGEST_CHANGE:g}), and the loop's "
        f"gain is still {found.beyond:.2g} at the highest (at most {LARGEST_BEYOND:g}): the loop settles too slowly for how fast it is; "
        "damp it better, or filter the derivative"
    )
    raise NotConvergedError(message, tail=found.tail, change=found.change, beyond=found.beyond)


def find_errors(grid: LoopGrid, terms: Terms) -> tuple[Floats, Floats, Floats]:
    """Give times, and the errors after unit steps of load and of command, each of shape (n,)."""
    load, setpoint, start = _transforms(grid, terms)[:3]
    return _times(grid), _back(grid, load), _back(grid, setpoint) + start


def _times(grid: LoopGrid) -> Floats:
    return np.asarray(grid.spacing * np.arange(grid.s.size), dtype=np.float64)


def _back(grid: LoopGrid, values: Complexes) -> Floats:
    """Turn transforms (along the last axis) into responses over the horizon."""
    count = 2 * (grid.s.size - 1)
    return np.asarray(np.fft.irfft(values, count)[..., : grid.s.size] * (count / (2.0 * grid.horizon)))


def _transforms(grid: LoopGrid, terms: Terms) -> tuple[Complexes, Complexes, Floats, Complexes, Complexes]:
    """Load and set-point errors as transforms, what the latter begins with in time, and both gradients."""
    kp, ki, kd, b = terms
    s, plant = grid.s, grid.plant
    filtered = s / (grid.filter_time * s + 1.0)
    q = s + plant * (kp * s + ki + kd * s * filtered)
    q_slopes = np.stack([plant * s, plant, plant * s * filtered, np.zeros_like(s)])
    load = grid.load / q
    n = 1.0 + plant * (kp * (1.0 - b) + kd * filtered)
    n_slopes = np.stack([plant * (1.0 - b), np.zeros_like(s), plant * filtered, -kp * plant])
    setpoint = n / q
    rate = 40.0 / grid.horizon
    start = (s + 2.0 * rate) / (s + rate) ** 2
    times = _times(grid)
    beginning = (1.0 + rate * times) * np.exp(-rate * times)
    return load, setpoint - start, np.asarray(beginning), -load / q * q_slopes, (n_slopes - setpoint * q_slopes) / q


def _errors(grid: LoopGrid, terms: Terms) -> tuple[float, Floats, float, Floats, float]:
    load, setpoint, beginning, load_slopes, setpoint_slopes = _transforms(grid, terms)
    weights = np.full(grid.s.size, grid.spacing)
    weights[0] = weights[-1] = 0.5 * grid.spacing
    y, e = _back(grid, load), _back(grid, setpoint) + beginning
    late = slice(-grid.s.size // 10, None)
    tails = [float(np.max(np.abs(row[late]), initial=0.0) / max(np.max(np.abs(row)), 1e-300)) for row in (y, e)]
    return (
        float(weights @ np.abs(y)),
        np.asarray(_back(grid, load_slopes) @ (weights * np.sign(y))),
        float(weights @ np.abs(e)),
        np.asarray(_back(grid, setpoint_slopes) @ (weights * np.sign(e))),
        max(tails),
    )


def _peaks(grid: LoopGrid, terms: Terms) -> list[tuple[Floats, Floats]]:
    """Peaks of |S|, |T| and |C S| in each bin, with gradients: the largest on the grid, improved by a parabola."""
    kp, ki, kd, _ = terms
    s = 1j * grid.omega
    filtered = s / (grid.filter_time * s + 1.0)
    law = kp + ki / s + kd * filtered
    law_slopes = np.stack([np.ones_like(s), 1.0 / s, filtered, np.zeros_like(s)])
    sensitivity = 1.0 / (1.0 + grid.at_peaks * law)
    of_loop = -grid.at_peaks * sensitivity * law_slopes  # slope of log S
    complementary = 1.0 - sensitivity
    with np.errstate(divide="ignore", invalid="ignore"):
        of_complementary = np.where(law != 0.0, law_slopes / law, 0.0) + of_loop
    measures = (
        (sensitivity, of_loop),
        (complementary, of_complementary),
        (law * sensitivity, of_complementary),
    )
    places = np.log(grid.omega)
    return [_binned(places, np.log(np.maximum(np.abs(value), 1e-300)), np.real(slope)) for value, slope in measures]


def _binned(places: Floats, logs: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """Peak in each bin, and its slope, at the vertex of the parabola through the largest point and its neighbours."""
    edges = np.linspace(0, logs.size, BINS + 1).astype(int)
    values, gradients = np.empty(BINS), np.empty((BINS, slopes.shape[0]))
    for k in range(BINS):
        top = edges[k] + int(np.argmax(logs[edges[k] : edges[k + 1]]))
        weights, first = np.array([1.0]), top
        if 0 < top < logs.size - 1 and logs[top] >= max(logs[top - 1], logs[top + 1]):
            weights, first = _vertex(places[top - 1 : top + 2], logs[top - 1 : top + 2]), top - 1
        part = slice(first, first + weights.size)
        values[k] = math.exp(min(float(weights @ logs[part]), 700.0))
        gradients[k] = values[k] * (slopes[:, part] @ weights)
    return values, gradients


def _vertex(x: Floats, y: Floats) -> Floats:
    """Weights of three values, the middle one not the least, that give the parabola through them at its vertex."""
    rise, fall = np.diff(y) / np.diff(x)
    bend = (fall - rise) / (x[2] - x[0])
    at = 0.5 * (x[0] + x[1] - rise / bend) if bend < 0.0 else x[1]
    a, b, c = at - x
    return np.array(
        [b * c / ((x[0] - x[1]) * (x[0] - x[2])), a * c / ((x[1] - x[0]) * (x[1] - x[2])), a * b / ((x[2] - x[0]) * (x[2] - x[1]))]
    )


def _is_stable(grid: LoopGrid, terms: Terms) -> bool:
    """Count the turns of (1 + L) s/(s + a), which has no pole on the axis, along the grid of peaks."""
    s = 1j * grid.omega
    law = terms.kp * s + terms.ki + terms.kd * s * s / (grid.filter_time * s + 1.0)
    curve = (s + grid.at_peaks * law) / (s + 1.0 if terms.ki != 0.0 else s)
    turned = float(np.sum(np.angle(curve[1:] / curve[:-1])))
    whole = turned + float(np.angle(curve[0] * np.sign(curve[0].real))) - float(np.angle(curve[-1]))
    return round(whole / math.pi) == grid.unstable_poles


def check_horizon(horizon: float) -> None:
    """Refuse a horizon that is none.

    Raises:
        InvalidInputError: it is not positive.
    """
    if not (math.isfinite(horizon) and horizon > 0.0):
        raise out_of_range("horizon", horizon, "s", "the positive numbers", "give some of the plant's time constants")
