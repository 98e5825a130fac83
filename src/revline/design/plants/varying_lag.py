"""A rational model whose transport delay is an angle over the speed that it itself predicts: a delay that varies with the state.

The fast part of the model stands before the delay and its slowest pole after it, as torque is made before an engine's delay and moves
its inertia after it. Source: Lee (1995), who recommends a delay that varies with speed.
"""

import math
from typing import NamedTuple

import numpy as np

from revline.equations import equation
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]

MOST_POLES = 4


class VaryingLagModel(NamedTuple):
    """Fast part in observer form with direct term, delay angle, and slowest pole; of a model about a trim.

    Coefficients belong to descending powers. States beyond the order are driven by nothing and die out at `spare`.
    """

    denominator: tuple[float, ...]
    numerator: tuple[float, ...]
    spare: tuple[float, ...]
    direct: float
    slowest: float
    angle: float
    base_input: float
    base_output: float


@equation
def emit(p: VaryingLagModel, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """What the fast part gives."""
    return (x[1] + p.direct * (u[0] - p.base_input),)


@equation
def lags(p: VaryingLagModel, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The delay: an angle over the output."""
    return (p.angle / (p.base_output + x[0]),)


@equation
def rate(p: VaryingLagModel, x: Vector, u: Vector, zd: Vector) -> Vector:
    """The slowest pole, and the fast part's observer form. Source: Kailath (1980), Linear Systems, section 2.1."""
    a, b, d = p.denominator, p.numerator, p.spare
    drive = u[0] - p.base_input
    return (
        zd[0] - p.slowest * x[0],
        x[2] - a[0] * x[1] + b[0] * drive - d[0] * x[1],
        x[3] - a[1] * x[1] + b[1] * drive - d[1] * x[2],
        0.0 - a[2] * x[1] + b[2] * drive - d[2] * x[3],
    )


@equation
def output(p: VaryingLagModel, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """The output, which is a state."""
    return (p.base_output + x[0],)


def varying_lag_model(model: TransferFunction, *, angle: float, base_input: float, base_output: float) -> DelaySystem:
    """Build a model whose delay is an angle over its output, from the rational part of a transfer function.

    Its small-signal response about the trim is that of the rational part with the fixed delay angle / base_output.

    Args:
        model: strictly proper and stable, its slowest pole real, with at most four poles; its delay is not used.
        angle: delay times output, in rad where the output is a speed in rad/s.
        base_input: input at the trim, in the model's input unit.
        base_output: output at the trim, in the model's output unit; above 0. A simulation that reaches output 0 is stopped.

    Raises:
        InvalidInputError: the angle or the output at the trim is not positive and finite, or the model is of another kind.
    """
    for what, value, unit in (("angle", angle, "rad"), ("base_output", base_output, model.output_unit)):
        if not (math.isfinite(value) and value > 0.0):
            message = f"{what} = {value:g} {unit} makes no delay angle / base_output above 0; give a positive number"
            raise InvalidInputError(message, quantity=what, value=value)
    parameters = _realise(model, angle, base_input, base_output)
    unit = model.output_unit
    return DelaySystem(
        name="varying_lag_model",
        parameters=parameters,
        states=(
            Variable(name="deviation", unit=unit, description="output less that at the trim", low=-base_output),
            *(Variable(name=f"x{k}", unit="1", description=f"state {k} of the fast part") for k in range(1, MOST_POLES)),
        ),
        inputs=(Variable(name="input", unit=model.input_unit, description="input of the model", nominal=base_input),),
        channels=(Variable(name="drive", unit=f"{unit}/s", description="what moves the output, before the delay"),),
        outputs=(Variable(name="output", unit=unit, description="output"),),
        emit=emit,
        lags=lags,
        rate=rate,
        output=output,
    )


def _realise(model: TransferFunction, angle: float, base_input: float, base_output: float) -> VaryingLagModel:
    poles = np.asarray(model.poles)
    order = poles.size
    if not 1 <= order <= MOST_POLES or len(model.numerator) > order:
        message = (
            f"the model has {len(model.numerator) - 1} zeros and {order} poles; a varying lag needs 1 to {MOST_POLES} poles"
            " and fewer zeros: fit such a model"
        )
        raise InvalidInputError(message, poles=order)
    position = int(np.argmax(poles.real))
    slowest = poles[position]
    if slowest.real >= 0.0 or abs(slowest.imag) > 1e-9 * abs(slowest):
        message = f"the model's slowest pole is {slowest:.4g} rad/s; a varying lag needs it real and stable: fit another order"
        raise InvalidInputError(message, pole=str(slowest))
    fast = order - 1
    falling = np.atleast_1d(np.real(np.poly(np.delete(poles, position))))[1:]
    zeros = np.zeros(order)
    zeros[order - len(model.numerator) :] = np.asarray(model.numerator)[::-1] / model.denominator[-1]
    direct = float(zeros[0])
    spare = MOST_POLES - 1 - fast
    return VaryingLagModel(
        denominator=(*falling.tolist(), *(0.0,) * spare),
        numerator=(*(zeros[1:] - direct * falling).tolist(), *(0.0,) * spare),
        spare=(*(0.0,) * fast, *(1.0,) * spare),
        direct=direct,
        slowest=-float(slowest.real),
        angle=angle,
        base_input=base_input,
        base_output=base_output,
    )
