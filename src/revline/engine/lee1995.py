"""The engine of Lee (1995) in its two-state form: manifold pressure and engine speed, fuel held at a ratio, no EGR.

Source: Lee (1995), chapter 2. The four-state form with EGR and fuel film adds states and leaves these parts as they are.
"""

import math
from enum import Enum
from typing import NamedTuple

import numpy as np

from revline.engine import air, torque
from revline.equations import Equation, equation
from revline.errors import InvalidInputError, out_of_range
from revline.system import DelaySystem, Variable
from revline.units import unit_of


class EfficiencyModel(Enum):
    """Which relation gives the volumetric efficiency."""

    THESIS = "thesis"
    GENERIC = "generic"


class EngineParameters(NamedTuple):
    """All parameters of the engine, by part. Source: Lee (1995)."""

    throttle: air.Throttle
    manifold: air.Manifold
    efficiency: air.ThesisEfficiency | air.GenericEfficiency
    cylinders: air.Cylinders
    mixture: torque.Mixture
    spark: torque.Spark
    delays: torque.Delays
    combustion: torque.Combustion
    friction: torque.Friction
    rotation: torque.Rotation


THESIS_EFFICIENCY = air.ThesisEfficiency(24.5, -3.1e4, -0.167, 222.0, 8.1e-4, 0.352)
GENERIC_EFFICIENCY = air.GenericEfficiency(0.81, 1.51e-4, 50.0, 362.25, -2e-6, 1.6e-3)

LEE_1995 = EngineParameters(
    throttle=air.Throttle(
        max_flow=0.1843, angle_slope=1.14459, angle_offset=-1.06, saturation_angle=79.46, pressure_exponent=9.0, ambient_pressure=100.0
    ),
    manifold=air.Manifold(volume=0.0027, temperature=310.0, gas_constant=8.31434 / 28.84),
    efficiency=THESIS_EFFICIENCY,
    cylinders=air.Cylinders(pumping=0.112),
    mixture=torque.Mixture(angle_per_ratio=7.3834, best_ratio=13.5),
    spark=torque.Spark(best_torque_angle=10.0, exponent=2.875),
    delays=torque.Delays(intake_to_torque=5.48, spark_to_torque=1.30),
    combustion=torque.Combustion(torque_constant=498636.0),
    friction=torque.Friction(constant=15.1, viscous=0.1056),
    rotation=torque.Rotation(inertia=0.1454),
)
"""Parameters of the thesis's engine. Source: Lee (1995), the vector of 24 numbers; the gas constant is 8.31434/28.84."""

STATES = (
    Variable(name="manifold_pressure", unit="kPa", description="intake manifold pressure", low=0.0, search_low=1.0, search_high=100.0),
    Variable(name="engine_speed", unit="rad/s", description="engine speed", low=0.0, search_low=10.0, search_high=1500.0),
)
INPUTS = (
    Variable(name="throttle", unit="deg", description="throttle angle", low=0.0, high=90.0, nominal=25.0),
    Variable(name="air_fuel_ratio", unit="1", description="air/fuel ratio", low=1.0, high=100.0, nominal=15.0),
    Variable(name="spark", unit="deg", description="spark advance relative to that of best torque", low=-90.0, high=90.0, nominal=10.0),
    Variable(name="load_torque", unit="N m", description="load torque", low=-1e4, high=1e4, nominal=0.0),
)
CHANNELS = (
    Variable(name="charge", unit="kg/rad", description="air charge per angle times mixture influence, intake to torque"),
    Variable(name="spark_influence", unit="1", description="spark influence, spark to torque"),
)
OUTPUTS = (
    Variable(name="engine_speed", unit="rad/s", description="engine speed"),
    Variable(name="indicated_torque", unit="N m", description="torque of combustion"),
    Variable(name="friction_torque", unit="N m", description="torque lost in friction"),
    Variable(name="net_torque", unit="N m", description="torque that accelerates: indicated less friction less load"),
    Variable(name="manifold_pressure", unit="kPa", description="intake manifold pressure"),
    Variable(name="throttle_air_rate", unit="kg/s", description="air through the throttle"),
    Variable(name="cylinder_air_rate", unit="kg/s", description="air into the cylinders"),
    Variable(name="volumetric_efficiency", unit="1", description="volumetric efficiency"),
    Variable(name="engine_acceleration", unit="rad/s2", description="rate of change of the engine speed"),
)

Vector = tuple[float, ...]


def lee1995(parameters: EngineParameters = LEE_1995) -> DelaySystem:
    """Build the engine as a system with two delay channels; the type of `parameters.efficiency` chooses its relation.

    Args:
        parameters: checked by `check_parameters`.

    Raises:
        InvalidInputError: a parameter is out of range.

    Source:
        Lee (1995), chapter 2.
    """
    check_parameters(parameters)
    floats = EngineParameters._make(type(part)._make(map(float, part)) for part in parameters)
    relation = air.thesis_efficiency if isinstance(parameters.efficiency, air.ThesisEfficiency) else air.generic_efficiency
    emit, rate, output = _equations(relation)
    return DelaySystem(
        name="lee1995",
        parameters=floats,
        states=STATES,
        inputs=INPUTS,
        channels=CHANNELS,
        outputs=OUTPUTS,
        emit=emit,
        lags=engine_lags,
        rate=rate,
        output=output,
    )


