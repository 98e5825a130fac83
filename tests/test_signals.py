"""Signals by themselves: values on both sides of a jump, bounds, and what they refuse."""

import math

import numpy as np
import pytest

from revline import signals
from revline.errors import InvalidInputError
from revline.signals import Signal


@pytest.mark.parametrize(
    ("signal", "bounds"),
    [
        (signals.step(50.0, start=1.0) + signals.step(-50.0, start=2.0) + signals.step(50.0, start=3.0), (0.0, 50.0)),
        (signals.step(50.0, start=1.0) + signals.step(-50.0, start=1.0), (0.0, 0.0)),
        (signals.step(5.0, start=20.0), (0.0, 0.0)),
        (signals.step(4.0, rise=2.0) + signals.step(-3.0, start=1.0), (-1.0, 2.0)),
        (signals.sine(2.0, 5.0, start=4.0) + signals.step(7.0, start=2.0) + signals.step(-7.0, start=3.0), (-2.0, 7.0)),
        (signals.pulse_cycle(3.0, 1.0) + signals.trapezoid_cycle(1.0, 0.5), (-1.0, 4.0)),
        (signals.recorded(np.array([0.0, 1.0, 3.0]), np.array([1.0, -2.0, 5.0])) + signals.step(-5.0, start=3.0), (-2.0, 5.0)),
        (Signal(), (0.0, 0.0)),
    ],
)
def test_extremes_are_those_of_the_sum(signal: Signal, bounds: tuple[float, float]) -> None:
    assert signal.extremes(0.0, 10.0) == pytest.approx(bounds, abs=1e-12)
    low, high = signal.range()
    assert low <= bounds[0]
    assert high >= bounds[1]


def test_no_value_leaves_the_extremes() -> None:
    """Against values sampled so finely that they come within 3 % of both."""
    signal = signals.pulse_cycle(2.0, 0.7) + signals.sine(1.0, 3.0) + signals.step(-4.0, start=1.3, rise=2.2) + signals.step(5.0, start=4.1)
    low, high = signal.extremes(0.0, 60.0)
    values = [signal(float(time)) for time in np.linspace(0.0, 60.0, 60_001)]
    assert low <= min(values) < low + 0.03 * (high - low)
    assert high - 0.03 * (high - low) < max(values) <= high


def test_a_cycle_of_too_many_periods_is_refused() -> None:
    with pytest.raises(
        InvalidInputError, match=r"^cycle duration = 1e-06 s is outside durations whose periods are at most 1000000 until 2 s"
    ):
        signals.pulse_cycle(1.0, 1e-6).breakpoints(0.0, 2.0)
    assert len(signals.pulse_cycle(1.0, 0.5).breakpoints(0.0, 2.0)) == 8


@pytest.mark.parametrize("frequency", [0.0, -1.0, math.nan, math.inf])
def test_a_frequency_that_is_none_is_refused(frequency: float) -> None:
    with pytest.raises(InvalidInputError, match=r"^sine frequency = \S+ rad/s is outside values above 0"):
        signals.sine(1.0, frequency)
