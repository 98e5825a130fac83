"""Linear systems with delay channels: state space with every delay exact.

    dx/dt = A x + Bu u + Bz zd
    y     = Cy x + Dyu u + Dyz zd        zd_i(t) = z_i(t - lag_i)
    z     = Cz x + Dzu u + Dzz zd

This is a linear fractional form: a system without memory of its own about the delays, closed by exp(-s lag_i) from z to zd.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.errors import AnalysisError, InvalidInputError, out_of_range
from revline.lti.response import Complexes, Floats, FrequencyResponse, check_frequencies
from revline.values import make_read_only


class Signal(NamedTuple):
    """A named signal of a linear system, with the symbol of its unit."""

    name: str
    unit: str = "1"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DelayStateSpace:
    """A linear system with delay channels; see the module's text for its equations.

    Attributes:
        A, Bu, Bz: rates of the states from states, inputs and channel readings.
        Cy, Dyu, Dyz: outputs from the same.
        Cz, Dzu, Dzz: what enters the channels from the same.
        lags: of each channel, in s.
        states, inputs, outputs, channels: names and units, in the order of the blocks.

    Raises:
        InvalidInputError: a block has the wrong shape or an entry that is not finite, a lag is not positive, or two signals of a kind
            share a name.

    Source:
        The linear fractional form is that of Gumussoy, Eryilmaz and Gahinet (2012), IFAC Proceedings Volumes 45(14), 108-113.
    """

    A: Floats
    Bu: Floats
    Bz: Floats
    Cy: Floats
    Dyu: Floats
    Dyz: Floats
    Cz: Floats
    Dzu: Floats
    Dzz: Floats
    lags: Floats
    states: tuple[Signal, ...]
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    channels: tuple[Signal, ...]

    def __post_init__(self) -> None:
        rows = {"": self.states, "y": self.outputs, "z": self.channels}
        columns = {"x": self.states, "u": self.inputs, "z": self.channels}
        names = (("A", "", "x"), ("Bu", "", "u"), ("Bz", "", "z"), ("Cy", "y", "x"), ("Dyu", "y", "u"), ("Dyz", "y", "z"))
        for name, row, column in (*names, ("Cz", "z", "x"), ("Dzu", "z", "u"), ("Dzz", "z", "z")):
            shape = (len(rows[row]), len(columns[column]))
            object.__setattr__(self, name, _checked_block(name, getattr(self, name), shape))
        object.__setattr__(self, "lags", _checked_lags(self.lags, self.channels))
        for kind in ("states", "inputs", "outputs", "channels"):
            _refuse_twins(kind, getattr(self, kind))
        make_read_only(self)

    def transfer(self, s: ArrayLike) -> Complexes:
        """Evaluate the transfer matrix at complex numbers, delays exact.

        Args:
            s: complex numbers of any shape, in rad/s.

        Returns:
            Array of the shape of `s` with two more axes: outputs, inputs.

        Raises:
            AnalysisError: the system has a pole at one of the numbers.
        """
        return self._transfer(np.asarray(s, dtype=complex), slice(None), slice(None))

    def _transfer(self, points: NDArray[Any], outputs: slice, inputs: slice) -> Complexes:
        """Evaluate some rows and columns of the transfer matrix."""
        characteristic, forcing = self.characteristic(points), self._forcing(points, inputs)
        try:
            inner = np.linalg.solve(characteristic, forcing)
        except np.linalg.LinAlgError as error:
            message = "the transfer function has a pole at a point asked for, an integrator at 0 for example; leave that point out"
            raise AnalysisError(message) from error
        values = self.Dyu[outputs, inputs] + np.concatenate((self.Cy, self.Dyz), axis=1)[outputs] @ inner
        return np.asarray(values, dtype=complex)

    def characteristic(self, s: ArrayLike) -> Complexes:
        """Evaluate the characteristic matrix [[sI - A, -Bz], [-E Cz, I - E Dzz]], E = diag(exp(-s lag_i)); singular at the roots.

        Args:
            s: complex numbers of any shape, in rad/s.

        Returns:
            Array of the shape of `s` with two more axes over states and channel readings.
        """
        points = np.asarray(s, dtype=complex)[..., None, None]
        unknown, readings = len(self.states), len(self.channels)
        decay = np.exp(-points * self.lags[:, None])
        matrix = np.zeros((*points.shape[:-2], unknown + readings, unknown + readings), dtype=complex)
        matrix[..., :unknown, :unknown] = points * np.eye(unknown) - self.A
        matrix[..., :unknown, unknown:] = -self.Bz
        matrix[..., unknown:, :unknown] = -decay * self.Cz
        matrix[..., unknown:, unknown:] = np.eye(readings) - decay * self.Dzz
        return matrix

    def _forcing(self, points: NDArray[Any], inputs: slice) -> Complexes:
        decay = np.exp(-points[..., None, None] * self.lags[:, None])
        direct = np.broadcast_to(self.Bu[:, inputs], (*points.shape, *self.Bu[:, inputs].shape))
        return np.concatenate((direct, decay * self.Dzu[:, inputs]), axis=-2)

    def response(self, omega: ArrayLike, input_name: str, output_name: str) -> FrequencyResponse:
        """Evaluate the exact frequency response from one input to one output.

        Args:
            omega: frequencies in rad/s, strictly rising.
            input_name: which input.
            output_name: which output.

        Returns:
            Response whose method is "exact".

        Raises:
            InvalidInputError: there is no such signal, or the frequencies cannot be used.
            AnalysisError: a pole lies at one of the frequencies.
        """
        column, row = position(self.inputs, input_name), position(self.outputs, output_name)
        frequencies = check_frequencies(omega)
        return FrequencyResponse(
            omega=frequencies,
            values=self._transfer(1j * frequencies, slice(row, row + 1), slice(column, column + 1))[:, 0, 0],
            input_name=input_name,
            input_unit=self.inputs[column].unit,
            output_name=output_name,
            output_unit=self.outputs[row].unit,
            method="exact",
        )

    def static_gain(self, input_name: str, output_name: str) -> float:
        """Evaluate the gain at rest: change of the settled output per change of the input.

        Raises:
            InvalidInputError: there is no such signal.
            AnalysisError: the system integrates, so that it has no gain at rest.
        """
        column, row = position(self.inputs, input_name), position(self.outputs, output_name)
        return float(self.transfer(0.0)[row, column].real)


def position(signals: tuple[Signal, ...], name: str) -> int:
    """Find a signal's position by name.

    Raises:
        InvalidInputError: there is none; the message lists those there are.
    """
    for index, signal in enumerate(signals):
        if signal.name == name:
            return index
    message = f"there is no signal {name}; there are {', '.join(signal.name for signal in signals)}"
    raise InvalidInputError(message, name=name)


def _checked_block(name: str, block: ArrayLike, shape: tuple[int, int]) -> NDArray[np.float64]:
    array = np.array(block, dtype=float)
    if array.size == 0 and 0 in shape:
        array = array.reshape(shape)
    if array.shape != shape:
        message = f"block {name} has shape {array.shape} where the signals ask for {shape}; give it that shape"
        raise InvalidInputError(message)
    if not np.all(np.isfinite(array)):
        row, column = (int(k[0]) for k in np.nonzero(~np.isfinite(array)))
        message = f"block {name} holds {array[row, column]} in row {row}, column {column}; give finite numbers"
        raise InvalidInputError(message)
    return array


def _checked_lags(lags: ArrayLike, channels: tuple[Signal, ...]) -> Floats:
    array = np.array(lags, dtype=float)
    if array.shape != (len(channels),):
        message = f"{array.size} lags for {len(channels)} channels; give one lag for each channel"
        raise InvalidInputError(message)
    for channel, lag in zip(channels, array, strict=True):
        if not (np.isfinite(lag) and lag > 0.0):
            quantity = f"lag of {channel.name}"
            raise out_of_range(quantity, float(lag), "s", "0 to infinity, without the ends", "give a positive lag")
    return array


def _refuse_twins(kind: str, signals: tuple[Signal, ...]) -> None:
    names = [signal.name for signal in signals]
    for name in names:
        if names.count(name) > 1:
            message = f"two {kind} are named {name}; give each its own name"
            raise InvalidInputError(message, name=name)
