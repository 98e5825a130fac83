"""A transfer function with delay as a system about a trim, its delay a channel and not an approximation.

Realised in observer form: the numerator and denominator are the equations' parameters, so that all models share one kernel.
"""

import math
from typing import NamedTuple

import numpy as np

from revline.analysis.linearize import rate_unit
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]

MOST_POLES = 8


class LinearPlant(NamedTuple):
    """Observer form of a strictly proper transfer function with at most eight poles, about a trim.

    Coefficients belong to descending powers, the denominator's first being one; those beyond the order are zero, and
    the states that they belong to stay zero.
    """

    denominator: tuple[float, ...]
    numerator: tuple[float, ...]
    delay: float
    base_input: float
    base_output: float


@equation
def rates(p: LinearPlant, x: Vector, u: Vector) -> Vector:
    """Rates of the observer form. Source: Kailath (1980), Linear Systems, section 2.1."""
    a, b = p.denominator, p.numerator
    first, drive = x[0], u[0] - p.base_input
    return (
        x[1] - a[0] * first + b[0] * drive,
        x[2] - a[1] * first + b[1] * drive,
        x[3] - a[2] * first + b[2] * drive,
        x[4] - a[3] * first + b[3] * drive,
        x[5] - a[4] * first + b[4] * drive,
        x[6] - a[5] * first + b[5] * drive,
        x[7] - a[6] * first + b[6] * drive,
        0.0 - a[7] * first + b[7] * drive,
    )


@equation
def emit(p: LinearPlant, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The undelayed output and its rate."""
    return 1.0 * x[0], rates(p, x, u)[0]


@equation
def lags(p: LinearPlant, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The delay, for both."""
    return p.delay, p.delay


@equation
def rate(p: LinearPlant, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Rates of the states."""
    return rates(p, x, u)


@equation
def output(p: LinearPlant, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The delayed output and its rate."""
    return p.base_output + zd[0], 1.0 * zd[1]


def linear_plant(model: TransferFunction, *, base_input: float = 0.0, base_output: float = 0.0) -> DelaySystem:
    """Build a transfer function with delay as a system about a trim.

    Args:
        model: strictly proper, with a delay above zero and at most eight poles.
        base_input: input at the trim, in the model's input unit.
        base_output: output at the trim, in the model's output unit.

    Raises:
        InvalidInputError: the model has no delay, is not strictly proper, or has too many poles.
    """
    if model.delay <= 0.0:
        message = f"a model with delay = {model.delay:g} s has no delay to simulate; its closed loop is rational: use its exact response"
        raise InvalidInputError(message, delay=model.delay)
    unit = model.output_unit
    rates_unit = rate_unit(Variable(name="output", unit=unit))
    return DelaySystem(
        name="linear_plant",
        parameters=_observer_form(model, base_input, base_output),
        states=_states(),
        inputs=(Variable(name="input", unit=model.input_unit, description="input of the model", nominal=base_input),),
        channels=(
            Variable(name="output", unit=unit, description="output before the delay"),
            Variable(name="output_rate", unit=rates_unit, description="its rate before the delay"),
        ),
        outputs=(
            Variable(name="output", unit=unit, description="output"),
            Variable(name="output_rate", unit=rates_unit, description="rate of the output"),
        ),
        emit=emit,
        lags=lags,
        rate=rate,
        output=output,
    )


@equation
def _nothing(p: LinearPlant, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Nothing is delayed."""
    return ()


@equation
def _prompt_output(p: LinearPlant, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The output, undelayed."""
    return (p.base_output + x[0],)


def held_plant(model: TransferFunction, *, base_input: float = 0.0, base_output: float = 0.0) -> DelaySystem:
    """Build a transfer function as a system for an input that is held between samples, with its delay or without one.

    Args:
        model: strictly proper, with at most eight poles.
        base_input: input at the trim, in the model's input unit.
        base_output: output at the trim, in the model's output unit.

    Raises:
        InvalidInputError: the model is not strictly proper, or has too many poles.
    """
    if model.delay > 0.0:
        return linear_plant(model, base_input=base_input, base_output=base_output)
    return DelaySystem(
        name="linear_plant",
        parameters=_observer_form(model, base_input, base_output),
        states=_states(),
        inputs=(Variable(name="input", unit=model.input_unit, description="input of the model", nominal=base_input),),
        channels=(),
        outputs=(Variable(name="output", unit=model.output_unit, description="output"),),
        emit=_nothing,
        lags=_nothing,
        rate=rate,
        output=_prompt_output,
    )


def _states() -> tuple[Variable, ...]:
    return tuple(Variable(name=f"x{k}", unit="1", description=f"state {k} of the observer form") for k in range(MOST_POLES))


def _observer_form(model: TransferFunction, base_input: float, base_output: float) -> LinearPlant:
    order = len(model.denominator) - 1
    if len(model.numerator) > order:
        message = f"the model has {len(model.numerator) - 1} zeros and {order} poles; a plant needs more poles than zeros: add a lag"
        raise InvalidInputError(message)
    if order > MOST_POLES:
        message = f"the model has {order} poles, more than the {MOST_POLES} that can be simulated; fit one of lower order"
        raise InvalidInputError(message, poles=order)
    scale = model.denominator[-1]
    falling = [c / scale for c in reversed(model.denominator[:-1])]
    zeros = [0.0] * (order - len(model.numerator)) + [c / scale for c in reversed(model.numerator)]
    pad = (0.0,) * (MOST_POLES - order)
    return LinearPlant((*falling, *pad), (*zeros, *pad), model.delay, base_input, base_output)


def step_limit(model: TransferFunction) -> float:
    """Longest step that a simulation of the model's poles and delay stands, with a margin of ten, in seconds.

    Args:
        model: with or without delay.
    """
    fastest = float(np.max(np.abs(model.poles), initial=0.0))
    return min(0.25 / fastest if fastest > 0.0 else math.inf, model.delay / 4.0 if model.delay > 0.0 else math.inf)
