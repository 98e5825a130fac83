"""Steady states of any system with delay channels: all of those in its search range, each with its stability.

At rest every channel reads what enters it now, so that lags do not matter for where a steady state lies; they decide whether it is stable.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from revline.analysis.jacobians import evaluate, find_jacobians
from revline.analysis.linearize import DRIFT_LIMIT, build_model, rate_unit, search_scale
from revline.analysis.steady_equations import SteadyEquations, Target, solve_steady
from revline.errors import InvalidInputError, NoTrimError, RevlineError
from revline.lti.roots import RightmostRoots, characteristic_roots
from revline.system import DelaySystem, Floats, Variable, check_range, index_of
from revline.values import make_read_only

MOST_NAMED = 3
"""Steady states outside the search range that a message names; it counts the others."""

LONGEST_JUDGED = 10.0
"""A steady state outside the search range with a longer lag, in s, is not judged for stability: no machine runs there."""

SWEEP, SWEEP_STARTS = 31, 8
"""Values of a free input, and starts at each, to tell how near a target can be reached."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A steady state of the equations that lies outside a state's search range.

    Attributes:
        quantity, value, unit: the state that lies outside.
        limit: the end of its search range that it passes.
        longest_lag: of all channels there, in s; 0 without channels.
        stability: in words; empty where it was not found.
    """

    quantity: str
    value: float
    unit: str
    limit: float
    longest_lag: float
    stability: str = ""

    def __str__(self) -> str:
        """Name the steady state, for a warning."""
        side = "below" if self.value < self.limit else "above"
        lag = f", with a lag of {self.longest_lag:.3g} s" if self.longest_lag > 0.0 else ""
        stability = f", {self.stability}" if self.stability else ""
        where = f"{self.quantity} = {self.value:.4g} {self.unit}{lag}{stability}"
        return f"left out: a steady state at {where}, {side} the search limit {self.limit:g} {self.unit}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trim:
    """A steady operating point, and what else the search met.

    Attributes:
        system: name of the system.
        state_variables, input_variables, channel_variables, output_variables: its signals.
        states, inputs, channels, outputs: their values at rest.
        lags: of the channels, in s.
        drift: what is left of the rates of the states, in their units per second.
        roots: right-most characteristic roots of the exact linearisation.
        alternatives: other trims for the same request, inside the search range.
        left_out: steady states outside the search range.
    """

    system: str
    state_variables: tuple[Variable, ...]
    input_variables: tuple[Variable, ...]
    channel_variables: tuple[Variable, ...]
    output_variables: tuple[Variable, ...]
    states: Floats
    inputs: Floats
    channels: Floats
    outputs: Floats
    lags: Floats
    drift: Floats
    roots: RightmostRoots
    alternatives: "tuple[Trim, ...]" = field(default=())
    left_out: tuple[LeftOut, ...] = field(default=())

    def __post_init__(self) -> None:
        for variable, rate in zip(self.state_variables, self.drift, strict=True):
            if not abs(rate) <= DRIFT_LIMIT * search_scale(variable):
                message = f"{variable.name} drifts by {rate:g} {rate_unit(variable)}; that is no trim"
                raise InvalidInputError(message, quantity=variable.name, drift=float(rate))
        make_read_only(self)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return self.roots.stable

    @property
    def unstable_count(self) -> int:
        """Number of characteristic roots in the right half-plane."""
        return self.roots.unstable_count

    @property
    def residual(self) -> float:
        """Largest drift per second, as a fraction of the state's search range."""
        scales = np.array([search_scale(v) for v in self.state_variables])
        return float(np.max(np.abs(self.drift) / scales, initial=0.0))

    def state(self, name: str) -> float:
        """Value of a state. Raises InvalidInputError where there is none of that name."""
        return float(self.states[index_of(self.state_variables, name)])

    def input(self, name: str) -> float:
        """Value of an input. Raises InvalidInputError where there is none of that name."""
        return float(self.inputs[index_of(self.input_variables, name)])

    def output(self, name: str) -> float:
        """Value of an output. Raises InvalidInputError where there is none of that name."""
        return float(self.outputs[index_of(self.output_variables, name)])

    def channel(self, name: str) -> float:
        """What a channel carries. Raises InvalidInputError where there is none of that name."""
        return float(self.channels[index_of(self.channel_variables, name)])

    def lag(self, name: str) -> float:
        """Lag of a channel, in s. Raises InvalidInputError where there is none of that name."""
        return float(self.lags[index_of(self.channel_variables, name)])


