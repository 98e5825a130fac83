"""Why there is no trim: steady states outside the search range, and how near a search came."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.jacobians import evaluate
from revline.analysis.linearize import search_scale
from revline.analysis.steady_equations import Search, SteadyEquations, solve_steady_each
from revline.errors import NoTrimError
from revline.system import Floats

MOST_NAMED = 3
"""Steady states outside the search range that a message names; it counts the others."""

SLACK = 1e-12
"""A state this near to an end of its search range, as a part of that, still lies inside."""

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


def find_outside(equations: SteadyEquations, unknowns: Floats) -> LeftOut | tuple[()]:
    """The state that lies outside its search range, or nothing."""
    system = equations.system
    x, u = equations.split(unknowns)
    for variable, value in zip(system.states, x, strict=True):
        slack = SLACK * search_scale(variable)
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


def no_trim(equations: SteadyEquations, search: Search, left_out: Sequence[LeftOut]) -> NoTrimError:
    """Say why a search found no trim.

    Args:
        equations: what holds at rest.
        search: what Newton found.
        left_out: steady states outside the search range.
    """
    request = equations.describe()
    if left_out:
        # At a standstill any free input will do, which gives one and the same state many times.
        distinct = list({(entry.quantity, round(entry.value, 6)): entry for entry in left_out}.values())
        more = (f"and {len(distinct) - MOST_NAMED} more",) if len(distinct) > MOST_NAMED else ()
        found = "; ".join((*(str(entry) for entry in distinct[:MOST_NAMED]), *more))
        return NoTrimError(f"no trim at {request} inside the search range ({found}); change the inputs", request=request)
    if not search.isolated:
        message = f"no trim at {request}: steady states are not isolated, a state is free to rest anywhere; hold it with `outputs`"
        return NoTrimError(message, request=request)
    drift, limit, text = equations.worst(search.closest)
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
    values = np.linspace(swept[0].low, swept[0].high, SWEEP)
    known = np.tile(equations.known, (SWEEP, 1))
    known[:, equations.free[0]] = values
    posed = SteadyEquations(system=system, known=equations.known, free=(), targets=())
    for k, search in enumerate(solve_steady_each(posed, known, [posed.starts(SWEEP_STARTS, {})] * SWEEP)):
        here = replace(posed, known=known[k])
        for unknowns in search.solutions:
            if not find_outside(here, unknowns):
                x, u = here.split(unknowns)
                shown = x if target.is_state else evaluate(system, system.output, x, u, here.channels(unknowns))
                reached.append((abs(float(shown[target.index]) - target.value), float(shown[target.index]), float(values[k])))
    if not reached:
        return ()
    _, nearest, value = min(reached)
    unit = target.variable.unit
    return nearest, f"{target.variable.name} = {nearest:.6g} {unit}, at {swept[0].name} = {value:.4g} {swept[0].unit}"
