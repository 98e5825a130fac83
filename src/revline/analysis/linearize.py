"""Exact linearisation of any system with delay channels about a steady state.

A lag may depend on the state. At a steady state what travels in a channel does not change with time, so reading it a little earlier or
later makes no first-order difference: the lag contributes its value alone, and only rate, output and emit are differentiated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from revline.analysis.jacobians import BLOCKS, Jacobians, Matrix, evaluate, find_jacobians
from revline.analysis.limits import Limit, find_limits
from revline.equations import Equation
from revline.errors import InvalidInputError
from revline.lti.state_space import DelayStateSpace, Signal
from revline.system import DelaySystem, Floats, Variable
from revline.values import make_read_only

DRIFT_LIMIT = 1e-8
"""Largest drift of a state at rest, per second, as a fraction of its search range."""

RESIDUAL_REMARK = 1e-10
"""A drift that is allowed but larger than this, in the same measure, is remarked upon: Newton's method leaves far less."""

NEAR = 0.01
"""A limit nearer than this part of an argument's range is remarked upon."""

KINK_STEPS = (1e-4, 1e-5)
"""Steps of one-sided differences, as fractions of a variable's range."""

KINK_TOLERANCE = 1e-3
"""One-sided derivatives that differ by more than this fraction, and as much at the small step as at the large, mark a kink."""

NOISE = 1e-7
"""Slopes below this fraction of the steepest of their equation, all arguments over their ranges, are rounding."""


class SteadyState(Protocol):
    """Where to linearise: a `Trim`, or any record of the same arrays."""

    @property
    def states(self) -> Floats:
        """Values of the states."""

    @property
    def inputs(self) -> Floats:
        """Values of the inputs."""

    @property
    def channels(self) -> Floats:
        """What the channels carry."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kink:
    """An argument at which an equation has no single derivative, or at which a limit makes it flat.

    Attributes:
        result: what is computed, for example "rate of manifold_pressure".
        argument: what it is computed from, for example "throttle".
        below: derivative for a small decrease of the argument.
        above: derivative for a small increase.
        used: derivative in the linear model.
    """

    result: str
    argument: str
    below: float
    above: float
    used: float

    def __str__(self) -> str:
        """Say what is limited, for a warning."""
        if self.below == self.above == self.used == 0.0:
            return f"{self.result} does not answer to {self.argument} here: a limit is active"
        sides = f"slope {self.below:g} below, {self.above:g} above"
        whose = {"below": ", which holds below alone", "above": ", which holds above alone"}.get(self.side, ", which is neither")
        return f"{self.result} has a kink in {self.argument} here: {sides}; the model has {self.used:g}{whose}"

    @property
    def side(self) -> Literal["below", "above", "both", "neither"]:
        """For which changes of the argument the linear model's derivative holds."""
        size = max(abs(self.below), abs(self.above))
        low, high = (abs(self.used - slope) <= KINK_TOLERANCE * size for slope in (self.below, self.above))
        return ("both" if high else "below") if low else ("above" if high else "neither")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearization:
    """A linear model about a steady state, with what limits its validity.

    A derivative at a kink holds on one side alone; `Kink.side` tells which, and `warnings` says so.

    Attributes:
        model: linear system with the delays exact.
        kinks: limits that are active, or just reached, at the point.
        system: what was linearised.
        arguments: states, inputs and channel readings at the point.
        residual: largest drift of a state at the point, per second, as a part of its search range.
        other_points: how many other steady states are known for the same inputs.
    """

    model: DelayStateSpace
    kinks: tuple[Kink, ...]
    system: DelaySystem
    arguments: Floats
    residual: float
    other_points: int

    def __post_init__(self) -> None:
        make_read_only(self)

    def find_limits(self) -> tuple[Limit, ...]:
        """Find all limits that the equations have, with their distance from the point, the nearest first; takes some 20 ms."""
        return find_limits(self.system, self.arguments, self._spans)

    @property
    def _spans(self) -> Floats:
        return _spans(self.system, self.arguments[len(self.system.states) + len(self.system.inputs) :])

    def warnings(self, limits: Sequence[Limit]) -> tuple[str, ...]:
        """Say what limits the model's validity: kinks, limits near by, a drift, other steady states.

        Args:
            limits: those of `find_limits`.
        """
        kinked = {kink.argument for kink in self.kinks}
        found = [str(kink) for kink in self.kinks]
        found += [str(limit) for limit in limits if limit.share <= NEAR and limit.argument not in kinked]
        if self.residual > RESIDUAL_REMARK:
            found.append(f"the point drifts by {self.residual:.3g} of a state's range per second; refine it (limit {DRIFT_LIMIT:g})")
        if self.other_points:
            found.append(f"one of {self.other_points + 1} steady states known for these inputs; the model holds about this one alone")
        return tuple(found)


