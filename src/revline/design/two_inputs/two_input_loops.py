"""The loops of two inputs and one measurement, broken where each can fail, delays exact.

With F fast and S slow, L_F = P_F C, L_S = P_S (D C + K s), C = kp + ki/s, D = slow_kp + slow_ki/s, K = slow_kd:

- at the fast input, the slow loop closed: L_F/(1 + L_S);
- at the slow input, the fast loop closed: L_S/(1 + L_F);
- at the measurement, where both are one: L_F + L_S; its sensitivity is what the load meets;
- with the fast input at its limit: P_S (D kp + K s).

Both inputs changed at once by any factors in one disk: the structured singular value of S - T at the plant's input, over two scalar
blocks, where the upper bound by scaling is exact.

Source: Skogestad and Postlethwaite (2005), Multivariable Feedback Control, section 8.8; disks: Seiler, Packard and Gahinet (2020), IEEE
Control Systems Magazine 40(5), 78-95.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.design.stability.open_loop import OpenLoop
from revline.lti.state_space import DelayStateSpace, position

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

POINTS = 600
"""Frequencies at which candidates are compared; the chosen one's margins are found on a refined grid."""

NAMES = ("fast", "slow", "both", "fast at its limit", "crossovers apart")
"""What a candidate can break."""

HALVINGS = 80
"""Steps of the search for the scaling of two blocks."""

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


class LoopGains(NamedTuple):
    """Gains for a fast input counted so that the measurement rises with it: `kp`, `ki` are positive."""

    kp: float
    ki: float
    slow_kp: float
    slow_ki: float
    slow_kd: float


@dataclass(frozen=True, slots=True, eq=False)
class TwoInputPlant:
    """Exact transfer functions from both inputs to the measurement, the fast one's sign turned so that it raises it.

    Attributes:
        model: exact linear model.
        fast, slow, measurement: positions of the signals.
        sign: of the fast input's gain.
    """

    model: DelayStateSpace
    fast: int
    slow: int
    measurement: int
    sign: float

    @classmethod
    def of(cls, model: DelayStateSpace, fast: str, slow: str, measurement: str, *, sign: float) -> "TwoInputPlant":
        """Name the signals. Raises InvalidInputError where there is none of a name."""
        return cls(model, position(model.inputs, fast), position(model.inputs, slow), position(model.outputs, measurement), sign)

    def __call__(self, s: ArrayLike) -> tuple[Complexes, Complexes]:
        """Evaluate both at complex numbers, in rad/s, of any shape."""
        values = self.model.transfer(s)[..., self.measurement, :]
        return self.sign * values[..., self.fast], values[..., self.slow]

    def grid(self) -> Floats:
        """Frequencies from well below to well above what the poles and lags make of the plant."""
        fastest = max(float(np.max(np.abs(np.linalg.eigvals(self.model.A)))), 1.0 / float(np.min(self.model.lags)))
        slowest = 1.0 / float(np.sum(self.model.lags))
        return np.geomspace(1e-3 * slowest, 20.0 * fastest, POINTS)


class RayPeaks(NamedTuple):
    """What candidates reach: peaks of the sensitivities, shape (4, times, levels), and the ratio of the crossovers."""

    names: tuple[str, ...]
    peaks: Floats
    separation: Floats

    def broken(self, ms: float, separation: float) -> NDArray[np.bool_]:
        """Which bounds are broken, shape (5, times, levels)."""
        return np.concatenate((self.peaks > ms, (self.separation < separation)[None]))


def peaks_of_rays(plant: TwoInputPlant, fast: tuple[float, float], rays: tuple[Floats, Floats, float]) -> RayPeaks:
    """Evaluate slow gains: for each integral time all levels of the integral gain, one derivative time.

    Args:
        plant: both transfer functions.
        fast: kp and ki.
        rays: integral times in s, shape (n,), integral gains, shape (m,), and the derivative gain over the integral one, kp taken out.
    """
    times, levels, derivative = rays
    omega = plant.grid()
    s = 1j * omega
    p_fast, p_slow = plant(s)
    kp, ki = fast
    c = kp + ki / s
    fast_loop = p_fast * c
    top = omega[np.abs(fast_loop) >= 1.0]
    fast_crossover = float(top[-1]) if top.size else 0.0
    peaks = np.empty((4, times.size, levels.size))
    separation = np.empty((times.size, levels.size))
    for k, time in enumerate(times):
        shape = levels[:, None] * (time + 1.0 / s)
        kick = levels[:, None] * derivative * kp * s
        slow_loop, left = p_slow * (shape * c + kick), p_slow * (shape * kp + kick)
        at_slow = slow_loop / (1.0 + fast_loop)
        for row, loop in enumerate((fast_loop / (1.0 + slow_loop), at_slow, fast_loop + slow_loop, left)):
            peaks[row, k] = np.max(1.0 / np.abs(1.0 + loop), axis=1)
        last = omega.size - 1 - np.argmax(np.abs(at_slow[:, ::-1]) >= 1.0, axis=1)
        crossed = np.any(np.abs(at_slow) >= 1.0, axis=1)
        separation[k] = np.where(crossed, fast_crossover / omega[last], np.inf)
    return RayPeaks(NAMES, peaks, separation)


