"""Steady states at many inputs at once: one search for all, and what is found at one input is tried at its neighbours."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from revline.analysis.steady_equations import Search, SteadyEquations, merge_solutions, solve_steady_each
from revline.analysis.trim import Rests, judge_each, pose
from revline.analysis.trim_refusals import SLACK
from revline.system import DelaySystem, Floats

STARTS = 24
"""Points to start from at each input, as many as `find_trim` takes."""


def find_rests_along(system: DelaySystem, inputs: Sequence[Mapping[str, float]]) -> tuple[Rests, ...]:
    """Find all steady states at each of many inputs, in the order in which one follows another.

    At each all starts of `find_trim` are taken, and besides every steady state of the inputs before and after it, until these bring
    nothing new: a branch met anywhere is followed both ways.

    Args:
        system: any system with delay channels.
        inputs: known inputs at each place; the others have their nominal values.

    Returns:
        What was met at each place.

    Raises:
        InvalidInputError: a name is unknown, or a value is out of range.
    """
    equations = [pose(system, each, {}, ()) for each in inputs]
    known = np.array([posed.known for posed in equations])
    starts = equations[0].starts(STARTS, {})
    searches = solve_steady_each(equations[0], known, [starts] * len(equations))
    return judge_each(equations, _followed(equations[0], known, searches))


def follow_each(system: DelaySystem, inputs: Sequence[Mapping[str, float]], starts: Floats) -> list[tuple[bool, Floats]]:
    """Find the steady states that Newton reaches from some states at each of many inputs; nothing is said of others.

    Args:
        system: any system with delay channels.
        inputs: known inputs at each place.
        starts: states to start from, the same at each place.

    Returns:
        For each place whether one of them lies inside the search range, and all of them, one in each row.
    """
    equations = [pose(system, each, {}, ()) for each in inputs]
    searches = solve_steady_each(equations[0], np.array([posed.known for posed in equations]), [starts] * len(equations))
    low, high = np.array([(variable.search_low, variable.search_high) for variable in system.states]).reshape(-1, 2).T
    slack = SLACK * equations[0].scales
    inside = [np.all((search.solutions >= low - slack) & (search.solutions <= high + slack), axis=1) for search in searches]
    return [(bool(np.any(held)), search.solutions) for held, search in zip(inside, searches, strict=True)]


def _followed(equations: SteadyEquations, known: Floats, searches: Sequence[Search]) -> tuple[Search, ...]:
    """Start from the neighbours' solutions too, as long as that brings new ones."""
    found, fresh = list(searches), [search.solutions for search in searches]
    for _ in range(len(found)):
        beside = [np.concatenate(fresh[max(k - 1, 0) : k] + fresh[k + 1 : k + 2] or [fresh[k][:0]]) for k in range(len(found))]
        rows = [k for k, starts in enumerate(beside) if len(starts)]
        if not rows:
            break
        reached = solve_steady_each(equations, known[rows], [beside[k] for k in rows])
        fresh = [search.solutions[:0] for search in found]
        for k, search in zip(rows, reached, strict=True):
            merged = merge_solutions(found[k].solutions, search.solutions, equations.scales)
            fresh[k] = merged[len(found[k].solutions) :]
            found[k] = replace(found[k], solutions=merged, isolated=found[k].isolated and search.isolated)
    return tuple(found)
