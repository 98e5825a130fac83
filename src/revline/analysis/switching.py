"""Where a system's equations switch: the arguments of every minimum and maximum in them, compared.

Equations are made of smooth functions and of `np.minimum` and `np.maximum`, so that their derivatives jump only where the two arguments
of one of these cross. The difference of the arguments is recorded while an equation is evaluated: no threshold is needed to see a kink.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from revline.analysis.jacobians import Matrix
from revline.equations import Equation
from revline.system import DelaySystem, Floats

SWITCHES = frozenset({np.minimum, np.maximum})
"""The functions whose derivatives jump."""


class _Watched(NDArrayOperatorsMixin):
    """Values that write down what they are compared with, and remember on which comparisons they depend."""

    def __init__(self, values: Any, log: list[Matrix], switches: frozenset[int] = frozenset()) -> None:
        self.values, self._log, self.switches = values, log, switches

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> "_Watched":
        plain = [item.values if isinstance(item, _Watched) else item for item in inputs]
        switches = frozenset[int]().union(*(item.switches for item in inputs if isinstance(item, _Watched)))
        if ufunc in SWITCHES:
            switches |= {len(self._log)}
            self._log.append(np.asarray(plain[0] - plain[1]))
        return _Watched(getattr(ufunc, method)(*plain, **options), self._log, switches)


def compare(system: DelaySystem, function: Equation, arguments: Sequence[Matrix]) -> tuple[list[Matrix], list[frozenset[int]]]:
    """Evaluate what decides the switches of one of a system's equations.

    Args:
        system: gives the parameters.
        function: its emit, lags, rate or output.
        arguments: states, inputs and channel readings, real or complex, each of shape (n, number of them).

    Returns:
        The first argument less the second of each minimum and maximum, of shape (n,); and for each result those that it depends on.
    """
    log: list[Matrix] = []
    with np.errstate(all="ignore"):
        results = function(system.parameters, *(tuple(_Watched(v[:, k], log) for k in range(v.shape[1])) for v in arguments))
    gaps = [np.broadcast_to(gap, (arguments[0].shape[0],)) for gap in log]
    return gaps, [result.switches if isinstance(result, _Watched) else frozenset() for result in results]


def switching_values(system: DelaySystem, x: Floats, u: Floats, zd: Floats) -> Floats:
    """Evaluate what decides the switches of emit, lags and rate: the first argument less the second of each minimum and maximum.

    Args:
        system: any system.
        x: states, shape (n, n_states).
        u: inputs, shape (n, n_inputs).
        zd: channel readings, shape (n, n_channels).

    Returns:
        Shape (n, n_switches); a switch that cannot happen, its limit being infinite, has infinite values.
    """
    gaps = [gap for function in (system.emit, system.lags, system.rate) for gap in compare(system, function, (x, u, zd))[0]]
    found = np.empty((x.shape[0], len(gaps)))
    for k, values in enumerate(gaps):
        found[:, k] = values
    return found
