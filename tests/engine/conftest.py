from collections.abc import Callable, Sequence
from typing import Any

import pytest

Agree = Callable[[Callable[..., Any], Any, Sequence[float], float], None]


def complex_step(function: Callable[..., Any], point: Sequence[float], position: int) -> float:
    """Exact derivative by one argument: the imaginary part after an imaginary step too small to matter.

    Source: Squire and Trapp (1998), SIAM Review 40(1), 110-112.
    """
    step = 1e-200
    result = function(*(value + 1j * step * (k == position) for k, value in enumerate(point)))
    return float((result + 0j).imag / step)


def central_difference(function: Callable[..., Any], point: Sequence[float], position: int) -> float:
    """Derivative by one argument from real values alone."""
    step = 1e-5 * max(abs(point[position]), 0.1)
    above, below = (function(*(v + s * (k == position) for k, v in enumerate(point))) for s in (step, -step))
    return float((above - below) / (2.0 * step))


@pytest.fixture(scope="session")
def derivatives_agree() -> Agree:
    """Check all derivatives of an equation by its scalar arguments after the first, to 1e-7 of the result's scale over the argument."""

    def agree(function: Callable[..., Any], part: Any, point: Sequence[float], scale: float) -> None:
        for position, value in enumerate(point):
            exact = complex_step(lambda *values: function(part, *values), point, position)
            estimate = central_difference(lambda *values: function(part, *values), point, position)
            size = max(abs(exact), scale / max(abs(value), 0.1))
            assert abs(exact - estimate) <= 1e-7 * size, (function.__name__, position, point, exact, estimate)

    return agree
