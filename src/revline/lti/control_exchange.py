"""To and from python-control, which has no delays: what must become rational says by how much, what need not stays exact.

python-control is an extra: `pip install revline[control]`. It is imported when a function of this module is called.
"""

import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import matrix_balance

from revline.errors import InvalidInputError, out_of_range
from revline.lti.interconnection import append, feed_back, select, to_state_space
from revline.lti.response import Floats, FrequencyResponse, check_frequencies
from revline.lti.roots import axis_widths, characteristic_roots
from revline.lti.state_space import DelayStateSpace, Signal, position
from revline.lti.transfer_function import TransferFunction

HIGHEST_ORDER = 20
"""Approximants of higher order lose in rounding what they gain."""

PER_DECADE, PER_TURN, MOST_FREQUENCIES = 200, 32, 200_000
"""Frequencies at which an approximation is compared, on a decade and on a turn of all lags together, and most of them."""

NO_UNITS: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class PadeConversion:
    """A system of python-control in which each lag is a Pade approximant, and what that changes.

    Attributes:
        system: `control.StateSpace`.
        order: of each lag's approximant, numerator and denominator alike.
        low, high: band over which the two were compared, in rad/s.
        max_relative_error: largest |approximate - exact| / |exact| of any input and output over the band.
        frequency: where, in rad/s.
        input_name, output_name: of which pair.
        unstable_poles: of the approximate system, right of the imaginary axis.
        unstable_roots: characteristic roots of the exact one there; the error over a band does not tell whether these agree.
    """

    system: Any
    order: int
    low: float
    high: float
    max_relative_error: float
    frequency: float
    input_name: str
    output_name: str
    unstable_poles: int
    unstable_roots: int

    @property
    def keeps_stability(self) -> bool:
        """Whether both systems have as many unstable poles."""
        return self.unstable_poles == self.unstable_roots


def to_control(model: DelayStateSpace | TransferFunction, *, order: int, low: float, high: float) -> PadeConversion:
    """Convert to python-control, each lag as a Pade approximant of a stated order, and measure the error over a stated band.

    Args:
        model: any linear system with delays, or a transfer function with delay.
        order: of the approximants, 1 to 20; without lags it changes nothing.
        low: lower end of the band in which the error is measured, in rad/s.
        high: its upper end.

    Returns:
        The system, and the largest relative error over the band.

    Raises:
        InvalidInputError: python-control is not installed, the order or the band cannot be used, the exact model is zero throughout the
            band, the transfer function is not proper, or delays that feed one another make an algebraic loop when they are approximated.
        AnalysisError: a pole lies at a frequency of the band, or the exact model's unstable roots cannot be counted.

    Source:
        Golub and Van Loan (2013), Matrix Computations, section 9.3 (diagonal Pade approximants of the exponential).
    """
    control = _load_control()
    if order not in range(1, HIGHEST_ORDER + 1):
        raise out_of_range("order of the Pade approximant", order, "", f"1 to {HIGHEST_ORDER}", "give a whole number in that range")
    if not 0.0 < low < high < math.inf:
        message = f"a band from {low:g} to {high:g} rad/s cannot be compared over; give two rising frequencies above 0"
        raise InvalidInputError(message, low=low, high=high)
    exact = _as_state_space(model)
    rational = approximate_lags(exact, order)
    poles = np.linalg.eigvals(rational.A).astype(complex)
    error, frequency, row, column = _largest_error(exact, rational, low, high)
    system = control.StateSpace(
        rational.A,
        rational.Bu,
        rational.Cy,
        rational.Dyu,
        0,
        inputs=[signal.name for signal in exact.inputs],
        outputs=[signal.name for signal in exact.outputs],
        states=[signal.name for signal in rational.states] or None,
        remove_useless_states=False,
    )
    return PadeConversion(
        system=system,
        order=order,
        low=low,
        high=high,
        max_relative_error=error,
        frequency=frequency,
        input_name=exact.inputs[column].name,
        output_name=exact.outputs[row].name,
        unstable_poles=int(np.sum(poles.real > axis_widths(poles))),
        unstable_roots=characteristic_roots(exact).unstable_count,
    )


