"""Jacobians against CasADi, which differentiates the same equations as a symbolic graph; and how lags enter a linearisation."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from revline.analysis.jacobians import differentiate
from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim, find_trim
from revline.engine.catalogue import ENGINES
from revline.system import DelaySystem

casadi: Any = importlib.import_module("casadi")
"""Its own annotations are not those of what it takes."""

POINTS = [
    ("lee1995", 8.0, 0.0),
    ("lee1995", 25.0, 0.0),
    ("lee1995", 25.0, 40.0),
    ("lee1995", 60.0, 60.0),
    ("lee1995-generic", 15.0, 0.0),
    ("lee1995-generic", 40.0, 50.0),
]


class Graph(np.lib.mixins.NDArrayOperatorsMixin):
    """A scalar of CasADi behind numpy's functions: what a ufunc does to it becomes a node of the graph.

    CasADi's own scalars answer numpy by numerical conversion or with arrays, by version; this forwards each function by name.
    """

    def __init__(self, node: Any) -> None:
        self.node = node

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **_: object) -> "Graph":
        assert method == "__call__"
        nodes = [item.node if isinstance(item, Graph) else item for item in inputs]
        return Graph(FUNCTIONS[ufunc.__name__](*nodes))


FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b, "subtract": lambda a, b: a - b, "multiply": lambda a, b: a * b, "divide": lambda a, b: a / b,
    "negative": lambda a: -a, "positive": lambda a: a, "power": casadi.power, "square": lambda a: a * a, "sqrt": casadi.sqrt,
    "exp": casadi.exp, "log": casadi.log, "sin": casadi.sin, "cos": casadi.cos, "tan": casadi.tan, "minimum": casadi.fmin,
    "maximum": casadi.fmax,
}  # fmt: skip


def symbols(name: str, count: int) -> list[Any]:
    return [casadi.SX.sym(f"{name}{k}") for k in range(count)]


def column(results: Sequence[object]) -> Any:
    return casadi.vertcat(*(r.node if isinstance(r, Graph) else r for r in results))


def traced(system: DelaySystem, function: Any, arguments: Sequence[list[Any]]) -> Any:
    """The equation as a column of symbols."""
    return column(function(system.parameters, *(tuple(Graph(s) for s in group) for group in arguments)))


def derivatives(system: DelaySystem, trim: Trim) -> dict[str, np.ndarray]:
    """All blocks by CasADi."""
    groups = [symbols(n, c) for n, c in (("x", len(system.states)), ("u", len(system.inputs)), ("z", len(system.channels)))]
    every = [s for group in groups for s in group]
    names = (("A", "Bu", "Bz"), ("Cy", "Dyu", "Dyz"), ("Cz", "Dzu", "Dzz"))
    values = np.concatenate((trim.states, trim.inputs, trim.channels))
    found = {}
    for function, row in zip((system.rate, system.output, system.emit), names, strict=True):
        expression = traced(system, function, groups)
        for name, group in zip(row, groups, strict=True):
            jacobian = casadi.jacobian(expression, casadi.vertcat(*group))
            found[name] = np.array(casadi.Function("j", every, [jacobian])(*values)).reshape(expression.shape[0], len(group))
    return found


def at(name: str, angle: float, load: float) -> tuple[DelaySystem, Trim]:
    system = next(entry for entry in ENGINES if entry.name == name).build()
    return system, find_trim(system, inputs={"throttle": angle, "load_torque": load})


@pytest.mark.parametrize(("name", "angle", "load"), POINTS)
def test_every_block_agrees_with_casadi(name: str, angle: float, load: float) -> None:
    system, trim = at(name, angle, load)
    model = linearize(system, trim).model
    for block, other in derivatives(system, trim).items():
        own = getattr(model, block)
        assert np.max(np.abs(own - other), initial=0.0) <= 1e-12 * np.max(np.abs(other), initial=0.0), block
    assert np.any(model.Bz != 0.0)


def along_histories(system: DelaySystem, trim: Trim, drift: np.ndarray, *, moving_lags: bool) -> np.ndarray:
    """How the rates answer the present states by way of the lags alone, channels carrying histories z + drift t.

    Every reading is zd_i(t) = z_i + drift_i (t - lag_i(x)); by CasADi, d rate / d zd . d zd / d lag . d lag / d x.
    """
    groups = [symbols(n, c) for n, c in (("x", len(system.states)), ("u", len(system.inputs)), ("z", len(system.channels)))]
    x, u, z = groups
    lags = traced(system, system.lags, groups)
    read = [trim.channels[k] - drift[k] * (lags[k] if moving_lags else float(trim.lags[k])) for k in range(len(z))]
    rates = traced(system, system.rate, (x, u, read))
    held = casadi.substitute(rates, casadi.vertcat(*z), casadi.DM(trim.channels)) if z else rates
    slope = casadi.jacobian(held, casadi.vertcat(*x))
    return np.array(casadi.Function("s", [*x, *u], [slope])(*trim.states, *trim.inputs))


def test_lags_contribute_by_their_value_at_rest_and_by_their_slope_elsewhere() -> None:
    """What a channel carries is constant at rest: moving the lag changes nothing. Where it drifts, d lag/dx . dz/dt appears."""
    system, trim = at("lee1995", 25.0, 0.0)
    model = linearize(system, trim).model
    rest = np.zeros(len(system.channels))
    drift = 0.3 * trim.channels
    assert along_histories(system, trim, rest, moving_lags=True) == pytest.approx(model.A, rel=1e-12, abs=1e-12)
    fixed, moving = (along_histories(system, trim, drift, moving_lags=flag) for flag in (False, True))
    lag_slope = differentiate(system, system.lags, trim.states, trim.inputs, trim.channels)[0]
    foretold = -(model.Bz * drift) @ lag_slope
    assert moving - fixed == pytest.approx(foretold, rel=0.03, abs=1e-12)
    assert np.max(np.abs(foretold)) > 0.01 * abs(model.A[1, 1])
