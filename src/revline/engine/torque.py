"""Torque: what burning gives, what friction takes, and how old both influences are.

Source: Lee (1995), eqs. 2.13-2.17, with the data of Cho and Hedrick (1989) and Moskwa and Hedrick (1992).
"""

from typing import Annotated, NamedTuple

import numpy as np

from revline.equations import equation
from revline.units import (
    DEGREE,
    Degrees,
    Dimensionless,
    KilogramsPerRadian,
    KilogramSquareMetres,
    Meaning,
    NewtonMetres,
    NewtonMetreSeconds,
    NewtonMetresPerKilogram,
    Radians,
    RadiansPerSecond,
    RadiansPerSecondSquared,
    Seconds,
)


class Mixture(NamedTuple):
    """Influence of the air/fuel ratio. Source: Lee (1995), chapter 2; Cho and Hedrick (1989)."""

    angle_per_ratio: Annotated[
        Degrees, Meaning("angle of the influence's cosine per unit of air/fuel ratio", "Lee (1995), chapter 2; Cho and Hedrick (1989)")
    ]
    best_ratio: Annotated[Dimensionless, Meaning("air/fuel ratio of best torque", "Lee (1995), chapter 2; Cho and Hedrick (1989)")]


class Spark(NamedTuple):
    """Influence of the spark advance; `best_torque_angle` (MBT) only shifts an absolute angle, the input is relative to it.

    Source: Lee (1995), chapter 2.
    """

    best_torque_angle: Annotated[
        Degrees, Meaning("spark advance of best torque (MBT); only shifts an absolute angle", "Lee (1995), chapter 2")
    ]
    exponent: Annotated[Dimensionless, Meaning("exponent of the influence's cosine", "Lee (1995), chapter 2; Cho and Hedrick (1989)")]


class Delays(NamedTuple):
    """Crank angles from intake and from spark to torque; over speed they are lags.

    Source: Lee (1995), eqs. 2.13 and 2.14; Moskwa and Hedrick (1992).
    """

    intake_to_torque: Annotated[Radians, Meaning("crank angle from intake to torque", "Lee (1995), eq. 2.13; Moskwa and Hedrick (1992)")]
    spark_to_torque: Annotated[Radians, Meaning("crank angle from spark to torque", "Lee (1995), eq. 2.14; Moskwa and Hedrick (1992)")]


class Combustion(NamedTuple):
    """Torque for the charge burnt. Source: Lee (1995), eq. 2.15."""

    torque_constant: Annotated[NewtonMetresPerKilogram, Meaning("torque per charge", "Lee (1995), eq. 2.15; Cho and Hedrick (1989)")]


class Friction(NamedTuple):
    """Friction of the engine, linear in speed. Source: Lee (1995), eq. 2.16."""

    constant: Annotated[NewtonMetres, Meaning("friction at standstill", "Lee (1995), eq. 2.16; Cho and Hedrick (1989)")]
    viscous: Annotated[NewtonMetreSeconds, Meaning("rise of friction with speed", "Lee (1995), eq. 2.16; Cho and Hedrick (1989)")]


class Rotation(NamedTuple):
    """Rotating mass of engine and load. Source: Lee (1995), eq. 2.17."""

    inertia: Annotated[KilogramSquareMetres, Meaning("inertia of engine and load", "Lee (1995), eq. 2.17; Cho and Hedrick (1989)")]


@equation
def mixture_influence(mixture: Mixture, air_fuel_ratio: Dimensionless) -> Dimensionless:
    """Torque factor of the air/fuel ratio, never below none; a mixture too lean to burn stays so. Source: Lee (1995), chapter 2."""
    angle = mixture.angle_per_ratio * (air_fuel_ratio - mixture.best_ratio)
    # Without the limit the cosine would rise again beyond 270 degrees, an air/fuel ratio of 50.
    return np.maximum(np.cos(np.minimum(np.maximum(angle, -180.0), 180.0) * DEGREE), 0.0)


@equation
def spark_influence(spark: Spark, advance: Degrees) -> Dimensionless:
    """Torque factor of the spark advance relative to that of best torque, within 90 degrees of it. Source: Lee (1995), chapter 2."""
    return np.cos(advance * DEGREE) ** spark.exponent


@equation
def crank_lag(angle: Radians, speed: RadiansPerSecond) -> Seconds:
    """Time that the crank takes for an angle at the present speed. Source: Lee (1995), eqs. 2.13 and 2.14."""
    return angle / speed


@equation
def indicated_torque(combustion: Combustion, charge: KilogramsPerRadian, spark_factor: Dimensionless) -> NewtonMetres:
    """Torque of the charge and the spark factor that arrive now. Source: Lee (1995), eq. 2.15."""
    return combustion.torque_constant * charge * spark_factor


@equation
def friction_torque(friction: Friction, speed: RadiansPerSecond) -> NewtonMetres:
    """Friction torque. Source: Lee (1995), eq. 2.16."""
    return friction.constant + friction.viscous * speed


@equation
def acceleration(rotation: Rotation, torque: NewtonMetres) -> RadiansPerSecondSquared:
    """Acceleration under the torque that is left. Source: Lee (1995), eq. 2.17."""
    return torque / rotation.inertia