def linearize(system: DelaySystem, point: SteadyState) -> Linearization:
    """Linearise a system about a steady state, with derivatives exact to rounding and all delays kept.

    Args:
        system: any system with delay channels.
        point: steady state, from `find_trim` for example.

    Returns:
        The linear model, and the kinks and active limits met at the point.

    Raises:
        InvalidInputError: the point does not fit the system or is no steady state, or an equation has no finite derivative there.

    Source:
        Complex step: Squire and Trapp (1998), SIAM Review 40(1), 110-112. State-dependent lags at a steady state: Cooke and Huang
        (1996), Proceedings of the AMS 124(5), 1417-1426.
    """
    (found,) = linearize_each(system, (point,))
    return found


def linearize_each(system: DelaySystem, points: Sequence[SteadyState]) -> tuple[Linearization, ...]:
    """Linearise a system about many steady states as `linearize` does about one, all at once.

    Args:
        system: any system with delay channels.
        points: steady states, from `find_trim` or a steady map for example.

    Returns:
        One linear model for each point, with the kinks and active limits met there.

    Raises:
        InvalidInputError: a point does not fit the system or is no steady state, or an equation has no finite derivative there.
    """
    if not points:
        return ()
    for point in points:
        _check_sizes(system, point)
    stacked = _Stacked(*(np.array([getattr(point, name) for point in points]) for name in ("states", "inputs", "channels")))
    for k in np.flatnonzero(~_are_steady(system, stacked)):
        check_steady(system, points[int(k)])
    jacobians = find_jacobians(system, stacked.states, stacked.inputs, stacked.channels)
    lags = evaluate(system, system.lags, stacked.states, stacked.inputs, stacked.channels)
    models = [build_model(system, jacobians.at(k), lags[k]) for k in range(len(points))]
    kinks = _find_kinks_each(system, stacked, jacobians)
    residuals = _residuals(system, stacked)
    return tuple(
        Linearization(
            model=model,
            kinks=tuple(kinks[k]),
            system=system,
            arguments=np.concatenate((stacked.states[k], stacked.inputs[k], stacked.channels[k])),
            residual=float(residuals[k]),
            other_points=len(getattr(point, "alternatives", ())),
        )
        for k, (model, point) in enumerate(zip(models, points, strict=True))
    )


@dataclass(frozen=True, slots=True)
class _Stacked:
    """Many points, along the first axis."""

    states: Floats
    inputs: Floats
    channels: Floats


def build_model(system: DelaySystem, jacobians: Jacobians, lags: Floats) -> DelayStateSpace:
    """Name the derivatives at one point as a linear system.

    Raises:
        InvalidInputError: a derivative is not finite, or a lag is not positive.
    """
    try:
        return DelayStateSpace(
            **{name: getattr(jacobians, name) for name in BLOCKS},
            lags=lags,
            states=_signals(system.states),
            inputs=_signals(system.inputs),
            outputs=_signals(system.outputs),
            channels=_signals(system.channels),
        )
    except InvalidInputError:
        _check_derivatives(system, jacobians)
        raise