def find_trim(
    system: DelaySystem,
    *,
    inputs: Mapping[str, float] | None = None,
    outputs: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    near: Mapping[str, float] | None = None,
    starts: int = 24,
) -> Trim:
    """Find the steady states for given inputs, or for prescribed outputs with as many inputs free.

    Newton with exact derivatives runs from many points spread over the search ranges, all at once. Of several trims the one with the
    fewest unstable roots is chosen, among those the one with the largest first output (of an engine its speed); with `near`, the
    nearest. The others are its `alternatives`.

    Args:
        system: any system with delay channels.
        inputs: known inputs; the others have their nominal values.
        outputs: outputs or states to hold at a value.
        free: inputs to find, as many as there are `outputs`.
        near: values of some states to start from too; the nearest trim is chosen.
        starts: how many points to start from.

    Returns:
        The trim, its stability, and all other steady states met.

    Raises:
        InvalidInputError: a name is unknown, a value is out of range, or outputs and free inputs are not equally many.
        NoTrimError: there is no steady state in the search range; the message says how near the search came.

    Example:
        >>> from revline.engine.lee1995 import lee1995
        >>> round(find_trim(lee1995(), inputs={"throttle": 25.0}).state("engine_speed"), 3)
        240.799
    """
    equations = pose(system, inputs or {}, outputs or {}, tuple(free))
    beginnings = equations.starts(starts, _named_states(system, near or {}))
    search = solve_steady(equations, beginnings)
    candidates, left_out = [], []
    for unknowns in search.solutions:
        outside = _outside(equations, unknowns)
        if outside:
            left_out.append(_judged(equations, unknowns, outside))
        else:
            candidates.append(_build(equations, unknowns))
    if not candidates:
        raise _no_trim(equations, search.closest, search.isolated, left_out)
    ordered = _by_preference(system, candidates, near or {})
    return replace(ordered[0], alternatives=tuple(ordered[1:]), left_out=tuple(left_out))


def pose(system: DelaySystem, inputs: Mapping[str, float], outputs: Mapping[str, float], free: tuple[str, ...]) -> SteadyEquations:
    """State which equations hold at the trim asked for, and in which unknowns.

    Raises:
        InvalidInputError: a name is unknown, a value out of range, an input both given and free, or the counts do not match.
    """
    known = system.input_vector(inputs)
    freed = tuple(index_of(system.inputs, name) for name in free)
    for name in free:
        if name in inputs:
            message = f"{name} is both given as {inputs[name]:g} and free; leave one out"
            raise InvalidInputError(message, name=name)
    if len(set(free)) != len(outputs) or len(free) != len(outputs):
        message = f"{len(outputs)} prescribed outputs need as many free inputs, not {len(free)}: name each free input once"
        raise InvalidInputError(message, prescribed=len(outputs), free=len(free))
    return SteadyEquations(system=system, known=known, free=freed, targets=tuple(_target(system, *item) for item in outputs.items()))


def _target(system: DelaySystem, name: str, value: float) -> Target:
    for variable in (*system.states, *system.outputs):
        if variable.name == name:
            check_range(variable, value)
    if any(v.name == name for v in system.outputs):
        index = index_of(system.outputs, name)
        variable, is_state = system.outputs[index], False
    else:
        index = index_of((*system.states, *system.outputs), name)
        variable, is_state = system.states[index], True
    ranged = next((v for v in system.states if v.name == name), variable)
    return Target(variable=variable, index=index, is_state=is_state, value=value, scale=max(search_scale(ranged), 1e-3 * abs(value)))


def _named_states(system: DelaySystem, near: Mapping[str, float]) -> dict[int, float]:
    return {index_of(system.states, name): value for name, value in near.items()}


def _outside(equations: SteadyEquations, unknowns: Floats) -> LeftOut | tuple[()]:
    """The state that lies outside its search range, or nothing."""
    system = equations.system
    x, u = equations.split(unknowns)
    for variable, value in zip(system.states, x, strict=True):
        slack = 1e-12 * search_scale(variable)
        if not variable.search_low - slack <= value <= variable.search_high + slack:
            lags = evaluate(system, system.lags, x, u, equations.channels(unknowns))
            return LeftOut(
                quantity=variable.name,
                value=float(value),
                unit=variable.unit,
                limit=variable.search_low if value < variable.search_low else variable.search_high,
                longest_lag=float(np.max(lags, initial=0.0)),
            )
    return ()


