"""Air path: throttle, intake manifold, and what the cylinders draw.

Source: Lee (1995), eqs. 2.1-2.9, with the data of Cho and Hedrick (1989).
"""

from typing import Annotated, NamedTuple

import numpy as np

from revline.equations import equation
from revline.units import (
    DEGREE,
    CubicMetres,
    Degrees,
    Dimensionless,
    Kelvin,
    Kilograms,
    KilogramsPerSecond,
    KilojoulesPerKilogramKelvin,
    Kilopascals,
    KilopascalsPerSecond,
    Meaning,
    PerKilogram,
    PerKilogramSquared,
    RadiansPerSecond,
    SecondsPerRadian,
    SecondsPerRadianKilogram,
    SecondsPerRadianKilogramSquared,
    SecondsSquaredPerRadianSquared,
)

WIDE_OPEN = 90.0
"""Throttle angle beyond which nothing opens further, in degrees. Source: Lee (1995), eq. 2.3."""


class Throttle(NamedTuple):
    """Butterfly throttle. Source: Lee (1995), eqs. 2.1-2.3; Cho and Hedrick (1989)."""

    max_flow: Annotated[KilogramsPerSecond, Meaning("largest air flow through the throttle", "Lee (1995), eq. 2.1; Cho and Hedrick (1989)")]
    angle_slope: Annotated[
        Dimensionless, Meaning("slope of the corrected angle over the throttle angle", "Lee (1995), eq. 2.3; Cho and Hedrick (1989)")
    ]
    angle_offset: Annotated[Degrees, Meaning("corrected angle of a closed throttle", "Lee (1995), eq. 2.3; Cho and Hedrick (1989)")]
    saturation_angle: Annotated[
        Degrees, Meaning("angle from which the throttle counts as fully open; upper limit of controllers", "Lee (1995), eq. 2.3")
    ]
    pressure_exponent: Annotated[
        Dimensionless, Meaning("steepness of the pressure-ratio influence", "Lee (1995), eq. 2.2; Cho and Hedrick (1989)")
    ]
    ambient_pressure: Annotated[Kilopascals, Meaning("pressure before the throttle", "Lee (1995), eq. 2.2")]


class Manifold(NamedTuple):
    """Intake manifold at constant temperature. Source: Lee (1995), eq. 2.8."""

    volume: Annotated[CubicMetres, Meaning("volume of the intake manifold", "Lee (1995), eq. 2.8; Cho and Hedrick (1989)")]
    temperature: Annotated[Kelvin, Meaning("temperature of the air in the manifold", "Lee (1995), eq. 2.8; Cho and Hedrick (1989)")]
    gas_constant: Annotated[KilojoulesPerKilogramKelvin, Meaning("gas constant of air", "Lee (1995), eq. 2.8")]


class ThesisEfficiency(NamedTuple):
    """Volumetric efficiency as a polynomial in manifold air mass and speed. Source: Lee (1995), eq. 2.5; Cho and Hedrick (1989).

    The program listing of Lee (1995) prints the constant of the squared mass as 0.00031; the responses of its Table 4.1
    come out only with -3.1e4, the value of Cho and Hedrick.
    """

    mass_squared_speed: Annotated[
        SecondsPerRadianKilogramSquared,
        Meaning("coefficient of squared air mass times speed", "Lee (1995), eq. 2.5; Cho and Hedrick (1989)"),
    ]
    mass_squared: Annotated[
        PerKilogramSquared, Meaning("coefficient of squared air mass", "Cho and Hedrick (1989); misprinted in the listing of Lee (1995)")
    ]
    mass_speed: Annotated[
        SecondsPerRadianKilogram, Meaning("coefficient of air mass times speed", "Lee (1995), eq. 2.5; Cho and Hedrick (1989)")
    ]
    mass: Annotated[PerKilogram, Meaning("coefficient of air mass", "Lee (1995), eq. 2.5; Cho and Hedrick (1989)")]
    speed: Annotated[SecondsPerRadian, Meaning("coefficient of speed", "Lee (1995), eq. 2.5; Cho and Hedrick (1989)")]
    constant: Annotated[Dimensionless, Meaning("constant part", "Lee (1995), eq. 2.5; Cho and Hedrick (1989)")]


