"""Responses by two routes set side by side: how far apart they are, what is allowed, and whether they agree."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from revline.lti.response import Complexes
from revline.system import Floats
from revline.values import make_read_only

EXACT = "exact small-signal response"
VANISHING = "harmonic balance at vanishing amplitude"
BALANCE = "harmonic balance"
SIMULATION = "sinestream by simulation"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseDifference:
    """The same response by two routes.

    Attributes:
        routes: names of the first and the second.
        omega: frequencies in rad/s, shape (n_freq,), as all arrays.
        first: responses by the first route, output over input.
        second: by the second, none of them 0.
    """

    routes: tuple[str, str]
    omega: Floats
    first: Complexes
    second: Complexes

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def magnitude(self) -> Floats:
        """Magnitude by the first route over that by the second, less one."""
        return np.abs(self.first) / np.abs(self.second) - 1.0

    @property
    def phase_deg(self) -> Floats:
        """Phase by the first route less that by the second, without whole turns, in degrees."""
        return np.degrees(np.angle(self.first / self.second))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RouteComparison:
    """Two routes that must agree.

    A difference up to the tolerance is allowed of the magnitude, relative, and of the phase, in radians: were both routes wrong by no more
    than their error estimates, their complex responses could not be further apart.

    Attributes:
        difference: of the routes.
        tolerance: largest relative difference allowed, shape (n_freq,).
        amplitude: of the input, shape (n_freq,), in its unit; where amplitudes were made to vanish, the largest of them.
    """

    difference: ResponseDifference
    tolerance: Floats
    amplitude: Floats

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def tolerance_deg(self) -> Floats:
        """Largest difference of the phases allowed, in degrees."""
        return np.degrees(self.tolerance)

    @property
    def used(self) -> Floats:
        """Which part of the tolerance the difference takes; above 1 the routes disagree."""
        larger = np.maximum(np.abs(self.difference.magnitude), np.radians(np.abs(self.difference.phase_deg)))
        part: Floats = larger / self.tolerance
        return part

    @property
    def disagreeing(self) -> NDArray[np.bool_]:
        """Where the routes disagree."""
        return ~(self.used <= 1.0)

    @property
    def agreed(self) -> bool:
        """Whether the routes agree at all frequencies."""
        return not np.any(self.disagreeing)

    @property
    def worst(self) -> int:
        """Position of the frequency that takes the largest part of its tolerance."""
        return int(np.argmax(self.used))

    @property
    def worst_magnitude(self) -> int:
        """Position of the largest difference of magnitudes."""
        return int(np.argmax(np.abs(self.difference.magnitude)))

    @property
    def worst_phase(self) -> int:
        """Position of the largest difference of phases."""
        return int(np.argmax(np.abs(self.difference.phase_deg)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unchecked:
    """Where two routes could not be compared, and why.

    Attributes:
        routes: names of the first and the second.
        omega: frequencies in rad/s.
        reason: why, in words.
    """

    routes: tuple[str, str]
    omega: Floats
    reason: str

    def __post_init__(self) -> None:
        make_read_only(self)

    def __str__(self) -> str:
        """Say what was not checked, for a warning."""
        shown = ", ".join(f"{w:g}" for w in self.omega[:4]) + (f" and {self.omega.size - 4} more" if self.omega.size > 4 else "")
        return f"{self.routes[0]} was not checked against {self.routes[1]} at {shown} rad/s: {self.reason}"
