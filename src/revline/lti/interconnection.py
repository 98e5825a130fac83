"""Linear delay systems put together: side by side, in series, in parallel, fed back, inverted. Every delay stays what it is.

All operations are one: systems stand side by side, inputs are made of outputs by a matrix of gains, u = K y + r, and what is not needed
is left out. The direct feedthrough makes that an algebraic equation, which is solved where it has a solution and refused by name where
it has none.

Source: Zhou, Doyle and Glover (1996), Robust and Optimal Control, section 10.4, with the delays as a further pair of signals.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from revline.errors import InvalidInputError
from revline.lti.batches import invert_each
from revline.lti.response import Floats
from revline.lti.state_space import DelayStateSpace, Signal
from revline.lti.transfer_function import TransferFunction

SINGULAR = 1e-12
"""A loop gain this near 1, relative to its terms, has no solution that rounding could tell."""


def append(first: DelayStateSpace, second: DelayStateSpace) -> DelayStateSpace:
    """Put two systems side by side, unconnected: inputs and outputs of the first, then of the second.

    A name of the second that the first has already gets a number.
    """
    return DelayStateSpace(
        A=_diagonal(first.A, second.A),
        Bu=_diagonal(first.Bu, second.Bu),
        Bz=_diagonal(first.Bz, second.Bz),
        Cy=_diagonal(first.Cy, second.Cy),
        Dyu=_diagonal(first.Dyu, second.Dyu),
        Dyz=_diagonal(first.Dyz, second.Dyz),
        Cz=_diagonal(first.Cz, second.Cz),
        Dzu=_diagonal(first.Dzu, second.Dzu),
        Dzz=_diagonal(first.Dzz, second.Dzz),
        lags=np.concatenate((first.lags, second.lags)),
        states=_joined(first.states, second.states),
        inputs=_joined(first.inputs, second.inputs),
        outputs=_joined(first.outputs, second.outputs),
        channels=_joined(first.channels, second.channels),
    )


def feed_back(system: DelayStateSpace, gains: ArrayLike) -> DelayStateSpace:
    """Make a system's inputs of its outputs: u = gains y + r, with the same names for r as for u.

    Args:
        system: any.
        gains: in input units per output unit, shape (n_inputs, n_outputs).

    Raises:
        InvalidInputError: the gains have another shape, or close an algebraic loop without a solution; the signals are named.
    """
    K = np.asarray(gains, dtype=float)
    shape = (len(system.inputs), len(system.outputs))
    if K.shape != shape or not np.all(np.isfinite(K)):
        message = f"gains of shape {K.shape} where {shape[0]} inputs are made of {shape[1]} outputs; give finite gains of shape {shape}"
        raise InvalidInputError(message)
    # u = K (Cy x + Dyu u + Dyz zd) + r
    solve = _invert(np.eye(shape[0]) - K @ system.Dyu, system, K)
    from_states, from_readings = solve @ K @ system.Cy, solve @ K @ system.Dyz
    return replace(
        system,
        A=system.A + system.Bu @ from_states,
        Bz=system.Bz + system.Bu @ from_readings,
        Bu=system.Bu @ solve,
        Cy=system.Cy + system.Dyu @ from_states,
        Dyz=system.Dyz + system.Dyu @ from_readings,
        Dyu=system.Dyu @ solve,
        Cz=system.Cz + system.Dzu @ from_states,
        Dzz=system.Dzz + system.Dzu @ from_readings,
        Dzu=system.Dzu @ solve,
    )


def select(system: DelayStateSpace, inputs: Sequence[int], outputs: Sequence[int]) -> DelayStateSpace:
    """Keep some inputs, the others being zero, and some outputs, by their positions."""
    return replace(
        system,
        Bu=system.Bu[:, inputs],
        Dzu=system.Dzu[:, inputs],
        Dyu=system.Dyu[np.ix_(outputs, inputs)],
        Cy=system.Cy[outputs],
        Dyz=system.Dyz[outputs],
        inputs=tuple(system.inputs[k] for k in inputs),
        outputs=tuple(system.outputs[k] for k in outputs),
    )


def series(first: DelayStateSpace, second: DelayStateSpace) -> DelayStateSpace:
    """Let the first system's outputs drive the second's inputs, in their order.

    Raises:
        InvalidInputError: their numbers or units differ.
    """
    _check_match(first.outputs, second.inputs, "outputs of the first", "inputs of the second")
    both = append(first, second)
    p, q = len(first.inputs), len(first.outputs)
    gains = np.zeros((len(both.inputs), len(both.outputs)))
    gains[p:, :q] = np.eye(q)
    closed = select(feed_back(both, gains), range(p), range(q, len(both.outputs)))
    return replace(closed, outputs=second.outputs)


def parallel(first: DelayStateSpace, second: DelayStateSpace) -> DelayStateSpace:
    """Drive two systems by the same inputs and add their outputs.

    Raises:
        InvalidInputError: numbers or units of inputs or outputs differ.
    """
    _check_match(first.inputs, second.inputs, "inputs of the first", "inputs of the second")
    _check_match(first.outputs, second.outputs, "outputs of the first", "outputs of the second")
    both = append(first, second)
    p, q = len(first.inputs), len(first.outputs)
    return replace(
        both,
        Bu=both.Bu[:, :p] + both.Bu[:, p:],
        Dzu=both.Dzu[:, :p] + both.Dzu[:, p:],
        Cy=both.Cy[:q] + both.Cy[q:],
        Dyz=both.Dyz[:q] + both.Dyz[q:],
        Dyu=first.Dyu + second.Dyu,
        inputs=first.inputs,
        outputs=first.outputs,
    )


def feedback(forward: DelayStateSpace, backward: DelayStateSpace, *, sign: float = -1.0) -> DelayStateSpace:
    """Close a loop: the forward system is driven by the command plus `sign` times what the backward one makes of its outputs.

    Args:
        forward: from command to output.
        backward: from the forward system's outputs to its inputs.
        sign: -1 for negative feedback.

    Raises:
        InvalidInputError: numbers or units of signals differ, or the loop is algebraic and has no solution.
    """
    _check_match(forward.outputs, backward.inputs, "outputs of the forward system", "inputs of the backward system")
    _check_match(backward.outputs, forward.inputs, "outputs of the backward system", "inputs of the forward system")
    both = append(forward, backward)
    p, q = len(forward.inputs), len(forward.outputs)
    gains = np.zeros((len(both.inputs), len(both.outputs)))
    gains[:p, q:] = sign * np.eye(p)
    gains[p:, :q] = np.eye(q)
    return select(feed_back(both, gains), range(p), range(q))


def inverse(system: DelayStateSpace) -> DelayStateSpace:
    """Swap inputs and outputs: the system that tells what input gives an output.

    Raises:
        InvalidInputError: there are not as many inputs as outputs, or the output does not answer the input at once: what would have to
            be known ahead, or differentiated, has no inverse of this form.
    """
    if len(system.inputs) != len(system.outputs):
        message = f"{len(system.inputs)} inputs and {len(system.outputs)} outputs have no inverse; select as many of each"
        raise InvalidInputError(message)
    size = np.linalg.svd(system.Dyu, compute_uv=False)
    if size.size == 0 or size[-1] <= SINGULAR * max(size[0], 1e-300):
        names = ", ".join(signal.name for signal in system.outputs)
        message = f"{names} answers its input late or not at all, so that there is no causal inverse; add a direct feedthrough"
        raise InvalidInputError(message)
    through = invert_each(system.Dyu)
    return replace(
        system,
        A=system.A - system.Bu @ through @ system.Cy,
        Bz=system.Bz - system.Bu @ through @ system.Dyz,
        Bu=system.Bu @ through,
        Cy=-through @ system.Cy,
        Dyz=-through @ system.Dyz,
        Dyu=through,
        Cz=system.Cz - system.Dzu @ through @ system.Cy,
        Dzz=system.Dzz - system.Dzu @ through @ system.Dyz,
        Dzu=system.Dzu @ through,
        inputs=system.outputs,
        outputs=system.inputs,
    )


def to_state_space(model: TransferFunction, *, input_name: str = "input", output_name: str = "output") -> DelayStateSpace:
    """Realise a transfer function with delay in observer form, its delay a channel at the output.

    Args:
        model: proper.
        input_name: name of the input.
        output_name: name of the output.

    Raises:
        InvalidInputError: the model has more zeros than poles.

    Source:
        Kailath (1980), Linear Systems, section 2.1.
    """
    order = len(model.denominator) - 1
    if len(model.numerator) - 1 > order:
        message = f"{len(model.numerator) - 1} zeros and {order} poles make no state space; add a lag, such as a derivative's filter"
        raise InvalidInputError(message)
    scale = model.denominator[-1]
    a = np.array(model.denominator[:-1][::-1]) / scale
    b = np.array([0.0] * (order + 1 - len(model.numerator)) + list(model.numerator[::-1])) / scale
    through = b[0]
    A = np.zeros((order, order))
    A[:, :1] = -a[:, None]
    A[:-1, 1:] += np.eye(max(order - 1, 0))
    B, C, D = (b[1:] - a * through)[:, None], np.eye(1, order), np.array([[through]])
    late = model.delay > 0.0
    none, rows = np.zeros((1, 1 if late else 0)), 1 if late else 0
    return DelayStateSpace(
        A=A,
        Bu=B,
        Bz=np.zeros((order, rows)),
        Cy=np.zeros((1, order)) if late else C,
        Dyu=np.zeros((1, 1)) if late else D,
        Dyz=np.ones((1, 1)) if late else none,
        Cz=C if late else np.zeros((0, order)),
        Dzu=D if late else np.zeros((0, 1)),
        Dzz=np.zeros((rows, rows)),
        lags=np.array([model.delay] if late else []),
        states=tuple(Signal(f"{output_name}_state{k}") for k in range(order)),
        inputs=(Signal(input_name, model.input_unit),),
        outputs=(Signal(output_name, model.output_unit),),
        channels=(Signal(f"{output_name}_undelayed", model.output_unit),) if late else (),
    )


def _diagonal(upper: Floats, lower: Floats) -> Floats:
    joined: Floats = np.zeros((upper.shape[0] + lower.shape[0], upper.shape[1] + lower.shape[1]))
    joined[: upper.shape[0], : upper.shape[1]] = upper
    joined[upper.shape[0] :, upper.shape[1] :] = lower
    return joined


def _joined(first: tuple[Signal, ...], second: tuple[Signal, ...]) -> tuple[Signal, ...]:
    taken = {signal.name for signal in first}
    joined = list(first)
    for signal in second:
        name, number = signal.name, 2
        while name in taken:
            name, number = f"{signal.name}_{number}", number + 1
        taken.add(name)
        joined.append(signal._replace(name=name))
    return tuple(joined)


def _invert(matrix: Floats, system: DelayStateSpace, gains: Floats) -> Floats:
    """Solve the algebraic loop, or name the signals along it."""
    size = np.linalg.svd(matrix, compute_uv=False)
    if size.size and size[-1] <= SINGULAR * max(1.0, size[0]):
        through = np.abs(gains) @ np.abs(system.Dyu)
        row = int(np.argmax(np.sum(through, axis=1)))
        column = int(np.argmax(np.abs(gains[row])))
        message = (
            f"the algebraic loop from {system.outputs[column].name} to {system.inputs[row].name} has no solution: its gain is 1 without "
            "any lag between; put a lag into it, or change the gain"
        )
        raise InvalidInputError(message, input=system.inputs[row].name, output=system.outputs[column].name)
    inverted: Floats = invert_each(matrix)
    return inverted


def _check_match(given: tuple[Signal, ...], wanted: tuple[Signal, ...], whose: str, other: str) -> None:
    if len(given) != len(wanted):
        message = f"{len(given)} {whose} meet {len(wanted)} {other}; select as many of each"
        raise InvalidInputError(message)
    for one, two in zip(given, wanted, strict=True):
        if one.unit != two.unit:
            message = f"{one.name} in {one.unit} meets {two.name} in {two.unit} ({whose}, {other}); convert one of them"
            raise InvalidInputError(message, first=one.unit, second=two.unit)