@equation
def engine_lags(p: EngineParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """Lags of both channels at the present speed."""
    _, speed = x
    return torque.crank_lag(p.delays.intake_to_torque, speed), torque.crank_lag(p.delays.spark_to_torque, speed)


@equation
def engine_torque(p: EngineParameters, zd: Vector) -> float:
    """Indicated torque of what arrives from both channels."""
    charge, spark_factor = zd
    return torque.indicated_torque(p.combustion, charge, spark_factor)


def _equations(relation: Equation) -> tuple[Equation, Equation, Equation]:
    """Assemble emit, rate and output with one relation for the volumetric efficiency."""

    @equation
    def breathe(p: EngineParameters, pressure: float, speed: float) -> tuple[float, float]:
        mass = air.manifold_air_mass(p.manifold, pressure)
        efficiency = relation(p.efficiency, mass, speed)
        return efficiency, air.cylinder_flow(p.cylinders, efficiency, speed, mass)

    @equation
    def emit(p: EngineParameters, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
        pressure, speed = x
        _, air_fuel_ratio, spark, _ = u
        _, flow = breathe(p, pressure, speed)
        return flow * torque.mixture_influence(p.mixture, air_fuel_ratio) / speed, torque.spark_influence(p.spark, spark)

    @equation
    def rate(p: EngineParameters, x: Vector, u: Vector, zd: Vector) -> Vector:
        pressure, speed = x
        angle, _, _, load = u
        _, flow = breathe(p, pressure, speed)
        inflow = air.throttle_flow(p.throttle, angle, pressure)
        left = engine_torque(p, zd) - torque.friction_torque(p.friction, speed) - load
        return air.manifold_pressure_rate(p.manifold, inflow, flow), torque.acceleration(p.rotation, left)

    @equation
    def output(p: EngineParameters, x: Vector, u: Vector, zd: Vector) -> Vector:
        pressure, speed = x
        angle, _, _, load = u
        efficiency, flow = breathe(p, pressure, speed)
        indicated = engine_torque(p, zd)
        lost = torque.friction_torque(p.friction, speed)
        left = indicated - lost - load
        inflow = air.throttle_flow(p.throttle, angle, pressure)
        return speed, indicated, lost, left, pressure, inflow, flow, efficiency, torque.acceleration(p.rotation, left)

    return emit, rate, output


POSITIVE = frozenset(
    {"max_flow", "angle_slope", "saturation_angle", "pressure_exponent", "ambient_pressure", "volume", "temperature", "gas_constant"}
    | {"pumping", "exponent", "intake_to_torque", "spark_to_torque", "torque_constant", "inertia", "change_speed"}
)
"""Parameters without which the engine is none: each must be above zero."""


def lee1995_parameters(engine: DelaySystem) -> EngineParameters:
    """Give the parameters of an engine that `lee1995` built, from which it can be built again.

    Raises:
        InvalidInputError: the engine is another model, or its equations or signals were changed.
    """
    parameters = engine.parameters
    if not isinstance(parameters, EngineParameters):
        message = f"{engine.name} is no engine of Lee (1995): its parameters are {type(parameters).__name__}, not EngineParameters"
        raise InvalidInputError(message, name=engine.name)
    again = lee1995(parameters)
    changed = [
        what for what in ("equation_digest", "states", "inputs", "channels", "outputs") if getattr(engine, what) != getattr(again, what)
    ]
    if changed:
        message = (
            f"{engine.name} differs from the engine of Lee (1995) in its {', '.join(changed)}, beyond parameters: keep it as Python code"
        )
        raise InvalidInputError(message, name=engine.name)
    return again.parameters


def check_parameters(parameters: EngineParameters) -> None:
    """Refuse parameters that are no finite numbers, or outside the range that physics asks for.

    Raises:
        InvalidInputError: names the part, the parameter, its value and the limit; `details` has `quantity` and `value`.
    """
    for section, part in zip(EngineParameters._fields, parameters, strict=True):
        for name, value in zip(part._fields, part, strict=True):
            _check_parameter(f"{section}.{name}", value, unit_of(type(part), name))


def _check_parameter(quantity: str, value: object, unit: str) -> None:
    if isinstance(value, bool) or not isinstance(value, float | int | np.floating | np.integer):
        message = f"{quantity} = {value!r} is of type {type(value).__name__}; give a number in {unit}"
        raise InvalidInputError(message, quantity=quantity, value=repr(value))
    if not math.isfinite(value):
        message = f"{quantity} = {value} is no finite number; give one in {unit}"
        raise InvalidInputError(message, quantity=quantity, value=float(value))
    name = quantity.partition(".")[2]
    if name in POSITIVE and value <= 0.0:
        raise out_of_range(quantity, float(value), unit, f"the range above 0 {unit}", "give a value above 0")
    if name == "saturation_angle" and value > air.WIDE_OPEN:
        limit = f"0 to {air.WIDE_OPEN:g} {unit}"
        raise out_of_range(quantity, float(value), unit, limit, "a throttle opens no further")