class GenericEfficiency(NamedTuple):
    """Volumetric efficiency as a function of speed alone: a line, then a parabola. Source: Lee (1995), chapter 2."""

    line_constant: Annotated[Dimensionless, Meaning("efficiency at the origin of the line", "Lee (1995), chapter 2")]
    line_slope: Annotated[SecondsPerRadian, Meaning("slope of the line", "Lee (1995), chapter 2")]
    line_origin: Annotated[RadiansPerSecond, Meaning("speed from which the line is counted", "Lee (1995), chapter 2")]
    change_speed: Annotated[RadiansPerSecond, Meaning("speed at which the parabola takes over from the line", "Lee (1995), chapter 2")]
    parabola_squared: Annotated[
        SecondsSquaredPerRadianSquared, Meaning("coefficient of squared speed in the parabola", "Lee (1995), chapter 2")
    ]
    parabola_slope: Annotated[SecondsPerRadian, Meaning("coefficient of speed in the parabola", "Lee (1995), chapter 2")]


class Cylinders(NamedTuple):
    """Pumping of the cylinders: displacement over four pi times manifold volume. Source: Lee (1995), eq. 2.9."""

    pumping: Annotated[Dimensionless, Meaning("displacement over four pi times manifold volume", "Lee (1995), eqs. 2.5 and 2.9")]


@equation
def pressure_influence(throttle: Throttle, pressure: Kilopascals) -> Dimensionless:
    """Flow factor of the pressure ratio: 1 far below ambient, none at ambient. Source: Lee (1995), eq. 2.2."""
    ratio = np.minimum(np.maximum(pressure / throttle.ambient_pressure, 0.0), 1.0)
    return 1.0 - np.exp(throttle.pressure_exponent * (ratio - 1.0))


@equation
def throttle_characteristic(throttle: Throttle, angle: Degrees) -> Dimensionless:
    """Opening of the throttle over its angle, 0 to 1. Source: Lee (1995), eq. 2.3."""
    limited = np.minimum(np.maximum(angle, 0.0), WIDE_OPEN)
    return 1.0 - np.cos(np.minimum(throttle.angle_slope * limited + throttle.angle_offset, 90.0) * DEGREE)


@equation
def throttle_flow(throttle: Throttle, angle: Degrees, pressure: Kilopascals) -> KilogramsPerSecond:
    """Air through the throttle. Source: Lee (1995), eq. 2.1."""
    return throttle.max_flow * pressure_influence(throttle, pressure) * throttle_characteristic(throttle, angle)


@equation
def manifold_air_mass(manifold: Manifold, pressure: Kilopascals) -> Kilograms:
    """Air in the manifold: kPa m3 over kJ/(kg K) K gives kg."""
    return pressure * manifold.volume / (manifold.gas_constant * manifold.temperature)


@equation
def manifold_pressure_rate(manifold: Manifold, inflow: KilogramsPerSecond, outflow: KilogramsPerSecond) -> KilopascalsPerSecond:
    """Filling of the manifold at constant temperature. Source: Lee (1995), eq. 2.8."""
    return manifold.gas_constant * manifold.temperature / manifold.volume * (inflow - outflow)


@equation
def thesis_efficiency(efficiency: ThesisEfficiency, mass: Kilograms, speed: RadiansPerSecond) -> Dimensionless:
    """Volumetric efficiency over air mass and speed. Source: Lee (1995), eq. 2.5."""
    quadratic = (efficiency.mass_squared_speed * speed + efficiency.mass_squared) * mass * mass
    return quadratic + (efficiency.mass_speed * speed + efficiency.mass) * mass + efficiency.speed * speed + efficiency.constant


@equation
def generic_efficiency(efficiency: GenericEfficiency, mass: Kilograms, speed: RadiansPerSecond) -> Dimensionless:  # noqa: ARG001 - one signature for both
    """Volumetric efficiency over speed alone, made continuous where its pieces meet (they miss by 1.3e-7).

    Source: Lee (1995), chapter 2.
    """
    slow = np.minimum(speed, efficiency.change_speed)
    fast = np.maximum(speed, efficiency.change_speed)
    line = efficiency.line_constant + efficiency.line_slope * (slow - efficiency.line_origin)
    rise = efficiency.parabola_slope * (fast - efficiency.change_speed)
    return line + rise + efficiency.parabola_squared * (fast * fast - efficiency.change_speed * efficiency.change_speed)


@equation
def cylinder_flow(cylinders: Cylinders, efficiency: Dimensionless, speed: RadiansPerSecond, mass: Kilograms) -> KilogramsPerSecond:
    """Air drawn by the cylinders. Source: Lee (1995), eqs. 2.5 and 2.9."""
    return cylinders.pumping * efficiency * speed * mass
