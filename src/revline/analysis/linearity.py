"""The verdict on linearity: at which frequencies an output under a sinusoid follows its frequency with little distortion."""

from collections.abc import Sequence
from dataclasses import dataclass

from revline.analysis.harmonic_balance import HarmonicBalance
from revline.analysis.sinestream import Sinestream
from revline.analysis.spectrum import SpectralCheck
from revline.errors import InvalidInputError, out_of_range

DISTORTION_LIMIT = 0.05
"""Largest distortion of an answer that counts as linear, where none other is asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearityPoint:
    """What one simulated sinusoid showed.

    Attributes:
        omega: frequency in rad/s.
        distortion: root of the summed squares of the harmonics from the second on, over the fundamental.
        follows: whether the highest line of the spectrum is that of the input.
    """

    omega: float
    distortion: float
    follows: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearityVerdict:
    """Where an output answers a sinusoid as a linear system would, at one amplitude.

    Attributes:
        points: what was looked at, in the order of frequency.
        distortion_limit: largest distortion that counts as linear.
    """

    points: tuple[LinearityPoint, ...]
    distortion_limit: float

    def __post_init__(self) -> None:
        if not self.points:
            message = "no frequencies to judge linearity by; give a sinestream or spectral checks"
            raise InvalidInputError(message)
        check_distortion_limit(self.distortion_limit)

    @property
    def low(self) -> float:
        """Lowest frequency looked at, in rad/s."""
        return self.points[0].omega

    @property
    def high(self) -> float:
        """Highest frequency looked at, in rad/s."""
        return self.points[-1].omega

    @property
    def largest_distortion(self) -> float:
        """Largest distortion of all points."""
        return self._worst.distortion

    @property
    def where(self) -> float:
        """Frequency of the largest distortion, in rad/s."""
        return self._worst.omega

    @property
    def failures(self) -> tuple[LinearityPoint, ...]:
        """Points at which the output does not follow, or is distorted beyond the limit."""
        return tuple(point for point in self.points if not self._passes(point))

    @property
    def follows(self) -> bool:
        """Whether all points pass."""
        return not self.failures

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Lowest and highest frequency of each run of neighbouring points that pass, in rad/s; empty where none passes."""
        found: list[tuple[float, float]] = []
        before = False
        for point in self.points:
            passes = self._passes(point)
            if passes:
                start = found.pop()[0] if before else point.omega
                found.append((start, point.omega))
            before = passes
        return tuple(found)

    @property
    def text(self) -> str:
        """The verdict in words and numbers."""
        worst = f"distortion is {100.0 * self.largest_distortion:.2g} % at most, at {self.where:g} rad/s"
        limit = f"limit {100.0 * self.distortion_limit:g} %"
        if len(self.points) == 1:
            other = "" if self.points[0].follows else "another line than the input's is highest, "
            return f"{'follows' if self.follows else 'is not linear at'} the only frequency looked at: {other}{worst} ({limit})"
        span = f"{self.low:g} to {self.high:g} rad/s"
        if self.follows:
            return f"follows the input's frequency from {span}, at all {len(self.points)} frequencies looked at: {worst} ({limit})"
        lost = sum(not point.follows for point in self.points)
        inside = " and ".join(f"{low:g} to {high:g} rad/s" for low, high in self.ranges) or "nowhere"
        return (
            f"is not linear at {len(self.failures)} of {len(self.points)} frequencies from {span}: {worst} ({limit}); "
            f"another line than the input's is highest at {lost or 'none'} of them; it is linear {'from ' if self.ranges else ''}{inside}"
        )

    @property
    def _worst(self) -> LinearityPoint:
        return max(self.points, key=lambda point: point.distortion)

    def _passes(self, point: LinearityPoint) -> bool:
        return point.follows and point.distortion <= self.distortion_limit


def check_distortion_limit(limit: float) -> None:
    """Refuse a limit that is no part of the fundamental.

    Raises:
        InvalidInputError: it is not between 0 and 1.
    """
    if not 0.0 < limit < 1.0:
        raise out_of_range("distortion limit", limit, "of the fundamental", "0 to 1, without the ends", "give one such as 0.05")


def judge_linearity(
    streams: Sequence[Sinestream | HarmonicBalance] = (),
    checks: Sequence[SpectralCheck] = (),
    *,
    distortion_limit: float = DISTORTION_LIMIT,
) -> LinearityVerdict:
    """Judge from answers to sinusoids in which range of frequencies an output follows its input linearly.

    A point of a response follows where no harmonic is higher than the fundamental; a spectral check says so itself. A frequency in both
    must pass both.

    Args:
        streams: frequency responses by simulation or by harmonic balance.
        checks: spectral checks.
        distortion_limit: largest distortion that counts as linear.

    Returns:
        The verdict, with all points that it rests on.

    Raises:
        InvalidInputError: there is nothing to judge by, or the limit is not between 0 and 1.
    """
    points: dict[float, LinearityPoint] = {}
    seen = [
        (float(omega), float(distortion), bool(harmonics[0] >= harmonics[1:].max()))
        for stream in streams
        for omega, distortion, harmonics in zip(stream.omega, stream.distortion, stream.harmonics, strict=True)
    ]
    seen += [(check.omega, check.distortion, check.follows) for check in checks]
    for omega, distortion, follows in seen:
        known = points.get(omega, LinearityPoint(omega=omega, distortion=0.0, follows=True))
        points[omega] = LinearityPoint(omega=omega, distortion=max(distortion, known.distortion), follows=follows and known.follows)
    return LinearityVerdict(points=tuple(points[omega] for omega in sorted(points)), distortion_limit=distortion_limit)