def _check_derivatives(system: DelaySystem, jacobians: Jacobians) -> None:
    """Refuse derivatives without a value, by the names that the system gives."""
    of = (("the rate of", system.states), ("the output", system.outputs), ("what enters the channel", system.channels))
    blocks = np.block(
        [
            [jacobians.A, jacobians.Bu, jacobians.Bz],
            [jacobians.Cy, jacobians.Dyu, jacobians.Dyz],
            [jacobians.Cz, jacobians.Dzu, jacobians.Dzz],
        ]
    )
    if not np.isfinite(blocks).all():
        row, column = np.argwhere(~np.isfinite(blocks))[0]
        results = [f"{words} {variable.name}" for words, variables in of for variable in variables]
        argument = (*system.states, *system.inputs, *system.channels)[column].name
        message = (
            f"{system.name}: {results[row]} has no finite derivative by {argument} at this steady state ({blocks[row, column]:g}); write"
            " the equation so that no part of it overflows or is infinitely steep there"
        )
        raise InvalidInputError(message, result=results[row], argument=argument)


def check_steady(system: DelaySystem, point: SteadyState) -> float:
    """Refuse a point at which a state or a channel changes.

    Returns:
        Largest drift of a state, per second, as a part of its search range.

    Raises:
        InvalidInputError: names what changes, how fast, and the limit; or the signals that the point does not fit.
    """
    _check_sizes(system, point)
    drift = evaluate(system, system.rate, point.states, point.inputs, point.channels)
    for variable, rate in zip(system.states, drift, strict=True):
        limit = DRIFT_LIMIT * search_scale(variable)
        if not abs(rate) <= limit:
            unit = rate_unit(variable)
            message = f"no steady state: {variable.name} drifts by {rate:g} {unit} (limit {limit:g} {unit}); find one with find_trim()"
            raise InvalidInputError(message, quantity=variable.name, drift=float(rate), limit=limit)
    entering = evaluate(system, system.emit, point.states, point.inputs, point.channels)
    for variable, old, new in zip(system.channels, point.channels, entering, strict=True):
        if not abs(new - old) <= 1e-9 * (abs(old) + 1e-12):
            readings = f"reads {old:g} {variable.unit} where {new:g} {variable.unit} enters"
            message = f"no steady state: channel {variable.name} {readings}; find one with find_trim()"
            raise InvalidInputError(message, quantity=variable.name, reading=float(old), entering=float(new))
    return float(np.max(np.abs(drift) / _scales(system), initial=0.0))


def _scales(system: DelaySystem) -> Floats:
    return np.array([search_scale(variable) for variable in system.states])


def _residuals(system: DelaySystem, points: _Stacked) -> Floats:
    """The largest drift of each point's states, as a part of their search range per second."""
    drift = evaluate(system, system.rate, points.states, points.inputs, points.channels)
    return np.asarray(np.max(np.abs(drift) / _scales(system), axis=1, initial=0.0))


def _check_sizes(system: DelaySystem, point: SteadyState) -> None:
    for what, values, variables in (
        ("states", point.states, system.states),
        ("inputs", point.inputs, system.inputs),
        ("channels", point.channels, system.channels),
    ):
        if values.shape != (len(variables),):
            message = f"the point has {values.size} {what} where {system.name} has {len(variables)}; give a steady state of this system"
            raise InvalidInputError(message)


def _are_steady(system: DelaySystem, points: _Stacked) -> NDArray[np.bool_]:
    """Tell for many points at once what `check_steady` checks."""
    drift = evaluate(system, system.rate, points.states, points.inputs, points.channels)
    entering = evaluate(system, system.emit, points.states, points.inputs, points.channels)
    still = np.all(np.abs(drift) <= DRIFT_LIMIT * _scales(system), axis=1)
    return still & np.all(np.abs(entering - points.channels) <= 1e-9 * (np.abs(points.channels) + 1e-12), axis=1)


def search_scale(variable: Variable) -> float:
    """Give the width of a variable's search range, of its range where it has no other, or 1 where both are without end."""
    for low, high in ((variable.search_low, variable.search_high), (variable.low, variable.high)):
        if np.isfinite(low) and np.isfinite(high):
            return float(high - low)
    return max(1.0, abs(variable.nominal))


def rate_unit(variable: Variable) -> str:
    """Give the unit of a variable's rate of change: of rad/s it is rad/s2."""
    return f"{variable.unit}2" if variable.unit.endswith("/s") else f"{variable.unit}/s"


