"""The one abstraction: a system with delay channels.

    z = emit(p, x, u, zd)            what enters the delay channels
    lag_i = lags(p, x, u, zd)        how old each channel's reading is
    dx/dt = rate(p, x, u, zd)        zd_i(t) = z_i(t - lag_i(t))
    y = output(p, x, u, zd)

Engines, controllers and linear models take this form; `revline.connection` makes one system of two. All methods work on it
and know nothing of engines.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from revline.equations import Equation, equation_digest, trace
from revline.errors import InvalidInputError
from revline.values import fingerprint

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A named quantity of a system: a state, input, channel or output.

    Attributes:
        name: lower case with underscores, for example "engine_speed".
        unit: symbol of the unit of its source, for example "rad/s".
        description: a few words for people.
        low: below it the model means nothing; a simulation that gets there is stopped.
        high: above it the model means nothing.
        search_low: lower end of the range in which steady states are sought.
        search_high: upper end of that range.
        nominal: value that an input has where none is given.
    """

    name: str
    unit: str
    description: str = ""
    low: float = -math.inf
    high: float = math.inf
    search_low: float = -math.inf
    search_high: float = math.inf
    nominal: float = 0.0

    def renamed(self, name: str) -> "Variable":
        """Give the same quantity another name."""
        return replace(self, name=name)


@dataclass(frozen=True, slots=True)
class Structure:
    """What each equation's results depend on: names such as "x0", "u1", "zd0", found by tracing."""

    emit: tuple[frozenset[str], ...]
    lags: tuple[frozenset[str], ...]
    rate: tuple[frozenset[str], ...]
    output: tuple[frozenset[str], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class DelaySystem:
    """A system with delay channels: four equations, their parameters, and the names and units of all signals.

    Attributes:
        name: for people and files.
        parameters: NamedTuple of floats, or of such; the first argument of every equation.
        states, inputs, channels, outputs: the signals, in the order of the equations' tuples.
        emit, lags, rate, output: see the module's text. `lags` may read an earlier channel's reading only.

    Raises:
        InvalidInputError: an equation branches on a value, calls a function without derivative, returns the wrong number of results,
            a lag depends on its own or a later channel's reading, or two signals of a kind bear one name.
    """

    name: str
    parameters: Any
    states: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    channels: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    emit: Equation
    lags: Equation
    rate: Equation
    output: Equation

    def __post_init__(self) -> None:
        for what in ("states", "inputs", "channels", "outputs"):
            names = [variable.name for variable in getattr(self, what)]
            for name in names:
                if names.count(name) > 1:
                    message = f"{self.name}: {names.count(name)} {what} are named {name}; give each its own name"
                    raise InvalidInputError(message)
        structure = self.structure
        for what, count, wanted in (
            ("emit", len(structure.emit), len(self.channels)),
            ("lags", len(structure.lags), len(self.channels)),
            ("rate", len(structure.rate), len(self.states)),
            ("output", len(structure.output), len(self.outputs)),
        ):
            if count != wanted:
                message = f"{self.name}: {what} returns {count} results where {wanted} signals are named"
                raise InvalidInputError(message)
        for k, sources in enumerate(structure.lags):
            later = {f"zd{j}" for j in range(k, len(self.channels))}
            if sources & later:
                channel = self.channels[k].name
                message = f"{self.name}: the lag of channel {channel} depends on its own or a later channel's reading; order the channels"
                raise InvalidInputError(message)

    @functools.cached_property
    def structure(self) -> Structure:
        """What depends on what."""
        sizes = (("x", len(self.states)), ("u", len(self.inputs)), ("zd", len(self.channels)))
        return Structure(*(trace(f, self.parameters, *sizes) for f in (self.emit, self.lags, self.rate, self.output)))

    @functools.cached_property
    def equation_digest(self) -> str:
        """Digest of the equations' code, with all that they reach; parameters are not in it."""
        return equation_digest(self.emit, self.lags, self.rate, self.output)

    @functools.cached_property
    def content_digest(self) -> str:
        """Digest of equations, parameters and signals: equal for systems that behave alike."""
        return fingerprint(
            self.equation_digest,
            tuple(self.parameters),
            type(self.parameters).__name__,
            self.states,
            self.inputs,
            self.channels,
            self.outputs,
        )

    def with_parameters(self, parameters: object) -> "DelaySystem":
        """Make the same system with other parameters of the same type; a model's own checks of their values are not made again.

        Raises:
            InvalidInputError: the parameters are of another type.
        """
        if type(parameters) is not type(self.parameters):
            message = f"{self.name} has {type(self.parameters).__name__}, not {type(parameters).__name__}, for parameters; give those"
            raise InvalidInputError(message)
        return replace(self, parameters=parameters)

    def input_vector(self, values: Mapping[str, float] | None = None) -> Floats:
        """Give all inputs their nominal values but those named.

        Raises:
            InvalidInputError: a name is no input, or a value lies outside the input's range or is not finite.
        """
        given = dict(values or {})
        vector = np.array([given.pop(v.name, v.nominal) for v in self.inputs], dtype=float)
        if given:
            message = f"{self.name} has no input {', '.join(sorted(given))}; its inputs are {', '.join(v.name for v in self.inputs)}"
            raise InvalidInputError(message)
        for variable, value in zip(self.inputs, vector, strict=True):
            check_range(variable, float(value))
        return vector


class Plant(Protocol):
    """What can be experimented with but not looked into: an FMU, a test bench, a measurement."""

    def simulate(self, times: Floats, inputs: Floats) -> Floats:
        """Answer an input: times of shape (n,), inputs (n, n_inputs) to outputs (n, n_outputs)."""


def check_range(variable: Variable, value: float) -> None:
    """Refuse a value outside a variable's range.

    Raises:
        InvalidInputError: the value is not finite or outside `low` to `high`.
    """
    if not (math.isfinite(value) and variable.low <= value <= variable.high):
        unit = "" if variable.unit == "1" else f" {variable.unit}"
        limit = f"{variable.low:g} to {variable.high:g}{unit}"
        message = f"{variable.name} = {value:g}{unit} is outside {limit}; give a value in that range"
        raise InvalidInputError(message, quantity=variable.name, value=value, limit=limit)


def index_of(variables: Sequence[Variable], name: str) -> int:
    """Find a variable's position by name.

    Raises:
        InvalidInputError: there is none; the message lists those there are.
    """
    for position, variable in enumerate(variables):
        if variable.name == name:
            return position
    message = f"there is no signal {name}; there are {', '.join(v.name for v in variables)}"
    raise InvalidInputError(message, name=name)