def approximate_lags(system: DelayStateSpace, order: int) -> DelayStateSpace:
    """Put a Pade approximant in the place of each lag; the result has no channels.

    Args:
        system: any.
        order: of the approximants.

    Raises:
        InvalidInputError: delays that feed one another make an algebraic loop without solution when they are approximated.
    """
    n, p, q, m = len(system.states), len(system.inputs), len(system.outputs), len(system.channels)
    core = DelayStateSpace(
        A=system.A,
        Bu=np.hstack((system.Bu, system.Bz)),
        Bz=np.zeros((n, 0)),
        Cy=np.vstack((system.Cy, system.Cz)),
        Dyu=np.block([[system.Dyu, system.Dyz], [system.Dzu, system.Dzz]]),
        Dyz=np.zeros((q + m, 0)),
        Cz=np.zeros((0, n)),
        Dzu=np.zeros((0, p + m)),
        Dzz=np.zeros((0, 0)),
        lags=np.zeros(0),
        states=system.states,
        inputs=(*(_numbered("input", k) for k in range(p)), *(s._replace(name=f"reading_of_{s.name}") for s in system.channels)),
        outputs=(*(_numbered("output", k) for k in range(q)), *system.channels),
        channels=(),
    )
    whole = core
    for channel, lag in zip(system.channels, system.lags, strict=True):
        whole = append(whole, _approximant(channel, float(lag), order))
    gains = np.zeros((len(whole.inputs), len(whole.outputs)))
    for k in range(m):
        gains[p + k, q + m + k] = 1.0
        gains[p + m + k, q + k] = 1.0
    closed = select(feed_back(whole, gains), range(p), range(q))
    return replace(closed, inputs=system.inputs, outputs=system.outputs)


def response_to_control(model: FrequencyResponse | DelayStateSpace | TransferFunction, omega: ArrayLike | None = None) -> Any:
    """Give a frequency response as python-control's FRD, every delay exact.

    Args:
        model: a response, taken at its own frequencies; or a model, evaluated at those given.
        omega: frequencies in rad/s, strictly rising; none for a response.

    Returns:
        `control.FrequencyResponseData`.

    Raises:
        InvalidInputError: python-control is not installed, frequencies are wanting or of no use, or are given for a response.
        AnalysisError: a pole lies at one of the frequencies.
    """
    control = _load_control()
    if isinstance(model, FrequencyResponse) != (omega is None):
        message = "a response has its own frequencies, a model needs some: leave omega out, or give it in rad/s"
        raise InvalidInputError(message)
    if isinstance(model, FrequencyResponse):
        grid, values = model.omega, model.values[:, None, None]
        inputs, outputs = [model.input_name], [model.output_name]
    elif isinstance(model, TransferFunction):
        return response_to_control(model.response(check_frequencies(omega if omega is not None else ())))
    else:
        grid = check_frequencies(omega if omega is not None else ())
        values = model.transfer(1j * grid)
        inputs, outputs = [s.name for s in model.inputs], [s.name for s in model.outputs]
    return control.FrequencyResponseData(np.moveaxis(values, 0, -1), grid, inputs=inputs, outputs=outputs)


