"""Explicit Runge-Kutta methods as data.

Source of the format: Butcher (2016), Numerical Methods for Ordinary Differential Equations, chapter 3.
"""

from dataclasses import dataclass

from revline.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Tableau:
    """An explicit Runge-Kutta method.

    Attributes:
        name: as people call it.
        order: of convergence on smooth problems.
        nodes: where in the step each stage stands, 0 to 1.
        coupling: per stage the weights of the earlier stages' rates; strictly lower triangular, rows of equal length.
        weights: of the stages' rates in the step.
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    coupling: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        stages = len(self.nodes)
        if len(self.weights) != stages or any(len(row) != stages for row in self.coupling) or len(self.coupling) != stages:
            message = f"tableau {self.name}: {stages} nodes need as many weights and as many rows of that length"
            raise InvalidInputError(message)
        if any(self.coupling[i][j] != 0.0 for i in range(stages) for j in range(i, stages)):
            message = f"tableau {self.name} is not explicit: a stage uses itself or a later one"
            raise InvalidInputError(message)


RK4 = Tableau(
    name="RK4",
    order=4,
    nodes=(0.0, 0.5, 0.5, 1.0),
    coupling=((0.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.0), (0.0, 0.5, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)),
    weights=(1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
)
"""The classical method. Source: Kutta (1901); used by Lee (1995), chapter 3."""

HEUN = Tableau(name="Heun", order=2, nodes=(0.0, 1.0), coupling=((0.0, 0.0), (1.0, 0.0)), weights=(0.5, 0.5))
"""Second order, for order tests and comparisons. Source: Heun (1900)."""

TABLEAUX = (HEUN, RK4)
