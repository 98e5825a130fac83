"""Steady states of any system with delay channels: all of those in its search range, each with its stability.

At rest every channel reads what enters it now, so that lags do not matter for where a steady state lies; they decide whether it is stable.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from revline.analysis.jacobians import evaluate, find_jacobians, settle_channels
from revline.analysis.linearize import DRIFT_LIMIT, build_model, rate_unit, search_scale
from revline.analysis.steady_equations import AT_ONCE, Search, SteadyEquations, Target, solve_steady
from revline.analysis.trim_refusals import LeftOut, find_outside, no_trim
from revline.errors import InvalidInputError, RevlineError
from revline.lti.root_batches import characteristic_roots_each
from revline.lti.roots import RightmostRoots
from revline.lti.state_space import DelayStateSpace
from revline.system import DelaySystem, Floats, Variable, check_range, index_of
from revline.values import make_read_only

LONGEST_JUDGED = 10.0
"""A steady state outside the search range with a longer lag, in s, is not judged for stability: no machine runs there."""


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
        for variable, value in zip(self.output_variables, self.outputs, strict=True):
            if not math.isfinite(value):
                message = f"{variable.name} = {value:g} {variable.unit} at rest; an output without a value makes no trim"
                raise InvalidInputError(message, quantity=variable.name, value=float(value))
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
        InvalidInputError: a name is unknown, a value is out of range, or outputs and free inputs are not equally many; or an equation
            has no finite derivative or value at a steady state, or a lag is not positive there.
        NoTrimError: there is no steady state in the search range; the message says how near the search came.
        NotConvergedError: the stability of a steady state could not be decided.

    Example:
        >>> from revline.engine.lee1995 import lee1995
        >>> round(find_trim(lee1995(), inputs={"throttle": 25.0}).state("engine_speed"), 3)
        240.799
    """
    equations = pose(system, inputs or {}, outputs or {}, tuple(free))
    search = solve_steady(equations, equations.starts(starts, named_states(system, near or {})))
    (found,) = judge_each((equations,), (search,))
    return found.choose(near or {})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rests:
    """All that one search met.

    Attributes:
        equations: what was solved.
        search: the solutions.
        candidates: trims inside the search range.
        left_out: steady states outside it.
        undecided: why steady states inside the search range make no trims: no lag, derivative or output, or no decided stability.
    """

    equations: SteadyEquations
    search: Search
    candidates: tuple[Trim, ...]
    left_out: tuple[LeftOut, ...]
    undecided: tuple[RevlineError, ...]

    def choose(self, near: Mapping[str, float]) -> Trim:
        """Choose one of the trims, the nearest to some states where they are named; see `find_trim`.

        Raises:
            NoTrimError: there is none.
            InvalidInputError: an equation has no finite derivative or value at a steady state, or a lag is not positive.
            NotConvergedError: the stability of a steady state could not be decided.
        """
        for reason in self.undecided:
            raise reason
        if not self.candidates:
            raise no_trim(self.equations, self.search, self.left_out)
        ordered = _by_preference(self.equations.system, self.candidates, near)
        return replace(ordered[0], alternatives=tuple(ordered[1:]), left_out=self.left_out)


def judge_each(equations: Sequence[SteadyEquations], searches: Sequence[Search]) -> tuple[Rests, ...]:
    """Make trims of what searches found inside the search range, and say what lies outside; all at once.

    Args:
        equations: of each search; all of one system.
        searches: from `solve_steady_each`.

    Returns:
        What was met by each; a steady state that makes no trim concerns its own search alone, see `Rests.choose`.
    """
    places = [(k, unknowns) for k, search in enumerate(searches) for unknowns in search.solutions]
    outside = [find_outside(equations[k], unknowns) for k, unknowns in places]
    wanted = [j for j, entry in enumerate(outside) if not (isinstance(entry, LeftOut) and entry.longest_lag > LONGEST_JUDGED)]
    parts = (wanted[first : first + AT_ONCE] for first in range(0, len(wanted), AT_ONCE))
    built = {
        j: trim
        for part in parts
        for j, trim in zip(part, _build_each([(equations[places[j][0]], places[j][1]) for j in part]), strict=True)
    }
    found: list[tuple[list[Trim], list[LeftOut], list[RevlineError]]] = [([], [], []) for _ in searches]
    for j, (k, _) in enumerate(places):
        entry, trim = outside[j], built.get(j)
        if isinstance(entry, LeftOut):
            found[k][1].append(_judged(entry, trim) if isinstance(trim, Trim) else entry)
        elif isinstance(trim, Trim):
            found[k][0].append(trim)
        elif trim is not None:
            found[k][2].append(trim)
    return tuple(
        Rests(equations=posed, search=search, candidates=tuple(candidates), left_out=tuple(left_out), undecided=tuple(undecided))
        for posed, search, (candidates, left_out, undecided) in zip(equations, searches, found, strict=True)
    )


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


def named_states(system: DelaySystem, near: Mapping[str, float]) -> dict[int, float]:
    """Give values of states by their position."""
    return {index_of(system.states, name): value for name, value in near.items()}


def _judged(entry: LeftOut, trim: Trim) -> LeftOut:
    """Say whether a steady state outside the search range is stable."""
    count = trim.unstable_count
    return replace(entry, stability=f"unstable ({count} roots right of the imaginary axis)" if count else "stable")


def _build_each(places: Sequence[tuple[SteadyEquations, Floats]]) -> list[Trim | RevlineError]:
    """Make a trim of each solution, or the error why it is none."""
    system = places[0][0].system
    split = [equations.split(unknowns) for equations, unknowns in places]
    x, u = (np.array([pair[k] for pair in split]) for k in range(2))
    zd = settle_channels(system, x, u)
    lags = evaluate(system, system.lags, x, u, zd)
    outputs, drift = evaluate(system, system.output, x, u, zd), evaluate(system, system.rate, x, u, zd)
    jacobians = find_jacobians(system, x, u, zd)
    built: list[Trim | RevlineError | DelayStateSpace] = []
    for k in range(len(x)):
        try:
            built.append(build_model(system, jacobians.at(k), lags[k]))
        except RevlineError as error:
            built.append(error)
    roots = iter(characteristic_roots_each([entry for entry in built if isinstance(entry, DelayStateSpace)]))
    return [
        entry if isinstance(entry, RevlineError) else _trim(system, (x[k], u[k], zd[k], outputs[k], lags[k], drift[k]), next(roots))
        for k, entry in enumerate(built)
    ]


def _trim(system: DelaySystem, values: tuple[Floats, ...], roots: RightmostRoots | RevlineError) -> Trim | RevlineError:
    if isinstance(roots, RevlineError):
        return roots
    states, inputs, channels, outputs, lags, drift = values
    try:
        return Trim(
            system=system.name,
            state_variables=system.states,
            input_variables=system.inputs,
            channel_variables=system.channels,
            output_variables=system.outputs,
            states=states,
            inputs=inputs,
            channels=channels,
            outputs=outputs,
            lags=lags,
            drift=drift,
            roots=roots,
        )
    except RevlineError as error:
        return error


def _by_preference(system: DelaySystem, trims: Sequence[Trim], near: Mapping[str, float]) -> list[Trim]:
    wanted = named_states(system, near)
    scales = [search_scale(v) for v in system.states]

    def rank(trim: Trim) -> tuple[float, float, float]:
        distance = sum(abs(trim.states[k] - value) / scales[k] for k, value in wanted.items())
        return distance, trim.unstable_count, -float(trim.outputs[0]) if trim.outputs.size else 0.0

    return sorted(trims, key=rank)