def _judged(equations: SteadyEquations, unknowns: Floats, entry: LeftOut) -> LeftOut:
    """Say whether a steady state outside the search range is stable, where that can be told without long work."""
    if entry.longest_lag > LONGEST_JUDGED:
        return entry
    try:
        count = _build(equations, unknowns).unstable_count
    except RevlineError:
        return entry
    return replace(entry, stability=f"unstable ({count} roots right of the imaginary axis)" if count else "stable")


def _build(equations: SteadyEquations, unknowns: Floats) -> Trim:
    system = equations.system
    x, u = equations.split(unknowns)
    zd = equations.channels(unknowns)
    lags = evaluate(system, system.lags, x, u, zd)
    return Trim(
        system=system.name,
        state_variables=system.states,
        input_variables=system.inputs,
        channel_variables=system.channels,
        output_variables=system.outputs,
        states=x,
        inputs=u,
        channels=zd,
        outputs=evaluate(system, system.output, x, u, zd),
        lags=lags,
        drift=evaluate(system, system.rate, x, u, zd),
        roots=characteristic_roots(build_model(system, find_jacobians(system, x, u, zd), lags)),
    )


def _by_preference(system: DelaySystem, trims: list[Trim], near: Mapping[str, float]) -> list[Trim]:
    wanted = _named_states(system, near)
    scales = [search_scale(v) for v in system.states]

    def rank(trim: Trim) -> tuple[float, float, float]:
        distance = sum(abs(trim.states[k] - value) / scales[k] for k, value in wanted.items())
        return distance, trim.unstable_count, -float(trim.outputs[0]) if trim.outputs.size else 0.0

    return sorted(trims, key=rank)


def _no_trim(equations: SteadyEquations, closest: Floats, isolated: bool, left_out: list[LeftOut]) -> NoTrimError:  # noqa: FBT001 - a fact, not a mode
    request = equations.describe()
    if left_out:
        # At a standstill any free input will do, which gives one and the same state many times.
        distinct = list({(entry.quantity, round(entry.value, 6)): entry for entry in left_out}.values())
        more = (f"and {len(distinct) - MOST_NAMED} more",) if len(distinct) > MOST_NAMED else ()
        found = "; ".join((*(str(entry) for entry in distinct[:MOST_NAMED]), *more))
        return NoTrimError(f"no trim at {request} inside the search range ({found}); change the inputs", request=request)
    if not isolated:
        message = f"no trim at {request}: steady states are not isolated, a state is free to rest anywhere; hold it with `outputs`"
        return NoTrimError(message, request=request)
    drift, limit, text = equations.worst(closest)
    near = _nearest_reached(equations)
    words = f"; the nearest steady state met has {near[1]}" if near else ""
    message = f"no trim at {request}: {text}{words}. The point may lie outside the operating range; see find_steady_map() or revline map"
    return NoTrimError(message, request=request, drift=drift, limit=limit, **({"nearest": near[0]} if near else {}))


def _nearest_reached(equations: SteadyEquations) -> tuple[float, str] | tuple[()]:
    """Sweep the only free input over its range: what the only target comes nearest to at rest, and in words where."""
    system = equations.system
    swept = [system.inputs[k] for k in equations.free]
    if len(swept) != 1 or not np.all(np.isfinite((swept[0].low, swept[0].high))):
        return ()
    (target,), reached = equations.targets, []
    for value in np.linspace(swept[0].low, swept[0].high, SWEEP):
        known = equations.known.copy()
        known[equations.free[0]] = value
        posed = SteadyEquations(system=system, known=known, free=(), targets=())
        for unknowns in solve_steady(posed, posed.starts(SWEEP_STARTS, {})).solutions:
            if not _outside(posed, unknowns):
                x, u = posed.split(unknowns)
                shown = x if target.is_state else evaluate(system, system.output, x, u, posed.channels(unknowns))
                reached.append((abs(float(shown[target.index]) - target.value), float(shown[target.index]), float(value)))
    if not reached:
        return ()
    _, nearest, value = min(reached)
    unit = target.variable.unit
    return nearest, f"{target.variable.name} = {nearest:.6g} {unit}, at {swept[0].name} = {value:.4g} {swept[0].unit}"