def _find_kinks_each(system: DelaySystem, points: _Stacked, jacobians: Jacobians) -> list[list[Kink]]:
    """Compare exact derivatives with one-sided differences, and find arguments to which an equation is flat.

    Returns:
        For each point one entry for each result and argument with a kink or an active limit. A smooth extremum is neither.
    """
    blocks = (
        ("rate of ", system.rate, system.states, (jacobians.A, jacobians.Bu, jacobians.Bz), system.structure.rate),
        ("output ", system.output, system.outputs, (jacobians.Cy, jacobians.Dyu, jacobians.Dyz), system.structure.output),
        ("channel ", system.emit, system.channels, (jacobians.Cz, jacobians.Dzu, jacobians.Dzz), system.structure.emit),
    )
    names = [variable.name for variable in (*system.states, *system.inputs)] + [f"reading of {v.name}" for v in system.channels]
    keys = [f"{k}{i}" for k, group in (("x", system.states), ("u", system.inputs), ("zd", system.channels)) for i in range(len(group))]
    found: list[list[Kink]] = [[] for _ in points.states]
    for prefix, function, results, slopes, structure in blocks:
        exact = np.concatenate(slopes, axis=-1)
        below, above, limited = _one_sided(system, function, points, exact)
        limited &= np.array([[key in sources for key in keys] for sources in structure], dtype=bool).reshape(exact.shape[1:])
        for k, row, column in np.argwhere(limited):
            kink = Kink(
                result=f"{prefix}{results[row].name}",
                argument=names[column],
                below=float(below[k, row, column]),
                above=float(above[k, row, column]),
                used=float(exact[k, row, column]),
            )
            found[k].append(kink)
    return found


def _one_sided(system: DelaySystem, function: Equation, points: _Stacked, exact: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Slopes below and above over (points, results, arguments), and where a limit makes them flat or different."""
    widths = _spans(system, points.channels)
    coarse, fine = (_differences(system, function, points, fraction * widths) for fraction in KINK_STEPS)
    wide, narrow = (np.abs(above - below) for below, above in (coarse, fine))
    below, above = fine
    spans = widths[:, None, :]
    rise = np.maximum(np.abs(below), np.abs(above)) * spans
    steepest = np.max(rise, axis=-1, keepdims=True, initial=0.0)
    # Curvature makes the sides differ in proportion to the step; at a kink the difference does not shrink with it.
    kinked = ~((narrow <= 0.5 * wide) | (narrow * spans <= KINK_TOLERANCE * rise) | (narrow * spans <= NOISE * steepest))
    flat = (coarse[0] == 0.0) & (coarse[1] == 0.0) & (exact == 0.0)
    return below, above, kinked | flat


def _spans(system: DelaySystem, channels: Floats) -> Floats:
    """Ranges of states and inputs, and sizes of readings of any leading shape, along the last axis."""
    fixed = np.array([search_scale(v) for v in (*system.states, *system.inputs)])
    carried = np.where(channels == 0.0, 1.0, np.abs(channels))
    return np.concatenate((np.broadcast_to(fixed, (*carried.shape[:-1], fixed.size)), carried), axis=-1)


def _differences(system: DelaySystem, function: Equation, points: _Stacked, steps: Floats) -> tuple[Matrix, Matrix]:
    base = np.concatenate((points.states, points.inputs, points.channels), axis=1)
    ends = np.cumsum((points.states.shape[1], points.inputs.shape[1]))
    centre = evaluate(system, function, points.states, points.inputs, points.channels)[:, None, :]
    sides = []
    for sign in (-1.0, 1.0):
        moved = base[:, None, :] + sign * steps[:, :, None] * np.eye(base.shape[1])
        values = evaluate(system, function, *np.split(moved, ends, axis=-1))
        sides.append(np.swapaxes((values - centre) * sign / steps[:, :, None], 1, 2))
    return sides[0], sides[1]


def _signals(variables: tuple[Variable, ...]) -> tuple[Signal, ...]:
    return tuple(Signal(variable.name, variable.unit) for variable in variables)