def state_space_from_control(model: Any, units: Mapping[str, str] = NO_UNITS) -> DelayStateSpace:
    """Take a continuous model of python-control, of any number of inputs and outputs.

    Args:
        model: `control.StateSpace` or `control.TransferFunction`.
        units: of inputs and outputs by name; "1" for those left out.

    Raises:
        InvalidInputError: python-control is not installed, the model is of another kind, is discrete or of unknown time base, or is not
            proper; the message says how to mend it.
    """
    control = _load_control()
    if not isinstance(model, control.StateSpace | control.TransferFunction):
        message = f"{type(model).__name__} is no StateSpace and no TransferFunction of python-control; convert it to one of them first"
        raise InvalidInputError(message)
    _check_continuous(model)
    inputs, outputs = (tuple(Signal(name, units.get(name, "1")) for name in labels) for labels in (model.input_labels, model.output_labels))
    if isinstance(model, control.TransferFunction):
        return _realise(model, inputs, outputs)
    n, p, q = model.nstates, len(inputs), len(outputs)
    return DelayStateSpace(
        A=model.A,
        Bu=model.B,
        Bz=np.zeros((n, 0)),
        Cy=model.C,
        Dyu=model.D,
        Dyz=np.zeros((q, 0)),
        Cz=np.zeros((0, n)),
        Dzu=np.zeros((0, p)),
        Dzz=np.zeros((0, 0)),
        lags=np.zeros(0),
        states=tuple(Signal(name) for name in model.state_labels),
        inputs=inputs,
        outputs=outputs,
        channels=(),
    )


def response_from_control(
    data: Any, *, input_name: str | None = None, output_name: str | None = None, units: Mapping[str, str] = NO_UNITS
) -> FrequencyResponse:
    """Take one input and output of python-control's FRD.

    Args:
        data: `control.FrequencyResponseData`.
        input_name: which input; not needed where there is one.
        output_name: which output; not needed where there is one.
        units: of inputs and outputs by name; "1" for those left out.

    Raises:
        InvalidInputError: python-control is not installed, the data are of another kind or discrete, a signal is not named or not there,
            or the values cannot be used.
    """
    control = _load_control()
    if not isinstance(data, control.FrequencyResponseData):
        message = f"{type(data).__name__} is no FrequencyResponseData of python-control; convert it with control.frd() first"
        raise InvalidInputError(message)
    if data.dt not in {0, None}:
        _check_continuous(data)
    chosen = []
    for kind, name, labels in (("input", input_name, data.input_labels), ("output", output_name, data.output_labels)):
        if name is None and len(labels) != 1:
            message = f"the data have {len(labels)} {kind}s, {', '.join(labels)}; give {kind}_name"
            raise InvalidInputError(message)
        chosen.append(position(tuple(Signal(label) for label in labels), labels[0] if name is None else name))
    column, row = chosen
    first, second = data.input_labels[column], data.output_labels[row]
    return FrequencyResponse(
        omega=np.array(data.omega),
        values=np.array(data.frdata[row, column]),
        input_name=first,
        input_unit=units.get(first, "1"),
        output_name=second,
        output_unit=units.get(second, "1"),
        method="python-control",
    )


def _as_state_space(model: DelayStateSpace | TransferFunction) -> DelayStateSpace:
    if isinstance(model, TransferFunction):
        return to_state_space(model, input_name=model.input_name, output_name=model.output_name)
    return model


def _numbered(kind: str, k: int) -> Signal:
    """A name that no state, channel or other input has; the true names come back in the end."""
    return Signal(f"{kind} {k}")


def _approximant(channel: Signal, lag: float, order: int) -> DelayStateSpace:
    """Pade approximant of a lag, in companion form for lag 1, balanced, then scaled in time."""
    weights = np.cumprod([1.0, *((order - k) / ((2.0 * order - k) * (k + 1.0)) for k in range(order))])
    signs = (-1.0) ** np.arange(order + 1)
    unit = to_state_space(TransferFunction(numerator=tuple(weights * signs), denominator=tuple(weights)))
    balanced, (scales, _) = matrix_balance(unit.A, permute=False, separate=True)
    return replace(
        unit,
        A=balanced / lag,
        Bu=unit.Bu / scales[:, None] / lag,
        Cy=unit.Cy * scales,
        states=tuple(Signal(f"{channel.name}_pade{k}") for k in range(order)),
        inputs=(channel._replace(name=f"{channel.name}_entering"),),
        outputs=(channel._replace(name=f"{channel.name}_leaving"),),
    )


