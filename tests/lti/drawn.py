"""Random linear systems with several delays, for property tests."""

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

from revline.lti.state_space import DelayStateSpace, Signal
from revline.lti.transfer_function import TransferFunction

HUNDREDTHS = st.integers(-200, 200).map(lambda k: k / 100.0)
"""Numbers from -2 to 2, zero among them often enough."""


@st.composite
def systems(
    draw: st.DrawFn, inputs: int = 1, outputs: int = 1, lags: st.SearchStrategy[float] | None = None, most: int = 2
) -> DelayStateSpace:
    """Random systems, all signals in volts, up to two states and some delays that follow and feed one another."""
    n, m = draw(st.integers(0, 2)), draw(st.integers(0, most))
    entry, lag = HUNDREDTHS, st.floats(0.01, 2.0) if lags is None else lags

    def block(rows: int, columns: int, scale: float = 1.0) -> np.ndarray:
        return scale * np.array([draw(entry) for _ in range(rows * columns)]).reshape(rows, columns)

    return DelayStateSpace(
        A=block(n, n) - 4.0 * np.eye(n), Bu=block(n, inputs), Bz=block(n, m), Cy=block(outputs, n), Dyu=block(outputs, inputs, 0.2),
        Dyz=block(outputs, m), Cz=block(m, n), Dzu=block(m, inputs), Dzz=block(m, m, 0.1), lags=np.array([draw(lag) for _ in range(m)]),
        states=named("x", n), inputs=named("u", inputs), outputs=named("y", outputs), channels=named("z", m),
    )  # fmt: skip


@st.composite
def transfer_functions(draw: st.DrawFn, excess: int = 0, delays: st.SearchStrategy[float] | None = None) -> TransferFunction:
    """Random proper transfer functions with delay, `excess` more poles than zeros at least, poles between 0.2 and 5 rad/s."""
    poles = draw(st.lists(st.floats(0.2, 5.0), min_size=excess, max_size=3))
    denominator: Sequence[float] = [1.0]
    for pole in poles:
        denominator = np.convolve(denominator, [1.0, 1.0 / pole]).tolist()
    numerator = draw(st.lists(st.floats(0.1, 2.0), min_size=1, max_size=len(poles) + 1 - excess))
    delay = draw((st.floats(0.01, 1.0) if delays is None else delays) | st.just(0.0))
    return TransferFunction(
        numerator=tuple(numerator), denominator=tuple(denominator), delay=delay, input_unit="V", output_unit="V"
    )  # fmt: skip


def named(letter: str, count: int) -> tuple[Signal, ...]:
    return tuple(Signal(f"{letter}{k}", "V") for k in range(count))
