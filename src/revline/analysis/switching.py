"""Where a system's equations switch: the arguments of every minimum and maximum in them, compared.

Equations are made of smooth functions and of `np.minimum` and `np.maximum`, so that their derivatives jump only where the two arguments
of one of these cross. The difference of the arguments is recorded while an equation is evaluated: no threshold is needed to see a kink.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from revline.system import DelaySystem, Floats

SWITCHES = frozenset({"minimum", "maximum"})
"""The functions whose derivatives jump."""


@dataclass(frozen=True, slots=True, eq=False)
class _Watched(NDArrayOperatorsMixin):
    """An array that tells a list of every comparison that it takes part in."""

    values: Any
    seen: list[Floats] = field(repr=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> "_Watched":
        plain = [item.values if isinstance(item, _Watched) else item for item in inputs]
        if ufunc.__name__ in SWITCHES:
            self.seen.append(np.asarray(plain[0] - plain[1], dtype=float))
        return _Watched(getattr(ufunc, method)(*plain, **options), self.seen)


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
    seen: list[Floats] = []
    with np.errstate(all="ignore"):
        for function in (system.emit, system.lags, system.rate):
            function(system.parameters, *(tuple(_Watched(v[:, k], seen) for k in range(v.shape[1])) for v in (x, u, zd)))
    found = np.empty((x.shape[0], len(seen)))
    for k, values in enumerate(seen):
        found[:, k] = values
    return found