def loops_of(plant: TwoInputPlant, gains: LoopGains) -> tuple[Callable[[ArrayLike], Complexes], Callable[[ArrayLike], Complexes]]:
    """Give L_F and L_S as functions of complex s."""

    def fast(s: ArrayLike) -> Complexes:
        points = np.asarray(s, dtype=complex)
        return np.asarray(plant(points)[0] * (gains.kp + gains.ki / points))

    def slow(s: ArrayLike) -> Complexes:
        points = np.asarray(s, dtype=complex)
        law = (gains.slow_kp + gains.slow_ki / points) * (gains.kp + gains.ki / points) + gains.slow_kd * points
        return np.asarray(plant(points)[1] * law)

    return fast, slow


def broken_loops(plant: TwoInputPlant, gains: LoopGains, *, unstable: float, unstable_at_limit: float) -> dict[str, OpenLoop]:
    """Break the loops where each can fail.

    Args:
        plant: both transfer functions.
        gains: of both controllers.
        unstable: poles of the closed loop right of the axis.
        unstable_at_limit: of the loop that is left with the fast input at its limit.
    """
    fast, slow = loops_of(plant, gains)

    def left(s: ArrayLike) -> Complexes:
        points = np.asarray(s, dtype=complex)
        law = (gains.slow_kp + gains.slow_ki / points) * gains.kp + gains.slow_kd * points
        return np.asarray(plant(points)[1] * law)

    made: dict[str, tuple[Callable[[ArrayLike], Complexes], float]] = {
        "fast": (lambda s: fast(s) / (1.0 + slow(s)), unstable),
        "slow": (lambda s: slow(s) / (1.0 + fast(s)), unstable),
        "both": (lambda s: fast(s) + slow(s), unstable),
        "fast at its limit": (left, unstable_at_limit),
    }
    delay = float(np.max(plant.model.lags))
    return {
        name: OpenLoop(name=f"broken at: {name}", transfer=transfer, delay=delay, unstable_poles=count)
        for name, (transfer, count) in made.items()
    }


class TwoInputDisk(NamedTuple):
    """Disk margin of both inputs at once, and the frequency that has it, in rad/s."""

    margin: float
    frequency: float


def find_two_input_disk(plant: TwoInputPlant, gains: LoopGains) -> TwoInputDisk:
    """Find how far gain and phase of both inputs may change at once, independently of one another."""
    fast, slow = loops_of(plant, gains)
    omega = np.geomspace(plant.grid()[0], plant.grid()[-1], 4 * POINTS)
    sizes = structured_sizes(fast(1j * omega), slow(1j * omega))
    for _ in range(2):
        at = int(np.argmax(sizes))
        omega = np.linspace(omega[max(at - 1, 0)], omega[min(at + 1, omega.size - 1)], 201)
        sizes = structured_sizes(fast(1j * omega), slow(1j * omega))
    at = int(np.argmax(sizes))
    return TwoInputDisk(1.0 / float(sizes[at]), float(omega[at]))


def structured_sizes(fast: Complexes, slow: Complexes) -> Floats:
    """Structured singular value of (S - T)/2 over two scalar blocks at frequencies, shape (n,).

    The controllers' and plants' factors enter by their products only: with rows scaled, T is [[F, F], [S, S]]/(1 + F + S). The smallest
    scaling is a minimum over one positive number, its function without other minima.
    """
    below = 1.0 + fast + slow
    a, d = 0.5 - fast / below, 0.5 - slow / below
    b, c = -fast / below, -slow / below  # entries off the diagonal, before scaling

    def largest(log_scale: Floats) -> Floats:
        scale = np.exp(log_scale)
        total = np.abs(a) ** 2 + np.abs(d) ** 2 + np.abs(b * scale) ** 2 + np.abs(c / scale) ** 2
        product = np.abs(a * d - b * c) ** 2
        return np.asarray(np.sqrt(0.5 * (total + np.sqrt(np.maximum(total**2 - 4.0 * product, 0.0)))))

    centre = 0.5 * np.log(np.maximum(np.abs(c), 1e-300) / np.maximum(np.abs(b), 1e-300))
    low, high = centre - 20.0, centre + 20.0
    for _ in range(HALVINGS):
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        better = largest(left) < largest(right)
        low, high = np.where(better, low, left), np.where(better, right, high)
    return largest(0.5 * (low + high))
