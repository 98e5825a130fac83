"""Units as types at the edges, and the few conversions between them.

A model keeps the units of its source. A unit is an annotation on a float: it costs nothing at run time and may be
read back with `unit_of`. Equations are also evaluated with complex arguments for exact derivatives, so an annotated
value is a scalar that behaves like a float, not a checked type.
"""

import math
from dataclasses import dataclass
from typing import Annotated, get_type_hints

DEGREE = math.pi / 180.0
"""One degree in radians; equations multiply by it because `numpy.radians` has no complex form."""

RPM = math.pi / 30.0
"""One revolution per minute in radians per second."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of measurement, by the symbol that files and plots show."""

    symbol: str


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a parameter is, and where its value and its relation come from; stands beside the unit in its annotation."""

    text: str
    source: str


Dimensionless = Annotated[float, Unit("1")]
Seconds = Annotated[float, Unit("s")]
Degrees = Annotated[float, Unit("deg")]
DegreesPerSecond = Annotated[float, Unit("deg/s")]
Radians = Annotated[float, Unit("rad")]
RadiansPerSecond = Annotated[float, Unit("rad/s")]
RadiansPerSecondSquared = Annotated[float, Unit("rad/s2")]
PerSecond = Annotated[float, Unit("1/s")]
Kelvin = Annotated[float, Unit("K")]
Kilograms = Annotated[float, Unit("kg")]
PerKilogram = Annotated[float, Unit("1/kg")]
PerKilogramSquared = Annotated[float, Unit("1/kg2")]
SecondsPerRadian = Annotated[float, Unit("s/rad")]
SecondsSquaredPerRadianSquared = Annotated[float, Unit("s2/rad2")]
SecondsPerRadianKilogram = Annotated[float, Unit("s/(rad kg)")]
SecondsPerRadianKilogramSquared = Annotated[float, Unit("s/(rad kg2)")]
KilogramsPerSecond = Annotated[float, Unit("kg/s")]
KilogramsPerRadian = Annotated[float, Unit("kg/rad")]
Kilopascals = Annotated[float, Unit("kPa")]
KilopascalsPerSecond = Annotated[float, Unit("kPa/s")]
CubicMetres = Annotated[float, Unit("m3")]
KilojoulesPerKilogramKelvin = Annotated[float, Unit("kJ/(kg K)")]
NewtonMetres = Annotated[float, Unit("N m")]
NewtonMetreSeconds = Annotated[float, Unit("N m s/rad")]
NewtonMetresPerKilogram = Annotated[float, Unit("N m/kg")]
KilogramSquareMetres = Annotated[float, Unit("kg m2")]


def unit_of(record: type, field: str) -> str:
    """Read the unit symbol that a record's field is annotated with.

    Args:
        record: class with annotated fields, for example a NamedTuple of parameters.
        field: name of the field.

    Returns:
        The symbol, "1" where the field is a plain number.
    """
    symbols = [note.symbol for note in _annotations(record, field) if isinstance(note, Unit)]
    return symbols[0] if symbols else "1"


def meaning_of(record: type, field: str) -> Meaning:
    """Read the meaning and the source that a record's field is annotated with.

    Args:
        record: class with annotated fields, for example a NamedTuple of parameters.
        field: name of the field.

    Returns:
        The annotation; where there is none, the field's name in words and no source.
    """
    meanings = [note for note in _annotations(record, field) if isinstance(note, Meaning)]
    return meanings[0] if meanings else Meaning(field.replace("_", " "), "")


def _annotations(record: type, field: str) -> tuple[object, ...]:
    return getattr(get_type_hints(record, include_extras=True)[field], "__metadata__", ())


def speed_to_rpm(speed: RadiansPerSecond) -> float:
    """Convert rad/s to revolutions per minute."""
    return speed / RPM


def rpm_to_speed(speed_rpm: float) -> RadiansPerSecond:
    """Convert revolutions per minute to rad/s."""
    return speed_rpm * RPM
