"""Explicit Runge-Kutta methods as data.

Source of the format: Butcher (2016), Numerical Methods for Ordinary Differential Equations, chapter 3.
"""

import math
from dataclasses import dataclass

from revline.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Tableau:
    """An explicit Runge-Kutta method whose stages each start from the rate of the one before, as the classical methods do.

    Stage k stands at t + c_k h and x + c_k h f_(k-1); the step ends at x + h (b_1 f_1 + ... + b_s f_s).

    Attributes:
        name: as people call it.
        order: of convergence on smooth problems.
        nodes: c, where in the step each stage stands, 0 to 1, the first at 0.
        weights: b, of the stages' rates in the step; their sum is 1.

    Raises:
        InvalidInputError: the nodes and weights make no such method.
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.weights) != len(self.nodes) or not self.nodes:
            message = f"tableau {self.name}: {len(self.nodes)} nodes and {len(self.weights)} weights; give one weight per node"
            raise InvalidInputError(message)
        if self.nodes[0] != 0.0 or not all(0.0 <= node <= 1.0 for node in self.nodes):
            message = f"tableau {self.name} has nodes {self.nodes}; the first must be 0, the others 0 to 1"
            raise InvalidInputError(message)
        if not math.isclose(sum(self.weights), 1.0, rel_tol=1e-12):
            message = f"tableau {self.name}: its weights add up to {sum(self.weights):g}; they must add up to 1"
            raise InvalidInputError(message)


RK4 = Tableau(name="RK4", order=4, nodes=(0.0, 0.5, 0.5, 1.0), weights=(1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0))
"""The classical method. Source: Kutta (1901); used by Lee (1995), chapter 3."""

HEUN = Tableau(name="Heun", order=2, nodes=(0.0, 1.0), weights=(0.5, 0.5))
"""Second order, for order tests and comparisons. Source: Heun (1900)."""

TABLEAUX = (HEUN, RK4)
