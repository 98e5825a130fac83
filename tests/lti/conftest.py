"""A short way to write linear systems with delays."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from revline.lti.state_space import DelayStateSpace, Signal

Build = Callable[..., DelayStateSpace]


@pytest.fixture(scope="session")
def build() -> Build:
    """Build a system from nested lists, with signals named x0, u0, y0, z0 and so on; blocks not given are zero."""

    def make(lags: Sequence[float], **blocks: object) -> DelayStateSpace:
        arrays = {name: np.atleast_2d(np.array(block, dtype=float)) for name, block in blocks.items()}
        sizes = {"z": len(lags)}
        for name, array in arrays.items():
            row = {"A": "x", "B": "x", "C": name[1:], "D": name[1:2]}[name[0]]
            column = {"A": "x", "B": name[1:], "C": "x", "D": name[2:]}[name[0]]
            sizes[row], sizes[column] = array.shape
        n, p, q, m = (sizes.get(kind, 0) for kind in "xuyz")
        shapes = {"A": (n, n), "Bu": (n, p), "Bz": (n, m), "Cy": (q, n), "Dyu": (q, p), "Dyz": (q, m)}
        shapes |= {"Cz": (m, n), "Dzu": (m, p), "Dzz": (m, m)}
        return DelayStateSpace(
            **{name: arrays.get(name, np.zeros(shape)) for name, shape in shapes.items()},
            lags=np.array(lags, dtype=float),
            states=tuple(Signal(f"x{k}", "m") for k in range(n)),
            inputs=tuple(Signal(f"u{k}", "N") for k in range(p)),
            outputs=tuple(Signal(f"y{k}", "V") for k in range(q)),
            channels=tuple(Signal(f"z{k}") for k in range(m)),
        )

    return make