def _largest_error(exact: DelayStateSpace, rational: DelayStateSpace, low: float, high: float) -> tuple[float, float, int, int]:
    """Largest relative error over a band, where, and of which output and input."""
    turns = (high - low) * float(np.sum(exact.lags)) / (2.0 * math.pi)
    wanted = PER_DECADE * math.log10(high / low) + PER_TURN * turns
    if wanted > MOST_FREQUENCIES:
        message = f"the lags turn {turns:.3g} times between {low:g} and {high:g} rad/s, too often to compare; give a narrower band"
        raise InvalidInputError(message, turns=turns)
    grid = np.union1d(np.geomspace(low, high, 2 + math.ceil(wanted)), np.linspace(low, high, 2 + math.ceil(PER_TURN * turns)))
    for _ in range(2):
        errors = _relative_errors(exact, rational, grid)
        place = int(np.unravel_index(np.argmax(errors), errors.shape)[0])
        grid = np.linspace(grid[max(place - 1, 0)], grid[min(place + 1, grid.size - 1)], 65)
    errors = _relative_errors(exact, rational, grid)
    place, row, column = (int(k) for k in np.unravel_index(np.argmax(errors), errors.shape))
    return float(errors[place, row, column]), float(grid[place]), row, column


def _relative_errors(exact: DelayStateSpace, rational: DelayStateSpace, omega: Floats) -> Floats:
    wanted, found = exact.transfer(1j * omega), rational.transfer(1j * omega)
    size = np.abs(wanted)
    if not np.any(size):
        message = f"the model is zero from {omega[0]:g} to {omega[-1]:g} rad/s, so that no error is relative to it; select what answers"
        raise InvalidInputError(message)
    answering = np.broadcast_to(np.any(size > 0.0, axis=0), size.shape)
    return np.where(answering, np.abs(found - wanted) / np.where(size > 0.0, size, np.finfo(float).tiny), 0.0)


def _realise(model: Any, inputs: tuple[Signal, ...], outputs: tuple[Signal, ...]) -> DelayStateSpace:
    """One observer form for each entry, their inputs joined and their outputs added."""
    parts = []
    for i, numerators in enumerate(model.num_list):
        for j, numerator in enumerate(numerators):
            entry = TransferFunction(numerator=tuple(numerator[::-1]), denominator=tuple(model.den_list[i][j][::-1]))
            parts.append(to_state_space(entry, output_name=f"{outputs[i].name}_by_{inputs[j].name}"))
    whole = parts[0]
    for part in parts[1:]:
        whole = append(whole, part)
    spread, gather = np.tile(np.eye(len(inputs)), (len(outputs), 1)), np.kron(np.eye(len(outputs)), np.ones((1, len(inputs))))
    return replace(
        whole,
        Bu=whole.Bu @ spread,
        Cy=gather @ whole.Cy,
        Dyu=gather @ whole.Dyu @ spread,
        Dyz=gather @ whole.Dyz,
        Dzu=whole.Dzu @ spread,
        inputs=inputs,
        outputs=outputs,
    )


def _check_continuous(model: Any) -> None:
    if model.dt is None and not getattr(model, "nstates", 0) and model.isctime():
        moving = hasattr(model, "den_list") and any(len(den) > 1 for row in model.den_list for den in row)
        if not moving:
            return
    if model.dt is None:
        message = "the model's time base is not given (dt is None); set dt = 0 where it is continuous"
        raise InvalidInputError(message)
    if model.dt != 0:
        kept = "of unknown period" if model.dt is True else f"with a period of {model.dt:g} s"
        message = f"the model is discrete, {kept}, and here all is continuous; convert it to continuous time first"
        raise InvalidInputError(message)


def _load_control() -> ModuleType:
    try:
        return importlib.import_module("control")
    except ImportError as error:
        message = "python-control is not installed; pip install revline[control]"
        raise InvalidInputError(message) from error
