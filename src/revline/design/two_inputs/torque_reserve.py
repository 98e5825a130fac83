"""What a fast input can do at a point: sign and size of its gain on a quantity, and the reserve up to where the gain ends.

For spark advance the quantity is the indicated torque. At the spark of best torque the gain is zero, and so is the reserve; the torque
held back by running away from it is the reserve. The states, and with them the charge that burns, are held at the point.
Source: Hrovat and Sun (1997), Control Engineering Practice 5(8), 1093-1100.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from revline.analysis.jacobians import evaluate, find_jacobians
from revline.analysis.trim import Trim
from revline.errors import InvalidInputError
from revline.system import DelaySystem, Floats, index_of
from revline.values import make_read_only

Curve = Callable[[Floats], tuple[Floats, Floats]]
"""Values of the input to the quantity and its slope."""

SAMPLES = 721
"""Values of the input over its range at which the sign of its gain is looked at."""

LEAST_RESERVE = 1e-3
"""A smaller reserve, as a part of the quantity, is none: the input cannot help."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TorqueReserve:
    """The authority of an input over a quantity, both at rest, the states held.

    Attributes:
        input, unit: name of the input and its unit.
        quantity, quantity_unit: what it acts on.
        rest: the input at the point.
        value: the quantity there.
        gain: its derivative by the input there.
        best: the input at which the quantity is highest, on this side of the point.
        worst: the other end of the range about the point in which the gain keeps its sign, or the input's own end.
        highest: the quantity at `best`.
        inputs, values: samples from the lower to the higher of `best` and `worst`, shape (n,).
    """

    input: str
    unit: str
    quantity: str
    quantity_unit: str
    rest: float
    value: float
    gain: float
    best: float
    worst: float
    highest: float
    inputs: Floats
    values: Floats

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def sign(self) -> float:
        """1 where the quantity rises with the input, -1 where it falls."""
        return float(np.sign(self.gain))

    @property
    def reserve(self) -> float:
        """By how much the input alone can raise the quantity."""
        return self.highest - self.value

    @property
    def range(self) -> tuple[float, float]:
        """Values of the input between which the gain keeps its sign."""
        return min(self.best, self.worst), max(self.best, self.worst)

    def quantity_at(self, values: Floats) -> Floats:
        """Give the quantity at values of the input within the range, to the samples' accuracy."""
        return np.asarray(np.interp(values, self.inputs, self.values))


def find_torque_reserve(system: DelaySystem, trim: Trim, *, name: str = "spark", quantity: str = "indicated_torque") -> TorqueReserve:
    """Find sign, range and reserve of an input that acts through a delay channel or at once.

    Args:
        system: that of the trim.
        trim: the point.
        name: of the input.
        quantity: output that it acts on.

    Raises:
        InvalidInputError: there is no such signal, or the input has no authority there: the reserve is below a thousandth of the quantity.
    """
    column, row = index_of(system.inputs, name), index_of(system.outputs, quantity)
    variable, unit = system.inputs[column], system.outputs[row].unit
    rest, low, high = float(trim.inputs[column]), variable.low, variable.high
    if not (np.isfinite(low) and np.isfinite(high)):
        message = f"{name} has no finite range ({low:g} to {high:g} {variable.unit}), so that its authority cannot be searched; give it one"
        raise InvalidInputError(message, low=low, high=high)

    def curve(values: Floats) -> tuple[Floats, Floats]:
        return _value_and_slope(system, trim, values, column, row)

    grid = np.union1d(np.linspace(low, high, SAMPLES)[1:-1], rest)
    value, slope = (float(array[0]) for array in curve(np.array([rest])))
    _, slopes = curve(grid)
    upward = slope >= 0.0
    ends = [_end(curve, grid, slopes * (1.0 if upward else -1.0), rest, direction=direction) for direction in (-1, 1)]
    worst, best = ends if upward else ends[::-1]
    highest = float(curve(np.array([best]))[0][0])
    if not highest - value > LEAST_RESERVE * abs(value):
        message = (
            f"{name} = {rest:g} {variable.unit} has no authority over {quantity}: its gain is {slope:.3g} {unit}/{variable.unit} and its "
            f"reserve {highest - value:.3g} {unit} of {value:.4g} {unit} (limit {LEAST_RESERVE:g} of it); choose a set-point away from "
            f"that of best torque, {best:.4g} {variable.unit}"
        )
        raise InvalidInputError(message, quantity=name, value=rest, gain=slope, reserve=highest - value)
    inputs = np.linspace(min(best, worst), max(best, worst), SAMPLES)
    return TorqueReserve(
        input=name,
        unit=variable.unit,
        quantity=quantity,
        quantity_unit=unit,
        rest=rest,
        value=value,
        gain=slope,
        best=best,
        worst=worst,
        highest=highest,
        inputs=inputs,
        values=curve(inputs)[0],
    )


def _value_and_slope(system: DelaySystem, trim: Trim, values: Floats, column: int, row: int) -> tuple[Floats, Floats]:
    """The quantity and its derivative at rest over the input, shape (n,) each."""
    x = np.tile(trim.states, (values.size, 1))
    u = np.tile(trim.inputs, (values.size, 1))
    u[:, column] = values
    held = np.tile(trim.channels, (values.size, 1))
    zd = evaluate(system, system.emit, x, u, held)
    found = find_jacobians(system, x, u, zd)
    slope = found.Dyu[:, row, column] + np.einsum("nk,nk->n", found.Dyz[:, row], found.Dzu[:, :, column])
    return evaluate(system, system.output, x, u, zd)[:, row], slope


def _end(curve: Curve, grid: Floats, slopes: Floats, rest: float, *, direction: int) -> float:
    """Where the slope changes its sign, or the last sample on that side."""
    side = grid[grid >= rest] if direction > 0 else grid[grid <= rest][::-1]
    along = slopes[grid >= rest] if direction > 0 else slopes[grid <= rest][::-1]
    ended = np.flatnonzero(~(along > 0.0))
    if not ended.size:
        return float(side[-1])
    k = int(ended[0])
    if k == 0 or along[k] == 0.0:
        return float(side[k])
    return float(brentq(lambda v: float(curve(np.array([v]))[1][0]), side[k - 1], side[k]))
